//! A muscle of the thigh as one Hill-type unit: the lines of the rigid leg that belong to it, pulling together.
//!
//! The deformable muscle is solved in equilibrium at rest, so its force-length law is the isometric one of the rigid leg: fibre and
//! elastic tendon in balance ([`multibody::muscle::hill::equilibrium`]). What the velocity of the fibres does to the force at a gait step
//! comes in through the drive, the isometric activation that makes the same force at the same length.

use fem::scene::FibreLawSpec;
use multibody::muscle::MuscleTendon;
use multibody::muscle::curves::Curves;
use multibody::muscle::hill::{EquilibriumError, equilibrium};
use multibody::muscle::musculotendon::MusculotendonModel;
use nalgebra::Vector3;

use crate::steps::RigidMuscle;

/// Activations at which the law is tabulated. A lengthening fibre pulls up to 1.8 times as hard as one at rest
/// ([`multibody::muscle::curves::Thelen2003::f_len`]).
const ACTIVATIONS: [f64; 15] = [0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.2, 1.5, 1.8];
/// The greatest isometric activation that is tabulated.
pub const MOST_ACTIVE: f64 = ACTIVATIONS[ACTIVATIONS.len() - 1];
/// Samples of the law in length.
const LENGTHS: usize = 96;
/// Fibre lengths over which it is tabulated, in multiples of the optimal length.
const FIBRE_RANGE: [f64; 2] = [0.3, 1.9];

/// One line of a unit.
#[derive(Clone, Debug)]
struct Line {
    unit: &'static MuscleTendon,
    /// Fraction of its tension along the direction of the whole muscle.
    along: f64,
    /// Musculotendon length \[m\] of the generic leg.
    length: f64,
}

/// The lines of a muscle in a posture.
#[derive(Clone, Debug)]
pub struct MuscleUnit {
    lines: Vec<Line>,
    curves: Curves,
}

impl MuscleUnit {
    /// The lines of a muscle where `muscle` has them; with the curves of the rigid leg.
    pub fn new(muscle: &RigidMuscle, curves: Curves) -> MuscleUnit {
        let units = &MusculotendonModel::generic().units;
        let together: Vector3<f64> = muscle.lines.iter().map(|l| l.f_max * l.direction()).sum();
        let lines = muscle.lines.iter().map(|l| Line {
            unit: units.iter().find(|u| u.short_name == l.name).expect("tables agree"),
            along: l.direction().dot(&together.normalize()),
            length: l.length,
        });
        MuscleUnit { lines: lines.collect(), curves }
    }

    /// Isometric force \[N\] along the muscle with all lines longer by `shift` \[m\], at activation `a`.
    pub fn force(&self, shift: f64, a: f64) -> f64 {
        let line = |l: &Line| l.along * isometric(l.unit, &self.curves, l.length + shift, a);
        self.lines.iter().map(line).sum()
    }

    /// Isometric force \[N\] at activation `a` and at the lengths that the lines have in another posture.
    pub fn force_at(&self, posture: &RigidMuscle, a: f64) -> f64 {
        let forces = self.lines.iter().zip(&posture.lines);
        forces.map(|(l, at)| l.along * isometric(l.unit, &self.curves, at.length, a)).sum()
    }

    /// The isometric activation at which the lines make, at the lengths of a step, the force that the Hill model of the rigid leg gives
    /// them there; 0 where their passive force alone is greater. `None` beyond 1.8, where no fibre pulls.
    ///
    /// A line at rest counts with its passive force in balance with its tendon: the rigid leg reads the fibre's length off a tendon that
    /// carries the shared force, which is nothing there.
    pub fn drive(&self, step: &RigidMuscle) -> Option<f64> {
        let line = |(l, at): (&Line, &crate::steps::RigidLine)| match at.activation {
            0.0 => isometric(l.unit, &self.curves, at.length, 0.0),
            _ => at.hill_force,
        };
        let wanted: f64 = self.lines.iter().zip(&step.lines).map(|pair| pair.0.along * line(pair)).sum();
        let force = |a: f64| self.force_at(step, a);
        (force(MOST_ACTIVE) >= wanted).then(|| activation(force, wanted))
    }

