//! Small things that every figure needs: escaped text, short numbers, round ticks, grid lines.

use std::fmt::Write;

pub use coupling::number::{fixed, significant};

/// Text that is safe inside HTML and inside quoted attributes.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// A coordinate in user units of the figure with at most two decimals.
pub fn px(value: f64) -> String {
    let text = format!("{value:.2}");
    match text.trim_end_matches('0').trim_end_matches('.') {
        "-0" => "0".into(),
        short => short.into(),
    }
}

/// Round positions for ticks.
#[derive(Clone, Debug, PartialEq)]
pub struct Ticks {
    /// Positions, increasing.
    pub at: Vec<f64>,
    /// Decimals that tell neighbours apart.
    pub decimals: usize,
}

impl Ticks {
    /// About `wanted` ticks within `lo..=hi`, on multiples of 1, 2 or 5 times a power of ten.
    pub fn new(lo: f64, hi: f64, wanted: usize) -> Ticks {
        Ticks::every(round_step((hi - lo) / wanted.max(1) as f64), lo, hi)
    }

    /// [`Ticks::new`] on whole numbers: the exponents of a scale of decades.
    pub fn whole(lo: f64, hi: f64, wanted: usize) -> Ticks {
        Ticks::every(round_step((hi - lo) / wanted.max(1) as f64).max(1.0), lo, hi)
    }

    fn every(step: f64, lo: f64, hi: f64) -> Ticks {
        let (first, last) = ((lo / step - 1e-9).ceil(), (hi / step + 1e-9).floor());
        let count = (last - first).clamp(0.0, 100.0) as usize;
        Ticks {
            at: (0..=count).map(|i| (first + i as f64) * step).collect(),
            decimals: (-step.log10().floor()).clamp(0.0, 12.0) as usize,
        }
    }

    /// The label of a tick.
    pub fn label(&self, value: f64) -> String {
        if value.abs() >= 1e6 { significant(value, 2) } else { fixed(value, self.decimals) }
    }
}

/// A grid line from `left` to `right` at every tick, with what `label` says of it in front; `y`: where a value lies.
pub fn rows(
    out: &mut String,
    ticks: &Ticks,
    [left, right]: [f64; 2],
    y: impl Fn(f64) -> f64,
    label: impl Fn(f64) -> String,
) {
    for &t in &ticks.at {
        let _ = write!(
            out,
            "<path class=\"gridline\" d=\"M{} {}H{}\"/><text class=\"end\" x=\"{}\" y=\"{}\">{}</text>",
            px(left),
            px(y(t)),
            px(right),
            px(left - 5.0),
            px(y(t) + 3.5),
            label(t)
        );
    }
}

/// The step of 1, 2 or 5 times a power of ten that is nearest above `raw`.
pub fn round_step(raw: f64) -> f64 {
    if !(raw.is_finite() && raw > 1e-300) {
        return 1.0;
    }
    let power = 10_f64.powf(raw.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= raw * (1.0 - 1e-9)).unwrap_or(10.0);
    factor * power
}

/// Smallest and largest finite value.
pub fn extent<'a>(values: impl IntoIterator<Item = &'a f64>) -> Option<(f64, f64)> {
    values
        .into_iter()
        .filter(|v| v.is_finite())
        .fold(None, |range, &v| Some(range.map_or((v, v), |(lo, hi): (f64, f64)| (lo.min(v), hi.max(v)))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(Ticks::new(0.0, 100.0, 5).at, [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]);
        let small = Ticks::new(-0.013, 0.031, 4);
        assert_eq!(small.at.iter().map(|&v| small.label(v)).collect::<Vec<_>>(), ["0.00", "0.02"]);
        assert_eq!(Ticks::new(3.0, 3.0, 4).at, [3.0]);
        let decades = Ticks::whole(-1.0, 0.0, 4);
        assert_eq!(decades.at.iter().map(|&v| decades.label(v)).collect::<Vec<_>>(), ["−1", "0"]);
        assert_eq!(Ticks::whole(-18.0, 3.0, 5).at, [-15.0, -10.0, -5.0, 0.0]);
        for (lo, hi) in [(-1e300, 1e300), (0.0, 1e-310), (5.0, -5.0), (0.0, f64::INFINITY)] {
            assert!(Ticks::new(lo, hi, 5).at.len() < 102);
        }
    }

    #[test]
    fn coordinates_and_text_are_safe() {
        assert_eq!((px(1.0), px(-0.001), px(2.345)), ("1".into(), "0".into(), "2.35".into()));
        assert_eq!(escape("<a b=\"c\">&"), "&lt;a b=&quot;c&quot;&gt;&amp;");
    }
}
