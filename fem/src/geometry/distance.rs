//! Distances between points, segments and triangles, with the closest points.
//!
//! Each result is the distance between two points that do lie on the two shapes (to round-off), so it is never too small by more; and
//! near-parallel edges cannot spoil it: their ends are candidates as well.

use nalgebra::Vector3;

use super::closest::{EDGES, Feature, along_edge, edge_fractions, feature};
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

/// From a point to a triangle, and the part of the triangle that is closest.
pub fn point_triangle(p: &Vector3<f64>, t: &Triangle) -> (Closest, Feature) {
    let (feature, _) = feature(&[*p, t[0], t[1], t[2]]);
    let on_triangle = match feature {
        Feature::Vertex(k) => t[k as usize],
        Feature::Edge(k) => {
            let [a, b] = EDGES[k as usize].map(|corner| t[corner]);
            a + along_edge(p, &a, &b) * (b - a)
        }
        // Along the normal: near the plane this is more accurate than weights of the corners are.
        Feature::Face => {
            let n = (t[1] - t[0]).cross(&(t[2] - t[0]));
            p - (p - t[0]).dot(&n) / n.norm_squared() * n
        }
    };
    (Closest::new(*p, on_triangle), feature)
}

/// Between the segments `a` and `b`.
pub fn segments(a: [&Vector3<f64>; 2], b: [&Vector3<f64>; 2]) -> Closest {
    let (crossing, ends) = edge_fractions(&[*a[0], *a[1], *b[0], *b[1]]);
    let at = |[p, q]: [&Vector3<f64>; 2], fraction: f64| p + fraction * (q - p);
    let best = Closest::new(*a[0], at(b, ends[0][1]))
        .nearer(Closest::new(*a[1], at(b, ends[1][1])))
        .nearer(Closest::new(at(a, ends[2][0]), *b[0]))
        .nearer(Closest::new(at(a, ends[3][0]), *b[1]));
    crossing.map_or(best, |[s, t]| best.nearer(Closest::new(at(a, s), at(b, t))))
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
