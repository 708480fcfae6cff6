//! Joint angles of a posture, the coupled knee, and velocities and accelerations that satisfy the joint equations.

#![allow(non_snake_case)]

use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::joint::{Equation, knee};
use crate::natural::{Coordinates, Pose, SegmentId, Shape};
use crate::tables::JointTable;

/// Angles (z, x, y) \[rad\] of R = Rz(z) Rx(x) Ry(y).
///
/// At x = ±90° z and y turn about the same axis; there y is set to zero.
pub fn zxy_angles(R: &Matrix3<f64>) -> (f64, f64, f64) {
    // R[(2,1)] = sin x; column 1 = (−sin z cos x, cos z cos x, sin x); row 2 = (−cos x sin y, sin x, cos x cos y).
    let x = R[(2, 1)].clamp(-1.0, 1.0).asin();
    if R[(2, 1)].abs() > 1.0 - 1e-14 {
        return (R[(1, 0)].atan2(R[(0, 0)]), x, 0.0);
    }
    ((-R[(0, 1)]).atan2(R[(1, 1)]), x, (-R[(2, 0)]).atan2(R[(2, 2)]))
}

/// Pose of the shank in the thigh-distal frame at a knee flexion \[rad\]: the one-degree-of-freedom path of the five knee
/// equations, solved by Newton from extension. Returns (adduction, internal rotation) \[rad\] and the position of the shank
/// origin \[m\].
pub fn coupled_knee(flexion: f64) -> ((f64, f64), Vector3<f64>) {
    // Unit shapes: the knee is not scaled, so any leg will do.
    let shape = Shape { L: 0.4, cos_alpha: 0.0, cos_beta: 0.0, cos_gamma: 0.0 };
    let equations = knee(JointTable::built_in(), &shape, &shape);
    let thigh = Pose { R: Matrix3::identity(), p: Vector3::new(0.0, shape.L, 0.0) };
    let mut Q = Coordinates::zeros();
    shape.write(SegmentId::Thigh, &thigh, &mut Q);
    let mut unknown = nalgebra::SVector::<f64, 5>::zeros();
    // Small steps of flexion keep Newton on the branch that starts at extension.
    let steps = (flexion.abs() / 0.02).ceil().max(1.0) as usize;
    for k in 1..=steps {
        let at = flexion * k as f64 / steps as f64;
        for _ in 0..30 {
            let residual = |unknown: &nalgebra::SVector<f64, 5>| {
                let mut Q = Q;
                let R = zxy(-at, unknown[0], unknown[1]);
                let p = Vector3::new(unknown[2], unknown[3], unknown[4]);
                shape.write(SegmentId::Shank, &Pose { R, p }, &mut Q);
                let mut phi = Vec::with_capacity(5);
                equations.iter().for_each(|e: &Equation| e.residual(&Q, &mut phi));
                nalgebra::SVector::<f64, 5>::from_vec(phi)
            };
            let phi = residual(&unknown);
            if phi.norm() < 1e-15 {
                break;
            }
            // The equations are quadratic in the coordinates: central differences are accurate to round-off.
            let mut jacobian = nalgebra::SMatrix::<f64, 5, 5>::zeros();
            for c in 0..5 {
                let h = 1e-6;
                let (mut a, mut b) = (unknown, unknown);
                a[c] += h;
                b[c] -= h;
                jacobian.set_column(c, &((residual(&a) - residual(&b)) / (2.0 * h)));
            }
            match jacobian.lu().solve(&phi) {
                Some(step) => unknown -= step,
                None => break,
            }
        }
    }
    ((unknown[0], unknown[1]), Vector3::new(unknown[2], unknown[3], unknown[4]))
}

