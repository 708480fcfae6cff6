//! The page of `study`: how many runs are solved and why others are not, numbers with their spread, bands, and what the numbers follow.

mod figures;

use std::path::Path;

use coupling::number::{fixed, significant};
use coupling::study::Study;
use coupling::study::indices::NINETEEN_OF_TWENTY;
use coupling::study::rows::{Cell, OfGroup, Row, Rows};
use coupling::study::run::{Curves, RunStatus, Set};
use coupling::study::statistics::{BAND, chance, mean_and_sd, percentiles, rank_correlation, resampled};

use super::page::{document, grid, section, table};
use super::svg::escape;
use figures::{Band, Dots, bands, scatter};

/// Instants of a band.
const INSTANTS: usize = 101;
/// Curves that the page shows as bands: the knee, its compartments and ligaments, the hip, and the muscles that carry most.
const BANDS: usize = 12;
/// Runs whose curves make a band; of more, as many evenly spaced ones, so that the page does not hang on all files of a large study.
const CURVES: usize = 3000;
/// Numbers that the page tells of.
const NUMBERS: usize = 40;
/// Inputs that are named per number.
const INPUTS: usize = 5;
/// Figures of one number against one input.
const SCATTERS: usize = 6;
/// Dots of a figure.
const DOTS: usize = 2000;

/// Everything that the page shows.
pub struct StudyReport<'a> {
    study: &'a Study,
    rows: &'a Rows,
    indices: &'a [OfGroup],
    out: &'a Path,
}

/// How closely a number follows an input.
struct Follows {
    number: usize,
    input: usize,
    setting: usize,
    rho: f64,
}

impl<'a> StudyReport<'a> {
    /// Of a study and what is done of it below `out`.
    pub fn new(study: &'a Study, rows: &'a Rows, indices: &'a [OfGroup], out: &'a Path) -> StudyReport<'a> {
        StudyReport { study, rows, indices, out }
    }

    /// Solved runs of a subject and a setting, with their numbers in the study; of all subjects where none is given. Those with exchanged values are in the
    /// indices alone: they hang on others.
    fn solved(&self, subject: Option<usize>, setting: usize) -> Vec<(usize, &'a Row)> {
        let wanted = |(_, row): &(usize, &Row)| {
            row.status == RunStatus::Solved
                && row.setting == setting
                && !matches!(row.set, Set::Exchanged(_))
                && subject.is_none_or(|s| row.subject == s)
        };
        self.rows.done().filter(wanted).collect()
    }

    /// A number of these runs.
    fn values(&self, runs: &[(usize, &Row)], number: usize) -> Vec<f64> {
        runs.iter().filter_map(|(_, row)| self.rows.number(row, number)).collect()
    }

    /// Value of an input and of a number in every run that has both.
    fn pairs(&self, runs: &[(usize, &Row)], input: usize, number: usize) -> Vec<[f64; 2]> {
        let pair = |(_, row): &(usize, &Row)| match row.values[input] {
            Cell::Number(value) => Some([value, self.rows.number(row, number)?]),
            Cell::Word(_) => None,
        };
        runs.iter().filter_map(pair).collect()
    }

    /// Places of the numbers that the page tells of: the knee first, then the largest.
    fn numbers(&self) -> Vec<usize> {
        let all: Vec<(usize, &Row)> = self.rows.done().collect();
        let mean = |k: usize| {
            let values = self.values(&all, k);
            values.iter().sum::<f64>().abs() / values.len().max(1) as f64
        };
        let names = &self.rows.numbers;
        let mut order: Vec<(bool, f64, usize)> =
            names.iter().enumerate().map(|(k, name)| (name == "peak_knee_N", mean(k), k)).collect();
        order.sort_by(|a, b| b.0.cmp(&a.0).then(b.1.total_cmp(&a.1)).then(a.2.cmp(&b.2)));
        order.into_iter().take(NUMBERS).map(|(_, _, k)| k).collect()
    }

    /// Which inputs a number follows more closely than chance in one of twenty studies of as many inputs; the closest first.
    fn followed(&self, numbers: &[usize]) -> Vec<Follows> {
        let mut found = Vec::new();
        for setting in 0..self.study.settings.len() {
            let solved = self.solved(None, setting);
            let threshold = chance(solved.len(), 20.0 * self.rows.inputs.len().max(1) as f64);
            for &number in numbers {
                for input in 0..self.rows.inputs.len() {
                    let pairs = self.pairs(&solved, input, number);
                    let [a, b] = [0, 1].map(|k| pairs.iter().map(|p| p[k]).collect::<Vec<f64>>());
                    let Some(rho) = rank_correlation(&a, &b).filter(|rho| rho.abs() > threshold) else {
                        continue;
                    };
                    found.push(Follows { number, input, setting, rho });
                }
            }
        }
        found.sort_by(|a, b| b.rho.abs().total_cmp(&a.rho.abs()));
        found
    }
}

