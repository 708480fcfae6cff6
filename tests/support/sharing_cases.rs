//! Hard cases of force sharing (Q1 to Q5), each a function that says what decided it or what went wrong.

#![allow(non_snake_case)]

use multibody::sharing::{
    Capacity, KKT_TOLERANCE, MuscleCost, Sharing, SharingOptions, SharingProblem, SharingSolver,
    muscle_weights,
};
use multibody::trial::Status;
use nalgebra::{DMatrix, DVector};

use crate::Random;
use crate::sharing_problems::{names, random_problem, second_opinion};

type Outcome = Result<String, String>;

/// `Err(message)` unless `condition`.
fn ensure(condition: bool, message: impl FnOnce() -> String) -> Result<(), String> {
    if condition { Ok(()) } else { Err(message()) }
}

/// Solves with a fresh solver.
pub fn solve(problem: &SharingProblem) -> Sharing {
    SharingSolver::new(names(problem), SharingOptions::default()).solve(problem).expect("well posed")
}

/// Solves with raised strengths allowed.
pub fn solve_raised(problem: &SharingProblem, limit: f64) -> Sharing {
    let options = SharingOptions { raise_bounds: Some(limit) };
    SharingSolver::new(names(problem), options).solve(problem).expect("well posed")
}

/// Strengths, optimal fibre lengths and a problem of a leg's size that costs `cost`: 6 coordinates, 43 muscles of 200 to
/// 2000 N, 10 x with bounds, weighted or not. Half the strength or less is needed.
pub fn leg(seed: u64, cost: MuscleCost, weighted: bool) -> (Capacity, Vec<f64>, SharingProblem) {
    let mut random = Random::new(seed);
    let (nc, nm, nx) = (6, 43, 10);
    let strength: Vec<f64> = (0..nm).map(|_| random.between(200.0, 2000.0)).collect();
    let l_opt: Vec<f64> = (0..nm).map(|_| random.between(0.03, 0.3)).collect();
    let R =
        DMatrix::from_fn(nc, nm, |_, _| if random.chance(0.5) { 0.0 } else { random.between(-0.08, 0.08) });
    let X = DMatrix::from_fn(nx, nm, |_, _| random.between(-1.0, 1.5));
    let tension =
        DVector::from_fn(
            nm,
            |i, _| if random.chance(0.6) { 0.0 } else { random.between(0.0, 0.5) * strength[i] },
        );
    let x0 = DVector::from_fn(nx, |_, _| random.between(-300.0, 300.0));
    let x = &x0 + &X * &tension;
    let capacity = Capacity::nominal(strength.clone());
    let problem = SharingProblem {
        tau: &R * &tension,
        R,
        X,
        lower_f: DVector::zeros(nm),
        upper_f: DVector::from_vec(strength),
        lower_x: x.map(|x| (x - 50.0).min(0.0)),
        upper_x: DVector::repeat(nx, f64::INFINITY),
        w_f: muscle_weights(cost, &capacity, &l_opt),
        target_f: None,
        w_x: DVector::from_fn(nx, |j, _| if weighted { [1e-6, 1.0, 2.0][j % 3] } else { 0.0 }),
        w_s: None,
        x0,
    };
    (capacity, l_opt, problem)
}

/// Q1: twice the capacity. The moment that is left is the least possible: no admissible tensions come closer, which
/// for a box is known in closed form, max_f vᵀ R f = Σ max(0, (vᵀR)_i) F_i.
pub fn infeasible_load() -> Outcome {
    let mut worst = 0.0f64;
    for seed in 1..=100 {
        let (capacity, _, mut problem) = leg(seed, MuscleCost::Force, false);
        problem.lower_x.fill(f64::NEG_INFINITY);
        let F = DVector::from_vec(capacity.force_per_activation);
        // The load in the direction of tau that all muscles together can just bear is found by the farthest vertex.
        let reach: f64 = problem.R.tr_mul(&problem.tau).iter().zip(&F).map(|(g, F)| g.max(0.0) * F).sum();
        problem.tau *= 2.0 * reach / problem.tau.norm_squared();
        let answer = solve(&problem);
        let verdict = &answer.verdict;
        ensure(verdict.status == Status::Infeasible, || format!("seed {seed}: {verdict:?}"))?;
        let v = &problem.tau - &problem.R * &answer.f;
        ensure((&v - &answer.missing).amax() < 1e-9 * v.amax(), || {
            format!("seed {seed}: missing is not tau − R f")
        })?;
        let best: f64 = problem.R.tr_mul(&v).iter().zip(&F).map(|(g, F)| g.max(0.0) * F).sum();
        let gap = (best - v.dot(&(&problem.R * &answer.f))) / v.norm_squared();
        worst = worst.max(gap);
        ensure(gap.abs() < 1e-6, || format!("seed {seed}: another tension misses less, gap {gap:.1e}"))?;
        ensure(!verdict.saturated.is_empty(), || format!("seed {seed}: {verdict:?}"))?;
        for (k, v) in v.iter().enumerate() {
            let listed = verdict.shortfall.iter().find(|s| s.coordinate == format!("c{k}"));
            let right =
                listed.map_or(v.abs() < 1e-5 * problem.tau.amax(), |s| s.missing == answer.missing[k]);
            ensure(right, || format!("seed {seed}: c{k} lacks {v} N·m, {:?}", verdict.shortfall))?;
        }
        for (i, F) in F.iter().enumerate() {
            let named = verdict.saturated.contains(&format!("m{i}"));
            ensure(named == (answer.f[i] == *F), || format!("seed {seed}: m{i} saturated or not"))?;
        }
    }
    Ok(format!("100 loads of twice the capacity, least-violation gap {worst:.1e}"))
}

