//! Lever arms: no jumps in any coordinate, derivatives of lengths, and the knee extensors within published ones.

#![allow(non_snake_case)]

use multibody::dynamics::LegForce;
use multibody::equilibrium::equilibrium;
use multibody::model::Model;
use multibody::muscle::path::knee_angle;
use multibody::natural::SegmentId;
use nalgebra::{DMatrix, Rotation3};
use support::Random;

use super::postures::{Leg, Turns};

/// Lever arms \[m\] in a posture, n_coordinates × n_muscles.
fn arms(leg: &Leg, turns: &Turns) -> DMatrix<f64> {
    let Q = leg.posture(turns);
    assert!(leg.misfit(&Q) < 1e-9, "{turns:?}: {:.1e}", leg.misfit(&Q));
    equilibrium(&leg.model, &Q, &LegForce::zeros()).expect("no joint is locked").lever_arms
}

/// Sweeps of every coordinate over its range of use \[deg\]; the other coordinates at several values.
fn sweeps() -> Vec<(&'static str, Vec<Turns>)> {
    let turned = |set: &dyn Fn(&mut Turns, f64), from: f64, to: f64| {
        let mut all = Vec::new();
        for knee in [5.0, 60.0, 110.0] {
            let base = Turns { knee: f64::to_radians(knee), ..Turns::default() };
            let steps = (to - from) as usize;
            all.extend((0..=steps).map(|k| {
                let mut turns = base;
                set(&mut turns, f64::to_radians(from + k as f64));
                turns
            }));
        }
        all
    };
    vec![
        ("hip flexion", turned(&|t, a| t.hip[0] = a, -30.0, 90.0)),
        ("hip adduction", turned(&|t, a| t.hip[1] = a, -30.0, 20.0)),
        ("hip rotation", turned(&|t, a| t.hip[2] = a, -30.0, 30.0)),
        (
            "knee flexion",
            (0..=140).map(|k| Turns { knee: f64::to_radians(k as f64), ..Turns::default() }).collect(),
        ),
        ("ankle flexion", turned(&|t, a| t.ankle[0] = a, -30.0, 25.0)),
        ("ankle inversion", turned(&|t, a| t.ankle[1] = a, -20.0, 20.0)),
    ]
}

fn between(a: &Turns, b: &Turns, part: f64) -> Turns {
    let mix = |x: f64, y: f64| x + part * (y - x);
    Turns {
        hip: std::array::from_fn(|k| mix(a.hip[k], b.hip[k])),
        knee: mix(a.knee, b.knee),
        ankle: std::array::from_fn(|k| mix(a.ankle[k], b.ankle[k])),
    }
}

/// The largest jump of a lever arm \[m\] in a sweep, with its muscle: what is left of the change of a degree when the degree is halved fourteen times,
/// each time towards the larger change.
fn largest_jump(leg: &Leg, sweep: &[Turns]) -> (f64, usize) {
    let all: Vec<DMatrix<f64>> = sweep.iter().map(|t| arms(leg, t)).collect();
    let mut worst = (0.0, 0);
    for k in 1..sweep.len() {
        // Sweeps at several knee angles follow each other.
        let degree = f64::to_radians(1.5);
        let apart = |a: &Turns, b: &Turns| {
            (a.knee - b.knee).abs().max((0..3).map(|j| (a.hip[j] - b.hip[j]).abs()).fold(0.0, f64::max))
        };
        if apart(&sweep[k - 1], &sweep[k]) > degree {
            continue;
        }
        let change = &all[k] - &all[k - 1];
        for m in 0..change.ncols() {
            let size = change.column(m).amax();
            if size < 0.5e-3 {
                continue;
            }
            let (mut a, mut b) = (sweep[k - 1], sweep[k]);
            let (mut at_a, mut at_b) = (all[k - 1].clone(), all[k].clone());
            for _ in 0..14 {
                let middle = between(&a, &b, 0.5);
                let here = arms(leg, &middle);
                let part = |x: &DMatrix<f64>, y: &DMatrix<f64>| (x - y).column(m).amax();
                if part(&here, &at_a) >= part(&at_b, &here) {
                    (b, at_b) = (middle, here);
                } else {
                    (a, at_a) = (middle, here);
                }
            }
            let left = (&at_b - &at_a).column(m).amax();
            if left > worst.0 {
                worst = (left, m);
            }
        }
    }
    worst
}

#[test]
fn lever_arms_of_all_muscles_have_no_jumps_in_any_coordinate() {
    let leg = Leg::new(Model::with_wrapped_muscles);
    assert_eq!(leg.model.muscles.len(), 43);
    for (name, sweep) in sweeps() {
        let (jump, muscle) = largest_jump(&leg, &sweep);
        // A ten-thousandth of a degree is left.
        assert!(jump < 2e-6, "{name}: {} jumps by {:.2} mm", leg.model.muscles[muscle].name, 1e3 * jump);
    }
    // The published paths do jump: the same search finds it.
    let published = Leg::new(|model| model);
    let (_, knee) = sweeps().into_iter().find(|s| s.0 == "knee flexion").unwrap();
    let (jump, muscle) = largest_jump(&published, &knee);
    assert!(jump > 10e-3, "{} {jump}", published.model.muscles[muscle].name);
}

