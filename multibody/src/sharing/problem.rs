//! The force-sharing problem of one frame, in plain numbers.

#![allow(non_snake_case)]

use nalgebra::{DMatrix, DVector};
use thiserror::Error;

/// Share the required moments of one frame among muscles, with least weighted squares of forces:
///
/// ```text
/// min 1/2 ( Σ w_f (f − target_f)² + Σ w_x x² + Σ w_s s² )
///     R f + s = tau            s = 0 where no reserves are asked for
///     x = x0 + X f
///     lower_f ≤ f ≤ upper_f,   lower_x ≤ x ≤ upper_x
/// ```
///
/// `w_f > 0` makes the problem strictly convex: there is at most one answer.
/// Moissenet, Chèze, Dumas, J Biomech 2014;47:50, with the multipliers reduced to the wanted ones.
#[derive(Clone, Debug, PartialEq)]
pub struct SharingProblem {
    /// Lever arms, n_coordinates × n_muscles \[m\]: moment on a coordinate per newton of tension.
    pub R: DMatrix<f64>,
    /// Required moments, n_coordinates \[N·m\].
    pub tau: DVector<f64>,
    /// Contact, ligament, tendon and bone forces without any tension, n_x \[N\].
    pub x0: DVector<f64>,
    /// Change of these forces with the tensions, n_x × n_muscles \[N/N\].
    pub X: DMatrix<f64>,
    /// Least tensions, n_muscles \[N\]; 0 for muscles, finite.
    pub lower_f: DVector<f64>,
    /// Greatest tensions, n_muscles \[N\]; may be infinite.
    pub upper_f: DVector<f64>,
    /// Least x, n_x \[N\]; may be −infinite.
    pub lower_x: DVector<f64>,
    /// Greatest x, n_x \[N\]; may be infinite.
    pub upper_x: DVector<f64>,
    /// Weights of the squared tensions, n_muscles \[1/N²\], positive.
    pub w_f: DVector<f64>,
    /// Tensions that cost nothing, n_muscles \[N\], finite. `None`: zero.
    pub target_f: Option<DVector<f64>>,
    /// Weights of the squared x, n_x \[1/N²\], not negative.
    pub w_x: DVector<f64>,
    /// Weights of the squared reserve moments, n_coordinates \[1/(N·m)²\], positive; infinite where a
    /// coordinate has no reserve. `None`: no reserves at all.
    pub w_s: Option<DVector<f64>>,
}

/// What the rows and columns of a [`SharingProblem`] are called in verdicts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Names {
    /// Joint coordinates, the rows of `R`.
    pub coordinates: Vec<String>,
    /// Muscles, the columns of `R` and `X`.
    pub muscles: Vec<String>,
    /// Contact, ligament, tendon and bone forces, the rows of `X`.
    pub reactions: Vec<String>,
}

/// Why a problem is not a problem that can be posed.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum SharingError {
    /// Sizes disagree.
    #[error("`{what}` has {found} entries, expected {expected} ({unit})")]
    Size {
        /// Field of the problem.
        what: &'static str,
        /// Size found.
        found: usize,
        /// Size that the names ask for.
        expected: usize,
        /// What is counted.
        unit: &'static str,
    },
    /// A number that is not finite, or not in the range of its field.
    #[error("`{what}` of `{name}` is {value}, expected {expected}")]
    Value {
        /// Field of the problem.
        what: &'static str,
        /// Muscle, coordinate or force concerned.
        name: String,
        /// The value found.
        value: f64,
        /// Admissible values.
        expected: &'static str,
    },
}

impl SharingProblem {
    /// Number of joint coordinates.
    pub fn n_coordinates(&self) -> usize {
        self.R.nrows()
    }

    /// Number of muscles.
    pub fn n_muscles(&self) -> usize {
        self.R.ncols()
    }

    /// Number of contact, ligament, tendon and bone forces.
    pub fn n_reactions(&self) -> usize {
        self.X.nrows()
    }

    /// Contact, ligament, tendon and bone forces x = x0 + X f \[N\].
    pub fn reactions(&self, f: &DVector<f64>) -> DVector<f64> {
        &self.x0 + &self.X * f
    }

    /// By how much the tensions `f` differ from those that cost nothing, n_muscles \[N\].
    pub fn off_target(&self, f: &DVector<f64>) -> DVector<f64> {
        self.target_f.as_ref().map_or_else(|| f.clone(), |target| f - target)
    }

