//! How the fibres of every muscle were calibrated, and what became of two-way coupling.

use std::fmt::Write;

use super::{CompareReport, words};
use crate::report::anatomy::hue;
use crate::report::page::{section, table};
use crate::report::svg::{Ticks, escape, fixed, px, rows, significant};
use coupling::fibres::FibreCalibration;
use coupling::number::short;

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 330.0;
const LEFT: f64 = 52.0;
const RIGHT: f64 = WIDTH - 12.0;
const BOTTOM: f64 = HEIGHT - 36.0;
const TOP: f64 = 8.0;

/// Points of one muscle; joined or not.
struct Series {
    muscle: usize,
    points: Vec<[f64; 2]>,
    joined: bool,
}

/// Curves of thermal fibres, or forces found beside forces wanted of Hill fibres.
pub(super) fn section_of(report: &CompareReport) -> String {
    let title = "Fibre calibration";
    match &report.comparison.calibration.fibres {
        FibreCalibration::None => String::new(),
        FibreCalibration::Thermal(curves) => {
            let series =
                curves.iter().enumerate().filter(|(_, c)| c.force.len() > 1).map(|(muscle, c)| Series {
                    muscle,
                    points: c.contraction.iter().zip(&c.force).map(|(c, f)| [*c, *f]).collect(),
                    joined: true,
                });
            let figure = figure(
                report,
                &series.collect::<Vec<_>>(),
                ["contraction of the fibres", "force through the belly, N"],
                false,
            );
            let lead = "Every muscle alone, held in the posture of the mesh: which contraction of its fibres makes which force. The wanted force is looked up; muscles that are at rest in all steps have no curve.";
            section(title, lead, &figure)
        }
        FibreCalibration::Hill { muscles, .. } => {
            let series: Vec<Series> = muscles
                .iter()
                .enumerate()
                .map(|(muscle, m)| Series {
                    muscle,
                    points: m.samples.iter().map(|s| [s.rigid_at_length, s.found]).collect(),
                    joined: false,
                })
                .collect();
            let rows: Vec<Vec<String>> = muscles
                .iter()
                .map(|m| {
                    let most = m.samples.iter().map(|s| s.rigid_at_length).fold(0.0, f64::max);
                    vec![
                        words(&m.muscle),
                        fixed(m.fit.rest, 4),
                        fixed(m.fit.gain, 4),
                        m.samples.len().to_string(),
                        fixed(most, 0),
                        fixed(m.error(), 1),
                    ]
                })
                .collect();
            let header =
                ["Muscle", "Rest stretch", "Gain", "Samples", "Largest force, N", "Largest error, N"];
            let content = format!(
                "<div class=\"grid half\"><div>{}</div><div>{}</div></div>",
                figure(
                    report,
                    &series,
                    [
                        "force of the rigid lines at the same activation and length, N",
                        "force through the belly, N"
                    ],
                    true
                ),
                table(&header, 1, &rows)
            );
            let lead = match muscles.iter().any(|m| m.samples.len() > 1) {
                true => {
                    "Every muscle alone, at several activations in the posture of the mesh and in two others that no step has: force through its belly against the Hill model's at the same activation and fibre length."
                }
                false => {
                    "Every muscle alone, at the activation of the fit in the posture of the mesh: force through its belly against the Hill model's at the same fibre length. With accuracy.check_calibration = true other states are looked at, too."
                }
            };
            section(title, lead, &content)
        }
    }
}

