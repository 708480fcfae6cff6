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
            let model = Model::new(&trial, anatomy, ankle).unwrap();
            let start = std::time::Instant::now();
            let frames = ik::fit(&model, &trial);
            let dt = start.elapsed();
            let r: Vec<_> = trial.report.clone().map(|k| &frames[k]).collect();
            let rms = (r.iter().map(|f| f.verdict.marker_rms.powi(2)).sum::<f64>() / r.len() as f64).sqrt();
            let it: usize = frames.iter().map(|f| f.verdict.iterations).sum();
            let c = r.iter().map(|f| f.verdict.constraint).fold(0.0, f64::max);
            let fails: Vec<_> = frames.iter().filter_map(|f| f.verdict.failure.clone()).collect();
            println!("{knee:?} {ankle:?} rms {:.3} mm, {it} iterations, constraint {c:.1e}, fails {} {:?} {dt:?}", rms*1e3, fails.len(), fails.first());
        }
    }
}
