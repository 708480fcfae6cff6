//! The surface of a muscle between its sections.
//!
//! Around a section: a closed cubic Hermite curve through the 14 boundary points, knots spaced by the square root of the chord,
//! tangents by the three-point parabola rule P′ = (h₁ s₀ + h₀ s₁)/(h₀ + h₁) with the slopes s₀, s₁ and steps h₀, h₁ before and
//! after the knot. Along the muscle: the same rule in s for every point of the outline, one-sided at the two ends.
//! A point of the surface has the coordinates t in 0..14, the outline parameter (whole numbers at the boundary points), and s in 0..1.

use nalgebra::Vector3;

use super::sections::{MuscleSections, N_OUTLINE};

/// Coefficients of a cubic in the fraction of its interval.
type Cubic = [Vector3<f64>; 4];

/// The lofted surface of one muscle.
#[derive(Clone, Debug)]
pub struct Loft {
    s: Vec<f64>,
    outlines: Vec<[Cubic; N_OUTLINE]>,
}

/// A point of the loft with its tangents.
#[derive(Clone, Copy, Debug)]
pub struct LoftPoint {
    /// Position \[m\].
    pub position: Vector3<f64>,
    /// ∂position/∂t \[m\].
    pub around: Vector3<f64>,
    /// ∂position/∂s \[m\].
    pub along: Vector3<f64>,
    /// ∂²position/∂t² \[m\], without continuity at the boundary points.
    pub bend: Vector3<f64>,
}

impl LoftPoint {
    /// Unit normal, outward.
    pub fn normal(&self) -> Vector3<f64> {
        self.around.cross(&self.along).normalize()
    }
}

impl Loft {
    /// The loft through sections that [`MuscleSections::check`] accepts.
    pub fn new(sections: &MuscleSections) -> Loft {
        Loft {
            s: sections.stations.iter().map(|station| station.s).collect(),
            outlines: sections.stations.iter().map(|station| outline(&station.outline)).collect(),
        }
    }

    /// Point with outline parameter `t` (periodic in 14) and fraction `s`, clamped to 0..1.
    pub fn point(&self, t: f64, s: f64) -> LoftPoint {
        let s = s.clamp(0.0, 1.0);
        let (first, weights, slopes) = self.weights(s);
        let t = t.rem_euclid(N_OUTLINE as f64);
        let (k, f) = ((t.floor() as usize).min(N_OUTLINE - 1), t - t.floor());
        let zero = Vector3::zeros();
        let mut point = LoftPoint { position: zero, around: zero, along: zero, bend: zero };
        for j in 0..4 {
            if weights[j] == 0.0 && slopes[j] == 0.0 {
                continue;
            }
            let c = &self.outlines[first + j - 1][k];
            let position = c[0] + (c[1] + (c[2] + c[3] * f) * f) * f;
            point.position += position * weights[j];
            point.along += position * slopes[j];
            point.around += (c[1] + (c[2] * 2.0 + c[3] * (3.0 * f)) * f) * weights[j];
            point.bend += (c[2] * 2.0 + c[3] * (6.0 * f)) * weights[j];
        }
        point
    }

    /// The point of the loft nearest to `x` \[m\] and its coordinates (t, s), by Newton steps from `start`; s stays within `range`.
    ///
    /// The nearest in the neighbourhood of `start`: the loft has other sides.
    pub fn project(&self, x: &Vector3<f64>, start: [f64; 2], range: [f64; 2]) -> ([f64; 2], LoftPoint) {
        let [mut t, mut s] = start;
        let mut here = self.point(t, s);
        let mut distance = (x - here.position).norm_squared();
        for _ in 0..PROJECT_ITERATIONS {
            let d = x - here.position;
            let (u, v) = (here.around, here.along);
            // Curvature around the muscle counts where thin borders are near; the step stays one downhill.
            let uu = (u.norm_squared() - d.dot(&here.bend)).max(0.2 * u.norm_squared());
            let (uv, vv) = (u.dot(&v), v.norm_squared());
            let (du, mut dv) = (d.dot(&u), d.dot(&v));
            let held = range[0] == range[1] || (s <= range[0] && dv < 0.0) || (s >= range[1] && dv > 0.0);
            let det = uu * vv - uv * uv;
            let (dt, ds) = if held || !(det > 1e-6 * uu * vv) {
                dv = 0.0;
                (du / uu, 0.0)
            } else {
                ((du * vv - dv * uv) / det, (dv * uu - du * uv) / det)
            };
            if !(dt * du + ds * dv > PROJECT_TOLERANCE) {
                break;
            }
            let mut scale = (1.0 / dt.abs().max(1e-300)).min(0.1 / ds.abs().max(1e-300)).min(1.0);
            let mut moved = false;
            for _ in 0..8 {
                let (t_new, s_new) = (t + scale * dt, (s + scale * ds).clamp(range[0], range[1]));
                let there = self.point(t_new, s_new);
                let square = (x - there.position).norm_squared();
                if square < distance {
                    (t, s, here, distance, moved) = (t_new, s_new, there, square, true);
                    break;
                }
                scale /= 4.0;
            }
            if !moved {
                break;
            }
        }
        ([t.rem_euclid(N_OUTLINE as f64), s], here)
    }

