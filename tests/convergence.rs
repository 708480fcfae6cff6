//! Does the error fall at the order theory promises?
//!
//! Manufactured solution: a smooth field u(X) is prescribed on the boundary and the body force b = −Div P(F(u)) inside;
//! the L2 error of the displacement must fall like h² for hex8 and h³ for tet10.
//! Hughes, The Finite Element Method, §4.1; Roache, J Fluids Eng 2002;124:4 (manufactured solutions).

#![allow(non_snake_case)]

use fem::element::shape::{hex8_at, tet10_at};
use fem::material::{Material, MooneyRivlin, NeoHookean};
use fem::mesh::{Mesh, generate};
use fem::scene::{ForceSpec, LawSpec, Scene};
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::PI;
use support::fem_scenes::{displaced, plan, solid, solve, tolerance};

fn u(X: Vector3<f64>) -> Vector3<f64> {
    let (x, y, z) = (X.x, X.y, X.z);
    0.06 * Vector3::new(
        (2.0 * y + x).sin() * z,
        (1.5 * x - z).cos() * (1.0 + y),
        (2.0 * x + 1.7 * z).sin() + x * y * z,
    )
}

/// Differences of order 8 of a smooth field, accurate to about 1e-11 at this step.
fn derivative<T>(f: impl Fn(f64) -> T) -> T
where
    T: std::ops::Sub<Output = T> + std::ops::Add<Output = T> + std::ops::Mul<f64, Output = T>,
{
    // Coefficients: Fornberg, Math Comput 1988;51:699.
    let h = 2e-2;
    let d = |k: f64| f(k * h) - f(-k * h);
    (d(1.0) * (4.0 / 5.0) + d(2.0) * (-1.0 / 5.0) + d(3.0) * (4.0 / 105.0) + d(4.0) * (-1.0 / 280.0))
        * (1.0 / h)
}

fn F(X: Vector3<f64>) -> Matrix3<f64> {
    Matrix3::identity() + Matrix3::from_columns(&[0, 1, 2].map(|j| derivative(|h| u(X + Vector3::ith(j, h)))))
}

/// b = −Div P.
fn body_force(law: &impl Material, X: Vector3<f64>) -> Vector3<f64> {
    -(0..3)
        .map(|j| derivative(|h| -> Vector3<f64> { law.stress(&F(X + Vector3::ith(j, h))).column(j).into() }))
        .sum::<Vector3<f64>>()
}

/// Gauss points and weights of degree 9 on [-1, 1].
const GAUSS: [(f64, f64); 5] = [
    (0.0, 0.568_888_888_888_888_9),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    (0.906_179_845_938_664, 0.236_926_885_056_189_08),
];

/// Shape functions, their derivatives and the weight at every point of a fine rule on the parametric cell.
fn fine_rule(n_nodes: usize) -> Vec<(Vec<f64>, Vec<[f64; 3]>, f64)> {
    let mut rule = Vec::new();
    for (x, wx) in GAUSS {
        for (y, wy) in GAUSS {
            for (z, wz) in GAUSS {
                let w = wx * wy * wz;
                if n_nodes == 8 {
                    let (n, dn) = hex8_at([x, y, z]);
                    rule.push((n.to_vec(), dn.to_vec(), w));
                } else {
                    // The cube collapsed onto the tetrahedron.
                    let [a, b, c] = [x, y, z].map(|s| 0.5 * (s + 1.0));
                    let xi = [a, (1.0 - a) * b, (1.0 - a) * (1.0 - b) * c];
                    let (n, dn) = tet10_at(xi);
                    rule.push((n.to_vec(), dn.to_vec(), w / 8.0 * (1.0 - a).powi(2) * (1.0 - b)));
                }
            }
        }
    }
    rule
}

