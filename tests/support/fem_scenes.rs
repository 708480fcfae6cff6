//! Small scenes of the finite-element side, shared by its tests.

use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::run::{Drive, Frame, run};
use fem::scene::{FibreDirection, FormulationSpec, LawSpec, PrescribedSpec, Scene, SolidSpec};
use fem::solve::{BlockMatrix, Potential, Settings};

use crate::taylor_order;

/// Every solid law with constants of soft tissue, moderately compressible.
pub fn laws() -> Vec<(&'static str, LawSpec)> {
    let (young, nu) = (22e3, 0.45);
    vec![
        ("neo-Hookean", LawSpec::NeoHookean { young, nu }),
        ("uncoupled neo-Hookean", LawSpec::NeoHookeanUncoupled { mu: 7.5e3, bulk: 75e3 }),
        ("Mooney-Rivlin", mooney_rivlin()),
        ("Mooney-Rivlin, LS-DYNA", LawSpec::MooneyRivlinDyna { a: 3e3, b: 0.75e3, nu }),
        ("stable neo-Hookean", LawSpec::StableNeoHookean { young, nu }),
        ("St. Venant-Kirchhoff", LawSpec::StVenantKirchhoff { young, nu: 0.3 }),
        ("linear elastic", LawSpec::LinearElastic { young, nu }),
        (
            "Blemker",
            LawSpec::Blemker {
                g1: 5e3,
                g2: 5e3,
                bulk: 1e5,
                sigma_max: 3e5,
                lambda_ofl: 1.1,
                fibres: FibreDirection::Uniform([1.0, 1.0, 0.5]),
                activation: None,
            },
        ),
    ]
}

/// The muscle matrix of the benchmarks, C₁₀ = 3 kPa, C₀₁ = 0.75 kPa, K = 747.5 kPa (ν = 0.495).
pub fn mooney_rivlin() -> LawSpec {
    LawSpec::MooneyRivlin { c10: 3e3, c01: 0.75e3, bulk: 747.5e3 }
}

/// A solid region.
pub fn solid(region: &str, law: LawSpec, formulation: Option<FormulationSpec>) -> SolidSpec {
    SolidSpec { formulation, ..SolidSpec::new(region, law) }
}

/// Adds the set `boundary` of all nodes on the faces of a [`generate::block`].
pub fn name_boundary(mesh: &mut Mesh) {
    let mut all = Vec::new();
    for (name, nodes) in &mesh.node_sets {
        if name.ends_with("_min") || name.ends_with("_max") {
            all.extend(nodes);
        }
    }
    all.sort_unstable();
    all.dedup();
    mesh.node_sets.insert("boundary".to_string(), all);
}

/// A box of side 1 m with `n` cells along each side, inner nodes moved by up to 15 % of an edge; `boundary` named.
pub fn distorted_box(n: usize) -> Mesh {
    let mut mesh = generate::block([n; 3], [1.0; 3]);
    generate::distort(&mut mesh, 0.15, 7);
    name_boundary(&mut mesh);
    mesh
}

/// Displaces the nodes of a set by `field` of their reference position, scaled by the control `load`.
pub fn displaced(mesh: &Mesh, set: &str, field: impl Fn([f64; 3]) -> [f64; 3]) -> PrescribedSpec {
    PrescribedSpec {
        nodes: set.to_string(),
        components: [true; 3],
        displacement: mesh.node_sets[set].iter().map(|&n| field(mesh.points[n as usize])).collect(),
        control: Some("load".to_string()),
    }
}

/// Holds some components of a set.
pub fn held(set: &str, components: [bool; 3]) -> PrescribedSpec {
    PrescribedSpec { nodes: set.to_string(), components, displacement: vec![], control: None }
}

/// Rollers on the planes x = 0, y = 0 and z = 0 of a [`generate::block`] or of an octant.
pub fn symmetry_planes() -> Vec<PrescribedSpec> {
    let rollers = |(c, set)| held(set, std::array::from_fn(|i| i == c));
    ["x_min", "y_min", "z_min"].into_iter().enumerate().map(rollers).collect()
}

/// Plan of a scene; panics with the mistake.
pub fn plan(scene: &Scene, mesh: &Mesh) -> Plan {
    Plan::new(scene, mesh.clone()).unwrap_or_else(|e| panic!("{e}"))
}

/// Solver settings with a relative residual.
pub fn tolerance(tolerance: f64) -> Settings {
    Settings { tolerance, ..Settings::default() }
}

/// The equilibrium under some controls; panics with the reason where there is none.
pub fn solve(plan: &Plan, controls: &[(&str, f64)], settings: &Settings) -> Frame {
    let drive = Drive::once(plan.load(controls, &[]).unwrap_or_else(|e| panic!("{e}")));
    let mut run = run(plan, &drive, settings, None, &mut |_| {});
    assert!(run.is_solved(), "{}", run.errors[0]);
    run.frames.pop().expect("one frame")
}

/// Orders at which energy and forces of a potential near `x` leave their first derivatives along `step` · `u`: 2 where gradient and Hessian are
/// right. Forces are seen along `w`.
pub fn derivative_orders(potential: &dyn Potential, x: &[f64], [u, w]: [&[f64]; 2], step: f64) -> [f64; 2] {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let at = |h: f64| x.iter().zip(u).map(|(x, u)| x + step * h * u).collect::<Vec<f64>>();
    let gradient = |x: &[f64]| {
        let mut g = vec![0.0; x.len()];
        potential.gradient(x, &mut g);
        g
    };
    let mut k = BlockMatrix::zeros(potential.pattern().clone());
    potential.hessian(x, 0.0, &mut k);
    let mut ku = vec![0.0; x.len()];
    k.multiply(u, &mut ku);
    [
        taylor_order(|h| potential.energy(&at(h)), step * dot(&gradient(x), u), 0.1),
        taylor_order(|h| dot(&gradient(&at(h)), w), step * dot(&ku, w), 0.1),
    ]
}
