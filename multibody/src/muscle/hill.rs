//! From tendon force to activation and back: a Hill-type muscle in series with its tendon.
//!
//! ```text
//! F = f_max (a f_L(L) f_V(V) + f_P(L)) cos α,   l sin α = l_opt sin α₀,   l_mt = l_t + l cos α
//! ```
//!
//! Zajac, Crit Rev Biomed Eng 1989;17:359 (fibre of constant height); curves in [`super::curves`]. The tendon
//! force is given, so tendon, fibre and activation follow one after the other without iteration.

#![allow(non_snake_case)]

use nalgebra::DMatrix;
use thiserror::Error;

use super::MuscleTendon;
use super::curves::Curves;
use crate::filter::{LowPass, differentiate};

/// Fibre lengths outside this range (multiples of l_opt) are limited to it before the curves are read.
pub const LENGTH_RANGE: (f64, f64) = (0.4, 1.6);

/// Least cos α; OpenSim's limit of the pennation angle (MuscleFixedWidthPennationModel, arccos 0.1 = 84.3°).
const LEAST_COS: f64 = 0.1;

/// Shortest fibre an equilibrium is looked for at, in multiples of l_opt (as in OpenSim's Thelen2003Muscle).
const SHORTEST_FIBRE: f64 = 0.01;

/// Steps in which an equilibrium is bracketed.
const SHORTENING_STEPS: usize = 64;

/// An activation counts as clipped when it is outside 0..1 by more than this, which is above solver round-off.
const CLIPPING: f64 = 1e-6;

/// How the tendon follows its force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tendon {
    /// Always at slack length; good for short tendons.
    Rigid,
    /// Along its force-strain curve.
    Elastic,
}

/// Where the fibre velocity comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FibreVelocity {
    /// V = 0 in every frame: a comparison that needs no derivative.
    Isometric,
    /// Central differences of the fibre length as it is, for data that are smooth already.
    Differences,
    /// Central differences of the fibre length after [`LowPass`], applied to each uninterrupted stretch of frames.
    LowPass {
        /// Cut-off frequency \[Hz\].
        cutoff_hz: f64,
    },
}

/// Choices of the way from force to activation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The curves.
    pub curves: Curves,
    /// The tendon.
    pub tendon: Tendon,
    /// The fibre velocity.
    pub velocity: FibreVelocity,
}

impl Default for Settings {
    /// Set A as in the gait2392 model, elastic tendon, fibre length filtered at 5 Hz (Moissenet et al.,
    /// Multibody Syst Dyn 2012;28:125, for all derivatives).
    fn default() -> Self {
        let velocity = FibreVelocity::LowPass { cutoff_hz: 5.0 };
        Self { curves: Curves::default(), tendon: Tendon::Elastic, velocity }
    }
}

/// Why no activations were computed.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum HillError {
    /// Lengths, forces and muscles do not belong together.
    #[error(
        "{n_muscles} muscles need {n_muscles} columns and equal rows: lengths are {lengths:?}, forces {forces:?}"
    )]
    Shape {
        /// Number of muscles.
        n_muscles: usize,
        /// Rows and columns of the lengths.
        lengths: (usize, usize),
        /// Rows and columns of the forces.
        forces: (usize, usize),
    },
    /// The frame rate is no rate.
    #[error("frame rate is {0} Hz, expected a positive number")]
    Rate(f64),
    /// No such low-pass filter.
    #[error(
        "cut-off {cutoff_hz} Hz of the fibre length must be positive and below half the frame rate of {rate} Hz"
    )]
    Cutoff {
        /// Cut-off asked for \[Hz\].
        cutoff_hz: f64,
        /// Frame rate \[Hz\].
        rate: f64,
    },
    /// A muscle has no force at its length.
    #[error(transparent)]
    Equilibrium(#[from] EquilibriumError),
}

