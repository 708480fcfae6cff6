//! Points inside hexahedra and tetrahedra: which cell, and with which shape functions.

use crate::effect::line::End;
use crate::element::shape::{self, contract};
use crate::mesh::{CellKind, Mesh};
use nalgebra::Vector3;

/// The solid cells of a mesh that points can be embedded in.
pub struct Embedding<'a> {
    mesh: &'a Mesh,
    cells: Vec<Cell<'a>>,
}

struct Cell<'a> {
    kind: CellKind,
    nodes: &'a [u32],
    /// Corners of the bounding box \[m\].
    bounds: [[f64; 3]; 2],
}

/// How far outside a cell, in its own coordinates, a point still counts as inside (points on faces).
const TOLERANCE: f64 = 1e-6;

impl<'a> Embedding<'a> {
    /// Over the hexahedra and linear tetrahedra of the named blocks.
    pub fn new(mesh: &'a Mesh, regions: &[&str]) -> Self {
        let mut cells = Vec::new();
        for block in mesh.blocks.iter().filter(|b| regions.contains(&b.name.as_str())) {
            if !matches!(block.kind, CellKind::Hex8 | CellKind::Tet4) {
                continue;
            }
            for nodes in block.nodes.chunks_exact(block.kind.n_nodes()) {
                let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
                for &n in nodes {
                    for i in 0..3 {
                        bounds[0][i] = bounds[0][i].min(mesh.points[n as usize][i]);
                        bounds[1][i] = bounds[1][i].max(mesh.points[n as usize][i]);
                    }
                }
                cells.push(Cell { kind: block.kind, nodes, bounds });
            }
        }
        Embedding { mesh, cells }
    }

    /// Nodes and weights of the first cell that holds a point \[m\].
    pub fn locate(&self, p: [f64; 3]) -> Option<End> {
        self.cells.iter().find_map(|Cell { kind, nodes, bounds: [low, high] }| {
            let near = (0..3).all(|i| {
                let margin = TOLERANCE * (high[i] - low[i]);
                p[i] >= low[i] - margin && p[i] <= high[i] + margin
            });
            if !near {
                return None;
            }
            let weights = match kind {
                CellKind::Hex8 => self.in_hex8(nodes, p)?.to_vec(),
                _ => self.in_tet4(nodes, p)?.to_vec(),
            };
            Some(nodes.iter().copied().zip(weights).filter(|(_, w)| w.abs() > 1e-12).collect())
        })
    }

    /// Newton's method for ξ in x(ξ) = p.
    fn in_hex8(&self, nodes: &[u32], p: [f64; 3]) -> Option<[f64; 8]> {
        let X: [[f64; 3]; 8] = std::array::from_fn(|a| self.mesh.points[nodes[a] as usize]);
        let mut xi = Vector3::zeros();
        for _ in 0..20 {
            let (n, dn) = shape::hex8_at(xi.into());
            let x: Vector3<f64> = X.iter().zip(n).map(|(X, n)| Vector3::from(*X) * n).sum();
            let step = contract(&X, &dn).try_inverse()? * (Vector3::from(p) - x);
            xi += step;
            if step.amax() < 1e-13 {
                break;
            }
        }
        if !(xi.amax() <= 1.0 + TOLERANCE) {
            return None;
        }
        Some(shape::hex8_at(xi.into()).0)
    }

    fn in_tet4(&self, nodes: &[u32], p: [f64; 3]) -> Option<[f64; 4]> {
        let X: [[f64; 3]; 4] = std::array::from_fn(|a| self.mesh.points[nodes[a] as usize]);
        let jacobian = contract(&X, &shape::tet4().dn[0]);
        let xi = jacobian.try_inverse()? * (Vector3::from(p) - Vector3::from(X[0]));
        let n = [1.0 - xi[0] - xi[1] - xi[2], xi[0], xi[1], xi[2]];
        n.iter().all(|&n| n >= -TOLERANCE).then_some(n)
    }
}
