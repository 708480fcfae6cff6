//! How fast a machine is: one job of fixed size, timed.

use std::sync::Barrier;
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

/// Seconds that one Newton iteration of the block takes a thread, derivatives, factorization and line search together, while all threads of this
/// process do the same: what shares memory, power or a core is slower together than alone.
pub fn iteration_seconds() -> f64 {
    let threads = rayon::current_num_threads();
    let (scene, mesh) = squashed_block(ELEMENTS);
    let plan = Plan::new(&scene, mesh).expect("a scene of the verification");
    let squashed = plan.load(&[("c", SQUASH)], &[]).expect("its control");
    let job = || {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread more");
        pool.install(|| {
            let mut session = Session::new(&plan, &Settings::default(), None).expect("settings that can be");
            let done = session.advance(&DriveFrame { time: 1.0, load: squashed.clone() });
            done.frame.islands.iter().map(|island| island.iterations).sum::<usize>()
        })
    };
    let clock = Instant::now();
    let mut least = f64::INFINITY;
    while least.is_infinite() || clock.elapsed() < PATIENCE {
        least = least.min(together(threads, job));
    }
    least
}

/// Seconds per iteration of `job`, which returns how many it made, mean of `threads` that begin it at once.
fn together(threads: usize, job: impl Fn() -> usize + Sync) -> f64 {
    let begin = Barrier::new(threads);
    let timed = || {
        begin.wait();
        let once = Instant::now();
        let iterations = job();
        once.elapsed().as_secs_f64() / iterations.max(1) as f64
    };
    let all: f64 = std::thread::scope(|scope| {
        let running: Vec<_> = (0..threads).map(|_| scope.spawn(timed)).collect();
        running.into_iter().map(|thread| thread.join().expect("a job that ends")).sum()
    });
    all / threads as f64
}
