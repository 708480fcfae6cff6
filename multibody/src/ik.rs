//! Marker fit under joint constraints: min ½ Σ |r_marker − N Q|² subject to the joint equations
//! (Duprey, Chèze, Dumas 2010, J Biomech 43:2858), frame by frame.
//!
//! The unknowns of the Newton iteration are the poses of the five segments, so the rigid-body equations hold to
//! round-off at every step and their multipliers never appear: 30 unknowns and one multiplier per joint equation
//! instead of 60 + 48. Second derivatives are exact: those of the joint equations are constant in Q, those of a rotation
//! are ω × (ω × e). The minimiser is that of the Lagrangian F(Q, λ) of the publication.

#![allow(non_snake_case)]

use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, SVector, Vector3};
use rayon::prelude::*;

use crate::anatomy::rotation;
use crate::joint::Equation;
use crate::model::Model;
use crate::natural::{Coordinates, N_BLOCKS, Pose, SegmentId, block};
use crate::trial::{FitVerdict, Trial};

/// Frames that one task fits one after the other, each from the one before. A constant, so that results do not depend on
/// the number of threads.
const CHUNK: usize = 16;
/// Largest Newton residual of a fitted frame \[m, or m² for the gradient\].
const TOLERANCE: f64 = 1e-11;
const MAX_ITERATIONS: usize = 40;
/// Largest rotation of a segment in one step \[rad\].
const LARGEST_TURN: f64 = 0.5;
/// Turn of a joint away from the marker-based posture that makes a fit doubtful \[rad\].
const STRAY_ANGLE: f64 = 0.6;
/// A residual above this multiple of the trial's median plus the margin \[m\] stands out.
const OUTLIER_FACTOR: f64 = 1.5;
const OUTLIER_MARGIN: f64 = 2e-3;
/// The downhill approach: steps at most, residual at which Newton takes over, damping of the unknowns.
const APPROACH_ITERATIONS: usize = 100;
const APPROACH_TOLERANCE: f64 = 1e-4;
const APPROACH_DAMPING: f64 = 1e-3;
/// Smallest eigenvalue of the Hessian on the joint motions, per marker-metre², below which the markers do not fix the
/// posture: 5 mm of marker error would turn a segment by more than 9 degrees.
const LEAST_STIFFNESS: f64 = 1e-3;

