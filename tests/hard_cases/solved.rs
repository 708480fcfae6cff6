//! Hard case of what is called solved: E17.
//!
//! Contact is computed by the crate alone, so a scene with contact is judged by a weaker rule: all nodes but those of the contact
//! surfaces are in equilibrium, and what is missing at those is a pair of forces that cancel, push, and do not act from afar.

use super::judge::judged_run;
use crate::{Case, Outcome, Tier};
use fem::plan::{Plan, SceneError};
use fem::run::{Drive, DriveFrame};
use fem::solve::SolveError;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc;
use std::time::Duration;
use support::random_scenes::{RandomScene, Target, random_scene};

pub const CASES: &[Case] = &[
    Case { id: "E17", title: "solved means solved, 50 random scenes", tier: Tier::Quick, run: a_tenth },
    Case { id: "E17", title: "solved means solved, 500 random scenes", tier: Tier::Full, run: all },
];

/// Seconds after which a scene that has not ended hangs. The quick tier runs beside other tests and only looks that it ends.
const HANG: [u64; 2] = [600, 60];

fn a_tenth() -> Outcome {
    random_scenes(0..50, HANG[0])
}

fn all() -> Outcome {
    random_scenes(50..550, HANG[1])
}

/// How a scene ended.
enum Ending {
    Refused(String),
    Solved,
    NotConverged(String),
}

/// What is to be said of a scene.
struct Verdict {
    ending: Ending,
    /// Worst residual of what was called solved, relative to what was asked for.
    worst: f64,
    /// Whether its last good state has an inverted cell.
    inverted: bool,
    /// What is wrong.
    mistakes: Vec<String>,
}

/// Runs the scenes of some seeds; `E17_SEEDS=4..9` in the environment asks for others, and has each named with how it ended.
fn random_scenes(seeds: Range<u64>, hang: u64) -> Outcome {
    let asked = std::env::var("E17_SEEDS").ok();
    let (talks, seeds) = (asked.is_some(), asked.and_then(|s| range(&s)).unwrap_or(seeds));
    let (send, receive) = mpsc::channel();
    let all = seeds.clone();
    std::thread::spawn(move || {
        for seed in all {
            let verdict = catch_unwind(AssertUnwindSafe(|| verdict(&random_scene(seed))));
            if send.send(verdict.ok()).is_err() {
                return;
            }
        }
    });
    let (mut refused, mut solved, mut not_converged, mut inverted, mut worst) = (0, 0, 0, 0, 0.0_f64);
    let mut mistakes = Vec::new();
    for seed in seeds {
        let name = || format!("seed {seed} [{}]", random_scene(seed).what);
        let Ok(verdict) = receive.recv_timeout(Duration::from_secs(hang)) else {
            mistakes.push(format!("{}: hangs", name()));
            break;
        };
        let Some(verdict) = verdict else {
            mistakes.push(format!("{}: panics", name()));
            continue;
        };
        worst = worst.max(verdict.worst);
        inverted += usize::from(verdict.inverted);
        let how = match verdict.ending {
            Ending::Refused(why) => {
                refused += 1;
                format!("refused: {why}")
            }
            Ending::Solved => {
                solved += 1;
                format!("solved, {:.2e} of what was asked", verdict.worst)
            }
            Ending::NotConverged(why) => {
                not_converged += 1;
                format!("not converged: {why}")
            }
        };
        if talks {
            println!("{}: {how}", name());
        }
        mistakes.extend(verdict.mistakes.iter().map(|mistake| format!("{}: {mistake}", name())));
    }
    mistakes.iter().for_each(|mistake| println!("{mistake}"));
    let counts = format!("{solved} solved, {not_converged} not converged, {refused} refused");
    match mistakes.first() {
        None => Ok(format!(
            "{counts}; worst residual {worst:.3} of what was asked; {inverted} last good states with an inverted cell"
        )),
        Some(first) => Err(format!("{counts}; {} mistakes, the first: {first}", mistakes.len())),
    }
}

/// `4..9`, or `4` for that seed alone.
fn range(text: &str) -> Option<Range<u64>> {
    let (from, to) = text.split_once("..").unwrap_or((text, ""));
    let from: u64 = from.parse().ok()?;
    Some(from..to.parse().unwrap_or(from + 1))
}

fn verdict(random: &RandomScene) -> Verdict {
    let refused = |why: String| Verdict {
        ending: Ending::Refused(why),
        worst: 0.0,
        inverted: false,
        mistakes: Vec::new(),
    };
    let plan = match Plan::new(&random.scene, random.mesh.clone()) {
        Ok(plan) => plan,
        Err(why) => return refused(why.to_string()),
    };
    let frame = |target: &Target| {
        let load = plan.load(&target.controls, &target.poses)?;
        Ok(DriveFrame { time: target.time, load })
    };
    let drive = match random.frames.iter().map(frame).collect::<Result<_, SceneError>>() {
        Ok(frames) => Drive { frames },
        Err(why) => return refused(why.to_string()),
    };
    let (run, judge) = judged_run(&random.scene, &plan, &drive, &random.settings);
    let ending = match run.errors.first() {
        None => Ending::Solved,
        Some(error @ SolveError::Settings { .. }) => Ending::Refused(error.to_string()),
        Some(error) => Ending::NotConverged(error.to_string()),
    };
    Verdict { ending, worst: judge.worst, inverted: judge.inverted, mistakes: judge.mistakes }
}
