//! Does the marker fit find the posture that made the markers?

use multibody::ik;
use multibody::kinematics::coupled_knee;
use multibody::model::{Ankle, Model};
use multibody::walker::{Knee, walker};

#[test]
fn knee_path_agrees_with_the_published_test_vectors() {
    // joints.md: flexion, adduction, internal rotation [deg], x, y, z [mm]; printed to 0.01.
    let table = [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [15.0, -3.38, 10.45, 3.56, -0.98, -0.46],
        [30.0, -6.61, 13.63, 6.16, -3.63, -0.52],
        [45.0, -9.47, 12.68, 7.57, -7.61, -0.18],
        [60.0, -11.76, 9.76, 7.41, -12.66, 0.40],
        [75.0, -13.35, 6.77, 5.20, -18.48, 1.02],
        [90.0, -14.14, 5.40, 0.34, -24.67, 1.37],
        [105.0, -14.11, 6.83, -7.87, -30.41, 1.06],
        [120.0, -13.24, 10.73, -19.74, -34.07, -0.26],
    ];
    for [flexion, adduction, rotation, x, y, z] in table {
        let ((a, r), p) = coupled_knee(f64::to_radians(flexion));
        let got = [a.to_degrees(), r.to_degrees(), 1e3 * p.x, 1e3 * p.y, 1e3 * p.z];
        for (got, want) in got.iter().zip([adduction, rotation, x, y, z]) {
            assert!((got - want).abs() < 0.01, "at {flexion} deg: {got} instead of {want}");
        }
    }
}

#[test]
fn probe() {
    use multibody::share::*;
    use multibody::sharing::*;
    use multibody::trial::*;
    let filters = Filters { motion_hz: 5.0, force_hz: None, contact_threshold: 20.0 };
    for knee in [Knee::Hinge, Knee::Coupled] {
        for ankle in [Ankle::Universal, Ankle::Parallel] {
            let (trial, anatomy) = walker(knee);
            let model = Model::new(&trial, anatomy, ankle).unwrap();
            let motion = multibody::motion::track(&model, &trial, &filters);
            let t0 = std::time::Instant::now();
            let loads = loads(&model, &motion, &trial, &filters);
            let t1 = t0.elapsed();
            let capacity = Capacity::nominal(model.muscles.iter().map(|m| m.f_max).collect());
            for (name, muscle_cost, reaction_cost, bounded) in [
                ("c1", MuscleCost::Force, ReactionCost::None, false),
                ("c2", MuscleCost::Force, ReactionCost::Table, false),
                ("c2b", MuscleCost::Force, ReactionCost::Table, true),
                ("act", MuscleCost::Activation, ReactionCost::None, true),
                ("vol", MuscleCost::Volume, ReactionCost::None, true),
            ] {
                let settings =
                    SharingSettings { muscle_cost, reaction_cost, bounded, ..SharingSettings::default() };
                let t0 = std::time::Instant::now();
                let effort = share(&model, &motion, &loads, &capacity, &settings).unwrap();
                let t2 = t0.elapsed();
                let col = |n: &str| effort.reactions.columns.iter().position(|c| c == n).unwrap();
                let (m, l) = (col("knee_medial"), col("knee_lateral"));
                let total = (0..effort.time.len())
                    .map(|k| effort.reactions.values[(k, m)] + effort.reactions.values[(k, l)])
                    .fold(0.0, f64::max)
                    / (70.0 * 9.81);
                let over = (0..effort.time.len())
                    .flat_map(|k| (0..43).map(move |i| (k, i)))
                    .map(|(k, i)| effort.forces.values[(k, i)] / model.muscles[i].f_max)
                    .fold(0.0, f64::max);
                let active = (0..effort.time.len())
                    .map(|k| (0..43).filter(|&i| effort.forces.values[(k, i)] > 1e-6).count())
                    .sum::<usize>() as f64
                    / effort.time.len() as f64;
                let solved = effort.verdicts.iter().filter(|v| v.status == Status::Solved).count();
                let mcl = effort.reactions.values.column(col("mcl")).min();
                println!(
                    "{knee:?} {ankle:?} {name}: total {total:.2} BW, f/Fmax {over:.2}, active {active:.1}, solved {solved}, mcl {mcl:.0}, loads {t1:?} share {t2:?} {:?}",
                    effort.verdicts.iter().find(|v| v.status != Status::Solved).map(|v| v.reason.clone())
                );
            }
        }
    }
}
