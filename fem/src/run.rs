//! The frame loop: a plan carried along a drive.

use crate::explicit::{Dynamics, Moving, Relaxation};
use crate::measure::{Sides, Snapshot, prescribed_overlaps};
use crate::plan::{ContactPlan, Island, Load, LoadedIsland, Plan, Watch};
use crate::solve::{
    Admissible, Advance, Iteration, Loading, Method, Settings, SolveError, Solver, Stability, Way,
};
use rayon::prelude::*;
use std::ops::ControlFlow;

/// Loads in time; the way to the first starts at the mesh as read, with all controls at zero and bodies in place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drive {
    /// Frames, in the order of time.
    pub frames: Vec<DriveFrame>,
}

/// One frame of a drive.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveFrame {
    /// Time \[s\], or a pseudo-time.
    pub time: f64,
    /// Controls and poses at that time; see [`Plan::load`].
    pub load: Load,
}

impl Drive {
    /// A single frame.
    pub fn once(load: Load) -> Drive {
        Drive { frames: vec![DriveFrame { time: 1.0, load }] }
    }
}

/// Equilibrium at one frame (with inertia: where it takes the nodes by then), or the last good state before it.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    /// Time \[s\] as in the drive.
    pub time: f64,
    /// The load of the drive.
    pub load: Load,
    /// Positions of all nodes \[m\], 3 per node. Where an island failed its nodes are at its last good state.
    pub x: Vec<f64>,
    /// Velocities of all nodes \[m/s\], 3 per node; empty without inertia. Those of the frame before where one was not solved.
    pub v: Vec<f64>,
    /// What the solver did, per island.
    pub islands: Vec<Advance>,
    /// Surfaces whose prescribed faces intersect under the load, with the number of pairs of triangles ([`prescribed_overlaps`]): no
    /// solver can keep them apart.
    pub prescribed_overlaps: Vec<([String; 2], usize)>,
}

impl Frame {
    /// What measures look at.
    pub fn snapshot(&self) -> Snapshot<'_> {
        Snapshot { x: &self.x, load: &self.load }
    }

    /// The island that is least settled: its number and how it came to equilibrium; `None` where no forces are in play.
    pub fn worst(&self) -> Option<(usize, &Advance)> {
        let islands = self.islands.iter().enumerate().filter(|(_, advance)| advance.force_scale > 0.0);
        islands.max_by(|a, b| a.1.relative_residual().total_cmp(&b.1.relative_residual()))
    }

    /// Sum of a count over all islands.
    pub fn count(&self, of: impl Fn(&Advance) -> usize) -> usize {
        self.islands.iter().map(of).sum()
    }

    /// Whether all equilibria were tested for stability and are minima of the potential.
    pub fn is_tested_stable(&self) -> bool {
        self.islands.iter().all(|island| island.tested_stable)
    }
}

/// All frames, and how the run ended.
#[derive(Debug, Default)]
pub struct Run {
    /// Solved frames.
    pub frames: Vec<Frame>,
    /// The frame that was not solved, at its last good state.
    pub unsolved: Option<Frame>,
    /// Why it was not solved, per island; empty: the run is solved.
    pub errors: Vec<SolveError>,
    /// A row per Newton iteration.
    pub iterations: Vec<Iteration>,
    /// Frames that were not computed but taken over from an earlier run ([`crate::restart`]).
    pub taken_over: usize,
}

impl Run {
    /// Adds what a step came to; returns whether it was solved, without which the run is over.
    pub(crate) fn take(&mut self, done: Advanced) -> bool {
        let Advanced { frame, errors, iterations } = done;
        self.iterations.extend(iterations);
        self.errors = errors;
        match self.is_solved() {
            true => self.frames.push(frame),
            false => self.unsolved = Some(frame),
        }
        self.is_solved()
    }

    /// Whether every frame is in equilibrium.
    pub fn is_solved(&self) -> bool {
        self.errors.is_empty()
    }

    /// The last solved frame.
    pub fn last(&self) -> Option<&Frame> {
        self.frames.last()
    }

    /// Where the residual is the largest fraction of the forces in play, of all solved frames; none where nothing could move.
    pub fn worst(&self) -> Option<Worst<'_>> {
        let of = |(frame, f): (usize, &'_ Frame)| f.worst().map(|(island, _)| (frame, island));
        let places = self.frames.iter().enumerate().filter_map(of);
        let worst = places.map(|(frame, island)| Worst {
            frame,
            island,
            advance: &self.frames[frame].islands[island],
        });
        worst.max_by(|a, b| a.advance.relative_residual().total_cmp(&b.advance.relative_residual()))
    }