/// `problem` with muscle `m` replaced by `copies` equal parts of its strength.
pub fn split(
    capacity: &Capacity,
    l_opt: &[f64],
    problem: &SharingProblem,
    m: usize,
    copies: usize,
    cost: MuscleCost,
) -> SharingProblem {
    let source: Vec<usize> = (0..problem.n_muscles()).chain(std::iter::repeat_n(m, copies - 1)).collect();
    let fraction = |i: usize| if source[i] == m { 1.0 / copies as f64 } else { 1.0 };
    let strength: Vec<f64> =
        (0..source.len()).map(|i| capacity.force_per_activation[source[i]] * fraction(i)).collect();
    let l_opt: Vec<f64> = source.iter().map(|i| l_opt[*i]).collect();
    SharingProblem {
        R: problem.R.select_columns(&source),
        X: problem.X.select_columns(&source),
        lower_f: DVector::zeros(source.len()),
        w_f: muscle_weights(cost, &Capacity::nominal(strength.clone()), &l_opt),
        target_f: None,
        upper_f: DVector::from_vec(strength),
        ..problem.clone()
    }
}

/// Largest change of a total force, relative to the largest force, when muscle `m` is split.
pub fn change_by_splitting(
    seed: u64,
    cost: MuscleCost,
    weighted: bool,
    copies: usize,
) -> Result<f64, String> {
    let (capacity, l_opt, problem) = leg(seed, cost, weighted);
    let whole = solve(&problem);
    ensure(whole.verdict.status == Status::Solved, || format!("{:?}", whole.verdict))?;
    let m = whole.f.imax();
    let parts = solve(&split(&capacity, &l_opt, &problem, m, copies, cost));
    ensure(parts.verdict.status == Status::Solved, || format!("{copies} copies: {:?}", parts.verdict))?;
    let n = problem.n_muscles();
    let mut total = parts.f.rows(0, n).into_owned();
    total[m] += parts.f.rows(n, copies - 1).sum();
    Ok((total - &whole.f).amax() / whole.f.amax())
}

/// Q2: a muscle split in 2, 10, 100 parts. Totals stay with volume weighting, and move with the other costs.
pub fn redundant_copies() -> Outcome {
    let mut worst = 0.0f64;
    for copies in [2, 10, 100] {
        for seed in 1..=10 {
            for weighted in [false, true] {
                worst = worst.max(change_by_splitting(seed, MuscleCost::Volume, weighted, copies)?);
            }
        }
    }
    ensure(worst < 1e-6, || format!("totals change by {worst:.1e} with volume weighting"))?;
    let other = change_by_splitting(1, MuscleCost::Activation, false, 10)?;
    ensure(other > 1e-2, || format!("squared activations should prefer copies, change {other:.1e}"))?;
    Ok(format!("change {worst:.1e} (squared activations: {other:.2})"))
}

/// Q3: two parallel muscles and a coordinate that no muscle moves, without and with a moment on it; dependent rows.
pub fn rank_deficient() -> Outcome {
    let problem = SharingProblem {
        R: DMatrix::from_row_slice(
            3,
            4,
            &[0.04, 0.04, -0.03, 0.0, 0.0, 0.0, 0.0, 0.0, 0.08, 0.08, -0.06, 0.0],
        ),
        tau: DVector::from_vec(vec![20.0, 0.0, 40.0]),
        x0: DVector::zeros(0),
        X: DMatrix::zeros(0, 4),
        lower_f: DVector::zeros(4),
        upper_f: DVector::repeat(4, f64::INFINITY),
        lower_x: DVector::zeros(0),
        upper_x: DVector::zeros(0),
        w_f: DVector::repeat(4, 1.0),
        target_f: None,
        w_x: DVector::zeros(0),
        w_s: None,
    };
    let free = solve(&problem);
    ensure(free.verdict.status == Status::Solved, || format!("no moment on c1: {:?}", free.verdict))?;
    let expected = DVector::from_vec(vec![250.0, 250.0, 0.0, 0.0]);
    let error = (&free.f - expected).amax();
    ensure(error < 1e-9, || format!("not the minimum-norm answer: {}", free.f))?;
    ensure(free.unactuated == [1], || format!("unactuated {:?}", free.unactuated))?;

    let loaded = solve(&SharingProblem { tau: DVector::from_vec(vec![20.0, -3.0, 40.0]), ..problem.clone() });
    let [shortfall] = &loaded.verdict.shortfall[..] else { return Err(format!("{:?}", loaded.verdict)) };
    ensure(shortfall.coordinate == "c1" && (shortfall.missing + 3.0).abs() < 1e-6, || {
        format!("{shortfall:?}")
    })?;
    let reason = loaded.verdict.reason.unwrap_or_default();
    ensure(
        loaded.verdict.status == Status::Infeasible
            && reason.contains("c1 lacks -3.000 N·m (no muscle moves it)"),
        || reason.clone(),
    )?;

    let contradiction = solve(&SharingProblem { tau: DVector::from_vec(vec![20.0, 0.0, 50.0]), ..problem });
    ensure(contradiction.verdict.status == Status::Infeasible, || format!("{:?}", contradiction.verdict))?;
    Ok(format!("minimum-norm answer to {error:.1e} N; unactuated coordinate named: {reason}"))
}

