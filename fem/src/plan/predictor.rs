//! A kinematic predictor: where the free nodes of an island go when its bodies and obstacles move, finite rotations included.
//!
//! They drag space along: every point moves with the mean of their motions, weighted with the inverse square of its distance
//! to each (of obstacles, which may change their shape, to the nearest node; Shepard, Proc. 23rd ACM National Conference, 1968). Neighbours move alike, whatever they belong to, so gaps between
//! muscles stay open where a tangent to the equilibrium path would send one into the other.

#![allow(non_snake_case)]

use super::load::{Load, Motion};
use crate::effect::NO_NODE;
use crate::geometry::tree::{Aabb, Tree};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Turn of a body \[rad\] that is followed at once.
const TURN: f64 = 0.05;

/// The weights of the bodies at the free nodes of an island.
pub struct KinematicPredictor {
    /// What the nodes of each body have as motion: a body, or held.
    bodies: Vec<Motion>,
    /// Nodes that controls displace and nothing else acts on: displacement \[m\] at unit value of a control, per component.
    obstacles: Vec<[(usize, f64); 3]>,
    /// Per free node the nearest obstacle; empty where there are none.
    nearest: Vec<u32>,
    /// Per free node one weight per body and one of its nearest obstacle, summing to 1.
    weights: Vec<f64>,
}

impl KinematicPredictor {
    /// `None` where some nodes are prescribed in other ways than by bodies or as obstacles, or nothing is that can move.
    /// `X`: places in the mesh \[m\] of all nodes of the island, `motions` what they do, `acted_on` the nodes of its effects.
    pub fn new(
        X: &[f64],
        motions: &[[Motion; 3]],
        acted_on: impl Iterator<Item = u32>,
        free_nodes: &[u32],
    ) -> Option<KinematicPredictor> {
        let mut bodies: Vec<Motion> = Vec::new();
        let mut tied: Vec<Vec<Vector3<f64>>> = Vec::new();
        let (mut obstacles, mut places) = (Vec::new(), Vec::new());
        let mut is_acted_on = vec![false; motions.len()];
        acted_on.filter(|n| *n != NO_NODE).for_each(|n| is_acted_on[n as usize] = true);
        let place = |n: usize| Vector3::from_column_slice(&X[3 * n..3 * n + 3]);
        for (n, motion) in motions.iter().enumerate() {
            let by_control = |m: &Motion| matches!(m, Motion::Control(..));
            match motion {
                [Motion::Free, Motion::Free, Motion::Free] | [Motion::Rides(_) | Motion::Mean(_), ..] => {}
                &[m @ (Motion::Held | Motion::Body(_)), b, c] if b == m && c == m => {
                    let at = bodies.iter().position(|known| *known == m).unwrap_or_else(|| {
                        bodies.push(m);
                        tied.push(Vec::new());
                        bodies.len() - 1
                    });
                    tied[at].push(place(n));
                }
                m if !is_acted_on[n]
                    && m.iter().any(by_control)
                    && m.iter().all(|m| by_control(m) || *m == Motion::Held) =>
                {
                    obstacles.push(m.map(|m| match m {
                        Motion::Control(control, u) => (control, u),
                        _ => (0, 0.0),
                    }));
                    places.push(place(n));
                }
                _ => return None,
            }
        }
        if obstacles.is_empty() && !bodies.iter().any(|m| matches!(m, Motion::Body(_))) {
            return None;
        }
        let with_obstacles = !obstacles.is_empty();
        if with_obstacles {
            tied.push(places);
        }
        let searches: Vec<_> = tied
            .iter()
            .map(|points| {
                let boxes: Vec<Aabb> = points.iter().map(Aabb::at).collect();
                (points, Tree::new(&boxes))
            })
            .collect();
        let of_node = |&n: &u32| -> (Vec<f64>, u32) {
            let p = place(n as usize);
            let nearest: Vec<(u32, f64)> = searches
                .iter()
                .map(|(points, tree)| {
                    let squared = |i: u32| (points[i as usize] - p).norm_squared();
                    tree.nearest(&Aabb::at(&p), f64::MAX.sqrt(), None, squared).unwrap_or((0, f64::MAX))
                })
                .collect();
            let least = nearest.iter().fold(f64::MAX, |m, n| m.min(n.1));
            let inverse =
                nearest.iter().map(|(_, d)| if least > 0.0 { least / d } else { f64::from(*d == 0.0) });
            let inverse: Vec<f64> = inverse.collect();
            let sum: f64 = inverse.iter().sum();
            (inverse.iter().map(|w| w / sum).collect(), nearest.last().map_or(0, |n| n.0))
        };
        let (weights, nearest): (Vec<Vec<f64>>, Vec<u32>) = free_nodes.par_iter().map(of_node).unzip();
        let nearest = if with_obstacles { nearest } else { Vec::new() };
        Some(KinematicPredictor { bodies, obstacles, nearest, weights: weights.concat() })
    }

    /// Pieces in which to go from one load to another; 0 where nothing moves.
    pub fn n_pieces(&self, from: &Load, to: &Load) -> usize {
        let moving = self.bodies.iter().filter_map(|m| match m {
            Motion::Body(b) if from.poses[*b] != to.poses[*b] => {
                Some((to.poses[*b].rotation * from.poses[*b].rotation.inverse()).angle())
            }
            _ => None,
        });
        let turns = moving.map(|angle| ((angle / TURN).ceil() as usize).max(1));
        let moves = |&(control, u): &(usize, f64)| u != 0.0 && from.controls[control] != to.controls[control];
        let pushes = self.obstacles.iter().flatten().any(moves);
        turns.max().unwrap_or(0).max(usize::from(pushes))
    }

    /// Moves the free nodes at `x` \[m\] from one load to another.
    pub fn predict(&self, from: &Load, to: &Load, x: &mut [f64]) {
        let steps: Vec<_> = self
            .bodies
            .iter()
            .map(|m| match m {
                Motion::Body(b) => to.poses[*b] * from.poses[*b].inverse(),
                _ => nalgebra::Isometry3::identity(),
            })
            .collect();
        let n_weights = self.bodies.len() + usize::from(!self.obstacles.is_empty());
        let shift = |(control, u): (usize, f64)| match u {
            0.0 => 0.0,
            u => u * (to.controls[control] - from.controls[control]),
        };
        for (i, (x, weights)) in x.chunks_exact_mut(3).zip(self.weights.chunks_exact(n_weights)).enumerate() {
            let p = Point3::from_slice(x);
            let mut mean: Vector3<f64> =
                steps.iter().zip(weights).map(|(step, w)| (step * p).coords * *w).sum();
            if let Some(&nearest) = self.nearest.get(i) {
                let shift = Vector3::from(self.obstacles[nearest as usize].map(shift));
                mean += (p.coords + shift) * weights[self.bodies.len()];
            }
            x.copy_from_slice(mean.as_slice());
        }
    }
}
