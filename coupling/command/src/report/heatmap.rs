//! Muscles × time as shades of one colour, inline SVG.

use std::fmt::Write;

use super::plot::TimeAxis;
use super::svg::{Ticks, escape, px};

/// One row of the map.
#[derive(Clone, Debug)]
pub struct Row {
    /// Shown at the left.
    pub name: String,
    /// One value per frame, 0..1; what is not finite is drawn hatched.
    pub values: Vec<f64>,
}

/// Rows under a common heading.
#[derive(Clone, Debug)]
pub struct Block {
    /// Heading.
    pub title: String,
    /// Its rows.
    pub rows: Vec<Row>,
}

/// Number of shades; more cannot be told apart.
const SHADES: usize = 20;
const ROW: f64 = 13.0;
const WIDTH: f64 = 560.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = WIDTH - 10.0;

/// The figure as HTML. Cells of equal shade that touch are drawn as one stroke.
pub fn heatmap(title: &str, axis: &TimeAxis, blocks: &[Block]) -> String {
    let n = axis.time.len().max(1);
    let edge = |i: usize| LEFT + (RIGHT - LEFT) * i as f64 / n as f64;
    let mut body = String::new();
    let mut top = 4.0;
    for block in blocks {
        let _ = write!(
            body,
            r#"<text class="head" x="{}" y="{}">{}</text>"#,
            px(LEFT),
            px(top + 11.0),
            escape(&block.title)
        );
        top += 16.0;
        for row in &block.rows {
            draw_row(&mut body, row, top, &edge);
            top += ROW;
        }
        top += 5.0;
    }
    let (start, end) = (axis.time.first().copied().unwrap_or(0.0), axis.time.last().copied().unwrap_or(1.0));
    let (unit, lo, hi) = match (axis.percent(start), axis.percent(end)) {
        (Some(lo), Some(hi)) => ("% of gait cycle", lo, hi),
        _ => ("time, s", start, end),
    };
    let ticks = Ticks::new(lo, hi, 5);
    for &tick in &ticks.at {
        // A frame is drawn around its centre, so the first tick stands half a cell inside.
        let s = if hi > lo { (tick - lo) / (hi - lo) } else { 0.0 };
        let x = edge(0) + (RIGHT - LEFT) * (0.5 + s * (n as f64 - 1.0)) / n as f64;
        let _ = write!(
            body,
            r#"<path class="axis" d="M{} {}v4"/><text class="mid" x="{}" y="{}">{}</text>"#,
            px(x),
            px(top),
            px(x),
            px(top + 15.0),
            ticks.label(tick)
        );
    }
    let middle = px((LEFT + RIGHT) / 2.0);
    let _ = write!(body, r#"<text class="mid" x="{middle}" y="{}">{unit}</text>"#, px(top + 29.0));
    format!(
        r#"<figure class="heat wide"><svg class="heatmap" viewBox="0 0 {} {}" role="img" aria-label="{}" data-frame="{} {}">{body}</svg></figure>"#,
        px(WIDTH),
        px(top + 34.0),
        escape(title),
        px(LEFT),
        px(RIGHT)
    )
}

fn draw_row(body: &mut String, row: &Row, top: f64, edge: &dyn Fn(usize) -> f64) {
    let middle = top + ROW / 2.0;
    let percents: Vec<String> = row
        .values
        .iter()
        .map(|v| if v.is_finite() { format!("{:.0}", 100.0 * v) } else { String::new() })
        .collect();
    let _ = write!(
        body,
        r#"<g class="row" data-name="{}" data-y="{}" data-values="{}"><text class="end" x="{}" y="{}">{}</text>"#,
        escape(&row.name),
        px(middle),
        percents.join(","),
        px(LEFT - 5.0),
        px(middle + 3.5),
        escape(&row.name)
    );
    let _ = write!(
        body,
        r#"<path class="track" d="M{} {}H{}"/>"#,
        px(edge(0)),
        px(middle),
        px(edge(row.values.len()))
    );
    let mut paths = vec![String::new(); SHADES + 1];
    let mut missing = String::new();
    let mut from = 0;
    for run in row.values.chunk_by(|a, b| shade(*a) == shade(*b)) {
        let to = from + run.len();
        let path = match shade(run[0]) {
            None => Some(&mut missing),
            Some(0) => None,
            Some(level) => Some(&mut paths[level]),
        };
        if let Some(path) = path {
            let _ = write!(path, "M{} {}H{}", px(edge(from)), px(middle), px(edge(to)));
        }
        from = to;
    }
    for (level, path) in paths.iter().enumerate().filter(|(_, path)| !path.is_empty()) {
        let opacity = px(level as f64 / SHADES as f64);
        let _ = write!(body, r#"<path class="cell" stroke-opacity="{opacity}" d="{path}"/>"#);
    }
    if !missing.is_empty() {
        let _ = write!(body, r#"<path class="missing" d="{missing}"/>"#);
    }
    body.push_str("</g>");
}

/// Which shade a value gets; `None` where it is missing.
fn shade(value: f64) -> Option<usize> {
    value.is_finite().then(|| (value.clamp(0.0, 1.0) * SHADES as f64).round() as usize)
}
