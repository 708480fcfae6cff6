//! Nested iteration: a run on a fine mesh that is led by one on a coarse mesh of the same bodies (Hackbusch, Multi-Grid Methods and
//! Applications, Springer 1985, ch. 5), with Newton's method on every mesh.
//!
//! Displacements of the coarse run are carried over, frame by frame; where surfaces are kept apart those from one frame to the next, and what
//! the fine mesh is off by turns with the cells of the coarse one. Prescribed nodes go where they must, which at the edge of a support is
//! not where cells of the coarse mesh take them; cells that fold there are given shape again. The fine equilibrium is as exact as any: only
//! the way to it is shorter. Where there are several it may be another one.

#![allow(non_snake_case)]

mod patch;

use crate::mesh::Prolongation;
use crate::plan::{Load, LoadedIsland, Motion, Plan};
use crate::run::{Advanced, Drive, DriveFrame, Frame, Run, Session};
use crate::solve::{Settings, SolveError};
use nalgebra::Vector3;

/// A run on a coarse mesh that leads one on a fine mesh.
pub struct CoarseRun<'a> {
    plan: &'a Plan,
    frames: &'a [Frame],
    onto: Prolongation,
}

impl<'a> CoarseRun<'a> {
    /// Solved `frames` of the coarse `plan`; those of the `fine` one are to be under the same loads.
    pub fn new(plan: &'a Plan, frames: &'a [Frame], fine: &Plan) -> CoarseRun<'a> {
        CoarseRun { plan, frames, onto: Prolongation::new(&plan.mesh, &fine.mesh) }
    }

    /// A guess of the way to a frame of the fine run from the one before, or from the mesh: displacements \[m\] of all nodes, `None`
    /// where nothing is known. `to`: the load there. Empty where the coarse run did not come so far.
    pub fn way(&self, fine: &Plan, before: Option<&Frame>, frame: usize, to: &Load) -> Vec<Option<[f64; 3]>> {
        let Some(reached) = self.frames.get(frame) else { return Vec::new() };
        let reference = self.plan.reference();
        let start = before.map_or_else(|| fine.reference(), |frame| frame.x.clone());
        // Surfaces that are apart stay so where they go as the coarse ones do from here on, not where the coarse ones are.
        let keeps_apart = fine.islands.iter().any(|island| island.terms().iter().any(|t| t.keeps_apart()));
        let places = |x: &[f64]| {
            let moved: Vec<f64> = x.iter().zip(&reference).map(|(x, X)| x - X).collect();
            let along = self.onto.vectors(&moved).into_iter().zip(&fine.mesh.points);
            along.map(|(u, X)| u.map(|u| Vector3::from(*X) + Vector3::from(u))).collect::<Vec<_>>()
        };
        let left = keeps_apart.then(|| {
            let left = if frame == 0 { &reference } else { &self.frames[frame - 1].x };
            (places(left), self.onto.rotations(left, &reached.x))
        });
        let mut way: Vec<Option<[f64; 3]>> = vec![None; fine.mesh.points.len()];
        for (n, (way, now)) in way.iter_mut().zip(places(&reached.x)).enumerate() {
            let Some(now) = now else { continue };
            let x = Vector3::from_fn(|c, _| start[3 * n + c]);
            let off = left.as_ref().and_then(|(then, turned)| Some(turned[n]? * (x - then[n]?)));
            *way = Some((now + off.unwrap_or_default() - x).into());
        }
        let from = before.map_or_else(|| fine.load(&[], &[]).expect("nothing is named"), |f| f.load.clone());
        let calm = carried(fine, &start, &from, to);
        let is_free: Vec<bool> = fine.motion.iter().map(|m| *m == [Motion::Free; 3]).collect();
        let mut x = calm;
        let led =
            way.iter().enumerate().filter_map(|(n, way)| way.filter(|_| is_free[n]).map(|way| (n, way)));
        led.for_each(|(n, way)| (0..3).for_each(|c| x[3 * n + c] = start[3 * n + c] + way[c]));
        patch::unfold(&fine.mesh, &start, &is_free, &mut x);
        for (n, way) in way.iter_mut().enumerate() {
            *way = way.map(|_| std::array::from_fn(|c| x[3 * n + c] - start[3 * n + c]));
        }
        way
    }
}

/// Carries a plan along a drive, `led` by a coarse run where there is one; stops at the first frame that is not solved.
pub fn run_led(plan: &Plan, drive: &Drive, settings: &Settings, led: Option<&CoarseRun>) -> Run {
    let mut run = Run::default();
    for (k, to) in drive.frames.iter().enumerate() {
        match advance_led(plan, settings, run.frames.last(), k, to, led) {
            Ok(done) => {
                if !run.take(done) {
                    break;
                }
            }
            Err(error) => return Run { errors: vec![error], ..run },
        }
    }
    run
}

/// Solves the `k`-th frame of a drive from the one before, or from the mesh, with new solvers.
pub(crate) fn advance_led(
    plan: &Plan,
    settings: &Settings,
    last: Option<&Frame>,
    k: usize,
    to: &DriveFrame,
    led: Option<&CoarseRun>,
) -> Result<Advanced, SolveError> {
    let mut session = match last {
        None => Session::new(plan, settings, None)?,
        Some(frame) => Session::from_frame(plan, settings, frame, k - 1)?,
    };
    let way = led.map_or(Vec::new(), |coarse| coarse.way(plan, last, k, &to.load));
    Ok(session.advance_along(to, &way))
}

/// Positions \[m\] of all nodes where what is prescribed takes them from `x` by itself.
fn carried(plan: &Plan, x: &[f64], from: &Load, to: &Load) -> Vec<f64> {
    let mut all = x.to_vec();
    for island in &plan.islands {
        let free = island.free_positions(&island.gather(x));
        let places = LoadedIsland::new(island.clone(), from.clone(), to.clone()).carried(&free);
        for (&n, place) in island.nodes.iter().zip(places.as_chunks::<3>().0) {
            all[3 * n as usize..3 * n as usize + 3].copy_from_slice(place);
        }
    }
    all
}
