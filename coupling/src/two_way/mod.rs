//! Two-way coupling: the deformable muscles tell force sharing what they can do, force sharing tells them how hard to pull, until what
//! they can do no longer changes.
//!
//! Per step and muscle the capacity is: its lever arms, which all its lines then have, the length of its fibres, the force of its matrix
//! and shell, and how much of the tension of its fibres comes through the belly. Heads that are sewn together have their lever arm at the
//! knee in common ([`as_units`]): how hard each pulls is left to force sharing. From these follow the bounds of its tension (no less than its passive force, no more than at full activation
//! at that length) and the isometric activation that makes a tension. Agreement of the two models is a result, never the stopping rule.

#![allow(non_snake_case)]

pub mod capacity;
pub mod fixed_point;
mod tables;

use fem::plan::Plan;
use fem::run::{Advanced, Drive, DriveFrame, Frame, Session};
use fem::solve::{Iteration, Settings};
use multibody::loads::Loads;
use multibody::model::Model;
use multibody::share::{SharingSettings, names, problem};
use multibody::sharing::{Capacity, SharingProblem, SharingSolver};
use multibody::trial::Status;
use nalgebra::{DMatrix, DVector};

pub use tables::{write_capacities, write_missing, write_passes};

use crate::error::CouplingError;
use crate::fibres::muscle_unit::{Fit, MuscleUnit};
use crate::optimize::Optimized;
use crate::steps::{RigidMuscle, RigidStep};
use crate::thigh::build::Thigh;
use crate::thigh::registration::Registration;
use crate::two_way::capacity::{MOVED, MuscleAction, MuscleCapacity, VirtualTwists, actions, as_units};
use crate::two_way::fixed_point::{FixedPoint, Scheme};

/// Relative change of the capacity at which the passes end.
pub const TOLERANCE: f64 = 1e-3;
/// Passes at most.
pub const MOST_PASSES: usize = 16;
/// The coordinate at which sewn muscles are one unit; at the hip each pulls at the pelvis by itself.
pub const KNEE: usize = 3;
/// Numbers of a muscle at a step.
const N: usize = MuscleCapacity::N;
/// Tensions below this \[N\] say nothing about the fraction that comes through the belly.
const LEAST_TENSION: f64 = 20.0;

/// What stays the same from pass to pass.
pub struct TwoWay<'a> {
    /// The rigid leg.
    pub done: &'a Optimized,
    /// Its place in the mesh.
    pub registration: &'a Registration,
    /// The steps as one-way coupling has them.
    pub steps: &'a [RigidStep],
    /// The thigh with Hill fibres.
    pub thigh: &'a Thigh,
    /// Without or with contact.
    pub plan: &'a Plan,
    /// Muscles that are sewn together ([`sewn`](capacity::sewn)).
    pub sewn: &'a [Vec<usize>],
    /// The drive of the one-way run.
    pub drive: &'a Drive,
    /// Units and fits of its muscles, and the scale of [`MuscleUnit::law`].
    pub units: &'a [MuscleUnit],
    /// Their fits.
    pub fits: &'a [Fit],
    /// See [`MuscleUnit::law`].
    pub scale: f64,
    /// Of the deformable side.
    pub settings: &'a Settings,
}

/// One pass.
#[derive(Clone, Debug, PartialEq)]
pub struct Pass {
    /// Change of the capacity relative to its size: of what the thigh says over what it was asked with. `None` in the first pass.
    pub change: Option<f64>,
    /// What changed most: step, muscle and quantity.
    pub changed_most: Option<String>,
    /// Joint moments \[N·m\] per step, hip (three) and knee, that are missing when the forces of the thigh replace those of the rigid leg.
    pub missing: Vec<[f64; MOVED]>,
    /// The same per muscle: what force sharing counts on less what the muscle of the thigh does. Their sum is `missing`.
    pub lacking: Vec<Vec<[f64; MOVED]>>,
    /// Tensions per step and muscle as force sharing wants them \[N\].
    pub wanted: Vec<Vec<f64>>,
    /// Forces through the bellies per step and muscle \[N\].
    pub found: Vec<Vec<f64>>,
}

