//! How an island moved in time, and what its energies came to.

use serde::{Deserialize, Serialize};

/// How an island moved during a frame.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Motion {
    /// Time steps.
    pub steps: usize,
    /// Time steps that were taken back, as they turned out too long for the stiffness at their end.
    pub repeated: usize,
    /// Shortest time step \[s\], the last one left out.
    pub time_step: f64,
    /// Time step that needs no mass to be added \[s\].
    pub natural_step: f64,
    /// Mass of what can move \[kg\].
    pub mass: f64,
    /// Mass added to it, at most, mean of the three directions \[kg\].
    pub added_mass: f64,
    /// Largest kinetic energy on the way of the added mass alone \[J\].
    pub added_kinetic: f64,
    /// Kinetic energy at the end \[J\], of the added mass too.
    pub kinetic: f64,
    /// Potential energy gained \[J\].
    pub stored: f64,
    /// Energy that damping took \[J\].
    pub dissipated: f64,
    /// Work of what is prescribed: motions, activations, loads \[J\].
    pub work: f64,
    /// What central differences keep less than kinetic and stored energy, end less start: h²/8 (a·Ma) of a step h \[J\].
    pub lag: f64,
    /// Kinetic energy at the start, and what mass that comes or goes on the way brings \[J\].
    pub kinetic_before: f64,
    /// Largest kinetic energy on the way \[J\].
    pub largest_kinetic: f64,
}

/// Kinetic energy of the added mass beside all of it from which on it is said: a twentieth, as what is taken for slow may have beside what is
/// stored. Mass that hardly moves, as at the end of a tendon, changes nothing.
pub const HEAVY: f64 = 0.05;

impl Motion {
    /// Time steps, those taken back among them.
    pub fn taken(&self) -> usize {
        self.steps + self.repeated
    }

    /// Energy at the end that nothing accounts for \[J\].
    pub fn missing(&self) -> f64 {
        self.kinetic + self.stored + self.dissipated - self.work - self.kinetic_before - self.lag
    }

    /// The energies in play \[J\].
    pub fn in_play(&self) -> f64 {
        [self.largest_kinetic, self.stored.abs(), self.dissipated, self.work.abs()]
            .into_iter()
            .fold(0.0, f64::max)
    }

    /// Added mass relative to the mass of what can move.
    pub fn added(&self) -> f64 {
        if self.mass > 0.0 { self.added_mass / self.mass } else { 0.0 }
    }

    /// What is to be said of mass that changes the motion; `None`: nothing.
    pub fn warning(&self) -> Option<String> {
        (self.added_kinetic > HEAVY * self.largest_kinetic).then(|| {
            format!(
                "steps of {:.1e} s, {:.0} times as long as the material bears, take {:.1e} kg more, {:.0} % of the mass that can move, \
                 which has {:.0} % of the kinetic energy: what is fast is wrong, and rest comes later; a smaller `time_step_factor` takes less",
                self.time_step,
                self.time_step / self.natural_step,
                self.added_mass,
                100.0 * self.added(),
                100.0 * self.added_kinetic / self.largest_kinetic
            )
        })
    }
}