/// How many samples hit a limit, as fractions 0..1 of the samples that could be computed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fractions {
    /// Samples that could be computed.
    pub n_samples: usize,
    /// Activation clipped at 0: mostly a resting muscle with passive force, which the force sharing does not know.
    pub below_zero: f64,
    /// Activation clipped at 1.
    pub above_one: f64,
    /// Fibre length limited to [`LENGTH_RANGE`].
    pub length_limited: f64,
    /// Single frames between missing ones: no derivative exists, V = 0 was used.
    pub without_velocity: f64,
}

/// Activations of a trial; all matrices n_frames × n_muscles, NaN where force or length was not finite.
#[derive(Clone, Debug, PartialEq)]
pub struct HillResult {
    /// Activation, clipped to 0..1.
    pub activation: DMatrix<f64>,
    /// Activation as computed.
    pub unclipped: DMatrix<f64>,
    /// Fibre length L, in multiples of l_opt.
    pub fibre_length: DMatrix<f64>,
    /// Fibre velocity V, in multiples of v_max l_opt, lengthening positive.
    pub fibre_velocity: DMatrix<f64>,
    /// Clipping per muscle.
    pub fractions: Vec<Fractions>,
    /// Clipping over all muscles.
    pub overall: Fractions,
}

/// Activations from musculotendon lengths \[m\] and tendon forces \[N\], both n_frames × n_muscles in the order of
/// `units`, at `rate` frames per second.
pub fn activations(
    units: &[MuscleTendon],
    lengths: &DMatrix<f64>,
    forces: &DMatrix<f64>,
    rate: f64,
    settings: &Settings,
) -> Result<HillResult, HillError> {
    let n_muscles = units.len();
    let (n_frames, n_columns) = lengths.shape();
    if n_columns != n_muscles || forces.shape() != lengths.shape() {
        return Err(HillError::Shape { n_muscles, lengths: lengths.shape(), forces: forces.shape() });
    }
    if !(rate > 0.0 && rate.is_finite()) {
        return Err(HillError::Rate(rate));
    }
    let filter = match settings.velocity {
        FibreVelocity::LowPass { cutoff_hz } => {
            Some(LowPass::new(cutoff_hz, rate).ok_or(HillError::Cutoff { cutoff_hz, rate })?)
        }
        _ => None,
    };
    let missing = DMatrix::from_element(n_frames, n_muscles, f64::NAN);
    let mut result = HillResult {
        activation: missing.clone(),
        unclipped: missing.clone(),
        fibre_length: missing.clone(),
        fibre_velocity: missing,
        fractions: Vec::with_capacity(n_muscles),
        overall: Fractions::default(),
    };
    let mut total = Counts::default();
    for (m, unit) in units.iter().enumerate() {
        let mut counts = Counts::default();
        let computable = |i: usize| lengths[(i, m)].is_finite() && forces[(i, m)].is_finite();
        for frames in stretches(n_frames, computable) {
            let L: Vec<f64> = (frames.clone())
                .map(|i| {
                    let along = lengths[(i, m)] - tendon_length(unit, settings, forces[(i, m)]);
                    let (L, limited) = fibre_length(unit, along);
                    counts.length_limited += usize::from(limited);
                    L
                })
                .collect();
            let V = if settings.velocity == FibreVelocity::Isometric {
                vec![0.0; L.len()]
            } else {
                counts.without_velocity += usize::from(L.len() == 1);
                let step = unit.v_max / rate;
                match &filter {
                    Some(filter) => differentiate(&filter.apply(&L), step),
                    None => differentiate(&L, step),
                }
            };
            for (k, i) in frames.enumerate() {
                let a = activation(unit, &settings.curves, forces[(i, m)], L[k], V[k]);
                counts.samples += 1;
                counts.below_zero += usize::from(a < -CLIPPING);
                counts.above_one += usize::from(a > 1.0 + CLIPPING);
                result.unclipped[(i, m)] = a;
                result.activation[(i, m)] = a.clamp(0.0, 1.0);
                result.fibre_length[(i, m)] = L[k];
                result.fibre_velocity[(i, m)] = V[k];
            }
        }
        result.fractions.push(counts.fractions());
        total.add(&counts);
    }
    result.overall = total.fractions();
    Ok(result)
}

