//! Bars: force of every muscle in the rigid leg and in both configurations.

use std::fmt::Write;

use super::{CompareReport, Row, step_words, words};
use crate::report::page::{grid, section};
use crate::report::svg::{Ticks, escape, fixed, px};

/// Width of a figure and where its bars begin, in user units.
const WIDTH: f64 = 600.0;
const LEFT: f64 = 172.0;
/// Height of one muscle with its three bars.
const ROW: f64 = 27.0;
const BAR: f64 = 6.6;
/// Class of its colour and name of each bar.
const BARS: [(&str, &str); 3] = [("ink", "rigid"), ("c2", "FE without contact"), ("c1", "FE with contact")];

/// A figure per step.
pub(super) fn bars(report: &CompareReport) -> String {
    let all: Vec<Vec<Row>> = (0..report.comparison.steps.len()).map(|k| report.rows(k)).collect();
    let figures: Vec<String> = report
        .comparison
        .steps
        .iter()
        .zip(&all)
        .map(|(step, rows)| figure(&step_words(step.name), rows))
        .collect();
    section(
        "Forces side by side",
        "Muscles from hip to knee as in the tables. Bars to the left of zero push.",
        &grid("half", &figures),
    )
}

/// Force of bar `bar` of a row \[N\].
fn force(row: &Row, bar: usize) -> Option<f64> {
    match bar {
        0 => Some(row.rigid),
        1 => row.fe.without.map(|f| f.total),
        _ => row.fe.with.map(|f| f.total),
    }
}

fn figure(title: &str, rows: &[Row]) -> String {
    let shown: Vec<usize> = (0..3).filter(|&b| rows.iter().any(|r| force(r, b).is_some())).collect();
    let forces =
        || rows.iter().flat_map(|r| shown.iter().filter_map(|&b| force(r, b))).filter(|f| f.is_finite());
    let (low, high) = (forces().fold(0.0, f64::min), forces().fold(0.0, f64::max));
    let high = if high > low { high } else { low + 1.0 };
    let (right, bottom) = (WIDTH - 44.0, ROW * rows.len() as f64 + 6.0);
    let x = |f: f64| LEFT + (f - low) / (high - low) * (right - LEFT);
    let mut out =
        format!("<figure class=\"wide\"><figcaption><b>{}</b><span class=\"legend\">", escape(title));
    for &b in &shown {
        let (class, name) = BARS[b];
        let _ = write!(
            out,
            "<span><svg class=\"key\" viewBox=\"0 0 18 8\" aria-hidden=\"true\"><rect class=\"{class}\" x=\"1\" y=\"1\" width=\"16\" height=\"6\"/></svg>{name}</span>"
        );
    }
    let _ = write!(
        out,
        "</span></figcaption><svg class=\"bars\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"muscle forces at {}\">",
        px(WIDTH),
        px(bottom + 32.0),
        escape(&title.to_lowercase())
    );
    let ticks = Ticks::new(low, high, 6);
    for &t in &ticks.at {
        let class = if t == 0.0 { "zero" } else { "gridline" };
        let _ = write!(
            out,
            "<path class=\"{class}\" d=\"M{} 2V{}\"/><text class=\"mid\" x=\"{0}\" y=\"{}\">{}</text>",
            px(x(t)),
            px(bottom),
            px(bottom + 14.0),
            ticks.label(t)
        );
    }
    let _ = write!(
        out,
        "<text class=\"mid\" x=\"{}\" y=\"{}\">force, N</text>",
        px((LEFT + right) / 2.0),
        px(bottom + 28.0)
    );
    for (i, row) in rows.iter().enumerate() {
        let top = 4.0 + ROW * i as f64;
        let _ = write!(
            out,
            "<text class=\"end name\" x=\"{}\" y=\"{}\">{}</text>",
            px(LEFT - 8.0),
            px(top + ROW / 2.0 + 2.5),
            escape(&words(&row.muscle))
        );
        let gap = (ROW - 4.0 - BAR * shown.len() as f64) / 2.0;
        for (slot, &b) in shown.iter().enumerate() {
            let Some(f) = force(row, b).filter(|f| f.is_finite()) else { continue };
            let (from, to) = (x(f.min(0.0)), x(f.max(0.0)));
            let (class, name) = BARS[b];
            let _ = write!(
                out,
                "<rect class=\"bar {class}\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"><title>{}, {name}: {} N</title></rect>",
                px(from),
                px(top + gap + BAR * slot as f64),
                px((to - from).max(0.6)),
                px(BAR - 0.9),
                escape(&words(&row.muscle)),
                fixed(f, 1)
            );
        }
    }
    out.push_str("</svg></figure>");
    out
}