/// Q4: the same leg in N and kN (and kN·m), with all strengths and loads from 1 to 1e5 N, and with single muscles
/// made up to 1e5 times stronger on shorter lever arms: same activations.
pub fn scaling() -> Outcome {
    let mut worst = 0.0f64;
    for seed in 1..=20 {
        for weighted in [false, true] {
            let (capacity, _, problem) = leg(seed, MuscleCost::Activation, weighted);
            let F = DVector::from_vec(capacity.force_per_activation);
            let activation = |p: &SharingProblem, F: &DVector<f64>| -> Result<DVector<f64>, String> {
                let answer = solve(p);
                ensure(answer.verdict.status == Status::Solved, || {
                    format!("seed {seed}: {:?}", answer.verdict)
                })?;
                Ok(answer.f.component_div(F))
            };
            let reference = activation(&problem, &F)?;
            let mut compare = |p: &SharingProblem, F: &DVector<f64>| -> Result<(), String> {
                worst = worst.max((activation(p, F)? - &reference).amax());
                Ok(())
            };
            for unit in [1e-3, 1.0 / F.max(), 1e5 / F.max()] {
                let in_unit = SharingProblem {
                    tau: &problem.tau * unit,
                    x0: &problem.x0 * unit,
                    lower_x: &problem.lower_x * unit,
                    upper_f: &problem.upper_f * unit,
                    w_f: &problem.w_f / (unit * unit),
                    w_x: &problem.w_x / (unit * unit),
                    ..problem.clone()
                };
                compare(&in_unit, &(&F * unit))?;
                // Forces in the unit, moments still in N·m.
                compare(
                    &SharingProblem { R: &in_unit.R / unit, tau: problem.tau.clone(), ..in_unit },
                    &(&F * unit),
                )?;
            }
            let mut random = Random::new(seed);
            let factor = DVector::from_fn(F.len(), |_, _| 10f64.powf(random.between(-3.0, 2.0)));
            let shorter = |M: &DMatrix<f64>| M * DMatrix::from_diagonal(&factor.map(|c| 1.0 / c));
            let stronger = SharingProblem {
                R: shorter(&problem.R),
                X: shorter(&problem.X),
                upper_f: problem.upper_f.component_mul(&factor),
                w_f: problem.w_f.component_div(&factor.component_mul(&factor)),
                ..problem.clone()
            };
            compare(&stronger, &F.component_mul(&factor))?;
        }
    }
    ensure(worst < 1e-9, || format!("activations change by {worst:.1e}"))?;
    Ok(format!("activations agree to {worst:.1e}"))
}

/// Q5: `n` random problems: KKT residuals, agreement with a second solver, the same opinion on feasibility.
pub fn random_problems(n: usize) -> Outcome {
    let mut random = Random::new(1);
    let (mut infeasible, mut worst_kkt, mut worst_difference) = (0, 0.0f64, 0.0f64);
    for case in 0..n {
        let problem = random_problem(&mut random);
        let answer = solve(&problem);
        let status = answer.verdict.status;
        let Some(f) = second_opinion(&problem) else {
            ensure(status == Status::Infeasible, || format!("case {case}: {:?}", answer.verdict))?;
            infeasible += 1;
            continue;
        };
        ensure(status == Status::Solved, || format!("case {case}: {:?}", answer.verdict))?;
        worst_kkt = worst_kkt.max(answer.residuals.largest());
        worst_difference = worst_difference.max((&answer.f - &f).amax() / f.amax().max(1.0));
    }
    ensure(worst_kkt < KKT_TOLERANCE, || format!("KKT residual {worst_kkt:.1e}"))?;
    ensure(worst_difference < 1e-8, || format!("the solvers differ by {worst_difference:.1e}"))?;
    ensure(20 * infeasible > n && 2 * infeasible < n, || {
        format!("{infeasible} of {n} infeasible: no fair mix")
    })?;
    Ok(format!(
        "KKT {worst_kkt:.1e}, 0 disagreements (forces to {worst_difference:.1e}), {infeasible} of {n} infeasible"
    ))
}
