//! Hard cases of what is called solved: E16, E17.

use crate::{Case, Outcome, Tier};
use fem::plan::{Load, Plan};
use fem::run::{Drive, DriveFrame, Frame, run};
use fem::solve::SolveError;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc;
use std::time::Duration;
use support::independent::{Candidate, Component, Independent, Judgement};
use support::random_scenes::{RandomScene, random_scene};

pub const CASES: &[Case] = &[
    Case { id: "E17", title: "solved means solved, 50 random scenes", tier: Tier::Quick, run: a_tenth },
    Case { id: "E17", title: "solved means solved, 500 random scenes", tier: Tier::Full, run: all },
];

fn a_tenth() -> Outcome {
    random_scenes(0..50)
}

fn all() -> Outcome {
    random_scenes(50..550)
}

/// Seconds after which a scene that has not ended hangs.
const HANG: Duration = Duration::from_secs(60);

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
    /// What is wrong.
    mistakes: Vec<String>,
}

fn random_scenes(seeds: std::ops::Range<u64>) -> Outcome {
    let listed = std::env::var("E17_SEED").ok().and_then(|s| s.parse().ok()).map(|s: u64| s..s + 1);
    let seeds = listed.unwrap_or(seeds);
    let (send, receive) = mpsc::channel();
    let all = seeds.clone();
    std::thread::spawn(move || {
        for seed in all {
            let verdict = catch_unwind(AssertUnwindSafe(|| judge(&random_scene(seed))));
            if send.send((seed, verdict.ok())).is_err() {
                return;
            }
        }
    });
    let (mut refused, mut solved, mut not_converged) = (0, 0, 0);
    let mut mistakes = Vec::new();
    let mut worst = 0.0_f64;
    for next in seeds {
        let Ok((seed, verdict)) = receive.recv_timeout(HANG) else {
            mistakes.push(format!("seed {next} hangs: {}", random_scene(next).what));
            break;
        };
        let Some(verdict) = verdict else {
            mistakes.push(format!("seed {seed} panics: {}", random_scene(seed).what));
            continue;
        };
        let how = match verdict.ending {
            Ending::Refused(why) => {
                refused += 1;
                format!("refused: {why}")
            }
            Ending::Solved => {
                solved += 1;
                worst = worst.max(verdict.worst);
                format!("solved, {:.2e} of what was asked", verdict.worst)
            }
            Ending::NotConverged(why) => {
                not_converged += 1;
                format!("not converged: {why}")
            }
        };
        if std::env::var("E17_TALK").is_ok() {
            println!("{seed}: {how} [{}]", random_scene(seed).what);
        }
        for mistake in verdict.mistakes {
            println!("seed {seed}: {mistake} [{}]", random_scene(seed).what);
            mistakes.push(format!("seed {seed}: {mistake}"));
        }
    }
    let counts = format!("{solved} solved, {not_converged} not converged, {refused} refused");
    match mistakes.first() {
        None => Ok(format!("{counts}; worst residual {worst:.3} of what was asked")),
        Some(first) => Err(format!("{counts}; {} mistakes, the first: {first}", mistakes.len())),
    }
}

fn judge(random: &RandomScene) -> Verdict {
    let plan = match Plan::new(&random.scene, random.mesh.clone()) {
        Ok(plan) => plan,
        Err(why) => {
            return Verdict { ending: Ending::Refused(why.to_string()), worst: 0.0, mistakes: Vec::new() };
        }
    };
    let frame = |target: &support::random_scenes::Target| {
        let load = plan.load(&target.controls, &target.poses).expect("finite values of known names");
        DriveFrame { time: target.time, load }
    };
    let drive = Drive { frames: random.frames.iter().map(frame).collect() };
    let run = run(&plan, &drive, &random.settings, None, &mut |_| {});
    let mut judge = Judge::new(random, &plan);
    for frame in &run.frames {
        judge.solved(frame);
    }
    if let Some(last) = &run.unsolved {
        judge.unsolved(last, &run.errors);
    }
    let ending = match run.errors.first() {
        None => Ending::Solved,
        Some(error) => Ending::NotConverged(error.to_string()),
    };
    Verdict { ending, worst: judge.worst, mistakes: judge.mistakes }
}

/// Follows a run with the independent code.
struct Judge<'a> {
    random: &'a RandomScene,
    plan: &'a Plan,
    independent: Independent<'a>,
    /// The state before.
    time: f64,
    x: Vec<f64>,
    v: Vec<f64>,
    load: Load,
    worst: f64,
    mistakes: Vec<String>,
}

