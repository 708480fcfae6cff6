//! Minimisation of a smooth function of node positions: limited-memory BFGS (Nocedal & Wright, Numerical Optimization, 2nd ed.,
//! algorithms 7.4 and 7.5) with a constant 3 × 3 matrix per node as first guess of the inverse Hessian.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};

/// Pairs of steps and gradient changes that are kept.
const MEMORY: usize = 10;
/// Fraction of the promised decrease that a step must give (Armijo).
const DECREASE: f64 = 1e-4;
/// Halvings of a step before the search gives up.
const HALVINGS: usize = 30;

/// A step, the change of the gradient along it, and their product.
type Pair = (Vec<Vector3<f64>>, Vec<Vector3<f64>>, f64);

/// Lowers `f` from `x` in at most `max_iterations` steps, and returns the value reached and the steps taken.
///
/// `f` gives the value at a place and writes the gradient. `metric`: symmetric positive definite, one per node. `reach`: farthest that a node may go in one step. Ends early where the decrease
/// predicted by a step falls below `tolerance`.
pub fn minimise(
    x: &mut [Vector3<f64>],
    metric: &[Matrix3<f64>],
    reach: &[f64],
    max_iterations: usize,
    tolerance: f64,
    mut f: impl FnMut(&[Vector3<f64>], &mut [Vector3<f64>]) -> f64,
) -> (f64, usize) {
    let n = x.len();
    let mut gradient = vec![Vector3::zeros(); n];
    let mut value = f(x, &mut gradient);
    let mut history: VecDeque<Pair> = VecDeque::new();
    let mut new_x = x.to_vec();
    let mut new_gradient = gradient.clone();
    for iteration in 0..max_iterations {
        let mut direction = gradient.iter().map(|g| -g).collect::<Vec<_>>();
        two_loop(&mut direction, &history, metric);
        let mut slope = dot(&direction, &gradient);
        if !(slope < 0.0) {
            if history.is_empty() {
                return (value, iteration);
            }
            history.clear();
            direction.iter_mut().zip(&gradient).zip(metric).for_each(|((d, g), m)| *d = -(m * g));
            slope = dot(&direction, &gradient);
        }
        if !(-slope > tolerance) {
            return (value, iteration);
        }
        let farthest = direction.iter().zip(reach).map(|(d, r)| d.norm() / r).fold(0.0, f64::max);
        let mut scale = if farthest > 1.0 { 1.0 / farthest } else { 1.0 };
        let mut accepted = None;
        for _ in 0..HALVINGS {
            for i in 0..n {
                new_x[i] = x[i] + direction[i] * scale;
            }
            let new_value = f(&new_x, &mut new_gradient);
            if new_value <= value + DECREASE * scale * slope {
                accepted = Some(new_value);
                break;
            }
            scale /= if new_value.is_finite() { 2.0 } else { 8.0 };
        }
        let Some(new_value) = accepted else {
            if history.is_empty() {
                return (value, iteration);
            }
            history.clear();
            continue;
        };
        let step: Vec<_> = direction.iter().map(|d| d * scale).collect();
        let change: Vec<_> = new_gradient.iter().zip(&gradient).map(|(a, b)| a - b).collect();
        let curvature = dot(&step, &change);
        if curvature > 0.0 {
            if history.len() == MEMORY {
                history.pop_front();
            }
            history.push_back((step, change, curvature));
        }
        x.copy_from_slice(&new_x);
        std::mem::swap(&mut gradient, &mut new_gradient);
        value = new_value;
    }
    (value, max_iterations)
}

/// Multiplies with the current guess of the inverse Hessian.
fn two_loop(r: &mut [Vector3<f64>], history: &VecDeque<Pair>, metric: &[Matrix3<f64>]) {
    let mut factors = Vec::with_capacity(history.len());
    for (step, change, curvature) in history.iter().rev() {
        let factor = dot(step, r) / curvature;
        r.iter_mut().zip(change).for_each(|(r, y)| *r -= y * factor);
        factors.push(factor);
    }
    let scale = history.back().map_or(1.0, |(_, change, curvature)| {
        let size: f64 = change.iter().zip(metric).map(|(y, m)| y.dot(&(m * y))).sum();
        if size > 0.0 { curvature / size } else { 1.0 }
    });
    r.iter_mut().zip(metric).for_each(|(r, m)| *r = m * *r * scale);
    for ((step, change, curvature), factor) in history.iter().zip(factors.into_iter().rev()) {
        let back = factor - dot(change, r) / curvature;
        r.iter_mut().zip(step).for_each(|(r, s)| *r += s * back);
    }
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}
