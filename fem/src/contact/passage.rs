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
use super::surface::{Core, Surface};
use super::tree::Fitted;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// Cosine between the normals of the triangles by which a place comes into a body and out of it: 120 degrees, between the 90 of a face
/// beside it, round whose edge it may go, and the 180 of the far one.
const FACING: f64 = -0.5;

/// What was seen at the last look.
#[derive(Debug, Default)]
pub(super) struct Watch {
    /// Positions of the collision points \[m\], and the boxes of the trees.
    p: Vec<Vector3<f64>>,
    fitted: Arc<Vec<Fitted>>,
    /// What each core has seen of other surfaces.
    seen: Vec<Vec<Seen>>,
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

impl Contact {
    fn core_place(&self, core: &Core, p: &[Vector3<f64>]) -> Vector3<f64> {
        let corner = |t: u32, c: usize| p[self.surfaces.triangles[t as usize][c] as usize];
        let here: Vector3<f64> = (0..3).map(|c| corner(core.triangle, c)).sum::<Vector3<f64>>() / 3.0;
        let there: Vector3<f64> = (0..3).map(|c| corner(core.across, c) * core.at[c]).sum();
        0.5 * (here + there)
    }

    /// Begins to watch at positions `x` \[m\] of the local nodes where nothing overlaps.
    pub fn begin_watch(&self, x: &[f64]) {
        let mut watch = self.watch.lock().expect("no thread panics while it watches");
        let p = self.surfaces.positions(x);
        let fitted = Arc::new(self.fitted(&p));
        *watch = Watch { p, fitted, seen: vec![Vec::new(); self.surfaces.cores.len()] };
    }

    /// Looks where a step leads: the names of a body that passes through another, and of that, where there are such; the step counts as
    /// not taken then.
    pub fn look_for_passage(&self, x: &[f64]) -> Option<[String; 2]> {
        let all = &self.surfaces;
        let mut watch = self.watch.lock().expect("no thread panics while it watches");
        if watch.seen.len() != all.cores.len() {
            return None; // nobody watches
        }
        let p = all.positions(x);
        let before = watch.p.clone();
        let mut seen = watch.seen.clone();
        let moved = |i: usize| (p[i] - before[i]).norm();
        let ways: Vec<f64> =
            all.list.par_iter().map(|s| s.samples.clone().map(moved).fold(0.0, f64::max)).collect();
        let fitted = [watch.fitted.clone(), Arc::new(self.fitted(&p))];
        let normals = all.list.iter().map(|_| OnceLock::new()).collect();
        let look = Look { contact: self, fitted, normals, p: [&before, &p], ways };
        let passed: Vec<Option<(usize, usize)>> = seen
            .par_iter_mut()
            .zip(&all.cores)
            .with_min_len(64)
            .map(|(seen, core)| look.from(core, seen))
            .collect();
        match passed.into_iter().flatten().next() {
            Some((a, b)) => Some([a, b].map(|s| all.list[s].name.clone())),
            None => {
                let [_, fitted] = look.fitted;
                *watch = Watch { p, fitted, seen };
                None
            }
        }
    }
}

struct Look<'a> {
    contact: &'a Contact,
    /// Before and now.
    p: [&'a [Vector3<f64>]; 2],
    fitted: [Arc<Vec<Fitted>>; 2],
    /// By surface, now; where they are asked for.
    normals: Vec<OnceLock<Normals>>,
    /// How far the farthest point of each surface has moved \[m\].
    ways: Vec<f64>,
}

impl Look<'_> {
    /// The surfaces of a core and of what it has passed through.
    fn from(&self, core: &Core, seen: &mut Vec<Seen>) -> Option<(usize, usize)> {
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
                    if normal(front).dot(&normal(nearest)) < FACING {
                        passed = Some((mine, other));
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
