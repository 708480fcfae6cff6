//! Parts of the potential that belong to an island as a whole and go along with its load, as contact and inertia do.

/// A part of the potential of an island over its local nodes; places `x` \[m\], 3 per node, prescribed ones included. An [`Effect`](super::Effect)
/// is a sum over groups that never change; what is not, or has a state that goes with the load, is one of these.
pub trait IslandTerm: Send + Sync {
    /// Π \[J\].
    fn energy(&self, x: &[f64]) -> f64;

    /// Adds ∂Π/∂x \[N\].
    fn add_gradient(&self, x: &[f64], g: &mut [f64]);

    /// ∂²Π/∂x∂x \[N/m\] as row-major blocks between local nodes, both triangles, ascending by (row, column); less the fraction `convexity` 0..=1
    /// of the negative curvatures, with 1 positive semi-definite.
    fn hessian(&self, x: &[f64], convexity: f64) -> Vec<([u32; 2], [f64; 9])>;

    /// Norm \[N\] of its forces in play; adds to `total` those that supports may have to carry.
    fn force_scale(&self, x: &[f64], total: &mut [f64]) -> f64;

    /// Goes with the load to the fraction `t` 0..=1 of its way.
    fn set_load(&mut self, _t: f64) {}

    /// Looks anew, at `x`, at what it holds while steps are tried; returns whether there is any. See [`Loading::renew`](crate::solve::Loading::renew).
    fn renew(&mut self, _x: &[f64]) -> bool {
        false
    }

    /// Whether bodies that nothing holds are held by it.
    fn holds_free_bodies(&self) -> bool {
        false
    }

    /// Whether the predictor may drag the free nodes along with bodies, through others too.
    fn may_be_predicted(&self) -> bool {
        true
    }

    /// Whether there are places that may not be passed through.
    fn keeps_apart(&self) -> bool {
        false
    }

    /// Greatest fraction 0..=1 of the straight way from the places `from` to `to` that it admits.
    fn collision_free_step(&self, _from: &[f64], _to: &[f64]) -> f64 {
        1.0
    }

    /// How far a node may go in one step \[m\].
    fn longest_step(&self) -> f64 {
        f64::INFINITY
    }

    /// Whether it can be softened, so that what it keeps apart may be passed through on the way to a guess.
    fn can_soften(&self) -> bool {
        false
    }

    /// Softens it below the fraction `softness` of the distance at which it begins; 0: it is itself again.
    fn soften(&mut self, _softness: f64) {}

    /// Whether anything that is kept apart is close or overlaps.
    fn meets(&self, _x: &[f64]) -> bool {
        false
    }

    /// Moves nodes at `x` for which `moves` is true until all is apart by the fraction `softness` of that distance; returns whether it is.
    fn untangle(&self, _x: &mut Vec<f64>, _softness: f64, _moves: &dyn Fn(u32) -> bool) -> bool {
        true
    }

    /// Seconds spent so far in what keeps surfaces apart.
    fn seconds(&self) -> f64 {
        0.0
    }
}
