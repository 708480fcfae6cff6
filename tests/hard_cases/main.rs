//! The hard cases as one table: a row per case with id, verdict, the number that decided it, seconds.
//!
//! `cargo test --release -p sartorius-tests --test hard_cases` runs the quick tier,
//! `cargo test --release -p sartorius-tests --test hard_cases -- --full [ID...]` everything (or the named cases);
//! `--page` enters what was run in `docs/hard-cases.md`, with date and commit.

use std::sync::Mutex;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

mod blocks;
mod contact;
mod dynamics;
mod elements;
mod equilibrium;
mod fidelity;
mod grids;
mod hertz;
mod incompressible;
mod judge;
mod knee;
mod meshes;
mod no_equilibrium;
mod page;
mod rigid;
mod sides;
mod solved;
mod sweeps;

/// When a case runs.
#[derive(Clone, Copy, PartialEq)]
enum Tier {
    /// On every change.
    Quick,
    /// On request (`--full`).
    Full,
}

/// Cases that are known to fail, by id and title, with the reason. One that passes all the same is a surprise, too.
const KNOWN: &[(&str, &str, &str)] = &[
    ("b06", "work of the sliding force, cheap", OPEN_RIM),
    ("b06w", "on a wide block, open, guarded", RIM),
    ("b06w", "on a wide block, closed, cheap", RIM),
    ("C7", "patella of a real knee, 200 N, cheap", SLOPE),
    ("C7", "patella of a real knee, 200 N, guarded", SLOPE),
    ("C7", "patella of a real knee, 1000 N, cheap", EXTENSION),
    ("C7", "patella of a real knee, 1000 N, guarded", EXTENSION),
];
const SLOPE: &str = "rapid share 4 to 6 %, as a smooth curve has that ends with a slope; see C7j";
const EXTENSION: &str = "steps of 2.7 mm, of which the tibia prescribes 2.6; rapid share 3 to 8 %, as a smooth curve has that ends with a slope; see C7j";
const OPEN_RIM: &str =
    "samples drop out by a jump beyond the rim of an open surface, where no equilibrium is left";
const RIM: &str =
    "energy depends on where in its cells the rim stands; smooth normals across edges are missing";

/// How a case ended: `Ok` with the number that decided it, `Err` with what went wrong.
type Outcome = Result<String, String>;

/// One hard case.
struct Case {
    /// Short name, e.g. `E1`.
    id: &'static str,
    /// What is asked.
    title: &'static str,
    tier: Tier,
    run: fn() -> Outcome,
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let full = arguments.iter().any(|a| a == "--full");
    let wanted: Vec<&String> = arguments.iter().filter(|a| !a.starts_with('-')).collect();
    println!("{:<5} {:<8} {:>8}  case; what decided it", "id", "verdict", "seconds");
    let tables = [
        elements::CASES,
        contact::CASES,
        blocks::CASES,
        hertz::CASES,
        sweeps::CASES,
        fidelity::CASES,
        knee::CASES,
        meshes::CASES,
        dynamics::CASES,
        equilibrium::CASES,
        incompressible::CASES,
        grids::CASES,
        rigid::CASES,
        sides::CASES,
        no_equilibrium::CASES,
        solved::CASES,
    ];
    let titles: Vec<(&str, &str)> = tables.into_iter().flatten().map(|c| (c.id, c.title)).collect();
    let is_asked = |case: &&Case| match wanted.is_empty() {
        true => full || case.tier == Tier::Quick,
        false => wanted.iter().any(|w| w.eq_ignore_ascii_case(case.id)),
    };
    let cases: Vec<&Case> = tables.into_iter().flatten().filter(is_asked).collect();
    // Many quick cases have work for one core only. Rows of the page come in order, with seconds that nothing else ran beside.
    let page = arguments.iter().any(|a| a == "--page");
    let at_once = if full || page { 1 } else { std::thread::available_parallelism().map_or(1, usize::from) };
    let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..at_once {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Relaxed)) {
                    let row = judged(case);
                    done.lock().expect("no panic while it is held").push(row);
                }
            });
        }
    });
    let done = done.into_inner().expect("no panic while it is held");
    let surprises = done.iter().filter(|(_, is_surprise)| *is_surprise).count();
    if page {
        page::enter(done.into_iter().map(|(row, _)| row).collect(), &titles);
    }
    if surprises > 0 {
        println!("{surprises} hard case(s) ended otherwise than expected");
        std::process::exit(1);
    }
}

/// Runs a case and prints its row; whether it ended otherwise than expected.
fn judged(case: &Case) -> (page::Row, bool) {
    let start = Instant::now();
    // A panic is one failed row, not the end of the table.
    let outcome = std::panic::catch_unwind(case.run);
    let seconds = start.elapsed().as_secs_f64();
    let known = KNOWN.iter().find(|(id, title, _)| (*id, *title) == (case.id, case.title));
    let (verdict, text, is_surprise) = match (outcome, known) {
        (Ok(Ok(text)), None) => ("pass", text, false),
        (Ok(Err(text)), Some((_, _, why))) => ("known", format!("{text} ({why})"), false),
        (Ok(Ok(text)), Some(_)) => {
            ("PASS", format!("{text}; it was known to fail: take it out of KNOWN"), true)
        }
        (Ok(Err(text)), None) => ("FAIL", text, true),
        // Nothing that is known explains one.
        (Err(_), _) => ("FAIL", "panicked, see above".into(), true),
    };
    println!("{:<5} {:<8} {:>8.2}  {}; {}", case.id, verdict, seconds, case.title, text);
    (page::Row { id: case.id, title: case.title, verdict, seconds, text }, is_surprise)
}
