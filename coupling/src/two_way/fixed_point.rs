//! Fixed points x = H(x) of coupled solvers: constant relaxation, Aitken's factor, and the interface quasi-Newton method IQN-ILS.
//!
//! With x̃ = H(x) and the residual r = x̃ − x, relaxation goes to x + ω r; Aitken adapts ω (Küttler & Wall, Comput Mech 2008;43:61,
//! eq. 44). IQN-ILS keeps the differences of all residuals and images and steps to where the residual would vanish if H were linear in
//! their span, by least squares (Degroote, Bathe, Vierendeels, Comput Struct 2009;87:793).

#![allow(non_snake_case)]

use nalgebra::DVector;

/// How the next guess follows from what was seen.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scheme {
    /// x + ω r with this ω.
    Relaxation(f64),
    /// ω from the last two residuals; this one in the first pass.
    Aitken(f64),
    /// IQN-ILS; in the first pass relaxation with this ω.
    IqnIls(f64),
}

/// Columns of V that hold less than this fraction of themselves that is new are left out: they are noise of the solvers.
const LEAST_NEW: f64 = 1e-3;

/// Finds a fixed point, guess by guess.
#[derive(Clone, Debug)]
pub struct FixedPoint {
    scheme: Scheme,
    omega: f64,
    /// Residuals and images, in the order seen.
    seen: Vec<[DVector<f64>; 2]>,
}

impl FixedPoint {
    /// Nothing seen yet.
    pub fn new(scheme: Scheme) -> FixedPoint {
        let (Scheme::Relaxation(omega) | Scheme::Aitken(omega) | Scheme::IqnIls(omega)) = scheme;
        FixedPoint { scheme, omega, seen: Vec::new() }
    }

    /// The next guess after `x` and its `image` H(x).
    pub fn next(&mut self, x: &DVector<f64>, image: &DVector<f64>) -> DVector<f64> {
        let r = image - x;
        let next = match (self.scheme, self.seen.last()) {
            (Scheme::IqnIls(_), Some(_)) => image + self.quasi_newton(&r, image),
            (Scheme::Aitken(_), Some([before, _])) => {
                let change = &r - before;
                let square = change.norm_squared();
                if square > 0.0 {
                    self.omega *= -before.dot(&change) / square;
                }
                x + self.omega * &r
            }
            _ => x + self.omega * &r,
        };
        self.seen.push([r, image.clone()]);
        next
    }

    /// W c with c = argmin ‖V c + r‖, V and W the differences of residuals and images to the present ones, newest first. V is made
    /// orthogonal column by column, so that older columns that say nothing new drop out.
    fn quasi_newton(&self, r: &DVector<f64>, image: &DVector<f64>) -> DVector<f64> {
        let (mut Q, mut W): (Vec<DVector<f64>>, Vec<DVector<f64>>) = (Vec::new(), Vec::new());
        for [older, older_image] in self.seen.iter().rev() {
            let (mut v, mut w) = (older - r, older_image - image);
            let size = v.norm();
            // Twice is enough for orthogonality to round-off; the same combinations of the images keep V c and W c together.
            for _ in 0..2 {
                for (q, u) in Q.iter().zip(&W) {
                    let along = q.dot(&v);
                    v.axpy(-along, q, 1.0);
                    w.axpy(-along, u, 1.0);
                }
            }
            let new = v.norm();
            if new > LEAST_NEW * size {
                Q.push(v / new);
                W.push(w / new);
            }
        }
        let mut step = DVector::zeros(r.len());
        for (q, u) in Q.iter().zip(&W) {
            step.axpy(-q.dot(r), u, 1.0);
        }
        step
    }
}

#[cfg(test)]
mod tests {
    use super::{FixedPoint, Scheme};
    use nalgebra::{DMatrix, DVector};

    /// Passes until the residual is below 1e-10 of the image, at most 200; and the last guess.
    fn passes(scheme: Scheme, H: &dyn Fn(&DVector<f64>) -> DVector<f64>, n: usize) -> (usize, DVector<f64>) {
        let mut fixed_point = FixedPoint::new(scheme);
        let mut x = DVector::zeros(n);
        for k in 1..=200 {
            let image = H(&x);
            if (&image - &x).norm() < 1e-10 * image.norm() {
                return (k, x);
            }
            x = fixed_point.next(&x, &image);
        }
        (usize::MAX, x)
    }

    /// x̃ = A x + b with eigenvalues `values` on the first directions of a rotated basis, zero on the rest.
    fn linear(values: &[f64], n: usize) -> (DMatrix<f64>, DVector<f64>) {
        let raw = DMatrix::from_fn(n, n, |i, j| ((3 * i + 7 * j + i * j) as f64 * 0.7).sin());
        let Q = raw.qr().q();
        let D =
            DMatrix::from_fn(n, n, |i, j| if i == j { values.get(i).copied().unwrap_or(0.0) } else { 0.0 });
        (&Q * D * Q.transpose(), DVector::from_fn(n, |i, _| 1.0 + (i as f64).cos()))
    }

    #[test]
    fn a_linear_map_of_low_rank_is_solved_in_as_many_passes_as_it_has_directions() {
        let n = 30;
        for (values, soft) in [(&[0.6, 0.4, -0.3][..], true), (&[-4.0, 2.5, 0.5][..], false)] {
            let (A, b) = linear(values, n);
            let wanted = (DMatrix::identity(n, n) - &A).lu().solve(&b).unwrap();
            let H = |x: &DVector<f64>| &A * x + &b;
            let (quick, x) = passes(Scheme::IqnIls(0.5), &H, n);
            // One pass of relaxation, one more direction for the right-hand side, one to see that it is solved.
            assert!(quick <= values.len() + 3, "{quick} passes");
            assert!((x - &wanted).norm() < 1e-8 * wanted.norm());
            let (plain, x) = passes(Scheme::Relaxation(1.0), &H, n);
            // Stiff: plain substitution diverges.
            assert_eq!(plain < 200, soft);
            if soft {
                assert!(quick < plain && (x - &wanted).norm() < 1e-8 * wanted.norm());
                assert!(passes(Scheme::Aitken(1.0), &H, n).0 < plain);
            }
        }
    }

    #[test]
    fn a_nonlinear_map_takes_fewer_passes_than_relaxation() {
        // Two springs in series, one of which stiffens: the soft and the stiff side of a partitioned coupling.
        let n = 12;
        for gain in [0.8, 3.0] {
            let H = |x: &DVector<f64>| {
                DVector::from_fn(n, |i, _| {
                    let neighbours = x[(i + 1) % n] + 0.5 * x[(i + n - 1) % n];
                    1.0 + 0.1 * i as f64 - gain * (0.5 * x[i] + 0.2 * neighbours).tanh()
                })
            };
            let (quick, x) = passes(Scheme::IqnIls(0.3), &H, n);
            assert!(quick < 25 && (H(&x) - &x).norm() < 1e-9, "{quick} passes at gain {gain}");
            for omega in [0.3, 1.0] {
                let (slow, _) = passes(Scheme::Relaxation(omega), &H, n);
                assert!(quick < slow, "gain {gain}, factor {omega}: {quick} and {slow}");
            }
        }
    }

    #[test]
    fn a_fixed_point_stays_where_it_is() {
        let x = DVector::from_element(3, 2.0);
        for scheme in [Scheme::Relaxation(0.5), Scheme::Aitken(0.5), Scheme::IqnIls(0.5)] {
            let mut fixed_point = FixedPoint::new(scheme);
            for _ in 0..3 {
                assert_eq!(fixed_point.next(&x, &x), x);
            }
        }
    }
}
