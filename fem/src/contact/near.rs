//! Which collision points are near a surface or inside it.
//!
//! What was found is remembered: a signed distance changes by no more than the point and the surface have moved since, so most of
//! what was far need not be looked at again, and the triangle that was nearest is the first to be tried. Likewise it is no less
//! than at the nearest corner, less the way from there, so corners come first and spare most of the other samples. None of it
//! changes the answer.
//!
//! A point inside a closed body leaves it by the side that is nearest, unless that faces the way the point itself does: then the point has
//! got past the middle of a thin body, and it goes back out by a side that faces it, if that is not much farther. Out by the other its own
//! body would follow. So a side that faces the way the point does counts as farther by the depth of that body, or near the surface as some
//! times as far, and the point as so much deeper where that is the nearest even so: the depth is the least of these distances, nothing on
//! the surface and continuous. Who faces whom is looked at where Newton's method has arrived, and held while it tries steps: along a step
//! there is one energy.
//!
//! At a folded face outside and inside change places. But a signed distance changes by no more than what has moved since a softened way
//! began, where nothing overlapped unless it began at the guess of a coarser mesh: where it seems to have changed by more, the point is
//! outside. There alone the answer hangs on what was found before, and so a softened way begins without memory. What was known where Newton's
//! method has arrived does not wear off with the trials of a step: after a long one, a short one would else find somebody inside who is not
//! inside where it starts, and no step would be short enough for the energy to fall.

use super::candidates::Primitives;
use super::normals::Normals;
use super::surface::{Surface, Surfaces};
use super::{Contact, Mode};
use crate::geometry::closest::{feature, point_triangle};
use crate::geometry::tree::{Aabb, Tree};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::sync::{Arc, MutexGuard};

/// How deep overlaps are measured, in edge lengths.
const VIEW: f64 = 4.0;
/// Cosine between the normals of a point and of a triangle from which on they face the same way.
const ALIGNED: f64 = 0.5;
/// How many times as far such a triangle counts at most for a point inside.
const FARTHER: f64 = 4.0;
/// Fraction of the mean edge by which distances and ways may contradict each other: round-off.
const ROUND_OFF: f64 = 1e-6;
/// Fraction of the way to the far side of a body that a point may go at once.
const HALF: f64 = 0.5;

/// A collision point that is closer to another surface than wanted.
#[derive(Debug)]
pub(super) struct Near {
    pub(super) point: u32,
    pub(super) triangle: u32,
    /// Weights of its closest point among the corners of the triangle.
    pub(super) at: [f64; 3],
    /// Direction out of the other surface.
    pub(super) out: Vector3<f64>,
    /// Signed distance \[m\], negative inside.
    pub(super) gap: f64,
    /// How far it may come closer in one go so as not to get past the middle of the body that it may enter \[m\]; infinite inside.
    pub(super) room: f64,
    /// How far it is beside the rim of an open surface \[m\].
    beside: Option<f64>,
    /// How many times as deep it counts inside, and by how much more \[m\].
    pub(super) weight: f64,
    pub(super) extra: f64,
}

/// What the last search has found.
#[derive(Debug, Default)]
pub(super) struct Memory {
    /// How far it looked, and how far beside rims \[m\].
    range: [f64; 2],
    /// Whether it looked from all samples.
    all: bool,
    /// Positions of the collision points \[m\].
    p: Vec<Vector3<f64>>,
    /// The same where Newton's method has arrived; where the memory begins before it has.
    arrived: Vec<Vector3<f64>>,
    /// What each collision point has seen: corners, and the others.
    corners: Vec<Vec<Seen>>,
    others: Vec<Vec<Seen>>,
}

/// A surface as seen from a collision point.
#[derive(Clone, Copy, Debug)]
struct Seen {
    surface: usize,
    /// The triangle that was nearest, counted from the first of the surface.
    nearest: Option<u32>,
    /// The signed distance is no less \[m\].
    at_least: f64,
    /// Nor was it any less where Newton's method has arrived \[m\]: trials do not wear that off.
    on_arrival: f64,
}

impl Memory {
    /// Newton's method has arrived where the last search was.
    fn arrive(&mut self) {
        self.arrived.clone_from(&self.p);
        let all = self.corners.par_iter_mut().chain(&mut self.others);
        all.for_each(|seen| seen.iter_mut().for_each(|s| s.on_arrival = s.at_least));
    }
}

impl Contact {
    /// Collision points closer than `least` to a surface that they may meet, or inside it.
    pub(super) fn near(&self, p: &[Vector3<f64>], least: f64) -> Vec<Near> {
        self.near_within(p, Primitives::Samples, &|_, _| least, least + self.view(), 0.0)
    }

