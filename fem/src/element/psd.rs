//! Positive semidefinite part of small symmetric matrices.

/// Replaces a symmetric matrix by the nearest positive semidefinite one in the Frobenius norm: negative eigenvalues
/// become zero. Returns whether there was anything to change.
pub fn clamp<const D: usize>(A: &mut [[f64; D]; D]) -> bool {
    // Most matrices are fine, and a Cholesky attempt costs a small part of an eigendecomposition.
    let largest = A.as_flattened().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if is_positive(A, 1e-10 * largest) {
        return false;
    }
    let (values, vectors) = eigen(*A);
    for (value, v) in values.iter().zip(&vectors) {
        if *value < 0.0 {
            for r in 0..D {
                for c in 0..D {
                    A[r][c] -= value * v[r] * v[c];
                }
            }
        }
    }
    true
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

/// Eigenvalues and eigenvectors (as rows) of a symmetric matrix by cyclic Jacobi rotations.
///
/// Golub & Van Loan, Matrix Computations, 4th ed., §8.5.
pub fn eigen<const D: usize>(mut A: [[f64; D]; D]) -> ([f64; D], [[f64; D]; D]) {
    let mut V = [[0.0; D]; D];
    for i in 0..D {
        V[i][i] = 1.0;
    }
    let norm: f64 = A.as_flattened().iter().map(|v| v * v).sum();
    for _ in 0..30 {
        let off: f64 = (0..D).map(|r| (0..r).map(|c| A[r][c] * A[r][c]).sum::<f64>()).sum();
        if !(off > 1e-30 * norm) {
            break;
        }
        for p in 0..D {
            for q in p + 1..D {
                if A[p][q] == 0.0 {
                    continue;
                }
                let tau = (A[q][q] - A[p][p]) / (2.0 * A[p][q]);
                let t = tau.signum() / (tau.abs() + (1.0 + tau * tau).sqrt());
                let c = 1.0 / (1.0 + t * t).sqrt();
                let s = t * c;
                for k in 0..D {
                    let (akp, akq) = (A[k][p], A[k][q]);
                    A[k][p] = c * akp - s * akq;
                    A[k][q] = s * akp + c * akq;
                }
                for k in 0..D {
                    let (apk, aqk) = (A[p][k], A[q][k]);
                    A[p][k] = c * apk - s * aqk;
                    A[q][k] = s * apk + c * aqk;
                    let (vp, vq) = (V[p][k], V[q][k]);
                    V[p][k] = c * vp - s * vq;
                    V[q][k] = s * vp + c * vq;
                }
            }
        }
    }
    (std::array::from_fn(|i| A[i][i]), V)
}
