//! How stiff the tissue holds a body: the change of its wrench with its twist, every free node in equilibrium.
//!
//! With free nodes x and a twist s of the body, equilibrium g(x, s) = 0 gives dx/ds = −K⁻¹ ∂g/∂s. K is the derivative of the exact forces
//! and is only ever applied, as a difference quotient of them: the Hessian that the solver works with leaves out what whole fibres and
//! convexity take from it, and is the preconditioner here.

use super::{Snapshot, body_wrenches};
use crate::body::Pose;
use crate::plan::{Island, Load, LoadedIsland, Plan};
use crate::solve::{Analysis, BlockMatrix, LinearSolver, Loading, Potential};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::sync::Arc;

/// Step of difference quotients of forces \[m\], and of poses \[m, rad\]: of the distance at which surfaces in contact press (0.01 mm) a
/// thousandth, of forces of 100 N a round-off of 1e-6 N/m.
const STEP: f64 = 1e-8;
/// Residual of the linear systems relative to their right-hand sides.
const TOLERANCE: f64 = 1e-7;
/// Iterations after which a system is given up.
const MOST_ITERATIONS: usize = 2000;

/// The derivative of the wrench of the tissue on a body (by its number in [`Plan::bodies`]) with respect to its own twist, both about the
/// point `about` \[m\] that stays in space; all other bodies are held. Rows: force \[N\], moment \[N·m\]; columns: translation \[m\],
/// rotation \[rad\]. In a stable equilibrium it is symmetric but for the turning of the forces that are there already.
///
/// The error says why there is none: the state is no minimum of the energy, or not settled.
pub fn condensed_stiffness(
    plan: &Plan,
    at: Snapshot,
    body: usize,
    about: [f64; 3],
) -> Result<[[f64; 6]; 6], String> {
    let mut islands: Vec<Held> = plan.islands.iter().map(|island| Held::new(at, island.clone())).collect();
    let mut stiffness = [[0.0; 6]; 6];
    for column in 0..6 {
        let moved = [1.0, -1.0].map(|sign| {
            let mut load = at.load.clone();
            load.poses[body] = twisted(&load.poses[body], column, sign * STEP, about);
            load
        });
        let mut ways: Vec<Vec<f64>> = Vec::new();
        for island in &mut islands {
            ways.push(island.follow(&moved)?);
        }
        let wrench = |k: usize| {
            let sign = [1.0, -1.0][k];
            let mut x = at.x.to_vec();
            plan.prescribe_idle(&moved[k], &mut x);
            for (island, way) in islands.iter().zip(&ways) {
                island.put(&moved[k], way, sign * STEP, &mut x);
            }
            let centre: [f64; 3] = (moved[k].poses[body].inverse() * Point3::from(about)).into();
            let abouts = vec![centre; plan.bodies.len()];
            let wrench = body_wrenches(plan, Snapshot { x: &x, load: &moved[k] }, &abouts)[body];
            [wrench.force, wrench.moment].concat()
        };
        for (row, (ahead, behind)) in stiffness.iter_mut().zip(wrench(0).into_iter().zip(wrench(1))) {
            row[column] = (ahead - behind) / (2.0 * STEP);
        }
    }
    Ok(stiffness)
}

/// The pose after a small twist: `column` 0..3 translates along an axis, 3..6 turns about one through `about`.
fn twisted(pose: &Pose, column: usize, by: f64, about: [f64; 3]) -> Pose {
    let axis = |c: usize| Vector3::from_fn(|i, _| if i == c { by } else { 0.0 });
    if column < 3 {
        return Translation3::from(axis(column)) * pose;
    }
    let centre = Translation3::from(Vector3::from(about));
    let turn = UnitQuaternion::from_scaled_axis(axis(column - 3));
    centre * Isometry3::from_parts(Translation3::identity(), turn) * centre.inverse() * pose
}

/// An island about its equilibrium.
struct Held {
    island: Arc<Island>,
    load: Load,
    free: Vec<f64>,
    /// What is held of the free nodes.
    fixed: Vec<bool>,
    linear: Option<LinearSolver>,
}

impl Held {
    fn new(at: Snapshot, island: Arc<Island>) -> Held {
        let free = island.free_positions(&island.gather(at.x));
        let potential = LoadedIsland::new(island.clone(), at.load.clone(), at.load.clone());
        let fixed = match potential.fixed() {
            [] => vec![false; free.len()],
            fixed => fixed.to_vec(),
        };
        Held { island, load: at.load.clone(), free, fixed, linear: None }
    }

