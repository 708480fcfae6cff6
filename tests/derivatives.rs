//! Is every stress, force and stiffness the derivative of its energy?
//!
//! Each row of the tables is one law, element or effect; a new one is one more row. The order at which the Taylor
//! remainder falls is asserted (2 for a true derivative), never a tolerance on a difference quotient.

#![allow(non_snake_case)]

use fem::effect::chain::{Chain, Chains};
use fem::effect::{
    Anchored, DeadLoad, Effect, Lines, Membrane, NO_NODE, PatchPressure, Pressure, Solid, State,
};
use fem::effect::{line::Segment, solid::Uniform};
use fem::element::principal::lifted_tangent;
use fem::element::{Formulation, shape};
use fem::material::force_length::ForceLength;
use fem::material::line::{FibreStrain, HillFibre, LineLaw, Strand, ThermalFibre};
use fem::material::membrane::MembraneLaw;
use fem::material::user::At;
use fem::material::*;
use support::{Random, taylor_order};

use crate::laws::{Active, Guccione};

/// The smaller order; not a number where either is none.
fn least(a: f64, b: f64) -> f64 {
    if b.is_nan() { b } else { a.min(b) }
}

type MixedFunction<T> = Box<dyn Fn(&Matrix3, f64) -> T>;
type PlainFunction = Box<dyn Fn(&Matrix3) -> Matrix9>;
/// Name, effect and reference points.
type Sample = (&'static str, Box<dyn Effect>, Vec<[f64; 3]>);

/// A law behind plain functions of F and θ, so that all sit in one table.
struct Law {
    name: &'static str,
    energy: MixedFunction<f64>,
    stress: MixedFunction<(Matrix3, f64)>,
    tangent: MixedFunction<Mixed>,
    /// Energy and stress in the first two columns; tangent.
    plain: [PlainFunction; 2],
    inverted: bool,
}

fn law<L: Material + 'static>(name: &'static str, law: L, inverted: bool) -> Law {
    Law {
        name,
        energy: Box::new(move |F, t| law.mixed_energy(F, t)),
        stress: Box::new(move |F, t| law.mixed_stress(F, t)),
        tangent: Box::new(move |F, t| law.mixed_tangent(F, t)),
        plain: [
            Box::new(move |F| {
                let mut first = Matrix9::zeros();
                first[(0, 0)] = law.energy(F);
                first.fixed_view_mut::<9, 1>(0, 1).copy_from_slice(law.stress(F).as_slice());
                first
            }),
            Box::new(move |F| law.tangent(F)),
        ],
        inverted,
    }
}

fn laws() -> Vec<Law> {
    let a0 = nalgebra::Vector3::new(0.6, 0.64, 0.48);
    let along = |law: Blemker| BlemkerFibre { law, a0 };
    static FUNG: Guccione = Guccione { c: 2.0, bf: 8.0, bt: 2.0, bfs: 4.0, bulk: 1e2 };
    static ACTIVE: Active<Guccione> = Active(FUNG);
    let own = |law: &'static dyn SolidLaw| At { law, site: Site::new(0, a0, &[1], &[0.0, 30.0]) };
    vec![
        law("neo-Hookean", NeoHookean { mu: 7.5, lambda: 30.0 }, false),
        law("neo-Hookean, uncoupled", NeoHookeanUncoupled { mu: 7.5, bulk: 75.0 }, false),
        law("Mooney-Rivlin", MooneyRivlin { c10: 3.0, c01: 0.75, bulk: 75.0 }, false),
        law("Mooney-Rivlin, LS-DYNA", MooneyRivlinDyna { a: 3.0, b: 0.75, nu: 0.45 }, false),
        law("stable neo-Hookean", StableNeoHookean::from_young(20.0, 0.4), true),
        law("St. Venant-Kirchhoff", StVenantKirchhoff::from_young(20.0, 0.3), true),
        law("foldover-free", FoldoverFree { epsilon: 0.5 }, true),
        law("linear elastic", LinearElastic::from_young(20.0, 0.3), false),
        law("Blemker, passive", along(Blemker { bulk: 1e4, ..Blemker::muscle() }), false),
        law("Blemker, active", along(Blemker { bulk: 1e4, activation: 0.7, ..Blemker::muscle() }), false),
        law("a user's: Guccione", own(&FUNG), false),
        law("a user's: Guccione, active", own(&ACTIVE), false),
    ]
}