    /// For the interval that holds `s`: the number of its first station, and the weights of the outlines of stations
    /// first − 1 … first + 2 with their derivatives by s.
    fn weights(&self, s: f64) -> (usize, [f64; 4], [f64; 4]) {
        let n = self.s.len();
        let j = self.s[1..n - 1].partition_point(|&knot| knot <= s);
        let h = self.s[j + 1] - self.s[j];
        let f = (s - self.s[j]) / h;
        let (f2, f3) = (f * f, f * f * f);
        // Hermite basis: value and tangent (per h) at both ends.
        let value = [2.0 * f3 - 3.0 * f2 + 1.0, f3 - 2.0 * f2 + f, 3.0 * f2 - 2.0 * f3, f3 - f2];
        let slope = [6.0 * (f2 - f), 3.0 * f2 - 4.0 * f + 1.0, 6.0 * (f - f2), 3.0 * f2 - 2.0 * f];
        let [tangent_a, tangent_b] = [self.tangent(j), self.tangent(j + 1)];
        let combine = |basis: [f64; 4]| {
            let mut w = [0.0, basis[0], basis[2], 0.0];
            for i in 0..3 {
                w[i] += basis[1] * h * tangent_a[i];
                w[i + 1] += basis[3] * h * tangent_b[i];
            }
            w
        };
        (j, combine(value), combine(slope).map(|w| w / h))
    }

    /// Weights of stations j − 1, j, j + 1 in the tangent at station j.
    fn tangent(&self, j: usize) -> [f64; 3] {
        let n = self.s.len();
        if j == 0 {
            let h = self.s[1] - self.s[0];
            [0.0, -1.0 / h, 1.0 / h]
        } else if j == n - 1 {
            let h = self.s[n - 1] - self.s[n - 2];
            [-1.0 / h, 1.0 / h, 0.0]
        } else {
            three_point(self.s[j] - self.s[j - 1], self.s[j + 1] - self.s[j])
        }
    }
}

/// Steps of the projection at most.
const PROJECT_ITERATIONS: usize = 20;
/// The projection ends when a step promises less than this of the squared distance \[m²\].
const PROJECT_TOLERANCE: f64 = 1e-18;

/// Weights of the points before, at and after a knot in the slope of the parabola through them.
fn three_point(h0: f64, h1: f64) -> [f64; 3] {
    let (before, after) = (h1 / (h0 * (h0 + h1)), h0 / (h1 * (h0 + h1)));
    [-before, before - after, after]
}

/// The closed curve through boundary points.
fn outline(points: &[Vector3<f64>; N_OUTLINE]) -> [Cubic; N_OUTLINE] {
    let next = |k: usize| (k + 1) % N_OUTLINE;
    let previous = |k: usize| (k + N_OUTLINE - 1) % N_OUTLINE;
    let mut step = [0.0; N_OUTLINE];
    let mut tangent = [Vector3::zeros(); N_OUTLINE];
    for k in 0..N_OUTLINE {
        step[k] = (points[next(k)] - points[k]).norm().sqrt();
    }
    for k in 0..N_OUTLINE {
        let w = three_point(step[previous(k)], step[k]);
        tangent[k] = points[previous(k)] * w[0] + points[k] * w[1] + points[next(k)] * w[2];
    }
    std::array::from_fn(|k| {
        let (p, q) = (points[k], points[next(k)]);
        let (a, b) = (tangent[k] * step[k], tangent[next(k)] * step[k]);
        [p, a, (q - p) * 3.0 - a * 2.0 - b, (p - q) * 2.0 + a + b]
    })
}
