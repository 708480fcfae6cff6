//! Is what a run calls solved in equilibrium? Asked of code that shares nothing with the solver and its elements.

use fem::plan::{Load, Plan};
use fem::run::{Drive, Frame, Run, run};
use fem::scene::Scene;
use fem::solve::{Settings, SolveError};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use support::independent::{Candidate, Component, Independent, Judgement};

/// Follows a run frame by frame.
pub struct Judge<'a> {
    scene: &'a Scene,
    plan: &'a Plan,
    settings: &'a Settings,
    independent: Independent<'a>,
    /// The state before.
    time: f64,
    x: Vec<f64>,
    v: Vec<f64>,
    load: Load,
    /// Worst residual of what was called solved, as a fraction of what was asked for.
    pub worst: f64,
    /// Whether the last good state of a frame that failed has an inverted cell, where a law allows that. Nobody calls it solved.
    pub inverted: bool,
    /// What is wrong.
    pub mistakes: Vec<String>,
}

/// Carries a plan along a drive and judges all that comes of it.
pub fn judged_run<'a>(
    scene: &'a Scene,
    plan: &'a Plan,
    drive: &Drive,
    settings: &'a Settings,
) -> (Run, Judge<'a>) {
    let run = run(plan, drive, settings, None, &mut |_| {});
    let mut judge = Judge {
        scene,
        plan,
        settings,
        independent: Independent::new(scene, &plan.mesh),
        time: 0.0,
        x: plan.reference(),
        v: plan.inertia.as_ref().map_or(Vec::new(), |i| i.velocities.clone()),
        load: plan.load(&[], &[]).expect("nothing is named"),
        worst: 0.0,
        inverted: false,
        mistakes: Vec::new(),
    };
    for frame in &run.frames {
        judge.solved(frame);
    }
    if let Some(last) = &run.unsolved {
        judge.unsolved(last, &run.errors);
    }
    (run, judge)
}