/// A random deformation gradient near the identity, with det F above 0.3, or reflected.
fn deformation(random: &mut Random, inverted: bool) -> Matrix3 {
    loop {
        let mut F = Matrix3::identity() + Matrix3::from_fn(|_, _| 0.4 * random.uniform());
        if F.determinant() > 0.3 {
            if inverted {
                F.set_column(0, &(-F.column(0)));
            }
            return F;
        }
    }
}

#[test]
fn stress_and_tangent_of_every_law_are_derivatives() {
    let mut random = Random::new(1);
    for law in laws() {
        let (mut worst_P, mut worst_A) = (f64::INFINITY, f64::INFINITY);
        for sample in 0..40 {
            let F = deformation(&mut random, law.inverted && sample % 2 == 1);
            let theta = F.determinant() * (1.0 + 0.1 * random.uniform());
            let (dF, dG) = (deformation(&mut random, false), deformation(&mut random, false));
            let (dt, ds) = (0.5 * random.uniform(), random.uniform());
            let h = 2e-4;
            let (P, p) = (law.stress)(&F, theta);
            let order = taylor_order(|h| (law.energy)(&(F + dF * h), theta + h * dt), P.dot(&dF) + p * dt, h);
            worst_P = least(worst_P, order);
            let m = (law.tangent)(&F, theta);
            let flat = |M: &Matrix3| nalgebra::SVector::<f64, 9>::from_column_slice(M.as_slice());
            let slope = flat(&dG).dot(&(m.A * flat(&dF)))
                + m.P_theta.dot(&dG) * dt
                + m.P_theta.dot(&dF) * ds
                + m.p_theta * dt * ds;
            let along = |h: f64| {
                let (P, p) = (law.stress)(&(F + dF * h), theta + h * dt);
                P.dot(&dG) + p * ds
            };
            worst_A = least(worst_A, taylor_order(along, slope, h));
            assert!(
                (m.A - m.A.transpose()).amax() <= 1e-12 * m.A.amax(),
                "{}: tangent not symmetric",
                law.name
            );

            // The plain density: ψ(F) = ψ̂(F, det F).
            let [first, second] = &law.plain;
            let value = first(&F);
            let same = (law.energy)(&F, F.determinant());
            assert!(
                (value[(0, 0)] - same).abs() <= 1e-12 * (1.0 + same.abs()),
                "{}: ψ̂(F, J) is not ψ(F)",
                law.name
            );
            let P = |F: &Matrix3| Matrix3::from_column_slice(first(F).column(1).as_slice());
            let order = taylor_order(|h| first(&(F + dF * h))[(0, 0)], P(&F).dot(&dF), h);
            worst_P = least(worst_P, order);
            let slope = flat(&dG).dot(&(second(&F) * flat(&dF)));
            worst_A = least(worst_A, taylor_order(|h| P(&(F + dF * h)).dot(&dG), slope, h));
        }
        println!("{:<28} stress order {worst_P:.2}, tangent order {worst_A:.2}", law.name);
        assert!(worst_P > 1.9, "{}: stress is not ∂ψ/∂F (order {worst_P:.2})", law.name);
        assert!(worst_A > 1.9, "{}: tangent is not ∂P/∂F (order {worst_A:.2})", law.name);
    }
}

#[test]
fn small_strain_moduli_are_those_of_linear_elasticity() {
    let (young, nu) = (20.0, 0.4);
    let (mu, lambda) = neo_hookean::lame(young, nu);
    let bulk = lambda + 2.0 / 3.0 * mu;
    let I = Matrix3::identity();
    let linear = LinearElastic { mu, lambda }.tangent(&I);
    let mooney = MooneyRivlin { c10: 0.3 * mu, c01: 0.2 * mu, bulk };
    for (name, stress, A) in [
        ("neo-Hookean", NeoHookean { mu, lambda }.stress(&I), NeoHookean { mu, lambda }.tangent(&I)),
        ("Mooney-Rivlin", mooney.stress(&I), mooney.tangent(&I)),
        (
            "Mooney-Rivlin, LS-DYNA",
            MooneyRivlinDyna { a: 0.3 * mu, b: 0.2 * mu, nu }.stress(&I),
            MooneyRivlinDyna { a: 0.3 * mu, b: 0.2 * mu, nu }.tangent(&I),
        ),
        (
            "uncoupled neo-Hookean",
            NeoHookeanUncoupled { mu, bulk }.stress(&I),
            NeoHookeanUncoupled { mu, bulk }.tangent(&I),
        ),
        (
            "stable neo-Hookean",
            StableNeoHookean::from_young(young, nu).stress(&I),
            StableNeoHookean::from_young(young, nu).tangent(&I),
        ),
        (
            "St. Venant-Kirchhoff",
            StVenantKirchhoff { mu, lambda }.stress(&I),
            StVenantKirchhoff { mu, lambda }.tangent(&I),
        ),
    ] {
        assert!(stress.amax() < 1e-12 * young, "{name}: stress {stress} at rest");
        assert!((A - linear).amax() < 1e-12 * young, "{name}: {A} instead of {linear}");
    }
}

