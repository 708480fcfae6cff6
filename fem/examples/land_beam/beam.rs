//! The beam of problem 1 as mesh and scene.

use super::laws::Guccione;
use fem::mesh::{Mesh, generate};
use fem::scene::{FibreDirection, LawSpec, PatchPressureSpec, PrescribedSpec, Scene, SolidSpec};

/// Pressure of the problem \[Pa\].
pub const PRESSURE: f64 = 4.0;
/// Where the deformed end of the line (10, 0.5, 1) mm lies in the programs that took part: z \[mm\].
pub const PUBLISHED: [f64; 2] = [4.14, 4.20];

/// Half of the beam of 10 × 1 × 1 mm: `n` cells along x, y (half the width) and z, cut at y = 0.5 mm where it is symmetric. The pressure
/// \[Pa\] under it is in the control `p`.
pub fn beam(n: [usize; 3], bulk: f64) -> (Scene, Mesh) {
    let law = LawSpec::user(Guccione { c: 2e3, bf: 8.0, bt: 2.0, bfs: 4.0, bulk });
    let held = |nodes: &str, components| PrescribedSpec {
        nodes: nodes.into(),
        components,
        displacement: Vec::new(),
        control: None,
    };
    let scene = Scene {
        solids: vec![SolidSpec::new("block", law.along(FibreDirection::Uniform([1.0, 0.0, 0.0])))],
        patch_pressures: vec![PatchPressureSpec { surface: "z_min".into(), control: "p".into() }],
        prescribed: vec![held("x_min", [true; 3]), held("y_max", [false, true, false])],
        ..Scene::default()
    };
    (scene, generate::block(n, [0.010, 0.0005, 0.001]))
}

/// The node at (10, 0.5, 1) mm.
pub fn tip(mesh: &Mesh) -> usize {
    let distance = |p: &[f64; 3]| (p[0] - 0.010).abs() + (p[1] - 0.0005).abs() + (p[2] - 0.001).abs();
    (0..mesh.points.len())
        .min_by(|&a, &b| distance(&mesh.points[a]).total_cmp(&distance(&mesh.points[b])))
        .expect("the mesh has nodes")
}
