//! Cases with known answers: what the solver gives beside what is right, with stated meshes and tolerances.
//!
//! Run all of them with `cargo run --release -p sartorius-fem --example verification`.

mod bars;
mod locking;
pub mod reference;
mod solids;

use std::fmt::Write;
use std::time::Instant;

use thiserror::Error;

use crate::body::Wrench;
use crate::measure::{Snapshot, support_wrench};
use crate::mesh::{Mesh, MeshError, unique_nodes};
use crate::plan::{Plan, SceneError};
use crate::run::{Drive, DriveFrame, Frame, Run, run};
use crate::scene::{LawSpec, PrescribedSpec, Scene, SolidSpec};
use crate::solve::{Settings, SolveError};
use reference::{DENSITY, MATRIX};

pub use bars::{Ends, fibre_bar, fibre_bar_cases, fibre_bar_force, fibre_bar_free_stretch, gravity};
pub use locking::{cook, squash, squashed_block};
pub use solids::{cube, sphere, torsion, turned, twisted_cylinder};

/// One number beside its reference.
#[derive(Clone, Debug)]
pub struct Check {
    /// Case, e.g. `b03 twisted cylinder`.
    pub case: &'static str,
    /// Mesh, e.g. `12 x 20 hex8`.
    pub mesh: String,
    /// Quantity and unit.
    pub quantity: String,
    /// What the solver gives.
    pub ours: f64,
    /// What it should be.
    pub reference: f64,
    /// What the difference is divided by: the reference itself, or the largest value on a curve.
    pub scale: f64,
    /// Largest difference relative to `scale`.
    pub tolerance: f64,
    /// Seconds of the run that gave it.
    pub seconds: f64,
}

impl Check {
    /// (ours − reference) / scale.
    pub fn difference(&self) -> f64 {
        (self.ours - self.reference) / self.scale.abs()
    }

    /// Within the tolerance; NaN is not.
    pub fn holds(&self) -> bool {
        self.difference().abs() <= self.tolerance
    }
}

/// A case that gave no answer.
#[derive(Debug, Error)]
pub enum VerificationError {
    /// The scene is not good.
    #[error("{case}: {source}")]
    Scene {
        /// The case.
        case: &'static str,
        /// Why.
        source: SceneError,
    },
    /// The mesh is not good.
    #[error("{case}: {source}")]
    Mesh {
        /// The case.
        case: &'static str,
        /// Why.
        source: MeshError,
    },
    /// A frame was not solved.
    #[error("{case}: {source}")]
    Unsolved {
        /// The case.
        case: &'static str,
        /// Why.
        source: SolveError,
    },
}

/// A function that computes the checks of a case, on the stated mesh or on a refinement of it.
pub type CaseFn = fn(refined: bool) -> Result<Vec<Check>, VerificationError>;

/// All cases by name.
pub fn cases() -> Vec<(&'static str, CaseFn)> {
    vec![
        ("b01", cube),
        ("b02", sphere),
        ("b03", torsion),
        ("b04", fibre_bar_cases),
        ("b05", gravity),
        ("b08", cook),
        ("b09", squash),
    ]
}

/// Header of the table that [`table_row`] fills.
pub const TABLE_HEADER: &str = "| case | mesh | quantity | ours | reference | difference | tolerance | verdict | seconds |\n\
                                | --- | --- | --- | ---: | ---: | ---: | ---: | --- | ---: |\n";

/// A row of a Markdown table.
pub fn table_row(check: &Check) -> String {
    let Check { case, mesh, quantity, ours, reference, tolerance, seconds, .. } = check;
    let verdict = if check.holds() { "holds" } else { "**fails**" };
    let mut row = String::new();
    let (ours, reference) = (significant(*ours), significant(*reference));
    let (difference, tolerance) = (percent(check.difference()), percent(*tolerance).replace('+', ""));
    write!(row, "| {case} | {mesh} | {quantity} | {ours} | {reference} | {difference} | {tolerance} | {verdict} | {seconds:.1} |")
        .expect("a string takes any text");
    row
}

/// Five significant digits.
fn significant(x: f64) -> String {
    let digits = if x == 0.0 { 0 } else { (4 - x.abs().log10().floor() as i32).clamp(0, 12) as usize };
    format!("{x:.digits$}")
}

fn percent(x: f64) -> String {
    if x != 0.0 && x.abs() < 5e-5 { format!("{:+.0e} %", 100.0 * x) } else { format!("{:+.2} %", 100.0 * x) }
}

/// A solved case.
pub(crate) struct Solved {
    pub plan: Plan,
    pub run: Run,
    pub seconds: f64,
}