/// A distorted hexahedron.
fn hexahedron(random: &mut Random) -> Vec<[f64; 3]> {
    shape::HEX_CORNERS.iter().map(|c| c.map(|c| 0.5 * c + 0.1 * random.uniform())).collect()
}

fn line(law: LineLaw) -> Segment {
    // From a point inside a cell of nodes 0-3 to node 4.
    let ends = [vec![(0, 0.4), (1, 0.3), (2, 0.2), (3, 0.1)], vec![(4, 0.5), (2, 0.5)]];
    Segment { ends, length: 0.4, law }
}

/// Every effect over eight nodes with its reference points.
fn effects(random: &mut Random) -> Vec<Sample> {
    let X = hexahedron(random);
    let nodes = vec![[0, 1, 2, 3, 4, 5, 6, 7]];
    let mooney = MooneyRivlin { c10: 3.0, c01: 0.75, bulk: 747.5 };
    let dyna = MooneyRivlinDyna { a: 3.0, b: 0.75, nu: 0.45 };
    let rule = shape::hex8();
    let hex8 = |f| Solid::new("hex8", Uniform(mooney), f, &rule, &X, nodes.clone()).expect("good shape");
    let hex8_dyna = Solid::new("hex8", Uniform(dyna), Formulation::MeanDilatation, &rule, &X, nodes.clone());
    let tet4 = Solid::new("t", Uniform(mooney), Formulation::Plain, &shape::tet4(), &X, vec![[0, 1, 3, 4]]);
    let halves = vec![[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]];
    let wedge =
        |f| Solid::new("w", Uniform(mooney), f, &shape::wedge6(), &X, halves.clone()).expect("good shape");
    let rule = shape::tet10();
    let mut X10: Vec<[f64; 3]> = X[..4].to_vec();
    X10[2] = X[3];
    X10[3] = X[4];
    for [a, b] in [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]] {
        X10.push(std::array::from_fn(|i| 0.5 * (X10[a][i] + X10[b][i]) + 0.02 * random.uniform()));
    }
    let all = vec![std::array::from_fn(|i| i as u32)];
    let tet10 = Solid::new("t", Uniform(mooney), Formulation::Plain, &rule, &X10, all);
    let membrane = |law| {
        let faces = vec![[0, 1, 5, 4], [1, 2, 6, 5]];
        let membrane = Membrane::new("m", law, 0.1, &shape::quad4(), &X, faces).expect("area");
        Box::new(membrane) as Box<dyn Effect>
    };
    let svk = MembraneLaw::StVenantKirchhoff { young: 20.0, nu: 0.3 };
    // All faces of the hexahedron, one of them as two triangles; open surfaces are the question of `pressure.rs`.
    let mut faces = fem::mesh::CellKind::Hex8.faces().iter().map(|f| f.map(|n| n as u32)).collect::<Vec<_>>();
    let [a, b, c, d] = faces.pop().expect("six faces");
    faces.extend([[a, b, c, c], [c, d, a, a]]);
    let pressure = Pressure::new("p", 0, &X, faces, Default::default());
    let patch = PatchPressure::new("p", 0, &X, &[[0, 1, 5, 4], [1, 2, 6, 6]]);
    let anchor: Vec<f64> = X.as_flattened().iter().map(|x| 1.3 * x + 0.05 * random.uniform()).collect();
    // Kept for good, since the table owns its effects.
    let patch = Anchored { effect: Box::leak(Box::new(patch)), anchor: anchor.leak() };
    let thermal =
        |strain, toe| LineLaw::Thermal(ThermalFibre { stiffness: 3.0, contraction: 0.3, strain, toe });
    let lines = |law| Box::new(Lines::<8>::new("line", Some(0), &X, &[line(law)])) as Box<dyn Effect>;
    vec![
        ("hex8, plain", Box::new(hex8(Formulation::Plain)), X.clone()),
        ("hex8, mean dilatation", Box::new(hex8(Formulation::MeanDilatation)), X.clone()),
        ("hex8, scaled", Box::new(hex8(Formulation::MeanDilatation).scaled(vec![40.0])), X.clone()),
        ("hex8, mean dilatation, LS-DYNA law", Box::new(hex8_dyna.expect("good shape")), X.clone()),
        ("tet4", Box::new(tet4.expect("good shape")), X.clone()),
        ("wedge6", Box::new(wedge(Formulation::Plain)), X.clone()),
        ("wedge6, mean dilatation", Box::new(wedge(Formulation::MeanDilatation)), X.clone()),
        ("tet10", Box::new(tet10.expect("good shape")), X10),
        ("membrane, St. Venant-Kirchhoff", membrane(svk), X.clone()),
        ("membrane, neo-Hookean", membrane(MembraneLaw::NeoHookean { mu: 3.0 }), X.clone()),
        ("follower pressure", Box::new(pressure), X.clone()),
        ("patch pressure about its anchor", Box::new(patch), X.clone()),
        ("dead load", Box::new(DeadLoad::new("f", 0, &[(3, [0.3, -0.2, 0.5])])), X.clone()),
        ("thermal fibre, engineering", lines(thermal(FibreStrain::Engineering, None)), X.clone()),
        ("thermal fibre, logarithmic", lines(thermal(FibreStrain::Logarithmic, None)), X.clone()),
        ("thermal fibre, toe", lines(thermal(FibreStrain::Engineering, Some(5.0))), X.clone()),
        ("thermal fibre, logarithmic, toe", lines(thermal(FibreStrain::Logarithmic, Some(5.0))), X.clone()),
        ("thermal fibre, above the toe", lines(thermal(FibreStrain::Logarithmic, Some(0.01))), X.clone()),
        ("Hill fibre", lines(LineLaw::Hill(HillFibre { f_max: 5.0, lambda_opt: 1.1 })), X.clone()),
        ("strand", lines(LineLaw::Strand(Strand { stiffness: 5.0, toe: 0.03 })), X.clone()),
        ("strand, in the toe", lines(LineLaw::Strand(Strand { stiffness: 5.0, toe: 3.0 })), X.clone()),
    ]
}

