//! The report page: one self-contained file with figures inside.
//!
//! The page shows results only, no times and no dates, so the same results give the same bytes; what a run cost
//! stands in `run.json`.

#![allow(non_snake_case)]

pub mod anatomy;
pub mod both;
pub mod compare;
pub mod cost;
mod decades;
pub mod deep_cost;
pub mod deep_flexion;
mod details;
mod figures;
pub mod groups;
pub mod heatmap;
mod knee_sections;
pub mod mesh;
mod optimize;
pub mod page;
pub mod plot;
pub mod problems;
pub mod reserves;
pub mod study;
pub mod svg;

use multibody::emg::{self, Compared};
use multibody::loads::Loads;
use multibody::trial::{Effort, Motion, Status, Table, Trial};
use serde::Serialize;

use crate::output::tables::Series;
use coupling::measured::{Agreement, Overlay};
use coupling::optimize::WithThigh;
use coupling::samples::Samples;

pub use optimize::optimize_page;
pub use reserves::Reserve;

/// Above this vertical ground force \[N\] the foot counts as standing; the threshold of the recorded trials' events.
pub const STANCE_THRESHOLD: f64 = 20.0;

/// What the page says about one muscle beside its curves.
#[derive(Clone, Debug, PartialEq)]
pub struct MuscleInfo {
    /// Anatomical name.
    pub full_name: String,
    /// Strength: the force that bounds it, or its maximal isometric force where sharing knows no bound \[N\].
    pub f_max: f64,
    /// Fraction of frames in which no activation within 0..1 gives the force, 0..1; `None` where not computed.
    pub clipped: Option<f64>,
}

/// Everything that the report of `optimize` shows. Borrowed: the page changes nothing.
#[derive(Clone, Copy, Debug)]
pub struct OptimizeReport<'a> {
    /// What was recorded.
    pub trial: &'a Trial,
    /// Posture and quality of the marker fit.
    pub motion: &'a Motion,
    /// What the joints carry.
    pub loads: &'a Loads,
    /// Forces, activations and verdicts.
    pub effort: &'a Effort,
    /// One per column of `effort.forces`, in that order.
    pub muscles: &'a [MuscleInfo],
    /// Heel strike to next heel strike of the leg under study \[s\]; `None` where the frames are no full cycle.
    pub cycle: Option<[f64; 2]>,
    /// Settings as label and value, in the order to show.
    pub settings: &'a [(String, String)],
    /// Effects that were simulated, one sentence each.
    pub simulated: &'a [String],
    /// Effects that were left out and why.
    pub left_out: &'a [(String, String)],
    /// What the reader must know: warnings about the input, assumptions made.
    pub notes: &'a [String],
    /// Comparison with an instrumented knee.
    pub measured: Option<&'a Overlay>,
    /// Least and greatest joint forces over all admissible sharings; absent where they were not asked for.
    pub bands: Option<&'a Table>,
    /// Passive joint moments beside those of the muscles; absent where they are left out.
    pub passive: Option<&'a Table>,
    /// Electromyography beside muscle forces.
    pub emg: Option<&'a [Compared]>,
    /// Forces shared with what the muscles of the deformable thigh can do.
    pub with_thigh: Option<&'a WithThigh>,
    /// The trial with inputs that scatter; absent where it was not asked for.
    pub samples: Option<&'a Samples>,
    /// The motion in coordinates of OpenSim's gait2392; absent where there is no model of the leg.
    pub gait2392: Option<&'a Series>,
}

