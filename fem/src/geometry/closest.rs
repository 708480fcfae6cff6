//! Closest points of two simplices: a point and a triangle, or two edges.
//!
//! Both are the minimum of |w(ξ)| over parameters ξ, where w = Σ cᵢ(ξ) xᵢ joins a point of one simplex to a point of the other
//! and every cᵢ is affine in ξ. Which parameters are free at the minimum names the features that are closest (vertex,
//! edge, face). Ericson, Real-Time Collision Detection (2005), §5.1.

use nalgebra::Vector3;

/// Four points of a pair: (p, a, b, c) of a point and a triangle, (a, b, c, d) of the edges ab and cd.
pub type Points = [Vector3<f64>; 4];

/// The shortest connection w = Σ cᵢ xᵢ of a pair and how it may vary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closest {
    /// cᵢ at the minimum.
    pub c: [f64; 4],
    /// ∂cᵢ/∂ξₖ of the free parameters, `n_free` of them.
    pub dc: [[f64; 4]; 2],
    /// Number of free parameters: 0 two vertices, 1 vertex and edge, 2 vertex and face or two edges.
    pub n_free: usize,
    /// w \[m\].
    pub w: Vector3<f64>,
}

impl Closest {
    fn new(c: [f64; 4], dc: &[[f64; 4]], x: &Points) -> Closest {
        let mut free = [[0.0; 4]; 2];
        free[..dc.len()].copy_from_slice(dc);
        Closest { c, dc: free, n_free: dc.len(), w: combine(&c, x) }
    }

    /// Squared distance \[m²\].
    pub fn squared(&self) -> f64 {
        self.w.norm_squared()
    }
}

/// Σ cᵢ xᵢ.
pub fn combine(c: &[f64; 4], x: &Points) -> Vector3<f64> {
    // Differences first: the cᵢ sum to zero and the xᵢ may be far from the origin.
    (x[1] - x[0]) * c[1] + (x[2] - x[0]) * c[2] + (x[3] - x[0]) * c[3]
}

/// The part of a triangle that is closest to a point; counts its corners and the edges (0 1), (1 2), (2 0).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feature {
    /// The inside.
    Face,
    /// An edge without its ends.
    Edge(u8),
    /// A corner.
    Vertex(u8),
}

/// Corners of the edges of a triangle.
pub const EDGES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

/// Squared sine of the angle at a corner below which a triangle is an edge: its inside is then lost in the round-off of the products that
/// tell where in it a point lies.
const SLIVER: f64 = 1e-12;

/// The closest part of a triangle without inside.
fn nearest_edge(x: &Points) -> (Feature, [f64; 3]) {
    let on = |e: usize| {
        let [i, j] = EDGES[e];
        let t = along_edge(&x[0], &x[i + 1], &x[j + 1]);
        let (mut at, feature) = (
            [0.0; 3],
            match t {
                0.0 => Feature::Vertex(i as u8),
                1.0 => Feature::Vertex(j as u8),
                _ => Feature::Edge(e as u8),
            },
        );
        (at[i], at[j]) = (1.0 - t, t);
        let c = [1.0, -at[0], -at[1], -at[2]];
        (combine(&c, x).norm_squared(), (feature, at))
    };
    let all = [on(0), on(1), on(2)];
    all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).expect("three edges").1
}

/// The part of triangle (x₁, x₂, x₃) closest to x₀, and where: the weights of the three corners.
pub fn feature(x: &Points) -> (Feature, [f64; 3]) {
    let [p, a, b, c] = *x;
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return (Feature::Vertex(0), [1.0, 0.0, 0.0]);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return (Feature::Vertex(1), [0.0, 1.0, 0.0]);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return (Feature::Edge(0), [1.0 - t, t, 0.0]);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return (Feature::Vertex(2), [0.0, 0.0, 1.0]);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return (Feature::Edge(2), [1.0 - t, 0.0, t]);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return (Feature::Edge(1), [0.0, 1.0 - t, t]);
    }
    let sum = va + vb + vc;
    if !(sum > SLIVER * ab.norm_squared() * ac.norm_squared()) {
        return nearest_edge(x);
    }
    let (v, w) = (vb / sum, vc / sum);
    (Feature::Face, [1.0 - v - w, v, w])
}

