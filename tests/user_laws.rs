//! Laws of a user's own, and the load without potential that their benchmark needs: does a Rust type with nothing but an energy density
//! solve problem 1 of Land et al. 2015, contract as it should, and get its mistakes told?

#![allow(non_snake_case)]

#[path = "../fem/examples/land_beam/beam.rs"]
#[allow(dead_code)]
mod beam;

use crate::laws::{self, Active, Guccione};
use beam::{PRESSURE, PUBLISHED, beam, tip};
use fem::material::user::{At, mean_young};
use fem::material::{Hyperelastic, Material, Matrix3, NeoHookeanUncoupled, Real, Site, Symmetric};
use fem::measure::{nodal_forces, support_wrench};
use fem::mesh::generate;
use fem::plan::{Motion, Plan};
use fem::run::{Drive, run};
use fem::scene::*;
use fem::solve::Settings;
use nalgebra::Vector3;
use support::fem_scenes::{held, plan, solve, symmetry_planes, tolerance};

/// Force \[N\] of a pressure on a surface and its moment about the origin \[N·m\], from nothing but the corners of its faces: the area of a
/// bilinear face as a vector is half the product of its diagonals; the moment is integrated with 3 × 3 points.
fn pressure_wrench(faces: &[[u32; 4]], x: &[f64], pressure: f64) -> [Vector3<f64>; 2] {
    let place = |n: u32| Vector3::from_row_slice(&x[3 * n as usize..3 * n as usize + 3]);
    let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
    for face in faces {
        let [a, b, c, d] = face.map(place);
        force -= (c - a).cross(&(d - b)) * (0.5 * pressure);
        let root = 0.6_f64.sqrt();
        for (u, wu) in [(-root, 5.0 / 9.0), (0.0, 8.0 / 9.0), (root, 5.0 / 9.0)] {
            for (v, wv) in [(-root, 5.0 / 9.0), (0.0, 8.0 / 9.0), (root, 5.0 / 9.0)] {
                let (s, t) = (0.5 * (1.0 + u), 0.5 * (1.0 + v));
                let at = (a * (1.0 - s) + b * s) * (1.0 - t) + (d * (1.0 - s) + c * s) * t;
                let along = (b - a) * (1.0 - t) + (c - d) * t;
                let up = (d - a) * (1.0 - s) + (c - b) * s;
                moment -= at.cross(&along.cross(&up)) * (0.25 * wu * wv * pressure);
            }
        }
    }
    [force, moment]
}

#[test]
fn beam_of_guccione_bends_as_in_problem_1_of_land_and_others() {
    let mut tips = Vec::new();
    for n in [[20, 1, 2], [40, 2, 4]] {
        let (scene, mesh) = beam(n, 1e6);
        let plan = plan(&scene, &mesh);
        let frame = solve(&plan, &[("p", PRESSURE)], &tolerance(1e-8));
        // The true forces of the bent patch, not those of a model of it, are in equilibrium at every free component.
        let g = nodal_forces(&plan, frame.snapshot());
        let left = plan.motion.as_flattened().iter().zip(&g).filter(|(m, _)| **m == Motion::Free);
        let left = left.map(|(_, g)| g * g).sum::<f64>().sqrt();
        let support = support_wrench(&plan, frame.snapshot(), &mesh.node_sets["x_min"], [0.0; 3]);
        let [force, moment] = pressure_wrench(&mesh.surfaces["z_min"], &frame.x, PRESSURE);
        let scale = force.norm();
        assert!(
            left < 2e-8 * g.iter().map(|g| g * g).sum::<f64>().sqrt(),
            "{left:.1e} N are left, of {scale:.1e} N"
        );
        // Half a beam: the cut at y = 0.5 mm carries forces along y only.
        for i in [0, 2] {
            assert!(
                (support.force[i] + force[i]).abs() < 1e-6 * scale,
                "{:?} N for {force:?} N",
                support.force
            );
        }
        assert!(
            (support.moment[1] + moment[1]).abs() < 1e-6 * moment.norm(),
            "{:?} N m for {moment:?} N m",
            support.moment
        );
        tips.push(1e3 * frame.x[3 * tip(&mesh) + 2]);
    }
    println!("tip z {tips:.4?} mm");
    assert!(PUBLISHED[0] <= tips[1] && tips[1] <= PUBLISHED[1], "z = {tips:.4?} mm");
    // Edges half as long: of second order, a third of the difference is what is left.
    let left = (tips[1] - tips[0]) / 3.0;
    let limit = tips[1] + left;
    assert!(
        left.abs() < 0.03 && (PUBLISHED[0]..=PUBLISHED[1]).contains(&limit),
        "z = {tips:.4?} mm, limit {limit:.4} mm"
    );
}

