//! The numbers that a scene is simulated for, as one list: what settings of different accuracy are compared by.

use std::io::{self, Write};

use fem::measure::{body_wrenches, pair_forces, solid_field};
use fem::plan::Plan;
use fem::run::Frame;
use mesher::part::body_of;
use nalgebra::Vector3;

use super::Comparison;
use super::compare::Solution;
use crate::configuration::Configuration;
use crate::scene::StepName;
use crate::thigh::lines::lines_of_muscles;

/// Fraction of the volume of a muscle in which its largest principal stress is below the reported one: the greatest of all is that of a single
/// cell, mostly at an attachment, and grows as cells shrink.
const PERCENTILE: f64 = 0.95;

/// What a number is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Kind {
    /// Force through the belly of a muscle \[N\].
    SectionForce,
    /// The same of a muscle without mesh: the force of its lines in the rigid leg \[N\].
    LineForce,
    /// Magnitude of the force of all tissue on a bone \[N\].
    BoneForce,
    /// Magnitude of the contact force between two bodies \[N\].
    ContactForce,
    /// Largest principal stress of a muscle, 95th percentile by volume \[kPa\].
    StressPercentile,
    /// Largest principal stress of a muscle in any cell \[kPa\].
    StressMaximum,
    /// Mean distance at which bodies press, weighted with their forces \[mm\].
    Standoff,
    /// Volume that muscles have in common \[cm³\].
    OverlapVolume,
}

impl Kind {
    /// All, in the order of the table.
    pub const ALL: [Kind; 8] = [
        Kind::SectionForce,
        Kind::LineForce,
        Kind::BoneForce,
        Kind::ContactForce,
        Kind::StressPercentile,
        Kind::StressMaximum,
        Kind::Standoff,
        Kind::OverlapVolume,
    ];

    /// Its name in tables, unit included.
    pub fn name(self) -> &'static str {
        match self {
            Kind::SectionForce => "section_force_N",
            Kind::LineForce => "line_force_N",
            Kind::BoneForce => "bone_force_N",
            Kind::ContactForce => "contact_force_N",
            Kind::StressPercentile => "stress_p95_kPa",
            Kind::StressMaximum => "stress_max_kPa",
            Kind::Standoff => "standoff_mm",
            Kind::OverlapVolume => "overlap_cm3",
        }
    }
}

/// One number of a solved step.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    /// Which step.
    pub step: StepName,
    /// In which configuration.
    pub configuration: Configuration,
    /// What it is.
    pub kind: Kind,
    /// Whose it is: a muscle, a bone, two bodies joined by ` and `, or `all`.
    pub of: String,
    /// The number, in the unit of its kind.
    pub value: f64,
}

/// Columns of `quantities.csv`.
pub const COLUMNS: &str = "step,configuration,quantity,of,value";

impl Comparison {
    /// All numbers of the solved steps; a muscle that has no mesh is a line of the rigid leg, with the force of that.
    pub fn quantities(&self) -> Vec<Quantity> {
        let mut all = Vec::new();
        let solved: Vec<Configuration> = self.solutions.present().map(|(c, _)| c).collect();
        let configurations =
            if solved.is_empty() { vec![Configuration::WithoutContact] } else { solved.clone() };
        let is_line = |name: &String| solved.is_empty() || self.thigh.muscles.iter().all(|m| m.name != *name);
        let lines: Vec<String> = lines_of_muscles().into_keys().filter(is_line).collect();
        for (&configuration, step) in
            configurations.iter().flat_map(|c| self.steps.iter().map(move |s| (c, s)))
        {
            for of in &lines {
                let value = step.muscle(of).map_or(0.0, |m| m.force().norm());
                let (step, of) = (step.name, of.clone());
                all.push(Quantity { step, configuration, kind: Kind::LineForce, of, value });
            }
        }
        for (configuration, solution) in self.solutions.present() {
            for (k, frame) in solution.at_steps().enumerate() {
                let step = self.steps[k].name;
                let mut push = |kind, of: &str, value: f64| {
                    all.push(Quantity { step, configuration, kind, of: of.to_string(), value });
                };
                for (muscle, force) in self.thigh.muscles.iter().zip(&solution.steps[k].muscles) {
                    push(Kind::SectionForce, &muscle.name, force.total);
                }
                of_frame(&solution.plan, frame, &mut push);
                for muscle in &self.thigh.muscles {
                    if let Some([percentile, maximum]) = stresses(&solution.plan, frame, &muscle.name) {
                        push(Kind::StressPercentile, &muscle.name, percentile);
                        push(Kind::StressMaximum, &muscle.name, maximum);
                    }
                }
                if let Some(standoff) = standoff(solution, frame) {
                    push(Kind::Standoff, "all", standoff);
                }
                push(Kind::OverlapVolume, "all", solution.overlaps[k] * 1e6);
            }
        }
        all
    }

    /// `quantities.csv`: a row per number.
    pub fn write_quantities(&self, w: &mut dyn Write) -> io::Result<()> {
        writeln!(w, "{COLUMNS}")?;
        for Quantity { step, configuration, kind, of, value } in self.quantities() {
            writeln!(w, "{},{},{},{of},{value:.6e}", step.name(), configuration.folder(), kind.name())?;
        }
        Ok(())
    }
}

/// Forces on bones and between bodies.
fn of_frame(plan: &Plan, frame: &Frame, push: &mut dyn FnMut(Kind, &str, f64)) {
    let about = vec![[0.0; 3]; plan.bodies.len()];
    for (body, wrench) in plan.bodies.iter().zip(body_wrenches(plan, frame.snapshot(), &about)) {
        push(Kind::BoneForce, body, Vector3::from(wrench.force).norm());
    }
    for pair in pair_forces(plan, frame.snapshot(), [0.0; 3]) {
        let [a, b] = pair.names.each_ref().map(|name| body_of(name));
        push(Kind::ContactForce, &format!("{a} and {b}"), Vector3::from(pair.wrench.force).norm());
    }
}

/// Largest principal stress of a muscle \[kPa\]: 95th percentile by volume, and maximum.
fn stresses(plan: &Plan, frame: &Frame, muscle: &str) -> Option<[f64; 2]> {
    let mut cells: Vec<(f64, f64)> = solid_field(plan, frame.snapshot(), muscle)?
        .iter()
        .map(|cell| (cell.principal[0] * 1e-3, cell.volume))
        .collect();
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    let volume: f64 = cells.iter().map(|c| c.1).sum();
    let mut below = 0.0;
    let at = cells.iter().position(|cell| {
        below += cell.1;
        below >= PERCENTILE * volume
    });
    Some([cells[at?].0, cells.last()?.0])
}

/// Mean distance at which bodies press \[mm\], weighted with their forces.
fn standoff(solution: &Solution, frame: &Frame) -> Option<f64> {
    solution.plan.contact()?;
    let pressed = pair_forces(&solution.plan, frame.snapshot(), [0.0; 3]);
    let force = |pair: &fem::measure::PairForce| Vector3::from(pair.wrench.force).norm();
    let all: f64 = pressed.iter().map(force).sum();
    (all > 0.0).then(|| 1e3 * pressed.iter().map(|p| force(p) * p.standoff).sum::<f64>() / all)
}