fn figure(report: &CompareReport, all: &[Series], labels: [&str; 2], diagonal: bool) -> String {
    let values = |d: usize| all.iter().flat_map(|s| &s.points).map(move |p| p[d]).filter(|v| v.is_finite());
    let most = |d: usize| values(d).fold(1e-9, f64::max);
    let least = |d: usize| values(d).fold(0.0, f64::min);
    let (low, high) = ([least(0), least(1)], [most(0), most(1)]);
    let x = |v: f64| LEFT + (v - low[0]) / (high[0] - low[0]) * (RIGHT - LEFT);
    let y = |v: f64| BOTTOM - (v - low[1]) / (high[1] - low[1]) * (BOTTOM - TOP);
    let mut out = format!(
        "<figure class=\"wide\"><svg class=\"calibration\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{} over {}\">",
        px(WIDTH),
        px(HEIGHT),
        escape(labels[1]),
        escape(labels[0])
    );
    let horizontal = Ticks::new(low[0], high[0], 6);
    for &t in &horizontal.at {
        let _ = write!(
            out,
            "<path class=\"gridline\" d=\"M{} {}V{}\"/><text class=\"mid\" x=\"{0}\" y=\"{}\">{}</text>",
            px(x(t)),
            px(TOP),
            px(BOTTOM),
            px(BOTTOM + 15.0),
            horizontal.label(t)
        );
    }
    let vertical = Ticks::new(low[1], high[1], 6);
    rows(&mut out, &vertical, [LEFT, RIGHT], y, |t| vertical.label(t));
    let _ = write!(
        out,
        "<text class=\"mid\" x=\"{}\" y=\"{}\">{}</text><text class=\"mid\" transform=\"translate(11 {}) rotate(-90)\">{}</text>",
        px((LEFT + RIGHT) / 2.0),
        px(HEIGHT - 4.0),
        escape(labels[0]),
        px((TOP + BOTTOM) / 2.0),
        escape(labels[1])
    );
    if diagonal {
        let end = high[0].min(high[1]);
        let _ = write!(
            out,
            "<path class=\"bound\" d=\"M{} {}L{} {}\"/>",
            px(x(0.0)),
            px(y(0.0)),
            px(x(end)),
            px(y(end))
        );
    }
    for s in all {
        let name = escape(&words(&report.comparison.thigh.muscles[s.muscle].name));
        let mut d = String::new();
        for (i, p) in s.points.iter().filter(|p| p.iter().all(|v| v.is_finite())).enumerate() {
            let _ = match s.joined {
                true => write!(d, "{}{} {}", if i == 0 { 'M' } else { 'L' }, px(x(p[0])), px(y(p[1]))),
                false => write!(d, "M{} {}h0", px(x(p[0])), px(y(p[1]))),
            };
        }
        let width = if s.joined { "1.8" } else { "7" };
        let _ = write!(
            out,
            "<path class=\"line\" style=\"stroke:hsl({:.0} 55% 50%);stroke-width:{width}\" d=\"{d}\"><title>{name}</title></path>",
            hue(s.muscle)
        );
    }
    out.push_str("</svg></figure>");
    out
}

/// How the matrix of embedded muscles was softened; nothing without any.
pub(super) fn grids(report: &CompareReport) -> String {
    let rows: Vec<Vec<String>> = report
        .comparison
        .calibration
        .matrix
        .iter()
        .map(|m| {
            vec![
                words(&m.muscle),
                short(m.cell * 1e3),
                m.unknowns[0].to_string(),
                m.unknowns[1].to_string(),
                significant(m.of_mesh, 3),
                significant(m.of_grid, 3),
                fixed(m.factor, 3),
            ]
        })
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    section(
        "Muscles in grids",
        "Every muscle alone, passive, drawn out by a tenth of its length: the force with which it draws its bone back in its mesh and in its grid, and the factor on its matrix that makes them equal.",
        &table(
            &["Muscle", "Cube, mm", "Unknowns of the mesh", "of the grid", "Mesh, N", "Grid, N", "Factor"],
            1,
            &rows,
        ),
    )
}

/// Passes of two-way coupling; nothing without.
pub(super) fn passes(report: &CompareReport) -> String {
    if report.passes.is_empty() {
        return String::new();
    }
    let rows: Vec<Vec<String>> = report
        .passes
        .iter()
        .enumerate()
        .map(|(k, pass)| {
            vec![
                (k + 1).to_string(),
                pass.change.map_or("–".into(), |c| significant(c, 3)),
                significant(pass.largest_missing(), 3),
            ]
        })
        .collect();
    section(
        "Two-way coupling",
        "Forces and lever arms of the thigh go back into force sharing until they no longer change. Missing moment: what the joints lack when the forces of the thigh replace those of the rigid leg.",
        &table(&["Pass", "Change of the capacity", "Largest missing joint moment, N·m"], 0, &rows),
    )
}