#[test]
fn forces_and_stiffness_of_every_effect_are_derivatives() {
    let mut random = Random::new(2);
    for (name, effect, X) in effects(&mut random) {
        let mut random = Random::new(2); // of its own, so that a new row leaves the others as they are
        let (mut worst_f, mut worst_K) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..20 {
            let mut vector =
                |size: f64| -> Vec<f64> { (0..3 * X.len()).map(|_| size * random.uniform()).collect() };
            let (u, dx, dy) = (vector(0.05), vector(1.0), vector(1.0));
            // Stretched, so that strands and toes are in tension.
            let x: Vec<f64> = X.as_flattened().iter().zip(&u).map(|(X, u)| 1.4 * X + u).collect();
            let controls = [0.6];
            let at = |h: f64| -> Vec<f64> { x.iter().zip(&dx).map(|(x, d)| x + h * d).collect() };
            let (f, K) = dense(effect.as_ref(), &State { x: &x, controls: &controls });
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let energy = |h: f64| effect.energy(&State { x: &at(h), controls: &controls });
            let force =
                |h: f64| dot(&dense(effect.as_ref(), &State { x: &at(h), controls: &controls }).0, &dy);
            let h = 2e-4;
            worst_f = least(worst_f, taylor_order(energy, dot(&f, &dx), h));
            let n = x.len();
            let slope = (0..n).map(|r| dy[r] * dot(&K[r * n..(r + 1) * n], &dx)).sum();
            worst_K = least(worst_K, taylor_order(force, slope, h));
        }
        println!("{name:<36} force order {worst_f:.2}, stiffness order {worst_K:.2}");
        assert!(worst_f > 1.9, "{name}: force is not ∂Π/∂x (order {worst_f:.2})");
        assert!(worst_K > 1.9, "{name}: stiffness is not ∂²Π/∂x² (order {worst_K:.2})");
    }
}

