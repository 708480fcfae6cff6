//! What does one factorization, one solve, one product cost; and what does the order of elimination bring?
//!
//! `cargo bench -p sartorius-fem --bench solve`. Matrices of hexahedral meshes, three unknowns per node: the cube (the worst
//! shape) and the slender muscle of as many nodes. `faer_amd` is the library's own supernodal Cholesky with its own
//! order (approximate minimum degree), on one thread, symbolic part excluded.

use divan::{Bencher, black_box};
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, Triplet};
use fem::solve::{Analysis, BlockMatrix, Cholesky, Pattern};
use std::sync::Arc;

fn main() {
    for shape in SHAPES {
        let (k, points) = matrix(shape);
        let analysis = Analysis::new(k.pattern(), &points);
        let lower = lower(&k);
        let params = CholeskySymbolicParams::default();
        let amd =
            factorize_symbolic_cholesky(lower.symbolic(), faer::Side::Lower, SymmetricOrdering::Amd, params);
        println!(
            "{shape:?}: {} nodes, factor of {:.1} million numbers, {:.1} billion multiply-adds; minimum degree: {:.1} million",
            k.pattern().n_nodes(),
            1e-6 * analysis.n_values() as f64,
            1e-9 * analysis.work(),
            1e-6 * amd.expect("memory").len_val() as f64
        );
    }
    divan::main();
}

const SHAPES: [[usize; 3]; 3] = [[17, 17, 17], [8, 8, 125], [27, 27, 27]];

/// A positive definite matrix on the pattern of a grid of hexahedra, and its node positions.
fn matrix(n: [usize; 3]) -> (BlockMatrix, Vec<f64>) {
    let node = |i: usize, j: usize, k: usize| ((i * n[1] + j) * n[2] + k) as u32;
    let (mut points, mut cells) = (Vec::new(), Vec::new());
    for i in 0..n[0] {
        for j in 0..n[1] {
            for k in 0..n[2] {
                points.extend([i as f64, j as f64, k as f64]);
                if i + 1 < n[0] && j + 1 < n[1] && k + 1 < n[2] {
                    cells.extend((0..8).map(|c| node(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2))));
                }
            }
        }
    }
    let pattern = Arc::new(Pattern::new(points.len() / 3, cells.chunks(8)));
    let slots = pattern.slots(8, &cells);
    let mut k = BlockMatrix::zeros(pattern);
    k.add_groups(&slots, 16, |_, out| {
        for out in out.chunks_exact_mut(24 * 24) {
            out.fill(-1.0);
            out.iter_mut().step_by(25).for_each(|d| *d = 24.0);
        }
    });
    k.shift(1e-3);
    (k, points)
}

fn lower(k: &BlockMatrix) -> SparseColMat<usize, f64> {
    let mut entries = Vec::new();
    for i in 0..k.pattern().n_nodes() {
        for (&j, b) in k.pattern().row(i).iter().zip(k.row(i)) {
            for e in 0..9 {
                let (row, column) = (3 * i + e / 3, 3 * j as usize + e % 3);
                if row >= column {
                    entries.push(Triplet::new(row, column, b[e]));
                }
            }
        }
    }
    let n = 3 * k.pattern().n_nodes();
    SparseColMat::try_new_from_triplets(n, n, &entries).expect("valid entries")
}

#[divan::bench(args = SHAPES, sample_count = 5)]
fn analyse(bencher: Bencher, shape: [usize; 3]) {
    let (k, points) = matrix(shape);
    bencher.bench_local(|| Analysis::new(black_box(k.pattern()), &points));
}

#[divan::bench(types = [f32, f64], args = SHAPES, sample_count = 5)]
fn factorize<T: fem::solve::cholesky::Scalar>(bencher: Bencher, shape: [usize; 3]) {
    let (k, points) = matrix(shape);
    let mut factor = Cholesky::<T>::new(Arc::new(Analysis::new(k.pattern(), &points)));
    bencher.bench_local(|| factor.factorize(black_box(&k)));
}

#[divan::bench(args = SHAPES, sample_count = 3)]
fn faer_amd(bencher: Bencher, shape: [usize; 3]) {
    use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
    let lower = lower(&matrix(shape).0);
    let symbolic = SymbolicLlt::try_new(lower.symbolic(), faer::Side::Lower).expect("memory");
    bencher.bench_local(|| {
        Llt::try_new_with_symbolic(symbolic.clone(), black_box(lower.as_ref()), faer::Side::Lower)
            .expect("definite")
    });
}

#[divan::bench(types = [f32, f64], args = SHAPES, sample_count = 20)]
fn solve<T: fem::solve::cholesky::Scalar>(bencher: Bencher, shape: [usize; 3]) {
    let (k, points) = matrix(shape);
    let mut factor = Cholesky::<T>::new(Arc::new(Analysis::new(k.pattern(), &points)));
    factor.factorize(&k).expect("definite");
    let mut b: Vec<f64> = points.iter().map(|x| x.sin()).collect();
    bencher.bench_local(|| factor.solve(black_box(&mut b)));
}

#[divan::bench(args = SHAPES, sample_count = 50)]
fn multiply(bencher: Bencher, shape: [usize; 3]) {
    let (k, points) = matrix(shape);
    let mut y = vec![0.0; points.len()];
    bencher.bench_local(|| k.multiply(black_box(&points), &mut y));
}
