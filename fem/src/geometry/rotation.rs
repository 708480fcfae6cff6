//! The rotation in a linear map.

#![allow(non_snake_case)]

use nalgebra::Matrix3;

/// U Vᵀ of A = U Σ Vᵀ.
pub(crate) fn nearest_rotation(A: &Matrix3<f64>) -> Matrix3<f64> {
    let svd = A.svd(true, true);
    svd.u.expect("asked for") * svd.v_t.expect("asked for")
}
