//! Does a distorted patch reproduce a linear field to round-off, per element and law?
//!
//! Boundary nodes are displaced by u = A X, inner ones are found by the solver. Hughes, The Finite Element Method, §4.6.

#![allow(non_snake_case)]

use fem::material::{Material, MooneyRivlin};
use fem::measure::solid_field;
use fem::mesh::{Mesh, generate};
use fem::scene::{FormulationSpec, LawSpec, Scene};
use nalgebra::{Matrix3, Vector3};
use support::fem_scenes::{displaced, distorted_box, laws, plan, solid, solve, tolerance};

fn meshes() -> Vec<(&'static str, Mesh, Option<FormulationSpec>)> {
    let hex = distorted_box(3);
    vec![
        ("hex8, mean dilatation", hex.clone(), Some(FormulationSpec::MeanDilatation)),
        ("hex8, plain", hex.clone(), Some(FormulationSpec::Plain)),
        ("tet4", generate::tetrahedra(&hex, false), None),
        ("wedge6", generate::wedges(&hex), None),
        ("tet10", with_boundary(generate::tetrahedra(&hex, true)), None),
    ]
}

/// The boundary of tet10 holds the nodes on its edges too.
fn with_boundary(mut mesh: Mesh) -> Mesh {
    let outside = |p: &[f64; 3]| p.iter().any(|&c| c.abs() < 1e-12 || (c - 1.0).abs() < 1e-12);
    let nodes = (0..mesh.points.len() as u32).filter(|&n| outside(&mesh.points[n as usize])).collect();
    mesh.node_sets.insert("boundary".to_string(), nodes);
    mesh
}

#[test]
fn distorted_patches_hold_a_linear_field() {
    let large = Matrix3::new(0.15, 0.1, -0.05, 0.0, -0.1, 0.08, 0.06, 0.0, 0.05);
    for (element, mesh, formulation) in meshes() {
        for (name, law) in laws() {
            let A = if matches!(law, LawSpec::LinearElastic { .. }) { large * 0.1 } else { large };
            let field = |X: [f64; 3]| (A * Vector3::from(X)).into();
            let region = mesh.blocks[0].name.clone();
            let scene = Scene {
                solids: vec![solid(&region, law.clone(), formulation)],
                prescribed: vec![displaced(&mesh, "boundary", field)],
                ..Scene::default()
            };
            let plan = plan(&scene, &mesh);
            let frame = solve(&plan, &[("load", 1.0)], &tolerance(1e-12));
            let mut worst = 0.0_f64;
            for (x, X) in frame.x.chunks_exact(3).zip(&mesh.points) {
                let exact = Vector3::from(*X) + A * Vector3::from(*X);
                worst = worst.max((Vector3::from_column_slice(x) - exact).norm());
            }
            let cells = solid_field(&plan, frame.snapshot(), &region).expect("a solid");
            let scale = cells[0].cauchy.amax();
            let spread =
                cells.iter().map(|c| (c.cauchy - cells[0].cauchy).amax()).fold(0.0, f64::max) / scale;
            let J = (Matrix3::identity() + A).determinant();
            let volume = cells.iter().map(|c| (c.volume_ratio - J).abs()).fold(0.0, f64::max);
            println!("{element:<22} {name:<24} position {worst:.1e}, stress spread {spread:.1e}");
            if let LawSpec::MooneyRivlin { c10, c01, bulk } = law {
                let F = Matrix3::identity() + A;
                let exact = MooneyRivlin { c10, c01, bulk }.stress(&F) * F.transpose() / J;
                let off = (cells[0].cauchy - exact).amax() / exact.amax();
                assert!(off < 1e-10, "{element}: Cauchy stress is off the law's by {off:.1e}");
            }
            assert!(worst < 1e-10, "{element}, {name}: off the linear field by {worst:.2e} m");
            assert!(spread < 1e-8, "{element}, {name}: stress differs from cell to cell by {spread:.2e}");
            assert!(volume < 1e-10, "{element}, {name}: volume ratio is off {J} by {volume:.2e}");
        }
    }
}
