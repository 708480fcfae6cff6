//! The data handed from stage to stage: Trial → Motion → [`Loads`](crate::loads::Loads) → Effort.
//!
//! Everything here is SI and written in the ground frame of the model: X forward (direction of
//! walking), Y up, Z to the right. A left leg has been mirrored to a right one (Z → −Z) before it gets here.

#![allow(non_snake_case)]

use std::ops::Range;

use nalgebra::{DMatrix, Vector3};

/// Which leg was recorded. Past the reader every leg is a right leg.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// Right leg, taken as it is.
    Right,
    /// Left leg, mirrored.
    Left,
}

impl Side {
    /// As written in files.
    pub fn name(self) -> &'static str {
        match self {
            Side::Right => "right",
            Side::Left => "left",
        }
    }
}

/// Sex, which selects the segment tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sex {
    /// Tables of men.
    Male,
    /// Tables of women.
    Female,
}

/// Who was recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct Subject {
    /// Name or code.
    pub name: String,
    /// Body mass \[kg\].
    pub mass: f64,
    /// Standing height \[m\].
    pub height: f64,
    /// Selects the table of segment inertia.
    pub sex: Sex,
}

/// The path of one marker.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkerTrack {
    /// Name as in the recording.
    pub name: String,
    /// Segment that carries it.
    pub segment: crate::natural::SegmentId,
    /// Position in ground at each frame \[m\]; `None` where it was not seen.
    pub position: Vec<Option<Vector3<f64>>>,
}

/// Force of the ground on the foot of the leg under study.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GroundReaction {
    /// Sample times \[s\], increasing; may be faster than the markers.
    pub time: Vec<f64>,
    /// Force on the foot, in ground \[N\].
    pub force: Vec<Vector3<f64>>,
    /// Moment on the foot about the origin of ground \[N·m\].
    pub moment: Vec<Vector3<f64>>,
}

/// Low-pass filters of a trial.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filters {
    /// Cut-off for velocities and accelerations \[Hz\], applied after each differentiation.
    pub motion_hz: f64,
    /// Cut-off for ground force and moment \[Hz\]; `None` leaves them as they are.
    pub force_hz: Option<f64>,
    /// Vertical force below which there is no contact \[N\].
    pub contact_threshold: f64,
}

/// One recorded or synthesised trial, ready for the marker fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Short name, used for the output folder.
    pub name: String,
    /// Leg that was recorded.
    pub side: Side,
    /// Who was recorded.
    pub subject: Subject,
    /// Frame times \[s\], uniform.
    pub time: Vec<f64>,
    /// Frames that are reported; the frames around them only feed the filters.
    pub report: Range<usize>,
    /// The markers that the trial file assigns to segments.
    pub markers: Vec<MarkerTrack>,
    /// Ground reaction on the leg under study.
    pub ground: GroundReaction,
}

/// Numbers with named columns, one row per frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// One name per column.
    pub columns: Vec<String>,
    /// n_frames × n_columns.
    pub values: DMatrix<f64>,
}

impl Table {
    /// The column called `name`, with or without `_N`.
    pub fn column(&self, name: &str) -> Option<Vec<f64>> {
        let j = self.columns.iter().position(|c| c.strip_suffix("_N").unwrap_or(c) == name)?;
        Some(self.values.column(j).iter().copied().collect())
    }
}

/// How well one frame of markers was fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct FitVerdict {
    /// `None` when fitted; otherwise why not, in words, with the counts of markers seen.
    pub failure: Option<String>,
    /// What makes a fitted frame less certain than others: markers of a segment lost, a gap close by.
    pub caution: Option<String>,
    /// Markers seen in this frame per segment: foot, shank, patella, thigh, pelvis.
    pub markers_seen: [usize; 5],
    /// Root mean square distance of the seen markers from the model \[m\].
    pub marker_rms: f64,
    /// Newton steps.
    pub iterations: usize,
    /// Norm of the Newton residual at the end.
    pub residual: f64,
    /// Largest joint or rigid-body equation \[m, or 1 for unit vectors\].
    pub constraint: f64,
}