/// A cube with fibres that pull shortens until the pull along them balances the law: d/dλ of ψ(λ) = 0 at J = 1.
#[test]
fn active_second_piola_stress_shortens_a_cube_as_it_should() {
    let (passive, tension) = (Guccione { c: 2e3, bf: 8.0, bt: 2.0, bfs: 4.0, bulk: 1e8 }, 3e3);
    let slope = |l: f64| {
        let (along, across) = (0.5 * (l * l - 1.0), 0.5 * (1.0 / l - 1.0));
        let Q = passive.bf * along * along + 2.0 * passive.bt * across * across;
        let dQ = 2.0 * passive.bf * along * l - 2.0 * passive.bt * across / (l * l);
        0.5 * passive.c * Q.exp() * dQ + tension * l
    };
    let (mut low, mut high) = (0.5, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if slope(middle) > 0.0 { high = middle } else { low = middle }
    }
    let mesh = generate::block([2; 3], [0.01; 3]);
    let along = FibreDirection::Uniform([0.0, 2.0, 0.0]);
    let law = LawSpec::user(Active(passive)).along(along).driven_by(&["tension"]);
    let scene = Scene {
        solids: vec![SolidSpec::new("block", law)],
        prescribed: symmetry_planes(),
        ..Scene::default()
    };
    let plan = plan(&scene, &mesh);
    // All forces are internal and balance within each cell, so what is in play is said: tension times section.
    let settings = Settings { least_force: tension * 1e-4, ..tolerance(1e-9) };
    let frame = solve(&plan, &[("tension", tension)], &settings);
    let n = mesh.node_sets["y_max"][3] as usize;
    let stretch = frame.x[3 * n + 1] / 0.01;
    println!("stretch {stretch:.6}, exact {low:.6}");
    assert!(low < 0.95 && (stretch - low).abs() < 1e-4, "{stretch}, should be {low}");
}

/// Neo-Hookean once more, as a user's.
#[derive(Debug)]
struct Twin(NeoHookeanUncoupled);

impl Hyperelastic for Twin {
    fn psi<S: Real>(&self, C: &Symmetric<S>, _: &Site) -> S {
        let J = C.determinant().sqrt();
        fem::material::Isotropic::psi(&self.0, C.trace(), C.trace(), J, J)
    }
}

#[test]
fn a_built_in_law_written_again_is_the_same_law() {
    let built_in = NeoHookeanUncoupled { mu: 7.5e3, bulk: 75e3 };
    let twin = Twin(built_in);
    let law = At { law: &twin, site: Site::new(0, Vector3::zeros(), &[], &[]) };
    let F = Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, 0.05, -0.1, 1.1);
    let scale = built_in.tangent(&F).amax();
    assert!((law.energy(&F) / built_in.energy(&F) - 1.0).abs() < 1e-12);
    assert!((law.stress(&F) - built_in.stress(&F)).amax() < 1e-12 * scale);
    assert!((law.tangent(&F) - built_in.tangent(&F)).amax() < 1e-12 * scale);
    let young = 9.0 * 75e3 * 7.5e3 / (3.0 * 75e3 + 7.5e3);
    assert!((mean_young(&law.tangent(&Matrix3::identity())) / young - 1.0).abs() < 1e-12);
    assert_eq!(law.energy(&-F), f64::INFINITY, "folded");
    // And in a scene, turned and stretched.
    let mesh = generate::block([2; 3], [1.0; 3]);
    let solved = |law: LawSpec| {
        let moved = PrescribedSpec {
            nodes: "z_max".into(),
            components: [true; 3],
            displacement: vec![[0.2, 0.1, 0.3]],
            control: Some("load".into()),
        };
        let prescribed = vec![held("z_min", [true; 3]), moved];
        let scene = Scene { solids: vec![SolidSpec::new("block", law)], prescribed, ..Scene::default() };
        solve(&plan(&scene, &mesh), &[("load", 1.0)], &tolerance(1e-10)).x
    };
    let ours = solved(LawSpec::user(twin).into());
    let theirs = solved(LawSpec::NeoHookeanUncoupled { mu: 7.5e3, bulk: 75e3 });
    let apart = ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart < 1e-8, "{apart:.1e} m apart");
}

