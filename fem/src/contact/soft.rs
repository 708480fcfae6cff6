//! A soft way towards the equilibrium of guarded contact, for a first guess of it.
//!
//! Barriers and collision detection let surfaces that slide past each other move by a fraction of the gap between them per iteration:
//! a hundredth of the way that a change of posture asks for. Here the barrier of a sample goes on as its parabola below a fraction of
//! the activation distance, through zero into penetrations, so that Newton's method may step half as far as the thickest body is thick. Where
//! every gap ends above that fraction the equilibrium is that of the guarded mode but for edges. What comes of it is a guess and no
//! more: it counts only where nothing overlaps in it, and the guarded mode goes on from there.
//!
//! Where barriers are softest the corners of triangles are samples enough: a tenth of all points, and it is a way, not an answer.
//!
//! All surfaces must be closed. A point leaves a body by the side that is nearest, or where it has got past the middle of a thin one by a
//! side that faces it, see [`near`](super::near); no step takes one from outside deeper than half the body that it enters, but the one to the
//! guess of a coarser mesh.
//! Whether a body has got through another is looked at afterwards, see [`Sides`](crate::measure::Sides).

use super::candidates::Primitives;
use super::near::Near;
use super::stencil::{Law, Stencil};
use super::surface::Surface;
use super::{Contact, Mode};
use crate::geometry::closest::point_triangle;
use crate::geometry::tree::Aabb;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Fraction of the thickness of the thickest body that a node may move in one step, and up to which points are looked for inside.
const LONGEST: f64 = 0.5;
/// Fraction of the activation distance above which barriers that are softened below it are sampled at corners only.
const SOFTEST: f64 = 0.2;

/// What is sampled where barriers are softened below the fraction `softness` of the activation distance.
fn sampled(softness: f64) -> Primitives {
    if softness > SOFTEST { Primitives::Corners } else { Primitives::Samples }
}

impl Contact {
    /// Whether there is a soft way: inside and outside are known everywhere, which they are not of a surface that meets itself.
    pub fn can_soften(&self) -> bool {
        let is_known =
            |(s, surface): (usize, &Surface)| surface.thickness > 0.0 && !self.partners.of[s].contains(&s);
        self.mode == Mode::Guarded && self.surfaces.list.iter().enumerate().all(is_known)
    }

    /// How far a node may move in one step where barriers are softened, an edge at least \[m\].
    pub fn longest_soft_step(&self) -> f64 {
        let thickest = self.surfaces.list.iter().map(|s| s.thickness).fold(0.0, f64::max);
        self.surfaces.edge_length.max(LONGEST * thickest)
    }

    /// Points inside a surface with the collision points at `p`.
    fn soft_inside(&self, p: &[Vector3<f64>], softness: f64) -> Vec<Near> {
        self.near_within(p, sampled(softness), &|_, _| 0.0, self.longest_soft_step(), 0.0)
    }

    /// Barriers softened below the fraction `softness` of the activation distance, with the collision points at `p`.
    pub(super) fn soft_barriers(&self, p: &[Vector3<f64>], softness: f64) -> Vec<Stencil> {
        let all = &self.surfaces;
        let of_triangle = |t: u32| all.surface(all.triangles[t as usize][0]);
        let primitives = sampled(softness);
        let areas = if primitives == Primitives::Corners { &all.corner_areas } else { &all.areas };
        let inside = self.soft_inside(p, softness);
        let mut entered: Vec<(u32, usize)> =
            inside.iter().map(|n| (n.point, of_triangle(n.triangle))).collect();
        entered.sort_unstable();
        let candidates = self.candidates_at(primitives, p);
        let is_outside = |&&[s, t]: &&[u32; 2]| {
            areas[s as usize] > 0.0 && entered.binary_search(&(s, of_triangle(t))).is_err()
        };
        let outside: Vec<[u32; 2]> = candidates.point_triangle.iter().filter(is_outside).copied().collect();
        let mut stencils = self.sample_barriers(&outside, p);
        for stencil in &mut stencils {
            let sample = stencil.points[0] as usize;
            stencil.scale *= areas[sample] / all.areas[sample];
            if let Law::Barrier(reach) = stencil.law {
                stencil.law = Law::Soft { reach, softness, side: 1.0, extra: 0.0 };
            }
        }
        stencils.extend(inside.iter().map(|n| {
            let [a, b, c] = all.triangles[n.triangle as usize];
            Stencil {
                points: [n.point, a, b, c],
                closest: point_triangle(&self.triangle_points(n.point, n.triangle, p)),
                scale: 0.5 * areas[n.point as usize] * self.stiffness(n.point, n.triangle),
                law: Law::Soft {
                    reach: self.reach[n.point as usize],
                    softness,
                    side: -n.weight,
                    extra: n.extra,
                },
                edges: 0.0,
            }
        }));
        stencils
    }

    /// Fraction 0..=1 of the way from `from` to `to` (positions of the local nodes, m) that a step may go where barriers are softened below
    /// the fraction `softness` of the activation distance.
    pub fn soft_step(&self, from: &[f64], to: &[f64], softness: f64) -> f64 {
        let all = &self.surfaces;
        let start = all.positions(from);
        let u: Vec<Vector3<f64>> =
            all.positions(to).par_iter().zip(&start).map(|(to, from)| to - from).collect();
        let longest = self.longest_soft_step();
        // What points and surfaces do together brings none into another.
        let spans: Vec<Aabb> =
            all.list.par_iter().map(|s| Aabb::around(u[s.samples.clone()].iter())).collect();
        let against =
            |point: usize, other: usize| spans[other].farthest(&Aabb { lo: u[point], hi: u[point] });
        // What surfaces do together is no less than what their points do: pairs that can change nothing are left out.
        let pairs = (0..all.list.len()).flat_map(|s| self.partners.of[s].iter().map(move |&o| (s, o)));
        let mut pairs: Vec<_> = pairs.map(|(s, o)| (spans[o].farthest(&spans[s]), s, o)).collect();
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut farthest = longest;
        for (bound, s, o) in pairs {
            if bound <= farthest {
                break;
            }
            let samples = all.list[s].samples.clone().into_par_iter().with_min_len(1024);
            farthest = samples.map(|point| against(point, o)).reduce(|| farthest, f64::max);
        }
        let mut fraction = longest / farthest;
        let least = |point: usize, other: usize| fraction * against(point, other);
        let ahead = self.near_within(&start, sampled(softness), &least, longest, 0.0);
        for n in ahead {
            let corners = all.triangles[n.triangle as usize];
            let theirs: Vector3<f64> = (0..3).map(|c| u[corners[c] as usize] * n.at[c]).sum();
            let closing = -(u[n.point as usize] - theirs).dot(&n.out);
            if closing * fraction > n.room {
                fraction = n.room / closing;
            }
        }
        fraction
    }

    /// Positions \[m\] of the nodes near `x` at which all surfaces are apart by the fraction `softness` of the activation distance; nodes for
    /// which `moves` is false stay. `None`: none are found.
    pub fn untangled(&self, x: &[f64], softness: f64, moves: &dyn Fn(u32) -> bool) -> Option<Vec<f64>> {
        let u = self.untangle(x, softness * self.distance, moves).ok()?;
        Some(x.iter().zip(&u).map(|(x, u)| x + u).collect())
    }
}