/// Point x₀ and triangle (x₁, x₂, x₃).
pub fn point_triangle(x: &Points) -> Closest {
    let (feature, at) = feature(x);
    let c = [1.0, -at[0], -at[1], -at[2]];
    match feature {
        Feature::Vertex(_) => Closest::new(c, &[], x),
        Feature::Edge(e) => {
            let [i, j] = EDGES[e as usize];
            let mut dc = [0.0; 4];
            (dc[i + 1], dc[j + 1]) = (1.0, -1.0);
            Closest::new(c, &[dc], x)
        }
        Feature::Face => Closest::new(c, &[[0.0, 1.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]], x),
    }
}

/// Point x₀ and edge (x₁, x₂); x₃ has no part in it.
pub fn point_edge(x: &Points) -> Closest {
    let t = along_edge(&x[0], &x[1], &x[2]);
    let free: &[[f64; 4]] = if t > 0.0 && t < 1.0 { &[[0.0, 1.0, -1.0, 0.0]] } else { &[] };
    Closest::new([1.0, t - 1.0, -t, 0.0], free, x)
}

/// Points x₀ and x₁; the others have no part in it.
pub fn point_point(x: &Points) -> Closest {
    Closest::new([1.0, -1.0, 0.0, 0.0], &[], x)
}

/// Fraction along the edge ab at which it is closest to p, 0..=1.
pub fn along_edge(p: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    let e = b - a;
    let t = (p - a).dot(&e) / e.norm_squared();
    if t > 0.0 { t.min(1.0) } else { 0.0 }
}

/// Fractions along the edges (x₀, x₁) and (x₂, x₃) at which they may be closest: at their common perpendicular, where it meets both between
/// their ends, and from each of the four ends x₀ … x₃. Of parallel edges a closest pair always has an end.
pub fn edge_fractions(x: &Points) -> (Option<[f64; 2]>, [[f64; 2]; 4]) {
    let (u, v, r) = (x[1] - x[0], x[3] - x[2], x[0] - x[2]);
    // By cross products: of edges that are nearly parallel less is lost than by products of lengths.
    let n = u.cross(&v);
    let sine = n.norm_squared();
    let (s, t) = (v.cross(&r).dot(&n) / sine, u.cross(&r).dot(&n) / sine);
    let between = |fraction: f64| fraction > 0.0 && fraction < 1.0;
    let is_crossing = sine > PARALLEL * u.norm_squared() * v.norm_squared() && between(s) && between(t);
    let on_b = |end: usize| along_edge(&x[end], &x[2], &x[3]);
    let on_a = |end: usize| along_edge(&x[end], &x[0], &x[1]);
    let ends = [[0.0, on_b(0)], [1.0, on_b(1)], [on_a(2), 0.0], [on_a(3), 1.0]];
    (is_crossing.then_some([s, t]), ends)
}

/// Squared sine below which edges are parallel: the fractions at the perpendicular are then off by more than a percent of the edges.
const PARALLEL: f64 = 1e-14;

/// Edges (x₀, x₁) and (x₂, x₃).
pub fn edge_edge(x: &Points) -> Closest {
    let (crossing, ends) = edge_fractions(x);
    let mut best = crossing.map(|[s, t]| {
        let free = [[-1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]];
        Closest::new([1.0 - s, s, t - 1.0, -t], &free, x)
    });
    for (end, fractions) in ends.into_iter().enumerate() {
        let (i, j) = if end < 2 { (2, 3) } else { (0, 1) };
        let (sign, t) = if end < 2 { (1.0, fractions[1]) } else { (-1.0, fractions[0]) };
        let (mut c, mut dc) = ([0.0; 4], [0.0; 4]);
        (c[end], c[i], c[j]) = (sign, sign * (t - 1.0), -sign * t);
        (dc[i], dc[j]) = (sign, -sign);
        let free: &[[f64; 4]] = if t > 0.0 && t < 1.0 { &[dc] } else { &[] };
        let candidate = Closest::new(c, free, x);
        if best.is_none_or(|b| candidate.squared() < b.squared()) {
            best = Some(candidate);
        }
    }
    best.expect("four candidates at least")
}
