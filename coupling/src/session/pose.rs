//! Poses as numbers.

use fem::body::Pose;
use nalgebra::{Quaternion, Translation3, UnitQuaternion};

/// Translation x, y, z \[m\] and quaternion w, x, y, z, the real part first.
pub type PoseNumbers = [f64; 7];

/// How far from 1 the length of a quaternion may be: single precision is enough.
const UNIT: f64 = 1e-6;

/// The numbers of a pose, to the last bit.
pub fn numbers(pose: &Pose) -> PoseNumbers {
    let (p, q) = (pose.translation.vector, pose.rotation);
    [p.x, p.y, p.z, q.w, q.i, q.j, q.k]
}

/// The pose of these numbers, to the last bit; the error says what they must be.
pub fn as_pose(numbers: &PoseNumbers) -> Result<Pose, String> {
    let [x, y, z, w, i, j, k] = *numbers;
    if !numbers.iter().all(|v| v.is_finite()) {
        return Err(format!("{numbers:?}: translation x, y, z and quaternion w, x, y, z must be finite"));
    }
    let quaternion = Quaternion::new(w, i, j, k);
    let length = quaternion.norm();
    if (length - 1.0).abs() > UNIT {
        return Err(format!(
            "the quaternion (w, x, y, z) = ({w}, {i}, {j}, {k}) has length {length}, must be 1"
        ));
    }
    Ok(Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::new_unchecked(quaternion)))
}
