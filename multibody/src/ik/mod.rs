//! Marker fit under joint constraints: min ½ Σ |r_marker − N Q|² subject to the joint equations
//! (Duprey, Chèze, Dumas 2010, J Biomech 43:2858), frame by frame.
//!
//! The unknowns of the Newton iteration are the poses of the five segments, so the rigid-body equations hold to
//! round-off at every step and their multipliers never appear: 30 unknowns and one multiplier per joint equation
//! instead of 60 + 48. Second derivatives are exact: those of the joint equations are constant in Q, those of a rotation
//! are ω × (ω × e). The minimiser is that of the Lagrangian F(Q, λ) of the publication.

#![allow(non_snake_case)]

mod elimination;
mod newton;

use nalgebra::{DVector, Matrix3, SVector, Vector3};
use rayon::prelude::*;

use crate::joint::Equation;
use crate::model::Model;
use crate::natural::{Coordinates, SegmentId};
use crate::trial::{FitVerdict, Trial};
use newton::Solver;
pub(crate) use newton::local_blocks;

/// Frames that one task fits one after the other, each from the one before. A constant, so that results do not depend on
/// the number of threads.
const CHUNK: usize = 16;
/// Turn of a joint away from the marker-based posture that makes a fit doubtful \[rad\].
const STRAY_ANGLE: f64 = 0.6;
/// A residual above this multiple of the trial's median plus the margin \[m\] stands out.
const OUTLIER_FACTOR: f64 = 1.5;
const OUTLIER_MARGIN: f64 = 2e-3;

/// One fitted frame.
#[derive(Clone, Debug)]
pub struct FittedFrame {
    /// Natural coordinates.
    pub Q: Coordinates,
    /// Multipliers of the joint equations, in the order of `Model::equations`.
    pub multipliers: DVector<f64>,
    /// How well.
    pub verdict: FitVerdict,
}

/// Fits all frames of the trial; frames run in parallel, results do not depend on the number of threads.
///
/// Frames that the markers do not determine, or where Newton fails, carry a posture interpolated between their
/// neighbours (so that filters have something to work on) and say so in `verdict.failure`.
pub fn fit(model: &Model, trial: &Trial) -> Vec<FittedFrame> {
    let n = trial.time.len();
    let starts: Vec<Option<Coordinates>> = (0..n).into_par_iter().map(|k| model.start(trial, k)).collect();
    let around = neighbours(&starts);
    let chunks: Vec<Vec<Result<FittedFrame, FitVerdict>>> = (0..n.div_ceil(CHUNK))
        .into_par_iter()
        .map(|c| fit_chunk(model, trial, &starts, &around, c * CHUNK..((c + 1) * CHUNK).min(n)))
        .collect();
    let mut frames: Vec<_> = chunks.into_iter().flatten().collect();
    refit_outliers(model, trial, &starts, &mut frames);
    fill_failed(model, frames)
}

/// The joint equations have several roots, and Newton may settle in one that fits the markers badly. Frames whose residual
/// stands out are fitted again from every start at hand, and the best fit is kept.
fn refit_outliers(
    model: &Model,
    trial: &Trial,
    starts: &[Option<Coordinates>],
    frames: &mut [Result<FittedFrame, FitVerdict>],
) {
    let mut rms: Vec<f64> = frames.iter().flatten().map(|f| f.verdict.marker_rms).collect();
    if rms.is_empty() {
        return;
    }
    rms.sort_by(f64::total_cmp);
    let limit = OUTLIER_FACTOR * rms[rms.len() / 2] + OUTLIER_MARGIN;
    let good: Vec<Option<Coordinates>> = frames
        .iter()
        .map(|f| f.as_ref().ok().filter(|f| f.verdict.marker_rms <= limit).map(|f| f.Q))
        .collect();
    let around = neighbours(&good);
    let refitted: Vec<(usize, FittedFrame)> = (0..frames.len())
        .into_par_iter()
        .filter(|&k| good[k].is_none())
        .filter_map(|k| {
            let mut solver = Solver::new(model);
            let targets = targets(model, trial, k);
            let before = around[k].0.and_then(|i| good[i]);
            let after = around[k].1.and_then(|i| good[i]);
            let candidates = [before, after, starts[k]];
            let fits = [false, true]
                .iter()
                .flat_map(|&approach| candidates.iter().flatten().map(move |s| (s, approach)));
            let best = fits
                .filter_map(|(start, approach)| solver.fit(&targets, start, None, approach).ok())
                .min_by(|a, b| a.verdict.marker_rms.total_cmp(&b.verdict.marker_rms))?;
            Some((k, best))
        })
        .collect();
    for (k, best) in refitted {
        let better = match &frames[k] {
            Ok(old) => best.verdict.marker_rms < old.verdict.marker_rms,
            Err(_) => true,
        };
        if better {
            frames[k] = Ok(best);
        }
    }
}

