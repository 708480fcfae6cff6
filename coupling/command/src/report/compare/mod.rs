//! The page of `compare`: the table first, then bars, sections, the thigh in three dimensions, convergence and cost.

mod calibration;
mod convergence;
mod cost;
mod figures;
mod nodal;
mod published;
mod settled;
mod slices;
mod tables;
mod viewer;

pub use settled::Settled;

use mesher::Bone;
use serde::Serialize;

use super::page::{document_with, label_table, section};
pub use published::published;

use coupling::comparison::Comparison;
use coupling::comparison::compare::{MuscleForce, wanted};
use coupling::configuration::{Configuration, PerConfiguration};
use coupling::scene::StepName;
use coupling::steps::RigidMuscle;
use coupling::two_way::Pass;

/// Everything that the page shows. Borrowed: the page changes nothing.
#[derive(Clone, Copy)]
pub struct CompareReport<'a> {
    /// Name of the scene.
    pub name: &'a str,
    /// Who was recorded.
    pub subject: &'a str,
    /// The thigh beside the rigid leg.
    pub comparison: &'a Comparison,
    /// Bones, where the mesh has them.
    pub bones: &'a [Bone],
    /// Height of the section through the middle of the thigh \[m\].
    pub mid_thigh: f64,
    /// Settings as label and value.
    pub settings: &'a [(String, String)],
    /// Effects that were simulated, one sentence each.
    pub simulated: &'a [String],
    /// Effects that were left out, and why.
    pub left_out: &'a [(String, String)],
    /// What the reader must know: doubts about the trial, warnings about the mesh.
    pub notes: &'a [String],
    /// Passes of two-way coupling; empty without.
    pub passes: &'a [Pass],
    /// Why the passes are no settled result; empty where they are, or where there are none.
    pub unsettled: &'a [String],
    /// Stage and wall seconds, in the order of the run.
    pub seconds: &'a [(String, f64)],
}

/// One muscle at one step.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Name as in the section tables.
    pub muscle: String,
    /// Activation, 0..1.
    pub activation: f64,
    /// Force of the rigid leg \[N\].
    pub rigid: f64,
    /// Section forces; `None` where not solved.
    pub fe: PerConfiguration<Option<MuscleForce>>,
    /// The one-way result, where this is a two-way one.
    pub one_way: Option<OneWayRow>,
}

/// One muscle at one step before two-way coupling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OneWayRow {
    /// Activation, 0..1.
    pub activation: f64,
    /// Force of the rigid leg \[N\].
    pub rigid: f64,
    /// Section force; `None` where not solved.
    pub fe: Option<MuscleForce>,
}

impl Row {
    /// Force of the thigh minus that of the rigid leg \[N\].
    pub fn difference(&self, configuration: Configuration) -> Option<f64> {
        Some(self.fe[configuration]?.total - self.rigid)
    }
}

/// A muscle counts as carrying force in the rigid leg from here on \[N\].
pub const CARRIES: f64 = 0.5;

/// How far a configuration is from the rigid leg at a step; what `run.json`, `--json` and the terminal say.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Which step.
    pub step: StepName,
    /// Which configuration.
    #[serde(serialize_with = "named")]
    pub configuration: Configuration,
    /// Mean over the muscles that carry force in the rigid leg, as the publication counts; `None` where there are none.
    #[serde(rename = "mean_N")]
    pub mean: Option<f64>,
    /// Mean over all muscles.
    #[serde(rename = "mean_of_all_N")]
    pub mean_of_all: f64,
    /// Largest of all muscles.
    #[serde(rename = "largest_N")]
    pub largest: f64,
    /// The muscle that has it.
    pub largest_muscle: String,
    /// Volume that muscles share with each other.
    #[serde(rename = "shared_volume_cm3")]
    pub shared_volume: f64,
}

