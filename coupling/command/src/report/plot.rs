//! Line figures over time as inline SVG.
//!
//! Colours and strokes come from the style sheet of the page through class names, so one figure serves light, dark
//! and print. Geometry is written with two decimals; the script of the page reads values back from it.

use std::fmt::Write;

use super::svg::{Ticks, escape, extent, px, round_step};

/// The time axis that all figures of a page share.
#[derive(Clone, Debug, PartialEq)]
pub struct TimeAxis {
    /// Frame times \[s\].
    pub time: Vec<f64>,
    /// Heel strike to next heel strike \[s\]; `None` where the frames are no cycle, then the axis shows seconds.
    pub cycle: Option<[f64; 2]>,
    /// Whether figures of a cycle show seconds, too; not where the times are fractions of several cycles.
    pub seconds: bool,
    /// Times of ground contact, shaded \[s\].
    pub stance: Vec<[f64; 2]>,
}

impl TimeAxis {
    /// Fraction of the cycle \[%\] at time `t`.
    pub fn percent(&self, t: f64) -> Option<f64> {
        self.cycle.map(|[start, end]| 100.0 * (t - start) / (end - start))
    }

    /// First and last time, never equal.
    fn domain(&self) -> (f64, f64) {
        match extent(&self.time) {
            Some((lo, hi)) if hi > lo => (lo, hi),
            Some((lo, _)) => (lo - 0.5, lo + 0.5),
            None => (0.0, 1.0),
        }
    }
}

/// One curve.
#[derive(Clone, Debug)]
pub struct Line<'a> {
    /// For legend and tooltip.
    pub name: String,
    /// Class of its colour, e.g. `c1`.
    pub class: &'static str,
    /// Times \[s\]; `None` for the frames of the axis.
    pub time: Option<&'a [f64]>,
    /// One value per time; what is not finite breaks the curve.
    pub values: Vec<f64>,
}

/// A surface between two curves, drawn behind the curves of its name.
#[derive(Clone, Debug)]
pub struct Band {
    /// The curve that it belongs to.
    pub name: String,
    /// Class of its colour.
    pub class: &'static str,
    /// Lower and upper end at every frame of the axis; what is not finite leaves a gap.
    pub ends: [Vec<f64>; 2],
}

/// How large a figure is drawn, in user units (one per CSS pixel on a wide screen).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Size {
    /// Three to a row.
    Normal,
    /// Seven to a row: fewer ticks, no seconds.
    Small,
}

/// How values become heights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// Linear and fitted to the values.
    Fitted,
    /// Linear and including zero.
    FromZero,
    /// Decades; values below 1e-18 are drawn there.
    Log,
}

/// A second axis on the right that shows the same curves in another unit.
#[derive(Clone, Copy, Debug)]
pub struct RightAxis {
    /// Left unit per right unit, e.g. N per body weight.
    pub per_unit: f64,
    /// Name of the unit.
    pub unit: &'static str,
}

/// A line figure.
#[derive(Clone, Debug)]
pub struct Plot<'a> {
    /// Heading.
    pub title: String,
    /// Right part of the heading, quieter.
    pub note: String,
    /// What the values are, for the title of their axis.
    pub quantity: &'static str,
    /// Unit of the values; empty where they have none.
    pub unit: &'static str,
    /// Shared axis.
    pub axis: &'a TimeAxis,
    /// Drawn in order.
    pub lines: Vec<Line<'a>>,
    /// Drawn behind all curves.
    pub bands: Vec<Band>,
    /// Extent of the figure.
    pub size: Size,
    /// Vertical scale.
    pub scale: Scale,
    /// Second unit.
    pub right: Option<RightAxis>,
    /// Value and name of a dashed horizontal line; widens the scale only if within twice the largest value.
    pub bound: Option<(f64, &'static str)>,
    /// What the frames are at which no curve of the axis has a value; they are hatched.
    pub gap: &'static str,
}

/// Position of the drawing area in the figure.
struct Frame {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
    width: f64,
    height: f64,
}

/// Value to height and back, with the ticks that go with it.
struct Vertical {
    lo: f64,
    hi: f64,
    log: bool,
    ticks: Ticks,
}

const LOG_FLOOR: f64 = 1e-18;
/// Beyond this the extent of an axis would overflow.
const LARGEST: f64 = 1e300;