    /// How many collision points are closer to a surface that they may meet, with the nodes at `x` \[m\], than `least` \[m\] says of point and surface;
    /// it says no more than `most`. What it does meanwhile, and be it another search, does not matter to this one.
    pub fn n_near(&self, x: &[f64], most: f64, least: &(dyn Fn(usize, usize) -> f64 + Sync)) -> usize {
        let p = self.surfaces.positions(x);
        self.near_within(&p, Primitives::Samples, least, most + self.view(), 0.0).len()
    }

    /// Forgets what earlier searches have found.
    pub(super) fn forget_near(&self) {
        *self.held() = Memory::default();
    }

    /// Newton's method has arrived where the last search was: what is known there does not wear off with trials.
    pub fn arrive(&self) {
        let mut memory = std::mem::take(&mut *self.held());
        memory.arrive();
        *self.held() = memory;
    }

    /// From now on, until [`release_normals`](Contact::release_normals), who faces whom is told by the normals with the nodes at `x` \[m\].
    pub fn hold_normals(&self, x: &[f64]) {
        let p = self.surfaces.positions(x);
        self.tell_by(Some(Arc::new(self.normals(&p))));
    }

    /// From now on it is told by those of the moment.
    pub fn release_normals(&self) {
        self.tell_by(None);
    }

    fn tell_by(&self, normals: Option<Arc<Vec<Normals>>>) {
        *self.held_normals.lock().expect("no thread panics while it holds them") = normals;
        *self.last.lock().expect("no thread panics while it holds them") = Arc::default();
    }

    fn held(&self) -> MutexGuard<'_, Memory> {
        self.memory.lock().expect("no thread panics while it holds the memory")
    }

    /// How deep overlaps are measured \[m\]: who is deeper has its surface crossed elsewhere, or is inside altogether, as its
    /// first point shows.
    pub(super) fn view(&self) -> f64 {
        VIEW * self.surfaces.edge_length
    }

    /// The same of corners or all samples, `least` by point and surface, of points no farther than `view` \[m\] from the surface, and of
    /// the first point of every surface. What lies beyond the rim of an open surface counts where it is less than `aside` \[m\] beside it.
    pub(super) fn near_within(
        &self,
        p: &[Vector3<f64>],
        primitives: Primitives,
        least: &(dyn Fn(usize, usize) -> f64 + Sync),
        view: f64,
        aside: f64,
    ) -> Vec<Near> {
        let mut memory = std::mem::take(&mut *self.held());
        let found = self.found(p, primitives, least, view, aside, &mut memory);
        *self.held() = memory;
        found
    }

    /// The same, with what `memory` holds, where what was found is kept.
    fn found(
        &self,
        p: &[Vector3<f64>],
        primitives: Primitives,
        least: &(dyn Fn(usize, usize) -> f64 + Sync),
        view: f64,
        aside: f64,
        memory: &mut Memory,
    ) -> Vec<Near> {
        let all = &self.surfaces;
        let every = primitives > Primitives::Corners;
        if memory.range != [view, aside] {
            let [now, arrived] = [p.to_vec(), p.to_vec()];
            *memory = Memory { range: [view, aside], p: now, arrived, ..Memory::default() };
            memory.corners.resize_with(p.len(), Vec::new);
        }
        if every && !memory.all {
            memory.others = p.iter().map(|_| Vec::new()).collect();
        }
        memory.all = every;
        let since_search = Moved::new(all, &memory.p, p);
        let since_arrival = Moved::new(all, &memory.arrived, p);
        memory.p.copy_from_slice(p);
        let fitted = self.fitted(p);
        let boxes = fitted.iter().map(|f| f.whole().grown(view)).collect();
        let held_normals = self.held_normals.lock().expect("no thread panics while it holds them").clone();
        let normals = self.normals(p);
        let moved = [since_search, since_arrival];
        let search = Search { contact: self, p, view, aside, moved, normals, held_normals, fitted, boxes };
        // From corners it is worth to look a little farther, for the samples around.
        let farther = if every { all.edge_length } else { 0.0 };
        let Memory { corners, others, arrived, .. } = memory;
        let of_corners = each(corners, |point, seen| match all.is_corner(point as u32) {
            true => search.from(point, least, farther, &[], seen),
            false => Vec::new(),
        });
        if !every {
            return of_corners.into_iter().flatten().collect();
        }
        let of_others = each(others, |point, seen| {
            if all.is_corner(point as u32) {
                return Vec::new();
            }
            let way = |p: &[Vector3<f64>], c: u32| (p[point] - p[c as usize]).norm();
            let ways = all.corners_of[point].map(|c| (way(p, c), c));
            let (way_now, corner) =
                ways.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).expect("three corners");
            let way_then = way(arrived, corner);
            let beside =
                |s: &Seen| Seen { at_least: s.at_least - way_now, on_arrival: s.on_arrival - way_then, ..*s };
            let known: Vec<Seen> = corners[corner as usize].iter().map(beside).collect();
            search.from(point, least, 0.0, &known, seen)
        });
        of_corners
            .into_iter()
            .zip(of_others)
            .flat_map(|(corner, other)| corner.into_iter().chain(other))
            .collect()
    }

    /// Boxes of the triangle trees of all surfaces with the collision points at `p`.
    pub(super) fn fitted(&self, p: &[Vector3<f64>]) -> Vec<Tree> {
        let all = &self.surfaces;
        let fit = |s: &Surface| {
            s.triangle_tree.fit(|t| Aabb::of(&all.triangles[s.triangles.start + t as usize], p))
        };
        all.list.par_iter().map(fit).collect()
    }

    /// The place of a point against the triangle `t`, counted from the first of its surface, which is nearest.
    fn seen_from(&self, point: u32, s: &Surface, t: u32, normals: &Normals, p: &[Vector3<f64>]) -> Near {
        let triangle = (s.triangles.start + t as usize) as u32;
        let x = self.triangle_points(point, triangle, p);
        let (which, at) = feature(&x);
        let (out, rim) = normals.of(&self.surfaces, triangle, which);
        let closest = point_triangle(&x);
        let (squared, height) = (closest.squared(), closest.w.dot(&out));
        let distance = if rim { height.abs() } else { squared.sqrt() };
        let beside = rim.then(|| (squared - height * height).max(0.0).sqrt());
        let gap = if height < 0.0 { -distance } else { distance };
        Near { point, triangle, at, out, gap, room: f64::INFINITY, beside, weight: 1.0, extra: 0.0 }
    }
}