    /// Solved frames all of whose equilibria were tested for stability and are minima of the potential.
    pub fn frames_tested_for_stability(&self) -> usize {
        self.frames.iter().filter(|frame| frame.is_tested_stable()).count()
    }

    /// Sum of a count over all islands of all solved frames.
    pub fn count(&self, of: impl Fn(&Advance) -> usize) -> usize {
        self.frames.iter().map(|frame| frame.count(&of)).sum()
    }
}

/// An island of a frame, by their numbers, and how it came to equilibrium.
#[derive(Clone, Copy, Debug)]
pub struct Worst<'a> {
    /// The frame.
    pub frame: usize,
    /// The island, as in [`Plan::islands`].
    pub island: usize,
    /// What the solver did there.
    pub advance: &'a Advance,
}

/// A frame as the solver leaves it.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// Equilibrium, or the last good state where there are errors.
    pub frame: &'a Frame,
    /// Newton iterations that led there.
    pub iterations: &'a [Iteration],
    /// Why there is no equilibrium, per island; empty: there is.
    pub errors: &'a [SolveError],
}

/// A plan on its way: where its nodes are, under which load, and the solvers with what they keep.
pub struct Session<'a> {
    plan: &'a Plan,
    x: Vec<f64>,
    /// Velocities \[m/s\]; empty without inertia.
    v: Vec<f64>,
    /// Time that belongs to them \[s\].
    time: f64,
    from: Load,
    settings: Settings,
    solvers: Vec<Solver>,
    /// Who is on which side of whom; absent where nothing can touch, and in time, where bodies fly past each other.
    sides: Option<Sides>,
    step: usize,
}

/// Where a session came to under a load.
#[derive(Debug)]
pub struct Advanced {
    /// Equilibrium, or the last good state where there are errors.
    pub frame: Frame,
    /// Why there is no equilibrium, per island; empty: there is.
    pub errors: Vec<SolveError>,
    /// A row per Newton iteration.
    pub iterations: Vec<Iteration>,
}