/// A law of which nothing is known at rest.
#[derive(Debug)]
struct Broken;

impl Hyperelastic for Broken {
    fn psi<S: Real>(&self, C: &Symmetric<S>, _: &Site) -> S {
        (C.trace() - 3.0).powf(0.5)
    }
}

#[test]
fn mistakes_with_user_laws_are_told() {
    let mesh = generate::block([1; 3], [1.0; 3]);
    let scene = Scene { solids: vec![SolidSpec::new("block", LawSpec::user(Broken))], ..Scene::default() };
    let error = Plan::new(&scene, mesh.clone()).map(|_| ()).expect_err("infinite stress at rest").to_string();
    for word in ["solid `block`", "stress [Pa] at rest", "cell 0", "finite", "mend the law"] {
        assert!(error.contains(word), "{error}");
    }
    let text = "[[solids]]\nregion = \"block\"\nlaw = { kind = \"user\", law = \"Guccione\" }\n";
    let error = Plan::parse(text, std::path::Path::new("beam.toml")).expect_err("a Rust type").to_string();
    for word in ["beam.toml", "Rust type", "LawSpec::user"] {
        assert!(error.contains(word), "{error}");
    }
    let guccione = |c| LawSpec::from(LawSpec::user(Guccione { c, bf: 8.0, bt: 2.0, bfs: 4.0, bulk: 1e6 }));
    assert_eq!(guccione(2e3), guccione(2e3));
    assert_ne!(guccione(2e3), guccione(2.1e3), "laws with other constants are others");
    let written = serde_json::to_string(&guccione(2e3)).expect("for records");
    assert!(written.contains("\"kind\":\"user\"") && written.contains("bfs: 4.0"), "{written}");
    let (mut scene, mesh) = beam([2, 1, 1], 1e6);
    scene.patch_pressures[0].surface = "z_mim".into();
    let error = Plan::new(&scene, mesh).map(|_| ()).expect_err("no such surface").to_string();
    assert!(error.contains("patch pressure") && error.contains("`z_min`"), "{error}");
}

/// A pressure that is let go again leaves the beam where it was: the model of the load keeps nothing of its way.
#[test]
fn beam_comes_back_when_the_pressure_goes() {
    let (scene, mesh) = beam([10, 1, 1], 1e6);
    let plan = plan(&scene, &mesh);
    let load = |p: f64| plan.load(&[("p", p)], &[]).expect("a control");
    let frames = [(1.0, PRESSURE), (2.0, 0.0)].map(|(time, p)| fem::run::DriveFrame { time, load: load(p) });
    let done = run(&plan, &Drive { frames: frames.to_vec() }, &tolerance(1e-7), None, &mut |_| {});
    assert!(done.is_solved(), "{}", done.errors[0]);
    assert!(done.frames[0].x[3 * tip(&mesh) + 2] > 2e-3, "it was bent");
    let apart = done.frames[1]
        .x
        .iter()
        .zip(mesh.points.as_flattened())
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max);
    assert!(apart < 1e-9, "{apart:.1e} m off");
}
