//! Questions about whole surfaces: who comes how close to whom, and what meets.
//!
//! Triangles are cut into chunks of constant size and results put in the order of their numbers, so that answers are
//! the same bits on any number of threads.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::Surface;
use super::closest::Feature;
use super::distance::{self, Closest};
use super::intersect::{neighbours_meet, triangles_meet};
use super::tree::{Aabb, Tree};

/// Triangles handled one after the other by one thread.
const CHUNK: usize = 128;

/// A surface with a tree of boxes, to be searched.
#[derive(Clone, Debug)]
pub struct SearchSurface {
    surface: Surface,
    pub(super) tree: Tree,
}

/// Two triangles and their closest points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// Triangle of the first surface.
    pub a: u32,
    /// Triangle of the second surface.
    pub b: u32,
    /// Distance, zero where the triangles meet, and the closest points.
    pub closest: Closest,
}

impl SearchSurface {
    /// Builds the tree. Triangles must name points there are ([`Surface::check`]).
    pub fn new(surface: Surface) -> SearchSurface {
        let boxes: Vec<Aabb> = (0..surface.triangles.len()).map(|t| box_of(&surface, t)).collect();
        let tree = Tree::new(&boxes);
        SearchSurface { surface, tree }
    }

    /// The surface.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// Moves the points \[m\]; their number and the triangles stay.
    ///
    /// # Panics
    /// If the number of points differs.
    pub fn set_points(&mut self, points: &[[f64; 3]]) {
        self.surface.points.copy_from_slice(points);
        self.tree = self.tree.fit(|t| box_of(&self.surface, t as usize));
    }

    /// All pairs of triangles of this and another surface at most `d` \[m\] apart, by their numbers.
    pub fn pairs_within(&self, other: &SearchSurface, d: f64) -> Vec<Gap> {
        self.collect(|a, found| {
            let corners = self.surface.corners(a);
            other.tree.overlapping(&Aabb::around(corners.iter()).grown(d), |b| {
                let closest = distance::triangles(&corners, &other.surface.corners(b as usize));
                if closest.distance <= d {
                    found.push(Gap { a: a as u32, b, closest });
                }
            });
        })
    }

    /// The closest pair of triangles; of several at the same distance the first by their numbers on this surface.
    /// `None` if a surface has no triangles. Distance zero means that the surfaces meet.
    pub fn least_gap(&self, other: &SearchSurface) -> Option<Gap> {
        let nearest = |a: usize, limit: f64| {
            let corners = self.surface.corners(a);
            let gap = |b: u32| distance::triangles(&corners, &other.surface.corners(b as usize));
            let near = Aabb::around(corners.iter());
            let (b, distance) = other.tree.least(&near, f64::sqrt, limit, None, |b| gap(b).distance)?;
            (distance < limit).then(|| Gap { a: a as u32, b, closest: gap(b) })
        };
        // A few triangles first, for a distance that spares most of the work.
        let n = self.surface.triangles.len();
        let distance = |g: &Option<Gap>| g.map_or(f64::INFINITY, |g| g.closest.distance);
        let sample: Vec<Option<Gap>> =
            (0..n).into_par_iter().step_by(n / 64 + 1).map(|a| nearest(a, f64::INFINITY)).collect();
        let start = sample.iter().map(distance).fold(f64::INFINITY, f64::min).next_up();
        let chunks: Vec<Option<Gap>> = (0..n.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut best: Option<Gap> = None;
                for a in chunk * CHUNK..n.min((chunk + 1) * CHUNK) {
                    best = nearest(a, distance(&best).min(start)).or(best);
                }
                best
            })
            .collect();
        let first = |best: Option<Gap>, found| if distance(&found) < distance(&best) { found } else { best };
        chunks.into_iter().fold(None, first)
    }

    /// Pairs of triangles of this and another surface that have a point in common (exact), by their numbers.
    pub fn intersections(&self, other: &SearchSurface) -> Vec<(u32, u32)> {
        self.collect(|a, found| {
            let corners = self.surface.corners(a);
            other.tree.overlapping(&Aabb::around(corners.iter()), |b| {
                if triangles_meet(&corners, &other.surface.corners(b as usize)) {
                    found.push((a as u32, b));
                }
            });
        })
    }

    /// Pairs of triangles of this surface that meet elsewhere than in the points they share (exact), the smaller number
    /// first. Triangles must have area.
    pub fn self_intersections(&self) -> Vec<(u32, u32)> {
        self.collect(|a, found| {
            let corners = self.surface.corners(a);
            let points = self.surface.triangles[a];
            self.tree.overlapping(&Aabb::around(corners.iter()), |b| {
                if b as usize > a {
                    let others = self.surface.triangles[b as usize];
                    let shared: Vec<(usize, usize)> =
                        (0..9).map(|i| (i / 3, i % 3)).filter(|&(i, j)| points[i] == others[j]).collect();
                    if neighbours_meet(&corners, &self.surface.corners(b as usize), &shared) {
                        found.push((a as u32, b));
                    }
                }
            });
        })
    }

    /// The closest point, its triangle and the part of the triangle it lies on; of several triangles the first. `None` without triangles.
    pub fn nearest(&self, point: &Vector3<f64>) -> Option<(Closest, u32, Feature)> {
        let found = |t: u32| distance::point_triangle(point, &self.surface.corners(t as usize));
        let distance = |t: u32| found(t).0.distance;
        let (t, _) = self.tree.least(&Aabb::at(point), f64::sqrt, f64::INFINITY, None, distance)?;
        let (closest, part) = found(t);
        Some((closest, t, part))
    }

    /// Runs `each` on every triangle number, in chunks, and puts the findings together in order.
    fn collect<T: Pair>(&self, each: impl Fn(usize, &mut Vec<T>) + Sync) -> Vec<T> {
        let n = self.surface.triangles.len();
        let chunks: Vec<Vec<T>> = (0..n.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut found = Vec::new();
                for a in chunk * CHUNK..n.min((chunk + 1) * CHUNK) {
                    each(a, &mut found);
                }
                found.sort_unstable_by_key(Pair::numbers);
                found
            })
            .collect();
        chunks.into_iter().flatten().collect()
    }
}

fn box_of(surface: &Surface, triangle: usize) -> Aabb {
    Aabb::around(surface.corners(triangle).iter())
}

/// What is found for two triangles.
trait Pair: Send {
    /// Their numbers.
    fn numbers(&self) -> (u32, u32);
}

impl Pair for (u32, u32) {
    fn numbers(&self) -> (u32, u32) {
        *self
    }
}

impl Pair for Gap {
    fn numbers(&self) -> (u32, u32) {
        (self.a, self.b)
    }
}
