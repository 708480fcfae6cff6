//! Electromyography: envelopes, defects and concordance of signals that are known, and of the shipped recordings.

#![allow(non_snake_case)]

use coupling::form::Form;
use coupling::optimize::{OptimizeOptions, optimize};
use multibody::emg::{Channel, Defect, Recording, compare, overall};
use multibody::share::SharingSettings;
use multibody::trial::Table;
use multibody::trial_file::TrialFile;
use nalgebra::DMatrix;
use support::{Random, shared, shipped_trial};

const RATE: f64 = 1200.0;

/// Noise of a muscle that is excited between `from` and `to` \[s\], 2 s long.
fn burst(random: &mut Random, from: f64, to: f64, size: f64) -> Vec<f64> {
    (0..2400)
        .map(|k| {
            let t = k as f64 / RATE;
            let on = if (from..to).contains(&t) { 1.0 } else { 0.02 };
            size * on * random.normal() + 0.5 // an offset, as amplifiers have it
        })
        .collect()
}

fn channel(name: &str, muscle: usize, samples: Vec<f64>) -> Channel {
    Channel { name: name.into(), muscles: vec![muscle], start: 0.0, rate: RATE, samples }
}

#[test]
fn bursts_agree_with_forces_that_come_a_delay_later() {
    let mut random = Random::new(2);
    let delay = 0.05;
    let time: Vec<f64> = (0..150).map(|k| 0.2 + 0.01 * k as f64).collect();
    let force = |from: f64, to: f64| -> Vec<f64> {
        time.iter().map(|t| if (from + delay..to + delay).contains(t) { 500.0 } else { 5.0 }).collect()
    };
    let columns = [force(0.6, 1.0), force(0.6, 1.0), force(1.2, 1.6), force(0.6, 1.0), force(0.6, 1.0)];
    let forces = Table {
        columns: (0..5).map(|m| format!("m{m}")).collect(),
        values: DMatrix::from_fn(time.len(), 5, |k, m| columns[m][k]),
    };
    let mut clipped = burst(&mut random, 0.6, 1.0, 0.2);
    clipped.iter_mut().for_each(|v| *v = v.clamp(0.4, 0.6));
    let recording = Recording {
        delay,
        channels: vec![
            channel("right", 0, burst(&mut random, 0.6, 1.0, 0.2)),
            channel("flat", 1, burst(&mut random, 0.6, 1.0, 0.004)),
            channel("other", 2, burst(&mut random, 0.6, 1.0, 0.1)),
            channel("clipped", 3, clipped),
            channel("short", 4, burst(&mut random, 0.6, 1.0, 0.2)[..1200].to_vec()),
        ],
    };
    let compared = compare(&recording, &time, &forces);
    let defects: Vec<Option<Defect>> = compared.iter().map(|c| c.defect).collect();
    assert_eq!(defects, [None, Some(Defect::Flat), None, Some(Defect::Clipped), Some(Defect::Short)]);
    // The 6 Hz envelope needs some 50 ms to rise and to fall: five frames at each edge.
    let agreed = compared[0].concordance.unwrap();
    assert!(agreed > 0.9, "{agreed}");
    // A burst of 0.4 s and a force of 0.4 s at other times disagree in 0.8 s of 1.5 s.
    let disagreed = compared[2].concordance.unwrap();
    assert!((disagreed - (1.0 - 0.8 / 1.5)).abs() < 0.1, "{disagreed}");
    assert!((overall(&compared).unwrap() - 0.5 * (agreed + disagreed)).abs() < 1e-12);
    assert!(compared[0].envelope.iter().all(|v| (0.0..=1.0).contains(v)));
}

#[test]
fn names_of_channels_and_muscles_are_examined_together() {
    let Some(data) = shared("gait") else { return };
    let shipped = shipped_trial("jw_ngait_og3");
    let text = std::fs::read_to_string(&shipped).unwrap();
    let wrong = text.replace("medgas = \"gasmed\"", "medgass = \"gasmet\"");
    let file = TrialFile::parse(&shipped, wrong.as_bytes()).unwrap();
    let said = file.emg(Some(&data)).unwrap_err().to_string();
    assert!(said.contains("`medgass`") && said.contains("did you mean `gasmed`?"), "{said}");
    assert!(said.contains("medgas"), "{said}");
}

#[test]
fn the_default_agrees_with_the_shipped_recordings_in_more_than_60_per_cent_of_frames() {
    let Some(data) = shared("gait") else { return };
    let mut all = Vec::new();
    for trial in ["jw_ngait_og1", "jw_ngait_og3", "jw_ngait_og7"] {
        let form = Form::REVISED;
        let done = optimize(&OptimizeOptions {
            trial: Some(shipped_trial(trial)),
            data: Some(data.clone()),
            form,
            sharing: SharingSettings {
                muscle_cost: form.muscle_cost,
                reaction_cost: form.reaction_cost,
                ..SharingSettings::default()
            },
            ..OptimizeOptions::default()
        })
        .unwrap();
        let compared = done.emg.unwrap();
        assert_eq!(compared.len(), 15);
        // The README of the recordings names three channels that are nearly flat.
        let flat: Vec<&str> =
            compared.iter().filter(|c| c.defect == Some(Defect::Flat)).map(|c| c.channel.as_str()).collect();
        for c in &compared {
            println!("{trial} {:10} {:?} {:?}", c.channel, c.concordance, c.defect);
        }
        assert!(flat.iter().all(|c| ["semimem", "sartorius", "gmed"].contains(c)), "{flat:?}");
        all.push(overall(&compared).unwrap());
    }
    let mean = all.iter().sum::<f64>() / 3.0;
    println!("in all {all:?}, mean {mean:.3}");
    assert!(mean > 0.6, "{mean}");
}
