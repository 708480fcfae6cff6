//! Force sharing informed by electromyography: of all sharings that carry the moments, one whose muscles pull when they are excited.
//!
//! A muscle with a channel costs w_f (f² + W (f − f_emg)²) in place of w_f f², with f_emg the force that its envelope e says, between those
//! at rest and at full activation: f_emg = least + s e (greatest − least). W is the weight: at 1 it costs as much to be off the
//! electromyogram by some force as that force costs. Moments and bounds hold as without it.
//!
//! An electromyogram has no scale of its own, so e is a fraction of its largest value, and all channels are taken to reach the same
//! activation s: the one with which f_emg is nearest, in least squares of all frames and muscles with a channel, to what sharing alone says.
//!
//! Balancing electromyograms with optimization: Sartori, Farina & Lloyd, J Biomech 2014;47:3613; there moments may be missed, here not.

use nalgebra::{DMatrix, DVector};

use crate::emg::Compared;
use crate::sharing::{Capacity, SharingProblem};
use crate::trial::{Effort, Table};

/// What electromyography says of forces.
#[derive(Clone, Debug, PartialEq)]
pub struct Informed {
    /// How much it costs to be off it, relative to the cost of force.
    pub weight: f64,
    /// Activation that every channel reaches, 0..1.
    pub activation: f64,
    /// Forces that the envelopes say \[N\], a row per reported frame; a column per muscle with a channel.
    pub forces: Table,
    /// Numbers of these muscles.
    pub muscles: Vec<usize>,
}

impl Informed {
    /// From channels without defect, and forces that were shared without them; `None` where there is no such channel or no frame is solved.
    ///
    /// `capacity`: that of a reported frame. A muscle with two channels has the mean of their envelopes.
    pub fn new<'a>(
        compared: &[Compared],
        effort: &Effort,
        capacity: impl Fn(usize) -> &'a Capacity,
        weight: f64,
    ) -> Option<Informed> {
        let good: Vec<&Compared> = compared.iter().filter(|c| c.defect.is_none()).collect();
        let names = &effort.forces.columns;
        let has_channel = |m: &usize| good.iter().any(|c| c.muscles.contains(&names[*m]));
        let muscles: Vec<usize> = (0..names.len()).filter(has_channel).collect();
        let envelope = |m: usize, frame: usize| {
            let of_muscle = good.iter().filter(|c| c.muscles.contains(&names[m]));
            let (sum, n) = of_muscle.fold((0.0, 0.0), |(sum, n), c| (sum + c.envelope[frame], n + 1.0));
            sum / n
        };
        let n_frames = effort.time.len();
        let (mut alike, mut own) = (0.0, 0.0);
        for frame in 0..n_frames {
            for &m in &muscles {
                let [least, greatest] = capacity(frame).bounds[m];
                let (says, found) =
                    (envelope(m, frame) * (greatest - least), effort.forces.values[(frame, m)]);
                if found.is_finite() {
                    alike += says * (found - least);
                    own += says * says;
                }
            }
        }
        if own == 0.0 {
            return None;
        }
        let activation = (alike / own).clamp(0.0, 1.0);
        let force = |frame: usize, j: usize| {
            let [least, greatest] = capacity(frame).bounds[muscles[j]];
            least + activation * envelope(muscles[j], frame) * (greatest - least)
        };
        let values = DMatrix::from_fn(n_frames, muscles.len(), force);
        let columns = muscles.iter().map(|&m| names[m].clone()).collect();
        Some(Informed { weight, activation, forces: Table { columns, values }, muscles })
    }

    /// Makes the cost of a reported frame heed it.
    pub fn inform(&self, frame: usize, problem: &mut SharingProblem) {
        let mut target = DVector::zeros(problem.n_muscles());
        for (j, &m) in self.muscles.iter().enumerate() {
            // w f² + w W (f − g)² = w (1 + W) (f − g W / (1 + W))² + what no force changes
            problem.w_f[m] *= 1.0 + self.weight;
            target[m] = self.forces.values[(frame, j)] * self.weight / (1.0 + self.weight);
        }
        problem.target_f = Some(target);
    }
}
