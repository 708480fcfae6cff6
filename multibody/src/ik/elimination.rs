//! Gaussian elimination for the Newton matrix, which is small and mostly zero.
//!
//! Unknowns are placed along the leg (foot, ankle equations, shank, knee equations, …), so that non-zeros stay near the
//! diagonal; rows without a multiplier are skipped and rows are only touched up to their last non-zero. That takes about a
//! quarter of the operations of a dense factorization of this size.

use nalgebra::DVector;

/// Pivots below this fraction of the largest entry count as zero.
const SINGULAR: f64 = 1e-14;

/// A square system, stored by rows in the placed order.
pub(super) struct Elimination {
    n: usize,
    /// Position of each unknown in the placed order.
    place: Vec<usize>,
    a: Vec<f64>,
    /// Right-hand side in the placed order.
    b: Vec<f64>,
    /// One past the last non-zero of each row.
    end: Vec<usize>,
}

impl Elimination {
    /// A system of zeros. `order`: the unknowns in the order in which they are placed.
    pub fn new(order: &[usize]) -> Elimination {
        let n = order.len();
        let mut place = vec![0; n];
        order.iter().enumerate().for_each(|(position, &unknown)| place[unknown] = position);
        Elimination { n, place, a: vec![0.0; n * n], b: vec![0.0; n], end: vec![0; n] }
    }

    /// Sets all entries to zero.
    pub fn clear(&mut self) {
        self.a.fill(0.0);
    }

    /// Entry of two unknowns.
    pub fn at(&self, row: usize, column: usize) -> f64 {
        self.a[self.place[row] * self.n + self.place[column]]
    }

    /// Adds to an entry.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        self.a[self.place[row] * self.n + self.place[column]] += value;
    }

    /// Replaces `rhs` by the solution, with partial pivoting; `false` where the matrix is singular. The entries are
    /// used up.
    pub fn solve(&mut self, rhs: &mut DVector<f64>) -> bool {
        let n = self.n;
        for (unknown, &position) in self.place.iter().enumerate() {
            self.b[position] = rhs[unknown];
        }
        let mut largest = 0.0f64;
        for (row, end) in self.a.chunks_exact(n).zip(&mut self.end) {
            *end = row.iter().rposition(|v| *v != 0.0).map_or(0, |last| last + 1);
            largest = row.iter().fold(largest, |m, v| m.max(v.abs()));
        }
        for k in 0..n {
            let mut pivot = k;
            for i in k + 1..n {
                if self.a[i * n + k].abs() > self.a[pivot * n + k].abs() {
                    pivot = i;
                }
            }
            // The negation catches NaN too.
            if self.a[pivot * n + k].abs() <= SINGULAR * largest || self.a[pivot * n + k].is_nan() {
                return false;
            }
            let (above, below) = self.a.split_at_mut((k + 1) * n);
            let row_k = &mut above[k * n..];
            if pivot != k {
                row_k[k..].swap_with_slice(&mut below[(pivot - k - 1) * n + k..(pivot - k) * n]);
                self.b.swap(k, pivot);
                self.end.swap(k, pivot);
            }
            let end = self.end[k];
            let pivot_row = &row_k[k..end];
            for (i, row) in (k + 1..n).zip(below.chunks_exact_mut(n)) {
                if row[k] != 0.0 {
                    let factor = row[k] / pivot_row[0];
                    for (value, above) in row[k + 1..end].iter_mut().zip(&pivot_row[1..]) {
                        *value -= factor * above;
                    }
                    self.b[i] -= factor * self.b[k];
                    self.end[i] = self.end[i].max(end);
                }
            }
        }
        for k in (0..n).rev() {
            let row = &self.a[k * n..(k + 1) * n];
            let known: f64 = (k + 1..self.end[k]).map(|j| row[j] * self.b[j]).sum();
            self.b[k] = (self.b[k] - known) / row[k];
        }
        for (unknown, &position) in self.place.iter().enumerate() {
            rhs[unknown] = self.b[position];
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn solves_what_a_dense_factorization_solves() {
        // A banded, indefinite matrix with zeros on the diagonal, in a scrambled order.
        let n = 23;
        let order: Vec<usize> = (0..n).map(|k| (k * 7) % n).collect();
        let value =
            |i: usize, j: usize| ((3 * i + 5 * j) as f64).sin() * f64::from(i.abs_diff(j) < 5 && i != j);
        let dense = DMatrix::from_fn(n, n, value);
        let mut system = Elimination::new(&order);
        for i in 0..n {
            (0..n).for_each(|j| system.add(order[i], order[j], dense[(i, j)]));
        }
        let want = DVector::from_fn(n, |i, _| (i as f64).cos());
        let product = &dense * &want;
        let mut rhs = DVector::zeros(n);
        (0..n).for_each(|i| rhs[order[i]] = product[i]);
        assert!(system.solve(&mut rhs));
        for i in 0..n {
            assert!((rhs[order[i]] - want[i]).abs() < 1e-10, "{i}: {} {}", rhs[order[i]], want[i]);
        }
    }

    #[test]
    fn names_a_singular_matrix() {
        let mut system = Elimination::new(&[0, 1]);
        (0..2).for_each(|i| (0..2).for_each(|j| system.add(i, j, 1.0)));
        assert!(!system.solve(&mut DVector::from_element(2, 1.0)));
    }
}
