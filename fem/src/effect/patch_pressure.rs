//! Follower pressure on a patch whose rim moves freely.
//!
//! The force on node a is p ∫ N_a n da over the patch as it is, as of any [`Pressure`]. With a free rim it is the gradient of no energy: its
//! derivative is symmetric inside the patch, but not along the rim. Schweizerhof & Ramm, Comput. Struct. 18 (1984) 1099.

use super::{Effect, Groups, Pressure, State};

/// Pressure on quadrilaterals; a triangle repeats its last node.
pub struct PatchPressure(Pressure);

impl PatchPressure {
    /// Name of the effect, but for the surface.
    pub const NAME: &str = "patch pressure on ";

    /// Pressure \[Pa\] held by the control with index `control` on `faces` (indices into `points` \[m\]), normals by the
    /// right-hand rule out of the solid.
    pub fn new(name: &str, control: usize, points: &[[f64; 3]], faces: &[[u32; 4]]) -> Self {
        PatchPressure(Pressure::new(name, control, points, faces.to_vec(), Default::default()))
    }
}

impl Effect for PatchPressure {
    fn groups(&self) -> &Groups {
        self.0.groups()
    }

    fn has_potential(&self) -> bool {
        false
    }

    fn energy(&self, _: &State) -> f64 {
        0.0
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        self.0.forces(s, first, out);
    }

    fn stiffness(&self, s: &State, convexity: f64, first: usize, out: &mut [f64]) {
        self.0.stiffness(s, convexity, first, out);
    }
}