/// Nearest known frames at or before, and at or after, a frame.
type Neighbours = (Option<usize>, Option<usize>);

/// Neighbours of every frame.
fn neighbours<T>(known: &[Option<T>]) -> Vec<Neighbours> {
    let mut around = vec![(None, None); known.len()];
    let mut last = None;
    for k in 0..known.len() {
        last = known[k].as_ref().map(|_| k).or(last);
        around[k].0 = last;
    }
    last = None;
    for k in (0..known.len()).rev() {
        last = known[k].as_ref().map(|_| k).or(last);
        around[k].1 = last;
    }
    around
}

/// Seen positions of the model's markers in one frame.
fn targets(model: &Model, trial: &Trial, frame: usize) -> Vec<Option<Vector3<f64>>> {
    model.markers.iter().map(|m| trial.markers[m.track].position[frame]).collect()
}

fn fit_chunk(
    model: &Model,
    trial: &Trial,
    starts: &[Option<Coordinates>],
    around: &[Neighbours],
    frames: std::ops::Range<usize>,
) -> Vec<Result<FittedFrame, FitVerdict>> {
    let mut solver = Solver::new(model);
    let (mut previous, mut before): (Option<FittedFrame>, Option<FittedFrame>) = (None, None);
    let mut results = Vec::with_capacity(frames.len());
    for frame in frames {
        let targets = targets(model, trial, frame);
        let nearest = match around[frame] {
            (Some(before), Some(after)) => {
                starts[if frame - before <= after - frame { before } else { after }]
            }
            (before, after) => before.or(after).and_then(|k| starts[k]),
        };
        // Two fitted frames predict the next one, posture and multipliers.
        let predicted = previous.take().map(|last| {
            let guess = match before.take() {
                Some(b) => (2.0 * last.Q - b.Q, 2.0 * &last.multipliers - b.multipliers),
                None => (last.Q, last.multipliers.clone()),
            };
            before = Some(last);
            guess
        });
        let result = best_fit(&mut solver, &targets, predicted, [starts[frame], nearest]);
        previous = result.as_ref().ok().cloned();
        results.push(result);
    }
    results
}

/// Fits from the prediction, from the marker-based posture and from the nearest one, until a fit does not stray from what the markers alone suggest; if all stray, the
/// one with the least residual.
fn best_fit(
    solver: &mut Solver,
    targets: &[Option<Vector3<f64>>],
    predicted: Option<(Coordinates, DVector<f64>)>,
    starts: [Option<Coordinates>; 2],
) -> Result<FittedFrame, FitVerdict> {
    let [suggested, _] = starts;
    let mut best: Option<FittedFrame> = None;
    let mut failure = None;
    for approach in [false, true] {
        let warm = predicted.iter().map(|(Q, multipliers)| (Q, Some(multipliers)));
        let cold = starts.iter().flatten().map(|Q| (Q, None));
        for (start, multipliers) in warm.chain(cold) {
            match solver.fit(targets, start, multipliers, approach) {
                Ok(fit) if suggested.is_none_or(|s| !strays(solver.model, &fit.Q, &s)) => return Ok(fit),
                Ok(fit) => {
                    if best.as_ref().is_none_or(|b| fit.verdict.marker_rms < b.verdict.marker_rms) {
                        best = Some(fit);
                    }
                }
                Err(verdict) => failure = Some(verdict),
            }
        }
    }
    best.ok_or_else(|| {
        failure.unwrap_or_else(|| FitVerdict {
            caution: None,
            failure: Some("no start posture: too few markers in every frame".into()),
            markers_seen: seen_per_segment(solver.model, targets),
            marker_rms: f64::NAN,
            iterations: 0,
            residual: f64::NAN,
            constraint: f64::NAN,
        })
    })
}

