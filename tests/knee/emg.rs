//! Electromyography: envelopes, defects and concordance of signals that are known, and of the shipped recordings.

#![allow(non_snake_case)]

use coupling::form::Form;
use coupling::optimize::{OptimizeOptions, optimize};
use multibody::emg::{Channel, Defect, Recording, compare, overall};
use multibody::informed::Informed;
use multibody::share::SharingSettings;
use multibody::sharing::{Capacity, SharingProblem};
use multibody::trial::Table;
use multibody::trial_file::TrialFile;
use nalgebra::{DMatrix, DVector};
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

/// Does heeding electromyograms trade force for agreement, and nothing else?
#[test]
fn a_weight_takes_forces_towards_the_electromyograms_and_keeps_the_moments() {
    let Some(data) = shared("gait") else { return };
    let run = |emg_weight| {
        let options = OptimizeOptions {
            trial: Some(shipped_trial("jw_ngait_og3")),
            data: Some(data.clone()),
            emg_weight,
            ..OptimizeOptions::revised()
        };
        optimize(&options).unwrap()
    };
    let (alone, hardly, much) = (run(None), run(Some(1e-9)), run(Some(2.0)));
    assert!(alone.informed.is_none());
    let informed = much.informed.as_ref().unwrap();
    assert!((0.05..0.5).contains(&informed.activation), "{}", informed.activation);
    // Both costs, with the weights of the cost by volume: optimal for one weight is between those of others.
    let l_opt: Vec<f64> = alone.model.muscles.iter().map(|m| m.l_opt).collect();
    let costs = |forces: &Table| {
        let (mut of_force, mut off) = (0.0, 0.0);
        for (frame, f) in forces.values.row_iter().enumerate() {
            for (i, muscle) in alone.model.muscles.iter().enumerate() {
                let w = l_opt[i] / 0.1 * 1000.0 / muscle.f_max;
                of_force += w * f[i] * f[i];
                if let Some(j) = informed.muscles.iter().position(|m| *m == i) {
                    off += w * (f[i] - informed.forces.values[(frame, j)]).powi(2);
                }
            }
        }
        [of_force, off]
    };
    let [[least, far], [nearly, as_far], [more, near]] =
        [&alone, &hardly, &much].map(|done| costs(&done.effort.forces));
    assert!((nearly - least).abs() < 1e-6 * least && (as_far - far).abs() < 1e-6 * far);
    assert!(more > least && near < 0.7 * far, "{least} to {more}, {far} to {near}");
    assert!(more + 2.0 * near < least + 2.0 * far, "the sum of both is least with the weight that it has");
    for done in [&alone, &much] {
        assert!(done.effort.verdicts.iter().all(|v| v.equality_residual < 1e-9));
    }
    let agree = |done: &coupling::optimize::Optimized| overall(done.emg.as_ref().unwrap()).unwrap();
    assert!(agree(&much) > agree(&alone) + 0.03, "{} {}", agree(&much), agree(&alone));
}

/// The scale of all channels is found, and what is added to the cost is what is said.
#[test]
fn forces_that_follow_their_electromyograms_give_back_their_scale() {
    let time: Vec<f64> = (0..50).map(|k| 0.02 * k as f64).collect();
    let e: Vec<f64> = (0..50).map(|k| (0.1 * k as f64).sin().abs()).collect();
    let columns = vec!["soleus".to_string(), "tibant".into(), "tfl".into()];
    let strength = [900.0, 300.0, 200.0];
    let rest = 7.0;
    let force = |k: usize, i: usize| if i < 2 { rest + 0.3 * e[k] * (strength[i] - rest) } else { 11.0 };
    let forces = Table { columns: columns.clone(), values: DMatrix::from_fn(50, 3, force) };
    let compared: Vec<_> = [("a", 0, None), ("b", 1, None), ("c", 2, Some(Defect::Flat))]
        .map(|(name, i, defect): (&str, usize, _)| multibody::emg::Compared {
            channel: name.into(),
            muscles: vec![columns[i].clone()],
            envelope: e.clone(),
            force: e.clone(),
            defect,
            concordance: Some(1.0),
        })
        .into();
    let effort = multibody::trial::Effort {
        time,
        forces,
        activations: Table { columns: Vec::new(), values: DMatrix::zeros(50, 0) },
        reactions: Table { columns: Vec::new(), values: DMatrix::zeros(50, 0) },
        reserves: Table { columns: Vec::new(), values: DMatrix::zeros(50, 0) },
        least_violation: Table { columns: Vec::new(), values: DMatrix::zeros(50, 0) },
        verdicts: Vec::new(),
    };
    let mut capacity = Capacity::nominal(strength.to_vec());
    capacity.bounds.iter_mut().for_each(|bounds| bounds[0] = rest);
    let weight = 0.4;
    let informed = Informed::new(&compared, &effort, |_| &capacity, weight).unwrap();
    assert!((informed.activation - 0.3).abs() < 1e-12, "{}", informed.activation);
    assert_eq!(informed.muscles, [0, 1], "a flat channel says nothing");
    let posed = SharingProblem {
        R: DMatrix::zeros(1, 3),
        tau: DVector::zeros(1),
        x0: DVector::zeros(0),
        X: DMatrix::zeros(0, 3),
        lower_f: DVector::zeros(3),
        upper_f: DVector::repeat(3, 1e3),
        w_f: DVector::from_vec(vec![1.0, 3.0, 2.0]),
        target_f: None,
        lower_x: DVector::zeros(0),
        upper_x: DVector::zeros(0),
        w_x: DVector::zeros(0),
        w_s: None,
    };
    let mut heeding = posed.clone();
    informed.inform(20, &mut heeding);
    // What is added to the cost differs from weight · w (f − f_emg)² by what no force changes.
    let added = |f: &DVector<f64>| {
        let s = DVector::zeros(1);
        let off: f64 = (0..2).map(|i| posed.w_f[i] * (f[i] - force(20, i)).powi(2)).sum();
        heeding.objective(f, &s) - posed.objective(f, &s) - 0.5 * weight * off
    };
    let mut random = Random::new(5);
    let mut any = || DVector::from_fn(3, |_, _| random.between(0.0, 500.0));
    let (one, other) = (added(&any()), added(&any()));
    assert!((one - other).abs() < 1e-9 * one.abs(), "{one} {other}");
    assert!(Informed::new(&compared[2..], &effort, |_| &capacity, weight).is_none());
}

#[test]
fn a_trial_without_electromyograms_cannot_heed_them() {
    let options = OptimizeOptions { emg_weight: Some(1.0), ..OptimizeOptions::revised() };
    let said = optimize(&options).err().unwrap().to_string();
    assert!(said.contains("no electromyograms") && said.contains("[emg]"), "{said}");
}
