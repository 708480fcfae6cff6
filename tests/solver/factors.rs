//! Matrices, orders of elimination and factors.

use super::lattice::{Lattice, STIFFNESS, dense, no_motion};
use fem::solve::{Analysis, BlockMatrix, Cholesky, Pattern, Potential};
use nalgebra::DVector;
use std::sync::Arc;

#[test]
fn assembled_matrix_is_the_sum_of_its_springs() {
    let lattice = Lattice::new([3, 4, 3], |p| p[2] == 0.0, |_| false, no_motion);
    let x: Vec<f64> = lattice.start().iter().enumerate().map(|(i, x)| x + 0.1 * (i as f64).sin()).collect();
    let mut k = BlockMatrix::zeros(lattice.pattern.clone());
    lattice.hessian(&x, 0.0, &mut k);
    let k = dense(&k);
    let h = 1e-6;
    let (mut high, mut low) = (vec![0.0; x.len()], vec![0.0; x.len()]);
    for j in 0..x.len() {
        let mut moved = x.clone();
        moved[j] += h;
        lattice.gradient(&moved, &mut high);
        moved[j] -= 2.0 * h;
        lattice.gradient(&moved, &mut low);
        for i in 0..x.len() {
            let difference = (high[i] - low[i]) / (2.0 * h);
            assert!((k[(i, j)] - difference).abs() < 1e-6 * STIFFNESS, "entry ({i}, {j})");
        }
    }
}

#[test]
fn factor_solves_like_a_dense_one() {
    let lattice = Lattice::new([5, 6, 7], |p| p[2] == 0.0, |_| false, no_motion);
    let x = lattice.start();
    let mut k = BlockMatrix::zeros(lattice.pattern.clone());
    lattice.hessian(&x, 0.0, &mut k);
    let b: Vec<f64> = (0..x.len()).map(|i| (i as f64).cos()).collect();
    let exact = dense(&k).cholesky().unwrap().solve(&DVector::from_column_slice(&b));
    let analysis = Arc::new(Analysis::new(&lattice.pattern, &x));
    let mut double = Cholesky::<f64>::new(analysis.clone());
    double.factorize(&k).unwrap();
    let mut y = b.clone();
    double.solve(&mut y);
    let error = (DVector::from_column_slice(&y) - &exact).norm() / exact.norm();
    assert!(error < 1e-12, "double: {error:.1e}");
    let mut single = Cholesky::<f32>::new(analysis);
    single.factorize(&k).unwrap();
    let mut y = b;
    single.solve(&mut y);
    let error = (DVector::from_column_slice(&y) - &exact).norm() / exact.norm();
    assert!(error < 1e-4, "single: {error:.1e}");
    k.multiply(exact.as_slice(), &mut y);
    let left = (DVector::from_column_slice(&y) - dense(&k) * exact).norm();
    assert!(left < 1e-10, "product: {left:.1e}");
}

/// A slender body is best eliminated from its ends, layer by layer, a compact one by dissection: no order that serves one serves both.
#[test]
fn slender_and_compact_bodies_each_get_their_order() {
    let work = |n: [usize; 3]| {
        let lattice = Lattice::new(n, |_| false, |_| false, no_motion);
        Analysis::new(&lattice.pattern, &lattice.start()).work()
    };
    // Layer by layer the band is one layer, one row and two nodes wide.
    let by_layers = |n: [usize; 3]| {
        let band = (3 * (n[0] * n[1] + n[1] + 2)) as f64;
        (3 * n[0] * n[1] * n[2]) as f64 * band * band / 2.0
    };
    let (slender, compact) = ([8, 8, 125], [16, 16, 16]);
    let ratios = [slender, compact].map(|n| work(n) / by_layers(n));
    println!("slender {:.2}, compact {:.2} of layer by layer", ratios[0], ratios[1]);
    assert!(ratios[0] < 1.3, "slender: {:.2}", ratios[0]);
    assert!(ratios[1] < 0.6, "compact: {:.2}", ratios[1]);
}

/// The elimination tree of a chain from its ends is as deep as the chain is long; nothing recurses that deep.
#[test]
fn a_long_chain_is_factorized() {
    let n = 100_000;
    let links: Vec<[u32; 2]> = (1..n).map(|i| [i - 1, i]).collect();
    let pattern = Arc::new(Pattern::new(n as usize, links.iter().map(|l| &l[..])));
    let mut k = BlockMatrix::zeros(pattern.clone());
    let identity = |s: f64| std::array::from_fn(|e| if e % 4 == 0 { s } else { 0.0 });
    for i in 0..n as usize {
        k.add_block(i, i, &identity(2.001));
        if i > 0 {
            k.add_block(i, i - 1, &identity(-1.0));
            k.add_block(i - 1, i, &identity(-1.0));
        }
    }
    let points: Vec<f64> = (0..n).flat_map(|i| [f64::from(i), 0.0, 0.0]).collect();
    let mut factor = Cholesky::<f64>::new(Arc::new(Analysis::new(&pattern, &points)));
    factor.factorize(&k).unwrap();
    let b: Vec<f64> = (0..3 * n).map(|i| f64::from(i).cos()).collect();
    let (mut x, mut product) = (b.clone(), vec![0.0; b.len()]);
    factor.solve(&mut x);
    k.multiply(&x, &mut product);
    let left = product.iter().zip(&b).map(|(p, b)| (p - b).abs()).fold(0.0, f64::max);
    assert!(left < 1e-9, "{left:.1e}");
}

#[test]
fn a_negative_direction_anywhere_is_found() {
    let lattice = Lattice::new([4, 4, 4], |p| p[2] == 0.0, |_| false, no_motion);
    let x = lattice.start();
    let analysis = Arc::new(Analysis::new(&lattice.pattern, &x));
    for node in [0, 17, 40] {
        let mut k = BlockMatrix::zeros(lattice.pattern.clone());
        lattice.hessian(&x, 0.0, &mut k);
        assert!(Cholesky::<f64>::new(analysis.clone()).factorize(&k).is_ok());
        let mut minus = [0.0; 9];
        minus[4] = -1e4 * STIFFNESS;
        k.add_block(node, node, &minus);
        assert!(Cholesky::<f64>::new(analysis.clone()).factorize(&k).is_err(), "node {node}");
    }
}
