//! Size and shape of cells: volume, Jacobian determinants, scaled Jacobian.
#![allow(non_snake_case)]

use nalgebra::{Matrix3, Vector3};

use super::{CellBlock, CellKind, Mesh};
use crate::element::shape;

/// Shape of the solid cells of a block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Least scaled Jacobian of a cell: 1 for a cube or a regular tetrahedron, not positive when inverted at a corner.
    pub least_scaled_jacobian: f64,
    /// The cell that has it.
    pub worst_cell: usize,
    /// Mean over the cells.
    pub mean_scaled_jacobian: f64,
    /// Least determinant of the map from the parent cell at a Gauss point \[m³\].
    pub least_gauss_det: f64,
    /// Sum of the cell volumes \[m³\].
    pub volume: f64,
}

impl Mesh {
    /// Quality of the solid cells of `block`; `None` for faces, lines and empty blocks.
    pub fn quality(&self, block: &CellBlock) -> Option<Quality> {
        if !block.kind.is_solid() || block.n_cells() == 0 {
            return None;
        }
        let mut quality = Quality {
            least_scaled_jacobian: f64::INFINITY,
            worst_cell: 0,
            mean_scaled_jacobian: 0.0,
            least_gauss_det: f64::INFINITY,
            volume: 0.0,
        };
        for (cell, nodes) in block.cells().enumerate() {
            let X = self.corners(nodes);
            let scaled = scaled_jacobian(block.kind, &X);
            if scaled < quality.least_scaled_jacobian {
                (quality.least_scaled_jacobian, quality.worst_cell) = (scaled, cell);
            }
            quality.mean_scaled_jacobian += scaled / block.n_cells() as f64;
            for (det, weight) in gauss_dets(block.kind, &X) {
                quality.least_gauss_det = quality.least_gauss_det.min(det);
                quality.volume += weight * det;
            }
        }
        Some(quality)
    }

    /// Volume of the solid cells of a block \[m³\]; zero for faces and lines.
    pub fn volume(&self, block: &CellBlock) -> f64 {
        self.quality(block).map_or(0.0, |q| q.volume)
    }

    /// Coordinates of the nodes of a cell \[m\].
    pub(crate) fn corners(&self, nodes: &[u32]) -> Vec<Vector3<f64>> {
        nodes.iter().map(|&n| Vector3::from(self.points[n as usize])).collect()
    }
}

/// A corner of each cell with the ends of the edges that leave it, right-handed.
const HEX_CORNERS: [[usize; 4]; 8] = [
    [0, 1, 3, 4],
    [1, 2, 0, 5],
    [2, 3, 1, 6],
    [3, 0, 2, 7],
    [4, 7, 5, 0],
    [5, 4, 6, 1],
    [6, 5, 7, 2],
    [7, 6, 4, 3],
];
const TET_CORNERS: [[usize; 4]; 4] = [[0, 1, 2, 3], [1, 2, 0, 3], [2, 0, 1, 3], [3, 0, 2, 1]];
const WEDGE_CORNERS: [[usize; 4]; 6] =
    [[0, 1, 2, 3], [1, 2, 0, 4], [2, 0, 1, 5], [3, 5, 4, 0], [4, 3, 5, 1], [5, 4, 3, 2]];

/// Least over the corners of det(e₁, e₂, e₃) / (|e₁||e₂||e₃|), e the edges that leave the corner; for tetrahedra times √2
/// (from their corner nodes) and for wedges times 2/√3, so that the regular ones have 1 (Knupp et al., The Verdict Library,
/// 2006, §5.8, §6.14 and ch. 8, with the edges of each corner in place of the largest product). `X`: nodes of a solid cell \[m\].
pub fn scaled_jacobian(kind: CellKind, X: &[Vector3<f64>]) -> f64 {
    let (corners, scale): (&[[usize; 4]], f64) = match kind {
        CellKind::Hex8 => (&HEX_CORNERS, 1.0),
        CellKind::Wedge6 => (&WEDGE_CORNERS, 2.0 / 3f64.sqrt()),
        _ => (&TET_CORNERS, 2f64.sqrt()),
    };
    let mut least = f64::INFINITY;
    for &[o, a, b, c] in corners {
        let edges = [X[a] - X[o], X[b] - X[o], X[c] - X[o]];
        let lengths: f64 = edges.iter().map(|e| e.norm()).product();
        let det = Matrix3::from_columns(&edges).determinant();
        least = least.min(if lengths > 0.0 { scale * det / lengths } else { 0.0 });
    }
    least
}

