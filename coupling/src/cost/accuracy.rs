//! How sure a number is: errors by their owner.
//!
//! Discretisation: Richardson's extrapolation with the observed order where three meshes show one, and the safety factors of Eça & Hoekstra,
//! J Comput Phys 262:104 (2014): 1.25 where the order is credible, three times the spread of the meshes where none is seen.

use std::collections::BTreeMap;

use super::ladder::{Axis, Ladder, Owner};
use super::rung::{Ending, Numbers};

/// Orders that are believed: first order is what corners and contact leave, second what the elements promise; above it the estimate is
/// made with the second.
const ORDERS: [f64; 2] = [0.5, 2.0];
/// Safety factor where an order is seen, and where none is (Eça & Hoekstra).
const SAFETY: [f64; 2] = [1.25, 3.0];

/// What three meshes say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extrapolated {
    /// Observed order; `None` where the meshes show none.
    pub order: Option<f64>,
    /// Value for elements of no size, as far as one is seen; else that of the finest.
    pub limit: f64,
    /// How far the value of the finest mesh may be off.
    pub spread: f64,
}

/// Extrapolates a value computed on three meshes or more, from coarse to fine; `sizes`: of their elements, in any unit. Looks at the three finest.
pub fn extrapolate(sizes: &[f64], values: &[f64]) -> Option<Extrapolated> {
    let n = sizes.len().min(values.len());
    if n < 3 {
        return None;
    }
    let ([h1, h2, h3], [f1, f2, f3]) =
        (<[f64; 3]>::try_from(&sizes[n - 3..n]).ok()?, <[f64; 3]>::try_from(&values[n - 3..n]).ok()?);
    let spread = [f1, f2, f3].iter().fold(f64::MIN, |m, f| f.max(m))
        - [f1, f2, f3].iter().fold(f64::MAX, |m, f| f.min(m));
    if spread == 0.0 {
        return Some(Extrapolated { order: None, limit: f3, spread: 0.0 });
    }
    let ratio = (f1 - f2) / (f2 - f3);
    // (h₁ᵖ − h₂ᵖ)/(h₂ᵖ − h₃ᵖ) grows with p from ln(h₁/h₂)/ln(h₂/h₃).
    let of = |p: f64| (h1.powf(p) - h2.powf(p)) / (h2.powf(p) - h3.powf(p));
    let seen = (ratio.is_finite() && ratio > 0.0).then(|| {
        let (mut low, mut high) = (1e-3, 20.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if of(middle) < ratio { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    });
    match seen.filter(|p| *p >= ORDERS[0]) {
        Some(order) => {
            let p = order.min(ORDERS[1]);
            let limit = f3 + (f3 - f2) / ((h2 / h3).powf(p) - 1.0);
            Some(Extrapolated { order: Some(order), limit, spread: SAFETY[0] * (limit - f3).abs() })
        }
        None => Some(Extrapolated { order: None, limit: f3, spread: SAFETY[1] * spread }),
    }
}

/// Errors of one number of the base.
#[derive(Clone, Debug, PartialEq)]
pub struct Errors {
    /// Step, quantity, whose.
    pub of: [String; 3],
    /// In the base.
    pub value: f64,
    /// On the finest mesh, all else as in the base.
    pub finest: Option<f64>,
    /// Order that the meshes show.
    pub order: Option<f64>,
    /// By owner; absent: no axis asks.
    pub by_owner: BTreeMap<Owner, f64>,
}

impl Owner {
    /// All, in the order of the table.
    pub const ALL: [Owner; 5] =
        [Owner::Discretisation, Owner::Regularisation, Owner::Tolerance, Owner::Path, Owner::Modelling];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Owner::Discretisation => "discretisation",
            Owner::Regularisation => "regularisation",
            Owner::Tolerance => "tolerance",
            Owner::Path => "path",
            Owner::Modelling => "modelling",
        }
    }
}

