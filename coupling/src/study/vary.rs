//! What differs from sample to sample: a key and its distribution, drawn from a sequence of points in the unit cube.
//!
//! A point is a function of seed, sample and dimension alone, so that any process draws the same run.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use statrs::distribution::{ContinuousCDF, LogNormal, Normal};
use toml::Value;

use crate::changes::number;

/// Axes of the frame in which landmarks are shifted.
const AXES: [&str; 3] = ["x", "y", "z"];
/// Half a step of the sequence, which has 24 bits: no point is at the edge of the cube, where a normal distribution has no value.
const HALF_STEP: f64 = 1.0 / (1u64 << 25) as f64;
/// Samples and dimensions that the Sobol sequence has.
pub const SOBOL: [usize; 2] = [1 << 16, 256];

/// How samples fill the space of what varies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sequence {
    /// Sobol points, scrambled after Owen (Burley, J Comput Graph Tech 2020;9(4):1): they fill it more evenly than chance.
    #[default]
    Sobol,
    /// Independent points (ChaCha, eight rounds).
    Random,
}

impl Sequence {
    /// A coordinate of a point, in (0, 1).
    pub fn point(self, seed: u32, sample: usize, dimension: usize) -> f64 {
        match self {
            Sequence::Sobol => {
                f64::from(sobol_burley::sample(sample as u32, dimension as u32, seed)) + HALF_STEP
            }
            Sequence::Random => {
                let mut generator = ChaCha8Rng::seed_from_u64(seed.into());
                generator.set_stream(sample as u64);
                generator.set_word_pos(2 * dimension as u128);
                ((generator.next_u64() >> 11) as f64 + 0.5) / (1u64 << 53) as f64
            }
        }
    }
}

/// How a number is distributed.
#[derive(Clone, Debug, PartialEq)]
pub enum Distribution {
    /// Normal, by mean and standard deviation, cut off at the bounds.
    Normal {
        /// Mean before it is cut off.
        mean: f64,
        /// Standard deviation before it is cut off.
        sd: f64,
        /// Least and greatest value.
        bounds: [f64; 2],
    },
    /// Log-normal, by mean and standard deviation of the number itself, cut off at the bounds.
    Lognormal {
        /// Mean before it is cut off.
        mean: f64,
        /// Standard deviation before it is cut off.
        sd: f64,
        /// Least and greatest value.
        bounds: [f64; 2],
    },
    /// Even between two bounds.
    Uniform {
        /// Least and greatest value.
        bounds: [f64; 2],
    },
    /// One of these, all as likely.
    Choice {
        /// Values.
        values: Vec<Value>,
    },
}

impl Distribution {
    /// The value below which a fraction `u` in (0, 1) of all lie.
    pub fn value(&self, u: f64) -> Value {
        match self {
            Distribution::Uniform { bounds: [low, high] } => (low + u * (high - low)).into(),
            Distribution::Normal { mean, sd, bounds } => {
                within(&Normal::new(*mean, *sd).expect("checked"), *bounds, u).into()
            }
            Distribution::Lognormal { mean, sd, bounds } => {
                let [location, scale] = of_logarithm(*mean, *sd);
                within(&LogNormal::new(location, scale).expect("checked"), *bounds, u).into()
            }
            Distribution::Choice { values } => {
                values[((u * values.len() as f64) as usize).min(values.len() - 1)].clone()
            }
        }
    }

    /// Bounds of its numbers; of a choice, least and greatest number among them.
    pub fn bounds(&self) -> Option<[f64; 2]> {
        match self {
            Distribution::Normal { bounds, .. }
            | Distribution::Lognormal { bounds, .. }
            | Distribution::Uniform { bounds } => Some(*bounds),
            Distribution::Choice { values } => {
                let numbers: Option<Vec<f64>> = values.iter().map(number).collect();
                let numbers = numbers?;
                let least = numbers.iter().fold(f64::INFINITY, |m, v| m.min(*v));
                Some([least, numbers.iter().fold(f64::NEG_INFINITY, |m, v| m.max(*v))])
            }
        }
    }
}

/// Mean and standard deviation of the logarithm of a log-normal number.
fn of_logarithm(mean: f64, sd: f64) -> [f64; 2] {
    let variance = (1.0 + (sd / mean).powi(2)).ln();
    [mean.ln() - 0.5 * variance, variance.sqrt()]
}

