//! What is prescribed: how each component of a node moves, and the controls and poses that move it.

#![allow(non_snake_case)]

use super::free::FreeBody;
use super::slide::Slide;
use crate::body::{Pose, interpolate};
use nalgebra::Vector3;

/// Nodes of which another is a fixed mean, with their weights, which add up to 1.
pub type Mean = Vec<(u32, f64)>;

/// What every node does, and what that refers to.
#[derive(Clone, Copy)]
pub(super) struct Motions<'a> {
    /// Per node what its components do.
    pub(super) motion: &'a [[Motion; 3]],
    pub(super) slides: &'a [Slide],
    pub(super) free: &'a [FreeBody],
    pub(super) means: &'a [Mean],
}

impl Motions<'_> {
    /// The mean of others that a node at `X` \[m\] in the mesh is, if it is one.
    pub(super) fn mean(&self, node: u32, X: [f64; 3]) -> Option<Mean> {
        match self.motion[node as usize][0] {
            Motion::Rides(body) => Some(self.free[body].weights(X).to_vec()),
            Motion::Mean(of) => Some(self.means[of as usize].clone()),
            _ => None,
        }
    }

    /// The nodes whose displacements a node takes over.
    pub(super) fn leaders(&self, node: u32) -> Vec<u32> {
        let of = |motion: &Motion| match motion {
            Motion::Follows(leader) => vec![*leader],
            Motion::Slides(of) => self.slides[*of as usize].follows.iter().map(|f| f.0).collect(),
            Motion::Rides(body) => self.free[*body].frame.to_vec(),
            Motion::Mean(of) => self.means[*of as usize].iter().map(|(leader, _)| *leader).collect(),
            _ => Vec::new(),
        };
        self.motion[node as usize].iter().flat_map(of).collect()
    }
}

/// What one component of a node does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// It is an unknown.
    Free,
    /// It stays where it is in the mesh.
    Held,
    /// It is displaced by the value of a control times a length \[m\].
    Control(usize, f64),
    /// It moves with a body.
    Body(usize),
    /// Its displacement is that of the same component of a node.
    Follows(u32),
    /// It rides on a free body: index into [`Plan::free_bodies`](super::Plan::free_bodies).
    Rides(usize),
    /// It is a fixed mean of others, as its whole node is: index into [`Plan::means`](super::Plan::means).
    Mean(u32),
    /// It moves with its node, which slides in directions that are no axes: index into [`Plan::slides`](super::Plan::slides).
    Slides(u32),
}

impl Motion {
    /// Whether it is not prescribed altogether.
    pub fn is_unknown(&self) -> bool {
        match self {
            Motion::Free | Motion::Follows(_) | Motion::Slides(_) | Motion::Rides(_) | Motion::Mean(_) => {
                true
            }
            Motion::Held | Motion::Control(..) | Motion::Body(_) => false,
        }
    }

    /// Whether forces on it are, in part, those of a support.
    pub(super) fn is_support(&self) -> bool {
        !self.is_unknown() || matches!(self, Motion::Slides(_))
    }
}

/// The part of a `force` \[N\] on a node that its supports carry, by its `motion`, or by how it slides where it does.
pub(crate) fn on_supports(motion: &[Motion; 3], slide: Option<&Slide>, force: Vector3<f64>) -> Vector3<f64> {
    match slide {
        Some(slide) => slide.reaction(force),
        None => Vector3::from_fn(|c, _| if motion[c].is_unknown() { 0.0 } else { force[c] }),
    }
}

/// Values of the controls and poses of the bodies at one time, in the order of the plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Load {
    /// Controls.
    pub controls: Vec<f64>,
    /// Poses.
    pub poses: Vec<Pose>,
}

impl Load {
    /// Sets what is prescribed of the place `x` \[m\] of a node that is at `X` \[m\] in the mesh.
    pub fn prescribe(&self, motion: &[Motion; 3], X: &[f64; 3], x: &mut [f64; 3]) {
        for c in 0..3 {
            match motion[c] {
                Motion::Free
                | Motion::Follows(_)
                | Motion::Slides(_)
                | Motion::Rides(_)
                | Motion::Mean(_) => {}
                Motion::Held => x[c] = X[c],
                Motion::Control(control, u) => x[c] = X[c] + self.controls[control] * u,
                Motion::Body(b) => x[c] = (self.poses[b] * nalgebra::Point3::from(*X))[c],
            }
        }
    }

    /// The load a fraction `t` of the way to `end`; bodies turn about `pivots` \[m\] of the mesh.
    pub fn towards(&self, end: &Load, pivots: &[[f64; 3]], t: f64) -> Load {
        // Both ends exactly: frames of a run meet there.
        if t == 0.0 || t == 1.0 {
            return if t == 0.0 { self.clone() } else { end.clone() };
        }
        let pose = |i: usize| interpolate(&self.poses[i], &end.poses[i], pivots[i].into(), t);
        Load {
            controls: self.controls.iter().zip(&end.controls).map(|(a, b)| a + t * (b - a)).collect(),
            poses: (0..self.poses.len()).map(pose).collect(),
        }
    }
}