impl Judge<'_> {
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
            self.check_island(&judgement, "solved", self.settings.tolerance, true);
            self.check_contact(&judgement, &frame.x);
        }
        self.time = frame.time;
        (self.x, self.v, self.load) = (frame.x.clone(), frame.v.clone(), frame.load.clone());
    }

    /// What is prescribed has to be where the load wants it, what follows beside its master.
    fn check_places(&mut self, x: &[f64], load: &Load) {
        let (mesh, scene, plan) = (&self.plan.mesh, self.scene, self.plan);
        let control =
            |name: &str| load.controls[plan.controls.iter().position(|c| c == name).expect("known")];
        let mut wanted = BTreeMap::<usize, f64>::new();
        for spec in &scene.prescribed {
            let factor = spec.control.as_ref().map_or(0.0, |c| control(c));
            for (i, &n) in mesh.node_sets[&spec.nodes].iter().enumerate() {
                let i = if spec.displacement.len() == 1 { 0 } else { i };
                for c in (0..3).filter(|c| spec.components[*c]) {
                    let u = spec.displacement.get(i).map_or(0.0, |u| u[c]);
                    wanted.insert(3 * n as usize + c, mesh.points[n as usize][c] + factor * u);
                }
            }
        }
        for spec in &scene.ties {
            let body = plan.bodies.iter().position(|b| *b == spec.body).expect("known");
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

    /// Residual \[N\] that was asked for.
    fn wanted(&self, judgement: &Judgement) -> f64 {
        self.settings.tolerance * judgement.scale.max(self.settings.least_force)
    }

    fn check_island(&mut self, judgement: &Judgement, what: &str, tolerance: f64, counts: bool) {
        let Judgement { residual, scale, least_det, .. } = judgement;
        let wanted = tolerance * scale.max(self.settings.least_force);
        let fraction = if *residual == 0.0 { 0.0 } else { residual / wanted };
        if counts {
            self.worst = self.worst.max(fraction);
        }
        if !(fraction <= 1.0) {
            self.mistakes.push(format!(
                "{what}, but the residual is {residual:.2e} N of {scale:.2e} N in play, {fraction:.2e} of what was asked"
            ));
        }
        if !(*least_det > 0.0) {
            match counts {
                true => self.mistakes.push(format!("{what}, but det F is {least_det:.2e}")),
                false => self.inverted = true,
            }
        }
    }

    /// What contact does between two surfaces that can move is known from the rest: forces and moments have to cancel, both to push, and
    /// nothing may happen from afar.
    fn check_contact(&mut self, judgement: &Judgement, x: &[f64]) {
        let Some(spec) = self.scene.contact.as_ref().filter(|_| !judgement.contact.is_empty()) else {
            return;
        };
        let mesh = &self.plan.mesh;
        let place = |n: u32| Vector3::from_column_slice(&x[3 * n as usize..3 * n as usize + 3]);
        let nodes =
            |name: &String| fem::mesh::unique_nodes(self.plan.mesh.surfaces[name].iter().flatten().copied());
        let [low, high] = [nodes(&spec.surfaces[0]), nodes(&spec.surfaces[1])];
        let sum = |of: &[u32]| of.iter().map(|n| Vector3::from(judgement.contact[n])).sum::<Vector3<f64>>();
        let (total, push) = (sum(&low) + sum(&high), sum(&high));
        let centre = place(high[0]);
        let all = low.iter().chain(&high);
        let turn = |n: &u32| (place(*n) - centre).cross(&Vector3::from(judgement.contact[n]));
        let moment: Vector3<f64> = all.clone().map(turn).sum();
        let extent = all.clone().map(|n| (place(*n) - centre).norm()).fold(0.0, f64::max);
        // What is left at each node is within what was asked for; so many of them add up to this at most.
        let bound = self.wanted(judgement) * ((low.len() + high.len()) as f64).sqrt() * 2.0;
        if !(total.norm() <= bound) {
            self.mistakes
                .push(format!("contact forces differ by {:.2e} N, {bound:.2e} N would do", total.norm()));
        }
        if !(moment.norm() <= 2.0 * bound * extent) {
            self.mistakes.push(format!(
                "contact turns by {:.2e} N m, {:.2e} N m would do",
                moment.norm(),
                bound * extent
            ));
        }
        if !(push.z >= -bound) {
            self.mistakes.push(format!("contact pulls with {:.2e} N", -push.z));
        }
        let edges = |name: &String| {
            let faces = mesh.surfaces[name].iter();
            let edge = |f: &[u32; 4]| {
                (0..4).map(|k| (place(f[k]) - place(f[(k + 1) % 4])).norm()).fold(0.0, f64::max)
            };
            faces.map(edge).fold(0.0, f64::max)
        };
        let far = low.iter().flat_map(|a| high.iter().map(|b| (place(*a) - place(*b)).norm()));
        let gap = far.fold(f64::INFINITY, f64::min) - edges(&spec.surfaces[0]) - edges(&spec.surfaces[1]);
        let pushes = judgement.contact.values().flatten().map(|f| f * f).sum::<f64>().sqrt();
        if gap > spec.distance && !(pushes <= bound) {
            self.mistakes.push(format!("contact pushes with {pushes:.2e} N from {gap:.2e} m"));
        }
    }

    /// A frame that was not solved holds the last good state of each island: equilibrium at the load that its error names.
    fn unsolved(&mut self, frame: &Frame, errors: &[SolveError]) {
        if !frame.x.iter().chain(&frame.v).all(|v| v.is_finite()) {
            self.mistakes.push("a frame that was not solved holds values that are not finite".to_string());
            return;
        }
        // Which of several islands failed their errors do not say; what touches or flies stops on the way, near equilibrium only.
        if self.scene.contact.is_some() || self.scene.inertia.is_some() || self.plan.islands.len() != 1 {
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
        let tolerance = self.settings.tolerance;
        for judgement in self.judgements(&frame.x, &controls, frame.time) {
            let what = format!("the last good state, load {load:.3}");
            self.check_island(&judgement, &what, tolerance, false);
        }
    }
}
