//! What the page of `optimize` shows, in this order: verdict, figures, details.

use std::fmt::Write;

use multibody::sharing::KKT_TOLERANCE;

use super::page::document;
use super::plot::TimeAxis;
use super::problems::{Mark, Run, runs};
use super::svg::{escape, fixed, significant};
use super::{OptimizeReport, Reserve, STANCE_THRESHOLD, Summary};

/// The whole page. All tables of the report have one row per reported frame.
pub fn optimize_page(report: &OptimizeReport) -> String {
    let view = View::of(report);
    let body = [
        view.headline(),
        view.knee(),
        view.bands(),
        view.samples(),
        view.measured(),
        view.motion(),
        view.loads(),
        view.muscle_forces(),
        view.activations(),
        view.emg(),
        view.other_forces(),
        view.reserves(),
        view.quality(),
        view.details(),
    ]
    .concat();
    document(&format!("{} · static optimization · Sartorius", report.trial.name), &body)
}

pub(super) struct View<'a> {
    pub(super) report: &'a OptimizeReport<'a>,
    pub(super) axis: TimeAxis,
    pub(super) summary: Summary,
    /// How the frames ended, in order.
    pub(super) runs: Vec<Run>,
}

/// Style class and letter of how a frame ended.
pub(super) fn look(mark: Mark) -> (&'static str, char) {
    match mark {
        Mark::Solved => ("s", 'S'),
        Mark::Infeasible => ("i", 'I'),
        Mark::Failed => ("f", 'F'),
        Mark::NotFitted => ("m", 'M'),
    }
}

fn time_axis(report: &OptimizeReport) -> TimeAxis {
    let loads = report.loads;
    let mut stance = Vec::new();
    let standing: Vec<_> = loads.time.iter().zip(&loads.ground_force).map(|(&t, f)| (t, f.y)).collect();
    for run in standing.split(|(_, vertical)| *vertical <= STANCE_THRESHOLD) {
        if let (Some(first), Some(last)) = (run.first(), run.last()) {
            stance.push([first.0, last.0]);
        }
    }
    TimeAxis { time: report.effort.time.clone(), cycle: report.cycle, seconds: true, stance }
}

/// A column name for people: `hip_flexion` → `hip flexion`, `acl` → `ACL`.
pub(super) fn words(name: &str) -> String {
    match name {
        "acl" | "pcl" | "mcl" => name.to_uppercase(),
        _ => name.strip_suffix("_N").unwrap_or(name).replace('_', " "),
    }
}

