//! Nobody passes through anybody, where contact is softened and surfaces may overlap on the way.
//!
//! Every body has places in its middle ([`Core`](super::surface::Core)). As long as those of one body stay out of the other, surfaces
//! overlap by less than half of what they enter, and what comes out comes out where it has come in. Where bodies are thin they may
//! get into others: then the side by which they come out must not face away from that by which they have come in.
//!
//! No step closes a pair by more than half the depth of the body that is entered, so nothing passes between two looks.

use super::Contact;
use super::closest::{feature, point_triangle};
use super::normals::Normals;
use super::surface::{Core, Surface, faces_away};
use super::tree::Fitted;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::sync::{Arc, MutexGuard, OnceLock};

/// Halvings of a step that leads through somebody.
const MOST_HALVES: usize = 5;

/// Who is in whom at the last state that was accepted, and where the way that was looked at last leads from there.
#[derive(Debug, Default)]
pub(super) struct Watch {
    now: State,
    /// Points of triangles whose core is inside another surface.
    swallowed: Arc<Swallowed>,
    ahead: Option<Ahead>,
}

/// Who is in whom.
#[derive(Debug, Default)]
struct State {
    /// Positions of the collision points \[m\], and the boxes of the trees.
    p: Vec<Vector3<f64>>,
    fitted: Vec<Fitted>,
    /// What each core has seen of other surfaces.
    seen: Vec<Vec<Seen>>,
}

/// Where a way leads.
#[derive(Debug)]
struct Ahead {
    /// Positions of the local nodes \[m\].
    x: Vec<f64>,
    state: State,
    /// The surfaces of one that passes through another.
    passed: Option<[usize; 2]>,
}

/// A surface as seen from a core.
#[derive(Clone, Copy, Debug)]
struct Seen {
    other: usize,
    /// Its signed distance is no less \[m\].
    at_least: f64,
    /// The triangle that was nearest, counted from the first of the surface.
    nearest: Option<u32>,
    /// The triangle by which it has come in; outside: none.
    front: Option<u32>,
}

/// (point, other surface, triangle of that by which the middle behind the point has come in), ascending.
pub(super) type Swallowed = Vec<(u32, usize, u32)>;

impl Contact {
    fn core_place(&self, core: &Core, p: &[Vector3<f64>]) -> Vector3<f64> {
        let corner = |t: u32, c: usize| p[self.surfaces.triangles[t as usize][c] as usize];
        let here: Vector3<f64> = (0..3).map(|c| corner(core.triangle, c)).sum::<Vector3<f64>>() / 3.0;
        let there: Vector3<f64> = (0..3).map(|c| corner(core.across, c) * core.at[c]).sum();
        0.5 * (here + there)
    }

    /// Begins to watch at positions `x` \[m\] of the local nodes where nothing overlaps.
    pub fn begin_watch(&self, x: &[f64]) {
        let p = self.surfaces.positions(x);
        let fitted = self.fitted(&p);
        let seen = vec![Vec::new(); self.surfaces.cores.len()];
        *self.watch() = Watch { now: State { p, fitted, seen }, ..Watch::default() };
    }

    /// Watches no more.
    pub fn end_watch(&self) {
        *self.watch() = Watch::default();
    }

    /// The names of a body that passes through another where the nodes go to `x` \[m\], and of that; `None`: nobody does, or nobody watches.
    pub fn passage(&self, x: &[f64]) -> Option<[String; 2]> {
        let mut watch = self.watch();
        if watch.now.seen.is_empty() {
            return None;
        }
        if watch.ahead.as_ref().is_none_or(|ahead| ahead.x != x) {
            watch.ahead = Some(self.look_ahead(&watch.now, x));
        }
        let passed = watch.ahead.as_ref().and_then(|ahead| ahead.passed);
        passed.map(|pair| pair.map(|s| self.surfaces.list[s].name.clone()))
    }

    /// The share of the way from `from` to `to` \[m\] on which nobody passes through anybody: `share`, or a half, a quarter... of it. Where
    /// even the shortest leads through it is the one.
    pub fn share_before_passage(&self, from: &[f64], to: &[f64], mut share: f64) -> f64 {
        for _ in 0..MOST_HALVES {
            let at: Vec<f64> = from.iter().zip(to).map(|(a, b)| a + share * (b - a)).collect();
            if self.passage(&at).is_none() {
                break;
            }
            share /= 2.0;
        }
        share
    }

    /// The same of nodes that are at `x` now; where somebody passes through somebody they are watched from before.
    pub fn watch_step(&self, x: &[f64]) -> Option<[String; 2]> {
        let passed = self.passage(x);
        let mut watch = self.watch();
        if passed.is_none()
            && let Some(ahead) = watch.ahead.take()
        {
            let swallowed = self.swallowed_by(&ahead.state.seen);
            if swallowed != *watch.swallowed {
                // They are pushed elsewhere now.
                watch.swallowed = Arc::new(swallowed);
                *self.last.lock().expect("no thread panics while it holds the terms") = Arc::default();
            }
            watch.now = ahead.state;
        }
        passed
    }

    pub(super) fn swallowed(&self) -> Arc<Swallowed> {
        self.watch().swallowed.clone()
    }