impl Pass {
    /// Largest missing moment \[N·m\].
    pub fn largest_missing(&self) -> f64 {
        self.missing.iter().flatten().fold(0.0, |m, v| m.max(v.abs()))
    }
}

/// What the passes came to.
#[derive(Clone, Debug, Default)]
pub struct Coupling {
    /// All passes that were carried out; the first is the one-way result.
    pub passes: Vec<Pass>,
    /// The last pass, per step; empty where there is none but the first.
    pub last: Vec<Coupled>,
    /// What the thigh shows in the last pass, per step and muscle; empty where there is none but the first.
    pub capacities: Vec<Vec<MuscleCapacity>>,
    /// Least and greatest tensions that follow from it \[N\].
    pub bounds: Vec<Vec<[f64; 2]>>,
    /// Why the last pass is no settled result; empty where it is.
    pub shortcomings: Vec<String>,
}

/// One step in the last pass.
#[derive(Clone, Debug)]
pub struct Coupled {
    /// Tensions of all lines of the leg as force sharing wants them \[N\].
    pub tensions: DVector<f64>,
    /// Isometric activation of every muscle of the thigh.
    pub drives: Vec<f64>,
    /// The thigh under them.
    pub frame: Frame,
    /// A row per Newton iteration that led there from the pass before.
    pub iterations: Vec<Iteration>,
}

/// What force sharing says of a step.
struct Shared {
    /// Tensions of all lines \[N\].
    f: DVector<f64>,
    /// Joint moments of the muscles of the thigh, with the lever arms that it has of them \[N·m\].
    counted: Vec<[f64; MOVED]>,
    /// What no forces within their bounds carry.
    infeasible: Option<String>,
}