/// A patch with a free rim has no potential: its stiffness is the symmetric part of the derivative of its forces, and at the anchor its model
/// has the true forces. Inside the patch, away from the rim, nothing unsymmetric is left.
#[test]
fn stiffness_of_a_patch_pressure_is_the_symmetric_part_of_its_derivative() {
    let mut random = Random::new(11);
    let X: Vec<[f64; 3]> = (0..9)
        .map(|n| [f64::from(n % 3), f64::from(n / 3), 0.0].map(|x| x + 0.2 * random.uniform()))
        .collect();
    let faces = [[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]];
    let patch = PatchPressure::new("p", 0, &X, &faces);
    let (x, controls) = (X.as_flattened().to_vec(), [0.7]);
    let forces = |x: &[f64]| dense(&patch, &State { x, controls: &controls }).0;
    let (f, K) = dense(&patch, &State { x: &x, controls: &controls });
    let model = Anchored { effect: &patch, anchor: &x };
    assert_eq!(dense(&model, &State { x: &x, controls: &controls }).0, f, "true at the anchor");
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let moved = |d: &[f64], h: f64| -> Vec<f64> { x.iter().zip(d).map(|(x, d)| x + h * d).collect() };
    let mut skew = 0.0_f64;
    for _ in 0..20 {
        let mut vector = || -> Vec<f64> { (0..27).map(|_| random.uniform()).collect() };
        let (v, w) = (vector(), vector());
        let Kv: Vec<f64> = (0..27).map(|r| dot(&K[27 * r..27 * (r + 1)], &v)).collect();
        let both = |h: f64| 0.5 * (dot(&forces(&moved(&v, h)), &w) + dot(&forces(&moved(&w, h)), &v));
        let order = taylor_order(both, dot(&Kv, &w), 1e-3);
        assert!(order > 1.9, "not the symmetric part (order {order:.2})");
        skew = skew.max((dot(&forces(&moved(&v, 1e-6)), &w) - dot(&f, &w) - 1e-6 * dot(&Kv, &w)).abs());
        // Of the node in the middle alone the derivative is symmetric: what is left is of second order.
        let inner = |d: &[f64]| -> Vec<f64> {
            d.iter().enumerate().map(|(i, d)| if i / 3 == 4 { *d } else { 0.0 }).collect()
        };
        let (v, Kv) =
            (inner(&v), (0..27).map(|r| dot(&K[27 * r..27 * (r + 1)], &inner(&v))).collect::<Vec<_>>());
        let order = taylor_order(|h| dot(&forces(&moved(&v, h)), &w), dot(&Kv, &w), 1e-3);
        assert!(order > 1.9, "unsymmetric inside the patch (order {order:.2})");
    }
    assert!(skew > 1e-7, "a free rim should leave something unsymmetric, {skew:.1e}");
}

/// Muscle fibres with one tension: the force is the derivative of the energy on the rising, the falling and the passive part of the
/// curve and beyond its ends; the stiffness is that of the force as far as the tension does not change with the length.
#[test]
fn forces_of_whole_fibres_are_derivatives() {
    let mut random = Random::new(5);
    let X: Vec<[f64; 3]> =
        (0..7).map(|i| [f64::from(i), 0.3 * random.uniform(), 0.3 * random.uniform()]).collect();
    let length = |nodes: &[u32]| -> f64 {
        let place = |n: u32| nalgebra::Vector3::from(X[n as usize]);
        nodes.windows(2).map(|p| (place(p[1]) - place(p[0])).norm()).sum()
    };
    let chain = |nodes: &[u32], more: f64| Chain {
        segments: nodes.windows(2).map(|p| [p[0], p[1]]).collect(),
        length: length(nodes) + more,
        area: 0.7,
    };
    let fibres = [chain(&[0, 1, 2, 3], 0.0), chain(&[4, 5, 6], 0.4)];
    let stretch = vec![0.7, 0.85, 1.0, 1.2, 1.35, 1.5];
    let rising = |peak: f64| vec![0.0, 0.6 * peak, peak, 0.5 * peak, 0.4 * peak + 0.3, 2.0];
    let hill =
        ForceLength::new(stretch.clone(), vec![0.0, 1.0], &[vec![0.0, 0.0, 0.0, 0.1, 0.6, 2.0], rising(3.0)]);
    let level = ForceLength::new(stretch, vec![0.0], &[vec![2.0; 6]]);
    for (name, law, has_slope) in [("force-length", hill, true), ("constant tension", level, false)] {
        let effect = Chains::new("fibres", Some(0), law, &X, &fibres);
        for size in [0.6, 0.8, 0.93, 1.1, 1.28, 1.42, 1.6] {
            let mut vector = |size: f64| -> Vec<f64> { (0..21).map(|_| size * random.uniform()).collect() };
            let (u, dx, dy) = (vector(0.02), vector(1.0), vector(1.0));
            let x: Vec<f64> = X.as_flattened().iter().zip(&u).map(|(X, u)| size * X + u).collect();
            let controls = [0.6];
            let at = |h: f64| -> Vec<f64> { x.iter().zip(&dx).map(|(x, d)| x + h * d).collect() };
            let (f, K) = dense(&effect, &State { x: &x, controls: &controls });
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let energy = |h: f64| effect.energy(&State { x: &at(h), controls: &controls });
            let order = taylor_order(energy, dot(&f, &dx), 2e-4);
            assert!(order > 1.9, "{name} at {size}: force is not ∂Π/∂x (order {order:.2})");
            if !has_slope {
                let force = |h: f64| dot(&dense(&effect, &State { x: &at(h), controls: &controls }).0, &dy);
                let slope = (0..21).map(|r| dy[r] * dot(&K[r * 21..(r + 1) * 21], &dx)).sum();
                let order = taylor_order(force, slope, 2e-4);
                assert!(order > 1.9, "{name} at {size}: stiffness is not ∂²Π/∂x² (order {order:.2})");
            }
            // One force from end to end.
            let force = |e: usize| effect.line_state(&State { x: &x, controls: &controls }, e).unwrap().1;
            assert_eq!([force(0), force(3)], [force(1), force(4)]);
        }
    }
}