impl<'a> View<'a> {
    pub(super) fn of(report: &'a OptimizeReport<'a>) -> View<'a> {
        let runs = runs(report.motion, report.effort);
        View { report, axis: time_axis(report), summary: Summary::of(report), runs }
    }

    /// `45 % (0.559 s)`, or the seconds alone.
    pub(super) fn when(&self, t: f64) -> String {
        match self.axis.percent(t) {
            Some(p) => format!("{} % ({} s)", fixed(p, 0), fixed(t, 3)),
            None => format!("{} s", fixed(t, 3)),
        }
    }

    fn headline(&self) -> String {
        let (s, trial) = (&self.summary, self.report.trial);
        let [start, end] = self.report.cycle.unwrap_or([0.0, 0.0]);
        let mut out = format!(
            "<header data-start=\"{start:?}\" data-end=\"{end:?}\">\n<p class=\"eyebrow\">Sartorius · static optimization of the lower limb</p>\n<h1>{}</h1>\n<p class=\"subtitle\">{}</p>\n",
            escape(&trial.name),
            escape(&self.who())
        );
        let others =
            [(s.infeasible, "infeasible"), (s.failed, "failed"), (s.not_fitted, "without marker fit")];
        let others: Vec<_> =
            others.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
        let (class, detail) = if s.all_solved() {
            ("ok", "Optimality of every frame was recomputed from its answer.".to_string())
        } else {
            ("bad", format!("{}; <a href=\"#details\">see why</a>", others.join(", ")))
        };
        let _ = writeln!(
            out,
            "<p class=\"verdict {class}\"><b>{} of {} frames solved</b><span>{}</span></p>",
            s.solved, s.frames, detail
        );
        if let Some(when) = s.largest_reserve_share_time_s {
            let class = if s.reserves.iter().any(Reserve::is_much) { "bad" } else { "ok" };
            let _ = writeln!(
                out,
                "<p class=\"verdict {class}\"><b>Reserve moments carry up to {} %</b><span>of the joint moments of a frame, at {}; \
                 muscle and joint forces lack it; <a href=\"#reserve-moments\">where and when</a></span></p>",
                fixed(100.0 * s.largest_reserve_share, 0),
                self.when(when)
            );
        }
        out.push_str(&self.tiles());
        out.push_str("<h3>Verdict over time</h3>\n");
        out.push_str(&self.band());
        out.push_str("</header>\n");
        out
    }

    fn tiles(&self) -> String {
        let s = &self.summary;
        let number = |v: Option<f64>, decimals| fixed(v.unwrap_or(f64::NAN), decimals);
        let knee_time =
            s.peak_knee_force_time_s.map_or_else(String::new, |t| format!(" at {}", self.when(t)));
        let residual = |v: Option<f64>| v.map_or("–".into(), |v| significant(v, 2));
        let over = s.over().map_or_else(String::new, |frames| format!(", over {frames}"));
        let tiles = [
            (
                "Peak knee force",
                number(s.peak_knee_force_bw, 2),
                "BW",
                format!("{} N{knee_time}{over}", number(s.peak_knee_force_N, 0)),
            ),
            (
                "Marker residual, RMS",
                number(s.marker_rms_mm, 1),
                "mm",
                format!("worst frame {} mm", number(s.worst_marker_rms_mm, 1)),
            ),
            (
                "Largest muscle load",
                number(s.largest_load.map(|l| 100.0 * l), 0),
                "% of strength",
                s.largest_load_muscle
                    .as_deref()
                    .map_or_else(String::new, |name| format!("{}{over}", self.full_name(name))),
            ),
            (
                "Largest KKT residual",
                residual(s.largest_kkt_residual),
                "",
                format!("among solved frames; tolerance {}", significant(KKT_TOLERANCE, 1)),
            ),
        ];
        let mut out = String::from("<div class=\"tiles\">\n");
        for (label, value, unit, below) in tiles {
            let _ = writeln!(
                out,
                "<div class=\"tile\"><span>{label}</span><b>{value} <small>{unit}</small></b><span>{}</span></div>",
                escape(&below)
            );
        }
        out.push_str("</div>\n");
        out
    }

    pub(super) fn full_name(&self, muscle: &str) -> String {
        let found = self.report.effort.forces.columns.iter().position(|c| c == muscle);
        found.and_then(|j| self.report.muscles.get(j)).map_or(muscle.into(), |m| m.full_name.clone())
    }

    /// One piece per run of frames that ended the same way, as long as it lasts: colour, letter, and the reason in its title.
    pub(super) fn band(&self) -> String {
        let time = &self.report.effort.time;
        let frames = |mark: Mark| {
            self.runs.iter().filter(move |r| r.mark == mark).map(|r| r.frames.len()).sum::<usize>()
        };
        let mut out = format!(
            "<div class=\"band\" role=\"img\" aria-label=\"{} of {} frames solved; the table below says which are not\">",
            frames(Mark::Solved),
            time.len()
        );
        for run in &self.runs {
            let (class, letter) = look(run.mark);
            let title =
                format!("frames {}, {}: {}. {}", run.numbers(), self.span(run), run.mark.words(), run.why);
            let _ = write!(
                out,
                "<span class=\"{class}\" style=\"flex-grow:{}\" title=\"{}\">{letter}</span>",
                run.frames.len(),
                escape(title.trim_end_matches(". "))
            );
        }
        out.push_str("</div>\n");
        if let (Some(first), Some(last)) = (time.first(), time.last()) {
            let _ = writeln!(
                out,
                "<div class=\"ends\"><span>{}</span><span>{}</span></div>",
                self.when(*first),
                self.when(*last)
            );
        }
        out.push_str("<div class=\"keys\">");
        for mark in Mark::ALL {
            let (class, letter) = look(mark);
            let n = frames(mark);
            if n > 0 || mark == Mark::Solved {
                let _ = write!(
                    out,
                    "<span><span class=\"band\"><span class=\"{class}\">{letter}</span></span>{}: {n}</span>",
                    mark.words()
                );
            }
        }
        out.push_str("</div>\n");
        out
    }

    /// From when to when a run of frames lasts.
    pub(super) fn span(&self, run: &Run) -> String {
        let time = &self.report.effort.time;
        let (first, last) = (time[run.frames.start], time[run.frames.end - 1]);
        if run.frames.len() == 1 {
            self.when(first)
        } else {
            format!("{} to {}", self.when(first), self.when(last))
        }
    }
}
