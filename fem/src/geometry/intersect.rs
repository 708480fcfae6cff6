//! Do two triangles meet? Exactly, whatever their position.
//!
//! Every decision is the sign of a determinant of coordinates, and these signs are exact (adaptive-precision predicates of
//! J. R. Shewchuk, Discrete Comput Geom 1997;18:305, as in the crate `robust`) as long as no product of three coordinate
//! differences leaves the range of a double, that is between 1e-100 m and 1e100 m. Triangles are closed: touching is
//! meeting. Triangles without area count as the segment or point that they are.

use nalgebra::Vector3;
use robust::{Coord, Coord3D, orient2d, orient3d};

/// The corners of a triangle \[m\].
pub type Triangle = [Vector3<f64>; 3];

/// The two triangles have a point in common.
///
/// If they meet, an edge of one meets the other: a common segment ends on an edge, and of two triangles in one plane
/// either two edges cross or one triangle holds the other's edges.
pub fn triangles_meet(a: &Triangle, b: &Triangle) -> bool {
    // Most pairs lie on one side of each other's plane.
    let aside = |s: [f64; 3]| s.iter().all(|&s| s > 0.0) || s.iter().all(|&s| s < 0.0);
    if aside(a.map(|p| side(b, &p))) || aside(b.map(|p| side(a, &p))) {
        return false;
    }
    (0..3).any(|k| segment_meets_triangle(&a[k], &a[(k + 1) % 3], b))
        || (0..3).any(|k| segment_meets_triangle(&b[k], &b[(k + 1) % 3], a))
}

/// Two triangles of one surface that share points meet elsewhere as well.
///
/// `shared`: pairs (corner of `a`, corner of `b`) that are one point of the surface. Needs triangles with area.
pub fn neighbours_meet(a: &Triangle, b: &Triangle, shared: &[(usize, usize)]) -> bool {
    match *shared {
        [] => triangles_meet(a, b),
        // A second common point spans, with the first, a segment that ends on one of the opposite edges.
        [(i, j)] => {
            segment_meets_triangle(&a[(i + 1) % 3], &a[(i + 2) % 3], b)
                || segment_meets_triangle(&b[(j + 1) % 3], &b[(j + 2) % 3], a)
        }
        // Only a fold to the same side of the common edge, in one plane.
        [(i, j), (k, l)] => {
            let (p, q, u, v) = (&a[i], &a[k], &a[3 - i - k], &b[3 - j - l]);
            side(a, v) == 0.0
                && (0..3).any(|drop| {
                    let [p, q, u, v] = [p, q, u, v].map(|x| flat(x, drop));
                    orient2d(p, q, u) * orient2d(p, q, v) > 0.0
                })
        }
        _ => true,
    }
}

/// The segment from `p` to `q` and the triangle have a point in common.
pub fn segment_meets_triangle(p: &Vector3<f64>, q: &Vector3<f64>, t: &Triangle) -> bool {
    let (at_p, at_q) = (side(t, p), side(t, q));
    if (at_p > 0.0 && at_q > 0.0) || (at_p < 0.0 && at_q < 0.0) {
        return false;
    }
    if at_p == 0.0 && at_q == 0.0 {
        // In the plane of the triangle, or the triangle is a segment or point. Sets in one plane meet if they do so in all
        // three projections along the axes, as at least one of these is one-to-one.
        return (0..3).any(|k| segments_meet([p, q], [&t[k], &t[(k + 1) % 3]])) || holds(t, p);
    }
    // The ends are on different sides, or one is on the plane: does the line pass all edges on the same side?
    let turns = [0, 1, 2].map(|k| orient3d(solid(p), solid(q), solid(&t[k]), solid(&t[(k + 1) % 3])));
    turns.iter().all(|&s| s >= 0.0) || turns.iter().all(|&s| s <= 0.0)
}

/// Which side of the plane of the triangle: the sign is exact, zero in the plane.
fn side(t: &Triangle, p: &Vector3<f64>) -> f64 {
    orient3d(solid(&t[0]), solid(&t[1]), solid(&t[2]), solid(p))
}

/// Two segments in space have a point in common.
fn segments_meet([p, q]: [&Vector3<f64>; 2], [a, b]: [&Vector3<f64>; 2]) -> bool {
    orient3d(solid(p), solid(q), solid(a), solid(b)) == 0.0
        && (0..3).all(|drop| flat_segments_meet([p, q].map(|x| flat(x, drop)), [a, b].map(|x| flat(x, drop))))
}

/// Two segments in the plane have a point in common; a segment may be a point.
fn flat_segments_meet([p, q]: [Coord<f64>; 2], [a, b]: [Coord<f64>; 2]) -> bool {
    let [p_side, q_side] = [orient2d(a, b, p), orient2d(a, b, q)];
    let [a_side, b_side] = [orient2d(p, q, a), orient2d(p, q, b)];
    let apart = |s: f64, t: f64| (s > 0.0 && t < 0.0) || (s < 0.0 && t > 0.0);
    (apart(p_side, q_side) && apart(a_side, b_side))
        || (p_side == 0.0 && in_box(p, a, b))
        || (q_side == 0.0 && in_box(q, a, b))
        || (a_side == 0.0 && in_box(a, p, q))
        || (b_side == 0.0 && in_box(b, p, q))
}

fn in_box(x: Coord<f64>, a: Coord<f64>, b: Coord<f64>) -> bool {
    (a.x.min(b.x)..=a.x.max(b.x)).contains(&x.x) && (a.y.min(b.y)..=a.y.max(b.y)).contains(&x.y)
}

/// A triangle with area holds the point `p` of its plane.
fn holds(t: &Triangle, p: &Vector3<f64>) -> bool {
    // One projection in which the triangle keeps its area is enough: it is one-to-one on the plane.
    for drop in 0..3 {
        let [a, b, c, x] = [&t[0], &t[1], &t[2], p].map(|x| flat(x, drop));
        if orient2d(a, b, c) != 0.0 {
            let turns = [orient2d(a, b, x), orient2d(b, c, x), orient2d(c, a, x)];
            return turns.iter().all(|&s| s >= 0.0) || turns.iter().all(|&s| s <= 0.0);
        }
    }
    false
}

/// The corners are exactly in line.
pub fn is_degenerate(t: &Triangle) -> bool {
    (0..3).all(|drop| {
        let [a, b, c] = [&t[0], &t[1], &t[2]].map(|x| flat(x, drop));
        orient2d(a, b, c) == 0.0
    })
}

fn solid(p: &Vector3<f64>) -> Coord3D<f64> {
    Coord3D { x: p.x, y: p.y, z: p.z }
}

/// The point without its coordinate `drop`.
pub(super) fn flat(p: &Vector3<f64>, drop: usize) -> Coord<f64> {
    Coord { x: p[(drop + 1) % 3], y: p[(drop + 2) % 3] }
}
