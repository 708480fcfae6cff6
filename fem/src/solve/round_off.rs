//! What of an energy and of a residual is round-off.

use super::BlockMatrix;

/// Round-off of the energy \[J\] near a stress-free shape, where the terms of a law cancel: ε times stiffness times length
/// squared, as moduli times volume are; of the softest unknown, so that nothing stiff beside it hides its descent.
pub(super) fn energy_round_off(k: &BlockMatrix, x: &[f64]) -> f64 {
    let farthest = x.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let softest = (0..x.len()).map(|i| k.diagonal(i)).fold(f64::INFINITY, f64::min).max(0.0);
    2.0 * f64::EPSILON * farthest * farthest * softest * (x.len() as f64).sqrt()
}

/// Residual \[N\] that round-off of the positions alone makes: ε · |x| in every position times its stiffness.
pub(super) fn round_off(k: &BlockMatrix, x: &[f64]) -> f64 {
    let farthest = x.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let stiffness = (0..x.len()).map(|i| k.diagonal(i).powi(2)).sum::<f64>().sqrt();
    2.0 * f64::EPSILON * farthest * stiffness
}