/// One fitted frame.
#[derive(Clone, Debug)]
pub struct FittedFrame {
    /// Natural coordinates.
    pub Q: Coordinates,
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
    let chunks: Vec<Vec<Result<FittedFrame, FitVerdict>>> = (0..n.div_ceil(CHUNK))
        .into_par_iter()
        .map(|c| fit_chunk(model, trial, &starts, c * CHUNK..((c + 1) * CHUNK).min(n)))
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
    let refitted: Vec<(usize, FittedFrame)> = (0..frames.len())
        .into_par_iter()
        .filter(|&k| good[k].is_none())
        .filter_map(|k| {
            let mut solver = Solver::new(model);
            let targets = targets(model, trial, k);
            let before = (0..k).rev().find_map(|i| good[i]);
            let after = (k + 1..good.len()).find_map(|i| good[i]);
            let candidates = [before, after, starts[k]];
            let fits = [false, true]
                .iter()
                .flat_map(|&approach| candidates.iter().flatten().map(move |s| (s, approach)));
            let best = fits
                .filter_map(|(start, approach)| solver.fit(&targets, start, approach).ok())
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

/// Seen positions of the model's markers in one frame.
fn targets(model: &Model, trial: &Trial, frame: usize) -> Vec<Option<Vector3<f64>>> {
    model.markers.iter().map(|m| trial.markers[m.track].position[frame]).collect()
}

fn fit_chunk(
    model: &Model,
    trial: &Trial,
    starts: &[Option<Coordinates>],
    frames: std::ops::Range<usize>,
) -> Vec<Result<FittedFrame, FitVerdict>> {
    let mut solver = Solver::new(model);
    let mut previous: Option<Coordinates> = None;
    let mut results = Vec::with_capacity(frames.len());
    for frame in frames {
        let targets = targets(model, trial, frame);
        let nearest = || {
            let distance = |k: &usize| k.abs_diff(frame);
            (0..starts.len()).filter(|&k| starts[k].is_some()).min_by_key(distance).and_then(|k| starts[k])
        };
        let result = best_fit(&mut solver, &targets, [previous, starts[frame], nearest()], starts[frame]);
        previous = result.as_ref().ok().map(|f| f.Q);
        results.push(result);
    }
    results
}

/// Fits from one start after the other until a fit does not stray from what the markers alone suggest; if all stray, the
/// one with the least residual.
fn best_fit(
    solver: &mut Solver,
    targets: &[Option<Vector3<f64>>],
    starts: [Option<Coordinates>; 3],
    suggested: Option<Coordinates>,
) -> Result<FittedFrame, FitVerdict> {
    let mut best: Option<FittedFrame> = None;
    let mut failure = None;
    for approach in [false, true] {
        for start in starts.iter().flatten() {
            match solver.fit(targets, start, approach) {
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

/// Work space of the Newton iteration for one model.
struct Solver<'a> {
    model: &'a Model,
    /// Rows of the joint equations.
    m: usize,
    /// Local vectors of the 20 blocks and whether the origin is added.
    local: [(Vector3<f64>, f64); N_BLOCKS],
    matrix: DMatrix<f64>,
    rhs: DVector<f64>,
}

/// Which second derivatives the Newton matrix holds.
#[derive(Clone, Copy, PartialEq)]
enum Curvature {
    Exact,
    GaussNewton,
}

type Blocks = SMatrix<f64, N_BLOCKS, N_BLOCKS>;
type Gradient = [Vector3<f64>; N_BLOCKS];

impl<'a> Solver<'a> {
    fn new(model: &'a Model) -> Self {
        let m = model.n_joint_rows();
        let local = local_blocks(model);
        Solver { model, m, local, matrix: DMatrix::zeros(30 + m, 30 + m), rhs: DVector::zeros(30 + m) }
    }

    /// `approach`: walk downhill before Newton, for starts outside its basin.
    fn fit(
        &mut self,
        targets: &[Option<Vector3<f64>>],
        start: &Coordinates,
        approach: bool,
    ) -> Result<FittedFrame, FitVerdict> {
        let mut poses = SegmentId::ALL.map(|s| self.model.pose(s, start));
        let mut lambda = DVector::zeros(self.m);
        let (marker_hessian, marker_load) = self.marker_terms(targets);
        let mut verdict = FitVerdict {
            failure: None,
            markers_seen: seen_per_segment(self.model, targets),
            marker_rms: f64::NAN,
            iterations: 0,
            residual: f64::INFINITY,
            constraint: f64::INFINITY,
        };
        if approach {
            verdict.iterations +=
                self.approach(targets, &mut poses, &mut lambda, &marker_hessian, &marker_load);
        }
        let (limit, mut Q) = (verdict.iterations + MAX_ITERATIONS, *start);
        loop {
            self.write(&poses, &mut Q);
            self.assemble(&Q, &poses, &lambda, &marker_hessian, &marker_load, Curvature::Exact);
            verdict.residual = self.rhs.norm();
            if !verdict.residual.is_finite() || verdict.residual < TOLERANCE {
                break;
            }
            if verdict.iterations == limit {
                break;
            }
            verdict.iterations += 1;
            if !self.solve() {
                verdict.residual = f64::NAN;
                break;
            }
            self.step(&mut poses, &mut lambda, 1.0);
        }
        verdict.constraint = self.constraint(&Q);
        verdict.marker_rms = marker_rms(self.model, &Q, targets);
        verdict.failure = self.failure(&verdict, &Q);
        if verdict.failure.is_some() { Err(verdict) } else { Ok(FittedFrame { Q, verdict }) }
    }

    /// Sequential quadratic steps with the positive definite Gauss-Newton Hessian and a line search on the merit
    /// ½ Σ |r|² + μ Σ |φ|. Slower than Newton, but it descends from far away.
    fn approach(
        &mut self,
        targets: &[Option<Vector3<f64>>],
        poses: &mut [Pose; 5],
        lambda: &mut DVector<f64>,
        marker_hessian: &Blocks,
        marker_load: &Gradient,
    ) -> usize {
        let mut Q = Coordinates::zeros();
        for iteration in 0..APPROACH_ITERATIONS {
            self.write(poses, &mut Q);
            self.assemble(&Q, poses, lambda, marker_hessian, marker_load, Curvature::GaussNewton);
            if self.rhs.norm() < APPROACH_TOLERANCE || !self.solve() {
                return iteration;
            }
            let weight =
                0.1 + 2.0 * (0..self.m).map(|k| (lambda[k] + self.rhs[30 + k]).abs()).fold(0.0, f64::max);
            let merit = |Q: &Coordinates| {
                let phi = joint_residual(&self.model.equations, Q);
                let distance = |(marker, target): (&crate::model::ModelMarker, &Option<Vector3<f64>>)| {
                    target.map_or(0.0, |t| (marker.position.at(Q) - t).norm_squared())
                };
                let markers: f64 = self.model.markers.iter().zip(targets).map(distance).sum();
                0.5 * markers + weight * phi.iter().map(|v| v.abs()).sum::<f64>()
            };
            let before = merit(&Q);
            let mut share = 1.0;
            let (poses_before, lambda_before) = (*poses, lambda.clone());
            loop {
                self.step(poses, lambda, share);
                self.write(poses, &mut Q);
                if merit(&Q) < before || share < 1e-3 {
                    break;
                }
                share *= 0.5;
                *poses = poses_before;
                lambda.copy_from(&lambda_before);
            }
        }
        APPROACH_ITERATIONS
    }

    fn write(&self, poses: &[Pose; 5], Q: &mut Coordinates) {
        for segment in SegmentId::ALL {
            self.model.shapes[segment.index()].write(segment, &poses[segment.index()], Q);
        }
    }

    /// Overwrites `rhs` with the solution; `false` when the matrix is singular.
    fn solve(&mut self) -> bool {
        let matrix = std::mem::replace(&mut self.matrix, DMatrix::zeros(0, 0));
        let solved = matrix.lu().solve_mut(&mut self.rhs);
        self.matrix = DMatrix::zeros(30 + self.m, 30 + self.m);
        solved
    }

    /// Σ n nᵀ over the seen markers, and Σ n r.
    fn marker_terms(&self, targets: &[Option<Vector3<f64>>]) -> (Blocks, Gradient) {
        let mut S = Blocks::zeros();
        let mut t = [Vector3::zeros(); N_BLOCKS];
        for (marker, target) in self.model.markers.iter().zip(targets) {
            let Some(target) = target else { continue };
            for &(i, ki) in &marker.position.terms {
                t[i] += ki * target;
                for &(j, kj) in &marker.position.terms {
                    S[(i, j)] += ki * kj;
                }
            }
        }
        (S, t)
    }

    /// Newton matrix [H Cᵀ; C 0] into `matrix` and −[gradient; φ] into `rhs`.
    fn assemble(
        &mut self,
        Q: &Coordinates,
        poses: &[Pose; 5],
        lambda: &DVector<f64>,
        marker_hessian: &Blocks,
        marker_load: &Gradient,
        curvature: Curvature,
    ) {
        let exact = curvature == Curvature::Exact;
        let mut S = *marker_hessian;
        let mut gradient: Gradient = std::array::from_fn(|i| {
            let segment = i / 4 * 4;
            (segment..segment + 4).map(|j| marker_hessian[(i, j)] * block(Q, j)).sum::<Vector3<f64>>()
                - marker_load[i]
        });
        let arms: [Vector3<f64>; N_BLOCKS] = std::array::from_fn(|i| poses[i / 4].R * self.local[i].0);
        self.matrix.fill(0.0);
        let mut row = 0;
        let mut phi = Vec::with_capacity(self.m);
        for equation in &self.model.equations {
            equation.residual(Q, &mut phi);
            equation.jacobian(Q, &mut |k, b, d| {
                let multiplier = lambda[row + k];
                gradient[b] += multiplier * d;
                let column = 6 * (b / 4);
                let turn = arms[b].cross(&d);
                let origin = self.local[b].1;
                for c in 0..3 {
                    let r = 30 + row + k;
                    self.matrix[(r, column + c)] += turn[c];
                    self.matrix[(r, column + 3 + c)] += origin * d[c];
                }
            });
            if exact {
                let multiplier = lambda[row];
                equation.hessian(&mut |i, j, k| S[(i, j)] += multiplier * k);
            }
            row += equation.n_rows();
        }
        for r in 30..30 + self.m {
            for c in 0..30 {
                self.matrix[(c, r)] = self.matrix[(r, c)];
            }
        }
        self.rhs.fill(0.0);
        for i in 0..N_BLOCKS {
            let base = 6 * (i / 4);
            let (e, origin, g) = (arms[i], self.local[i].1, gradient[i]);
            let turn = e.cross(&g);
            for c in 0..3 {
                self.rhs[base + c] -= turn[c];
                self.rhs[base + 3 + c] -= origin * g[c];
            }
            if exact {
                // g · (½ ω × (ω × e)): curvature of the rotation.
                let bend = 0.5 * (e * g.transpose() + g * e.transpose()) - Matrix3::identity() * e.dot(&g);
                self.add(base, base, &bend);
            }
            for j in 0..N_BLOCKS {
                let s = S[(i, j)];
                if s != 0.0 {
                    self.add_pair(base, 6 * (j / 4), s, (&e, origin), (&arms[j], self.local[j].1));
                }
            }
        }
        for (k, value) in phi.iter().enumerate() {
            self.rhs[30 + k] = -value;
        }
        if !exact {
            (0..30).for_each(|k| self.matrix[(k, k)] += APPROACH_DAMPING);
        }
    }

    fn add(&mut self, row: usize, column: usize, block: &Matrix3<f64>) {
        for c in 0..3 {
            for r in 0..3 {
                self.matrix[(row + r, column + c)] += block[(r, c)];
            }
        }
    }

    /// s · Dᵢᵀ Dⱼ with D = [−e×, origin E]: derivative of a block by the turn and shift of its segment.
    fn add_pair(
        &mut self,
        row: usize,
        column: usize,
        s: f64,
        (ei, oi): (&Vector3<f64>, f64),
        (ej, oj): (&Vector3<f64>, f64),
    ) {
        // (ω_i × e_i)·(ω_j × e_j) = ω_i·((e_i·e_j) ω_j − e_j (e_i·ω_j))... as a matrix: (e_i·e_j) E − e_j e_iᵀ
        let turn_turn = Matrix3::identity() * ei.dot(ej) - ej * ei.transpose();
        self.add(row, column, &(s * turn_turn));
        if oj != 0.0 {
            self.add(row, column + 3, &(s * oj * ei.cross_matrix()));
        }
        if oi != 0.0 {
            self.add(row + 3, column, &(-s * oi * ej.cross_matrix()));
        }
        if oi != 0.0 && oj != 0.0 {
            self.add(row + 3, column + 3, &(Matrix3::identity() * (s * oi * oj)));
        }
    }

    /// Moves by `share` of the solution in `rhs`, less where a segment would turn too far.
    fn step(&self, poses: &mut [Pose; 5], lambda: &mut DVector<f64>, share: f64) {
        let turn = |k: usize| Vector3::from(self.rhs.fixed_rows::<3>(6 * k));
        let largest = (0..5).map(|k| turn(k).norm()).fold(0.0, f64::max);
        let share = share * if largest > LARGEST_TURN { LARGEST_TURN / largest } else { 1.0 };
        for (k, pose) in poses.iter_mut().enumerate() {
            pose.R = rotation(&(share * turn(k))) * pose.R;
            pose.p += share * Vector3::from(self.rhs.fixed_rows::<3>(6 * k + 3));
        }
        for k in 0..self.m {
            lambda[k] += share * self.rhs[30 + k];
        }
    }

    fn constraint(&self, Q: &Coordinates) -> f64 {
        let mut phi = Vec::with_capacity(self.m);
        self.model.equations.iter().for_each(|e| e.residual(Q, &mut phi));
        let joints = phi.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        SegmentId::ALL.iter().fold(joints, |m, s| m.max(self.model.shapes[s.index()].rigid_residual(*s, Q)))
    }

    fn failure(&self, verdict: &FitVerdict, Q: &Coordinates) -> Option<String> {
        let [foot, shank, _, thigh, pelvis] = verdict.markers_seen;
        let seen = format!("markers seen: pelvis {pelvis}, thigh {thigh}, shank {shank}, foot {foot}");
        if !(verdict.residual < TOLERANCE) {
            return Some(format!("marker fit did not converge (residual {:.1e}); {seen}", verdict.residual));
        }
        let thigh_pose = self.model.pose(SegmentId::Thigh, Q);
        let knee = block(Q, SegmentId::Thigh.block(2));
        let patella = block(Q, SegmentId::Patella.block(1));
        let forward = (patella - knee).dot(&thigh_pose.R.column(0));
        if forward < 0.0 {
            return Some(format!(
                "marker fit ended with the patella {:.0} mm behind the knee",
                -1e3 * forward
            ));
        }
        if [foot, shank, thigh, pelvis].iter().any(|&n| n < 3) {
            if self.least_stiffness() < LEAST_STIFFNESS {
                return Some(format!("the seen markers do not fix the posture; {seen}"));
            }
        }
        None
    }

    /// Smallest eigenvalue of the Gauss-Newton Hessian of the seen markers on the motions that the joints allow.
    fn least_stiffness(&self) -> f64 {
        // The Newton matrix was assembled last at the solution: [H Cᵀ; C 0].
        let C = self.matrix.view((30, 0), (self.m, 30)).into_owned();
        let H = self.matrix.view((0, 0), (30, 30)).into_owned();
        let eigen = (C.transpose() * &C).symmetric_eigen();
        let largest = eigen.eigenvalues.max();
        let free: Vec<DVector<f64>> = (0..30)
            .filter(|&k| eigen.eigenvalues[k] < 1e-12 * largest)
            .map(|k| eigen.eigenvectors.column(k).into_owned())
            .collect();
        if free.is_empty() {
            return f64::INFINITY;
        }
        let Z = DMatrix::from_columns(&free);
        (Z.transpose() * H * Z).symmetric_eigenvalues().min()
    }
}

/// Local vectors of the 20 blocks and whether the segment's origin is added.
pub(crate) fn local_blocks(model: &Model) -> [(Vector3<f64>, f64); N_BLOCKS] {
    let per_segment = model.shapes.map(|s| s.local_blocks());
    std::array::from_fn(|i| per_segment[i / 4][i % 4])
}

fn marker_rms(model: &Model, Q: &Coordinates, targets: &[Option<Vector3<f64>>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (marker, target) in model.markers.iter().zip(targets) {
        if let Some(target) = target {
            sum += (marker.position.at(Q) - target).norm_squared();
            count += 1.0;
        }
    }
    if count > 0.0 { f64::sqrt(sum / count) } else { f64::NAN }
}

/// Gives failed frames a posture between their fitted neighbours that satisfies the joint equations.
fn fill_failed(model: &Model, frames: Vec<Result<FittedFrame, FitVerdict>>) -> Vec<FittedFrame> {
    let fitted: Vec<Option<Coordinates>> = frames.iter().map(|f| f.as_ref().ok().map(|f| f.Q)).collect();
    let fallback = || SVector::repeat(f64::NAN);
    let mut solver = Solver::new(model);
    frames
        .into_iter()
        .enumerate()
        .map(|(k, frame)| match frame {
            Ok(frame) => frame,
            Err(mut verdict) => {
                let before = (0..k).rev().find_map(|i| Some((i, fitted[i]?)));
                let after = (k + 1..fitted.len()).find_map(|i| Some((i, fitted[i]?)));
                let (guess, how) = match (before, after) {
                    (Some((i, a)), Some((j, b))) => {
                        let share = (k - i) as f64 / (j - i) as f64;
                        ((1.0 - share) * a + share * b, "posture interpolated between fitted frames")
                    }
                    (Some((_, a)), None) => (a, "posture of the last fitted frame"),
                    (None, Some((_, b))) => (b, "posture of the first fitted frame"),
                    (None, None) => (fallback(), "no posture"),
                };
                // Fit the model's own markers at the guess: the nearest posture that the joints allow.
                let targets: Vec<_> = model.markers.iter().map(|m| Some(m.position.at(&guess))).collect();
                let Q = match guess.iter().all(|v| v.is_finite()).then(|| solver.fit(&targets, &guess, false))
                {
                    Some(Ok(frame)) => frame.Q,
                    _ => guess,
                };
                verdict.failure = verdict.failure.map(|f| format!("{f}; {how}"));
                FittedFrame { Q, verdict }
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
