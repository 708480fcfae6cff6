//! What the solver asks of an island: its potential, what is admissible, and how its load is carried on. It knows no more mechanics than that.

use super::{BlockMatrix, Pattern};
use std::sync::Arc;

/// The total potential Π of one island as a function of its unknowns.
///
/// The unknowns `x` are the current positions \[m\] of the free nodes, node-major (x₀ y₀ z₀ x₁ …). A node all of whose
/// components are prescribed is no free node: it is kept inside the potential. A node with one or two
/// prescribed components (a roller) is a free node; its prescribed components are named by
/// [`fixed`](Potential::fixed). `gradient` and `hessian` fill them like any other: the solver leaves them out.
pub trait Potential: Send + Sync {
    /// Number of unknowns, three per free node.
    fn n_unknowns(&self) -> usize {
        3 * self.pattern().n_nodes()
    }

    /// Which free nodes are coupled; built once (a new `Arc` makes the solver analyse it again).
    fn pattern(&self) -> &Arc<Pattern>;

    /// Unknowns that are prescribed and only move with the load, one flag per unknown; empty: none.
    fn fixed(&self) -> &[bool] {
        &[]
    }

    /// Π \[J\]; `+∞` where inadmissible (an inverted element), so that the line search backs off.
    fn energy(&self, x: &[f64]) -> f64;

    /// g = ∂Π/∂x \[N\]; overwrites `g`. Needs finite energy.
    fn gradient(&self, x: &[f64], g: &mut [f64]);

    /// K = ∂²Π/∂x² \[N/m\]; overwrites `k`, which has this potential's pattern. Needs finite energy.
    ///
    /// `convexity` 0..=1: every term's own Hessian loses that fraction of its negative curvatures; with 1 the sum is positive
    /// semi-definite.
    fn hessian(&self, x: &[f64], convexity: f64, k: &mut BlockMatrix);

    /// Diagonal 3×3 blocks of the Hessian \[N/m\], 9 values row-major per free node, of terms that have lost all their negative curvatures,
    /// and with strands and fibres with a toe that are slack as stiff as taut ones (not where nodes are means of others); overwrites `blocks`.
    /// Solvers without matrices measure nodes by them.
    fn diagonal_blocks(&self, x: &[f64], blocks: &mut [f64]) {
        let mut k = BlockMatrix::zeros(self.pattern().clone());
        self.hessian(x, 1.0, &mut k);
        for (node, block) in blocks.as_chunks_mut::<9>().0.iter_mut().enumerate() {
            *block = *k.diagonal_block(node);
        }
    }

    /// Unknowns that are [`fixed`](Potential::fixed) because they take over the displacement of another: both.
    fn followers(&self) -> Vec<[usize; 2]> {
        Vec::new()
    }

    /// Where `x` comes by the fraction `length` of a step `dx`: x + length · dx, but for parts that turn, which come near it along a curve.
    fn go(&self, x: &[f64], dx: &[f64], length: f64, out: &mut [f64]) {
        for i in 0..x.len() {
            out[i] = x[i] + length * dx[i];
        }
    }

    /// Whether [`go`](Potential::go) leads along curves.
    fn is_curved(&self) -> bool {
        false
    }

    /// Norm \[N\] of the forces in play, the scale of the residual: reactions of the prescribed unknowns
    /// (fully and partly prescribed nodes), external and active forces.
    fn force_scale(&self, x: &[f64]) -> f64;

    /// Whether it holds bodies that have no support, as inertia does.
    fn holds_free_bodies(&self) -> bool {
        false
    }

    /// Name of a free node for messages, e.g. ``node 12 of `rectus_femoris` ``.
    fn node_name(&self, free_node: usize) -> String {
        format!("free node {free_node}")
    }
}

/// What positions of the free nodes are admissible, and which ways between them.
pub trait Admissible: Send + Sync {
    /// Least det F over all integration points, and where: e.g. ``element 17 in `vastus_lateralis` ``.
    fn least_det_f(&self, x: &[f64]) -> (f64, String);

    /// Places \[m\] of all that may touch, at `x` and the present load; empty where nothing can.
    fn touching(&self, _x: &[f64]) -> Vec<f64> {
        Vec::new()
    }

    /// How far a node may go in one step of Newton's method \[m\].
    fn longest_step(&self) -> f64 {
        f64::INFINITY
    }

    /// Greatest fraction 0..=1 of the straight way from the places `from` ([`touching`](Admissible::touching)) to those at `x` and
    /// the present load on which nothing touches.
    fn collision_free_step(&self, _from: &[f64], _x: &[f64]) -> f64 {
        1.0
    }

    /// Seconds spent so far in what keeps surfaces apart.
    fn contact_seconds(&self) -> f64 {
        0.0
    }
}

/// A potential that depends on a load parameter t: prescribed positions, activations, pressures, gravity.
pub trait Loading: Potential + Admissible {
    /// Sets everything prescribed to its value at `t` in 0..=1, and the [`fixed`](Potential::fixed) components of `x`.
    ///
    /// Must be a smooth function of `t`: the solver differentiates the gradient with respect to it by a small
    /// step and predicts how the free nodes follow.
    fn set_load(&mut self, t: f64, x: &mut [f64]);

    /// Looks anew, at `x`, at loads that have no potential, and at which surfaces that overlap face which way; until the next time the potential
    /// holds a model of them whose gradient is true there. Returns whether there are any.
    fn renew(&mut self, _x: &[f64]) -> bool {
        false
    }

    /// Whether anything prescribed moves between the present load and that at `t`; forces alone may change.
    fn displaces(&self, _t: f64) -> bool {
        true
    }

    /// In how many pieces [`predict`](Loading::predict) should go from the present load to that at `t`; 0: it has no better guess
    /// than to leave the free nodes where they are.
    fn n_pieces(&self, _t: f64) -> usize {
        0
    }

    /// Whether places at the load `t` are guessed: those of the end are, or none.
    fn is_guessed(&self, _t: f64) -> bool {
        false
    }

    /// What was guessed of the way led astray; returns whether there was a guess.
    fn forget_guess(&mut self) -> bool {
        false
    }

    /// Softens what keeps surfaces apart below the fraction `softness` of the distance at which it begins, so that they may penetrate each
    /// other on the way to a guess; 0: it is itself again. Returns whether it can.
    fn soften(&mut self, _softness: f64) -> bool {
        false
    }

    /// Whether anything that is kept apart is close or overlaps at `x`.
    fn meets(&self, _x: &[f64]) -> bool {
        true
    }

    /// Moves the nodes at `x` apart where surfaces are closer than the fraction `softness` of the distance at which what keeps them apart begins;
    /// returns whether nothing is any more.
    fn untangle(&self, _x: &mut [f64], _softness: f64) -> bool {
        true
    }

    /// Places \[m\] by which [`keeps_sides`](Loading::keeps_sides) tells who is on which side of whom, at `x` and the present load.
    fn sides(&self, _x: &[f64]) -> Vec<f64> {
        Vec::new()
    }

    /// Whether nobody goes through anybody on the straight way from the places `from` ([`sides`](Loading::sides)) to those at `x` and the
    /// present load.
    fn keeps_sides(&self, _from: &[f64], _x: &[f64]) -> bool {
        true
    }

    /// Sets the load at `t` and moves the free nodes `x`, which belong to the present load, along as a guess.
    fn predict(&mut self, t: f64, x: &mut [f64]) {
        self.set_load(t, x);
    }
}