impl TwoWay<'_> {
    /// Passes from the one-way result (`first`: its frames at the steps) until the capacity stays the same, at most `most`. A pass that
    /// finds no equilibrium or no forces ends them: the last whole one stands, and a shortcoming says why.
    pub fn passes(&self, first: &[&Frame], scheme: Scheme, most: usize) -> Result<Coupling, CouplingError> {
        let twists: Vec<VirtualTwists> =
            self.steps.iter().map(|s| self.twists(s)).collect::<Result<_, _>>()?;
        let rigid = self.nominal()?;
        let see = |frame: &Frame, k: usize| {
            let mut seen = actions(self.plan, self.thigh, frame.snapshot(), &twists[k]);
            let arm = |m: usize| self.capacity_in(&rigid, k, m).lever_arms[KNEE];
            as_units(&mut seen, self.sewn, KNEE, &arm);
            seen
        };
        let seen: Vec<Vec<MuscleAction>> = first.iter().enumerate().map(|(k, f)| see(f, k)).collect();
        let shared: Vec<Shared> = self.steps.iter().map(|s| self.one_way(s)).collect::<Result<_, _>>()?;
        let passes = vec![self.pass(None, &shared, &seen)?];
        let mut coupling = Coupling { passes, ..Coupling::default() };
        if most < 2 {
            coupling.shortcomings.push("two-way coupling: one pass is the one-way result".into());
            return Ok(coupling);
        }
        let mut fixed_point = FixedPoint::new(scheme);
        let drives: Vec<Vec<f64>> = (0..self.steps.len()).map(|k| self.drives(self.at_step(k))).collect();
        let (mut x, mut shown) = self.capacity(&seen, &rigid, &drives);
        let mut ever = shown.clone();
        // From the result of the pass before, by solvers of their own: a pass hangs on that state alone.
        let mut at: Vec<Frame> = first.iter().map(|frame| (*frame).clone()).collect();
        while coupling.passes.len() < most {
            let carried: Result<Vec<(Shared, Coupled)>, CouplingError> = (self.steps.iter().enumerate())
                .map(|(k, step)| {
                    let sharing = self.share(step, &x, k)?;
                    let frame = self.frame(&sharing.f, &x, k)?;
                    let Advanced { frame: solved, iterations, .. } =
                        advance(self.plan, self.settings, &at[k], &frame)?;
                    let (tensions, drives) = (sharing.f.clone(), self.drives(&frame));
                    Ok((sharing, Coupled { tensions, drives, frame: solved, iterations }))
                })
                .collect();
            let pass = coupling.passes.len() + 1;
            let (shared, last): (Vec<_>, Vec<_>) = match carried {
                Ok(carried) => carried.into_iter().unzip(),
                Err(why) => {
                    let text = format!("two-way coupling ends in pass {pass}, before it has settled: {why}");
                    coupling.shortcomings.push(text);
                    return Ok(coupling);
                }
            };
            let seen: Vec<Vec<MuscleAction>> =
                last.iter().enumerate().map(|(k, c)| see(&c.frame, k)).collect();
            let drives: Vec<Vec<f64>> = last.iter().map(|c| c.drives.clone()).collect();
            let (image, shows) = self.capacity(&seen, &x, &drives);
            let change = (&image - &x).norm() / image.norm();
            let mut pass = self.pass(Some(change), &shared, &seen)?;
            pass.changed_most = Some(self.name_of((&image - &x).iamax()));
            coupling.passes.push(pass);
            at = last.iter().map(|c| c.frame.clone()).collect();
            coupling.last = last;
            coupling.capacities = (0..self.steps.len()).map(|k| self.capacities_in(&image, k)).collect();
            let bounds =
                |of: &Vec<MuscleCapacity>| of.iter().zip(self.units).map(|(c, u)| c.bounds(u)).collect();
            coupling.bounds = coupling.capacities.iter().map(bounds).collect();
            coupling.shortcomings = shared.into_iter().filter_map(|s| s.infeasible).collect();
            if change < TOLERANCE {
                return Ok(coupling);
            }
            // With other muscles at work it is another problem, of which the history knows nothing.
            if shows != shown {
                fixed_point = FixedPoint::new(scheme);
            }
            x = fixed_point.next(&x, &image);
            for i in (0..x.len()).filter(|&i| shows[i] && !std::mem::replace(&mut ever[i], true)) {
                x[i] = image[i]; // seen for the first time: there is nothing to relax from
            }
            shown = shows;
        }
        let change = coupling.passes.last().and_then(|p| p.change).unwrap_or(f64::NAN);
        coupling.shortcomings.push(format!(
            "two-way coupling has not settled: the capacity still changes by {change:.1e} in pass {most} (wanted {TOLERANCE:.0e}); \
             forces are those of that pass"
        ));
        Ok(coupling)
    }

    fn twists(&self, step: &RigidStep) -> Result<VirtualTwists, CouplingError> {
        let Q = &self.done.motion.Q[self.done.motion.report.start + step.row];
        let reduced = self.done.loads.reduced[step.row].as_ref().ok_or_else(|| no_loads(step))?;
        Ok(VirtualTwists::new(&self.done.model, self.registration, Q, &reduced.tangent))
    }

    /// Force sharing of the rigid leg at a step.
    fn one_way(&self, step: &RigidStep) -> Result<Shared, CouplingError> {
        let reduced = self.done.loads.reduced[step.row].as_ref().ok_or_else(|| no_loads(step))?;
        Ok(self.shared(self.done.effort.forces.values.row(step.row).transpose(), &reduced.lever_arms))
    }

    /// Tensions `f` of all lines with lever arms `R`.
    fn shared(&self, f: DVector<f64>, R: &DMatrix<f64>) -> Shared {
        let of_muscle = |m: usize| {
            let lines = self.lines(m);
            std::array::from_fn(|c| lines.iter().map(|&i| R[(c, i)] * f[i]).sum())
        };
        let counted = (0..self.thigh.muscles.len()).map(of_muscle).collect();
        Shared { f, counted, infeasible: None }
    }

    /// Numbers of the model's lines that belong to a muscle of the thigh.
    fn lines(&self, muscle: usize) -> Vec<usize> {
        let name = &self.thigh.muscles[muscle].name;
        let lines = self.steps[0].muscle(name).map_or(&[][..], |m| &m.lines);
        let number =
            |l: &crate::steps::RigidLine| self.done.model.muscles.iter().position(|m| m.name == l.name);
        lines.iter().filter_map(number).collect()
    }

    /// Where the capacity of a muscle at a step begins among the numbers of all.
    fn at(&self, step: usize, muscle: usize) -> usize {
        N * (step * self.thigh.muscles.len() + muscle)
    }

    fn capacity_in(&self, x: &DVector<f64>, step: usize, muscle: usize) -> MuscleCapacity {
        MuscleCapacity::of_scaled(&x.as_slice()[self.at(step, muscle)..][..N])
    }

    /// Those of all muscles.
    fn capacities_in(&self, x: &DVector<f64>, step: usize) -> Vec<MuscleCapacity> {
        (0..self.thigh.muscles.len()).map(|m| self.capacity_in(x, step, m)).collect()
    }

    /// The frame of a step in the one-way drive.
    fn at_step(&self, k: usize) -> &DriveFrame {
        &self.drive.frames[self.drive.frames.len() - self.steps.len() + k]
    }

    /// Control of the fibres of a muscle.
    fn control(&self, muscle: &str) -> usize {
        let control = self.plan.controls.iter().position(|c| c == muscle);
        control.expect("the fibres of a muscle have its name for a control")
    }

    /// Isometric activations of all muscles in a frame.
    fn drives(&self, frame: &DriveFrame) -> Vec<f64> {
        self.thigh.muscles.iter().map(|m| frame.load.controls[self.control(&m.name)]).collect()
    }

    /// Change of length of the lines of a muscle against the posture of the mesh \[m\] at a stretch of its fibres.
    fn shift(&self, muscle: usize, stretch: f64) -> f64 {
        (stretch - self.fits[muscle].rest) * self.thigh.muscles[muscle].fibre_length / self.scale
    }

    /// The capacity that was seen, scaled, all steps and muscles one after the other. Of muscles with hardly any force lever arms, length
    /// and fraction stay as in `before`: a slack one hangs as it may, and not where it would pull. Second: which numbers were seen.
    fn capacity(
        &self,
        seen: &[Vec<MuscleAction>],
        before: &DVector<f64>,
        drives: &[Vec<f64>],
    ) -> (DVector<f64>, Vec<bool>) {
        let (mut x, mut seen_now) = (before.clone(), vec![false; before.len()]);
        for k in 0..self.steps.len() {
            for (m, action) in seen[k].iter().enumerate() {
                let shift = self.shift(m, action.stretch);
                let (now, says) = seen_capacity(action, &self.units[m], shift, drives[k][m]);
                let at = self.at(k, m);
                for (i, (value, says)) in now.scaled().into_iter().zip(says).enumerate() {
                    if says {
                        (x[at + i], seen_now[at + i]) = (value, true);
                    }
                }
            }
        }
        (x, seen_now)
    }

    /// Capacity before anything is seen: lengths of the lines, and of their lever arms the mean, each with its strength.
    fn nominal(&self) -> Result<DVector<f64>, CouplingError> {
        let mut x = DVector::zeros(N * self.thigh.muscles.len() * self.steps.len());
        for (k, step) in self.steps.iter().enumerate() {
            let reduced = self.done.loads.reduced[step.row].as_ref().ok_or_else(|| no_loads(step))?;
            for m in 0..self.thigh.muscles.len() {
                let (lines, unit) = (self.lines(m), &self.units[m]);
                let rigid = step.muscle(&self.thigh.muscles[m].name);
                let nominal = nominal_capacity(&self.done.model, &reduced.lever_arms, unit, &lines, rigid);
                x.rows_mut(self.at(k, m), N).copy_from_slice(&nominal.scaled());
            }
        }
        Ok(x)
    }

    /// Force sharing at a step with a capacity.
    fn share(&self, step: &RigidStep, x: &DVector<f64>, k: usize) -> Result<Shared, CouplingError> {
        let model = &self.done.model;
        let capacities = self.capacities_in(x, k);
        let lines: Vec<Vec<usize>> = (0..self.thigh.muscles.len()).map(|m| self.lines(m)).collect();
        let problem = sharing_problem(model, &self.done.loads, step.row, self.units, &lines, &capacities)
            .ok_or_else(|| no_loads(step))?;
        let mut solver = SharingSolver::new(names(model), SharingSettings::default().options);
        let solved = solver.solve(&problem)?;
        if solved.verdict.status == Status::Failed || !solved.f.iter().all(|f| f.is_finite()) {
            let why = solved.verdict.reason.unwrap_or_default();
            return Err(CouplingError::NotConverged(format!(
                "two-way coupling, {}: no muscle forces: {why}",
                step.name.name()
            )));
        }
        let infeasible = (solved.verdict.status == Status::Infeasible).then(|| {
            let why = solved.verdict.reason.unwrap_or_default();
            format!(
                "two-way coupling, {}: no forces within their bounds carry the load: {why}",
                step.name.name()
            )
        });
        Ok(Shared { infeasible, ..self.shared(solved.f, &problem.R) })
    }

    /// The load of the thigh at a step for tensions `f`.
    fn frame(&self, f: &DVector<f64>, x: &DVector<f64>, k: usize) -> Result<DriveFrame, CouplingError> {
        let mut frame = self.at_step(k).clone();
        for (m, muscle) in self.thigh.muscles.iter().enumerate() {
            let tension: f64 = self.lines(m).iter().map(|&i| f[i]).sum();
            let control = self.control(&muscle.name);
            frame.load.controls[control] = self.capacity_in(x, k, m).drive(&self.units[m], tension);
        }
        Ok(frame)
    }

    /// What a number of the capacity is.
    fn name_of(&self, entry: usize) -> String {
        let quantity = MuscleCapacity::quantity(entry % N);
        let (muscle, step) = (entry / N % self.thigh.muscles.len(), entry / N / self.thigh.muscles.len());
        let (muscle, step) = (&self.thigh.muscles[muscle].name, self.steps[step].name.name());
        format!("{step} {muscle} {quantity}")
    }

    fn pass(
        &self,
        change: Option<f64>,
        shared: &[Shared],
        seen: &[Vec<MuscleAction>],
    ) -> Result<Pass, CouplingError> {
        let mut pass = Pass {
            change,
            changed_most: None,
            missing: Vec::new(),
            lacking: Vec::new(),
            wanted: Vec::new(),
            found: Vec::new(),
        };
        for (k, step) in self.steps.iter().enumerate() {
            let reduced = self.done.loads.reduced[step.row].as_ref().ok_or_else(|| no_loads(step))?;
            let mut others = shared[k].f.clone();
            let mut moments: DVector<f64> = DVector::zeros(reduced.moments.len());
            let mut wanted = Vec::new();
            for (m, action) in seen[k].iter().enumerate() {
                let lines = self.lines(m);
                wanted.push(lines.iter().map(|&i| shared[k].f[i]).sum());
                lines.iter().for_each(|&i| others[i] = 0.0);
                moments += &action.moments;
            }
            let missing = &reduced.moments - moments - &reduced.lever_arms * others;
            pass.missing.push(std::array::from_fn(|c| missing[c]));
            let lacks = |(counted, action): (&[f64; MOVED], &MuscleAction)| {
                std::array::from_fn(|c| counted[c] - action.moments[c])
            };
            pass.lacking.push(shared[k].counted.iter().zip(&seen[k]).map(lacks).collect());
            pass.wanted.push(wanted);
            pass.found.push(seen[k].iter().map(|a| a.force).collect());
        }
        Ok(pass)
    }
}

