//! How long does sharing one frame take? The 101 frames of the built-in walker, universal ankle: 43 muscles, 6 coordinates,
//! 19 contact, ligament, tendon and bone forces; condition 2 bounded by strength. Times are per cycle: divide by 101.

use divan::{Bencher, black_box};
use multibody::loads::loads;
use multibody::model::{Ankle, Model};
use multibody::motion::track;
use multibody::share::{SharingSettings, names, problem};
use multibody::sharing::{
    Capacity, Names, SharingError, SharingOptions, SharingProblem, SharingSolver, share_frames,
};
use multibody::trial::{Filters, Status};
use multibody::walker::{Knee, walker};

fn main() {
    divan::main();
}

/// The cycle's problems, with the tensions bounded by strength or not.
fn cycle(bounded: bool) -> (Names, Vec<SharingProblem>) {
    let (trial, anatomy) = walker(Knee::Hinge);
    let filters = Filters { motion_hz: 5.0, force_hz: None, contact_threshold: 20.0 };
    let model = Model::new(&trial, anatomy, Ankle::Universal).expect("the built-in walker");
    let motion = track(&model, &trial, &filters);
    let loads = loads(&model, &motion, &trial, &filters);
    let capacity = Capacity::nominal(model.muscles.iter().map(|m| m.f_max).collect());
    let settings = SharingSettings { bounded, ..SharingSettings::default() };
    let frame = |k| problem(&model, &loads, k, &capacity, &settings).expect("every frame is fitted");
    (names(&model), (0..loads.time.len()).map(frame).collect())
}

/// A new solver for every frame.
#[divan::bench(args = [true, false])]
fn cold(bencher: Bencher, bounded: bool) {
    let (names, problems) = cycle(bounded);
    bencher.bench_local(|| {
        for problem in &problems {
            let answer = SharingSolver::new(names.clone(), SharingOptions::default()).solve(problem);
            assert_eq!(answer.expect("well posed").verdict.status, Status::Solved);
        }
    });
}

/// One solver for the cycle.
#[divan::bench(args = [true, false])]
fn kept(bencher: Bencher, bounded: bool) {
    let (names, problems) = cycle(bounded);
    let mut solver = SharingSolver::new(names, SharingOptions::default());
    let (mut worst, mut iterations) = (0.0f64, 0);
    for problem in &problems {
        let answer = solver.solve(problem).expect("well posed");
        worst = worst.max(answer.residuals.largest());
        iterations += answer.verdict.iterations;
    }
    println!(
        "bounded {bounded}: KKT residual {worst:.1e}, {iterations} iterations in {} frames",
        problems.len()
    );
    bencher.bench_local(|| {
        for problem in &problems {
            black_box(solver.solve(problem).expect("well posed"));
        }
    });
}

/// All frames, in chunks, on all threads.
#[divan::bench]
fn parallel(bencher: Bencher) {
    let (names, problems) = cycle(true);
    bencher.bench_local(|| {
        share_frames(problems.len(), &names, SharingOptions::default(), |k| {
            Ok::<_, SharingError>(problems[k].clone())
        })
    });
}