/// Posture, velocity and acceleration of the leg. Rows: all frames of the trial.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Frame times \[s\].
    pub time: Vec<f64>,
    /// Frames that are reported.
    pub report: Range<usize>,
    /// Natural coordinates per frame (foot, shank, patella, thigh, pelvis; u, rP, rD, w).
    pub Q: Vec<crate::natural::Coordinates>,
    /// dQ/dt \[m/s or 1/s\].
    pub Qd: Vec<crate::natural::Coordinates>,
    /// d²Q/dt² \[m/s² or 1/s²\].
    pub Qdd: Vec<crate::natural::Coordinates>,
    /// Joint angles \[rad\], columns without unit suffix: `hip_flexion`, `hip_adduction`, …
    pub angles: Table,
    /// Per frame: was it fitted, how well.
    pub fit: Vec<FitVerdict>,
}

impl Motion {
    /// Root mean square over the fitted reported frames of the marker residual \[m\]; zero where none was fitted.
    pub fn marker_rms(&self) -> f64 {
        let fits = self.fit[self.report.clone()].iter().filter(|f| f.failure.is_none());
        let (sum, count) = fits.fold((0.0, 0usize), |(s, n), f| (s + f.marker_rms.powi(2), n + 1));
        (sum / count.max(1) as f64).sqrt()
    }
}

/// How one frame of force sharing ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Optimal: the recomputed KKT residual is below the tolerance.
    Solved,
    /// No forces within the bounds carry the load; the least-violation answer is reported.
    Infeasible,
    /// No answer; `reason` says why.
    Failed,
}

/// What a frame lacks in one coordinate.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Shortfall {
    /// Joint coordinate, e.g. `hip_adduction`.
    pub coordinate: String,
    /// Moment that no admissible muscle force supplies, signed \[N·m\].
    pub missing: f64,
}

/// Verdict on one frame of force sharing. All residuals are recomputed from the answer, not the solver's word.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Verdict {
    /// Solved, infeasible or failed.
    pub status: Status,
    /// Why, when not solved.
    pub reason: Option<String>,
    /// Scaled Karush-Kuhn-Tucker residual of the problem as posed.
    pub kkt_residual: f64,
    /// Largest violated equality, relative to the largest required moment or 1 N·m.
    pub equality_residual: f64,
    /// Iterations of the solver.
    pub iterations: u32,
    /// Bounds that hold with a positive multiplier.
    pub active_bounds: usize,
    /// Fraction of the required moment that reserves carry, 0..1.
    pub reserve_share: f64,
    /// Coordinates that lack moment (infeasible frames).
    pub shortfall: Vec<Shortfall>,
    /// Muscles at their upper bound.
    pub saturated: Vec<String>,
}

/// Muscle, contact, ligament and bone forces and activations. Rows: reported frames only.
///
/// Frames that are not [`Status::Solved`] hold NaN, written as empty cells: what is no solution enters no curve and no statistic.
#[derive(Clone, Debug, PartialEq)]
pub struct Effort {
    /// Times of the reported frames \[s\].
    pub time: Vec<f64>,
    /// Tension per muscle \[N\], columns named like the muscle.
    pub forces: Table,
    /// Activation per muscle, 0..1.
    pub activations: Table,
    /// Joint contact, ligament, tendon and bone forces \[N\].
    pub reactions: Table,
    /// Reserve moments per joint coordinate \[N·m\]; no columns where no reserves were asked for.
    pub reserves: Table,
    /// Of infeasible frames the answer of least violation, or that of the raised strengths that were asked for: the columns of
    /// `forces`, then those of `reactions` \[N\]. All other frames hold NaN.
    pub least_violation: Table,
    /// Per frame.
    pub verdicts: Vec<Verdict>,
}