/// Calls `visit` with the nodes of the cell, shape functions, place and weight of every fine quadrature point.
fn integrate(mesh: &Mesh, mut visit: impl FnMut(&[u32], &[f64], Vector3<f64>, f64)) {
    let block = &mesh.blocks[0];
    let n = block.kind.n_nodes();
    let rule = fine_rule(n);
    for nodes in block.nodes.chunks_exact(n) {
        for (shape, slope, w) in &rule {
            let (mut X, mut jacobian) = (Vector3::zeros(), Matrix3::zeros());
            for (a, &node) in nodes.iter().enumerate() {
                let p = Vector3::from(mesh.points[node as usize]);
                X += p * shape[a];
                jacobian += p * nalgebra::RowVector3::from(slope[a]);
            }
            visit(nodes, shape, X, w * jacobian.determinant());
        }
    }
}

/// L2 error of the displacement on a mesh whose boundary is that of the unit cube.
fn error(mut mesh: Mesh, law: &impl Material, spec: LawSpec) -> f64 {
    let outside = |p: &[f64; 3]| p.iter().any(|&c| c.abs() < 1e-9 || (c - 1.0).abs() < 1e-9);
    let nodes = (0..mesh.points.len() as u32).filter(|&n| outside(&mesh.points[n as usize])).collect();
    mesh.node_sets.insert("boundary".to_string(), nodes);
    let mut loads = vec![[0.0; 3]; mesh.points.len()];
    integrate(&mesh, |nodes, shape, X, w| {
        let b = body_force(law, X);
        for (&n, shape) in nodes.iter().zip(shape) {
            for i in 0..3 {
                loads[n as usize][i] += w * shape * b[i];
            }
        }
    });
    let scene = Scene {
        solids: vec![solid(&mesh.blocks[0].name, spec, None)],
        forces: vec![ForceSpec {
            name: "body force".to_string(),
            loads: (0..).zip(loads).collect(),
            control: "load".to_string(),
        }],
        prescribed: vec![displaced(&mesh, "boundary", |X| u(X.into()).into())],
        ..Scene::default()
    };
    let frame = solve(&plan(&scene, &mesh), &[("load", 1.0)], &tolerance(1e-9));
    let mut square = 0.0;
    integrate(&mesh, |nodes, shape, X, w| {
        let mut x = Vector3::zeros();
        for (&n, shape) in nodes.iter().zip(shape) {
            x += Vector3::from_column_slice(&frame.x[3 * n as usize..3 * n as usize + 3]) * *shape;
        }
        square += w * (x - X - u(X)).norm_squared();
    });
    square.sqrt()
}

/// The unit cube with its inside moved smoothly, so that no cell is a box.
fn warped(n: usize) -> Mesh {
    generate::mapped([n; 3], |s| {
        let bump = s.iter().map(|c| (PI * c).sin()).product::<f64>();
        [s[0] + 0.06 * bump, s[1] - 0.05 * bump, s[2] + 0.04 * bump]
    })
}

fn check(name: &str, sizes: [usize; 3], wanted: f64, error: impl Fn(usize) -> f64) {
    let errors = sizes.map(&error).map(|e| e * 1e6);
    let orders =
        [0, 1].map(|i| (errors[i] / errors[i + 1]).ln() / (sizes[i + 1] as f64 / sizes[i] as f64).ln());
    println!("{name}: n = {sizes:?}, L2 errors in 1e-6 {errors:.3?}, orders {orders:.3?}");
    assert!((orders[1] - wanted).abs() < 0.1, "{name}: order {:.3} instead of {wanted}", orders[1]);
}

#[test]
fn hex8_of_mean_dilatation_converges_with_order_two() {
    let law = MooneyRivlin { c10: 3.0, c01: 0.75, bulk: 75.0 };
    let spec = || LawSpec::MooneyRivlin { c10: 3.0, c01: 0.75, bulk: 75.0 };
    check("hex8, mean dilatation", [4, 8, 12], 2.0, |n| error(warped(n), &law, spec()));
}

#[test]
fn tet10_converges_with_order_three() {
    let law = NeoHookean::from_young(20.0, 0.3);
    let spec = || LawSpec::NeoHookean { young: 20.0, nu: 0.3 };
    check("tet10", [2, 4, 6], 3.0, |n| error(generate::tetrahedra(&warped(n), true), &law, spec()));
}
