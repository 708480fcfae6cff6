//! How fast a machine is: one job of fixed size, timed.

use std::time::{Duration, Instant};

use fem::plan::Plan;
use fem::run::{DriveFrame, Session};
use fem::solve::Settings;
use fem::verification::squashed_block;

/// Elements along an edge of the block: 1728 elements and 6000 unknowns, a small muscle.
const ELEMENTS: usize = 12;
/// Fraction of its height by which the block is squashed.
const SQUASH: f64 = 0.1;
/// How long the job is repeated; the fastest time counts, since other programs can only make it longer.
const PATIENCE: Duration = Duration::from_secs(1);

/// Seconds that one Newton iteration of the block takes one core, derivatives, factorization and line search together.
pub fn iteration_seconds() -> f64 {
    let (scene, mesh) = squashed_block(ELEMENTS);
    let plan = Plan::new(&scene, mesh).expect("a scene of the verification");
    let squashed = plan.load(&[("c", SQUASH)], &[]).expect("its control");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread more");
    let clock = Instant::now();
    let mut least = f64::INFINITY;
    while least.is_infinite() || clock.elapsed() < PATIENCE {
        least = least.min(pool.install(|| {
            let settings = Settings::default();
            let mut session = Session::new(&plan, &settings, None).expect("settings that can be");
            let once = Instant::now();
            let done = session.advance(&DriveFrame { time: 1.0, load: squashed.clone() });
            let iterations: usize = done.frame.islands.iter().map(|island| island.iterations).sum();
            once.elapsed().as_secs_f64() / iterations.max(1) as f64
        }));
    }
    least
}
