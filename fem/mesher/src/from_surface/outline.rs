//! Fourteen points on every level line: the thin borders A and B found smoothly along the muscle, the rest between them.

use std::f64::consts::TAU;

use nalgebra::{SMatrix, Vector3};

use super::harmonic::{area_and_centroid, length};
use crate::{N_OUTLINE, Station};
use fem::geometry::closest::along_edge;

/// Points of a resampled line.
const N: usize = 240;
/// Positions tried for a border.
const TRIED: usize = 80;
/// Samples per interval, rounds and hold of the places along the line when the points are fitted; points of the line searched each
/// way for the nearest.
const FIT_SAMPLES: usize = 8;
const FIT_ROUNDS: usize = 3;
const HOLD: f64 = 0.1;
const SEARCHED: usize = 12;
/// Weight of the change of shape between neighbouring sections against the thinness of a section.
const SMOOTHNESS: f64 = 1.0;
/// Length of an end's arc over the mean thickness; its bounds as fractions of the outline.
const END_ARC: f64 = 0.85;
const END_ARC_BOUNDS: [f64; 2] = [0.03, 0.16];

/// A closed line with equally spaced points.
pub(super) struct Ring {
    points: Vec<Vector3<f64>>,
    pub length: f64,
    pub centre: Vector3<f64>,
    pub normal: Vector3<f64>,
    pub area: f64,
}

impl Ring {
    pub fn new(line: &[Vector3<f64>]) -> Ring {
        let total = length(line);
        let mut points = Vec::with_capacity(N);
        let (mut i, mut passed) = (0, 0.0);
        for k in 0..N {
            let wanted = total * k as f64 / N as f64;
            loop {
                let (a, b) = (line[i % line.len()], line[(i + 1) % line.len()]);
                let step = (b - a).norm();
                if passed + step > wanted || i + 1 >= line.len() {
                    points.push(a + ((wanted - passed) / step.max(1e-300)).min(1.0) * (b - a));
                    break;
                }
                passed += step;
                i += 1;
            }
        }
        let (area, centre) = area_and_centroid(line);
        Ring { points, length: total, centre, normal: area / area.norm(), area: area.norm() }
    }

    /// Point at a fraction of the length.
    fn at(&self, u: f64) -> Vector3<f64> {
        let x = u.rem_euclid(1.0) * N as f64;
        let (i, f) = (x.floor() as usize % N, x - x.floor());
        self.points[i] + f * (self.points[(i + 1) % N] - self.points[i])
    }

    /// The point of the ring nearest to `p`, searched for near the fraction `u` of the length.
    fn nearest(&self, p: &Vector3<f64>, u: f64) -> Vector3<f64> {
        let first = (u.rem_euclid(1.0) * N as f64) as usize + N - SEARCHED;
        let on = |i: usize| {
            let (a, b) = (self.points[i % N], self.points[(i + 1) % N]);
            a + along_edge(p, &a, &b) * (b - a)
        };
        let mut best = on(first);
        for i in first + 1..=first + 2 * SEARCHED {
            let x = on(i);
            if (x - p).norm_squared() < (best - p).norm_squared() {
                best = x;
            }
        }
        best
    }

    /// Boundary points at fractions `u` of the length (ascending, less than one turn), then moved so that the closed curve through
    /// them lies on the ring as well as it can (least squares).
    fn fitted(&self, u: &[f64; N_OUTLINE]) -> [Vector3<f64>; N_OUTLINE] {
        let placed = u.map(|u| self.at(u));
        let mut points = placed;
        for _ in 0..FIT_ROUNDS {
            let basis = curve_basis(&points);
            // Towards the first places, weakly: points stay where they are along the ring.
            let mut matrix = SMatrix::<f64, N_OUTLINE, N_OUTLINE>::identity() * HOLD;
            let mut right = SMatrix::<f64, N_OUTLINE, 3>::zeros();
            for k in 0..N_OUTLINE {
                right.row_mut(k).copy_from(&(placed[k] * HOLD).transpose());
            }
            for (k, samples) in basis.iter().enumerate() {
                let span = (u[(k + 1) % N_OUTLINE] - u[k]).rem_euclid(1.0);
                for (j, weights) in samples.iter().enumerate() {
                    let index = |i: usize| (k + N_OUTLINE - 1 + i) % N_OUTLINE;
                    let x: Vector3<f64> = (0..4).map(|i| weights[i] * points[index(i)]).sum();
                    let target = self.nearest(&x, u[k] + span * j as f64 / FIT_SAMPLES as f64);
                    for a in 0..4 {
                        for b in 0..4 {
                            matrix[(index(a), index(b))] += weights[a] * weights[b];
                        }
                        let moved = right.row(index(a)) + (target * weights[a]).transpose();
                        right.row_mut(index(a)).copy_from(&moved);
                    }
                }
            }
            let Some(factor) = matrix.cholesky() else { break };
            let solved = factor.solve(&right);
            points = std::array::from_fn(|k| solved.row(k).transpose());
        }
        points
    }

    /// Mean square distance of the halves on both sides of position `j`, over the square of the length.
    fn thickness(&self, j: usize) -> f64 {
        let pair = |x: usize| (self.points[(j + x) % N] - self.points[(j + N - x) % N]).norm_squared();
        (1..N / 2).map(pair).sum::<f64>() / (N / 2) as f64 / (self.length * self.length)
    }

