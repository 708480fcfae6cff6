//! How long does the rigid side take, stage by stage, on one thread? The built-in walker: 101 reported frames and 100 around
//! them that feed the filters; 15 markers, 60 coordinates, 43 muscles. Times are per cycle: divide the marker fit and the motion by
//! 201 fitted frames, loads, sharing and the whole by 101 reported ones.

use divan::{Bencher, black_box};
use multibody::activation::activate;
use multibody::anatomy::Anatomy;
use multibody::ik::fit;
use multibody::loads::loads;
use multibody::model::{Ankle, Model};
use multibody::motion::track;
use multibody::muscle::hill;
use multibody::share::{SharingSettings, share};
use multibody::sharing::Capacity;
use multibody::trial::{Filters, Status, Trial};
use multibody::walker::{Knee, walker};

const FILTERS: Filters = Filters { motion_hz: 5.0, force_hz: None, contact_threshold: 20.0 };

fn main() {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("no pool was made before");
    let (trial, anatomy) = walker(Knee::Hinge);
    let model = leg(&trial, &anatomy);
    let frames = fit(&model, &trial);
    let steps: usize = frames.iter().map(|f| f.verdict.iterations).sum();
    let worst = frames.iter().map(|f| f.verdict.residual).fold(0.0, f64::max);
    println!("marker fit: {steps} Newton steps in {} frames, largest residual {worst:.1e}", frames.len());
    divan::main();
}

fn leg(trial: &Trial, anatomy: &Anatomy) -> Model {
    Model::new(trial, anatomy.clone(), Ankle::Universal).expect("the built-in walker")
}

/// Marker fit of 201 frames.
#[divan::bench]
fn marker_fit(bencher: Bencher) {
    let (trial, anatomy) = walker(Knee::Hinge);
    let model = leg(&trial, &anatomy);
    bencher.bench_local(|| black_box(fit(&model, &trial)));
}

/// Marker fit, filtered and projected velocities and accelerations of 201 frames.
#[divan::bench]
fn motion(bencher: Bencher) {
    let (trial, anatomy) = walker(Knee::Hinge);
    let model = leg(&trial, &anatomy);
    bencher.bench_local(|| black_box(track(&model, &trial, &FILTERS)));
}

/// Generalised loads, lever arms and joint forces per tension of 101 frames.
#[divan::bench(name = "loads")]
fn frame_loads(bencher: Bencher) {
    let (trial, anatomy) = walker(Knee::Hinge);
    let model = leg(&trial, &anatomy);
    let motion = track(&model, &trial, &FILTERS);
    bencher.bench_local(|| black_box(loads(&model, &motion, &trial, &FILTERS)));
}

/// Everything from markers to activations: 101 reported frames.
#[divan::bench]
fn end_to_end(bencher: Bencher) {
    let (trial, anatomy) = walker(Knee::Hinge);
    bencher.bench_local(|| {
        let model = leg(&trial, &anatomy);
        let motion = track(&model, &trial, &FILTERS);
        let loads = loads(&model, &motion, &trial, &FILTERS);
        let capacity = Capacity::nominal(model.muscles.iter().map(|m| m.f_max).collect());
        let mut effort =
            share(&model, &motion, &loads, &capacity, &SharingSettings::default()).expect("well posed");
        activate(&model, &motion, &mut effort, &hill::Settings::default()).expect("well posed");
        assert!(effort.verdicts.iter().all(|v| v.status == Status::Solved));
        effort
    });
}
