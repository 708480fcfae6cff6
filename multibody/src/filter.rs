//! Zero-phase Butterworth low-pass and differentiation that keep the time base: n samples in, the same n times out.

/// Fourth-order Butterworth low-pass (two second-order sections forward, the same backward: the effective order is
/// doubled and the phase cancelled), cut-off `cutoff_hz` at −3 dB per direction.
///
/// The ends are extended by odd reflection and the sections start in their steady state, so that a constant and a straight
/// line pass unchanged.
#[derive(Clone, Debug)]
pub struct LowPass {
    sections: [Section; 2],
    padding: usize,
}

/// y[n] = b0 x[n] + b1 x[n−1] + b2 x[n−2] − a1 y[n−1] − a2 y[n−2]
#[derive(Clone, Copy, Debug)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
}

impl LowPass {
    /// `None` where the cut-off is not below half the sampling rate (nothing to filter) or not positive.
    pub fn new(cutoff_hz: f64, rate_hz: f64) -> Option<LowPass> {
        if !(cutoff_hz > 0.0 && cutoff_hz < 0.5 * rate_hz) {
            return None;
        }
        // Bilinear transform with pre-warping of the analog prototype s² + 2 sin(θ) s + 1.
        let k = (std::f64::consts::PI * cutoff_hz / rate_hz).tan();
        let section = |theta: f64| {
            let damping = 2.0 * theta.sin();
            let norm = 1.0 + damping * k + k * k;
            let b0 = k * k / norm;
            Section {
                b: [b0, 2.0 * b0, b0],
                a: [2.0 * (k * k - 1.0) / norm, (1.0 - damping * k + k * k) / norm],
            }
        };
        let eighth = std::f64::consts::FRAC_PI_8;
        // Five periods of the cut-off: the start dies out to about 1e-6.
        let padding = (5.0 * rate_hz / cutoff_hz).ceil() as usize;
        Some(LowPass { sections: [section(eighth), section(3.0 * eighth)], padding })
    }

    /// Filters uniformly sampled values forward and backward.
    pub fn apply(&self, values: &[f64]) -> Vec<f64> {
        let n = values.len();
        if n < 3 {
            return values.to_vec();
        }
        let reach = self.padding.min(n - 1);
        let (first, last) = (values[0], values[n - 1]);
        let mut x: Vec<f64> = Vec::with_capacity(n + 2 * reach);
        x.extend((1..=reach).rev().map(|k| 2.0 * first - values[k]));
        x.extend_from_slice(values);
        x.extend((1..=reach).map(|k| 2.0 * last - values[n - 1 - k]));
        for _ in 0..2 {
            for section in &self.sections {
                section.run(&mut x);
            }
            x.reverse();
        }
        x.drain(..reach);
        x.truncate(n);
        x
    }
}

impl Section {
    /// Transposed direct form II, started in the steady state of the first sample.
    fn run(&self, x: &mut [f64]) {
        let [b0, b1, b2] = self.b;
        let [a1, a2] = self.a;
        let mut s2 = (b2 - a2) * x[0];
        let mut s1 = (b1 - a1) * x[0] + s2;
        for v in x {
            let y = b0 * *v + s1;
            s1 = b1 * *v - a1 * y + s2;
            s2 = b2 * *v - a2 * y;
            *v = y;
        }
    }
}

/// Derivative of uniformly sampled values: central differences, one-sided second-order at the ends.
pub fn differentiate(values: &[f64], step: f64) -> Vec<f64> {
    let n = values.len();
    match n {
        0 | 1 => vec![0.0; n],
        2 => vec![(values[1] - values[0]) / step; 2],
        _ => (0..n)
            .map(|k| match k {
                0 => (-3.0 * values[0] + 4.0 * values[1] - values[2]) / (2.0 * step),
                _ if k == n - 1 => (3.0 * values[k] - 4.0 * values[k - 1] + values[k - 2]) / (2.0 * step),
                _ => (values[k + 1] - values[k - 1]) / (2.0 * step),
            })
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_pass_and_the_time_base_stays() {
        let filter = LowPass::new(6.0, 120.0).unwrap();
        let line: Vec<f64> = (0..200).map(|k| 3.0 - 0.1 * k as f64).collect();
        for (a, b) in filter.apply(&line).iter().zip(&line) {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
        // A slow symmetric bump keeps its place: zero phase.
        let bump: Vec<f64> = (0..401).map(|k| (-((k as f64 - 200.0) / 60.0).powi(2)).exp()).collect();
        let smooth = filter.apply(&bump);
        for k in 0..401 {
            assert!((smooth[k] - smooth[400 - k]).abs() < 1e-6);
            assert!((smooth[k] - bump[k]).abs() < 1e-3);
        }
    }

    #[test]
    fn gain_at_the_cut_off_is_one_half() {
        // −3 dB per direction, twice.
        let (cutoff, rate) = (6.0, 240.0);
        let wave: Vec<f64> =
            (0..4000).map(|k| (2.0 * std::f64::consts::PI * cutoff * k as f64 / rate).sin()).collect();
        let filtered = LowPass::new(cutoff, rate).unwrap().apply(&wave);
        let peak = filtered[1000..3000].iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        assert!((peak - 0.5).abs() < 1e-3, "{peak}");
    }
}
