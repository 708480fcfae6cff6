//! The verification table of the rigid leg, as Markdown for the README:
//!
//! `cargo run --release -p sartorius-coupling --example rigid_verification -- ../shared/gait`
//!
//! Without a folder of recordings only the built-in walker is shown.

use std::path::PathBuf;

use coupling::error::CouplingError;
use coupling::optimize::{OptimizeOptions, Optimized, optimize};
use coupling::subject::GRAVITY;
use multibody::model::Ankle;
use multibody::sharing::{MuscleCost, ReactionCost};
use multibody::trial::Status;
use multibody::trial_file::HipRule;

const TRIALS: [&str; 5] = ["DM_ngait_og3", "DM_ngait_og4", "jw_ngait_og1", "jw_ngait_og3", "jw_ngait_og7"];

fn main() -> Result<(), CouplingError> {
    let data = std::env::args().nth(1).map(PathBuf::from);
    let trials = || -> Vec<Option<&str>> {
        let recorded = TRIALS.iter().copied().filter(|_| data.is_some()).map(Some);
        std::iter::once(None).chain(recorded).collect()
    };
    let options = |trial: Option<&str>| OptimizeOptions {
        trial: trial.map(|t| PathBuf::from(format!("gait-data/trials/{t}.toml"))),
        data: data.clone(),
        ..OptimizeOptions::default()
    };

    println!(
        "| trial | frames solved | residual RMS, mm | largest equation, m | medial, BW | lateral, BW | total, BW | highest activations |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for trial in trials() {
        let done = optimize(&options(trial))?;
        println!("{}", row(&done));
    }

    println!("\nPeak total knee force, body weights, by force sharing and ankle:\n");
    println!(
        "| trial | default | unbounded condition 2 | unbounded condition 1 | squared activations | parallel ankle |"
    );
    println!("|---|---|---|---|---|---|");
    for trial in trials() {
        let mut cells = Vec::new();
        for variant in 0..5 {
            let mut options = options(trial);
            let sharing = &mut options.sharing;
            match variant {
                1 => sharing.bounded = false,
                2 => (sharing.bounded, sharing.reaction_cost) = (false, ReactionCost::None),
                3 => {
                    (sharing.muscle_cost, sharing.reaction_cost) =
                        (MuscleCost::Activation, ReactionCost::None)
                }
                4 => options.ankle = Some(Ankle::Parallel),
                _ => {}
            }
            let done = optimize(&options)?;
            let unsolved = done.effort.verdicts.iter().filter(|v| v.status != Status::Solved).count();
            let note = if unsolved > 0 { format!(" ({unsolved} unsolved)") } else { String::new() };
            cells.push(format!("{:.2}{note}", peak(&done, |m, l| m + l)));
        }
        println!("| {} | {} |", trial.unwrap_or("walker"), cells.join(" | "));
    }

    if data.is_some() {
        println!("\nHip centre candidates: marker residual RMS, mm / peak total knee force, BW:\n");
        println!("| trial | shipped | Harrington | regression |");
        println!("|---|---|---|---|");
        for trial in TRIALS {
            let mut cells = Vec::new();
            for rule in [None, Some(HipRule::Harrington), Some(HipRule::Regression)] {
                let done = optimize(&OptimizeOptions { hip_centre: rule, ..options(Some(trial)) })?;
                cells.push(format!(
                    "{:.2} / {:.2}",
                    1e3 * done.motion.marker_rms(),
                    peak(&done, |m, l| m + l)
                ));
            }
            println!("| {trial} | {} |", cells.join(" | "));
        }
    }
    Ok(())
}

fn row(done: &Optimized) -> String {
    let verdicts = &done.effort.verdicts;
    let solved = verdicts.iter().filter(|v| v.status == Status::Solved).count();
    let equation = done.motion.fit.iter().map(|f| f.constraint).fold(0.0, f64::max);
    let mut activations: Vec<(f64, &String)> = done
        .effort
        .activations
        .columns
        .iter()
        .enumerate()
        .map(|(c, name)| (done.effort.activations.values.column(c).max(), name))
        .collect();
    activations.sort_by(|a, b| b.0.total_cmp(&a.0));
    let top: Vec<String> = activations[..4].iter().map(|(a, name)| format!("{name} {a:.2}")).collect();
    format!(
        "| {} | {solved} of {} | {:.2} | {equation:.0e} | {:.2} | {:.2} | {:.2} | {} |",
        done.case.trial.name,
        verdicts.len(),
        1e3 * done.motion.marker_rms(),
        peak(done, |m, _| m),
        peak(done, |_, l| l),
        peak(done, |m, l| m + l),
        top.join(", ")
    )
}

/// Largest value over the solved frames of a combination of medial and lateral knee force, in body weights.
fn peak(done: &Optimized, of: impl Fn(f64, f64) -> f64) -> f64 {
    let column = |name: &str| {
        done.effort.reactions.columns.iter().position(|c| c == name).expect("the knee has two contacts")
    };
    let (m, l) = (column("knee_medial"), column("knee_lateral"));
    let values = &done.effort.reactions.values;
    let weight = done.case.trial.subject.mass * GRAVITY;
    let solved = (0..values.nrows()).filter(|&k| done.effort.verdicts[k].status == Status::Solved);
    solved.map(|k| of(values[(k, m)], values[(k, l)]) / weight).fold(f64::NEG_INFINITY, f64::max)
}
