//! The page of `optimize` for both legs of a trial: verdicts side by side, and the curves of the two legs in the same figures.

use std::fmt::Write;

use multibody::trial::Table;
use serde::Serialize;

use super::figures::capital;
use super::groups::grouped;
use super::optimize::{View, words};
use super::page::{document, grid, section, table};
use super::plot::{Line, Plot, Scale, Size, TimeAxis};
use super::svg::{escape, extent, fixed};
use super::{OptimizeReport, Summary, total_knee_force};
use coupling::subject::who;

/// The numbers that decide, of each leg: verdict of `run.json`, output of `--json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BothLegs {
    /// Of the right leg.
    pub right: Summary,
    /// Of the left leg.
    pub left: Summary,
}

impl BothLegs {
    /// Of the reports of the right and of the left leg.
    pub fn of(legs: &[OptimizeReport; 2]) -> BothLegs {
        BothLegs { right: Summary::of(&legs[0]), left: Summary::of(&legs[1]) }
    }
}

/// The whole page. `legs`: the reports of the right and of the left leg, whose own pages lie in the folders of that name.
pub fn both_page(legs: [&OptimizeReport; 2]) -> String {
    let both = Both::of(legs);
    let body = [
        both.headline(),
        both.ground(),
        both.tables("Knee forces", "Compression of the two compartments of each knee.", "force", "N", &|r| {
            let names = ["knee_medial", "knee_lateral"];
            let mut columns: Vec<_> = names
                .iter()
                .filter_map(|n| Some((capital(&words(n)), r.effort.reactions.column(n)?)))
                .collect();
            columns.extend(total_knee_force(r.effort).map(|total| ("Knee total".to_string(), total)));
            columns
        }),
        both.tables(
            "Joint angles",
            "The left leg is mirrored, so a positive angle means the same on both sides.",
            "angle",
            "deg",
            &|r| {
                let failed = |i: usize| r.motion.fit[r.motion.report.start + i].failure.is_some();
                let rows = r.motion.report.clone();
                let angles = Table {
                    columns: r.motion.angles.columns.clone(),
                    values: r.motion.angles.values.rows(rows.start, rows.len()).into_owned(),
                };
                columns_of(&angles, &|i, v| if failed(i) { f64::NAN } else { v.to_degrees() })
            },
        ),
        both.tables(
            "Joint moments",
            "What the muscles must supply about each coordinate.",
            "moment",
            "N·m",
            &|r| columns_of(&r.loads.moments, &|_, v| v),
        ),
        both.muscles(),
    ]
    .concat();
    document(&format!("{} · both legs · Sartorius", legs[0].trial.name), &body)
}

/// Name and values of each.
type Columns = Vec<(String, Vec<f64>)>;

/// The columns of a table.
fn columns_of(table: &Table, value: &dyn Fn(usize, f64) -> f64) -> Columns {
    let values = |j| table.values.column(j).iter().enumerate().map(|(i, v)| value(i, *v)).collect();
    table.columns.iter().enumerate().map(|(j, name)| (capital(&words(name)), values(j))).collect()
}

struct Both<'a> {
    /// What the pages of the legs show.
    legs: [View<'a>; 2],
    axis: TimeAxis,
    /// Time on that axis of the reported frames of each leg.
    times: [Vec<f64>; 2],
}

/// Name and class of the colour of each leg.
const LEGS: [(&str, &str); 2] = [("right", "c1"), ("left", "c2")];