impl Solved {
    /// Carries a scene over a mesh through frames of control values.
    pub fn new(
        case: &'static str,
        scene: &Scene,
        mesh: &Mesh,
        frames: &[Vec<(&str, f64)>],
    ) -> Result<Solved, VerificationError> {
        let start = Instant::now();
        mesh.check().map_err(|source| VerificationError::Mesh { case, source })?;
        let plan =
            Plan::new(scene, mesh.clone()).map_err(|source| VerificationError::Scene { case, source })?;
        let loads: Result<Vec<_>, _> = frames.iter().map(|controls| plan.load(controls, &[])).collect();
        let loads = loads.map_err(|source| VerificationError::Scene { case, source })?;
        Solved::run(case, plan, loads, start)
    }

    /// Carries a plan through loads.
    pub fn run(
        case: &'static str,
        plan: Plan,
        loads: Vec<crate::plan::Load>,
        start: Instant,
    ) -> Result<Solved, VerificationError> {
        let frames = loads.into_iter().zip(1..).map(|(load, i)| DriveFrame { time: f64::from(i), load });
        let drive = Drive { frames: frames.collect() };
        // Two digits more than the tightest tolerance asks.
        let settings = Settings { tolerance: 1e-8, ..Settings::default() };
        let mut run = run(&plan, &drive, &settings, None, &mut |_| {});
        if !run.errors.is_empty() {
            return Err(VerificationError::Unsolved { case, source: run.errors.swap_remove(0) });
        }
        Ok(Solved { plan, run, seconds: start.elapsed().as_secs_f64() })
    }

    pub fn frames(&self) -> &[Frame] {
        &self.run.frames
    }

    pub fn at(&self, frame: usize) -> Snapshot<'_> {
        self.run.frames[frame].snapshot()
    }

    /// Force and moment (about the origin) of the supports on a node set.
    pub fn support(&self, frame: usize, set: &str) -> Wrench {
        support_wrench(&self.plan, self.at(frame), self.nodes(set), [0.0; 3])
    }

    pub fn nodes(&self, set: &str) -> &[u32] {
        self.plan.mesh.node_sets.get(set).map_or(&[], Vec::as_slice)
    }

    /// Displacement \[m\] of a node.
    pub fn displacement(&self, frame: usize, node: u32) -> [f64; 3] {
        let x = &self.run.frames[frame].x[3 * node as usize..][..3];
        [0, 1, 2].map(|d| x[d] - self.plan.mesh.points[node as usize][d])
    }

    /// The node nearest to a point of the mesh \[m\].
    pub fn node_at(&self, point: [f64; 3]) -> u32 {
        let distance = |p: &[f64; 3]| [0, 1, 2].map(|d| (p[d] - point[d]).powi(2)).iter().sum::<f64>();
        let points = self.plan.mesh.points.iter().map(distance).zip(0u32..);
        points.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0, |(_, node)| node)
    }

    pub fn check(
        &self,
        case: &'static str,
        mesh: &str,
        quantity: impl Into<String>,
        [ours, reference]: [f64; 2],
        tolerance: f64,
    ) -> Check {
        let (mesh, quantity, seconds) = (mesh.to_owned(), quantity.into(), self.seconds);
        Check { case, mesh, quantity, ours, reference, scale: reference, tolerance, seconds }
    }
}

/// The region `block` of the benchmark material.
pub(crate) fn matrix_block() -> SolidSpec {
    let law = LawSpec::MooneyRivlin { c10: MATRIX.c10, c01: MATRIX.c01, bulk: MATRIX.bulk };
    SolidSpec { density: DENSITY, ..SolidSpec::new("block", law) }
}

/// Components of a node set that stay where they are.
pub(crate) fn held(set: &str, components: [bool; 3]) -> PrescribedSpec {
    PrescribedSpec { nodes: set.into(), components, displacement: Vec::new(), control: None }
}

/// Components of a node set that move by `displacement` \[m\] times a control.
pub(crate) fn moved(
    set: &str,
    components: [bool; 3],
    displacement: [f64; 3],
    control: &str,
) -> PrescribedSpec {
    let displacement = vec![displacement];
    PrescribedSpec { nodes: set.into(), components, displacement, control: Some(control.into()) }
}

/// Adds a node set of all nodes on the boundary of the first block.
pub(crate) fn name_all_boundary(mesh: &mut Mesh) {
    let faces = mesh.surfaces.values().flatten().flatten().copied();
    let nodes = unique_nodes(faces);
    mesh.node_sets.insert("boundary".into(), nodes);
}

pub(crate) const X: [bool; 3] = [true, false, false];
pub(crate) const Y: [bool; 3] = [false, true, false];
pub(crate) const Z: [bool; 3] = [false, false, true];
pub(crate) const XYZ: [bool; 3] = [true, true, true];
