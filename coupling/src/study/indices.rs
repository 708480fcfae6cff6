//! Sobol indices: which part of the scatter of a number comes from each `[[vary]]`, by itself and together with others.
//!
//! Saltelli's design: two independent sets of values, and for every group of inputs the first set with that group of the second.
//! First-order indices by formula (b), total ones by (f) of table 2 of Saltelli et al., Comput Phys Commun 2010;181:259, the latter after Jansen.

/// Fewest samples: leaving one out says little of fewer.
pub const LEAST: usize = 8;
/// Half a confidence interval in which nineteen of twenty lie, in standard errors (normal distribution).
pub const NINETEEN_OF_TWENTY: f64 = 1.96;

/// Which part of the variance of a number comes from a group of inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Index {
    /// By itself, and its standard error.
    pub first: [f64; 2],
    /// With all that it does together with others, and its standard error.
    pub total: [f64; 2],
}

/// The index of a number over samples, whose values are `first` and `second` of the independent sets and `exchanged` of the first one with a group of the
/// second. `None` where the number does not vary or there are fewer than [`LEAST`] samples.
///
/// Standard errors are by leaving out each sample in turn (jackknife). They take samples for independent; those of a Sobol sequence lie more evenly, so
/// that the indices are surer than that.
pub fn index(first: &[f64], second: &[f64], exchanged: &[f64]) -> Option<Index> {
    let n = first.len();
    if n < LEAST {
        return None;
    }
    // Values about their mean: formula (b) takes the difference of large numbers otherwise.
    let mean = first.iter().chain(second).sum::<f64>() / (2 * n) as f64;
    let of_sample = |i: usize| {
        let [a, b, m] = [first[i], second[i], exchanged[i]].map(|v| v - mean);
        [a + b, a * a + b * b, b * (m - a), 0.5 * (a - m).powi(2)]
    };
    let add = |x: [f64; 4], y: [f64; 4]| std::array::from_fn(|k| x[k] + y[k]);
    let all: [f64; 4] = (0..n).map(of_sample).fold([0.0; 4], add);
    let indices = |[sum, squares, alone, together]: [f64; 4], n: f64| {
        let variance = squares / (2.0 * n) - (sum / (2.0 * n)).powi(2);
        [alone, together].map(|part| part / n / variance)
    };
    let scale = first.iter().chain(second).fold(0.0, |m: f64, v| m.max(v.abs()));
    // Less than the last digits of the values is no scatter.
    if all[1] / (2 * n) as f64 <= (8.0 * f64::EPSILON * scale).powi(2) {
        return None;
    }
    let without: Vec<[f64; 2]> = (0..n)
        .map(|i| {
            let own = of_sample(i);
            indices(std::array::from_fn(|k| all[k] - own[k]), n as f64 - 1.0)
        })
        .collect();
    let error = |k: usize| {
        let mean = without.iter().map(|v| v[k]).sum::<f64>() / n as f64;
        let squares = without.iter().map(|v| (v[k] - mean).powi(2)).sum::<f64>();
        (squares * (n as f64 - 1.0) / n as f64).sqrt()
    };
    let [alone, together] = indices(all, n as f64);
    Some(Index { first: [alone, error(0)], total: [together, error(1)] })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::study::vary::Sequence;

    /// Ishigami's function with a = 7 and b = 0.1 of three numbers even between -π and π.
    fn ishigami(x: [f64; 3]) -> f64 {
        x[0].sin() + 7.0 * x[1].sin().powi(2) + 0.1 * x[2].powi(4) * x[0].sin()
    }

    /// Its indices in closed form (Ishigami & Homma 1990): variance of every part over that of the whole.
    fn exact() -> [[f64; 2]; 3] {
        let (a, b) = (7.0, 0.1);
        let one = 0.5 * (1.0 + b * PI.powi(4) / 5.0f64).powi(2);
        let two = a * a / 8.0;
        let one_three = b * b * PI.powi(8) * (1.0 / 18.0 - 1.0 / 50.0);
        let all = one + two + one_three;
        [[one, one + one_three], [two, two], [0.0, one_three]].map(|parts| parts.map(|part| part / all))
    }

    fn estimated(sequence: Sequence, seed: u32, n: usize) -> [Index; 3] {
        let at = |sample: usize, second: [bool; 3]| {
            ishigami(std::array::from_fn(|k| {
                let dimension = if second[k] { 3 + k } else { k };
                PI * (2.0 * sequence.point(seed, sample, dimension) - 1.0)
            }))
        };
        let values = |second: [bool; 3]| (0..n).map(|i| at(i, second)).collect::<Vec<f64>>();
        let (first, second) = (values([false; 3]), values([true; 3]));
        std::array::from_fn(|group| {
            index(&first, &second, &values(std::array::from_fn(|k| k == group))).unwrap()
        })
    }

    #[test]
    fn indices_of_a_known_function_are_those_in_closed_form() {
        let wanted = exact();
        // Saltelli et al. 2010 print 0.3139, 0.4424, 0 and 0.5576, 0.4424, 0.2437.
        for (known, printed) in wanted.iter().zip([[0.3139, 0.5576], [0.4424, 0.4424], [0.0, 0.2437]]) {
            assert!((0..2).all(|k| (known[k] - printed[k]).abs() < 1e-4), "{known:?}");
        }
        for (index, wanted) in estimated(Sequence::Sobol, 1, 4096).iter().zip(wanted) {
            for ([value, error], wanted) in [index.first, index.total].into_iter().zip(wanted) {
                assert!((value - wanted).abs() < 0.01 && error < 0.04, "{index:?}, {wanted}");
            }
        }
    }

    /// Of 400 intervals of independent samples 380 hold the truth; 4.4 is the standard deviation.
    #[test]
    fn nineteen_of_twenty_intervals_hold_the_truth() {
        let wanted = exact();
        for (group, kind) in [(0, 0), (0, 1), (1, 0), (2, 1)] {
            let holds = |seed: u32| {
                let index = estimated(Sequence::Random, seed, 200)[group];
                let [value, error] = [index.first, index.total][kind];
                (value - wanted[group][kind]).abs() < NINETEEN_OF_TWENTY * error
            };
            let held = (0..400).filter(|seed| holds(*seed)).count();
            assert!((360..=395).contains(&held), "group {group}, kind {kind}: {held} of 400");
        }
    }

    #[test]
    fn what_does_nothing_has_an_index_of_nothing_and_a_constant_has_none() {
        let values: Vec<f64> = (0..20).map(|i| f64::from(i * i % 13)).collect();
        let others: Vec<f64> = (0..20).map(|i| f64::from(i * 7 % 11)).collect();
        let nothing = index(&values, &others, &values).unwrap();
        assert_eq!(nothing, Index { first: [0.0; 2], total: [0.0; 2] });
        assert_eq!(index(&[3.1; 20], &[3.1; 20], &[3.1; 20]), None);
        assert_eq!(index(&values[..7], &others[..7], &values[..7]), None);
    }
}