    /// How differently two rings lie about their centres when position `i` of the one is position `j` of the other.
    fn difference(&self, i: usize, other: &Ring, j: usize) -> f64 {
        let (r, q) = (self.length / TAU, other.length / TAU);
        let samples = (0..N).step_by(N / 24);
        let n = samples.len() as f64;
        samples
            .map(|k| {
                let a = (self.points[(i + k) % N] - self.centre) / r;
                let b = (other.points[(j + k) % N] - other.centre) / q;
                (a - b).norm_squared()
            })
            .sum::<f64>()
            / n
    }
}

/// Weights of the points k − 1 … k + 2 in the curve through boundary points (see [`crate::Loft`]), for samples of
/// every interval k. The knots are those of `points`.
fn curve_basis(points: &[Vector3<f64>; N_OUTLINE]) -> [[[f64; 4]; FIT_SAMPLES]; N_OUTLINE] {
    let next = |k: usize| (k + 1) % N_OUTLINE;
    let previous = |k: usize| (k + N_OUTLINE - 1) % N_OUTLINE;
    let step: [f64; N_OUTLINE] = std::array::from_fn(|k| (points[next(k)] - points[k]).norm().sqrt());
    let tangent = |k: usize| {
        let (h0, h1) = (step[previous(k)], step[k]);
        let (before, after) = (h1 / (h0 * (h0 + h1)), h0 / (h1 * (h0 + h1)));
        [-before, before - after, after]
    };
    std::array::from_fn(|k| {
        std::array::from_fn(|j| {
            let f = j as f64 / FIT_SAMPLES as f64;
            let (f2, f3) = (f * f, f * f * f);
            let (slope_a, slope_b) = ((f3 - 2.0 * f2 + f) * step[k], (f3 - f2) * step[k]);
            let mut weights = [0.0, 2.0 * f3 - 3.0 * f2 + 1.0, 3.0 * f2 - 2.0 * f3, 0.0];
            let (a, b) = (tangent(k), tangent(next(k)));
            for i in 0..3 {
                weights[i] += slope_a * a[i];
                weights[i + 1] += slope_b * b[i];
            }
            weights
        })
    })
}

/// Border A of every ring as a fraction of its length: the path through all rings with the least sum of thickness and change.
fn borders(rings: &[&Ring]) -> Vec<f64> {
    let position = |j: usize| j * N / TRIED;
    let own = |ring: &Ring| -> Vec<f64> { (0..TRIED).map(|j| 40.0 * ring.thickness(position(j))).collect() };
    let mut cost = own(rings[0]);
    let mut from: Vec<Vec<usize>> = Vec::new();
    for pair in rings.windows(2) {
        let thin = own(pair[1]);
        let mut next = vec![f64::INFINITY; TRIED];
        let mut origin = vec![0; TRIED];
        for j in 0..TRIED {
            for i in 0..TRIED {
                let total = cost[i] + SMOOTHNESS * pair[0].difference(position(i), pair[1], position(j));
                if total < next[j] {
                    (next[j], origin[j]) = (total, i);
                }
            }
            next[j] += thin[j];
        }
        cost = next;
        from.push(origin);
    }
    let mut best = (0..TRIED).fold(0, |best, j| if cost[j] < cost[best] { j } else { best });
    let mut path = vec![best];
    for origin in from.iter().rev() {
        best = origin[best];
        path.push(best);
    }
    path.reverse();
    path.into_iter().map(|j| position(j) as f64 / N as f64).collect()
}

/// Running means over neighbours, `rounds` times; for circular fractions the steps are taken the short way round.
fn smooth(values: &mut [f64], rounds: usize, circular: bool) {
    let step = |x: f64| if circular { x - x.round() } else { x };
    for _ in 0..rounds {
        let old = values.to_vec();
        for i in 0..values.len() {
            let before = step(old[i.saturating_sub(1)] - old[i]);
            let after = step(old[(i + 1).min(old.len() - 1)] - old[i]);
            values[i] = old[i] + 0.25 * (before + after);
        }
    }
}

/// Stations of rings that follow each other from origin to insertion, `s` along the line of centres.
pub(super) fn stations(rings: &[&Ring]) -> Vec<Station> {
    let border = borders(rings);
    let arc = |(ring, u): (&&Ring, &f64)| {
        let width = (ring.at(*u) - ring.at(u + 0.5)).norm();
        (END_ARC * ring.area / width / ring.length).clamp(END_ARC_BOUNDS[0], END_ARC_BOUNDS[1])
    };
    let mut arcs: Vec<f64> = rings.iter().zip(&border).map(arc).collect();
    smooth(&mut arcs, 2, false);
    let mut s = vec![0.0];
    for pair in rings.windows(2) {
        s.push(s[s.len() - 1] + (pair[1].centre - pair[0].centre).norm());
    }
    let total = s[s.len() - 1];
    let station = |i: usize| {
        let (ring, a, e) = (rings[i], border[i], arcs[i]);
        let side = 0.5 - e;
        let u: [f64; N_OUTLINE] = std::array::from_fn(|k| match k {
            0..=5 => a + e / 2.0 + side * k as f64 / 5.0,
            6 => a + 0.5,
            7..=12 => a + 0.5 + e / 2.0 + side * (k - 7) as f64 / 5.0,
            _ => a + 1.0,
        });
        let outline = ring.fitted(&u);
        let across = outline[13] - outline[6];
        let axis = (across - ring.normal * across.dot(&ring.normal)).normalize();
        Station { s: s[i] / total, centre: ring.centre, normal: ring.normal, axis, outline }
    };
    (0..rings.len()).map(station).collect()
}