/// What is near each collision point, given what it has seen before.
fn each(seen: &mut [Vec<Seen>], find: impl Fn(usize, &mut Vec<Seen>) -> Vec<Near> + Sync) -> Vec<Vec<Near>> {
    seen.par_iter_mut().enumerate().with_min_len(64).map(|(point, seen)| find(point, seen)).collect()
}

/// How far points have moved since some time \[m\].
struct Moved {
    /// Each collision point.
    points: Vec<f64>,
    /// The farthest one of each surface.
    surfaces: Vec<f64>,
}

impl Moved {
    /// From `then` to `now`.
    fn new(all: &Surfaces, then: &[Vector3<f64>], now: &[Vector3<f64>]) -> Moved {
        let points: Vec<f64> = now.par_iter().zip(then).map(|(now, then)| (now - then).norm()).collect();
        let farthest = |s: &Surface| {
            s.samples.clone().map(|i| points[i]).fold(0.0, |m: f64, v| if v <= m { m } else { v })
        };
        let surfaces = all.list.par_iter().map(farthest).collect();
        Moved { points, surfaces }
    }

    /// A point and a surface against each other.
    fn at_most(&self, point: usize, surface: usize) -> f64 {
        self.points[point] + self.surfaces[surface]
    }
}

/// One search for near points.
struct Search<'a> {
    contact: &'a Contact,
    /// Positions of the collision points \[m\].
    p: &'a [Vector3<f64>],
    view: f64,
    aside: f64,
    /// Since the last search, and since Newton's method has arrived.
    moved: [Moved; 2],
    /// By surface: normals, boxes of the tree, and the box of all that is not too far.
    normals: Vec<Normals>,
    /// Those by which it is told who faces whom, where they are held.
    held_normals: Option<Arc<Vec<Normals>>>,
    fitted: Vec<Tree>,
    boxes: Vec<Aabb>,
}

