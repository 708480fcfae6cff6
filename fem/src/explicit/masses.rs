//! What nodes weigh: as much as is stable with the time step, and no less than is given.
//!
//! With D the diagonal 3×3 blocks of the stiffness K and λ the largest eigenvalue of D⁻¹K, K ⪯ λ D. Central differences with the step h are
//! stable where M ⪰ ¼ h² K; so M ⪰ ¼ h² λ D will do, node by node and direction by direction. A node at the end of a tendon is heavy along
//! the tendon alone.
//! Underwood, Dynamic relaxation, in: Computational Methods for Transient Analysis (1983), 245-265, takes sums of rows for D; blocks turn
//! with the axes and know that fibres are stiff along themselves only.

use crate::solve::Potential;
use nalgebra::{Matrix3, SymmetricEigen};
use rayon::prelude::*;

/// A 3×3 matrix, row-major.
pub type Block = [f64; 9];

/// A bound λ D on the stiffness of a potential at some place.
#[derive(Clone, Debug, Default)]
pub struct Bound {
    /// D \[N/m\], with zeros where a component is prescribed.
    blocks: Vec<Block>,
    /// λ, with [`MARGIN`].
    pub largest: f64,
    /// The shape that is stiffest beside D, for the next time.
    pub vector: Vec<f64>,
}

/// Nodes that one task takes; the pieces of sums, too, so that they are the same on any number of threads.
const PIECE: usize = 512;
/// Steps of the power method: from no shape, and from that of the time before. The spectrum is dense at its end, so that after 40 steps
/// the quotient is within [`MARGIN`] of it.
const POWERS: [usize; 2] = [40, 10];
/// Factor on the largest eigenvalue that the power method found, which comes to it from below. Steps that are too long all the same are seen
/// from the quotient Δx·Δg / Δx·MΔx of the step itself, and answered.
pub const MARGIN: f64 = 1.1;
/// Curvatures of a block below this fraction of its greatest count as that: what resists in no direction of its own weighs something.
const LEAST: f64 = 1e-6;
/// Length of differences of gradients beside the largest coordinate: the root of round-off, so that neither it nor curvature spoils them.
const DIFFERENCE: f64 = 1e-8;

impl Bound {
    /// Looks anew at `potential` at the place `x`.
    pub fn renew(&mut self, potential: &dyn Potential, x: &[f64]) {
        let fixed = potential.fixed();
        self.blocks.resize(x.len() / 3, [0.0; 9]);
        potential.diagonal_blocks(x, self.blocks.as_flattened_mut());
        for (i, _) in fixed.iter().enumerate().filter(|(_, fixed)| **fixed) {
            let block = &mut self.blocks[i / 3];
            (0..3).for_each(|c| (block[3 * (i % 3) + c], block[3 * c + i % 3]) = (0.0, 0.0));
        }
        let unit = Masses::new(&[], &self.blocks);
        self.largest = MARGIN * largest(potential, x, &unit, &mut self.vector);
    }

    /// Whether there is a stiffness to speak of: a motion that has blown up has none.
    pub fn is_finite(&self) -> bool {
        self.largest.is_finite() && self.blocks.as_flattened().iter().all(|b| b.is_finite())
    }

    /// Residual \[N\] that round-off of the positions `x` within their body alone can make: ε · extent in every position times its stiffness.
    pub fn round_off(&self, x: &[f64]) -> f64 {
        let along = |c: usize| x.iter().skip(c).step_by(3);
        let width = |c| along(c).fold(f64::MIN, |m, v| m.max(*v)) - along(c).fold(f64::MAX, |m, v| m.min(*v));
        let extent = (0..3).map(width).fold(0.0, f64::max);
        let square: f64 = self.blocks.iter().flat_map(|b| [b[0], b[4], b[8]]).map(|d| d * d).sum();
        f64::EPSILON * extent * square.sqrt()
    }

    /// The blocks of λ D times `factor`.
    pub fn times(&self, factor: f64) -> Vec<Block> {
        self.blocks.iter().map(|b| b.map(|b| factor * self.largest * b)).collect()
    }
}