impl<'a> Session<'a> {
    /// Starts at the mesh as read, or at positions `start` \[m\] of all nodes, with all controls at zero and bodies in place.
    /// Refuses settings that cannot be and a start that is not of this plan.
    pub fn new(
        plan: &'a Plan,
        settings: &Settings,
        start: Option<&[f64]>,
    ) -> Result<Session<'a>, SolveError> {
        settings.check()?;
        let mistakes = unsuited(plan, settings);
        if !mistakes.is_empty() {
            return Err(SolveError::Settings { mistakes });
        }
        let x = start.map_or_else(|| plan.reference(), <[f64]>::to_vec);
        count("the start", x.len(), 3 * plan.mesh.points.len(), "3 per node of the mesh")?;
        Ok(Session {
            plan,
            x,
            v: plan.inertia.as_ref().map_or(Vec::new(), |i| i.velocities.clone()),
            time: 0.0,
            from: plan.load(&[], &[]).expect("nothing is named"),
            settings: *settings,
            solvers: plan.islands.iter().map(|i| Solver::new(&i.name, *settings)).collect(),
            sides: if plan.inertia.is_none() { Sides::new(plan) } else { None },
            step: 0,
        })
    }

    /// Starts at a solved frame, the `step`-th of its run, with new solvers: what they do does not depend on how the frame was reached.
    pub fn from_frame(
        plan: &'a Plan,
        settings: &Settings,
        frame: &Frame,
        step: usize,
    ) -> Result<Session<'a>, SolveError> {
        let wrong = |source| SolveError::Load { step, source: Box::new(source) };
        plan.check_load(&frame.load).map_err(wrong)?;
        let (from, time) = (frame.load.clone(), frame.time);
        // A frame without velocities is at rest.
        let mut v = frame.v.clone();
        v.resize(plan.inertia.as_ref().map_or(0, |i| i.velocities.len()), 0.0);
        Ok(Session { from, v, time, step: step + 1, ..Session::new(plan, settings, Some(&frame.x))? })
    }

    /// Goes from where it is to the equilibrium under `to.load`, or with inertia to where that takes it by `to.time`. Where that fails the
    /// session stays at the last good state of each island and should not be used further.
    pub fn advance(&mut self, to: &DriveFrame) -> Advanced {
        self.advance_along(to, &[])
    }

    /// The same with a guess of the way there, displacements \[m\] of all nodes, `None` where nothing is known: a good one, such as that of
    /// a [coarser mesh](crate::mesh::Prolongation), saves iterations, a bad one costs some. The equilibrium is as exact as any.
    pub fn advance_along(&mut self, to: &DriveFrame, way: &[Option<[f64; 3]>]) -> Advanced {
        let step = self.step;
        let h = to.time - self.time;
        let inertia = self.plan.inertia.as_ref();
        let refused = match self.plan.check_load(&to.load) {
            Err(source) => Some(SolveError::Load { step, source: Box::new(source) }),
            Ok(()) if inertia.is_some() && !(h > 0.0 && h.is_finite()) => {
                Some(SolveError::NoTime { step, from: self.time, to: to.time })
            }
            Ok(()) if !way.is_empty() => {
                count("guess of the way", way.len(), self.plan.mesh.points.len(), "one displacement per node")
                    .err()
            }
            Ok(()) => None,
        };
        if let Some(error) = refused {
            let (load, x, v) = (self.from.clone(), self.x.clone(), self.v.clone());
            let frame = Frame { time: to.time, load, x, v, ..Frame::default() };
            return Advanced { frame, errors: vec![error], iterations: Vec::new() };
        }
        let before = self.x.clone();
        let mut solvers = std::mem::take(&mut self.solvers);
        let mut solved = self.solve(to, way, &mut solvers);
        self.solvers = solvers;
        let refused = self.look_at_sides(to, &mut solved);
        let velocities: Vec<Vec<f64>> = solved.iter_mut().map(|s| std::mem::take(&mut s.v)).collect();
        let (mut islands, mut errors, mut iterations) = (Vec::new(), Vec::new(), Vec::new());
        self.x = self.places(to, &solved);
        for Solved { result, rows, .. } in solved {
            iterations.extend(rows);
            match result {
                Ok(advance) => islands.push(advance),
                Err(error) => errors.push(error),
            }
        }
        if let Some(error) = refused {
            // Nothing of the frame is good.
            self.x = before.clone();
            errors.push(error);
        }
        let prescribed_overlaps = prescribed_overlaps(self.plan, &to.load);
        if !errors.is_empty() && !prescribed_overlaps.is_empty() {
            errors.push(SolveError::NoRoom { step, pairs: prescribed_overlaps.clone() });
        }
        if inertia.is_some() && errors.is_empty() {
            self.v = self.x.iter().zip(&before).map(|(x, before)| (x - before) / h).collect();
            for (island, own) in self.plan.islands.iter().zip(&velocities) {
                for (&n, own) in island.nodes.iter().zip(own.as_chunks::<3>().0) {
                    self.v[3 * n as usize..3 * n as usize + 3].copy_from_slice(own);
                }
            }
        }
        self.from = to.load.clone();
        self.time = to.time;
        self.step += 1;
        let frame = Frame {
            time: to.time,
            load: to.load.clone(),
            x: self.x.clone(),
            v: self.v.clone(),
            islands,
            prescribed_overlaps,
        };
        Advanced { frame, errors, iterations }
    }

    /// Solves every island, all from where the session is.
    fn solve(&self, to: &DriveFrame, way: &[Option<[f64; 3]>], solvers: &mut [Solver]) -> Vec<Solved> {
        let (x, from, step) = (&self.x, &self.from, self.step);
        let inertia = self.plan.inertia.as_ref();
        let jobs: Vec<_> = self.plan.islands.iter().zip(solvers).collect();
        jobs.into_par_iter()
            .with_max_len(1)
            .map(|(island, solver)| {
                let local = island.gather(x);
                if let Some((det_f, place)) = island.folded(&to.load) {
                    let island = island.name.clone();
                    let folded = SolveError::Folded { island, step, place, det_f };
                    return Solved { local, v: Vec::new(), result: Err(folded), rows: Vec::new() };
                }
                let mut free = island.free_positions(&local);
                let mut potential = LoadedIsland::new(island.clone(), from.clone(), to.load.clone());
                let onlooker = self.sides.as_ref().and_then(|sides| {
                    let pairs = sides.pairs_of(self.plan, &island.nodes);
                    (!pairs.is_empty()).then_some(Onlooker { sides, pairs, plan: self.plan, island, x, step })
                });
                if let Some(onlooker) = &onlooker {
                    potential = potential.watched_by(onlooker);
                }
                if !way.is_empty() && self.settings.way == Way::Guided {
                    let own: Vec<_> = island.nodes.iter().map(|&n| way[n as usize]).collect();
                    potential = potential.led_by(&own, &free);
                }
                let h = to.time - self.time;
                if let (Method::Explicit, Some(inertia), false) =
                    (self.settings.method, inertia, free.is_empty())
                {
                    return self.moved(potential, free, (&inertia.masses, h));
                }
                if let Some(inertia) = inertia {
                    potential = potential.with(inertia.over(h, island, &local, &island.gather(&self.v)));
                }
                let mut rows = Vec::new();
                let result = match free.is_empty() {
                    true => {
                        potential.set_load(1.0, &mut free);
                        let least_det_f = potential.least_det_f(&free).0;
                        // What nothing can move is at its minimum.
                        Ok(Advance { least_det_f, tested_stable: true, ..Advance::default() })
                    }
                    false => match self.settings.method {
                        Method::Newton | Method::Explicit => {
                            solver.advance(&mut potential, &mut free, step, &mut rows)
                        }
                        Method::Relaxation => Relaxation::new(&island.name, self.settings).advance(
                            &mut potential,
                            &mut free,
                            step,
                            &mut rows,
                        ),
                    },
                };
                Solved { local: potential.expand(&free), v: Vec::new(), result, rows }
            })
            .collect()
    }

    /// Moves an island over the time `h` \[s\]; `masses` \[kg\] of all nodes of the mesh.
    fn moved(&self, mut potential: LoadedIsland, mut free: Vec<f64>, (masses, h): (&[f64], f64)) -> Solved {
        let island = potential.island().clone();
        let v = island.free_positions(&island.gather(&self.v));
        let mut moving = Moving { masses: island.lumped(masses), v, duration: h };
        let mut rows = Vec::new();
        let mut dynamics = Dynamics::new(&island.name, self.settings);
        let result = dynamics.advance(&mut potential, &mut free, &mut moving, self.step, &mut rows);
        let local = potential.expand(&free);
        // What is prescribed and what follows moves as it does just before the end.
        let mut before: Vec<f64> = free.iter().zip(&moving.v).map(|(x, v)| x - JUST * h * v).collect();
        potential.set_load(1.0 - JUST, &mut before);
        let just = potential.expand(&before);
        let mut v: Vec<f64> = local.iter().zip(&just).map(|(x, before)| (x - before) / (JUST * h)).collect();
        island.put_velocities(&moving.v, &mut v);
        Solved { local, v, result, rows }
    }

    /// Positions of all nodes with those of the islands.
    fn places(&self, to: &DriveFrame, solved: &[Solved]) -> Vec<f64> {
        let mut x = self.x.clone();
        if solved.iter().all(|s| s.result.is_ok()) {
            self.plan.prescribe_idle(&to.load, &mut x);
        }
        for (island, Solved { local, .. }) in self.plan.islands.iter().zip(solved) {
            scatter(island, local, &mut x);
        }
        x
    }

    /// Looks whether bodies have gone through each other on the straight way from frame to frame. In the cheap mode, where nothing else
    /// keeps them from it, the frame is refused then; in guarded contact no guess that was taken led them through.
    fn look_at_sides(&self, to: &DriveFrame, solved: &mut [Solved]) -> Option<SolveError> {
        let sides = self.sides.as_ref().filter(|_| solved.iter().all(|s| s.result.is_ok()))?;
        let pairs = sides.changed(&self.x, &self.places(to, solved));
        if let Some(Ok(first)) = solved.first_mut().map(|s| &mut s.result) {
            first.crossed_pairs = pairs.len();
        }
        let is_cheap = self.plan.contact().is_some_and(ContactPlan::is_cheap);
        (is_cheap && !pairs.is_empty()).then_some(SolveError::WentThrough { step: self.step, pairs })
    }
}

