//! Which collision points are near a surface or inside it.
//!
//! What was found is remembered: a signed distance changes by no more than the point and the surface have moved since, so most of
//! what was far need not be looked at again, and the triangle that was nearest is the first to be tried. Neither changes the answer.
//!
//! A point inside a closed body has come in by the side that is nearest, unless that faces the way the point itself does: then the
//! point has got past the middle of a thin body, and it has come in by a side that faces it, if that is no farther than its own
//! body is deep, which then still sticks out there.

use super::closest::{feature, point_triangle};
use super::normals::Normals;
use super::surface::Surface;
use super::tree::{Aabb, Fitted};
use super::{Contact, Mode};
use nalgebra::Vector3;
use rayon::prelude::*;

/// How deep overlaps are measured, in edge lengths.
const VIEW: f64 = 4.0;
/// Cosine between the normals of a point and of a triangle from which on they face the same way.
const ALIGNED: f64 = 0.5;
/// Share of the way to the far side of a body that a point may go at once.
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
}

/// What the last search has found.
#[derive(Debug, Default)]
pub(super) struct Memory {
    /// How far it looked, and how far beside rims \[m\].
    range: [f64; 2],
    /// Positions of the collision points \[m\].
    p: Vec<Vector3<f64>>,
    /// What each collision point has seen.
    seen: Vec<Vec<Seen>>,
}

/// A surface as seen from a collision point.
#[derive(Debug)]
struct Seen {
    surface: usize,
    /// The triangle that was nearest, counted from the first of the surface.
    nearest: Option<u32>,
    /// The signed distance is no less \[m\].
    at_least: f64,
}

impl Contact {
    /// Collision points closer than `least` to a surface that they may meet, or inside it.
    pub(super) fn near(&self, p: &[Vector3<f64>], least: f64) -> Vec<Near> {
        self.near_within(p, &|_, _| least, least + self.view(), 0.0)
    }

    /// How deep overlaps are measured \[m\]: who is deeper has its surface crossed elsewhere, or is inside altogether, as its
    /// first point shows.
    pub(super) fn view(&self) -> f64 {
        VIEW * self.surfaces.edge_length
    }

    /// The same, `least` by point and surface, of points no farther than `view` \[m\] from the surface, and of the first point of every
    /// surface. What lies beyond the rim of an open surface counts where it is less than `aside` \[m\] beside it.
    pub(super) fn near_within(
        &self,
        p: &[Vector3<f64>],
        least: &(dyn Fn(usize, usize) -> f64 + Sync),
        view: f64,
        aside: f64,
    ) -> Vec<Near> {
        let all = &self.surfaces;
        let mut memory = self.memory.lock().expect("no thread panics while it holds the memory");
        if memory.range != [view, aside] {
            let seen = p.iter().map(|_| Vec::new()).collect();
            *memory = Memory { range: [view, aside], p: p.to_vec(), seen };
        }
        let moved: Vec<f64> = p.iter().zip(&memory.p).map(|(now, then)| (now - then).norm()).collect();
        let way = |s: &Surface| {
            s.samples.clone().map(|i| moved[i]).fold(0.0, |m: f64, v| if v <= m { m } else { v })
        };
        let ways: Vec<f64> = all.list.iter().map(way).collect();
        memory.p.copy_from_slice(p);
        let normals = self.normals(p);
        let fitted = self.fitted(p);
        let boxes: Vec<Aabb> = fitted.iter().map(|f| f.whole().grown(view)).collect();
        let first = |point: usize| all.list.iter().any(|s| s.samples.start == point);
        let find = |(point, seen): (usize, &mut Vec<Seen>)| -> Vec<Near> {
            let q = &p[point];
            let mine = all.surface(point as u32);
            seen.iter_mut().for_each(|s| s.at_least -= moved[point] + ways[s.surface]);
            let mut found = Vec::new();
            for &other in &self.partners.of[mine] {
                if !boxes[other].contains(q) || other == mine {
                    continue;
                }
                let at = seen.iter().position(|s| s.surface == other).unwrap_or_else(|| {
                    seen.push(Seen { surface: other, nearest: None, at_least: f64::NEG_INFINITY });
                    seen.len() - 1
                });
                let (seen, least) = (&mut seen[at], least(point, other));
                if seen.at_least >= least {
                    continue;
                }
                let s = &all.list[other];
                let squared = |t: u32| {
                    let t = (s.triangles.start + t as usize) as u32;
                    point_triangle(&self.triangle_points(point as u32, t, p)).squared()
                };
                let search = |within: f64| {
                    s.triangle_tree.nearest(&fitted[other], q, within, seen.nearest, squared).map(|n| n.0)
                };
                let see = |t: u32| self.seen_from(point as u32, s, t, &normals[other], p);
                // Beyond a rim it is not the distance to the surface.
                let bound = |n: &Near| if n.beside.is_some() { f64::NEG_INFINITY } else { n.gap };
                let unlimited = f64::MAX.sqrt();
                let is_outside = seen.at_least > 0.0;
                let within = match first(point) {
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
                    continue;
                };
                let mut near = see(nearest);
                (seen.nearest, seen.at_least) = (Some(nearest), bound(&near));
                if near.gap >= least || near.beside.is_some_and(|d| d >= aside) {
                    continue;
                }
                if near.gap >= 0.0 {
                    near.room = near.gap + HALF * all.depths[near.triangle as usize].min(view);
                } else if self.mode == Mode::Guarded {
                    let (mine, theirs) = (normals[mine].sample(point as u32), &normals[other]);
                    let is_far = |t: u32| {
                        theirs.triangle((s.triangles.start + t as usize) as u32).dot(&mine) > ALIGNED
                    };
                    let squared = |t: u32| if is_far(t) { f64::INFINITY } else { squared(t) };
                    let within = all.sample_depths[point].min(view);
                    if is_far(nearest)
                        && let Some((front, _)) =
                            s.triangle_tree.nearest(&fitted[other], q, within, None, squared)
                    {
                        near = self.seen_from(point as u32, s, front, theirs, p);
                        near.gap = -near.gap.abs();
                    }
                }
                if self.partners.counts(all, &[point as u32], &all.triangles[near.triangle as usize]) {
                    found.push(near);
                }
            }
            found
        };
        let found: Vec<Vec<Near>> =
            memory.seen.par_iter_mut().enumerate().with_min_len(64).map(find).collect();
        found.into_iter().flatten().collect()
    }

    /// Boxes of the triangle trees of all surfaces with the collision points at `p`.
    pub(super) fn fitted(&self, p: &[Vector3<f64>]) -> Vec<Fitted> {
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
        Near { point, triangle, at, out, gap, room: f64::INFINITY, beside }
    }
}
