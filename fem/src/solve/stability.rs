//! Is an equilibrium stable, and which way leads out of one that is not?

use super::Loading;
use super::newton::{Run, extent};

impl Run<'_> {
    /// Whether the Hessian at `x` is positive definite.
    pub(super) fn is_stable(&mut self, potential: &dyn Loading, x: &[f64]) -> bool {
        potential.hessian(x, 0.0, self.k);
        self.k.constrain(&self.fixed);
        self.report.factorizations += 1;
        self.linear.refactorize(self.k).is_ok()
    }

    /// Leaves an unstable equilibrium along its softest mode, found by inverse iteration with the shifted Hessian: by a
    /// thousandth of the extent of the island, less where that is inadmissible.
    pub(super) fn leave(&mut self, potential: &dyn Loading, x: &mut [f64], kick: usize) {
        let n = x.len();
        let mut shift = 1e-8;
        loop {
            potential.hessian(x, 0.0, self.k);
            self.k.constrain(&self.fixed);
            self.k.shift(shift);
            if self.linear.refactorize(self.k).is_ok() || shift > 10.0 {
                break;
            }
            shift *= 10.0;
        }
        // Any start that no symmetry of the mesh makes orthogonal to the mode.
        let mut mode: Vec<f64> =
            (0..n).map(|i| ((i * i + kick) as f64 * 0.754_877_666).fract() - 0.5).collect();
        for _ in 0..8 {
            for i in (0..n).filter(|&i| self.is_fixed(i)) {
                mode[i] = 0.0;
            }
            let rhs: Vec<f64> = (0..n).map(|i| mode[i] * self.k.diagonal(i)).collect();
            self.linear.apply(&rhs, &mut mode);
            let largest = mode.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            mode.iter_mut().for_each(|v| *v /= largest);
        }
        let mut size = 1e-3 * extent(x) * kick as f64;
        let mut trial = vec![0.0; n];
        let places = potential.touching(x);
        for _ in 0..20 {
            potential.go(x, &mode, size, &mut trial);
            if potential.energy(&trial).is_finite()
                && (places.is_empty() || potential.collision_free_step(&places, &trial) >= 1.0)
            {
                x.copy_from_slice(&trial);
                break;
            }
            size /= 2.0;
        }
        self.linear.forget();
        self.convexity.first();
    }
}