/// The numbers that decide: head of the report, verdict of `run.json`, output of `--json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Frames reported.
    pub frames: usize,
    /// Frames that were fitted and whose force sharing is optimal.
    pub solved: usize,
    /// Frames whose loads no admissible forces carry.
    pub infeasible: usize,
    /// Frames without answer.
    pub failed: usize,
    /// Frames whose markers were not fitted (whatever became of force sharing).
    pub not_fitted: usize,
    /// Largest medial plus lateral knee force over solved frames \[N\].
    pub peak_knee_force_N: Option<f64>,
    /// The same in body weights.
    pub peak_knee_force_bw: Option<f64>,
    /// When \[s\].
    pub peak_knee_force_time_s: Option<f64>,
    /// Frames that were fitted with less certainty: markers of a segment lost, or a gap close by.
    pub cautions: usize,
    /// Root mean square over fitted frames of the marker residual \[mm\].
    pub marker_rms_mm: Option<f64>,
    /// Largest marker residual of a frame \[mm\].
    pub worst_marker_rms_mm: Option<f64>,
    /// Largest KKT residual among the solved frames.
    pub largest_kkt_residual: Option<f64>,
    /// Largest muscle force relative to its strength, over solved frames.
    pub largest_load: Option<f64>,
    /// The muscle that carries it.
    pub largest_load_muscle: Option<String>,
    /// Largest fraction of the required moments of a solved frame that reserves carry, all joint coordinates together.
    pub largest_reserve_share: f64,
    /// When \[s\]; `None` without reserves.
    pub largest_reserve_share_time_s: Option<f64>,
    /// The most that each reserve carries; empty without reserves.
    pub reserves: Vec<Reserve>,
    /// Fraction of force samples of solved frames that activations within 0..1 cannot give, over all muscles.
    pub clipped_share: Option<f64>,
    /// Mean concordance with electromyography over the channels without defect, 0..1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub emg_concordance: Option<f64>,
    /// Agreement with measured medial, lateral and total knee force, over the compared frames alone.
    pub measured: Option<[(&'static str, Agreement); 3]>,
    /// Frames that are solved and measured.
    pub compared_frames: Option<usize>,
}

impl Summary {
    /// Counts and extremes of a report.
    pub fn of(report: &OptimizeReport) -> Summary {
        let (motion, effort) = (report.motion, report.effort);
        let fits = &motion.fit[motion.report.clone()];
        let count = |status| effort.verdicts.iter().filter(|v| v.status == status).count();
        let fitted = |i: usize| fits[i].failure.is_none();
        let solved = |i: &usize| fitted(*i) && effort.verdicts[*i].status == Status::Solved;
        let frames = effort.time.len();

        let knee = total_knee_force(effort).unwrap_or_default();
        let peak = greatest((0..knee.len()).filter(solved).map(|i| (knee[i], i)));
        let rms: Vec<f64> = fits
            .iter()
            .filter(|f| f.failure.is_none() && f.marker_rms.is_finite())
            .map(|f| f.marker_rms * 1e3)
            .collect();
        let squares: f64 = rms.iter().map(|v| v * v).sum();
        let kkt = (0..frames).filter(solved).map(|i| (effort.verdicts[i].kkt_residual, i));
        let load = greatest(report.muscles.iter().enumerate().flat_map(|(j, m)| {
            effort.forces.values.column(j).iter().map(|f| (f / m.f_max, j)).collect::<Vec<_>>()
        }));
        let clipped: Vec<f64> = report.muscles.iter().filter_map(|m| m.clipped).collect();
        let weight = report.body_weight();
        let reserve = greatest((0..frames).filter(solved).map(|i| (effort.verdicts[i].reserve_share, i)))
            .filter(|_| !effort.reserves.columns.is_empty());
        Summary {
            frames,
            solved: (0..frames).filter(solved).count(),
            infeasible: count(Status::Infeasible),
            failed: count(Status::Failed),
            cautions: fits.iter().filter(|f| f.failure.is_none() && f.caution.is_some()).count(),
            not_fitted: fits.iter().filter(|f| f.failure.is_some()).count(),
            peak_knee_force_N: peak.map(|p| p.0),
            peak_knee_force_bw: peak.map(|p| p.0 / weight),
            peak_knee_force_time_s: peak.map(|p| effort.time[p.1]),
            marker_rms_mm: (!rms.is_empty()).then(|| (squares / rms.len() as f64).sqrt()),
            worst_marker_rms_mm: svg::extent(&rms).map(|e| e.1),
            largest_kkt_residual: greatest(kkt).map(|k| k.0),
            largest_load: load.map(|l| l.0),
            largest_load_muscle: load.map(|l| effort.forces.columns[l.1].clone()),
            largest_reserve_share: reserve.map_or(0.0, |r| r.0),
            largest_reserve_share_time_s: reserve.map(|r| effort.time[r.1]),
            reserves: Reserve::of(effort, report.loads),
            clipped_share: (!clipped.is_empty()).then(|| clipped.iter().sum::<f64>() / clipped.len() as f64),
            emg_concordance: report.emg.and_then(emg::overall),
            measured: report.measured.map(|o| o.curves().map(|(name, c)| (name, c.agreement.clone()))),
            compared_frames: report.measured.map(|o| o.time.len()),
        }
    }

    /// `58 of 241 frames`, for numbers that solved frames alone enter; `None` where that is all of them.
    pub fn over(&self) -> Option<String> {
        (!self.all_solved()).then(|| format!("{} of {} frames", self.solved, self.frames))
    }

    /// Is every frame solved?
    pub fn all_solved(&self) -> bool {
        self.frames > 0 && self.solved == self.frames
    }
}

impl OptimizeReport<'_> {
    /// Body weight \[N\].
    pub fn body_weight(&self) -> f64 {
        self.trial.subject.mass * coupling::subject::GRAVITY
    }
}

/// Medial plus lateral tibiofemoral force per frame \[N\]; `None` where the model has no such columns.
pub fn total_knee_force(effort: &Effort) -> Option<Vec<f64>> {
    let (medial, lateral) =
        (effort.reactions.column("knee_medial")?, effort.reactions.column("knee_lateral")?);
    Some(medial.iter().zip(&lateral).map(|(m, l)| m + l).collect())
}

/// The greatest finite value with what comes along; the first of equals.
fn greatest<T>(values: impl Iterator<Item = (f64, T)>) -> Option<(f64, T)> {
    values.filter(|(v, _)| v.is_finite()).reduce(|best, next| if next.0 > best.0 { next } else { best })
}
