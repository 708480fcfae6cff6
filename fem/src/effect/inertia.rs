//! Inertia over one time step.

use super::IslandTerm;

/// Inertia of an island over a time step h by backward Euler: Π = Σ m |x − x̂|² / 2h² with x̂ = x₀ + h v₀, whose minimum together
/// with the other effects has M (v − v₀) / h = f(x), v = (x − x₀) / h. First order in h; energy is lost, never created.
///
/// Source: Martin, Thomaszewski, Grinspun & Gross, Example-based elastic materials, ACM Trans. Graphics 30 (2011), section 4.
#[derive(Clone, Debug)]
pub struct TimeStep {
    /// m / h² of each component of each local node \[N/m\]; 0 where it is prescribed.
    stiffness: Vec<f64>,
    /// x₀ \[m\].
    start: Vec<f64>,
    /// h v₀ \[m\].
    flight: Vec<f64>,
    /// x₀ and the fraction of the flight that belongs to the present load \[m\].
    predicted: Vec<f64>,
}

impl TimeStep {
    /// From `start` \[m\] with `velocity` \[m/s\] over `h` \[s\]; all three per component of each local node, as `mass` \[kg\].
    pub fn new(h: f64, mass: Vec<f64>, start: Vec<f64>, velocity: &[f64]) -> TimeStep {
        let stiffness = mass.iter().map(|m| m / (h * h)).collect();
        let flight = velocity.iter().map(|v| h * v).collect();
        TimeStep { stiffness, predicted: start.clone(), start, flight }
    }
}

impl IslandTerm for TimeStep {
    fn energy(&self, x: &[f64]) -> f64 {
        let terms = self.stiffness.iter().zip(x.iter().zip(&self.predicted));
        terms.map(|(k, (x, p))| 0.5 * k * (x - p) * (x - p)).sum()
    }

    fn add_gradient(&self, x: &[f64], g: &mut [f64]) {
        for (i, g) in g.iter_mut().enumerate() {
            *g += self.stiffness[i] * (x[i] - self.predicted[i]);
        }
    }

    /// Constant and diagonal.
    fn hessian(&self, _x: &[f64], _convexity: f64) -> Vec<([u32; 2], [f64; 9])> {
        let diagonals = (0..).zip(self.stiffness.as_chunks::<3>().0);
        let has_mass = diagonals.filter(|(_, k)| k.iter().any(|k| *k > 0.0));
        has_mass.map(|(n, &[x, y, z])| ([n, n], [x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z])).collect()
    }

    /// The force that would stop all within the step; supports carry none of it.
    fn force_scale(&self, _x: &[f64], _total: &mut [f64]) -> f64 {
        let forces = self.stiffness.iter().zip(&self.flight).map(|(k, u)| k * u);
        forces.map(|f| f * f).sum::<f64>().sqrt()
    }

    /// While the load is carried over, time goes with it.
    fn set_load(&mut self, t: f64) {
        for ((p, x), u) in self.predicted.iter_mut().zip(&self.start).zip(&self.flight) {
            *p = x + t * u;
        }
    }

    fn holds_free_bodies(&self) -> bool {
        true
    }

    /// What flies is not dragged along, and what is passed through on the way would be a tunnel.
    fn may_be_predicted(&self) -> bool {
        false
    }
}