    fn watch(&self) -> MutexGuard<'_, Watch> {
        self.watch.lock().expect("no thread panics while it watches")
    }

    fn look_ahead(&self, now: &State, x: &[f64]) -> Ahead {
        let all = &self.surfaces;
        let p = all.positions(x);
        let mut seen = now.seen.clone();
        let moved = |i: usize| (p[i] - now.p[i]).norm();
        let ways = all.list.par_iter().map(|s| s.samples.clone().map(moved).fold(0.0, f64::max)).collect();
        let fitted = self.fitted(&p);
        let normals = all.list.iter().map(|_| OnceLock::new()).collect();
        let look = Look { contact: self, fitted: [&now.fitted, &fitted], normals, p: [&now.p, &p], ways };
        let cores = seen.par_iter_mut().zip(&all.cores).with_min_len(64);
        let passed: Vec<Option<[usize; 2]>> = cores.map(|(seen, core)| look.from(core, seen)).collect();
        Ahead { x: x.to_vec(), state: State { p, fitted, seen }, passed: passed.into_iter().flatten().next() }
    }

    fn swallowed_by(&self, seen: &[Vec<Seen>]) -> Swallowed {
        let all = &self.surfaces;
        let mut list = Swallowed::new();
        for (core, seen) in all.cores.iter().zip(seen) {
            for (other, front) in seen.iter().filter_map(|s| Some((s.other, s.front?))) {
                let front = (all.list[other].triangles.start + front as usize) as u32;
                let points = &all.triangle_samples[core.triangle as usize];
                list.extend(points.iter().map(|&point| (point, other, front)));
            }
        }
        list.sort_unstable();
        list.dedup_by_key(|s| (s.0, s.1));
        list
    }
}

struct Look<'a> {
    contact: &'a Contact,
    /// Before and now.
    p: [&'a [Vector3<f64>]; 2],
    fitted: [&'a [Fitted]; 2],
    /// By surface, now; where they are asked for.
    normals: Vec<OnceLock<Normals>>,
    /// How far the farthest point of each surface has moved \[m\].
    ways: Vec<f64>,
}

impl Look<'_> {
    /// The surfaces of a core and of what it has passed through.
    fn from(&self, core: &Core, seen: &mut Vec<Seen>) -> Option<[usize; 2]> {
        let all = &self.contact.surfaces;
        let corners = &all.triangles[core.triangle as usize];
        let mine = all.surface(corners[0]);
        let [before, now] = self.p.map(|p| self.contact.core_place(core, p));
        let mut passed = None;
        for &other in self.contact.partners.of[mine].iter().filter(|&&other| other != mine) {
            let s = &all.list[other];
            if s.thickness == 0.0 {
                continue;
            }
            let at = seen.iter().position(|s| s.other == other).unwrap_or_else(|| {
                seen.push(Seen { other, at_least: f64::NEG_INFINITY, nearest: None, front: None });
                seen.len() - 1
            });
            let seen = &mut seen[at];
            seen.at_least -= (now - before).norm() + self.ways[other];
            if seen.front.is_none() {
                let to_box = self.fitted[1][other].whole().squared_distance(&now).sqrt();
                seen.at_least = seen.at_least.max(if to_box > 0.0 { to_box } else { f64::NEG_INFINITY });
                if seen.at_least > 0.0 {
                    continue;
                }
            }
            let nearest = self.nearest(s, 1, other, &now, seen.nearest);
            let gap = self.signed_distance(s, other, nearest, &now);
            (seen.nearest, seen.at_least) = (Some(nearest), gap);
            if !self.contact.partners.counts(
                all,
                corners,
                &all.triangles[s.triangles.start + nearest as usize],
            ) {
                continue;
            }
            let normal = |t: u32| self.normals(other).triangle((s.triangles.start + t as usize) as u32);
            match seen.front {
                None if gap < 0.0 => seen.front = Some(self.nearest(s, 0, other, &before, Some(nearest))),
                Some(front) if gap >= 0.0 => {
                    if faces_away(&normal(front), &normal(nearest)) {
                        passed = Some([mine, other]);
                    }
                    seen.front = None;
                }
                _ => {}
            }
        }
        passed
    }

    fn normals(&self, surface: usize) -> &Normals {
        let all = &self.contact.surfaces;
        self.normals[surface].get_or_init(|| Normals::new(all, &all.list[surface], self.p[1]))
    }

    /// The triangle of a surface nearest to `place`, before or now.
    fn nearest(
        &self,
        s: &Surface,
        when: usize,
        other: usize,
        place: &Vector3<f64>,
        guess: Option<u32>,
    ) -> u32 {
        let squared = |t: u32| point_triangle(&self.with_place(s, t, place, when)).squared();
        let found = self.fitted[when][other].nearest(place, f64::MAX.sqrt(), guess, squared);
        found.expect("a closed surface has triangles").0
    }

    fn with_place(&self, s: &Surface, t: u32, place: &Vector3<f64>, when: usize) -> [Vector3<f64>; 4] {
        let [a, b, c] = self.contact.surfaces.triangles[s.triangles.start + t as usize];
        [*place, self.p[when][a as usize], self.p[when][b as usize], self.p[when][c as usize]]
    }

    fn signed_distance(&self, s: &Surface, other: usize, t: u32, place: &Vector3<f64>) -> f64 {
        let x = self.with_place(s, t, place, 1);
        let (which, _) = feature(&x);
        let triangle = (s.triangles.start + t as usize) as u32;
        let (out, _) = self.normals(other).of(&self.contact.surfaces, triangle, which);
        let closest = point_triangle(&x);
        closest.squared().sqrt().copysign(closest.w.dot(&out))
    }
}
