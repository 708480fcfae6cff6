//! Residual of every Newton iteration.

use std::fmt::Write;

use fem::run::Run;
use fem::solve::Iteration;

use super::{CompareReport, frame_label};
use crate::report::anatomy::hue;
use crate::report::page::{grid, section};
use crate::report::svg::{Ticks, escape, px, rows};

const WIDTH: f64 = 384.0;
const HEIGHT: f64 = 220.0;
const LEFT: f64 = 46.0;
const RIGHT: f64 = WIDTH - 10.0;
const TOP: f64 = 8.0;
const BOTTOM: f64 = HEIGHT - 34.0;

/// A figure per frame and configuration.
pub(super) fn section_of(report: &CompareReport) -> String {
    let mut figures = Vec::new();
    for (configuration, solution) in report.comparison.solutions.present() {
        let run = &solution.run;
        let unsolved = run.unsolved.iter().map(|f| (f, false));
        for (step, (frame, solved)) in run.frames.iter().map(|f| (f, true)).chain(unsolved).enumerate() {
            let title = format!("{}, {}", frame_label(report, frame.time, solved), configuration.name());
            figures.extend(figure(report, run, step, &title));
        }
    }
    if figures.is_empty() {
        return String::new();
    }
    section(
        "Convergence",
        "Residual after every Newton iteration, relative to the forces in play, one line per island: without contact every muscle is solved alone and has the colour of the viewer, with contact those that may touch are solved together. Jumps upwards begin a new load step.",
        &grid("normal", &figures),
    )
}

/// Residual over the forces in play, at least the one newton below which nothing is compared.
fn relative(row: &Iteration) -> f64 {
    (row.residual / row.force_scale.max(1.0)).clamp(1e-16, 1e16)
}

fn figure(report: &CompareReport, run: &Run, step: usize, title: &str) -> Option<String> {
    let mut islands: Vec<(&str, Vec<f64>)> = Vec::new();
    for row in run.iterations.iter().filter(|r| r.step == step && r.residual.is_finite()) {
        match islands.iter_mut().find(|(name, _)| *name == row.island) {
            Some((_, values)) => values.push(relative(row)),
            None => islands.push((&row.island, vec![relative(row)])),
        }
    }
    let most = islands.iter().map(|i| i.1.len()).max()?;
    let logs = || islands.iter().flat_map(|i| &i.1).map(|v| v.log10());
    let low = logs().fold(f64::INFINITY, f64::min).floor();
    let high = logs().fold(f64::NEG_INFINITY, f64::max).ceil().max(low + 1.0);
    let x = |i: usize| LEFT + i as f64 / (most.max(2) - 1) as f64 * (RIGHT - LEFT);
    let y = |log: f64| BOTTOM - (log - low) / (high - low) * (BOTTOM - TOP);
    let mut out = format!(
        "<figure class=\"normal\"><figcaption><b>{}</b></figcaption><svg class=\"residuals\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"residuals, {}\">",
        escape(title),
        px(WIDTH),
        px(HEIGHT),
        escape(title)
    );
    let vertical = Ticks::new(low, high, 5);
    rows(&mut out, &vertical, [LEFT, RIGHT], y, |t| format!("1e{}", vertical.label(t)));
    let horizontal = Ticks::new(0.0, (most - 1) as f64, 5);
    let whole = horizontal.at.iter().filter(|t| t.fract() == 0.0);
    for &t in whole {
        let at = px(x(t as usize));
        let _ = write!(
            out,
            "<path class=\"axis\" d=\"M{at} {}v4\"/><text class=\"mid\" x=\"{at}\" y=\"{}\">{t}</text>",
            px(BOTTOM),
            px(BOTTOM + 15.0)
        );
    }
    let _ = write!(
        out,
        "<path class=\"axis\" d=\"M{} {}H{}\"/><text class=\"mid\" x=\"{}\" y=\"{}\">Newton iterations</text>",
        px(LEFT),
        px(BOTTOM),
        px(RIGHT),
        px((LEFT + RIGHT) / 2.0),
        px(HEIGHT - 4.0)
    );
    let _ = write!(
        out,
        "<text class=\"mid\" transform=\"translate(11 {}) rotate(-90)\">residual / forces in play</text>",
        px((TOP + BOTTOM) / 2.0)
    );
    let alone = islands.len() > 1;
    for (name, values) in &islands {
        let d: String = values
            .iter()
            .enumerate()
            .map(|(i, v)| format!("{}{} {}", if i == 0 { 'M' } else { 'L' }, px(x(i)), px(y(v.log10()))))
            .collect();
        let muscle = report.comparison.thigh.muscles.iter().position(|m| m.name == *name);
        let colour = muscle
            .filter(|_| alone)
            .map_or(String::new(), |i| format!(" style=\"stroke:hsl({:.0} 55% 50%)\"", hue(i)));
        let dot = if values.len() == 1 { "h0" } else { "" };
        let _ = write!(
            out,
            "<path class=\"line c1\"{colour} d=\"{d}{dot}\"><title>{}: {} iterations</title></path>",
            escape(&name.replace('_', " ")),
            values.len() - 1
        );
    }
    out.push_str("</svg></figure>");
    Some(out)
}