    /// The isometric activation that makes `wanted` \[N\] with all lines longer by `shift` \[m\], the nearest one where none does.
    pub fn drive_for(&self, shift: f64, wanted: f64) -> f64 {
        activation(|a| self.force(shift, a), wanted)
    }

    /// Mean over the lines, weighted with their strength, of fibre lengths along the tendon (musculotendon length less slack tendon)
    /// \[m\] with all lines longer by `shift` \[m\].
    pub fn fibre_length(&self, shift: f64) -> f64 {
        let strength: f64 = self.lines.iter().map(|l| l.unit.f_max).sum();
        self.lines.iter().map(|l| l.unit.f_max * (l.length + shift - l.unit.l_ts)).sum::<f64>() / strength
    }

    /// The same at the lengths that the lines have in another posture.
    pub fn fibre_length_at(&self, posture: &RigidMuscle) -> f64 {
        let strength: f64 = self.lines.iter().map(|l| l.unit.f_max).sum();
        let lines = self.lines.iter().zip(&posture.lines);
        lines.map(|(l, at)| l.unit.f_max * (at.length - l.unit.l_ts)).sum::<f64>() / strength
    }

    /// Range of `shift` \[m\] over which some line has its fibre within [`FIBRE_RANGE`].
    fn range(&self) -> [f64; 2] {
        let at =
            |k: usize| self.lines.iter().map(move |l| l.unit.l_ts + FIBRE_RANGE[k] * l.unit.l_opt - l.length);
        [at(0).fold(f64::INFINITY, f64::min), at(1).fold(f64::NEG_INFINITY, f64::max)]
    }

    /// The law of fibres of section `area` \[m²\] and mean length `length` \[m\] in the mesh of which the leg is `scale` times as long as
    /// the generic one. The fit says at which stretch they are as long as the lines of this unit, and how many times harder than the
    /// section's force they have to pull.
    ///
    /// The fibres of the mesh run from end to end. All of their change of length is one of the muscle-tendon unit, so a fibre that is
    /// l_opt long on the rigid leg shortens by Δl/l_opt, not by the strain of the mesh.
    pub fn law(&self, area: f64, length: f64, scale: f64, fit: &Fit) -> FibreLawSpec {
        let stretch_of = |shift: f64| fit.rest + shift * scale / length;
        let [from, to] = self.range();
        let shifts = (0..LENGTHS).map(|k| from + (to - from) * k as f64 / (LENGTHS - 1) as f64);
        let shifts: Vec<f64> = shifts.filter(|s| stretch_of(*s) > 0.05).collect();
        let stress = |a: f64| shifts.iter().map(|s| fit.gain * self.force(*s, a).max(0.0) / area).collect();
        FibreLawSpec::ForceLength {
            stretch: shifts.iter().map(|s| stretch_of(*s)).collect(),
            activation: ACTIVATIONS.to_vec(),
            stress: ACTIVATIONS.map(stress).to_vec(),
        }
    }
}

/// What the calibration of a muscle finds.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Fit {
    /// Stretch of the fibres, taut in the posture of the mesh, at which the lines of the rigid leg are as long as there.
    pub rest: f64,
    /// Tension of all fibres over force through the belly.
    pub gain: f64,
}

impl Default for Fit {
    fn default() -> Fit {
        Fit { rest: 1.0, gain: 1.0 }
    }
}

/// The activation from 0 to the most at which `force` is `wanted` \[N\], or that end of the range that is nearest to it. Force grows with
/// activation: bisection down to the resolution of the force.
fn activation(force: impl Fn(f64) -> f64, wanted: f64) -> f64 {
    let (mut low, mut high) = (0.0, MOST_ACTIVE);
    if force(low) >= wanted {
        return low;
    }
    if force(high) <= wanted {
        return high;
    }
    for _ in 0..48 {
        let middle = 0.5 * (low + high);
        if force(middle) < wanted {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Isometric force \[N\] of fibre and elastic tendon; none where the path is too short for the tendon to be taut.
fn isometric(unit: &MuscleTendon, curves: &Curves, length: f64, a: f64) -> f64 {
    match equilibrium(unit, curves, length, 0.0, a) {
        Ok(found) => found.force,
        Err(EquilibriumError::Slack { .. } | EquilibriumError::FibreTooShort { .. }) => 0.0,
        Err(_) => f64::NAN,
    }
}
