//! A squat of the built-in leg with a prosthesis, knee from 5 to 100 degrees: can every frame be solved?

#![allow(non_snake_case)]

use multibody::dynamics::{GroundLoad, leg_load};
use multibody::equilibrium::equilibrium;
use multibody::model::{KneeKind, Model};
use multibody::natural::{Coordinates, SegmentId, block};
use multibody::share::{SharingSettings, names, reactions_of};
use multibody::sharing::{
    Capacity, MuscleCost, SharingOptions, SharingProblem, SharingSolver, muscle_weights,
};
use multibody::trial::Status;
use nalgebra::DVector;

use super::postures::{Leg, Turns};

/// Half the weight of 70 kg, under the middle of the foot (a third of the way from the ankle to the toes).
const HALF_WEIGHT: f64 = 0.5 * 70.0 * 9.81;

/// Frames of the squat: trunk, thigh and shank lean so that the foot stays flat under the hip.
fn frames(leg: &Leg) -> Vec<(f64, Coordinates)> {
    (0..=95)
        .map(|k| {
            let knee = f64::to_radians(5.0 + k as f64);
            // The thigh leans back as the shank leans forward, in the proportion of a squat (60 and 40 per cent of the knee angle).
            let turns = Turns { hip: [0.6 * knee, 0.0, 0.0], knee, ankle: [0.0, 0.0] };
            (knee, leg.posture(&turns))
        })
        .collect()
}

#[test]
fn every_frame_of_a_squat_to_100_degrees_is_solved_with_a_prosthesis() {
    let leg = Leg::new(|m: Model| m.with_wrapped_muscles().with_knee(KneeKind::Implant));
    let model = &leg.model;
    let names = names(model);
    let capacity = Capacity::nominal(model.muscles.iter().map(|m| m.f_max).collect());
    let l_opt: Vec<f64> = model.muscles.iter().map(|m| m.l_opt).collect();
    let table = reactions_of(model);
    assert!(SharingSettings::default().bounded);
    let mut solver = SharingSolver::new(names.clone(), SharingOptions::default());
    let mut peak: f64 = 0.0;
    for (knee, Q) in frames(&leg) {
        let toe = block(&Q, SegmentId::Foot.block(2));
        let ankle = block(&Q, SegmentId::Foot.block(1));
        // The ground pushes along the line of weight that keeps the whole body over the foot: straight up in the lab, turned with the shank here,
        // where the pelvis stays and the leg moves.
        let hip = block(&Q, SegmentId::Thigh.block(1));
        let at = ankle + (toe - ankle) / 3.0;
        let up = (hip - at).normalize();
        let force = HALF_WEIGHT * up;
        let load =
            leg_load(model, &Q, &Coordinates::zeros(), &GroundLoad { force, moment: at.cross(&force) });
        let reduced = equilibrium(model, &Q, &load).expect("no joint is locked");
        let problem = SharingProblem {
            R: reduced.lever_arms,
            tau: reduced.moments,
            x0: reduced.reaction_without,
            X: reduced.reaction_per_force,
            lower_f: DVector::zeros(43),
            upper_f: DVector::from_fn(43, |i, _| capacity.bounds[i][1]),
            lower_x: DVector::from_iterator(table.len(), table.iter().map(|r| r.lower)),
            upper_x: DVector::from_element(table.len(), f64::INFINITY),
            w_f: muscle_weights(MuscleCost::Volume, &capacity, &l_opt),
            w_x: DVector::zeros(table.len()),
            w_s: None,
        };
        let answer = solver.solve(&problem).unwrap();
        assert_eq!(
            answer.verdict.status,
            Status::Solved,
            "{:.0} deg: {:?}",
            knee.to_degrees(),
            answer.verdict.reason
        );
        let of = |name: &str| answer.x[names.reactions.iter().position(|n| n == name).unwrap()];
        assert!(of("knee_medial") >= -1e-6 && of("knee_lateral") >= -1e-6);
        peak = peak.max((of("knee_medial") + of("knee_lateral")) / (2.0 * HALF_WEIGHT));
    }
    println!("knee force up to {peak:.2} body weights");
    assert!(peak < 6.0, "{peak}");
}