impl<'a> Both<'a> {
    fn of(legs: [&'a OptimizeReport<'a>; 2]) -> Both<'a> {
        // Cycles are compared by their fraction, ranges of time on the clock of the recording.
        let cycles = (legs[0].cycle, legs[1].cycle);
        let times = match cycles {
            (Some(a), Some(b)) => [(legs[0], a), (legs[1], b)]
                .map(|(l, [start, end])| l.effort.time.iter().map(|t| (t - start) / (end - start)).collect()),
            _ => legs.map(|l| l.effort.time.clone()),
        };
        let all = times.iter().flatten();
        let (low, high) = extent(all).unwrap_or((0.0, 1.0));
        let cycle = cycles.0.and(cycles.1).map(|_| [0.0, 1.0]);
        let axis = TimeAxis { time: vec![low, high], cycle, seconds: false, stance: Vec::new() };
        Both { legs: legs.map(View::of), axis, times }
    }

    fn plot(
        &self,
        title: String,
        axis: [&'static str; 2],
        size: Size,
        values: [Option<Vec<f64>>; 2],
    ) -> String {
        let lines = LEGS.iter().zip(values).zip(&self.times).filter_map(|(((name, class), values), time)| {
            Some(Line { name: name.to_string(), class, time: Some(time), values: values? })
        });
        let lines = lines.collect();
        let [quantity, unit] = axis;
        Plot {
            title,
            note: String::new(),
            quantity,
            unit,
            axis: &self.axis,
            lines,
            bands: Vec::new(),
            size,
            scale: Scale::FromZero,
            right: None,
            bound: None,
            gap: "",
        }
        .render()
    }

    /// A figure per column that one of the legs has.
    fn figures(
        &self,
        axis: [&'static str; 2],
        size: Size,
        of: &dyn Fn(&OptimizeReport) -> Columns,
    ) -> Vec<String> {
        let [right, left] = self.legs.each_ref().map(|leg| of(leg.report));
        let mut names: Vec<&String> = right.iter().map(|c| &c.0).collect();
        names.extend(left.iter().map(|c| &c.0).filter(|n| right.iter().all(|c| c.0 != **n)));
        let find = |columns: &[(String, Vec<f64>)], name: &str| {
            columns.iter().find(|c| c.0 == name).map(|c| c.1.clone())
        };
        names
            .iter()
            .map(|name| self.plot(name.to_string(), axis, size, [find(&right, name), find(&left, name)]))
            .collect()
    }

    fn tables(
        &self,
        title: &str,
        lead: &str,
        quantity: &'static str,
        unit: &'static str,
        of: &dyn Fn(&OptimizeReport) -> Columns,
    ) -> String {
        let figures = self.figures([quantity, unit], Size::Normal, of);
        if figures.is_empty() { String::new() } else { section(title, lead, &grid("normal", &figures)) }
    }

    fn headline(&self) -> String {
        let is_fraction = self.axis.cycle.is_some();
        let first = self.legs[0].report;
        let mut out = format!(
            "<header data-start=\"0\" data-end=\"{}\"{}>\n<p class=\"eyebrow\">Sartorius · static optimization of both legs</p>\n<h1>{}</h1>\n<p class=\"subtitle\">{}</p>\n",
            u8::from(is_fraction),
            if is_fraction { " data-fraction=\"1\"" } else { "" },
            escape(&first.trial.name),
            escape(&who(first.trial))
        );
        let all = self.legs.iter().all(|leg| leg.summary.all_solved());
        let count = |((name, _), leg): (&(&str, &str), &View)| {
            format!("{name} {} of {}", leg.summary.solved, leg.summary.frames)
        };
        let counts = LEGS.iter().zip(&self.legs).map(count);
        let _ = writeln!(
            out,
            "<p class=\"verdict {}\"><b>{} frames solved</b><span>all about one leg: <a href=\"right/report.html\">right</a>, <a href=\"left/report.html\">left</a></span></p>",
            if all { "ok" } else { "bad" },
            capital(&counts.collect::<Vec<_>>().join(", "))
        );
        let rows = table(&["", "Right leg", "Left leg"], 1, &self.rows());
        let _ = writeln!(out, "<div class=\"narrow\">{rows}</div>");
        let peaks =
            if all { "" } else { " Peaks and loads are over solved frames; curves have gaps at the others." };
        let _ = writeln!(
            out,
            "<p class=\"lead\">{}{peaks}</p>",
            match is_fraction {
                true => "Curves are over the fraction of each leg's own gait cycle.",
                false => "Curves are over the time of the recording, as far as each leg is reported.",
            }
        );
        for (view, (name, _)) in self.legs.iter().zip(LEGS) {
            let _ = write!(out, "<h3>Verdict over time, {name} leg</h3>\n{}", view.band());
            out.push_str(&view.frames_not_solved());
        }
        out.push_str("</header>\n");
        out
    }

    /// The numbers that decide: what, right, left.
    fn rows(&self) -> Vec<Vec<String>> {
        let s = self.legs.each_ref().map(|leg| &leg.summary);
        let number = |v: Option<f64>, digits| fixed(v.unwrap_or(f64::NAN), digits);
        let when = |leg: usize, t: Option<f64>| t.map_or("–".to_string(), |t| self.legs[leg].when(t));
        let mut rows: Vec<Vec<String>> = Vec::new();
        let mut row = |label: &str, of: &dyn Fn(usize) -> String| rows.push(vec![label.into(), of(0), of(1)]);
        row("Frames solved", &|l| format!("{} of {}", s[l].solved, s[l].frames));
        row("Marker residual, RMS, mm", &|l| number(s[l].marker_rms_mm, 1));
        row("Peak vertical ground reaction, N", &|l| {
            let up: Vec<f64> = self.legs[l].report.loads.ground_force.iter().map(|f| f.y).collect();
            number(extent(&up).map(|e| e.1), 0)
        });
        row("Peak knee force, N", &|l| number(s[l].peak_knee_force_N, 0));
        row("Peak knee force, body weights", &|l| number(s[l].peak_knee_force_bw, 2));
        row("Peak knee force, when", &|l| when(l, s[l].peak_knee_force_time_s));
        row("Largest muscle load, % of strength", &|l| number(s[l].largest_load.map(|v| 100.0 * v), 0));
        row("Largest muscle load, of", &|l| s[l].largest_load_muscle.clone().unwrap_or_else(|| "–".into()));
        if s.iter().any(|s| s.largest_reserve_share_time_s.is_some()) {
            row("Reserves, % of the moments of a frame", &|l| fixed(100.0 * s[l].largest_reserve_share, 0));
        }
        rows
    }

    fn ground(&self) -> String {
        self.tables(
            "Ground reaction",
            "Force of the ground on each foot; lateral is away from the other leg.",
            "force",
            "N",
            &|r| {
                ["Forward", "Up", "Lateral"]
                    .iter()
                    .enumerate()
                    .map(|(d, name)| (name.to_string(), r.loads.ground_force.iter().map(|f| f[d]).collect()))
                    .collect()
            },
        )
    }

    fn muscles(&self) -> String {
        let key = |(name, class): (&str, &str)| {
            format!(
                "<span><svg class=\"key\" viewBox=\"0 0 18 8\" aria-hidden=\"true\"><path class=\"line {class}\" d=\"M1 4H17\"/></svg>{name}</span>"
            )
        };
        let mut content = format!("<div class=\"legend\">{}</div>\n", LEGS.map(key).concat());
        let columns = &self.legs[0].report.effort.forces.columns;
        for (title, members) in grouped(columns) {
            let names: Vec<&String> = members.iter().map(|&j| &columns[j]).collect();
            let figures = self.figures(["force", "N"], Size::Small, &|r| {
                names.iter().filter_map(|n| Some((n.to_string(), r.effort.forces.column(n)?))).collect()
            });
            let _ = write!(content, "<h3>{title}</h3>\n{}\n", grid("small", &figures));
        }
        section("Muscle forces", "Each muscle on its own scale, the right leg and the left one.", &content)
    }
}
