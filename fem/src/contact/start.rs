//! Is the start free of overlaps; where not, how deep.

use super::Contact;
use crate::geometry::tree::Aabb;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Two surfaces that overlap or touch at the start.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlap {
    /// The surfaces.
    pub names: [String; 2],
    /// Greatest depth \[m\] of a point of one inside the other; 0 where there is none.
    pub depth: f64,
    /// Least signed distance \[m\] of a point of one from the other, negative inside; infinite where only edges cross.
    pub gap: f64,
    /// Where that is \[m\].
    pub place: [f64; 3],
    /// Number of collision points concerned, of both.
    pub n_points: usize,
    /// Number of edges of one that pass through faces of the other.
    pub n_crossings: usize,
}

impl std::fmt::Display for Overlap {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Overlap { names: [a, b], depth, gap, place: [x, y, z], n_points, n_crossings } = self;
        write!(f, "`{a}` and `{b}` ")?;
        match self.is_overlap() {
            true if *depth > 0.0 => {
                write!(f, "by {:.3} mm ({n_points} points, deepest at {x:.4}, {y:.4}, {z:.4} m)", depth * 1e3)
            }
            true => write!(
                f,
                "by {n_crossings} edges that pass through faces, one from {x:.4}, {y:.4}, {z:.4} m on"
            ),
            false => write!(
                f,
                "{:.3} mm apart ({n_points} points, nearest at {x:.4}, {y:.4}, {z:.4} m)",
                gap * 1e3
            ),
        }
    }
}

impl Overlap {
    /// Whether they overlap, and are not only close.
    pub fn is_overlap(&self) -> bool {
        self.depth > 0.0 || self.n_crossings > 0
    }
}

impl Contact {
    /// Pairs of surfaces that overlap, or are closer than `least` \[m\], with the nodes at `x`.
    pub fn overlaps(&self, x: &[f64], least: f64) -> Vec<Overlap> {
        let p = self.surfaces.positions(x);
        let mut pairs = BTreeMap::<[usize; 2], Overlap>::new();
        for near in self.near(&p, least) {
            let all = &self.surfaces;
            let (a, b) = (all.surface(near.point), all.surface(all.triangles[near.triangle as usize][0]));
            let names = [a.min(b), a.max(b)].map(|s| all.list[s].name.clone());
            let place = p[near.point as usize].into();
            let new = Overlap { names, depth: 0.0, gap: f64::INFINITY, place, n_points: 0, n_crossings: 0 };
            let overlap = pairs.entry([a.min(b), a.max(b)]).or_insert(new);
            overlap.n_points += 1;
            if near.gap < overlap.gap {
                (overlap.gap, overlap.place) = (near.gap, place);
                overlap.depth = (-near.gap).max(0.0);
            }
        }
        for [e, t] in self.crossings(&p) {
            let all = &self.surfaces;
            let end = all.edges[e as usize].points[0];
            let (a, b) = (all.surface(end), all.surface(all.triangles[t as usize][0]));
            let names = [a.min(b), a.max(b)].map(|s| all.list[s].name.clone());
            let place = p[end as usize].into();
            let new = Overlap { names, depth: 0.0, gap: f64::INFINITY, place, n_points: 0, n_crossings: 0 };
            let overlap = pairs.entry([a.min(b), a.max(b)]).or_insert(new);
            overlap.n_points += 1;
            overlap.n_crossings += 1;
        }
        pairs.into_values().collect()
    }

    /// Edges that pass through triangles of surfaces that they may meet.
    pub(super) fn crossings(&self, p: &[Vector3<f64>]) -> Vec<[u32; 2]> {
        let all = &self.surfaces;
        let fitted = self.fitted(p);
        let find = |e: usize| -> Vec<[u32; 2]> {
            let ends = &all.edges[e].points;
            let [a, b] = ends.map(|i| p[i as usize]);
            let (query, mut found) = (Aabb::of(ends, p), Vec::new());
            for &other in &self.partners.of[all.surface(ends[0])] {
                let s = &all.list[other];
                fitted[other].overlapping(&query, |t| {
                    let t = s.triangles.start + t as usize;
                    let corners = &all.triangles[t];
                    if crosses(&a, &b, &corners.map(|c| p[c as usize]))
                        && self.partners.counts(all, ends, corners)
                    {
                        found.push([e as u32, t as u32]);
                    }
                });
            }
            found
        };
        let found: Vec<Vec<_>> = (0..all.edges.len()).into_par_iter().with_min_len(64).map(find).collect();
        found.into_iter().flatten().collect()
    }

    /// (node, surface) of points closer than `gap` \[m\] to a surface, with the nodes at `x`, where one of their nodes or of those of the
    /// nearest triangle is `wanted`.
    pub fn close_pairs(&self, x: &[f64], gap: f64, wanted: &dyn Fn(u32) -> bool) -> Vec<(u32, usize)> {
        let near = self.near(&self.surfaces.positions(x), gap);
        let nodes = near.iter().map(|n| self.nodes_of_pair(&[n.point], n.triangle));
        nodes.filter(|nodes| nodes.iter().any(|(n, _)| wanted(*n))).flatten().collect()
    }

    /// The nodes of a point or edge with the surface of a triangle, and those of the triangle with the surface of the point.
    pub(super) fn nodes_of_pair(&self, points: &[u32], triangle: u32) -> Vec<(u32, usize)> {
        let all = &self.surfaces;
        let corners = all.triangles[triangle as usize];
        let (mine, theirs) = (all.surface(points[0]), all.surface(corners[0]));
        let nodes = |points: &[u32], other: usize| -> Vec<(u32, usize)> {
            let parts = points.iter().flat_map(|&p| all.points[p as usize].weighted_nodes());
            parts.map(|(node, _)| (node, other)).collect()
        };
        [nodes(points, theirs), nodes(&corners, mine)].concat()
    }

    /// Least distance \[m\] of any pair within reach; the activation distance where there is none.
    pub fn least_distance(&self, x: &[f64]) -> f64 {
        self.terms(x, 0.0).stencils.iter().map(|s| s.distance()).fold(self.largest_reach, f64::min)
    }
}

/// Whether a segment passes through a triangle, by the signs of the volumes of the tetrahedra that they span.
fn crosses(a: &Vector3<f64>, b: &Vector3<f64>, [p, q, r]: &[Vector3<f64>; 3]) -> bool {
    let volume = |a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>, d: &Vector3<f64>| {
        (b - a).cross(&(c - a)).dot(&(d - a))
    };
    if volume(p, q, r, a) * volume(p, q, r, b) >= 0.0 {
        return false;
    }
    let sides = [volume(a, b, p, q), volume(a, b, q, r), volume(a, b, r, p)];
    sides.iter().all(|v| *v > 0.0) || sides.iter().all(|v| *v < 0.0)
}