    /// Forces on the unknowns \[N\] at `x` under a load.
    fn forces(&self, load: &Load, x: &[f64]) -> Vec<f64> {
        let mut potential = LoadedIsland::new(self.island.clone(), load.clone(), load.clone());
        let mut x = x.to_vec();
        potential.set_load(0.0, &mut x);
        potential.renew(&x);
        let mut g = vec![0.0; x.len()];
        potential.gradient(&x, &mut g);
        g.iter_mut().zip(&self.fixed).filter(|(_, fixed)| **fixed).for_each(|(g, _)| *g = 0.0);
        g
    }

    /// dx/ds of the free nodes, given the loads a step ahead and behind along s.
    fn follow(&mut self, moved: &[Load; 2]) -> Result<Vec<f64>, String> {
        let n = self.free.len();
        if n == 0 {
            return Ok(Vec::new());
        }
        let [ahead, behind] = moved.each_ref().map(|load| self.forces(load, &self.free));
        let b: Vec<f64> = ahead.iter().zip(behind).map(|(a, b)| -(a - b) / (2.0 * STEP)).collect();
        let size = norm(&b);
        let (mut u, mut r) = (vec![0.0; n], b);
        if size == 0.0 {
            return Ok(u);
        }
        let (mut z, mut p) = (vec![0.0; n], vec![0.0; n]);
        let mut rz = 1.0;
        for iteration in 0..MOST_ITERATIONS {
            self.preconditioner()?.apply(&r, &mut z);
            let next = dot(&r, &z);
            let beta = if iteration == 0 { 0.0 } else { next / rz };
            rz = next;
            p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + beta * *p);
            let q = self.stiffness_times(&p);
            let curvature = dot(&p, &q);
            if !(curvature > 0.0) {
                return Err("the state is no minimum of the energy".into());
            }
            let alpha = rz / curvature;
            u.iter_mut().zip(&p).for_each(|(u, p)| *u += alpha * p);
            r.iter_mut().zip(&q).for_each(|(r, q)| *r -= alpha * q);
            if norm(&r) <= TOLERANCE * size {
                return Ok(u);
            }
        }
        Err(format!("{MOST_ITERATIONS} iterations leave {:.1e} of the residual", norm(&r) / size))
    }

    /// K p, a central difference over a way of [`STEP`] of the node that moves most.
    fn stiffness_times(&self, p: &[f64]) -> Vec<f64> {
        let most = p.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        if most == 0.0 {
            return vec![0.0; p.len()];
        }
        let h = STEP / most;
        let at = |sign: f64| {
            let x: Vec<f64> = self.free.iter().zip(p).map(|(x, p)| x + sign * h * p).collect();
            self.forces(&self.load, &x)
        };
        at(1.0).iter().zip(at(-1.0)).map(|(a, b)| (a - b) / (2.0 * h)).collect()
    }

    /// The factor of the convex Hessian.
    fn preconditioner(&mut self) -> Result<&LinearSolver, String> {
        if self.linear.is_none() {
            let mut potential = LoadedIsland::new(self.island.clone(), self.load.clone(), self.load.clone());
            let mut x = self.free.clone();
            potential.set_load(0.0, &mut x);
            potential.renew(&x);
            let pattern = potential.pattern().clone();
            let mut linear = LinearSolver::new(Arc::new(Analysis::new(&pattern, &x)), &x, true);
            let mut k = BlockMatrix::zeros(pattern);
            potential.hessian(&x, 1.0, &mut k);
            k.constrain(&self.fixed);
            if linear.refactorize(&k).is_err() {
                // Semi-definite where parts hang on nothing.
                k.shift(1e-6);
                linear.refactorize(&k).map_err(|_| "a part can move freely".to_string())?;
            }
            self.linear = Some(linear);
        }
        Ok(self.linear.as_ref().expect("just made"))
    }

    /// Puts the nodes of the island where they are under a load, `by` along the way of the free nodes.
    fn put(&self, load: &Load, way: &[f64], by: f64, x: &mut [f64]) {
        let mut potential = LoadedIsland::new(self.island.clone(), load.clone(), load.clone());
        let mut free: Vec<f64> = self.free.iter().zip(way).map(|(x, u)| x + by * u).collect();
        potential.set_load(0.0, &mut free);
        let local = potential.expand(&free);
        for (&n, p) in self.island.nodes.iter().zip(local.chunks_exact(3)) {
            x[3 * n as usize..3 * n as usize + 3].copy_from_slice(p);
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}