/// The whole page.
pub fn study_page(report: &StudyReport) -> String {
    let StudyReport { study, rows, .. } = report;
    let (all, solved) = (study.n_runs(), rows.solved());
    let class = if solved == all { "verdict" } else { "verdict bad" };
    let mut body = format!(
        "<header><p class=\"eyebrow\">Study</p><h1>{}</h1></header>\n<p class=\"{class}\"><b>{solved} of {all} runs solved</b><span>{} subjects, {} settings, {} samples of {} dimensions{}</span></p>\n",
        escape(&study.name),
        study.subjects.len(),
        study.settings.len(),
        study.samples,
        study.dimensions.len(),
        if study.indices { format!(", {} sets of values each", study.n_sets()) } else { String::new() }
    );
    body += &section("Runs", "", &runs(report));
    if solved < all {
        let lead = "Rows without results: they are in the table, and in no number, band or correlation of this page.";
        body += &section("Failures by reason", lead, &failures(report));
    }
    let numbers = report.numbers();
    let lead = "Mean and standard deviation of the solved runs; 5, 50 and 95 of a hundred lie below. The largest numbers; all are in the table.";
    body += &section("Numbers", lead, &spread(report, &numbers));
    if study.curves && study.scene.is_none() {
        let lead = "Line: median of the solved runs. Dark: half of all runs. Light: nine tenths.";
        body += &section("Bands", lead, &band_figures(report));
    }
    if study.indices {
        let lead = "Sobol indices: the part of the variance of a number that comes from what varies, by itself (first order) and with all that it does together with others (total). Behind ± is half a 95 % confidence interval. Runs with exchanged values count here alone.";
        body += &section("Where the scatter comes from", lead, &parts(report, &numbers));
    }
    if !rows.inputs.is_empty() {
        let followed = report.followed(&numbers);
        let lead = "Rank correlation (Spearman) of a number with what varies, over the solved runs of a setting, all subjects together. Shown is what chance exceeds in one of twenty studies with as many inputs.";
        body += &section("What the numbers follow", lead, &sensitivity(report, &numbers, &followed));
        body += &section("Scatter", "The closest of these, each number once.", &scatters(report, &followed));
    }
    document(&format!("Study: {}", study.name), &body)
}

fn runs(report: &StudyReport) -> String {
    let StudyReport { study, rows, .. } = report;
    let mut lines = Vec::new();
    for (i, subject) in study.subjects.iter().enumerate() {
        for (j, setting) in study.settings.iter().enumerate() {
            let of = |status: Option<RunStatus>| {
                let own = rows.done().filter(|(_, row)| row.subject == i && row.setting == j);
                own.filter(|(_, row)| status.is_none_or(|s| row.status == s)).count()
            };
            let statuses = [RunStatus::NotConverged, RunStatus::Refused, RunStatus::Killed];
            let runs = study.samples * study.n_sets();
            let mut cells = vec![subject.name.clone(), setting.name.clone(), runs.to_string()];
            cells.extend([of(Some(RunStatus::Solved)).to_string()]);
            cells.extend(statuses.map(|s| of(Some(s)).to_string()));
            cells.push((runs - of(None)).to_string());
            lines.push(cells);
        }
    }
    let header = ["subject", "setting", "runs", "solved", "not converged", "refused", "killed", "missing"];
    table(&header, 2, &lines)
}

fn failures(report: &StudyReport) -> String {
    let lines: Vec<Vec<String>> = report
        .rows
        .failures()
        .iter()
        .map(|f| {
            vec![
                f.status.name().replace('_', " "),
                f.reason.clone(),
                f.runs[0].to_string(),
                f.runs.len().to_string(),
            ]
        })
        .collect();
    table(&["status", "reason", "first run", "runs"], 2, &lines)
}

fn spread(report: &StudyReport, numbers: &[usize]) -> String {
    let mut lines = Vec::new();
    for &number in numbers {
        let name = &report.rows.numbers[number];
        for (k, subject) in report.study.subjects.iter().enumerate() {
            for (setting, named) in report.study.settings.iter().enumerate() {
                let values = report.values(&report.solved(Some(k), setting), number);
                let Some([low, median, high]) = percentiles(&values, [0.05, 0.5, 0.95]) else { continue };
                let [mean, sd] = mean_and_sd(&values).map_or([f64::NAN; 2], |m| m);
                let shown = |v: f64| if v.is_finite() { significant(v, 4) } else { "–".into() };
                lines.push(vec![
                    name.replace('_', " "),
                    subject.name.clone(),
                    named.name.clone(),
                    shown(mean),
                    shown(sd),
                    shown(low),
                    shown(median),
                    shown(high),
                ]);
            }
        }
    }
    table(&["number", "subject", "setting", "mean", "sd", "5 %", "50 %", "95 %"], 3, &lines)
}

