//! Distances between points, segments and triangles, with the closest points.
//!
//! Each result is the distance between two points that do lie on the two shapes (to round-off), the least over all
//! candidates; so it is never too small, and near-parallel edges cannot spoil it: their ends are candidates as well.

use nalgebra::Vector3;

use super::intersect::{Triangle, segment_meets_triangle, triangles_meet};

/// Two closest points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closest {
    /// Distance \[m\].
    pub distance: f64,
    /// The point of the first shape \[m\].
    pub on_a: Vector3<f64>,
    /// The point of the second shape \[m\].
    pub on_b: Vector3<f64>,
}

/// Part of a triangle that a closest point lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Corner 0, 1 or 2.
    Corner(u8),
    /// Edge k, from corner k to corner k + 1.
    Edge(u8),
    /// The inside.
    Face,
}

impl Closest {
    fn new(on_a: Vector3<f64>, on_b: Vector3<f64>) -> Closest {
        Closest { distance: (on_a - on_b).norm(), on_a, on_b }
    }

    fn nearer(self, other: Closest) -> Closest {
        if other.distance < self.distance { other } else { self }
    }

    /// The same, seen from the other shape.
    pub fn swapped(self) -> Closest {
        Closest { distance: self.distance, on_a: self.on_b, on_b: self.on_a }
    }
}

/// Point of the segment from `a` to `b` that is closest to `p`, as fraction of the segment.
pub fn on_segment(p: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    let ab = b - a;
    let fraction = (p - a).dot(&ab) / ab.norm_squared();
    if fraction > 0.0 { fraction.min(1.0) } else { 0.0 } // also for a segment without length (NaN)
}

/// From a point to a triangle, and the part of the triangle that is closest.
///
/// Regions of the triangle's plane as in C. Ericson, Real-Time Collision Detection, 2005, section 5.1.5.
pub fn point_triangle(p: &Vector3<f64>, t: &Triangle) -> (Closest, Part) {
    let mut best = (Closest::new(*p, t[0]), Part::Corner(0));
    for k in 0..3u8 {
        let (a, b) = (&t[k as usize], &t[(k as usize + 1) % 3]);
        let fraction = on_segment(p, a, b);
        let (x, part) = match fraction {
            0.0 => (*a, Part::Corner(k)),
            1.0 => (*b, Part::Corner((k + 1) % 3)),
            f => (a + f * (b - a), Part::Edge(k)),
        };
        let found = Closest::new(*p, x);
        if found.distance < best.0.distance {
            best = (found, part);
        }
    }
    // The foot on the plane, where it falls into the triangle.
    let (u, v) = (t[1] - t[0], t[2] - t[0]);
    let n = u.cross(&v);
    let w = p - t[0];
    let size = n.norm_squared();
    let (beta, gamma) = (w.cross(&v).dot(&n) / size, u.cross(&w).dot(&n) / size);
    if beta > 0.0 && gamma > 0.0 && beta + gamma < 1.0 {
        // Along the normal: near the plane this is more accurate than beta and gamma are.
        let found = Closest::new(*p, p - w.dot(&n) / size * n);
        if found.distance < best.0.distance {
            best = (found, Part::Face);
        }
    }
    best
}

/// Between the segments `a` and `b`.
pub fn segments(a: [&Vector3<f64>; 2], b: [&Vector3<f64>; 2]) -> Closest {
    let (u, v, w) = (a[1] - a[0], b[1] - b[0], a[0] - b[0]);
    let end = |p: &Vector3<f64>, s: [&Vector3<f64>; 2]| s[0] + on_segment(p, s[0], s[1]) * (s[1] - s[0]);
    let mut best = Closest::new(*a[0], end(a[0], b));
    best = best.nearer(Closest::new(*a[1], end(a[1], b)));
    best = best.nearer(Closest::new(end(b[0], a), *b[0]));
    best = best.nearer(Closest::new(end(b[1], a), *b[1]));
    // Both inner: the common perpendicular of the two lines.
    let n = u.cross(&v);
    let size = n.norm_squared();
    let (s, t) = (v.cross(&w).dot(&n) / size, u.cross(&w).dot(&n) / size);
    if s > 0.0 && s < 1.0 && t > 0.0 && t < 1.0 {
        best = best.nearer(Closest::new(a[0] + s * u, b[0] + t * v));
    }
    best
}

/// Between two triangles. Exactly zero if and only if they meet by the exact test.
pub fn triangles(a: &Triangle, b: &Triangle) -> Closest {
    let best = apart(a, b);
    if triangles_meet(a, b) {
        let point = common_point(a, b).unwrap_or((best.on_a + best.on_b) / 2.0);
        return Closest { distance: 0.0, on_a: point, on_b: point };
    }
    // Not meeting, but nearer than round-off can tell: still not zero.
    Closest { distance: best.distance.max(f64::MIN_POSITIVE), ..best }
}

/// Between two triangles that do not meet: the closest points are a corner and a face, or on two edges.
fn apart(a: &Triangle, b: &Triangle) -> Closest {
    let mut best = point_triangle(&a[0], b).0;
    for p in &a[1..] {
        best = best.nearer(point_triangle(p, b).0);
    }
    for p in b {
        best = best.nearer(point_triangle(p, a).0.swapped());
    }
    for i in 0..3 {
        for j in 0..3 {
            best = best.nearer(segments([&a[i], &a[(i + 1) % 3]], [&b[j], &b[(j + 1) % 3]]));
        }
    }
    best
}

/// A point where an edge of one triangle passes through the other.
fn common_point(a: &Triangle, b: &Triangle) -> Option<Vector3<f64>> {
    let through = |edges: &Triangle, face: &Triangle| {
        (0..3).find_map(|k| {
            let (p, q) = (edges[k], edges[(k + 1) % 3]);
            let n = (face[1] - face[0]).cross(&(face[2] - face[0]));
            let fraction = n.dot(&(face[0] - p)) / n.dot(&(q - p));
            (segment_meets_triangle(&p, &q, face) && (0.0..=1.0).contains(&fraction))
                .then(|| p + fraction * (q - p))
        })
    };
    through(a, b).or_else(|| through(b, a))
}