impl<'a> Judge<'a> {
    fn new(random: &'a RandomScene, plan: &'a Plan) -> Judge<'a> {
        Judge {
            random,
            plan,
            independent: Independent::new(&random.scene, &plan.mesh),
            time: 0.0,
            x: plan.reference(),
            v: plan.inertia.as_ref().map_or(Vec::new(), |i| i.velocities.clone()),
            load: plan.load(&[], &[]).expect("nothing is named"),
            worst: 0.0,
            mistakes: Vec::new(),
        }
    }

    /// Judges every island of a state under a load.
    fn judgements(&self, x: &[f64], controls: &[f64], time: f64) -> Vec<Judgement> {
        let values: BTreeMap<&str, f64> =
            self.plan.controls.iter().map(String::as_str).zip(controls.iter().copied()).collect();
        let before = (!self.v.is_empty()).then_some((time - self.time, &self.x[..], &self.v[..]));
        self.independent.judge(&Candidate { x, control: &|name| values[name], before })
    }

    fn solved(&mut self, frame: &Frame) {
        if !frame.x.iter().chain(&frame.v).all(|v| v.is_finite()) {
            self.mistakes.push("a solved frame holds values that are not finite".to_string());
            return;
        }
        self.check_places(&frame.x, &frame.load);
        for judgement in self.judgements(&frame.x, &frame.load.controls, frame.time) {
            self.check_island(&judgement, "solved", true);
        }
        let at = self.plan.islands.iter().zip(&frame.islands);
        let told: Vec<(f64, f64)> = at.map(|(_, advance)| (advance.residual, advance.force_scale)).collect();
        if std::env::var("E17_TALK").is_ok() {
            println!("  told (residual, scale) {told:?}");
        }
        self.time = frame.time;
        (self.x, self.v, self.load) = (frame.x.clone(), frame.v.clone(), frame.load.clone());
    }

    /// What is prescribed has to be where the load wants it, what follows beside its master.
    fn check_places(&mut self, x: &[f64], load: &Load) {
        let (mesh, scene) = (&self.plan.mesh, &self.random.scene);
        let control =
            |name: &str| load.controls[self.plan.controls.iter().position(|c| c == name).expect("known")];
        let mut wanted = BTreeMap::<usize, f64>::new();
        for spec in &scene.prescribed {
            let factor = spec.control.as_ref().map_or(0.0, |c| control(c));
            for (i, &n) in mesh.node_sets[&spec.nodes].iter().enumerate() {
                for c in (0..3).filter(|c| spec.components[*c]) {
                    let given = if spec.displacement.len() == 1 {
                        spec.displacement.first()
                    } else {
                        spec.displacement.get(i)
                    };
                    let u = given.map_or(0.0, |u| u[c]);
                    wanted.insert(3 * n as usize + c, mesh.points[n as usize][c] + factor * u);
                }
            }
        }
        for spec in &scene.ties {
            let body = self.plan.bodies.iter().position(|b| *b == spec.body).expect("known");
            for &n in &mesh.node_sets[&spec.nodes] {
                let place = load.poses[body] * nalgebra::Point3::from(mesh.points[n as usize]);
                wanted.extend((0..3).map(|c| (3 * n as usize + c, place[c])));
            }
        }
        for (n, of) in self.independent.components().iter().enumerate() {
            for (c, component) in of.iter().enumerate() {
                if let Component::Follows(m) = component {
                    let m = *m as usize;
                    wanted.insert(3 * n + c, mesh.points[n][c] + (x[3 * m + c] - mesh.points[m][c]));
                }
            }
        }
        let extent = mesh.points.iter().flatten().chain(x).fold(0.0_f64, |m, v| m.max(v.abs()));
        for (i, wanted) in wanted {
            if !((x[i] - wanted).abs() <= 1e-14 * extent) {
                self.mistakes.push(format!("component {i} is at {}, prescribed at {wanted}", x[i]));
                return;
            }
        }
    }

    fn check_island(&mut self, judgement: &Judgement, what: &str, counts: bool) {
        let settings = &self.random.settings;
        let Judgement { residual, scale, least_det, .. } = judgement;
        let wanted = settings.tolerance * scale.max(settings.least_force);
        let share = if *residual == 0.0 { 0.0 } else { residual / wanted };
        if counts {
            self.worst = self.worst.max(share);
        }
        if !(share <= 1.0) {
            self.mistakes.push(format!(
                "{what}, but the residual is {residual:.2e} N of {scale:.2e} N in play, {share:.2e} of what was asked"
            ));
        }
        if !(*least_det > 0.0) {
            self.mistakes.push(format!("{what}, but det F is {least_det:.2e}"));
        }
    }

    /// A frame that was not solved holds the last good state of each island: equilibrium at the load that its error names.
    fn unsolved(&mut self, frame: &Frame, errors: &[SolveError]) {
        if !frame.x.iter().chain(&frame.v).all(|v| v.is_finite()) {
            self.mistakes.push("a frame that was not solved holds values that are not finite".to_string());
            return;
        }
        if self.random.scene.contact.is_some()
            || self.random.scene.inertia.is_some()
            || self.plan.islands.len() != 1
        {
            return;
        }
        let load = match errors.first() {
            Some(SolveError::NotConverged(why)) => why.load,
            _ => 0.0,
        };
        if load == 0.0 {
            if frame.x != self.x {
                self.mistakes.push("not converged beyond load 0, but nodes have moved".to_string());
            }
            return;
        }
        let mix = self.load.controls.iter().zip(&frame.load.controls).map(|(a, b)| a + load * (b - a));
        let controls: Vec<f64> = mix.collect();
        for judgement in self.judgements(&frame.x, &controls, frame.time) {
            self.check_island(&judgement, &format!("the last good state, load {load:.3}"), false);
        }
    }
}