fn band_figures(report: &StudyReport) -> String {
    let mut figures = Vec::new();
    for (s, subject) in report.study.subjects.iter().enumerate() {
        let curves: Vec<Vec<Curves>> = (0..report.study.settings.len())
            .map(|setting| {
                let solved = report.solved(Some(s), setting);
                let every = solved.len().div_ceil(CURVES).max(1);
                solved.iter().step_by(every).filter_map(|(run, _)| Curves::read(report.out, *run)).collect()
            })
            .collect();
        let Some(first) = curves.iter().flatten().next() else { continue };
        // As the numbers go: the knee, then what carries most.
        let names = report.numbers().into_iter().map(|i| &report.rows.numbers[i]);
        let shown: Vec<usize> = names
            .filter_map(|n| n.strip_prefix("peak_")?.strip_suffix("_N"))
            .filter_map(|n| first.columns.iter().position(|(name, _)| name == n))
            .take(BANDS)
            .collect();
        for column in shown {
            let name = &first.columns[column].0;
            let of: Vec<Band> = curves
                .iter()
                .zip(&report.study.settings)
                .map(|(runs, setting)| Band { name: &setting.name, percentiles: band(runs, name) })
                .collect();
            let title = match report.study.subjects.len() {
                1 => name.replace('_', " "),
                _ => format!("{}, {}", name.replace('_', " "), subject.name),
            };
            figures.push(bands(&title, &of));
        }
    }
    grid("normal", &figures)
}

/// Percentiles of a curve at evenly spaced instants.
fn band(runs: &[Curves], name: &str) -> Vec<Option<[f64; 5]>> {
    let resample = |run: &Curves| {
        let values = &run.columns.iter().find(|(n, _)| n == name)?.1;
        Some(resampled(&run.time, values, INSTANTS))
    };
    let curves: Vec<Vec<f64>> = runs.iter().filter_map(resample).collect();
    (0..INSTANTS).map(|i| percentiles(&curves.iter().map(|c| c[i]).collect::<Vec<f64>>(), BAND)).collect()
}

/// Sobol indices of the numbers that the page tells of, a column per `[[vary]]`.
fn parts(report: &StudyReport, numbers: &[usize]) -> String {
    let StudyReport { study, rows, .. } = report;
    let mut lines = Vec::new();
    for &number in numbers {
        for (k, subject) in study.subjects.iter().enumerate() {
            for (j, setting) in study.settings.iter().enumerate() {
                let is_of = |of: &&OfGroup| of.number == number && of.subject == k && of.setting == j;
                let own: Vec<&OfGroup> = report.indices.iter().filter(is_of).collect();
                let Some(samples) = own.first().map(|of| of.samples) else { continue };
                let mut cells = vec![
                    rows.numbers[number].replace('_', " "),
                    subject.name.clone(),
                    setting.name.clone(),
                    samples.to_string(),
                ];
                let shown = |[value, error]: [f64; 2]| {
                    format!("{} ± {}", fixed(value, 2), fixed(NINETEEN_OF_TWENTY * error, 2))
                };
                cells.extend(own.iter().flat_map(|of| [of.index.first, of.index.total].map(shown)));
                lines.push(cells);
            }
        }
    }
    if lines.is_empty() {
        return "<p>Too few samples are solved, or no number varies.</p>".into();
    }
    let columns = study.groups.iter().flat_map(|g| [format!("{g}, alone"), format!("{g}, with others")]);
    let header: Vec<String> =
        ["number", "subject", "setting", "samples"].map(String::from).into_iter().chain(columns).collect();
    table(&header.iter().map(String::as_str).collect::<Vec<_>>(), 3, &lines)
}

fn sensitivity(report: &StudyReport, numbers: &[usize], followed: &[Follows]) -> String {
    let mut lines = Vec::new();
    for &number in numbers {
        for (k, setting) in report.study.settings.iter().enumerate() {
            let of: Vec<String> = followed
                .iter()
                .filter(|f| f.number == number && f.setting == k)
                .take(INPUTS)
                .map(|f| format!("{} {}", report.rows.inputs[f.input], fixed(f.rho, 2)))
                .collect();
            if !of.is_empty() {
                lines.push(vec![
                    report.rows.numbers[number].replace('_', " "),
                    setting.name.clone(),
                    of.join(", "),
                ]);
            }
        }
    }
    match lines.is_empty() {
        true => "<p>No number follows any input more closely than chance.</p>".into(),
        false => table(&["number", "setting", "follows, rank correlation"], 3, &lines),
    }
}

fn scatters(report: &StudyReport, followed: &[Follows]) -> String {
    let mut figures = Vec::new();
    let mut seen = Vec::new();
    for f in followed {
        if figures.len() == SCATTERS || seen.contains(&f.number) {
            continue;
        }
        seen.push(f.number);
        let (input, number) = (&report.rows.inputs[f.input], &report.rows.numbers[f.number]);
        let of_setting = |(k, setting): (usize, &'_ coupling::study::file::Setting)| {
            let mut at = report.pairs(&report.solved(None, k), f.input, f.number);
            let every = at.len().div_ceil(DOTS).max(1);
            at = at.into_iter().step_by(every).collect();
            (setting.name.clone(), at)
        };
        let of: Vec<(String, Vec<[f64; 2]>)> =
            report.study.settings.iter().enumerate().map(of_setting).collect();
        let dots: Vec<Dots> = of.iter().map(|(name, at)| Dots { name, at: at.clone() }).collect();
        figures.push(scatter(&number.replace('_', " "), [input, number], &dots));
    }
    grid("normal", &figures)
}