/// A look at who is on which side of what one island moves.
struct Onlooker<'a> {
    sides: &'a Sides,
    pairs: Vec<[usize; 2]>,
    plan: &'a Plan,
    island: &'a Island,
    /// Positions \[m\] of all nodes before.
    x: &'a [f64],
    step: usize,
}

impl Watch for Onlooker<'_> {
    fn places(&self, load: &Load, local: &[f64]) -> Vec<f64> {
        let mut x = self.x.to_vec();
        // What is prescribed may belong to another island, or to none.
        let nodes = self.plan.motion.iter().zip(&self.plan.mesh.points).zip(x.as_chunks_mut::<3>().0);
        nodes.for_each(|((motion, rest), x)| load.prescribe(motion, rest, x));
        scatter(self.island, local, &mut x);
        x
    }

    fn keeps_sides(&self, from: &[f64], to: &[f64]) -> bool {
        let pairs = self.sides.changed_of(&self.pairs, from, to);
        if !pairs.is_empty() {
            tracing::info!(island = %self.island.name, step = self.step, ?pairs, "softened contact leads through");
        }
        pairs.is_empty()
    }
}

/// Writes positions \[m\] of the nodes of an island to those of all nodes.
fn scatter(island: &Island, local: &[f64], x: &mut [f64]) {
    for (&n, p) in island.nodes.iter().zip(local.chunks_exact(3)) {
        x[3 * n as usize..3 * n as usize + 3].copy_from_slice(p);
    }
}