impl Search<'_> {
    /// What is near a collision point. It `seen` surfaces before; those `known` are what it would see at least. Looks
    /// for surfaces `farther` \[m\] than at `least`.
    fn from(
        &self,
        point: usize,
        least: &(dyn Fn(usize, usize) -> f64 + Sync),
        farther: f64,
        known: &[Seen],
        seen: &mut Vec<Seen>,
    ) -> Vec<Near> {
        let Search { contact, p, .. } = *self;
        let all = &contact.surfaces;
        let q = &p[point];
        let mine = all.surface(point as u32);
        for s in seen.iter_mut() {
            let [since_search, since_arrival] = self.moved.each_ref().map(|m| m.at_most(point, s.surface));
            s.at_least = (s.at_least - since_search).max(s.on_arrival - since_arrival);
        }
        let mut found = Vec::new();
        for &other in &contact.partners.of[mine] {
            if !self.boxes[other].contains(q) || other == mine {
                continue;
            }
            let least = least(point, other);
            let beside = known.iter().find(|s| s.surface == other);
            if beside.is_some_and(|s| s.at_least >= least) {
                continue;
            }
            let at = seen.iter().position(|s| s.surface == other).unwrap_or_else(|| {
                let unknown = f64::NEG_INFINITY;
                let nothing = Seen { surface: other, nearest: None, at_least: unknown, on_arrival: unknown };
                seen.push(*beside.unwrap_or(&nothing));
                seen.len() - 1
            });
            let seen = &mut seen[at];
            if let Some(beside) = beside {
                seen.at_least = seen.at_least.max(beside.at_least);
            }
            if seen.at_least >= least + farther {
                continue;
            }
            let Some(near) = self.look(point, other, least + farther, seen) else { continue };
            if near.gap < least
                && contact.partners.counts(all, &[point as u32], &all.triangles[near.triangle as usize])
            {
                found.push(near);
            }
        }
        found
    }

    /// The surface `other` from a collision point, where it is closer than `least` or the point inside.
    fn look(&self, point: usize, other: usize, least: f64, seen: &mut Seen) -> Option<Near> {
        let Search { contact, p, view, .. } = *self;
        let all = &contact.surfaces;
        let (s, normals) = (&all.list[other], &self.normals[other]);
        let squared = |t: u32| {
            let t = (s.triangles.start + t as usize) as u32;
            point_triangle(&contact.triangle_points(point as u32, t, p)).squared()
        };
        let search = |within: f64| {
            let nearest = self.fitted[other].nearest(&Aabb::at(&p[point]), within, seen.nearest, squared);
            nearest.map(|n| n.0)
        };
        let see = |t: u32| contact.seen_from(point as u32, s, t, normals, p);
        // Beyond a rim it is not the distance to the surface.
        let bound = |n: &Near| if n.beside.is_some() { f64::NEG_INFINITY } else { n.gap };
        let unlimited = f64::MAX.sqrt();
        let is_outside = seen.at_least > 0.0;
        let within = match all.list.iter().any(|s| s.samples.start == point) {
            true => unlimited,
            false if is_outside => view.min(least), // it need not be looked at farther than asked
            false => view,
        };
        let Some(nearest) = search(within) else {
            // Far outside or deep inside: which of the two has to be known before it is skipped.
            seen.at_least = match is_outside {
                true => within,
                false => search(unlimited).map_or(within, |t| bound(&see(t))),
            };
            return None;
        };
        let mut near = see(nearest);
        let is_known = contact.mode == Mode::Guarded && near.beside.is_none();
        if is_known && near.gap < 0.0 && near.gap < seen.at_least - ROUND_OFF * all.edge_length {
            (near.gap, near.out) = (-near.gap, -near.out);
        }
        (seen.nearest, seen.at_least) = (Some(nearest), bound(&near));
        if near.gap >= least || near.beside.is_some_and(|d| d >= self.aside) {
            return None;
        }
        if near.gap >= 0.0 {
            near.room = near.gap + HALF * all.depths[near.triangle as usize].min(view);
        } else if contact.mode == Mode::Guarded {
            let held = self.held_normals.as_deref().unwrap_or(&self.normals);
            let mine = held[all.surface(point as u32)].sample(point as u32);
            let is_far =
                |t: u32| held[other].triangle((s.triangles.start + t as usize) as u32).dot(&mine) > ALIGNED;
            if is_far(nearest) {
                let squared = |t: u32| if is_far(t) { f64::INFINITY } else { squared(t) };
                let own = all.sample_depths[point];
                let (weight, extra) = match (FARTHER - 1.0) * -near.gap < own {
                    true => (FARTHER, 0.0),
                    false => (1.0, own),
                };
                let within = weight * -near.gap + extra;
                match self.fitted[other].nearest(&Aabb::at(&p[point]), within, None, squared) {
                    Some((front, _)) => {
                        near = contact.seen_from(point as u32, s, front, normals, p);
                        near.gap = -near.gap.abs();
                    }
                    None => (near.weight, near.extra) = (weight, extra),
                }
            }
        }
        Some(near)
    }
}