/// Whether a joint or the pelvis is turned far from a marker-based posture: the mark of a wrong root of the joint equations
/// (the knee's second root is turned by about 75 degrees).
fn strays(model: &Model, Q: &Coordinates, suggested: &Coordinates) -> bool {
    use SegmentId::{Foot, Pelvis, Shank, Thigh};
    let R = |segment: SegmentId, Q: &Coordinates| model.pose(segment, Q).R;
    let far =
        |a: Matrix3<f64>, b: Matrix3<f64>| ((a.transpose() * b).trace() - 1.0) / 2.0 < f64::cos(STRAY_ANGLE);
    let joint = |a, b, Q: &Coordinates| R(a, Q).transpose() * R(b, Q);
    far(R(Pelvis, Q), R(Pelvis, suggested))
        || [(Pelvis, Thigh), (Thigh, Shank), (Shank, Foot)]
            .iter()
            .any(|&(a, b)| far(joint(a, b, Q), joint(a, b, suggested)))
}

fn seen_per_segment(model: &Model, targets: &[Option<Vector3<f64>>]) -> [usize; 5] {
    let mut seen = [0; 5];
    for (marker, target) in model.markers.iter().zip(targets) {
        seen[marker.segment.index()] += usize::from(target.is_some());
    }
    seen
}

/// Gives failed frames a posture between their fitted neighbours that satisfies the joint equations.
fn fill_failed(model: &Model, frames: Vec<Result<FittedFrame, FitVerdict>>) -> Vec<FittedFrame> {
    let fitted: Vec<Option<Coordinates>> = frames.iter().map(|f| f.as_ref().ok().map(|f| f.Q)).collect();
    let around = neighbours(&fitted);
    let fallback = || SVector::repeat(f64::NAN);
    let mut solver = Solver::new(model);
    frames
        .into_iter()
        .enumerate()
        .map(|(k, frame)| match frame {
            Ok(frame) => frame,
            Err(mut verdict) => {
                let before = around[k].0.and_then(|i| Some((i, fitted[i]?)));
                let after = around[k].1.and_then(|i| Some((i, fitted[i]?)));
                let (guess, how) = match (before, after) {
                    (Some((i, a)), Some((j, b))) => {
                        let fraction = (k - i) as f64 / (j - i) as f64;
                        ((1.0 - fraction) * a + fraction * b, "posture interpolated between fitted frames")
                    }
                    (Some((_, a)), None) => (a, "posture of the last fitted frame"),
                    (None, Some((_, b))) => (b, "posture of the first fitted frame"),
                    (None, None) => (fallback(), "no posture"),
                };
                // Fit the model's own markers at the guess: the nearest posture that the joints allow.
                let targets: Vec<_> = model.markers.iter().map(|m| Some(m.position.at(&guess))).collect();
                let Q = match guess
                    .iter()
                    .all(|v| v.is_finite())
                    .then(|| solver.fit(&targets, &guess, None, false))
                {
                    Some(Ok(frame)) => frame.Q,
                    _ => guess,
                };
                verdict.failure = verdict.failure.map(|f| format!("{f}; {how}"));
                FittedFrame { Q, multipliers: DVector::zeros(model.n_joint_rows()), verdict }
            }
        })
        .collect()
}

/// Residuals of the joint equations at Q.
pub fn joint_residual(equations: &[Equation], Q: &Coordinates) -> Vec<f64> {
    let mut phi = Vec::new();
    equations.iter().for_each(|e| e.residual(Q, &mut phi));
    phi
}