/// The sharing problem of a reported frame in which the muscles of the thigh have these capacities. `lines`: per muscle the numbers of the
/// model's lines that belong to it. `None` where the loads are unknown.
pub fn sharing_problem(
    model: &Model,
    loads: &Loads,
    row: usize,
    units: &[MuscleUnit],
    lines: &[Vec<usize>],
    capacities: &[MuscleCapacity],
) -> Option<SharingProblem> {
    let mut capacity = Capacity::nominal(model.muscles.iter().map(|m| m.f_max).collect());
    for ((of_muscle, unit), lines) in capacities.iter().zip(units).zip(lines) {
        let arms: Vec<(usize, f64)> = of_muscle.lever_arms.into_iter().enumerate().collect();
        capacity.give(lines, |i| model.muscles[i].f_max, of_muscle.bounds(unit), &arms);
    }
    problem(model, loads, row, &capacity, &SharingSettings::default())
}

/// The capacity that a muscle shows at a change of length `shift` \[m\] under the isometric activation `drive`, and which of its
/// [numbers](MuscleCapacity::scaled) can be seen: a slack one hangs as it may, and not where it would pull.
pub fn seen_capacity(
    action: &MuscleAction,
    unit: &MuscleUnit,
    shift: f64,
    drive: f64,
) -> (MuscleCapacity, [bool; N]) {
    let tension = unit.force(shift, drive);
    let pulls = tension >= LEAST_TENSION;
    let arms: [Option<f64>; MOVED] = std::array::from_fn(|c| action.lever_arms[c]);
    let now = MuscleCapacity {
        shift,
        tissue: action.tissue,
        through_belly: (action.force - action.tissue) / tension,
        lever_arms: arms.map(Option::unwrap_or_default),
    };
    let says = std::array::from_fn(|i| match i {
        0 | 2 => pulls,
        1 => true,
        arm => arms[arm - 3].is_some(),
    });
    (now, says)
}

