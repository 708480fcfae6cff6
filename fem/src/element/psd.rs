//! Positive semidefinite part of small symmetric matrices.

use nalgebra::allocator::Allocator;
use nalgebra::{ArrayStorage, Const, DefaultAllocator, DimDiff, DimSub, SMatrix, SymmetricEigen, U1};

/// Takes the fraction `convexity` off the negative eigenvalues of a symmetric matrix; with all of it off it becomes the nearest positive
/// semidefinite one in the Frobenius norm. Returns whether there was anything to change.
pub fn lift<const D: usize>(A: &mut [[f64; D]; D], convexity: f64) -> bool
where
    Const<D>: DimSub<U1>,
    DefaultAllocator: Allocator<DimDiff<Const<D>, U1>>,
{
    if convexity == 0.0 {
        return false;
    }
    // Many matrices are fine, and a Cholesky attempt costs a small part of an eigendecomposition.
    let largest = A.as_flattened().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if is_positive(A, 1e-10 * largest) {
        return false;
    }
    // Householder and QL: at this size three times as fast as Jacobi rotations.
    let matrix = SMatrix::<f64, D, D>::from_array_storage(ArrayStorage(*A));
    let Some(eigen) = SymmetricEigen::<f64, Const<D>>::try_new(matrix, f64::EPSILON, 30 * D) else {
        return false; // not finite, as the solver will find
    };
    for (value, v) in eigen.eigenvalues.iter().zip(&eigen.eigenvectors.data.0) {
        let value: f64 = *value;
        if value < 0.0 {
            for r in 0..D {
                for c in 0..D {
                    A[r][c] -= convexity * value * v[r] * v[c];
                }
            }
        }
    }
    true
}

/// An eigenvalue less the fraction `convexity` of what is negative about it.
#[inline]
pub fn lifted(value: f64, convexity: f64) -> f64 {
    value - convexity * value.min(0.0)
}

/// Whether A + shift I has a Cholesky factor.
fn is_positive<const D: usize>(A: &[[f64; D]; D], shift: f64) -> bool {
    let mut l = *A;
    for c in 0..D {
        let mut pivot = l[c][c] + shift;
        for m in 0..c {
            pivot -= l[c][m] * l[c][m];
        }
        if !(pivot > 0.0) {
            return false;
        }
        let root = pivot.sqrt();
        l[c][c] = root;
        for r in c + 1..D {
            let mut v = l[r][c];
            for m in 0..c {
                v -= l[r][m] * l[c][m];
            }
            l[r][c] = v / root;
        }
    }
    true
}