impl Errors {
    /// What the number may be off as the answer to the scene as it is: all but what the model leaves out.
    pub fn total(&self) -> f64 {
        self.by_owner.iter().filter(|(owner, _)| **owner != Owner::Modelling).fold(0.0, |sum, (_, e)| sum + e)
    }
}

/// Errors of every number of the base, by the axes that start from it. `endings`: of the rungs of the ladder, as far as there are any.
pub fn errors(ladder: &Ladder, endings: &[Option<Ending>]) -> Vec<Errors> {
    let solved = |rung: usize| endings.get(rung).and_then(|e| e.as_ref()).and_then(Ending::solved);
    let Some((_, base)) = solved(0) else { return Vec::new() };
    let axes: Vec<&Axis> = ladder.axes.iter().filter(|axis| axis.with.is_empty()).collect();
    let mut all = Vec::new();
    for (of, &value) in base {
        let mut found =
            Errors { of: of.clone(), value, finest: None, order: None, by_owner: BTreeMap::new() };
        for axis in &axes {
            let on: Vec<(usize, f64, &Numbers)> = axis
                .rungs
                .iter()
                .filter_map(|&rung| {
                    solved(rung).map(|(taken, numbers)| (rung, taken.elements as f64, numbers))
                })
                .collect();
            let values: Vec<(usize, f64, f64)> = on
                .iter()
                .filter_map(|(rung, n, numbers)| Some((*rung, n.powf(-1.0 / 3.0), *numbers.get(of)?)))
                .collect();
            let error = match axis.owner {
                Owner::Discretisation if axis.is_mesh() => {
                    let (sizes, forces): (Vec<f64>, Vec<f64>) = values.iter().map(|v| (v.1, v.2)).unzip();
                    extrapolate(&sizes, &forces).map(|e| {
                        (found.finest, found.order) = (forces.last().copied(), e.order);
                        e.spread + (e.limit - value).abs()
                    })
                }
                // A base that is the finest: as far from the truth as the one before from it, by first order and half the size.
                Owner::Discretisation | Owner::Regularisation | Owner::Tolerance => match values.as_slice() {
                    [.., before, last] if last.0 == 0 => Some((before.2 - value).abs()),
                    [.., last] if last.0 != 0 => Some((last.2 - value).abs()),
                    _ => None,
                },
                Owner::Path | Owner::Modelling => {
                    let others = values.iter().filter(|v| v.0 != 0).map(|v| (v.2 - value).abs());
                    others.reduce(f64::max)
                }
            };
            if let Some(error) = error {
                *found.by_owner.entry(axis.owner).or_insert(0.0) += error;
            }
        }
        all.push(found);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_of_a_power_is_found_and_its_limit() {
        let sizes = [20.0, 12.0, 9.0, 6.0];
        for p in [0.7, 1.0, 1.6, 2.0] {
            let values = sizes.map(|h: f64| 300.0 + 0.5 * h.powf(p));
            let e = extrapolate(&sizes, &values).unwrap();
            assert!((e.order.unwrap() - p).abs() < 1e-6 && (e.limit - 300.0).abs() < 1e-6, "{p}: {e:?}");
            let true_error = values[3] - 300.0;
            assert!(e.spread > true_error && e.spread < 2.0 * true_error);
        }
    }

    #[test]
    fn where_no_order_is_seen_the_spread_of_the_meshes_counts() {
        let e = extrapolate(&[3.0, 2.0, 1.0], &[10.0, 12.0, 11.0]).unwrap();
        assert_eq!((e.order, e.limit, e.spread), (None, 11.0, 6.0));
        assert_eq!(extrapolate(&[2.0, 1.0], &[1.0, 2.0]), None);
        // Faster than the elements can be: the second order makes the estimate.
        let e = extrapolate(&[4.0, 2.0, 1.0], &[64.0, 8.0, 1.0]).unwrap();
        assert!(e.order.unwrap() > 2.0 && (e.limit - (1.0 - 7.0 / 3.0)).abs() < 1e-9, "{e:?}");
    }
}
