//! The knee forces: as found, with all that they could be, with the scatter of their inputs, and beside measured ones.

use multibody::share::BAND_NAMES;
use multibody::trial::Table;

use coupling::samples::PEAKS;

use super::{Panel, capital, colour};
use crate::report::optimize::{View, words};
use crate::report::page::{grid, section, table};
use crate::report::plot::{Band, Line, Plot, RightAxis};
use crate::report::svg::fixed;
use crate::report::total_knee_force;

impl View<'_> {
    pub(in crate::report) fn knee(&self) -> String {
        let effort = self.report.effort;
        let mut lines = Vec::new();
        for name in ["medial", "lateral"] {
            if let Some(values) = effort.reactions.column(&format!("knee_{name}")) {
                lines.push(Line { name: name.into(), class: colour(name, 0), time: None, values });
            }
        }
        if let Some(values) = total_knee_force(effort) {
            lines.push(Line { name: "total".into(), class: "ink", time: None, values });
        }
        if lines.is_empty() {
            return String::new();
        }
        let mut figures = vec![self.force_plot("Tibiofemoral contact", lines)];
        let ligaments: Vec<usize> = self.reactions_on(Panel::Ligaments);
        if !ligaments.is_empty() {
            figures.push(self.reaction_plot(Panel::Ligaments, &ligaments));
        }
        let patella = self.reactions_on(Panel::Patella);
        if !patella.is_empty() {
            figures.push(self.reaction_plot(Panel::Patella, &patella));
        }
        section(
            "Knee forces",
            "Compression of the medial and lateral compartment and tension of the ligaments; a negative MCL stands in for the lateral ligament, which this knee lacks. Stance is shaded.",
            &grid("normal", &figures),
        )
    }

    /// Each joint force with everything that it could be.
    pub(in crate::report) fn bands(&self) -> String {
        let Some(bands) = self.report.bands else { return String::new() };
        let effort = self.report.effort;
        let right = Some(RightAxis { per_unit: self.report.body_weight(), unit: "body weights" });
        let figure = |&name: &&str| {
            let end = |end: &str| bands.column(&format!("{name}_{end}")).unwrap_or_default();
            let values = match name {
                "knee_total" => total_knee_force(effort),
                "hip" | "ankle" => resultant(&effort.reactions, name),
                _ => effort.reactions.column(name),
            };
            let short = name.trim_start_matches("knee_");
            let class = colour(short, 0);
            let line = Line { name: "found".into(), class, time: None, values: values.unwrap_or_default() };
            let band = Band { name: "any sharing".into(), class, ends: [end("least"), end("greatest")] };
            let title = capital(&words(name));
            Plot { right, bands: vec![band], ..self.plot(title, ["force", "N"], vec![line]) }.render()
        };
        section(
            "What sharing can decide",
            "The line is the force that was found. The surface is all that it could be: the least and the greatest over all muscle forces that carry the moments within their \
             bounds, whatever they cost. Where the surface is thin, geometry and loads decide; where it is wide, the cost does. Hip and ankle: along the force that was found.",
            &grid("normal", &BAND_NAMES.iter().map(figure).collect::<Vec<_>>()),
        )
    }

    /// Each knee force with its scatter, and where the scatter comes from.
    pub(in crate::report) fn samples(&self) -> String {
        let Some(samples) = self.report.samples else { return String::new() };
        let effort = self.report.effort;
        let right = Some(RightAxis { per_unit: self.report.body_weight(), unit: "body weights" });
        // On all frames of the axis: those between are interpolated.
        let on_axis = |name: String| -> Vec<f64> {
            let values = samples.bands.column(&name).unwrap_or_default();
            let between = |t: &f64| {
                let after = samples.time.partition_point(|s| s < t).clamp(1, values.len() - 1);
                let (a, b) = (samples.time[after - 1], samples.time[after]);
                let part = ((t - a) / (b - a)).clamp(0.0, 1.0);
                values[after - 1] + part * (values[after] - values[after - 1])
            };
            self.axis.time.iter().map(between).collect()
        };
        let figure = |name: &&'static str| {
            let class = colour(name.trim_start_matches("knee_"), 0);
            let found =
                if *name == "knee_total" { total_knee_force(effort) } else { effort.reactions.column(name) };
            let line = Line { name: "found".into(), class, time: None, values: found.unwrap_or_default() };
            let ends = [on_axis(format!("{name}_low")), on_axis(format!("{name}_high"))];
            let band = Band { name: "19 of 20 samples".into(), class, ends };
            Plot { right, bands: vec![band], ..self.plot(capital(&words(name)), ["force", "N"], vec![line]) }
                .render()
        };
        let figures: Vec<String> = PEAKS.iter().map(figure).collect();
        let both = |[value, error]: [f64; 2]| format!("{} ± {}", fixed(value, 2), fixed(error, 2));
        let rows: Vec<Vec<String>> = samples
            .indices
            .iter()
            .map(|i| vec![capital(&words(i.quantity)), i.group.into(), both(i.first), both(i.total)])
            .collect();
        let header =
            ["largest force", "inputs", "by themselves", "with all that they do together with others"];
        let lead = format!(
            "{} computations with inputs that scatter as they do between measurements and people; {} frames of them have no solution. The surface holds 19 of 20. \
             The table says which part of the scatter of the largest force comes from which inputs (Sobol indices with their standard errors).",
            samples.n, samples.unsolved
        );
        let content = format!("{}\n{}", grid("normal", &figures), table(&header, 2, &rows));
        section("How sure the knee forces are", &lead, &content)
    }

    pub(in crate::report) fn measured(&self) -> String {
        let Some(overlay) = self.report.measured else { return String::new() };
        let weight = self.report.body_weight();
        let mut figures = Vec::new();
        let mut rows = Vec::new();
        for (name, curve) in overlay.curves() {
            // On all frames of the axis: a curve over the compared ones alone would bridge what lies between.
            let on_axis = |values: &[f64]| {
                let at = |t: &f64| overlay.time.iter().position(|compared| compared == t);
                self.axis.time.iter().map(|t| at(t).map_or(f64::NAN, |i| values[i])).collect()
            };
            let line = |what: &str, class, values: &[f64]| Line {
                name: what.into(),
                class,
                time: None,
                values: on_axis(values),
            };
            let lines = vec![
                line("model", colour(name, 0), &curve.model),
                line("measured", "measured", &curve.measured),
            ];
            let right = Some(RightAxis { per_unit: weight, unit: "body weights" });
            let plot = Plot { right, gap: "not compared", ..self.plot(capital(name), ["force", "N"], lines) };
            figures.push(plot.render());
            let a = &curve.agreement;
            let optional = |v: Option<f64>| v.map_or("–".into(), |v| fixed(v, 2));
            let both = |n: f64| format!("{} ({})", fixed(n, 0), fixed(n / weight, 2));
            rows.push(vec![
                capital(name),
                both(a.rmse_N),
                optional(a.determination),
                optional(a.squared_correlation),
                both(a.peak_measured_N),
                both(a.peak_model_N),
                both(a.peak_error_N),
                both(a.largest_error_N),
            ]);
        }
        let header = [
            "",
            "RMSE, N (BW)",
            "1 − SSE/SST",
            "squared correlation",
            "measured peak, N (BW)",
            "model peak, N (BW)",
            "peak error, N (BW)",
            "largest error, N (BW)",
        ];
        let lead = format!(
            "Instrumented knee, interpolated linearly; all numbers are over {} of {} frames, the others have no solution or no measurement. Two numbers are called R²: 1 − SSE/SST counts an offset \
             and a wrong scale against the model, and is negative where the mean of the measurement would do better; the squared correlation ignores both.",
            overlay.time.len(),
            overlay.time.len() + overlay.frames_left_out
        );
        let content = format!("{}\n{}", grid("normal", &figures), table(&header, 1, &rows));
        section("Measured knee forces", &lead, &content)
    }
}

/// Length of the force of a joint \[N\]; `None` where it has no three components.
fn resultant(reactions: &Table, joint: &str) -> Option<Vec<f64>> {
    let [x, y, z] = ["x", "y", "z"].map(|axis| reactions.column(&format!("{joint}_{axis}")));
    let (x, y, z) = (x?, y?, z?);
    Some((0..x.len()).map(|i| (x[i] * x[i] + y[i] * y[i] + z[i] * z[i]).sqrt()).collect())
}
