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
    for knee in [Knee::Hinge, Knee::Coupled] {
        for ankle in [Ankle::Universal, Ankle::Parallel] {
            let (trial, anatomy) = walker(knee);
            let mut model = Model::new(&trial, anatomy, ankle).unwrap();
            for pass in 0..2 {
                if pass == 1 {
                    use multibody::natural::*;
                    let i = model
                        .equations
                        .iter()
                        .position(|e| {
                            matches!(e, multibody::joint::Equation::Coincide { contact: "ankle", .. })
                        })
                        .unwrap();
                    let gap = model.shapes[1]
                        .point(SegmentId::Shank, &nalgebra::Vector3::zeros(), End::Distal)
                        .minus(&model.shapes[0].point(
                            SegmentId::Foot,
                            &nalgebra::Vector3::zeros(),
                            End::Proximal,
                        ));
                    model.equations.remove(i);
                    model.equations.remove(i);
                    if ankle == Ankle::Parallel {
                        model.equations.remove(i);
                    }
                    model.equations.insert(
                        0,
                        multibody::joint::Equation::Coincide {
                            gap,
                            distal: SegmentId::Foot,
                            contact: "ankle",
                        },
                    );
                }
                let frames = ik::fit(&model, &trial);
                let r: Vec<_> = trial
                    .report
                    .clone()
                    .map(|k| &frames[k])
                    .filter(|f| f.verdict.failure.is_none())
                    .collect();
                let rms =
                    (r.iter().map(|f| f.verdict.marker_rms.powi(2)).sum::<f64>() / r.len() as f64).sqrt();
                for (k, f) in frames.iter().enumerate() {
                    if f.verdict.failure.is_some() {
                        println!("{k} {:?}", f.verdict);
                    }
                }
                println!("{knee:?} {ankle:?} {pass} rms {:.3} mm {}", rms * 1e3, r.len());
            }
        }
    }
}