#[test]
fn a_force_length_law_meets_its_samples_and_never_pushes() {
    let stretch: Vec<f64> = (0..12).map(|k| 0.5 + 0.1 * f64::from(k)).collect();
    let row = |a: f64| -> Vec<f64> {
        let hill = HillFibre { f_max: 1.0, lambda_opt: 1.0 };
        stretch.iter().map(|l| LineLaw::Hill(hill).response(*l, a).force).collect()
    };
    let (low, high) = (row(0.0), row(1.0));
    let law = ForceLength::new(stretch.clone(), vec![0.0, 1.0], &[low.clone(), high.clone()]);
    assert!(law.at(f64::NAN, 0.5).energy.is_nan(), "no length, no energy");
    for k in 0..12 {
        assert!((law.at(stretch[k], 0.0).stress - low[k]).abs() < 1e-14);
        assert!((law.at(stretch[k], 1.0).stress - high[k]).abs() < 1e-14);
        assert!((law.at(stretch[k], 0.25).stress - (0.75 * low[k] + 0.25 * high[k])).abs() < 1e-14);
    }
    let h = 1e-6;
    for k in 0..2000 {
        let lambda = 0.3 + 8e-4 * f64::from(k);
        for a in [-0.5, 0.0, 0.3, 1.0, 1.7] {
            let (before, here, after) = (law.at(lambda - h, a), law.at(lambda, a), law.at(lambda + h, a));
            assert!(here.stress >= 0.0, "{} at {lambda}", here.stress);
            assert!(
                ((after.energy - before.energy) / (2.0 * h) - here.stress).abs() < 1e-7,
                "energy at {lambda}"
            );
            // Continuous with its slope: also across the samples.
            assert!(
                ((after.stress - before.stress) / (2.0 * h) - here.slope).abs() < 3e-4,
                "slope at {lambda}"
            );
        }
    }
}

/// Forces and dense stiffness of an effect over all nodes.
fn dense(effect: &dyn Effect, s: &State) -> (Vec<f64>, Vec<f64>) {
    let (n, m) = (s.x.len(), effect.nodes_per_group());
    let (mut f, mut K) = (vec![0.0; n], vec![0.0; n * n]);
    for (group, nodes) in effect.nodes().chunks(m).enumerate() {
        let (mut fe, mut ke) = (vec![0.0; 3 * m], vec![0.0; 9 * m * m]);
        effect.forces(s, group, &mut fe);
        effect.stiffness(s, 0.0, group, &mut ke);
        let dof = |r: usize| (nodes[r / 3] != NO_NODE).then(|| 3 * nodes[r / 3] as usize + r % 3);
        for r in 0..3 * m {
            let Some(row) = dof(r) else { continue };
            f[row] += fe[r];
            for c in 0..3 * m {
                if let Some(column) = dof(c) {
                    K[row * n + column] += ke[r * 3 * m + c];
                }
            }
        }
    }
    (f, K)
}