/// Poses of shank and patella in the thigh-distal frame (axes of the thigh, origin at its rD) at a knee flexion \[rad\], as
/// the knee and patella equations of a leg have them; `None` where the patella finds no place.
pub fn coupled_leg(shapes: &[Shape; 5], flexion: f64) -> Option<[Pose; 2]> {
    let thigh = shapes[SegmentId::Thigh.index()];
    let mut Q = Coordinates::zeros();
    // rD of the thigh in the origin.
    thigh.write(
        SegmentId::Thigh,
        &Pose { R: Matrix3::identity(), p: thigh.basis().column(1).into() },
        &mut Q,
    );
    let ((adduction, rotation), p) = coupled_knee(flexion);
    let shank = Pose { R: zxy(-flexion, adduction, rotation), p };
    shapes[SegmentId::Shank.index()].write(SegmentId::Shank, &shank, &mut Q);
    crate::anatomy::place_patella(shapes, &mut Q);
    let patella = shapes[SegmentId::Patella.index()];
    let equations =
        crate::joint::patella(JointTable::built_in(), &thigh, &patella, &shapes[SegmentId::Shank.index()]);
    let mut pose = patella.pose(SegmentId::Patella, &Q);
    let residual = |pose: &Pose| {
        let mut Q = Q;
        patella.write(SegmentId::Patella, pose, &mut Q);
        let mut phi = Vec::with_capacity(6);
        equations.iter().for_each(|e| e.residual(&Q, &mut phi));
        nalgebra::SVector::<f64, 6>::from_vec(phi)
    };
    let moved = |pose: &Pose, step: &nalgebra::SVector<f64, 6>| Pose {
        R: crate::anatomy::rotation(&step.fixed_rows::<3>(0).into_owned()) * pose.R,
        p: pose.p + step.fixed_rows::<3>(3),
    };
    for _ in 0..30 {
        let phi = residual(&pose);
        if phi.norm() < 1e-14 {
            break;
        }
        let mut jacobian = nalgebra::SMatrix::<f64, 6, 6>::zeros();
        for c in 0..6 {
            let mut h = nalgebra::SVector::<f64, 6>::zeros();
            h[c] = 1e-6;
            let slope = (residual(&moved(&pose, &h)) - residual(&moved(&pose, &-h))) / 2e-6;
            jacobian.set_column(c, &slope);
        }
        pose = moved(&pose, &-jacobian.lu().solve(&phi)?);
    }
    (residual(&pose).norm() < 1e-9).then_some([shank, pose])
}

/// Rz(z) Rx(x) Ry(y), angles in rad.
pub fn zxy(z: f64, x: f64, y: f64) -> Matrix3<f64> {
    use crate::anatomy::rotation;
    rotation(&Vector3::new(0.0, 0.0, z))
        * rotation(&Vector3::new(x, 0.0, 0.0))
        * rotation(&Vector3::new(0.0, y, 0.0))
}

/// Names of the joint angles, in the order of [`joint_angles`].
pub const ANGLES: [&str; 13] = [
    "hip_flexion",
    "hip_adduction",
    "hip_rotation",
    "knee_flexion",
    "knee_adduction",
    "knee_rotation",
    "ankle_flexion",
    "ankle_inversion",
    "ankle_rotation",
    "patella_flexion",
    "pelvis_tilt",
    "pelvis_obliquity",
    "pelvis_rotation",
];

/// Joint angles \[rad\] of a posture. Signs as in `gait-data/README.md`: flexion, adduction, internal rotation positive;
/// pelvis: front up, right side down, right side forward.
pub fn joint_angles(shapes: &[Shape; 5], Q: &Coordinates) -> [f64; 13] {
    let R = |s: SegmentId| shapes[s.index()].pose(s, Q).R;
    // The pelvis frame has Z along w (the line of the ASISs).
    let w = crate::natural::block(Q, SegmentId::Pelvis.block(3)).normalize();
    let u = crate::natural::block(Q, SegmentId::Pelvis.block(0));
    let y = w.cross(&u).normalize();
    let pelvis = Matrix3::from_columns(&[y.cross(&w), y, w]);
    let (thigh, shank) = (R(SegmentId::Thigh), R(SegmentId::Shank));
    let hip = zxy_angles(&(pelvis.transpose() * thigh));
    let knee = zxy_angles(&(thigh.transpose() * shank));
    let ankle = zxy_angles(&(shank.transpose() * R(SegmentId::Foot)));
    let patella = zxy_angles(&(thigh.transpose() * R(SegmentId::Patella)));
    let trunk = zxy_angles(&pelvis);
    [
        hip.0, hip.1, hip.2, -knee.0, knee.1, knee.2, ankle.0, ankle.1, ankle.2, -patella.0, trunk.0,
        trunk.1, trunk.2,
    ]
}

/// Removes jumps of 2π from columns of angles (rows: frames).
pub fn unwrap(values: &mut DMatrix<f64>) {
    let turn = std::f64::consts::TAU;
    for c in 0..values.ncols() {
        for r in 1..values.nrows() {
            let jump = values[(r, c)] - values[(r - 1, c)];
            values[(r, c)] -= turn * (jump / turn).round();
        }
    }
}