/// The largest eigenvalue of M⁻¹K at `x` by the power method from `vector`, or from a shape of its own where that is none, whose products with K are
/// differences of gradients; leaves its eigenvector there.
pub fn largest(potential: &dyn Potential, x: &[f64], masses: &Masses, vector: &mut Vec<f64>) -> f64 {
    let n = x.len();
    let is_shape =
        vector.len() == n && vector.iter().all(|v| v.is_finite()) && vector.iter().any(|v| *v != 0.0);
    if !is_shape {
        // No two neighbours alike, so that the stiffest shapes have a part in it.
        let hash = |i: usize| ((i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as f64;
        *vector = (0..n).map(|i| hash(i) / f64::from(1 << 23) - 1.0).collect();
    }
    let steps = POWERS[usize::from(is_shape)];
    let (mut g, mut ahead, mut moved) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    potential.gradient(x, &mut g);
    let small = DIFFERENCE * x.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let mut quotient = 0.0;
    masses.answer_in_place(vector);
    for _ in 0..steps {
        let most = vector.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        if !(most > 0.0) {
            break;
        }
        vector.iter_mut().for_each(|v| *v *= small / most);
        for i in 0..n {
            moved[i] = x[i] + vector[i];
        }
        potential.gradient(&moved, &mut ahead);
        ahead.iter_mut().zip(&g).for_each(|(a, g)| *a -= g);
        quotient = (dot(vector, &ahead) / masses.square(vector)).abs();
        vector.copy_from_slice(&ahead);
        masses.answer_in_place(vector);
    }
    quotient
}

/// Masses of the free nodes \[kg\], blocks that may weigh more in one direction than in another.
#[derive(Clone, Debug, Default)]
pub struct Masses {
    blocks: Vec<Block>,
    /// Zero in what is prescribed.
    inverse: Vec<Block>,
    /// Mass added to that given, mean of the three directions \[kg\].
    pub added: f64,
}

impl Masses {
    /// At least `given` \[kg\] per unknown (empty: none) and `least` per node. Unknowns for which both are zero are prescribed.
    pub fn new(given: &[f64], least: &[Block]) -> Masses {
        let mass = |i: usize| given.get(i).map_or(0.0, |m| *m);
        let of = |node: usize| std::array::from_fn(|e| if e % 4 == 0 { mass(3 * node + e / 4) } else { 0.0 });
        let given = Masses { blocks: (0..least.len()).map(of).collect(), ..Masses::default() };
        given.at_least(least)
    }

    /// These, and where they are less than `least`, in the directions in which they are, that.
    pub fn at_least(&self, least: &[Block]) -> Masses {
        let greatest = least.iter().flatten().fold(0.0_f64, |m, v| m.max(*v));
        let of = |(before, least): (&Block, &Block)| {
            let m: [f64; 3] = std::array::from_fn(|i| before[4 * i]);
            let prescribed: [bool; 3] = std::array::from_fn(|i| m[i] == 0.0 && least[4 * i] == 0.0);
            if *before == diagonal(m[0]) && least.iter().all(|b| *b == 0.0) && m[0] > 0.0 {
                return (*before, diagonal(1.0 / m[0]), 0.0);
            }
            let before = Matrix3::from_row_slice(before);
            let more = SymmetricEigen::new(Matrix3::from_row_slice(least) - before);
            let most = Matrix3::from_row_slice(least).amax();
            let floor = LEAST * if most > 0.0 { most } else { greatest };
            let (mut block, mut added) = (before, 0.0);
            for (value, u) in more.eigenvalues.iter().zip(more.eigenvectors.column_iter()) {
                let more = value.max(0.0);
                added += more / 3.0;
                block += u * u.transpose() * more;
            }
            for i in 0..3 {
                if prescribed[i] {
                    block[(i, i)] = 1.0;
                } else if m[i] == 0.0 {
                    block[(i, i)] += floor;
                }
            }
            let mut inverse = block.try_inverse().unwrap_or_else(Matrix3::zeros);
            for i in (0..3).filter(|i| prescribed[*i]) {
                block[(i, i)] = 0.0;
                inverse[(i, i)] = 0.0;
            }
            let flat = |m: &Matrix3<f64>| std::array::from_fn(|e| m[(e / 3, e % 3)]);
            (flat(&block), flat(&inverse), added)
        };
        let all: Vec<(Block, Block, f64)> =
            self.blocks.par_iter().zip(least).with_min_len(PIECE).map(of).collect();
        Masses {
            added: self.added + all.iter().map(|m| m.2).sum::<f64>(),
            blocks: all.iter().map(|m| m.0).collect(),
            inverse: all.iter().map(|m| m.1).collect(),
        }
    }

    /// These, twice as heavy.
    pub fn doubled(&self) -> Masses {
        let twice: Vec<Block> = self.blocks.iter().map(|b| b.map(|m| 2.0 * m)).collect();
        self.at_least(&twice)
    }

    /// Whether no node weighs less than `least` in any direction.
    pub fn cover(&self, least: &[Block]) -> bool {
        let lacks = |(mass, least): (&Block, &Block)| {
            let room = Matrix3::from_row_slice(mass) - Matrix3::from_row_slice(least);
            room.symmetric_eigenvalues().min() < -1e-9 * Matrix3::from_row_slice(least).amax()
        };
        !self.blocks.par_iter().zip(least).with_min_len(PIECE).any(lacks)
    }

    /// v ← `keep` v − `push` M⁻¹g, then x ← x + v; returns v·Mv.
    pub fn step(&self, x: &mut [f64], v: &mut [f64], g: &[f64], keep: f64, push: f64) -> f64 {
        let pieces: Vec<f64> = x
            .par_chunks_mut(3 * PIECE)
            .zip(v.par_chunks_mut(3 * PIECE))
            .zip(g.par_chunks(3 * PIECE))
            .enumerate()
            .map(|(piece, ((x, v), g))| {
                let nodes = x.as_chunks_mut::<3>().0.iter_mut().zip(v.as_chunks_mut::<3>().0);
                let mut square = 0.0;
                for (node, ((x, v), g)) in (piece * PIECE..).zip(nodes.zip(g.as_chunks::<3>().0)) {
                    let a = times(&self.inverse[node], g);
                    for c in 0..3 {
                        v[c] = keep * v[c] - push * a[c];
                        x[c] += v[c];
                    }
                    let w = times(&self.blocks[node], v);
                    square += v[0] * w[0] + v[1] * w[1] + v[2] * w[2];
                }
                square
            })
            .collect();
        pieces.iter().sum()
    }

    /// f·M⁻¹f.
    pub fn inverse_square(&self, f: &[f64]) -> f64 {
        let pieces: Vec<f64> = f
            .par_chunks(3 * PIECE)
            .enumerate()
            .map(|(piece, f)| {
                let nodes = (piece * PIECE..).zip(f.as_chunks::<3>().0);
                nodes.map(|(n, f)| (0..3).map(|c| f[c] * times(&self.inverse[n], f)[c]).sum::<f64>()).sum()
            })
            .collect();
        pieces.iter().sum()
    }

    /// u·Mu.
    pub fn square(&self, u: &[f64]) -> f64 {
        let pieces: Vec<f64> = u
            .par_chunks(3 * PIECE)
            .enumerate()
            .map(|(piece, u)| {
                let nodes = (piece * PIECE..).zip(u.as_chunks::<3>().0);
                nodes.map(|(n, u)| (0..3).map(|c| u[c] * times(&self.blocks[n], u)[c]).sum::<f64>()).sum()
            })
            .collect();
        pieces.iter().sum()
    }

    /// f ← M⁻¹f.
    pub fn answer_in_place(&self, f: &mut [f64]) {
        let nodes = f.as_chunks_mut::<3>().0.par_iter_mut().with_min_len(PIECE).enumerate();
        nodes.for_each(|(n, f)| *f = times(&self.inverse[n], f));
    }
}

fn diagonal(m: f64) -> Block {
    std::array::from_fn(|e| if e % 4 == 0 { m } else { 0.0 })
}

fn times(m: &Block, v: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| m[3 * i] * v[0] + m[3 * i + 1] * v[1] + m[3 * i + 2] * v[2])
}

/// a·b, in pieces.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let pieces: Vec<f64> = a
        .par_chunks(3 * PIECE)
        .zip(b.par_chunks(3 * PIECE))
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| a * b).sum())
        .collect();
    pieces.iter().sum()
}

/// (a − b)·v, in pieces.
pub fn dot_difference(v: &[f64], a: &[f64], b: &[f64]) -> f64 {
    let pieces: Vec<f64> = v
        .par_chunks(3 * PIECE)
        .zip(a.par_chunks(3 * PIECE).zip(b.par_chunks(3 * PIECE)))
        .map(|(v, (a, b))| v.iter().zip(a.iter().zip(b)).map(|(v, (a, b))| v * (a - b)).sum())
        .collect();
    pieces.iter().sum()
}
