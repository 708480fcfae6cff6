//! Joints as equations on the natural coordinates, and which multiplier is which force.

#![allow(non_snake_case)]

mod ankle;
mod hip;
mod knee;
mod patella;

use nalgebra::Vector3;

pub use ankle::{GENERIC_SHANK, parallel as ankle_parallel, universal as ankle_universal};
pub use hip::hip;
pub use knee::knee;
pub use patella::patella;

use crate::natural::{Coordinates, SegmentId, VectorForm};

/// One group of scalar equations φ(Q) = 0.
#[derive(Clone, Debug, PartialEq)]
pub enum Equation {
    /// A point of the proximal segment coincides with a point of the distal one: `gap` = proximal − distal \[m\],
    /// three rows. The multiplier is a contact force, reported in the axes of `distal`.
    Coincide {
        /// Proximal minus distal point.
        gap: VectorForm,
        /// Segment in whose axes the force is reported.
        distal: SegmentId,
        /// Name of the contact, e.g. `hip`.
        contact: &'static str,
    },
    /// a·b − value = 0, one row.
    Product {
        /// First factor.
        a: VectorForm,
        /// Second factor.
        b: VectorForm,
        /// Constant value of the product.
        value: f64,
        /// What the multiplier means.
        force: Force,
    },
}

/// What the multiplier of a product row means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Force {
    /// Not wanted as a force (fixed angles).
    None,
    /// Sphere on plane: contact force along the plane's normal, positive = push \[N\].
    Contact(&'static str),
    /// |a|² − d²: tension of a ligament of length d \[m\].
    Tension(&'static str, f64),
}

impl Equation {
    /// Number of scalar equations.
    pub fn n_rows(&self) -> usize {
        match self {
            Equation::Coincide { .. } => 3,
            Equation::Product { .. } => 1,
        }
    }

    /// Residuals, appended to `phi`.
    pub fn residual(&self, Q: &Coordinates, phi: &mut Vec<f64>) {
        match self {
            Equation::Coincide { gap, .. } => phi.extend(gap.at(Q).iter()),
            Equation::Product { a, b, value, .. } => phi.push(a.at(Q).dot(&b.at(Q)) - value),
        }
    }

    /// Calls `add(row, block, ∂φ_row/∂block)` for every non-zero block of the Jacobian; rows count from 0.
    pub fn jacobian(&self, Q: &Coordinates, add: &mut impl FnMut(usize, usize, Vector3<f64>)) {
        match self {
            Equation::Coincide { gap, .. } => {
                for &(block, k) in &gap.terms {
                    for row in 0..3 {
                        let mut d = Vector3::zeros();
                        d[row] = k;
                        add(row, block, d);
                    }
                }
            }
            Equation::Product { a, b, .. } => {
                let (va, vb) = (a.at(Q), b.at(Q));
                a.terms.iter().for_each(|&(block, k)| add(0, block, k * vb));
                b.terms.iter().for_each(|&(block, k)| add(0, block, k * va));
            }
        }
    }

    /// Second derivatives are `coefficient · E` for each ordered pair of blocks: calls `add(i, j, coefficient)`.
    pub fn hessian(&self, add: &mut impl FnMut(usize, usize, f64)) {
        if let Equation::Product { a, b, .. } = self {
            for &(i, ki) in &a.terms {
                for &(j, kj) in &b.terms {
                    add(i, j, ki * kj);
                    add(j, i, ki * kj);
                }
            }
        }
    }
}