/// The value of a distribution cut off at bounds.
fn within(distribution: &impl ContinuousCDF<f64, f64>, [low, high]: [f64; 2], u: f64) -> f64 {
    let at = |bound: f64, end: f64| if bound.is_finite() { distribution.cdf(bound) } else { end };
    let (from, to) = (at(low, 0.0), at(high, 1.0));
    distribution.inverse_cdf(from + u * (to - from)).clamp(low, high)
}

/// What a run takes in place of its base.
#[derive(Clone, Debug, PartialEq)]
pub enum Target {
    /// A key of the trial file.
    Trial(String),
    /// A key of the scene.
    Scene(String),
    /// An option of `optimize`.
    Option(String),
    /// A coordinate of a landmark, 0..3, to be added to \[mm\].
    Landmark(&'static str, usize),
    /// Factor on the strength of a muscle line.
    Strength(String),
}

impl Target {
    /// Name of its column in the table.
    pub fn column(&self) -> String {
        match self {
            Target::Trial(key) => format!("trial.{key}"),
            Target::Scene(key) => format!("scene.{key}"),
            Target::Option(key) => format!("optimize.{key}"),
            Target::Landmark(name, axis) => format!("landmarks.{name}.{}_mm", AXES[*axis]),
            Target::Strength(name) => format!("strengths.{name}"),
        }
    }
}

/// A dimension of the space of samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Dimension {
    /// What it sets.
    pub target: Target,
    /// How its values are distributed.
    pub distribution: Distribution,
    /// Which `[[vary]]` it is of.
    pub group: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Quantiles of the normal distribution: Abramowitz & Stegun, table 26.5.
    #[test]
    fn quantiles_are_the_tabulated_ones_and_cut_off_where_asked() {
        let all = [f64::NEG_INFINITY, f64::INFINITY];
        let normal = Distribution::Normal { mean: 1.0, sd: 0.2, bounds: all };
        for (u, z) in [(0.5, 0.0), (0.975, 1.959964), (0.84, 0.994458), (0.001, -3.090232)] {
            let value = number(&normal.value(u)).unwrap();
            assert!((value - (1.0 + 0.2 * z)).abs() < 2e-7, "{u}: {value}");
        }
        let cut = Distribution::Normal { mean: 1.0, sd: 0.2, bounds: [0.9, 1.0] };
        for u in [1e-9, 0.3, 1.0 - 1e-9] {
            assert!((0.9..=1.0).contains(&number(&cut.value(u)).unwrap()));
        }
        let n = 20_000;
        let lognormal = Distribution::Lognormal { mean: 2.0, sd: 0.5, bounds: all };
        let values: Vec<f64> =
            (0..n).map(|i| number(&lognormal.value((i as f64 + 0.5) / n as f64)).unwrap()).collect();
        let mean = values.iter().sum::<f64>() / n as f64;
        let sd = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
        assert!((mean - 2.0).abs() < 1e-3 && (sd - 0.5).abs() < 2e-3, "{mean} {sd}");
        let choice = Distribution::Choice { values: vec![1.into(), 2.into(), 3.into()] };
        let drawn = [0.0, 0.34, 0.999_999_9].map(|u| number(&choice.value(u)).unwrap());
        assert_eq!(drawn, [1.0, 2.0, 3.0]);
    }

    /// 2^k Sobol points have one point in each of 2^k intervals of every coordinate; chance does not.
    #[test]
    fn the_sequence_is_even_and_a_seed_makes_another_one() {
        let filled = |sequence: Sequence, dimension: usize| {
            let mut bins = vec![false; 256];
            (0..256).for_each(|i| bins[(256.0 * sequence.point(7, i, dimension)) as usize] = true);
            bins.into_iter().filter(|b| *b).count()
        };
        for dimension in [0, 1, 40, 255] {
            assert_eq!(filled(Sequence::Sobol, dimension), 256, "dimension {dimension}");
            // Expected by chance: 256 (1 - 1/e) = 162, standard deviation 5.
            assert!((130..195).contains(&filled(Sequence::Random, dimension)), "dimension {dimension}");
        }
        for sequence in [Sequence::Sobol, Sequence::Random] {
            assert_eq!(sequence.point(7, 100, 3), sequence.point(7, 100, 3));
            assert_ne!(sequence.point(7, 100, 3), sequence.point(8, 100, 3));
            assert_ne!(sequence.point(7, 100, 3), sequence.point(7, 100, 4));
        }
    }
}
