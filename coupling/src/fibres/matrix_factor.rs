//! How much softer the matrix of an embedded muscle is taken, so that it resists as its mesh does.
//!
//! Displacements in a grid are some of those of the mesh, so no state of the grid has less energy than the best of the mesh: a muscle in a
//! grid is too stiff, the coarser the more. One factor on the energy of its matrix takes that back: the passive muscle alone draws its most
//! distal bone back, once that has gone away by [`PULLED`] of its length, with the force that its mesh has. Fibres carry their tension in a grid as in
//! the mesh and are calibrated afterwards, with the softened matrix.

use fem::body::Pose;
use fem::measure::body_wrenches;
use fem::plan::Plan;
use fem::run::{DriveFrame, Session};
use fem::solve::Settings;
use nalgebra::{Translation3, UnitQuaternion, Vector3};

use crate::fibres::alone::calibrate_each;
use crate::fibres::cache::Cache;
use crate::fibres::thermal_calibration::CalibrationError;
use crate::thigh::build::Thigh;
use crate::thigh::registration::BODIES;

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
    /// Force with which it draws its bone back, passive and drawn by [`PULLED`], in its mesh \[N\].
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
    let is_embedded = |i: &usize| thigh.scene.embedded.iter().any(|e| e.region == thigh.muscles[*i].name);
    let embedded: Vec<usize> = (0..thigh.muscles.len()).filter(is_embedded).collect();
    let settings = Settings { tolerance: TOLERANCE, least_force: LEAST_FORCE, ..*settings };
    let depends = |_| format!("matrix factor {PULLED:?}{MET:?}{settings:?}");
    calibrate_each(thigh, &embedded, cache, depends, |_, muscle| find(muscle, &settings))
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
            return Ok(MatrixFactor {
                muscle,
                cell,
                factor: now.0,
                of_mesh,
                of_grid,
                softened: now.1,
                unknowns,
            });
        }
        let factor = now.0 + (of_mesh - now.1) * (now.0 - before.0) / (now.1 - before.1);
        if !(factor > 0.0 && factor.is_finite()) {
            break;
        }
        (before, now) = (now, (factor, softened(factor)?));
    }
    Err(CalibrationError::Factor { muscle, of_mesh, of_grid, last: now.1 })
}

/// Force \[N\] with which the passive only muscle of `thigh` draws its most distal bone back, once that has gone away from its origin by a
/// fraction of its line; and its unknowns.
pub fn drawn(thigh: &Thigh, fraction: f64, settings: &Settings) -> Result<(f64, usize), CalibrationError> {
    let muscle = &thigh.muscles[0];
    let plan = Plan::new(&thigh.scene, thigh.mesh.clone())?;
    let length: f64 = muscle.line.windows(2).map(|two| (two[1] - two[0]).norm()).sum();
    let ends: Vector3<f64> = muscle.line[muscle.line.len() - 1] - muscle.line[0];
    let way = ends.normalize();
    let away = Translation3::from(way * (fraction * length));
    let away = Pose::from_parts(away, UnitQuaternion::identity());
    let on_bone = |body: &&str| plan.bodies.iter().position(|b| b == *body);
    let (distal, body) = BODIES
        .iter()
        .rev()
        .find_map(|body| Some((on_bone(body)?, *body)))
        .expect("a muscle of the thigh grows from bone");
    let poses = [(body, away)];
    let load = plan.load(&[], &poses)?;
    let mut session = Session::new(&plan, settings, None)?;
    let done = session.advance(&DriveFrame { time: 1.0, load });
    if let Some(error) = done.errors.into_iter().next() {
        return Err(CalibrationError::Solve(error));
    }
    let about = vec![[0.0; 3]; plan.bodies.len()];
    let wrench = body_wrenches(&plan, done.frame.snapshot(), &about)[distal];
    Ok((-Vector3::from(wrench.force).dot(&way), plan.n_unknowns()))
}
