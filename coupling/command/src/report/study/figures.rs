//! Figures of a study: bands over the gait cycle, and one number against what varies.

use std::fmt::Write;

use crate::report::svg::{Ticks, escape, extent, px, round_step};

/// Size of a figure, and the frame in it: left, top, right, bottom.
const SIZE: [f64; 2] = [384.0, 236.0];
const FRAME: [f64; 4] = [50.0, 8.0, 374.0, 202.0];

/// A curve with what lies around it.
pub struct Band<'a> {
    /// Name, for the legend.
    pub name: &'a str,
    /// 5th, 25th, 50th, 75th and 95th percentile at evenly spaced instants.
    pub percentiles: Vec<Option<[f64; 5]>>,
}

/// Dots of one name.
pub struct Dots<'a> {
    /// Name, for the legend.
    pub name: &'a str,
    /// Where they are.
    pub at: Vec<[f64; 2]>,
}

/// A frame with linear axes.
struct Axes {
    across: [f64; 2],
    up: [f64; 2],
}

impl Axes {
    fn x(&self, v: f64) -> String {
        px(FRAME[0] + (v - self.across[0]) / (self.across[1] - self.across[0]) * (FRAME[2] - FRAME[0]))
    }

    fn y(&self, v: f64) -> String {
        px(FRAME[3] - (v - self.up[0]) / (self.up[1] - self.up[0]) * (FRAME[3] - FRAME[1]))
    }

    /// Axes around these values, with round ends.
    fn around(values: &[f64]) -> [f64; 2] {
        let (low, high) = extent(values).unwrap_or((0.0, 1.0));
        let spread =
            if high - low > 1e-9 * low.abs().max(high.abs()) { high - low } else { low.abs().max(1.0) };
        let step = round_step(spread / 5.0) / 2.0;
        let (low, high) = ((low / step).floor() * step, (high / step).ceil() * step);
        if high > low { [low, high] } else { [low - step, high + step] }
    }

    /// Caption, legend and axes; the curves follow.
    fn open(&self, title: &str, labels: [&str; 2], names: &[&str]) -> String {
        let mut svg = format!("<figure class=\"normal\"><figcaption><b>{}</b>", escape(title));
        if names.len() > 1 {
            svg += "<span class=\"legend\">";
            for (k, name) in names.iter().enumerate() {
                let _ = write!(
                    svg,
                    "<span><svg class=\"key\" viewBox=\"0 0 18 8\" aria-hidden=\"true\"><path class=\"line c{}\" d=\"M1 4H17\"/></svg>{}</span>",
                    colour(k),
                    escape(name)
                );
            }
            svg += "</span>";
        }
        let _ = write!(
            svg,
            "</figcaption><svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">",
            px(SIZE[0]),
            px(SIZE[1]),
            escape(title)
        );
        let up = Ticks::new(self.up[0], self.up[1], 5);
        for &v in &up.at {
            let class = if v == 0.0 { "zero" } else { "gridline" };
            let _ = write!(
                svg,
                "<path class=\"{class}\" d=\"M{} {}H{}\"/><text class=\"end\" x=\"{}\" y=\"{}\" dy=\"3.5\">{}</text>",
                px(FRAME[0]),
                self.y(v),
                px(FRAME[2]),
                px(FRAME[0] - 5.0),
                self.y(v),
                up.label(v)
            );
        }
        let across = Ticks::new(self.across[0], self.across[1], 5);
        for &v in &across.at {
            let _ = write!(
                svg,
                "<path class=\"axis\" d=\"M{} {}v4\"/><text class=\"mid\" x=\"{}\" y=\"{}\">{}</text>",
                self.x(v),
                px(FRAME[3]),
                self.x(v),
                px(FRAME[3] + 15.0),
                across.label(v)
            );
        }
        let _ = write!(
            svg,
            "<path class=\"axis\" d=\"M{} {}H{}\"/><text class=\"mid\" x=\"{}\" y=\"{}\">{}</text>\
             <text class=\"mid\" transform=\"translate(11 {}) rotate(-90)\">{}</text>",
            px(FRAME[0]),
            px(FRAME[3]),
            px(FRAME[2]),
            px(0.5 * (FRAME[0] + FRAME[2])),
            px(SIZE[1] - 4.0),
            escape(labels[0]),
            px(0.5 * (FRAME[1] + FRAME[3])),
            escape(labels[1])
        );
        svg
    }
}

/// Colours of the style sheet.
fn colour(k: usize) -> usize {
    k % 6 + 1
}

/// Median, and between which values half and nine tenths of all runs lie, over the reported frames.
pub fn bands(title: &str, bands: &[Band]) -> String {
    let all: Vec<f64> =
        bands.iter().flat_map(|b| b.percentiles.iter().flatten()).flatten().copied().collect();
    if all.is_empty() {
        return String::new();
    }
    let axes = Axes { across: [0.0, 100.0], up: Axes::around(&[all.as_slice(), &[0.0]].concat()) };
    let names: Vec<&str> = bands.iter().map(|b| b.name).collect();
    let mut svg = axes.open(title, ["% of the reported frames", "force, N"], &names);
    for (k, band) in bands.iter().enumerate() {
        let n = band.percentiles.len() as f64 - 1.0;
        let points: Vec<(f64, Option<[f64; 5]>)> =
            band.percentiles.iter().enumerate().map(|(i, p)| (100.0 * i as f64 / n, *p)).collect();
        for run in points.split(|(_, p)| p.is_none()).filter(|run| !run.is_empty()) {
            let at = |edge: usize| {
                run.iter()
                    .map(|(t, p)| format!("{} {}", axes.x(*t), axes.y(p.expect("split")[edge])))
                    .collect::<Vec<_>>()
            };
            for [low, high] in [[0, 4], [1, 3]] {
                let back: Vec<String> = at(low).into_iter().rev().collect();
                let _ = write!(
                    svg,
                    "<path class=\"area c{}\" d=\"M{}L{}Z\"/>",
                    colour(k),
                    at(high).join("L"),
                    back.join("L")
                );
            }
            let _ = write!(svg, "<path class=\"line c{}\" d=\"M{}\"/>", colour(k), at(2).join("L"));
        }
    }
    svg + "</svg></figure>"
}

/// One number against another, a dot per run.
pub fn scatter(title: &str, labels: [&str; 2], dots: &[Dots]) -> String {
    let of = |axis: usize| dots.iter().flat_map(|d| d.at.iter().map(|p| p[axis])).collect::<Vec<f64>>();
    if of(0).is_empty() {
        return String::new();
    }
    let axes = Axes { across: Axes::around(&of(0)), up: Axes::around(&of(1)) };
    let names: Vec<&str> = dots.iter().map(|d| d.name).collect();
    let mut svg = axes.open(title, labels, &names);
    for (k, dots) in dots.iter().enumerate() {
        for [x, y] in &dots.at {
            let _ = write!(
                svg,
                "<circle class=\"c{}\" fill-opacity=\".45\" stroke=\"none\" cx=\"{}\" cy=\"{}\" r=\"2\"/>",
                colour(k),
                axes.x(*x),
                axes.y(*y)
            );
        }
    }
    svg + "</svg></figure>"
}
