//! How much softer the matrix of an embedded muscle is taken, so that it resists as its mesh does.
//!
//! Displacements in a grid are some of those of the mesh, so no state of the grid has less energy than the best of the mesh: a muscle in a
//! grid is too stiff, the coarser the more. One factor on the energy of its matrix takes that back: the passive muscle alone, its most distal
//! bone drawn away by [`PULLED`] of its length, has the force through the belly that its mesh has. Fibres carry their tension in a grid as in
//! the mesh and are calibrated afterwards, with the softened matrix.

use fem::body::Pose;
use fem::plan::Plan;
use fem::run::{DriveFrame, Session};
use fem::solve::Settings;
use nalgebra::{Translation3, UnitQuaternion, Vector3};

use crate::fibres::alone::calibrate_each;
use crate::fibres::cache::Cache;
use crate::fibres::thermal_calibration::CalibrationError;
use crate::thigh::build::Thigh;
use crate::thigh::registration::BODIES;
use crate::thigh::section::belly_force;

/// Way of the most distal bone over the length of the muscle's line. Muscles of the thigh are that much longer at the ends of a step than
/// standing; docs/embedded.md has the factors at half and at twice of it.
pub const PULLED: f64 = 0.1;
/// Newton's method ends at this residual relative to the forces in play, which count at least [`LEAST_FORCE`]: 1e-4 of the force of a
/// passive muscle.
const TOLERANCE: f64 = 1e-4;
/// See [`TOLERANCE`] \[N\].
const LEAST_FORCE: f64 = 1.0;
/// The force of the mesh counts as met within this fraction: a tenth of the last digit that is printed of forces of some newtons.
const MET: f64 = 1e-3;
/// The force is close to a straight line over the factor, so that a secant is there in two or three.
const MOST_TRIES: usize = 10;

/// A muscle in a grid, and the factor on its matrix.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MatrixFactor {
    /// Which.
    pub muscle: String,
    /// Edge of a cube \[m\].
    pub cell: f64,
    /// Factor on the energy density of its matrix.
    pub factor: f64,
    /// Force through its passive belly, drawn by [`PULLED`], in its mesh \[N\].
    pub of_mesh: f64,
    /// The same in the grid, as it is \[N\].
    pub of_grid: f64,
    /// The same in the grid with the factor \[N\].
    pub softened: f64,
    /// Unknowns of its mesh and of its grid, the muscle alone.
    pub unknowns: [usize; 2],
}

/// Finds the factors of all embedded muscles, each alone and all in parallel. What `cache` has is not computed.
pub fn matrix_factors(
    thigh: &Thigh,
    settings: &Settings,
    cache: Option<&Cache>,
) -> Result<Vec<MatrixFactor>, CalibrationError> {
    if thigh.scene.embedded.is_empty() {
        return Ok(Vec::new());
    }
    let settings = Settings { tolerance: TOLERANCE, least_force: LEAST_FORCE, ..*settings };
    let depends = |_| format!("matrix factor {PULLED:?}{MET:?}{settings:?}");
    let is_embedded = |muscle: &Thigh| !muscle.scene.embedded.is_empty();
    let all = calibrate_each(thigh, cache, depends, |_, muscle| {
        Ok(if is_embedded(muscle) { vec![find(muscle, &settings)?] } else { Vec::new() })
    })?;
    Ok(all.concat())
}

/// Softens the matrix of the muscles that the factors are of.
pub fn soften(thigh: &mut Thigh, factors: &[MatrixFactor]) {
    for MatrixFactor { muscle, factor, .. } in factors {
        scale_matrix(thigh, muscle, *factor);
    }
}

fn scale_matrix(thigh: &mut Thigh, muscle: &str, factor: f64) {
    let cells = thigh.mesh.blocks.iter().find(|b| b.name == *muscle).map_or(0, |b| b.n_cells());
    for solid in thigh.scene.solids.iter_mut().filter(|s| s.region == *muscle) {
        if solid.scale.is_empty() {
            solid.scale = vec![1.0; cells];
        }
        solid.scale.iter_mut().for_each(|scale| *scale *= factor);
    }
}

/// The factor of the only muscle of `thigh`.
fn find(thigh: &Thigh, settings: &Settings) -> Result<MatrixFactor, CalibrationError> {
    let mut passive = thigh.clone();
    passive.scene.fibres.clear();
    let mut mesh = passive.clone();
    mesh.scene.embedded.clear();
    let (of_mesh, unknowns_of_mesh) = drawn(&mesh, PULLED, settings)?;
    let (of_grid, unknowns_of_grid) = drawn(&passive, PULLED, settings)?;
    let muscle = thigh.muscles[0].name.clone();
    let softened = |factor: f64| {
        let mut softened = passive.clone();
        scale_matrix(&mut softened, &muscle, factor);
        Ok::<f64, CalibrationError>(drawn(&softened, PULLED, settings)?.0)
    };
    // Without matrix there would be next to no force.
    let (mut before, mut now) = ((0.0, 0.0), (1.0, of_grid));
    for _ in 0..MOST_TRIES {
        if (now.1 - of_mesh).abs() <= MET * of_mesh.abs() {
            let unknowns = [unknowns_of_mesh, unknowns_of_grid];
            let cell = thigh.scene.embedded[0].cell;
            return Ok(MatrixFactor { muscle, cell, factor: now.0, of_mesh, of_grid, softened: now.1, unknowns });
        }
        let factor = now.0 + (of_mesh - now.1) * (now.0 - before.0) / (now.1 - before.1);
        if !(factor > 0.0 && factor.is_finite()) {
            break;
        }
        (before, now) = (now, (factor, softened(factor)?));
    }
    Err(CalibrationError::Factor { muscle, of_mesh, of_grid, last: now.1 })
}

/// Force through the passive belly \[N\] of the only muscle of `thigh` with its most distal bone drawn away from its origin by a fraction of
/// its line, and its unknowns.
pub fn drawn(thigh: &Thigh, fraction: f64, settings: &Settings) -> Result<(f64, usize), CalibrationError> {
    let muscle = &thigh.muscles[0];
    let plan = Plan::new(&thigh.scene, thigh.mesh.clone())?;
    let length: f64 = muscle.line.windows(2).map(|two| (two[1] - two[0]).norm()).sum();
    let ends: Vector3<f64> = muscle.line[muscle.line.len() - 1] - muscle.line[0];
    let way = Translation3::from(ends.normalize() * (fraction * length));
    let away = Pose::from_parts(way, UnitQuaternion::identity());
    let distal = BODIES.iter().rev().find(|body| plan.bodies.iter().any(|b| b == *body));
    let poses: Vec<(&str, Pose)> = distal.map(|body| (*body, away)).into_iter().collect();
    let load = plan.load(&[], &poses)?;
    let mut session = Session::new(&plan, settings, None)?;
    let done = session.advance(&DriveFrame { time: 1.0, load });
    if let Some(error) = done.errors.into_iter().next() {
        return Err(CalibrationError::Solve(error));
    }
    Ok((belly_force(&plan, done.frame.snapshot(), muscle).along(), plan.n_unknowns()))
}