/// Tendon force \[N\] at activation `a`, fibre length `L` (× l_opt) and velocity `V` (× v_max l_opt).
pub fn tendon_force(unit: &MuscleTendon, curves: &Curves, a: f64, L: f64, V: f64) -> f64 {
    let active = a * curves.active_length(L).f * curves.velocity(V, a).f;
    unit.f_max * (active + curves.passive(L).f) * cos_pennation(unit, L)
}

/// Force \[N\] of a muscle with a rigid tendon at musculotendon length `l_mt` \[m\], velocity `v_mt` \[m/s\] and activation `a`; the fibre
/// length is limited to [`LENGTH_RANGE`].
pub fn rigid_tendon_force(unit: &MuscleTendon, curves: &Curves, l_mt: f64, v_mt: f64, a: f64) -> f64 {
    let (L, _) = fibre_length(unit, l_mt - unit.l_ts);
    let V = v_mt * cos_pennation(unit, L) / (unit.v_max * unit.l_opt);
    tendon_force(unit, curves, a, L, V).max(0.0)
}

/// Force \[N\] of a muscle whose fibre is as short as [`LENGTH_RANGE`] counts it, at velocity `v_mt` \[m/s\] and activation `a`.
pub fn shortest_fibre_force(unit: &MuscleTendon, curves: &Curves, v_mt: f64, a: f64) -> f64 {
    let L = shortest_fibre(unit, LENGTH_RANGE.0);
    let V = v_mt * cos_pennation(unit, L) / (unit.v_max * unit.l_opt);
    tendon_force(unit, curves, a, L, V).max(0.0)
}

/// The activation at which the tendon force is `force` \[N\], not clipped; inverse of [`tendon_force`].
///
/// Where the passive force alone exceeds the tendon's, the excess in multiples of the isometric active force, negative.
pub fn activation(unit: &MuscleTendon, curves: &Curves, force: f64, L: f64, V: f64) -> f64 {
    let along_fibre = force / (unit.f_max * cos_pennation(unit, L));
    curves.activation((along_fibre - curves.passive(L).f) / curves.active_length(L).f, V)
}

/// A fibre in balance with its tendon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Equilibrium {
    /// Fibre length L, in multiples of l_opt.
    pub fibre_length: f64,
    /// Fibre velocity V, in multiples of v_max l_opt.
    pub fibre_velocity: f64,
    /// Tendon length \[m\].
    pub tendon_length: f64,
    /// Tendon force \[N\].
    pub force: f64,
    /// Fibre force along the tendon less tendon force \[N\].
    pub residual: f64,
}

/// Why a fibre has no equilibrium with its tendon.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum EquilibriumError {
    /// The path is shorter than the slack tendon and the shortest fibre together.
    #[error("muscle `{muscle}`: length {l_mt} m is below slack tendon and shortest fibre, {shortest} m")]
    Slack {
        /// Name of the muscle.
        muscle: String,
        /// Musculotendon length \[m\].
        l_mt: f64,
        /// Least length at which the tendon can be taut \[m\].
        shortest: f64,
    },
    /// The fibre overcomes the tendon at every length it can have.
    #[error(
        "muscle `{muscle}`: at length {l_mt} m and activation {a} the fibre pulls harder than the tendon down to \
         its shortest, {shortest_fibre} l_opt"
    )]
    FibreTooShort {
        /// Name of the muscle.
        muscle: String,
        /// Musculotendon length \[m\].
        l_mt: f64,
        /// Activation.
        a: f64,
        /// Shortest fibre, in multiples of l_opt.
        shortest_fibre: f64,
    },
    /// An argument is NaN, infinite or so large that forces overflow, or the activation is negative.
    #[error(
        "muscle `{muscle}`: length {l_mt} m, velocity {v_mt} m/s and activation {a} must be finite, of a muscle's size, a ≥ 0"
    )]
    Argument {
        /// Name of the muscle.
        muscle: String,
        /// Musculotendon length \[m\].
        l_mt: f64,
        /// Musculotendon velocity \[m/s\].
        v_mt: f64,
        /// Activation.
        a: f64,
    },
}