/// Only the lines whose points changed with the knee are others, and all are as before where none of them touches its cylinder.
#[test]
fn other_muscles_are_as_published() {
    let (published, wrapped) = (Leg::new(|m| m), Leg::new(Model::with_wrapped_muscles));
    let other: Vec<&str> = (published.model.muscles.iter().zip(&wrapped.model.muscles))
        .filter(|(a, b)| a != b)
        .map(|(a, _)| a.name.as_str())
        .collect();
    assert_eq!(other, ["recfem", "vasmed", "vasint", "vaslat", "gasmed", "gaslat"]);
    // In the nearly straight knee quadriceps goes straight to the patella, as published.
    let turns = Turns { knee: f64::to_radians(10.0), ..Turns::default() };
    let (a, b) = (arms(&published, &turns), arms(&wrapped, &turns));
    for name in ["recfem", "vasmed", "vasint", "vaslat"] {
        let m = published.model.muscles.iter().position(|muscle| muscle.name == name).unwrap();
        assert!((a.column(m) - b.column(m)).amax() < 1e-12, "{name}");
    }
}

/// R = −∂L/∂q, by central differences along the knee and the hip, where muscles lie on their cylinders and where they do not.
#[test]
fn lever_arms_are_the_derivatives_of_the_lengths_of_wrapped_paths() {
    let leg = Leg::new(Model::with_wrapped_muscles);
    let mut random = Random::new(5);
    let h = 1e-5;
    let length = |turns: &Turns| -> Vec<f64> {
        let Q = leg.posture(turns);
        let fe = knee_angle(&leg.model.shapes, &Q);
        leg.model.muscles.iter().map(|m| m.length(&Q, fe)).collect()
    };
    let mut on_cylinder = 0;
    for _ in 0..40 {
        let turns = Turns {
            hip: std::array::from_fn(|_| 0.3 * random.uniform()),
            knee: random.between(0.05, 2.4),
            ankle: std::array::from_fn(|_| 0.2 * random.uniform()),
        };
        let R = arms(&leg, &turns);
        let (mut up, mut down) = (turns, turns);
        up.knee += h;
        down.knee -= h;
        let (longer, shorter) = (length(&up), length(&down));
        // The coordinate is the turn about −Z of the thigh; the knee turns about its other axes as it bends.
        let shank = |t: &Turns| leg.model.pose(SegmentId::Shank, &leg.posture(t)).R;
        let turn = Rotation3::from_matrix_unchecked(shank(&up) * shank(&down).transpose()).scaled_axis();
        let thigh = leg.model.pose(SegmentId::Thigh, &leg.posture(&turns)).R;
        let dq = -turn.dot(&thigh.column(2));
        for (m, muscle) in leg.model.muscles.iter().enumerate() {
            let slope = -(longer[m] - shorter[m]) / dq;
            let arm = R[(3, m)];
            assert!(
                (slope - arm).abs() < 2e-6 + 1e-4 * arm.abs(),
                "{} at {turns:?}: {slope} {arm}",
                muscle.name
            );
            let Q = leg.posture(&turns);
            on_cylinder += usize::from(muscle.wrap.as_ref().is_some_and(|wrap| {
                let points: Vec<_> = muscle.path.iter().map(|p| p.position.at(&Q)).collect();
                wrap.touch(&Q, &points[wrap.after], &points[wrap.after + 1]).is_some()
            }));
        }
    }
    assert!((40..240).contains(&on_cylinder), "{on_cylinder} of 240 lie on their cylinders");
}

/// `gait-data/knee_extension_arms.csv`: what others measured, as ranges of two standard deviations.
#[test]
fn knee_extensors_have_published_lever_arms() {
    let leg = Leg::new(Model::with_wrapped_muscles);
    let table = include_str!("../../gait-data/knee_extension_arms.csv");
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(table.as_bytes());
    let arm = |flexion: f64| {
        let R = arms(&leg, &Turns { knee: flexion.to_radians(), ..Turns::default() });
        let of = |name: &str| -R[(3, leg.model.muscles.iter().position(|m| m.name == name).unwrap())];
        ["vasmed", "vasint", "vaslat"].map(of).iter().sum::<f64>() / 3.0
    };
    let mut rows = 0;
    for record in reader.records() {
        let record = record.unwrap();
        let number = |k: usize| record[k].parse::<f64>().unwrap();
        let (from, to, least, greatest) = (number(0), number(1), number(2), number(3));
        // Excursions give means over a range of angles.
        let n = 10;
        let mean =
            (0..=n).map(|k| arm(from + (to - from) * k as f64 / n as f64)).sum::<f64>() / (n + 1) as f64;
        assert!(
            (least..=greatest).contains(&(1e3 * mean)),
            "{from} to {to} degrees: {:.1} mm, measured {least} to {greatest} ({})",
            1e3 * mean,
            &record[4]
        );
        rows += 1;
    }
    assert_eq!(rows, 3);
    for k in 0..=14 {
        println!("{:3} deg: {:.1} mm", 10 * k, 1e3 * arm(10.0 * k as f64));
    }
}