/// Determinants of the map from the parent cell \[m³\] at the corners of a solid cell.
pub fn corner_dets(kind: CellKind, X: &[Vector3<f64>]) -> Vec<f64> {
    let of_edges = |corners: &[[usize; 4]]| {
        let det = |&[o, a, b, c]: &[usize; 4]| {
            Matrix3::from_columns(&[X[a] - X[o], X[b] - X[o], X[c] - X[o]]).determinant()
        };
        corners.iter().map(det).collect()
    };
    match kind {
        CellKind::Hex8 => of_edges(&HEX_CORNERS),
        CellKind::Wedge6 => of_edges(&WEDGE_CORNERS),
        CellKind::Tet10 => {
            let corner = |i: usize| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 });
            (0..4).map(|i| tet10_map(X, corner(i)).determinant()).collect()
        }
        _ => of_edges(&TET_CORNERS),
    }
}

/// Determinant of the map from the parent cell and quadrature weight at each Gauss point of a solid cell.
/// The weighted sum is the volume, exactly: the determinant is at most quadratic in each coordinate for hex8
/// (2 × 2 × 2 points), constant for tet4, cubic for tet10 (five points, Keast 1986, degree 3), linear over the triangle and
/// quadratic along the axis for wedges (3 × 2 points).
pub fn gauss_dets(kind: CellKind, X: &[Vector3<f64>]) -> Vec<(f64, f64)> {
    match kind {
        CellKind::Hex8 => {
            let g = 1.0 / 3f64.sqrt();
            let det = |i: usize| {
                let sign = |bit: usize| if i >> bit & 1 == 0 { -g } else { g };
                hex_map(X, [sign(0), sign(1), sign(2)]).determinant()
            };
            (0..8).map(|i| (det(i), 1.0)).collect()
        }
        CellKind::Tet4 => {
            vec![(Matrix3::from_columns(&[X[1] - X[0], X[2] - X[0], X[3] - X[0]]).determinant(), 1.0 / 6.0)]
        }
        CellKind::Tet10 => {
            let mut points = vec![([0.25; 4], -4.0 / 30.0)];
            for i in 0..4 {
                let mut L = [1.0 / 6.0; 4];
                L[i] = 0.5;
                points.push((L, 9.0 / 120.0));
            }
            points.into_iter().map(|(L, w)| (tet10_map(X, L).determinant(), w)).collect()
        }
        CellKind::Wedge6 => {
            let rule = shape::wedge6();
            let nodes: [[f64; 3]; 6] = std::array::from_fn(|a| X[a].into());
            let det = |g: usize| shape::contract(&nodes, &rule.dn[g]).determinant();
            (0..6).map(|g| (det(g), rule.w[g])).collect()
        }
        _ => Vec::new(),
    }
}

/// ∂X/∂ξ of the trilinear hexahedron, ξ in [-1, 1]³.
fn hex_map(X: &[Vector3<f64>], xi: [f64; 3]) -> Matrix3<f64> {
    const SIGN: [[f64; 3]; 8] = [
        [-1.0, -1.0, -1.0],
        [1.0, -1.0, -1.0],
        [1.0, 1.0, -1.0],
        [-1.0, 1.0, -1.0],
        [-1.0, -1.0, 1.0],
        [1.0, -1.0, 1.0],
        [1.0, 1.0, 1.0],
        [-1.0, 1.0, 1.0],
    ];
    let mut map = Matrix3::zeros();
    for (X, s) in X.iter().zip(SIGN) {
        let f = [0, 1, 2].map(|i| 1.0 + s[i] * xi[i]);
        let gradient = [s[0] * f[1] * f[2], f[0] * s[1] * f[2], f[0] * f[1] * s[2]];
        map += X * Vector3::from(gradient).transpose() / 8.0;
    }
    map
}

/// ∂X/∂(L₁, L₂, L₃) of the quadratic tetrahedron, L₀ = 1 − L₁ − L₂ − L₃.
fn tet10_map(X: &[Vector3<f64>], L: [f64; 4]) -> Matrix3<f64> {
    const EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]];
    let dL = [
        Vector3::new(-1.0, -1.0, -1.0),
        Vector3::new(1.0, 0.0, 0.0),
        Vector3::new(0.0, 1.0, 0.0),
        Vector3::new(0.0, 0.0, 1.0),
    ];
    let mut map = Matrix3::zeros();
    for i in 0..4 {
        map += X[i] * (dL[i] * (4.0 * L[i] - 1.0)).transpose();
    }
    for (X, [a, b]) in X[4..].iter().zip(EDGES) {
        map += X * ((dL[a] * L[b] + dL[b] * L[a]) * 4.0).transpose();
    }
    map
}