/// Fibre length at which fibre and elastic tendon carry the same force, at musculotendon length `l_mt` \[m\], velocity
/// `v_mt` \[m/s\] and activation `a`; the tendon's own velocity is taken as zero, v = v_mt cos α.
///
/// The fibre starts where the tendon is just slack and shortens in steps until the tendon holds it; bisection of that
/// step down to neighbouring numbers cannot diverge. Where several equilibria exist this is a stable one, the first
/// that a contracting fibre meets (up to the step, a 64th of the way to the shortest fibre).
pub fn equilibrium(
    unit: &MuscleTendon,
    curves: &Curves,
    l_mt: f64,
    v_mt: f64,
    a: f64,
) -> Result<Equilibrium, EquilibriumError> {
    let muscle = || unit.name.clone();
    if !(l_mt.is_finite() && v_mt.is_finite() && a.is_finite() && a >= 0.0) {
        return Err(EquilibriumError::Argument { muscle: muscle(), l_mt, v_mt, a });
    }
    let height = unit.l_opt * unit.pennation.sin();
    let at = |along: f64| {
        let l = along.hypot(height);
        let (L, cos) = (l / unit.l_opt, along / l);
        let V = v_mt * cos / (unit.v_max * unit.l_opt);
        let tendon_length = l_mt - along;
        let force = unit.f_max * curves.tendon(tendon_length / unit.l_ts - 1.0).f;
        let active = a * curves.active_length(L).f * curves.velocity(V, a).f;
        let fibre_force = unit.f_max * (active + curves.passive(L).f) * cos;
        Equilibrium {
            fibre_length: L,
            fibre_velocity: V,
            tendon_length,
            force,
            residual: fibre_force - force,
        }
    };
    let shortest = shortest_fibre(unit, SHORTEST_FIBRE);
    let short = ((shortest * unit.l_opt).powi(2) - height * height).sqrt();
    let slack = l_mt - unit.l_ts * (1.0 + curves.tendon_strain(0.0));
    if slack < short {
        let shortest = l_mt - slack + short;
        return Err(EquilibriumError::Slack { muscle: muscle(), l_mt, shortest });
    }
    // From the slack tendon on the fibre shortens until the tendon is the stronger.
    let step = |k: usize| slack + (short - slack) * k as f64 / SHORTENING_STEPS as f64;
    let Some(k) = (0..=SHORTENING_STEPS).find(|&k| at(step(k)).residual <= 0.0) else {
        return Err(EquilibriumError::FibreTooShort { muscle: muscle(), l_mt, a, shortest_fibre: shortest });
    };
    // Invariant of the bisection: the tendon is not the weaker at `short`, the fibre the stronger at `long`.
    let (mut short, mut long) = (step(k), step(k.max(1) - 1));
    loop {
        let middle = 0.5 * (short + long);
        if middle <= short || middle >= long {
            break;
        }
        if at(middle).residual <= 0.0 {
            short = middle;
        } else {
            long = middle;
        }
    }
    let (below, above) = (at(short), at(long));
    let best = if below.residual.abs() <= above.residual.abs() { below } else { above };
    if best.residual.is_finite() && best.force.is_finite() {
        Ok(best)
    } else {
        Err(EquilibriumError::Argument { muscle: muscle(), l_mt, v_mt, a }) // a path of kilometres
    }
}