/// A whole island: rollers, a plane whose nodes follow one of them, embedded fibres, gravity and pressure together.
#[test]
fn gradient_and_hessian_of_an_island_are_derivatives() {
    use fem::plan::LoadedIsland;
    use fem::scene::*;
    use fem::solve::{BlockMatrix, Loading, Potential};
    use support::fem_scenes::{distorted_box, held, mooney_rivlin, plan, solid};
    let mesh = distorted_box(2);
    let fibre = FibreSpec {
        name: "fibres".to_string(),
        course: Course::Embedded(vec![vec![[0.1, 0.3, 0.4], [0.45, 0.35, 0.6], [0.9, 0.4, 0.7]]]),
        law: FibreLawSpec::Hill { sigma_max: 3e5, lambda_opt: 1.0 },
        area: vec![1e-2],
        activation: Some("a".to_string()),
    };
    let scene = Scene {
        solids: vec![solid("block", mooney_rivlin(), None)],
        fibres: vec![fibre],
        gravity: Some(GravitySpec { acceleration: [0.0, 1.0, -9.81], control: "g".to_string() }),
        pressures: vec![PressureSpec {
            surface: "z_max".to_string(),
            origin: None,
            control: "p".to_string(),
        }],
        prescribed: vec![
            held("x_min", [true, false, false]),
            held("y_min", [false, true, false]),
            held("y_max", [false, true, false]),
            held("rim", [true, false, false]),
            held("z_min", [true, true, true]),
        ],
        planes: vec![PlaneSpec { nodes: "x_max".to_string(), axis: 0.into() }],
        ..Scene::default()
    };
    // Nodes of z_min on x_max would follow and be held at once; those of z_max are on the rim of the pressure, which stays in its plane.
    let mut mesh = mesh;
    let [low, top] = ["z_min", "z_max"].map(|set| mesh.node_sets[set].clone());
    let (rim, rest) = mesh.node_sets["x_max"].iter().partition(|n| top.contains(n));
    mesh.node_sets.insert("rim".to_string(), rim);
    mesh.node_sets.insert("x_max".to_string(), rest);
    mesh.node_sets.get_mut("x_max").expect("a set").retain(|n| !low.contains(n));
    let plan = plan(&scene, &mesh);
    let island = plan.islands[0].clone();
    let load = plan.load(&[("a", 0.6), ("g", 1.0), ("p", 500.0)], &[]).expect("names of the scene");
    let mut potential = LoadedIsland::new(island.clone(), plan.load(&[], &[]).expect("nothing"), load);
    assert_eq!(plan.islands.len(), 1, "one box, one island");
    let mut random = Random::new(5);
    let local: Vec<f64> = island.X.iter().map(|x| 1.03 * x + 0.02 * random.uniform()).collect();
    let mut x = island.free_positions(&local);
    potential.set_load(1.0, &mut x);
    let fixed = potential.fixed().to_vec();
    let mut direction =
        || -> Vec<f64> { fixed.iter().map(|&f| if f { 0.0 } else { random.uniform() }).collect() };
    let (mut worst_g, mut worst_K) = (f64::INFINITY, f64::INFINITY);
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let gradient = |x: &[f64]| {
        let mut g = vec![0.0; x.len()];
        potential.gradient(x, &mut g);
        g
    };
    let mut k = BlockMatrix::zeros(potential.pattern().clone());
    potential.hessian(&x, 0.0, &mut k);
    for _ in 0..10 {
        let (dx, dy) = (direction(), direction());
        let at = |h: f64| -> Vec<f64> { x.iter().zip(&dx).map(|(x, d)| x + h * d).collect() };
        worst_g = least(worst_g, taylor_order(|h| potential.energy(&at(h)), dot(&gradient(&x), &dx), 1e-4));
        let mut kx = vec![0.0; x.len()];
        k.multiply(&dx, &mut kx);
        worst_K = least(worst_K, taylor_order(|h| dot(&gradient(&at(h)), &dy), dot(&kx, &dy), 1e-4));
    }
    println!("island: gradient order {worst_g:.2}, Hessian order {worst_K:.2}");
    assert!(worst_g > 1.9 && worst_K > 1.9, "orders {worst_g:.2} and {worst_K:.2}");
}

