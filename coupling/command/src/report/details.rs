//! The last section of the page of `optimize`: what went wrong, subject, settings, muscles.

use std::fmt::Write;

use super::greatest;
use super::groups::grouped;
use super::optimize::View;
use super::page::{grid, label_table, list, section, table};
use super::problems::{Mark, Run};
use super::svg::{escape, extent, fixed};
use coupling::subject::GRAVITY;
use coupling::subject::words;

impl View<'_> {
    pub(super) fn details(&self) -> String {
        let report = self.report;
        let mut content = self.frames_not_solved();
        if !report.notes.is_empty() {
            let _ = write!(content, "<h3>Notes</h3>\n{}", list(report.notes.iter().map(|n| escape(n))));
        }
        let settings: Vec<_> = report.settings.to_vec();
        let tables = [label_table("Subject and trial", &self.subject()), label_table("Settings", &settings)];
        content.push_str(&grid("half", &tables));
        let left_out = report
            .left_out
            .iter()
            .map(|(what, why)| format!("{}: <span class=\"note\">{}</span>", escape(what), escape(why)));
        let lists = [
            format!("<div><h3>Simulated</h3>\n{}</div>", list(report.simulated.iter().map(|s| escape(s)))),
            format!("<div><h3>Left out</h3>\n{}</div>", list(left_out)),
        ];
        content.push_str(&grid("half", &lists));
        let _ = write!(content, "<h3>Muscles</h3>\n{}", self.muscle_table());
        let _ = write!(
            content,
            "<footer>Axes: x forward, y up, z to the right; a left leg is mirrored. Body weight: mass × {GRAVITY} m/s². \
             The numbers behind the figures stand in the CSV and STO files beside this page; what is needed to compute them again, with date and version, in run.json.</footer>"
        );
        section("Details", "", &content)
    }

    /// A row per run of frames that are not solved.
    pub(super) fn frames_not_solved(&self) -> String {
        let row = |run: &Run| vec![run.numbers(), self.span(run), run.mark.words().into(), run.why.clone()];
        let rows: Vec<Vec<String>> = self.runs.iter().filter(|r| r.mark != Mark::Solved).map(row).collect();
        if rows.is_empty() {
            return String::new();
        }
        format!(
            "<h3>Frames that are not solved</h3>\n{}",
            table(&["frames", "when", "verdict", "why"], 4, &rows)
        )
    }

    /// Subject, leg and frames in one line.
    pub(super) fn who(&self) -> String {
        let rows = self.subject();
        let value = |label: &str| rows.iter().find(|row| row.0 == label).map_or("", |row| row.1.as_str());
        format!("{} · frames: {}", value("Subject"), value("Frames"))
    }

    fn subject(&self) -> Vec<(String, String)> {
        let (trial, loads) = (self.report.trial, self.report.loads);
        let time = &self.report.effort.time;
        let (first, last) =
            (time.first().copied().unwrap_or(f64::NAN), time.last().copied().unwrap_or(f64::NAN));
        let mut rows = vec![
            ("Trial".to_string(), trial.name.clone()),
            ("Subject".into(), words(trial)),
            ("Frames".into(), format!("{}, {} to {} s", time.len(), fixed(first, 3), fixed(last, 3))),
            ("Markers".into(), trial.markers.len().to_string()),
        ];
        if let Some([start, end]) = self.report.cycle {
            rows.push(("Gait cycle".into(), format!("{} to {} s", fixed(start, 3), fixed(end, 3))));
        }
        let vertical: Vec<f64> = loads.ground_force.iter().map(|f| f.y).collect();
        if let Some((_, peak)) = extent(&vertical) {
            let bw = fixed(peak / self.report.body_weight(), 2);
            rows.push(("Peak vertical ground force".into(), format!("{} N ({bw} BW)", fixed(peak, 0))));
        }
        rows
    }

    fn muscle_table(&self) -> String {
        let effort = self.report.effort;
        let mut rows = Vec::new();
        for (group, members) in grouped(&effort.forces.columns) {
            for j in members {
                let Some(muscle) = self.report.muscles.get(j) else { continue };
                let force = greatest(effort.forces.values.column(j).iter().copied().zip(&effort.time));
                let activation = effort
                    .activations
                    .column(&effort.forces.columns[j])
                    .and_then(|a| extent(&a).map(|e| e.1))
                    .unwrap_or(f64::NAN);
                let peak = force.map_or(f64::NAN, |f| f.0);
                rows.push(vec![
                    effort.forces.columns[j].clone(),
                    muscle.full_name.clone(),
                    group.into(),
                    fixed(muscle.f_max, 0),
                    fixed(peak, 0),
                    fixed(100.0 * peak / muscle.f_max, 0),
                    force.filter(|f| f.0 > 0.5).map_or("–".into(), |f| self.when(*f.1)),
                    fixed(activation, 2),
                    muscle.clipped.map_or("–".into(), |c| fixed(100.0 * c, 1)),
                ]);
            }
        }
        let header = [
            "muscle",
            "name",
            "group",
            "strength, N",
            "peak force, N",
            "% of strength",
            "at",
            "peak activation",
            "clipped, % of frames",
        ];
        table(&header, 3, &rows)
    }
}
