//! Force-sharing problems for tests: random ones like a leg's, and the second solver's answer to them.

#![allow(non_snake_case)]

use multibody::sharing::{Names, SharingProblem};
use nalgebra::{DMatrix, DVector};

use crate::Random;
use crate::goldfarb_idnani::{Constraint, minimise};

/// Names `c0..`, `m0..`, `x0..` for a problem.
pub fn names(problem: &SharingProblem) -> Names {
    let numbered = |letter: &str, n: usize| (0..n).map(|i| format!("{letter}{i}")).collect();
    Names {
        coordinates: numbered("c", problem.n_coordinates()),
        muscles: numbered("m", problem.n_muscles()),
        reactions: numbered("x", problem.n_reactions()),
    }
}

/// A problem of the size of a leg or smaller: lever arms to 8 cm, half of them zero; some forces bounded above;
/// x with and without bounds and weights; moments that some admissible tensions supply, except that
/// about one problem in seven asks for more. Bounds of x leave these tensions some room: on the very edge of
/// feasibility round-off decides which solver is right.
pub fn random_problem(random: &mut Random) -> SharingProblem {
    let nc = random.integer(1, 6);
    let nm = random.integer(nc + 2, 43);
    let nx = random.integer(0, 19);
    let mut R =
        DMatrix::from_fn(nc, nm, |_, _| if random.chance(0.5) { 0.0 } else { random.between(-0.08, 0.08) });
    for k in 0..nc {
        R[(k, random.integer(0, nm - 1))] = random.between(0.01, 0.08);
    }
    let X = DMatrix::from_fn(nx, nm, |_, _| if random.chance(0.3) { 0.0 } else { random.between(-1.5, 1.5) });
    let bounded = random.between(0.0, 1.0);
    let upper_f = DVector::from_fn(nm, |_, _| {
        if random.chance(bounded) { random.between(100.0, 2000.0) } else { f64::INFINITY }
    });
    let tension = DVector::from_fn(nm, |i, _| {
        if random.chance(0.6) { 0.0 } else { random.between(0.0, upper_f[i].min(1500.0)) }
    });
    let x0 = DVector::from_fn(nx, |_, _| random.between(-300.0, 300.0));
    let x = &x0 + &X * &tension;
    let lower_x = DVector::from_fn(nx, |j, _| match random.integer(0, 3) {
        0 => f64::NEG_INFINITY,
        1 => x[j] - random.between(0.0, 300.0),
        _ => (x[j] - random.between(1.0, 50.0)).min(0.0),
    });
    let upper_x = DVector::from_fn(nx, |j, _| {
        if random.chance(0.2) { x[j] + random.between(1.0, 500.0) } else { f64::INFINITY }
    });
    let excess = if random.chance(0.15) { random.between(2.0, 20.0) } else { 1.0 };
    let tau = &R * &tension * excess;
    let spread = random.between(0.0, 4.0);
    let w_f = DVector::from_fn(nm, |_, _| 10f64.powf(random.between(-spread, spread) / 2.0));
    let weighted = random.chance(0.6);
    let w_x =
        DVector::from_fn(
            nx,
            |_, _| if weighted { [0.0, 1e-6, 1.0, 2.0, 4.0][random.integer(0, 4)] } else { 0.0 },
        );
    let w_s = random.chance(0.1).then(|| DVector::from_fn(nc, |_, _| 10f64.powf(random.between(0.0, 4.0))));
    let target_f = random.chance(0.3).then(|| {
        DVector::from_fn(nm, |i, _| {
            if upper_f[i].is_finite() { random.between(-0.2, 1.2) * upper_f[i] } else { 0.0 }
        })
    });
    SharingProblem {
        R,
        tau,
        x0,
        X,
        lower_f: DVector::zeros(nm),
        upper_f,
        lower_x,
        upper_x,
        w_f,
        target_f,
        w_x,
        w_s,
    }
}

/// The tensions that the second solver finds; `None` when it says that there are none.
pub fn second_opinion(p: &SharingProblem) -> Option<DVector<f64>> {
    let (nm, nc) = (p.n_muscles(), p.n_coordinates());
    let ns = p.w_s.as_ref().map_or(0, |_| nc);
    let n = nm + ns;
    let W = DMatrix::from_diagonal(&p.w_x);
    let mut G = DMatrix::zeros(n, n);
    G.view_mut((0, 0), (nm, nm)).copy_from(&(DMatrix::from_diagonal(&p.w_f) + p.X.transpose() * &W * &p.X));
    let mut a = DVector::zeros(n);
    a.rows_mut(0, nm).copy_from(&(p.X.transpose() * &W * &p.x0));
    if let Some(target) = &p.target_f {
        let mut muscles = a.rows_mut(0, nm);
        muscles -= p.w_f.component_mul(target);
    }
    for k in 0..ns {
        G[(nm + k, nm + k)] = p.reserve_weight(k);
    }
    let mut constraints = Vec::new();
    for k in 0..nc {
        let mut normal = DVector::zeros(n);
        normal.rows_mut(0, nm).copy_from(&p.R.row(k).transpose());
        if ns > 0 {
            normal[nm + k] = 1.0;
        }
        constraints.push(Constraint { n: normal, b: p.tau[k] });
    }
    let mut one_sided = |normal: DVector<f64>, lower: f64, upper: f64| {
        if lower.is_finite() {
            constraints.push(Constraint { n: normal.clone(), b: lower });
        }
        if upper.is_finite() {
            constraints.push(Constraint { n: -normal, b: -upper });
        }
    };
    for i in 0..nm {
        let mut normal = DVector::zeros(n);
        normal[i] = 1.0;
        one_sided(normal, p.lower_f[i], p.upper_f[i]);
    }
    for j in 0..p.n_reactions() {
        let mut normal = DVector::zeros(n);
        normal.rows_mut(0, nm).copy_from(&p.X.row(j).transpose());
        one_sided(normal, p.lower_x[j] - p.x0[j], p.upper_x[j] - p.x0[j]);
    }
    minimise(&G, &a, &constraints, nc).map(|y| y.rows(0, nm).into_owned())
}