/// A⁺ is the nearest positive semidefinite matrix to A exactly if A⁺ and A⁺ − A are positive semidefinite and
/// A⁺ (A⁺ − A) = 0 (Moreau's decomposition).
#[test]
fn clamped_matrix_is_the_nearest_semidefinite_one() {
    let mut random = Random::new(9);
    let mut changed = 0;
    for sample in 0..200 {
        let B = Matrix9::from_fn(|_, _| random.uniform());
        // A shift takes them from positive definite, where nothing may change, to negative definite.
        let A = (B + B.transpose()) * 1e4 + Matrix9::identity() * (600.0 * (100.0 - f64::from(sample)));
        let mut plus = A.data.0;
        changed += usize::from(fem::element::psd::lift(&mut plus, 1.0));
        let plus = Matrix9::from_array_storage(nalgebra::ArrayStorage(plus));
        let rest = plus - A;
        let scale = A.norm();
        assert!(plus.symmetric_eigenvalues().min() > -1e-10 * scale, "sample {sample}");
        assert!(rest.symmetric_eigenvalues().min() > -1e-10 * scale, "sample {sample}");
        assert!((plus * rest).norm() < 1e-10 * scale * scale, "sample {sample}");
    }
    assert!((100..200).contains(&changed), "{changed} of 200 were changed");
}

/// From principal stretches the nearest semidefinite tangent of an isotropic law is the same as on all ten components of (F, θ),
/// compressed, stretched or turned inside out, with two or three equal stretches too; so is the tangent itself.
#[test]
fn isotropic_tangents_are_lifted_in_principal_directions() {
    let mut random = Random::new(31);
    let st_venant_kirchhoff = fem::material::Law::StVenantKirchhoff(StVenantKirchhoff::from_young(30e3, 0.3));
    let laws = [
        fem::material::Law::MooneyRivlinDyna(MooneyRivlinDyna { a: 3e3, b: 750.0, nu: 0.495 }),
        fem::material::Law::NeoHookean(NeoHookean::from_young(30e3, 0.3)),
        st_venant_kirchhoff,
    ];
    let inside_out =
        [st_venant_kirchhoff, fem::material::Law::StableNeoHookean(StableNeoHookean::from_young(30e3, 0.4))];
    let mut changed = 0;
    for sample in 0..400 {
        let stretch = [1.0, 0.6, 1.7, 0.9][sample % 4];
        let noise = [0.0, 1e-9, 1e-3, 0.2][sample / 4 % 4];
        let mut F = Matrix3::identity() * stretch + Matrix3::from_fn(|_, _| noise * random.uniform());
        let is_inverted = sample >= 300;
        let law = if is_inverted { inside_out[sample / 5 % 2] } else { laws[sample % 3] };
        if is_inverted {
            F.column_mut(sample % 3).neg_mut();
        }
        let theta = F.determinant() * (1.0 + 0.1 * random.uniform());
        // Every other one: θ = J, as elements without mean dilatation have it.
        let is_plain = sample / 16 % 2 == 1;
        let p = if is_plain { 0.0 } else { 2e4 * random.uniform() };
        let mut m = law.mixed_tangent(&F, theta);
        if is_plain {
            (m.A, m.P_theta, m.p_theta) = (law.tangent(&F), Matrix3::zeros(), 0.0);
        }
        add_det_hessian(&mut m.A, &F, p);
        let mut full = [[0.0; 10]; 10];
        for c in 0..9 {
            full[c][..9].copy_from_slice(&m.A.data.0[c]);
            (full[c][9], full[9][c]) = (m.P_theta[c], m.P_theta[c]);
        }
        full[9][9] = m.p_theta;
        let scale = full.as_flattened().iter().fold(0.0_f64, |s, v| s.max(v.abs()));
        let fraction = [1.0, 0.25, 0.0][sample / 7 % 3];
        changed += usize::from(fem::element::psd::lift(&mut full, fraction));
        let psi = law.by_invariants(&F, (!is_plain).then_some(theta)).expect("an isotropic law");
        let (A, P_theta, p_theta) = lifted_tangent(&F, &psi, p, fraction).expect("F is not flat");
        for c in 0..9 {
            for r in 0..9 {
                let away = (full[c][r] - A[r / 3][c / 3][3 * (r % 3) + c % 3]).abs();
                assert!(away < 1e-9 * scale, "sample {sample}: {away} of {scale}");
            }
            assert!((full[c][9] - P_theta[c]).abs() < 1e-9 * scale, "sample {sample}");
        }
        assert!((full[9][9] - p_theta).abs() < 1e-9 * scale, "sample {sample}");
    }
    assert!(changed > 150, "only {changed} of 400 were indefinite");
}