/// Excitation u = a + τ da/dt of an activation sampled at `rate` \[Hz\], clipped to 0..1.
///
/// τ = τ_act (½ + 3/2 a) while activation rises, τ_deact/(½ + 3/2 a) while it falls (Thelen 2003, eqs. 1 and 2).
/// Missing samples (NaN) stay missing; a single one between them is taken as steady.
pub fn excitation(unit: &MuscleTendon, activation: &[f64], rate: f64) -> Vec<f64> {
    let mut u = vec![f64::NAN; activation.len()];
    for frames in stretches(activation.len(), |i| activation[i].is_finite()) {
        let slopes = differentiate(&activation[frames.clone()], 1.0 / rate);
        for (i, slope) in frames.zip(slopes) {
            let a = activation[i];
            let pace = 0.5 + 1.5 * a;
            let tau = if slope > 0.0 { unit.tau_activation * pace } else { unit.tau_deactivation / pace };
            u[i] = (a + tau * slope).clamp(0.0, 1.0);
        }
    }
    u
}

/// Tendon length \[m\] under `force` \[N\].
fn tendon_length(unit: &MuscleTendon, settings: &Settings, force: f64) -> f64 {
    match settings.tendon {
        Tendon::Rigid => unit.l_ts,
        Tendon::Elastic => unit.l_ts * (1.0 + settings.curves.tendon_strain(force / unit.f_max)),
    }
}

/// Fibre length (× l_opt) from its projection `along` the tendon \[m\], and whether it had to be limited.
fn fibre_length(unit: &MuscleTendon, along: f64) -> (f64, bool) {
    let shortest = shortest_fibre(unit, LENGTH_RANGE.0);
    let along = along / unit.l_opt;
    // A negative projection (path shorter than the tendon) is as short as can be.
    let L = if along > 0.0 { along.hypot(unit.pennation.sin()) } else { 0.0 };
    (L.clamp(shortest, LENGTH_RANGE.1), !(shortest..=LENGTH_RANGE.1).contains(&L))
}

/// `length` (× l_opt), or more where the pennation angle would pass its limit.
fn shortest_fibre(unit: &MuscleTendon, length: f64) -> f64 {
    length.max(unit.pennation.sin() / (1.0 - LEAST_COS * LEAST_COS).sqrt())
}

/// cos α of a fibre of length `L` (× l_opt), l sin α = l_opt sin α₀.
fn cos_pennation(unit: &MuscleTendon, L: f64) -> f64 {
    let sin = unit.pennation.sin() / L;
    (1.0 - sin * sin).max(LEAST_COS * LEAST_COS).sqrt()
}

/// Ranges of frames without a gap.
fn stretches(n_frames: usize, present: impl Fn(usize) -> bool) -> Vec<std::ops::Range<usize>> {
    let mut ranges: Vec<std::ops::Range<usize>> = Vec::new();
    for i in (0..n_frames).filter(|&i| present(i)) {
        match ranges.last_mut() {
            Some(range) if range.end == i => range.end = i + 1,
            _ => ranges.push(i..i + 1),
        }
    }
    ranges
}

/// Numbers behind [`Fractions`].
#[derive(Default)]
struct Counts {
    samples: usize,
    below_zero: usize,
    above_one: usize,
    length_limited: usize,
    without_velocity: usize,
}

impl Counts {
    fn add(&mut self, other: &Counts) {
        self.samples += other.samples;
        self.below_zero += other.below_zero;
        self.above_one += other.above_one;
        self.length_limited += other.length_limited;
        self.without_velocity += other.without_velocity;
    }

    fn fractions(&self) -> Fractions {
        let fraction = |count: usize| count as f64 / self.samples.max(1) as f64;
        Fractions {
            n_samples: self.samples,
            below_zero: fraction(self.below_zero),
            above_one: fraction(self.above_one),
            length_limited: fraction(self.length_limited),
            without_velocity: fraction(self.without_velocity),
        }
    }
}
