//! Electromyography: from raw channels to envelopes, and whether muscles that pull are those that are excited.
//!
//! Band-pass 20 to 400 Hz, rectified, envelope of 6 Hz, all of zero phase; the force follows by the electromechanical delay.
//! Concordance is the fraction of frames in which excitation and force are both on or both off (Giroux et al., Comput Methods Biomech Biomed
//! Engin 2013;16:1127; used by Moissenet et al. 2014). On is above a fifth of the largest value of the reported frames, of both alike, as
//! neither has a common scale.

use crate::filter::LowPass;
use crate::trial::Table;

/// Band of the signal and cut-off of its envelope \[Hz\].
const BAND: (f64, f64) = (20.0, 400.0);
const ENVELOPE: f64 = 6.0;
/// Fraction of the largest value above which a signal or a force is on.
pub const ON: f64 = 0.2;
/// A channel is flat where its effective value is below this fraction of the median of all channels: ten times less than the spread between
/// channels that work (a factor of three in the recordings of subject JW).
const FLAT: f64 = 0.05;
/// A channel is clipped where more than this fraction of its samples lie at its largest or smallest value.
const CLIPPED: f64 = 1e-3;

/// One recorded channel and the muscles that it belongs to.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Name in the recording.
    pub name: String,
    /// Muscle lines, by their numbers.
    pub muscles: Vec<usize>,
    /// First time \[s\] and samples per second.
    pub start: f64,
    /// Samples per second \[Hz\].
    pub rate: f64,
    /// Samples, in the unit of the recording.
    pub samples: Vec<f64>,
}

/// What the trial has of electromyography.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Channels.
    pub channels: Vec<Channel>,
    /// How long force comes after excitation \[s\].
    pub delay: f64,
}

/// Why a channel says nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Defect {
    /// It is far smaller than the others.
    Flat,
    /// The amplifier was at its end.
    Clipped,
    /// It does not reach over the reported frames.
    Short,
}

impl Defect {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Defect::Flat => "flat",
            Defect::Clipped => "clipped",
            Defect::Short => "does not reach over the frames",
        }
    }
}

/// A channel beside the force of its muscles.
#[derive(Clone, Debug, PartialEq)]
pub struct Compared {
    /// Name in the recording.
    pub channel: String,
    /// Names of the muscle lines.
    pub muscles: Vec<String>,
    /// Envelope at the reported frames, delayed, as a fraction of its largest value there.
    pub envelope: Vec<f64>,
    /// Force of the muscles together, as a fraction of its largest value; NaN in frames without solution.
    pub force: Vec<f64>,
    /// Why the channel is left out.
    pub defect: Option<Defect>,
    /// Fraction of the solved frames in which both are on or both off, 0..1; `None` without such frames.
    pub concordance: Option<f64>,
}

/// Compares channels with `forces` \[N\] at the times of the reported frames.
pub fn compare(recording: &Recording, time: &[f64], forces: &Table) -> Vec<Compared> {
    let bands: Vec<Vec<f64>> = recording.channels.iter().map(|c| band_pass(&c.samples, c.rate)).collect();
    let mut levels: Vec<f64> = bands.iter().map(|b| effective(b)).collect();
    let own = levels.clone();
    levels.sort_by(f64::total_cmp);
    let median = levels.get(levels.len() / 2).copied().unwrap_or(0.0);
    let channels = recording.channels.iter().zip(&bands).zip(own);
    channels
        .map(|((channel, band), level)| {
            let envelope = envelope(band, channel.rate);
            let end = channel.start + (envelope.len().max(1) - 1) as f64 / channel.rate;
            let covers = time.iter().all(|t| (channel.start..=end).contains(&(t - recording.delay)));
            let defect = if !covers {
                Some(Defect::Short)
            } else if level <= FLAT * median {
                Some(Defect::Flat)
            } else if is_clipped(&channel.samples) {
                Some(Defect::Clipped)
            } else {
                None
            };
            let at = |t: &f64| interpolated(&envelope, (t - recording.delay - channel.start) * channel.rate);
            let envelope = relative(time.iter().map(at).collect());
            let force = |k: usize| channel.muscles.iter().map(|&m| forces.values[(k, m)]).sum::<f64>();
            let force = relative((0..time.len()).map(force).collect());
            let solved: Vec<usize> = (0..time.len()).filter(|&k| force[k].is_finite()).collect();
            let agree = solved.iter().filter(|&&k| (envelope[k] > ON) == (force[k] > ON)).count();
            Compared {
                channel: channel.name.clone(),
                muscles: channel.muscles.iter().map(|&m| forces.columns[m].clone()).collect(),
                concordance: (!solved.is_empty()).then(|| agree as f64 / solved.len() as f64),
                envelope,
                force,
                defect,
            }
        })
        .collect()
}

/// Mean concordance of the channels without defect; `None` where there is none.
pub fn overall(compared: &[Compared]) -> Option<f64> {
    let good: Vec<f64> =
        compared.iter().filter(|c| c.defect.is_none()).filter_map(|c| c.concordance).collect();
    (!good.is_empty()).then(|| good.iter().sum::<f64>() / good.len() as f64)
}

/// The band of the signal, of zero phase. What a zero-phase low-pass leaves over is the zero-phase high-pass of the same order: their
/// gains 1/(1 + r⁸) and r⁸/(1 + r⁸) add up to one.
fn band_pass(samples: &[f64], rate: f64) -> Vec<f64> {
    let low = match LowPass::new(BAND.1, rate) {
        Some(filter) => filter.apply(samples),
        None => samples.to_vec(), // the samples hold nothing faster
    };
    let Some(filter) = LowPass::new(BAND.0, rate) else { return vec![0.0; samples.len()] };
    low.iter().zip(filter.apply(&low)).map(|(v, slow)| v - slow).collect()
}

/// Rectified and smoothed; the filter's undershoot below zero is cut.
fn envelope(band: &[f64], rate: f64) -> Vec<f64> {
    let rectified: Vec<f64> = band.iter().map(|v| v.abs()).collect();
    match LowPass::new(ENVELOPE, rate) {
        Some(filter) => filter.apply(&rectified).into_iter().map(|v| v.max(0.0)).collect(),
        None => rectified,
    }
}

/// Root mean square.
fn effective(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// Whether too many samples lie at the largest or the smallest value.
fn is_clipped(samples: &[f64]) -> bool {
    let largest = samples.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let smallest = samples.iter().copied().fold(f64::INFINITY, f64::min);
    let limit = CLIPPED * samples.len() as f64;
    [largest, smallest].iter().any(|end| samples.iter().filter(|v| *v == end).count() as f64 > limit.max(2.0))
}

/// Linear interpolation at a place counted in samples; the nearest value outside.
fn interpolated(values: &[f64], place: f64) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let place = place.clamp(0.0, last as f64);
    let below = place.floor() as usize;
    let part = place - below as f64;
    values[below] + part * (values[(below + 1).min(last)] - values[below])
}

/// Fractions of the largest value; zeros where nothing is above zero.
fn relative(values: Vec<f64>) -> Vec<f64> {
    let largest = values.iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max);
    if largest > 0.0 { values.into_iter().map(|v| v / largest).collect() } else { values }
}