impl Plot<'_> {
    /// The figure as HTML.
    pub fn render(&self) -> String {
        let frame = self.frame();
        let vertical = self.vertical();
        let (t0, t1) = self.axis.domain();
        let x = |t: f64| frame.left + (t - t0) / (t1 - t0) * (frame.right - frame.left);
        let y = |v: f64| vertical.height_of(v, &frame);
        let gaps = self.gaps();
        let mut svg = self.head(&frame, &vertical, t0, t1, !gaps.is_empty());
        for &[from, to] in &self.axis.stance {
            let (from, to) = (x(from.max(t0)), x(to.min(t1)));
            if to > from {
                let (w, h) = (px(to - from), px(frame.bottom - frame.top));
                let _ = write!(
                    svg,
                    r#"<rect class="stance" x="{}" y="{}" width="{w}" height="{h}"/>"#,
                    px(from),
                    px(frame.top)
                );
            }
        }
        for [from, to] in gaps {
            hatch(&mut svg, &frame, x(from.max(t0)), x(to.min(t1)));
        }
        self.horizontal_axis(&mut svg, &frame, &x, t0, t1);
        self.vertical_axis(&mut svg, &frame, &vertical, &y);
        if let Some((value, _)) = self.bound.filter(|&(v, _)| (frame.top..=frame.bottom).contains(&y(v))) {
            let _ = write!(
                svg,
                r#"<path class="bound" d="M{} {}H{}"/>"#,
                px(frame.left),
                px(y(value)),
                px(frame.right)
            );
        }
        for band in &self.bands {
            self.surface(&mut svg, band, &x, &y);
        }
        for line in &self.lines {
            self.curve(&mut svg, line, &frame, &x, &y);
        }
        svg.push_str("</svg></figure>");
        svg
    }

    /// Spans of time without any value among the curves over the frames of the axis, out to halfway to the next frame with one.
    fn gaps(&self) -> Vec<[f64; 2]> {
        let time = &self.axis.time;
        let lines: Vec<&Line> = self.lines.iter().filter(|line| line.time.is_none()).collect();
        let missing = |i: usize| lines.iter().all(|line| !line.values.get(i).is_some_and(|v| v.is_finite()));
        let halfway = |i: usize, j: usize| 0.5 * (time[i] + time[j]);
        let mut gaps = Vec::new();
        let mut i = 0;
        while i < time.len() && !lines.is_empty() {
            let from = i;
            while i < time.len() && missing(i) {
                i += 1;
            }
            if i > from {
                let start = if from > 0 { halfway(from - 1, from) } else { time[from] };
                gaps.push([start, if i < time.len() { halfway(i - 1, i) } else { time[i - 1] }]);
            }
            i += 1;
        }
        gaps
    }

    fn frame(&self) -> Frame {
        let right_margin = if self.right.is_some() { 44.0 } else { 10.0 };
        match self.size {
            Size::Normal => {
                let (width, height) = (384.0, 236.0);
                let top = if self.axis.cycle.is_some() { 22.0 } else { 8.0 };
                Frame { left: 46.0, right: width - right_margin, top, bottom: height - 34.0, width, height }
            }
            Size::Small => {
                let (width, height) = (168.0, 112.0);
                Frame { left: 42.0, right: width - 6.0, top: 6.0, bottom: height - 28.0, width, height }
            }
        }
    }

    fn vertical(&self) -> Vertical {
        let wanted = if self.size == Size::Small { 3 } else { 5 };
        let of_bands = self.bands.iter().flat_map(|band| &band.ends).flatten();
        let range = extent(self.lines.iter().flat_map(|line| &line.values).chain(of_bands));
        if self.scale == Scale::Log {
            let (lo, hi) = range.unwrap_or((1e-12, 1e-6));
            let hi = self.bound.map_or(hi, |(v, _)| hi.max(v)).max(LOG_FLOOR);
            let (lo, hi) = (lo.max(LOG_FLOOR).log10().floor(), hi.log10().ceil());
            let hi = hi.max(lo + 1.0);
            return Vertical { lo, hi, log: true, ticks: Ticks::whole(lo, hi, wanted) };
        }
        let (mut lo, mut hi) = range.unwrap_or((0.0, 1.0));
        if self.scale == Scale::FromZero {
            (lo, hi) = (lo.min(0.0), hi.max(0.0));
            // Less than a pixel beyond zero, e.g. the round-off of a bound at zero, does not open the other side.
            if -lo < 2e-3 * hi {
                lo = 0.0;
            } else if hi < -2e-3 * lo {
                hi = 0.0;
            }
        }
        if let Some((bound, _)) = self.bound.filter(|&(v, _)| v <= 2.0 * hi) {
            hi = hi.max(bound * 1.02);
        }
        let largest = lo.abs().max(hi.abs());
        if largest == 0.0 {
            hi = 1.0;
        } else if hi - lo <= 1e-9 * largest {
            (lo, hi) = (lo - 0.1 * largest, hi + 0.1 * largest);
        }
        let step = round_step((hi - lo) / wanted as f64) / 2.0; // every other edge carries a tick
        let snapped = |v: f64| v.clamp(-LARGEST, LARGEST);
        (lo, hi) = (snapped((lo / step).floor() * step), snapped((hi / step).ceil() * step));
        Vertical { lo, hi, log: false, ticks: Ticks::new(lo, hi, wanted) }
    }

    /// Heading with legend, and the opening tag with what the script needs to read values back.
    fn head(&self, frame: &Frame, vertical: &Vertical, t0: f64, t1: f64, has_gaps: bool) -> String {
        let mut out = format!(
            r#"<figure class="{}"><figcaption><b>{}</b>"#,
            if self.size == Size::Small { "small" } else { "normal" },
            escape(&self.title)
        );
        if !self.note.is_empty() {
            let _ = write!(out, r#"<span class="note">{}</span>"#, escape(&self.note));
        }
        if self.size == Size::Normal {
            out.push_str(r#"<span class="legend">"#);
            let bound = self.bound.map(|(_, name)| (name.to_string(), "boundkey"));
            let keys = self.lines.iter().map(|line| (line.name.clone(), line.class));
            for (name, class) in keys.chain(bound).filter(|_| self.lines.len() > 1 || self.bound.is_some()) {
                let _ = write!(
                    out,
                    r#"<span><svg class="key" viewBox="0 0 18 8" aria-hidden="true"><path class="line {class}" d="M1 4H17"/></svg>{}</span>"#,
                    escape(&name)
                );
            }
            if has_gaps {
                let _ = write!(
                    out,
                    r#"<span><svg class="key" viewBox="0 0 18 8" aria-hidden="true"><path class="gap" d="M1 8L5 0M6 8L10 0M11 8L15 0"/></svg>{}</span>"#,
                    escape(self.gap)
                );
            }
            out.push_str("</span>");
        }
        let _ = write!(
            out,
            r#"</figcaption><svg class="plot" viewBox="0 0 {} {}" role="img" aria-label="{} over time, {}" data-frame="{} {} {} {}" data-domain="{t0:?} {t1:?} {:?} {:?}" data-unit="{}""#,
            px(frame.width),
            px(frame.height),
            escape(&self.title),
            escape(self.unit),
            px(frame.left),
            px(frame.right),
            px(frame.top),
            px(frame.bottom),
            vertical.lo,
            vertical.hi,
            escape(self.unit)
        );
        if vertical.log {
            out.push_str(r#" data-log="1""#);
        }
        if let Some(right) = self.right {
            let _ =
                write!(out, r#" data-right="{:?}" data-right-unit="{}""#, right.per_unit, escape(right.unit));
        }
        out.push('>');
        out
    }

    fn horizontal_axis(&self, svg: &mut String, frame: &Frame, x: &dyn Fn(f64) -> f64, t0: f64, t1: f64) {
        let small = self.size == Size::Small;
        let _ = write!(
            svg,
            r#"<path class="axis" d="M{} {}H{}"/>"#,
            px(frame.left),
            px(frame.bottom),
            px(frame.right)
        );
        let mut label = |at: f64, dy: f64, tick: f64, text: &str, class: &str| {
            let (at, edge) = (px(at), if tick > 0.0 { frame.bottom } else { frame.top });
            let _ = write!(
                svg,
                r#"<path class="axis" d="M{at} {}v{}"/><text class="{class}" x="{at}" y="{}">{text}</text>"#,
                px(edge),
                px(tick),
                px(edge + dy)
            );
        };
        let wanted = if small { 2 } else { 5 };
        let middle = (frame.left + frame.right) / 2.0;
        match self.axis.cycle {
            Some([start, end]) => {
                let percent = |t: f64| 100.0 * (t - start) / (end - start);
                let ticks = Ticks::new(percent(t0), percent(t1), wanted);
                for &p in &ticks.at {
                    label(x(start + p / 100.0 * (end - start)), 15.0, 4.0, &ticks.label(p), "mid");
                }
                if !small && self.axis.seconds {
                    let seconds = Ticks::new(t0, t1, 5);
                    // The corner belongs to the label of the vertical axis.
                    for &t in seconds.at.iter().filter(|&&t| x(t) > frame.left + 16.0) {
                        label(x(t), -7.0, -3.0, &format!("{} s", seconds.label(t)), "mid minor");
                    }
                }
            }
            None => {
                let ticks = Ticks::new(t0, t1, wanted);
                for &t in &ticks.at {
                    label(x(t), 15.0, 4.0, &ticks.label(t), "mid");
                }
            }
        }
        let title = if self.axis.cycle.is_some() { "% of gait cycle" } else { "time, s" };
        let y = px(frame.height - if small { 2.0 } else { 4.0 });
        let _ = write!(svg, r#"<text class="mid" x="{}" y="{y}">{title}</text>"#, px(middle));
    }

    fn vertical_axis(&self, svg: &mut String, frame: &Frame, vertical: &Vertical, y: &dyn Fn(f64) -> f64) {
        for &tick in &vertical.ticks.at {
            let (value, text) = if vertical.log {
                (10_f64.powf(tick), format!("1e{}", vertical.ticks.label(tick)))
            } else {
                (tick, vertical.ticks.label(tick))
            };
            let at = y(value);
            let class = if tick == 0.0 && !vertical.log { "zero" } else { "gridline" };
            let _ = write!(
                svg,
                r#"<path class="{class}" d="M{} {}H{}"/><text class="end" x="{}" y="{}">{text}</text>"#,
                px(frame.left),
                px(at),
                px(frame.right),
                px(frame.left - 5.0),
                px(at + 3.5)
            );
        }
        let _ = write!(
            svg,
            r#"<text class="mid" transform="translate({} {}) rotate(-90)">{}</text>"#,
            if self.size == Size::Small { 9 } else { 11 },
            px((frame.top + frame.bottom) / 2.0),
            escape(&axis_title(self.quantity, self.unit))
        );
        if let Some(right) = self.right {
            let ticks = Ticks::new(vertical.lo / right.per_unit, vertical.hi / right.per_unit, 4);
            for &tick in &ticks.at {
                let at = y(tick * right.per_unit);
                let _ = write!(
                    svg,
                    r#"<path class="axis" d="M{} {}h3"/><text class="minor" x="{}" y="{}">{}</text>"#,
                    px(frame.right),
                    px(at),
                    px(frame.right + 5.0),
                    px(at + 3.5),
                    ticks.label(tick)
                );
            }
            let _ = write!(
                svg,
                r#"<text class="mid minor" transform="translate({} {}) rotate(-90)">{}</text>"#,
                px(frame.width - 3.0),
                px((frame.top + frame.bottom) / 2.0),
                escape(&axis_title(self.quantity, right.unit))
            );
        }
    }

    /// The surface between the ends of a band, broken where either is missing.
    fn surface(&self, svg: &mut String, band: &Band, x: &dyn Fn(f64) -> f64, y: &dyn Fn(f64) -> f64) {
        let [lower, upper] = &band.ends;
        let seen = |i: &usize| lower[*i].abs() <= LARGEST && upper[*i].abs() <= LARGEST;
        let frames: Vec<usize> = (0..self.axis.time.len()).collect();
        let mut path = String::new();
        for run in frames.split(|i| !seen(i)).filter(|run| !run.is_empty()) {
            let there = run.iter().map(|&i| (i, upper[i]));
            let back = run.iter().rev().map(|&i| (i, lower[i]));
            for (k, (i, v)) in there.chain(back).enumerate() {
                let _ = write!(
                    path,
                    "{}{} {}",
                    if k == 0 { 'M' } else { 'L' },
                    px(x(self.axis.time[i])),
                    px(y(v))
                );
            }
            path.push('Z');
        }
        if !path.is_empty() {
            let name = escape(&band.name);
            let _ = write!(svg, r#"<path class="between {}" data-band="{name}" d="{path}"/>"#, band.class);
        }
    }

    /// A path that is broken where a value is missing; a lone sample becomes a dot.
    fn curve(
        &self,
        svg: &mut String,
        line: &Line,
        frame: &Frame,
        x: &dyn Fn(f64) -> f64,
        y: &dyn Fn(f64) -> f64,
    ) {
        let time = line.time.unwrap_or(&self.axis.time);
        let mut path = String::new();
        let mut area = String::new();
        let points: Vec<_> = time.iter().zip(&line.values).map(|(&t, &v)| (t, v)).collect();
        for run in points.split(|(t, v)| !(t.is_finite() && v.abs() <= LARGEST)).filter(|run| !run.is_empty())
        {
            for (i, &(t, v)) in run.iter().enumerate() {
                let _ = write!(path, "{}{} {}", if i == 0 { 'M' } else { 'L' }, px(x(t)), px(y(v)));
            }
            if run.len() == 1 {
                path.push_str("h0");
            }
            if self.size == Size::Small {
                let outline = &path[path.rfind('M').unwrap_or(0)..];
                let base = px(y(0.0).clamp(frame.top, frame.bottom));
                let (first, last) = (px(x(run[0].0)), px(x(run[run.len() - 1].0)));
                let _ = write!(area, "{}L{last} {base}L{first} {base}Z", outline.trim_end_matches("h0"));
            }
        }
        if !area.is_empty() {
            let _ = write!(svg, r#"<path class="area {}" d="{area}"/>"#, line.class);
        }
        if !path.is_empty() {
            let _ = write!(
                svg,
                r#"<path class="line {}" data-name="{}" d="{path}"/>"#,
                line.class,
                escape(&line.name)
            );
        }
    }
}

/// Strokes rising to the right, 6 units apart, over the full height between `left` and `right`; at least one unit wide.
fn hatch(svg: &mut String, frame: &Frame, left: f64, right: f64) {
    const APART: f64 = 6.0;
    let (left, right) = (left.max(frame.left), right.max(left + 1.0).min(frame.right));
    let (width, height) = (right - left, frame.bottom - frame.top);
    let mut path = String::new();
    // With x from the left and y up from the bottom, the stroke y = x + height − s, cut to the rectangle.
    let mut s = 0.5 * APART;
    while s < width + height {
        let (x0, y0) = if s < height { (0.0, height - s) } else { (s - height, 0.0) };
        let (x1, y1) = if s < width { (s, height) } else { (width, height - (s - width)) };
        let at = |x: f64, y: f64| format!("{} {}", px(left + x), px(frame.bottom - y));
        let _ = write!(path, "M{}L{}", at(x0, y0), at(x1, y1));
        s += APART;
    }
    let _ = write!(svg, r#"<path class="gap" d="{path}"/>"#);
}

/// `force, N`, or the quantity alone where it has no unit.
fn axis_title(quantity: &str, unit: &str) -> String {
    if unit.is_empty() { quantity.into() } else { format!("{quantity}, {unit}") }
}

impl Vertical {
    fn height_of(&self, value: f64, frame: &Frame) -> f64 {
        let value = if self.log { value.max(LOG_FLOOR).log10() } else { value };
        frame.bottom - (value - self.lo) / (self.hi - self.lo) * (frame.bottom - frame.top)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(values: Vec<f64>) -> (f64, f64) {
        let axis = TimeAxis { time: vec![0.0, 1.0], cycle: None, seconds: true, stance: vec![] };
        let line = Line { name: "f".into(), class: "c1", time: None, values };
        let plot = Plot {
            title: String::new(),
            note: String::new(),
            quantity: "force",
            unit: "N",
            axis: &axis,
            lines: vec![line],
            bands: Vec::new(),
            size: Size::Normal,
            scale: Scale::FromZero,
            right: None,
            bound: None,
            gap: "",
        };
        let vertical = plot.vertical();
        (vertical.lo, vertical.hi)
    }

    #[test]
    fn scales_hold_the_values_and_round_off_opens_no_other_side() {
        assert_eq!(range(vec![-1e-13, 1657.0]), (0.0, 1750.0));
        assert_eq!(range(vec![1e-13, -80.0]), (-80.0, 0.0));
        assert_eq!(range(vec![-30.0, 1657.0]), (-250.0, 1750.0));
        assert_eq!(range(vec![0.0, 0.0]), (0.0, 1.0));
    }
}
