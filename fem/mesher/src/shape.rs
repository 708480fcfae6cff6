//! What a mesh of hexahedra is worth: a smooth penalty on the shape of its cells.
//!
//! At the corners and Gauss points of a cell the columns e₁, e₂, e₃ of the map from the parent cell have the scaled determinant
//! q = det(e₁, e₂, e₃)/(|e₁||e₂||e₃|), between −1 and 1 whatever happens to the cell, so that cells which start inverted need no
//! separate treatment. Penalty of a corner: exp(−k (q − q₀))/k + p (1 − q)². Gauss points are penalised with w max(0, q₁ − q)², and
//! only looked at in cells with a poor corner: elsewhere they are not below q₁.

use nalgebra::Vector3;

/// Weight p of the quadratic part, which raises the mean.
const QUADRATIC: f64 = 0.2;
/// The value q₀ at which the exponential part has slope −1.
pub const WANTED: f64 = 0.45;
/// Cells whose worst corner lies below this are also watched at their Gauss points.
const POOR_CORNER: f64 = 0.5;
/// Weight w and threshold q₁ of the penalty of a Gauss point.
const GAUSS_WEIGHT: f64 = 50.0;
const GAUSS_WANTED: f64 = 0.4;

/// Nodes of the edges in direction ξ, η, ζ; edge `i + 2 j` of a direction has the other two parent coordinates i and j.
const EDGES: [[[usize; 2]; 4]; 3] =
    [[[0, 1], [3, 2], [4, 5], [7, 6]], [[0, 3], [1, 2], [4, 7], [5, 6]], [[0, 4], [1, 5], [3, 7], [2, 6]]];

/// Penalty of one cell; adds its gradient. `k`: sharpness of the exponential part.
pub fn cell_penalty(x: &[Vector3<f64>; 8], k: f64, gradient: &mut [Vector3<f64>; 8]) -> f64 {
    let edges = EDGES.map(|direction| direction.map(|[a, b]| x[b] - x[a]));
    let squares = edges.map(|direction| direction.map(|e| e.norm_squared()));
    let mut slopes = [[Vector3::zeros(); 4]; 3];
    let mut sum = 0.0;
    let mut worst: f64 = 1.0;
    for corner in 0..8 {
        let (i, j, l) = (corner & 1, corner >> 1 & 1, corner >> 2);
        let at = [j + 2 * l, i + 2 * l, i + 2 * j];
        let e = [edges[0][at[0]], edges[1][at[1]], edges[2][at[2]]];
        let size = [squares[0][at[0]], squares[1][at[1]], squares[2][at[2]]];
        let (q, slope) = scaled_determinant(&e, size);
        worst = worst.min(q);
        let sharp = (-k * (q - WANTED)).exp();
        sum += sharp / k + QUADRATIC * (1.0 - q) * (1.0 - q);
        let by = -sharp - 2.0 * QUADRATIC * (1.0 - q);
        for d in 0..3 {
            slopes[d][at[d]] += slope[d] * by;
        }
    }
    if !(worst > POOR_CORNER) {
        let near = 0.5 + 0.5 / 3f64.sqrt();
        for point in 0..8 {
            let weight = |bit: usize, side: usize| if point >> bit & 1 == side { near } else { 1.0 - near };
            let mut weights = [[0.0; 4]; 3];
            let mut e = [Vector3::zeros(); 3];
            for (d, others) in [[1, 2], [0, 2], [0, 1]].into_iter().enumerate() {
                for n in 0..4 {
                    weights[d][n] = weight(others[0], n & 1) * weight(others[1], n >> 1);
                    e[d] += edges[d][n] * weights[d][n];
                }
            }
            let (q, slope) = scaled_determinant(&e, e.map(|e| e.norm_squared()));
            let missing = (GAUSS_WANTED - q).max(0.0);
            sum += GAUSS_WEIGHT * missing * missing;
            let by = -2.0 * GAUSS_WEIGHT * missing;
            for d in 0..3 {
                for n in 0..4 {
                    slopes[d][n] += slope[d] * (by * weights[d][n]);
                }
            }
        }
    }
    for d in 0..3 {
        for n in 0..4 {
            let [a, b] = EDGES[d][n];
            gradient[a] -= slopes[d][n];
            gradient[b] += slopes[d][n];
        }
    }
    sum
}

/// q of the columns `e` with the squared lengths `size`, and its derivative by each column.
fn scaled_determinant(e: &[Vector3<f64>; 3], size: [f64; 3]) -> (f64, [Vector3<f64>; 3]) {
    let across = [e[1].cross(&e[2]), e[2].cross(&e[0]), e[0].cross(&e[1])];
    let scale = 1.0 / (size[0] * size[1] * size[2]).sqrt();
    let q = e[0].dot(&across[0]) * scale;
    (q, [0, 1, 2].map(|d| across[d] * scale - e[d] * (q / size[d])))
}
