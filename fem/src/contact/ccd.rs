//! Continuous collision detection: how far a pair may move along straight lines without touching.
//!
//! The distance of a pair falls no faster than the fastest of its points moves against the other simplex. So the pair may
//! move until that bound has used up its distance, and again from there, until only a fraction of the first distance is
//! left: no root of a cubic, never too far. Li, Kaufman & Jiang, Codimensional incremental potential contact,
//! ACM Trans. Graph. 40 (2021), §5 (additive CCD).

use crate::geometry::closest::{Points, edge_edge, point_triangle};
use nalgebra::Vector3;

/// Of a distance a tenth is left at least.
pub fn tenth(first: f64) -> f64 {
    0.1 * first
}
/// Fraction of the safe motion that is taken at once.
const TAKEN: f64 = 0.9;
/// Rounds after which the fraction reached so far is the answer.
const MAX_ROUNDS: usize = 1000;

/// Greatest fraction 0..=1 of the way `to` − `from` that point 0 and triangle (1, 2, 3) may go, so that a distance of `kept(first)` is left
/// of the first one, which is less.
pub fn point_triangle_step(from: &Points, to: &Points, kept: impl Fn(f64) -> f64) -> f64 {
    let distance = |x: &Points| point_triangle(x).squared().sqrt();
    fraction(from, to, kept, distance, |step| step[0].norm() + largest(step[1..].iter().copied()))
}

/// The same of edges (0, 1) and (2, 3).
pub fn edge_edge_step(from: &Points, to: &Points, kept: impl Fn(f64) -> f64) -> f64 {
    let distance = |x: &Points| edge_edge(x).squared().sqrt();
    fraction(from, to, kept, distance, |step| {
        largest(step[..2].iter().copied()) + largest(step[2..].iter().copied())
    })
}

/// Greatest norm.
pub(super) fn largest(steps: impl IntoIterator<Item = Vector3<f64>>) -> f64 {
    steps.into_iter().map(|s| s.norm_squared()).fold(0.0, f64::max).sqrt()
}

fn fraction(
    from: &Points,
    to: &Points,
    kept: impl Fn(f64) -> f64,
    distance: impl Fn(&Points) -> f64,
    closing: impl Fn(&Points) -> f64,
) -> f64 {
    let mut step: Points = std::array::from_fn(|i| to[i] - from[i]);
    let mean = step.iter().sum::<Vector3<f64>>() / 4.0;
    step.iter_mut().for_each(|s| *s -= mean);
    let fastest = closing(&step);
    let first = distance(from);
    let kept = kept(first);
    if fastest <= TAKEN * (first - kept) {
        return 1.0;
    }
    if !(first > 0.0) {
        return 0.0;
    }
    let mut t = 0.0;
    let mut d = first;
    for _ in 0..MAX_ROUNDS {
        let next = t + TAKEN * (d - kept).max(0.0) / fastest;
        if next >= 1.0 {
            return 1.0;
        }
        d = distance(&std::array::from_fn(|i| from[i] + step[i] * next));
        if d <= kept * (1.0 + 1e-6) || next - t < 1e-9 {
            return if d > 0.0 { next } else { t };
        }
        t = next;
    }
    t
}
