//! The published leg stays what it was, to the bit, and is what everybody but `optimize` gets.

use coupling::form::Form;
use coupling::optimize::{OptimizeOptions, Optimized, optimize};
use multibody::share::SharingSettings;
use support::{shared, shipped_trial};

fn run(trial: Option<&str>, form: Form) -> Optimized {
    optimize(&OptimizeOptions {
        trial: trial.map(shipped_trial),
        data: shared("gait"),
        form,
        sharing: SharingSettings {
            muscle_cost: form.muscle_cost,
            reaction_cost: form.reaction_cost,
            ..SharingSettings::default()
        },
        ..OptimizeOptions::default()
    })
    .unwrap()
}

/// Joint forces of the built-in walker in seven frames, written by the program of commit 832cab0, before there was any other leg. Made by `optimize`
/// without options on 2026-11-25, x86_64; shortest digits that read back equal, compared as bits.
#[test]
fn the_published_walker_has_the_old_bits() {
    let golden = include_str!("published_walker.csv");
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(golden.as_bytes());
    let header = reader.headers().unwrap().clone();
    let done = run(None, Form::default());
    let mut compared = 0;
    for record in reader.records() {
        let record = record.unwrap();
        let time: f64 = record[0].parse().unwrap();
        let k = done.effort.time.iter().position(|t| *t == time).unwrap();
        for (name, value) in header.iter().zip(&record).skip(1) {
            let bare = name.strip_suffix("_N").unwrap();
            let column = done.effort.reactions.columns.iter().position(|c| c == bare).unwrap();
            let (got, want): (f64, f64) = (done.effort.reactions.values[(k, column)], value.parse().unwrap());
            assert_eq!(got.to_bits(), want.to_bits(), "{name} at {time} s: {got} {want}");
            compared += 1;
        }
    }
    assert_eq!(compared, 7 * 19);
}

#[test]
fn hip_and_knee_forces_are_of_the_size_that_instrumented_joints_show() {
    let mut trials = vec![None];
    if shared("gait").is_some() {
        trials.extend(
            ["DM_ngait_og3", "DM_ngait_og4", "jw_ngait_og1", "jw_ngait_og3", "jw_ngait_og7"].map(Some),
        );
    }
    for trial in trials {
        let done = run(trial, Form::REVISED);
        let name = trial.unwrap_or("walker");
        let solved =
            done.effort.verdicts.iter().filter(|v| v.status == multibody::trial::Status::Solved).count();
        assert_eq!(solved, done.effort.time.len(), "{name}");
        let weight = 9.81 * done.case.trial.subject.mass;
        let column = |n: &str| done.effort.reactions.column(n).unwrap();
        let [x, y, z] = ["hip_x", "hip_y", "hip_z"].map(column);
        let hip = (0..solved).map(|k| (x[k] * x[k] + y[k] * y[k] + z[k] * z[k]).sqrt()).fold(0.0, f64::max)
            / weight;
        let (medial, lateral) = (column("knee_medial"), column("knee_lateral"));
        let knee = (0..solved).map(|k| medial[k] + lateral[k]).fold(0.0, f64::max) / weight;
        println!("{name}: hip {hip:.2}, knee {knee:.2} body weights");
        assert!(hip <= 4.5, "{name}: hip {hip:.2}");
        assert!((1.8..=3.2).contains(&knee), "{name}: knee {knee:.2}");
    }
}