impl CompareReport<'_> {
    /// The comparison at one step.
    pub fn rows(&self, step: usize) -> Vec<Row> {
        let Comparison { thigh, steps, solutions, one_way, .. } = self.comparison;
        // Fed back, all lines of a muscle have its lever arms and pull along its belly: their tensions simply add up.
        let tension = |name: &str| steps[step].muscle(name).map_or(0.0, RigidMuscle::tension);
        let rigid: Vec<f64> = match one_way {
            Some(_) => thigh.muscles.iter().map(|m| tension(&m.name)).collect(),
            None => wanted(thigh, &steps[step]),
        };
        let before = one_way.as_ref().map(|o| (o, wanted(thigh, &o.steps[step])));
        let row = |(i, muscle): (usize, &coupling::thigh::build::ThighMuscle)| Row {
            muscle: muscle.name.clone(),
            activation: steps[step].activation(&muscle.name),
            rigid: rigid[i],
            fe: PerConfiguration::of(|c| Some(solutions[c].as_ref()?.steps.get(step)?.muscles[i])),
            one_way: before.as_ref().map(|(one_way, rigid)| OneWayRow {
                activation: one_way.steps[step].activation(&muscle.name),
                rigid: rigid[i],
                fe: one_way.forces.get(step).map(|s| s.muscles[i]),
            }),
        };
        thigh.muscles.iter().enumerate().map(row).collect()
    }

    /// Of every step and configuration that was solved.
    pub fn differences(&self) -> Vec<Difference> {
        let mut all = Vec::new();
        for (k, step) in self.comparison.steps.iter().enumerate() {
            let rows = self.rows(k);
            for (c, solution) in self.comparison.solutions.present() {
                let away: Vec<(f64, &Row)> =
                    rows.iter().filter_map(|r| Some((r.difference(c)?.abs(), r))).collect();
                let Some(most) = away.iter().max_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
                let mean = |carries: f64| {
                    let of: Vec<f64> = away.iter().filter(|a| a.1.rigid >= carries).map(|a| a.0).collect();
                    (!of.is_empty()).then(|| of.iter().sum::<f64>() / of.len() as f64)
                };
                all.push(Difference {
                    step: step.name,
                    configuration: c,
                    mean: mean(CARRIES),
                    mean_of_all: mean(f64::NEG_INFINITY).expect("there is a largest"),
                    largest: most.0,
                    largest_muscle: most.1.muscle.clone(),
                    shared_volume: solution.overlaps.get(k).map_or(f64::NAN, |v| v * 1e6),
                });
            }
        }
        all
    }

    /// How closely the forces balance in each configuration that has solved frames.
    pub fn settled(&self) -> Vec<Settled> {
        let of = |(c, solution)| Settled::new(c, solution);
        self.comparison.solutions.present().filter_map(of).collect()
    }

    /// Why the run is not solved; empty where it is.
    pub fn shortcomings(&self) -> Vec<String> {
        let mut reasons = self.comparison.shortcomings();
        reasons.extend(self.unsettled.iter().cloned());
        reasons
    }
}

fn named<S: serde::Serializer>(configuration: &Configuration, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(configuration.name())
}

/// A step for people.
pub fn step_words(step: StepName) -> String {
    match step {
        StepName::HeelStrike => "Heel strike".into(),
        StepName::LoadingResponse => "Loading response".into(),
        StepName::Twentieth(n) => format!("{} % of the cycle", 5 * n),
    }
}

/// Which frame of a run this is, by its pseudo-time: step k stands at 1 + k, the way to the first before it.
fn frame_label(report: &CompareReport, time: f64, solved: bool) -> String {
    let steps = || (1..).map(f64::from).zip(&report.comparison.steps);
    let mut label = match steps().find(|(t, _)| *t == time) {
        Some((_, step)) => step_words(step.name).to_lowercase(),
        None => "bones at heel strike, muscles at rest".to_string(),
    };
    if !solved {
        label.push_str(" – not solved: the last good state before it");
    }
    label
}

/// A muscle's name for people.
fn words(name: &str) -> String {
    name.replace('_', " ")
}

/// The page as one HTML file.
pub fn compare_page(report: &CompareReport) -> String {
    let details = [tables::effects(report), label_table("Settings", report.settings)].concat();
    let body = [
        tables::headline(report),
        tables::comparison(report),
        figures::bars(report),
        slices::sections(report),
        viewer::viewer(report),
        tables::explanations(report),
        calibration::passes(report),
        calibration::section_of(report),
        calibration::grids(report),
        convergence::section_of(report),
        cost::section_of(report),
        section("What was simulated and what was left out", "", &details),
    ]
    .concat();
    document_with(&format!("{} · compare · Sartorius", report.name), &body, include_str!("viewer.js"))
}
