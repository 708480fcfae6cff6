//! Prolongation: values at the nodes of a mesh carried over to another mesh of the same bodies.
//!
//! A node of the other mesh has the value of the cell that holds it; where it lies beside all cells of its region, as nodes of a finer
//! mesh do on rounded faces, that of the nearest cell continued.

#![allow(non_snake_case)]

use super::{CellBlock, CellKind, Mesh, unique_nodes};
use crate::element::shape::{contract, hex8_at};
use crate::geometry::rotation::nearest_rotation;
use crate::geometry::tree::{Aabb, Tree};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// How far beside a cell its shape functions are continued, in its own coordinates, where a cell goes from -1 to 1: by its own length.
const BESIDE: f64 = 3.0;
/// Change of the coordinates in a cell at which they are found.
const FOUND: f64 = 1e-9;

/// Nodes and weights per node of a mesh whose values are wanted: of those of a mesh where they are known.
#[derive(Clone, Debug)]
pub struct Prolongation {
    weights: Vec<Option<([u32; 8], [f64; 8])>>,
}

impl Prolongation {
    /// From the hexahedra of `from` to the nodes of regions of the same name in `to`.
    pub fn new(from: &Mesh, to: &Mesh) -> Prolongation {
        let mut weights = vec![None; to.points.len()];
        for block in from.blocks.iter().filter(|b| b.kind == CellKind::Hex8) {
            let Ok(wanted) = to.block(&block.name) else { continue };
            if !wanted.kind.is_solid() {
                continue;
            }
            let nodes = unique_nodes(wanted.nodes.iter().copied());
            let cells = Cells::new(from, block);
            let found: Vec<_> =
                nodes.par_iter().map(|&n| cells.locate(Vector3::from(to.points[n as usize]))).collect();
            nodes.iter().zip(found).for_each(|(&n, found)| weights[n as usize] = found);
        }
        Prolongation { weights }
    }

    /// Vectors at the nodes of the other mesh, from `values`, 3 per node where they are known; `None` at nodes of no common region.
    pub fn vectors(&self, values: &[f64]) -> Vec<Option<[f64; 3]>> {
        let value = |n: u32, c: usize| values[3 * n as usize + c];
        let sum = |(nodes, weights): &([u32; 8], [f64; 8])| {
            std::array::from_fn(|c| nodes.iter().zip(weights).map(|(&n, w)| w * value(n, c)).sum())
        };
        self.weights.iter().map(|w| w.as_ref().map(sum)).collect()
    }

    /// How the cell that each node of the other mesh is in turns from the places `from` \[m\] of the nodes to `to`: the rotation that takes its corners
    /// there with the least squares (Kabsch, Acta Cryst. A32, 1976, 922). `None` for nodes of no cell, and of cells that are turned over.
    pub fn rotations(&self, from: &[f64], to: &[f64]) -> Vec<Option<Matrix3<f64>>> {
        let turned = |(nodes, _): &([u32; 8], [f64; 8])| {
            let place = |x: &[f64], n: u32| Vector3::from_fn(|c, _| x[3 * n as usize + c]);
            let middle = |x: &[f64]| nodes.iter().map(|&n| place(x, n)).sum::<Vector3<f64>>() / 8.0;
            let (a, b) = (middle(from), middle(to));
            let h: Matrix3<f64> =
                nodes.iter().map(|&n| (place(to, n) - b) * (place(from, n) - a).transpose()).sum();
            nearest_rotation(&h)
        };
        let rotation = |w: &Option<_>| w.as_ref().map(turned).filter(|R| R.determinant() > 0.0);
        self.weights.par_iter().map(rotation).collect()
    }
}

/// The cells of a region, to be looked for by place.
struct Cells {
    nodes: Vec<[u32; 8]>,
    places: Vec<[[f64; 3]; 8]>,
    tree: Tree,
}

impl Cells {
    fn new(mesh: &Mesh, block: &CellBlock) -> Cells {
        let nodes = block.nodes.as_chunks::<8>().0.to_vec();
        let places: Vec<_> = nodes.iter().map(|nodes| nodes.map(|n| mesh.points[n as usize])).collect();
        let around = |X: &[[f64; 3]; 8]| Aabb::around(X.map(Vector3::from).iter());
        let tree = Tree::new(&places.iter().map(around).collect::<Vec<_>>());
        Cells { nodes, places, tree }
    }

    /// Nodes and shape functions of the cell that holds `p` \[m\], or of the nearest one.
    fn locate(&self, p: Vector3<f64>) -> Option<([u32; 8], [f64; 8])> {
        let beside = |cell: u32| {
            let X = &self.places[cell as usize];
            let inside = coordinates(X, p).map(|x| x.clamp(-1.0, 1.0));
            (at(X, inside) - p).norm_squared()
        };
        let (cell, _) = self.tree.nearest(&Aabb::at(&p), f64::MAX.sqrt(), None, beside)?;
        let xi = coordinates(&self.places[cell as usize], p);
        Some((self.nodes[cell as usize], hex8_at(xi.map(|x| x.clamp(-BESIDE, BESIDE)).into()).0))
    }
}

fn at(X: &[[f64; 3]; 8], xi: Vector3<f64>) -> Vector3<f64> {
    X.iter().zip(hex8_at(xi.into()).0).map(|(X, n)| Vector3::from(*X) * n).sum()
}

/// ξ with x(ξ) = p by Newton's method, which is kept from running away from cells that are not convex.
fn coordinates(X: &[[f64; 3]; 8], p: Vector3<f64>) -> Vector3<f64> {
    let mut xi = Vector3::zeros();
    for _ in 0..20 {
        let (_, dn) = hex8_at(xi.into());
        let Some(inverse) = contract(X, &dn).try_inverse() else { break };
        let next = (xi + inverse * (p - at(X, xi))).map(|x| x.clamp(-2.0 * BESIDE, 2.0 * BESIDE));
        let change = (next - xi).amax();
        xi = next;
        if change < FOUND {
            break;
        }
    }
    xi
}
