//! Which pairs can be close: everything else is skipped by boxes.
//!
//! The list is made for boxes in which the collision points stay, and serves every state whose points lie in them: a
//! whole Newton step with its line search, and later iterations that move little.

use super::surface::Surfaces;
use crate::geometry::tree::{Aabb, Tree};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Number of the first free body among what nodes move with.
pub const FREE: u32 = 1 << 30;

/// Whether a number of what nodes move with is that of a free body.
pub fn is_free_body(carrier: u32) -> bool {
    (FREE..2 * FREE).contains(&carrier)
}

/// What takes part in contact with what.
#[derive(Clone, Debug, Default)]
pub struct Partners {
    /// Surfaces that each surface may meet, ascending.
    pub of: Vec<Vec<usize>>,
    /// Surfaces that a collision point takes no notice of, one bit each.
    pub muted: Vec<u64>,
    /// What collision points move with all of whose nodes are prescribed or ride on one free body; `None`: free.
    pub carrier: Vec<Option<u32>>,
    /// What a surface moves with as a whole; `None`: it deforms.
    pub rigid: Vec<Option<u32>>,
}

impl Partners {
    /// Whether a pair of primitives counts: something of it can move, no point of one is tied to what the other's surface moves with, its
    /// surfaces take notice of each other there, and its points are no neighbours ([`Surfaces::related`]).
    pub fn counts(&self, all: &Surfaces, a: &[u32], b: &[u32]) -> bool {
        let carrier = |p: u32| self.carrier[p as usize];
        if a.iter().chain(b).all(|&p| carrier(p).is_some_and(|c| !is_free_body(c))) {
            return false;
        }
        let (of_a, of_b) = (all.surface(a[0]), all.surface(b[0]));
        let tied = |points: &[u32], other: usize| {
            self.rigid[other].is_some() && points.iter().any(|&p| carrier(p) == self.rigid[other])
        };
        if tied(a, of_b) || tied(b, of_a) {
            return false;
        }
        let mutes =
            |points: &[u32], other: usize| points.iter().any(|&p| self.muted[p as usize] >> other & 1 == 1);
        if mutes(a, of_b) || mutes(b, of_a) {
            return false;
        }
        !a.iter().any(|&p| b.iter().any(|&q| all.related(p, q)))
    }
}

/// Which primitives count; each includes those before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Primitives {
    /// Corners of triangles, against triangles.
    #[default]
    Corners,
    /// All samples, against triangles.
    Samples,
    /// Edges against each other, too.
    Edges,
}

/// Pairs that can be closer than the activation distance.
#[derive(Clone, Debug, Default)]
pub struct Candidates {
    /// Of what.
    primitives: Primitives,
    /// Where the list is good for each collision point to be.
    boxes: Vec<Aabb>,
    /// (collision point, triangle), ascending.
    pub point_triangle: Vec<[u32; 2]>,
    /// (edge, edge), ascending.
    pub edge_edge: Vec<[u32; 2]>,
}

impl Candidates {
    /// Whether the list serves `primitives` with points at `p`.
    pub fn covers(&self, primitives: Primitives, p: &[Vector3<f64>]) -> bool {
        self.primitives >= primitives
            && self.boxes.len() == p.len()
            && self.boxes.iter().zip(p).all(|(b, p)| b.contains(p))
    }

    /// The list of `primitives` for all states between `from` and `to` and up to `slack` \[m\] beside; `reach`: largest activation
    /// distance \[m\].
    pub fn new(
        all: &Surfaces,
        partners: &Partners,
        primitives: Primitives,
        from: &[Vector3<f64>],
        to: &[Vector3<f64>],
        slack: f64,
        reach: f64,
    ) -> Candidates {
        let boxes: Vec<Aabb> = from.iter().zip(to).map(|(a, b)| Aabb::of_way(a, b, slack)).collect();
        let of = |points: &[u32]| points.iter().fold(Aabb::empty(), |sum, &p| sum.join(&boxes[p as usize]));
        let fitted: Vec<(Tree, Tree)> = all
            .list
            .par_iter()
            .map(|s| {
                let triangle = |t: u32| of(&all.triangles[s.triangles.start + t as usize]);
                let edge = |e: u32| of(&all.edges[s.edges.start + e as usize].points);
                (s.triangle_tree.fit(triangle), s.edge_tree.fit(edge))
            })
            .collect();
        let point_triangle = collect(boxes.len(), |p, found| {
            if primitives == Primitives::Corners && !all.is_corner(p) {
                return;
            }
            let query = boxes[p as usize].grown(reach);
            for &other in &partners.of[all.surface(p)] {
                let s = &all.list[other];
                fitted[other].0.overlapping(&query, |t| {
                    let t = (s.triangles.start + t as usize) as u32;
                    let corners = &all.triangles[t as usize];
                    if partners.counts(all, &[p], corners) {
                        found.push([p, t]);
                    }
                });
            }
        });
        let n_edges = if primitives == Primitives::Edges { all.edges.len() } else { 0 };
        let edge_edge = collect(n_edges, |e, found| {
            let ends = &all.edges[e as usize].points;
            let query = of(ends).grown(reach);
            let mine = all.surface(ends[0]);
            for &other in partners.of[mine].iter().filter(|&&other| other >= mine) {
                let s = &all.list[other];
                fitted[other].1.overlapping(&query, |f| {
                    let f = (s.edges.start + f as usize) as u32;
                    let others = &all.edges[f as usize].points;
                    if f > e && partners.counts(all, ends, others) {
                        found.push([e, f]);
                    }
                });
            }
        });
        Candidates { primitives, boxes, point_triangle, edge_edge }
    }
}

/// Pairs found for each of `n` primitives, in their order.
fn collect(n: usize, find: impl Fn(u32, &mut Vec<[u32; 2]>) + Sync) -> Vec<[u32; 2]> {
    const PIECE: usize = 256;
    let pieces: Vec<Vec<[u32; 2]>> = (0..n.div_ceil(PIECE))
        .into_par_iter()
        .map(|piece| {
            let mut found = Vec::new();
            for i in piece * PIECE..n.min((piece + 1) * PIECE) {
                find(i as u32, &mut found);
            }
            found.sort_unstable();
            found
        })
        .collect();
    pieces.concat()
}