/// Capacity of a muscle before anything is seen of it: the length of its lines, and the mean of their lever arms, each with its strength.
pub fn nominal_capacity(
    model: &Model,
    lever_arms: &DMatrix<f64>,
    unit: &MuscleUnit,
    lines: &[usize],
    rigid: Option<&RigidMuscle>,
) -> MuscleCapacity {
    let f_max = |i: &usize| model.muscles[*i].f_max;
    let strength: f64 = lines.iter().map(f_max).sum();
    let arm = |c: usize| {
        let arm = |i: &usize| f_max(i) * lever_arms[(c, *i)];
        lines.iter().map(arm).sum::<f64>() / strength
    };
    MuscleCapacity {
        shift: rigid.map_or(0.0, |rigid| unit.fibre_length_at(rigid) - unit.fibre_length(0.0)),
        tissue: 0.0,
        through_belly: 1.0,
        lever_arms: std::array::from_fn(arm),
    }
}

fn no_loads(step: &RigidStep) -> CouplingError {
    CouplingError::NotConverged(format!("no loads at {}", step.name.name()))
}

fn advance(
    plan: &Plan,
    settings: &Settings,
    from: &Frame,
    to: &DriveFrame,
) -> Result<Advanced, CouplingError> {
    let session = Session::from_frame(plan, settings, from, 0);
    let done = session
        .map_err(|error| CouplingError::NotConverged(format!("two-way coupling: {error}")))?
        .advance(to);
    match done.errors.first() {
        None => Ok(done),
        Some(error) => Err(CouplingError::NotConverged(format!("two-way coupling: {error}"))),
    }
}
