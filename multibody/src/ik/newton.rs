//! Newton iteration of one frame on the poses of the five segments and the multipliers of the joint equations.

#![allow(non_snake_case)]

use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, Vector3};

use super::elimination::Elimination;
use super::{FittedFrame, joint_residual, seen_per_segment};
use crate::anatomy::rotation;
use crate::joint::Equation;
use crate::model::Model;
use crate::natural::{Coordinates, N_BLOCKS, Pose, SegmentId, block};
use crate::trial::FitVerdict;

/// Largest Newton residual of a fitted frame \[m, or m² for the gradient\].
const TOLERANCE: f64 = 1e-11;
const MAX_ITERATIONS: usize = 40;
/// Largest rotation of a segment in one step \[rad\].
const LARGEST_TURN: f64 = 0.5;
/// The downhill approach: steps at most, residual at which Newton takes over, damping of the unknowns.
const APPROACH_ITERATIONS: usize = 100;
const APPROACH_TOLERANCE: f64 = 1e-4;
const APPROACH_DAMPING: f64 = 1e-3;
/// Smallest eigenvalue of the Hessian on the joint motions, per marker-metre², below which the markers do not fix the
/// posture: 5 mm of marker error would turn a segment by more than 9 degrees.
const LEAST_STIFFNESS: f64 = 1e-3;

/// Work space of the Newton iteration for one model.
pub(super) struct Solver<'a> {
    pub(super) model: &'a Model,
    /// Rows of the joint equations.
    m: usize,
    /// Local vectors of the 20 blocks and whether the origin is added.
    local: [(Vector3<f64>, f64); N_BLOCKS],
    matrix: Elimination,
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
    pub(super) fn new(model: &'a Model) -> Self {
        let m = model.n_joint_rows();
        let local = local_blocks(model);
        Solver { model, m, local, matrix: Elimination::new(&order(model)), rhs: DVector::zeros(30 + m) }
    }

    /// `multipliers`: those of a neighbouring frame, if any. `approach`: walk downhill before Newton, for starts outside its
    /// basin.
    pub(super) fn fit(
        &mut self,
        targets: &[Option<Vector3<f64>>],
        start: &Coordinates,
        multipliers: Option<&DVector<f64>>,
        approach: bool,
    ) -> Result<FittedFrame, FitVerdict> {
        let mut poses = SegmentId::ALL.map(|s| self.model.pose(s, start));
        let mut lambda = multipliers.cloned().unwrap_or_else(|| DVector::zeros(self.m));
        let (marker_hessian, marker_load) = self.marker_terms(targets);
        let mut verdict = FitVerdict {
            failure: None,
            caution: caution(self.model, targets),
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
        if verdict.failure.is_some() {
            Err(verdict)
        } else {
            Ok(FittedFrame { Q, multipliers: lambda, verdict })
        }
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
            let mut fraction = 1.0;
            let (poses_before, lambda_before) = (*poses, lambda.clone());
            loop {
                self.step(poses, lambda, fraction);
                self.write(poses, &mut Q);
                if merit(&Q) < before || fraction < 1e-3 {
                    break;
                }
                fraction *= 0.5;
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
        self.matrix.solve(&mut self.rhs)
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
        self.matrix.clear();
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
                let r = 30 + row + k;
                for c in 0..3 {
                    for (at, value) in [(column + c, turn[c]), (column + 3 + c, origin * d[c])] {
                        self.matrix.add(r, at, value);
                        self.matrix.add(at, r, value);
                    }
                }
            });
            if exact {
                let multiplier = lambda[row];
                equation.hessian(&mut |i, j, k| S[(i, j)] += multiplier * k);
            }
            row += equation.n_rows();
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
            (0..30).for_each(|k| self.matrix.add(k, k, APPROACH_DAMPING));
        }
    }

    fn add(&mut self, row: usize, column: usize, block: &Matrix3<f64>) {
        for c in 0..3 {
            for r in 0..3 {
                self.matrix.add(row + r, column + c, block[(r, c)]);
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

    /// Moves by `fraction` of the solution in `rhs`, less where a segment would turn too far.
    fn step(&self, poses: &mut [Pose; 5], lambda: &mut DVector<f64>, fraction: f64) {
        let turn = |k: usize| Vector3::from(self.rhs.fixed_rows::<3>(6 * k));
        let largest = (0..5).map(|k| turn(k).norm()).fold(0.0, f64::max);
        let fraction = fraction * if largest > LARGEST_TURN { LARGEST_TURN / largest } else { 1.0 };
        for (k, pose) in poses.iter_mut().enumerate() {
            pose.R = rotation(&(fraction * turn(k))) * pose.R;
            pose.p += fraction * Vector3::from(self.rhs.fixed_rows::<3>(6 * k + 3));
        }
        for k in 0..self.m {
            lambda[k] += fraction * self.rhs[30 + k];
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
        let few = [foot, shank, thigh, pelvis].iter().any(|&n| n < 3);
        if verdict.residual.is_nan() || verdict.residual >= TOLERANCE {
            let why = if few { "; some segments show less than three markers" } else { "" };
            return Some(format!(
                "marker fit did not converge (residual {:.1e}){why}; {seen}",
                verdict.residual
            ));
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
        if few && self.least_stiffness() < LEAST_STIFFNESS {
            return Some(format!("the seen markers do not fix the posture; {seen}"));
        }
        None
    }

    /// Smallest eigenvalue of the Gauss-Newton Hessian of the seen markers on the motions that the joints allow.
    fn least_stiffness(&self) -> f64 {
        // The Newton matrix was assembled last at the solution: [H Cᵀ; C 0].
        let C = DMatrix::from_fn(self.m, 30, |r, c| self.matrix.at(30 + r, c));
        let H = DMatrix::from_fn(30, 30, |r, c| self.matrix.at(r, c));
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

/// Names the segments that show fewer than three markers: the joints then help to place them.
fn caution(model: &Model, targets: &[Option<Vector3<f64>>]) -> Option<String> {
    let seen = seen_per_segment(model, targets);
    let lost: Vec<String> = SegmentId::ALL
        .iter()
        .filter_map(|segment| {
            let total = model.markers.iter().filter(|m| m.segment == *segment).count();
            let seen = seen[segment.index()];
            (seen < 3 && seen < total).then(|| format!("{seen} of {total} {} markers seen", segment.name()))
        })
        .collect();
    (!lost.is_empty()).then(|| lost.join(", "))
}

/// Unknowns along the leg: foot, ankle equations, shank, knee, patella with its equations, thigh, hip, pelvis.
fn order(model: &Model) -> Vec<usize> {
    use SegmentId::{Foot, Patella, Pelvis, Shank, Thigh};
    let twist = |s: SegmentId| 6 * s.index()..6 * s.index() + 6;
    let first = |contact: &str| {
        let mut row = 30;
        for equation in &model.equations {
            if matches!(equation, Equation::Coincide { contact: c, .. } if *c == contact) {
                return row;
            }
            row += equation.n_rows();
        }
        row
    };
    let (patella, hip, end) = (first("patella"), first("hip"), 30 + model.n_joint_rows());
    let knee = patella - 5;
    twist(Foot)
        .chain(30..knee)
        .chain(twist(Shank))
        .chain(knee..patella)
        .chain(twist(Patella))
        .chain(patella..hip)
        .chain(twist(Thigh))
        .chain(hip..end)
        .chain(twist(Pelvis))
        .collect()
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
