//! Where the free nodes of an island go when its bodies move: a first guess for the equilibrium, finite rotations included.
//!
//! The bodies drag space along: every point moves with the mean of their motions, weighted with the inverse square of its distance
//! to each (Shepard, Proc. 23rd ACM National Conference, 1968). Neighbours move alike, whatever they belong to, so gaps between
//! muscles stay open where a tangent to the equilibrium path would send one into the other.

#![allow(non_snake_case)]

use super::island::{Island, Load, Motion};
use crate::contact::tree::{Aabb, Tree};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Turn of a body \[rad\] that is followed at once.
const TURN: f64 = 0.05;
/// Pieces at most into which a load step is divided.
const MOST_PIECES: usize = 64;

/// The weights of the bodies at the free nodes of an island.
pub struct Flow {
    /// What the nodes of each body have as motion: a body, or held.
    bodies: Vec<Motion>,
    /// Per free node one weight per body, summing to 1.
    weights: Vec<f64>,
}

impl Flow {
    /// `None` where some nodes are prescribed in other ways than by bodies, or no node is.
    pub fn new(island: &Island, free_nodes: &[u32]) -> Option<Flow> {
        let mut bodies: Vec<Motion> = Vec::new();
        let mut tied: Vec<Vec<Vector3<f64>>> = Vec::new();
        let place = |n: usize| Vector3::from_column_slice(&island.X[3 * n..3 * n + 3]);
        for (n, motion) in island.motion.iter().enumerate() {
            match motion {
                [Motion::Free, Motion::Free, Motion::Free] => {}
                &[m @ (Motion::Held | Motion::Body(_)), b, c] if b == m && c == m => {
                    let at = bodies.iter().position(|known| *known == m).unwrap_or_else(|| {
                        bodies.push(m);
                        tied.push(Vec::new());
                        bodies.len() - 1
                    });
                    tied[at].push(place(n));
                }
                _ => return None,
            }
        }
        if !bodies.iter().any(|m| matches!(m, Motion::Body(_))) {
            return None;
        }
        let searches: Vec<_> = tied
            .iter()
            .map(|points| {
                let point = |i: u32| Aabb::of_way(&points[i as usize], &points[i as usize], 0.0);
                let boxes: Vec<Aabb> = (0..points.len() as u32).map(point).collect();
                let tree = Tree::new(&boxes);
                let fitted = tree.fit(point);
                (points, tree, fitted)
            })
            .collect();
        let of_node = |&n: &u32| -> Vec<f64> {
            let p = place(n as usize);
            let squared: Vec<f64> = searches
                .iter()
                .map(|(points, tree, fitted)| {
                    let squared = |i: u32| (points[i as usize] - p).norm_squared();
                    tree.nearest(fitted, &p, f64::MAX.sqrt(), None, squared).map_or(f64::MAX, |(_, d)| d)
                })
                .collect();
            let least = squared.iter().fold(f64::MAX, |m, d| m.min(*d));
            let inverse = squared.iter().map(|d| if least > 0.0 { least / d } else { f64::from(*d == 0.0) });
            let inverse: Vec<f64> = inverse.collect();
            let sum: f64 = inverse.iter().sum();
            inverse.iter().map(|w| w / sum).collect()
        };
        let weights: Vec<Vec<f64>> = free_nodes.par_iter().map(of_node).collect();
        Some(Flow { bodies, weights: weights.concat() })
    }

    /// Pieces in which to go from one load to another; 0 where no body moves.
    pub fn n_pieces(&self, from: &Load, to: &Load) -> usize {
        let moving = self.bodies.iter().filter_map(|m| match m {
            Motion::Body(b) if from.poses[*b] != to.poses[*b] => {
                Some((to.poses[*b].rotation * from.poses[*b].rotation.inverse()).angle())
            }
            _ => None,
        });
        let turns = moving.map(|angle| ((angle / TURN).ceil() as usize).clamp(1, MOST_PIECES));
        turns.max().unwrap_or(0)
    }

    /// Moves the free nodes at `x` \[m\] from one load to another.
    pub fn carry(&self, from: &Load, to: &Load, x: &mut [f64]) {
        let steps: Vec<_> = self
            .bodies
            .iter()
            .map(|m| match m {
                Motion::Body(b) => to.poses[*b] * from.poses[*b].inverse(),
                _ => nalgebra::Isometry3::identity(),
            })
            .collect();
        for (x, weights) in x.chunks_exact_mut(3).zip(self.weights.chunks_exact(self.bodies.len())) {
            let p = Point3::from_slice(x);
            let mean: Vector3<f64> = steps.iter().zip(weights).map(|(step, w)| (step * p).coords * *w).sum();
            x.copy_from_slice(mean.as_slice());
        }
    }
}
