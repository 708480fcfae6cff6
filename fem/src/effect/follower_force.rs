//! A force that turns with a free body.

use super::{Effect, EffectKind, Groups, State, point};
use nalgebra::{Matrix3, Vector3};

/// The force c A f₀ at a point of an affine body with the map A, c the value of a control. It has no potential.
pub struct FollowerForce {
    groups: Groups,
    control: usize,
    weights: [f64; 4],
    force: Vector3<f64>,
    size: f64,
}

impl FollowerForce {
    /// The force `force` \[N\] at the point with these `weights` of the nodes of a `frame` of `size` \[m\]: see
    /// [`FreeBody`](crate::plan::FreeBody).
    pub fn new(
        name: &str,
        control: usize,
        frame: [u32; 4],
        weights: [f64; 4],
        force: [f64; 3],
        size: f64,
    ) -> FollowerForce {
        let groups = Groups::new(name, EffectKind::Load, &[frame], vec![[f64::NAN; 3]]);
        FollowerForce { groups, control, weights, force: force.into(), size }
    }

    /// ∂(A f₀)/∂x of each node is this times the identity.
    fn slopes(&self) -> [f64; 4] {
        let f = self.force / self.size;
        [-f.sum(), f[0], f[1], f[2]]
    }
}

impl Effect for FollowerForce {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    fn has_potential(&self) -> bool {
        false
    }

    fn energy(&self, _: &State) -> f64 {
        0.0
    }

    fn forces(&self, s: &State, _first: usize, out: &mut [f64]) {
        let [o, a, b, c] = self.groups.nodes::<4>(0).map(|n| Vector3::from(point(s.x, n)));
        let force = Matrix3::from_columns(&[a - o, b - o, c - o]) * self.force / self.size;
        for (out, w) in out.chunks_exact_mut(3).zip(self.weights) {
            (0..3).for_each(|i| out[i] = -s.controls[self.control] * w * force[i]);
        }
    }

    /// The symmetric part of −c w_p s_q I between nodes p and q.
    fn stiffness(&self, s: &State, _convexity: f64, _first: usize, out: &mut [f64]) {
        let (w, slopes) = (self.weights, self.slopes());
        out.fill(0.0);
        for p in 0..4 {
            for q in 0..4 {
                let k = -0.5 * s.controls[self.control] * (w[p] * slopes[q] + w[q] * slopes[p]);
                (0..3).for_each(|i| out[(3 * p + i) * 12 + 3 * q + i] = k);
            }
        }
    }
}