/// An island as its solver leaves it.
struct Solved {
    /// Positions of its nodes \[m\].
    local: Vec<f64>,
    /// Their velocities \[m/s\]; empty where they follow from the positions.
    v: Vec<f64>,
    result: Result<Advance, SolveError>,
    rows: Vec<Iteration>,
}

/// The last fraction of a frame, over which velocities of what is prescribed are taken.
const JUST: f64 = 1e-6;

/// What a plan has, or the settings ask for, that the chosen solver cannot do, or lacks.
pub fn unsuited(plan: &Plan, settings: &Settings) -> Vec<String> {
    let mut mistakes = Vec::new();
    if settings.method != Method::Newton && !plan.free_bodies.is_empty() {
        mistakes.push("method: bodies whose poses are unknowns need `newton`".to_string());
    }
    if settings.method != Method::Newton && !plan.embedded.is_empty() {
        // What a grid node outside its body weighs can be negative.
        mistakes.push("method: regions embedded in grids need `newton`".to_string());
    }
    if settings.method != Method::Newton && settings.stability == Stability::Always {
        mistakes.push("check_stability: only `newton` can show that a state is stable".to_string());
    }
    if settings.method == Method::Explicit && plan.inertia.is_none() {
        mistakes.push(
            "method: `explicit` moves masses, and the scene has no `inertia`; add it, or take `relaxation`, which finds rest without"
                .to_string(),
        );
    }
    mistakes
}

fn count(what: &'static str, found: usize, needed: usize, of: &str) -> Result<(), SolveError> {
    match found == needed {
        true => Ok(()),
        false => Err(SolveError::Count { what, found, needed: format!("{needed}: {of}") }),
    }
}

/// Carries a plan along a drive, from the mesh as read or from positions `start` \[m\] of all nodes; stops at the
/// first frame that is not solved. `on_frame` sees every solved frame as it comes.
pub fn run(
    plan: &Plan,
    drive: &Drive,
    settings: &Settings,
    start: Option<&[f64]>,
    on_frame: &mut dyn FnMut(&Frame),
) -> Run {
    run_steps(plan, drive, settings, start, &mut |step| {
        if step.errors.is_empty() {
            on_frame(step.frame);
        }
        ControlFlow::Continue(())
    })
}

/// [`run`] whose every step, the one that fails included, is shown to `on_step`; a `Break` ends the run after it.
pub fn run_steps(
    plan: &Plan,
    drive: &Drive,
    settings: &Settings,
    start: Option<&[f64]>,
    on_step: &mut dyn FnMut(&Step) -> ControlFlow<()>,
) -> Run {
    let mut out = Run::default();
    let mut session = match Session::new(plan, settings, start) {
        Ok(session) => session,
        Err(error) => return Run { errors: vec![error], ..out },
    };
    for to in &drive.frames {
        let done = session.advance(to);
        let flow = on_step(&Step { frame: &done.frame, iterations: &done.iterations, errors: &done.errors });
        if !out.take(done) || flow.is_break() {
            return out;
        }
    }
    out
}