    /// Cost 1/2 (Σ w_f (f − target_f)² + Σ w_x x² + Σ w_s s²); coordinates without reserve do not count.
    pub fn objective(&self, f: &DVector<f64>, s: &DVector<f64>) -> f64 {
        let squares = |w: &DVector<f64>, v: &DVector<f64>| -> f64 {
            w.iter().zip(v).filter(|(w, _)| w.is_finite()).map(|(w, v)| w * v * v).sum()
        };
        let reserves = self.w_s.as_ref().map_or(0.0, |w_s| squares(w_s, s));
        0.5 * (squares(&self.w_f, &self.off_target(f)) + squares(&self.w_x, &self.reactions(f)) + reserves)
    }

    /// Reserve weight of a coordinate; infinite where it has no reserve.
    pub fn reserve_weight(&self, coordinate: usize) -> f64 {
        self.w_s.as_ref().map_or(f64::INFINITY, |w_s| w_s[coordinate])
    }

    /// Sizes agree with the names, numbers are finite and in range.
    pub fn validate(&self, names: &Names) -> Result<(), SharingError> {
        let (nc, nm, nx) = (names.coordinates.len(), names.muscles.len(), names.reactions.len());
        let size = |what, found, expected, unit| {
            if found == expected { Ok(()) } else { Err(SharingError::Size { what, found, expected, unit }) }
        };
        size("R", self.R.nrows(), nc, "coordinates")?;
        size("R", self.R.ncols(), nm, "muscles")?;
        size("tau", self.tau.len(), nc, "coordinates")?;
        size("X", self.X.nrows(), nx, "reactions")?;
        size("X", self.X.ncols(), nm, "muscles")?;
        for (what, vector) in [("x0", &self.x0), ("lower_x", &self.lower_x), ("upper_x", &self.upper_x)] {
            size(what, vector.len(), nx, "reactions")?;
        }
        for (what, vector) in [("lower_f", &self.lower_f), ("upper_f", &self.upper_f), ("w_f", &self.w_f)] {
            size(what, vector.len(), nm, "muscles")?;
        }
        if let Some(target) = &self.target_f {
            size("target_f", target.len(), nm, "muscles")?;
        }
        size("w_x", self.w_x.len(), nx, "reactions")?;
        if let Some(w_s) = &self.w_s {
            size("w_s", w_s.len(), nc, "coordinates")?;
        }

        let finite: fn(f64) -> bool = f64::is_finite;
        check("tau", &self.tau, &names.coordinates, "a finite moment", finite)?;
        check("x0", &self.x0, &names.reactions, "a finite force", finite)?;
        for (what, matrix) in [("R", &self.R), ("X", &self.X)] {
            if let Some(bad) = matrix.iter().position(|value| !value.is_finite()) {
                let name = names.muscles[bad / matrix.nrows()].clone();
                return Err(SharingError::Value {
                    what,
                    name,
                    value: matrix[bad],
                    expected: "a finite number",
                });
            }
        }
        check("lower_f", &self.lower_f, &names.muscles, "a finite force", finite)?;
        check("w_f", &self.w_f, &names.muscles, "a positive finite weight", |w| w > 0.0 && w.is_finite())?;
        if let Some(target) = &self.target_f {
            check("target_f", target, &names.muscles, "a finite force", finite)?;
        }
        check("w_x", &self.w_x, &names.reactions, "a weight of at least zero", |w| {
            w >= 0.0 && w.is_finite()
        })?;
        if let Some(w_s) = &self.w_s {
            check("w_s", w_s, &names.coordinates, "a positive weight", |w| w > 0.0)?;
        }
        check("lower_x", &self.lower_x, &names.reactions, "a force or -inf", |b| b < f64::INFINITY)?;
        let gap_f = &self.upper_f - &self.lower_f;
        check("upper_f", &gap_f, &names.muscles, "an upper bound not below the lower one", |gap| gap >= 0.0)?;
        for (row, name) in names.reactions.iter().enumerate() {
            let (lower, upper) = (self.lower_x[row], self.upper_x[row]);
            if !(upper >= lower && upper > f64::NEG_INFINITY) {
                let expected = "an upper bound not below the lower one";
                return Err(SharingError::Value {
                    what: "upper_x",
                    name: name.clone(),
                    value: upper,
                    expected,
                });
            }
        }
        Ok(())
    }
}

/// The first value of `vector` that is not `admissible`, as an error.
fn check(
    what: &'static str,
    vector: &DVector<f64>,
    names: &[String],
    expected: &'static str,
    admissible: impl Fn(f64) -> bool,
) -> Result<(), SharingError> {
    match vector.iter().position(|value| !admissible(*value)) {
        Some(i) => Err(SharingError::Value { what, name: names[i].clone(), value: vector[i], expected }),
        None => Ok(()),
    }
}
