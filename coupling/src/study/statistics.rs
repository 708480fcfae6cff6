//! What many runs say together: percentiles, and which inputs a number follows.

/// Fractions of a band, from its lower edge to its upper one.
pub const BAND: [f64; 5] = [0.05, 0.25, 0.5, 0.75, 0.95];

/// The values below which these fractions of all lie (linear between neighbours: type 7 of Hyndman & Fan, Am Stat 1996;50:361), or `None` where
/// there are no numbers. What is no number is left out.
pub fn percentiles<const N: usize>(values: &[f64], fractions: [f64; N]) -> Option<[f64; N]> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    Some(fractions.map(|fraction| {
        let at = fraction * last as f64;
        let below = at.floor() as usize;
        let above = (below + 1).min(last);
        sorted[below] + (at - below as f64) * (sorted[above] - sorted[below])
    }))
}

/// Mean and standard deviation (of the sample); `None` of fewer than two numbers.
pub fn mean_and_sd(values: &[f64]) -> Option<[f64; 2]> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (values.len() > 1).then(|| [mean, (squares / (n - 1.0)).sqrt()])
}

/// Rank correlation (Spearman) of two lists; `None` where either does not vary or there are fewer than three pairs.
pub fn rank_correlation(a: &[f64], b: &[f64]) -> Option<f64> {
    let n = a.len();
    if n < 3 || n != b.len() {
        return None;
    }
    let (a, b) = (ranks(a), ranks(b));
    let mean = 0.5 * (n as f64 - 1.0);
    let product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| (x - mean) * (y - mean)).sum::<f64>();
    let scale = (product(&a, &a) * product(&b, &b)).sqrt();
    (scale > 0.0).then(|| product(&a, &b) / scale)
}

/// Rank of every value; equal ones share the mean of theirs.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&i, &j| values[i].total_cmp(&values[j]));
    let mut ranks = vec![0.0; values.len()];
    for tied in order.chunk_by(|&i, &j| values[i] == values[j]).scan(0usize, |from, tied| {
        let at = *from;
        *from += tied.len();
        Some((at, tied))
    }) {
        let (at, tied) = tied;
        let mean = at as f64 + 0.5 * (tied.len() as f64 - 1.0);
        tied.iter().for_each(|&i| ranks[i] = mean);
    }
    ranks
}

/// Magnitude of a rank correlation of `n` pairs that chance exceeds in one of `chances` cases (normal approximation).
pub fn chance(n: usize, chances: f64) -> f64 {
    use statrs::distribution::{ContinuousCDF, Normal};
    let normal = Normal::standard();
    normal.inverse_cdf(1.0 - 0.5 / chances) / ((n as f64 - 1.0).max(1.0)).sqrt()
}

/// Values over time at evenly spaced instants, linear between neighbours; a gap stays one.
pub fn resampled(time: &[f64], values: &[f64], n: usize) -> Vec<f64> {
    let (Some(first), Some(last)) = (time.first(), time.last()) else { return vec![f64::NAN; n] };
    let at = |k: usize| {
        let t = first + (last - first) * k as f64 / (n as f64 - 1.0);
        let above = time.partition_point(|x| *x < t).min(time.len() - 1);
        let below = above.saturating_sub(usize::from(time[above] > t));
        let fraction = if above == below { 0.0 } else { (t - time[below]) / (time[above] - time[below]) };
        if fraction == 0.0 {
            values[below]
        } else {
            values[below] + fraction * (values[above] - values[below])
        }
    };
    (0..n).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_definition() {
        let values = [4.0, 1.0, f64::NAN, 3.0, 2.0];
        assert_eq!(percentiles(&values, [0.0, 0.5, 1.0, 0.25]), Some([1.0, 2.5, 4.0, 1.75]));
        assert_eq!(percentiles::<1>(&[f64::NAN], [0.5]), None);
        assert_eq!(mean_and_sd(&[1.0, 3.0]), Some([2.0, 2f64.sqrt()]));
    }

    /// Example of Spearman's coefficient with ties, by hand: ranks 0 1.5 1.5 3 against 0 1 2 3.
    #[test]
    fn rank_correlations_see_any_monotonic_law_and_share_ties() {
        let x: Vec<f64> = (0..20).map(f64::from).collect();
        let cube: Vec<f64> = x.iter().map(|v| -v.powi(3)).collect();
        assert!((rank_correlation(&x, &cube).unwrap() + 1.0).abs() < 1e-15);
        let with_ties = rank_correlation(&[1.0, 2.0, 2.0, 3.0], &[1.0, 2.0, 3.0, 4.0]).unwrap();
        assert!((with_ties - 4.5 / (4.5f64 * 5.0).sqrt()).abs() < 1e-15, "{with_ties}");
        assert_eq!(rank_correlation(&x, &[1.0; 20]), None);
        assert!((chance(401, 20.0) - 1.959964 / 20.0).abs() < 1e-6);
    }

    #[test]
    fn curves_are_resampled_between_their_own_instants() {
        let time = [1.0, 2.0, 4.0];
        let values = [0.0, 10.0, 30.0];
        assert_eq!(resampled(&time, &values, 4), [0.0, 10.0, 20.0, 30.0]);
        assert_eq!(resampled(&time, &values, 7), [0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0]);
        let gap = resampled(&time, &[0.0, f64::NAN, 30.0], 4);
        assert!(gap[1].is_nan() && gap[2].is_nan() && gap[0] == 0.0 && gap[3] == 30.0);
    }
}
