//! Does the solver find equilibria, refuse what has none, and name why?
//!
//! Asked of a lattice of springs, whose answers need no finite element: a spring that is compressed has an
//! indefinite Hessian, and one shorter than a third of its length counts as inverted.

use fem::solve::{
    Admissible, Analysis, BlockMatrix, Cholesky, Island, Iteration, IterationLog, Loading, NotConverged,
    PRESCRIBED, Pattern, Potential, Reason, Settings, Slots, SolveError, Solver, Stability, advance_islands,
};
use nalgebra::{DMatrix, DVector, Vector3};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Springs between the nodes of a grid, edges and diagonals of every cell.
struct Lattice {
    /// Current positions of prescribed nodes, rest positions of free ones; node-major.
    points: Vec<[f64; 3]>,
    rest: Vec<[f64; 3]>,
    /// Free index of every node.
    free: Vec<u32>,
    springs: Vec<[u32; 2]>,
    length: Vec<f64>,
    slots: Slots,
    pattern: Arc<Pattern>,
    fixed: Vec<bool>,
    /// Displacement of a prescribed point at load 1.
    motion: fn(&[f64; 3]) -> [f64; 3],
    linear: bool,
}

/// Stiffness \[N/m\] of every spring.
const STIFFNESS: f64 = 100.0;
/// Length ratio at which a spring counts as inverted.
const LEAST: f64 = 1.0 / 3.0;

impl Lattice {
    /// `n` nodes along each axis, 1 m apart; `held`: is this point prescribed; `roller`: is its z prescribed.
    fn new(
        n: [usize; 3],
        held: impl Fn(&[f64; 3]) -> bool,
        roller: impl Fn(&[f64; 3]) -> bool,
        motion: fn(&[f64; 3]) -> [f64; 3],
    ) -> Lattice {
        let mut rest = Vec::new();
        for i in 0..n[0] {
            for j in 0..n[1] {
                for k in 0..n[2] {
                    rest.push([i as f64, j as f64, k as f64]);
                }
            }
        }
        let mut free = Vec::new();
        let mut fixed = Vec::new();
        let mut n_free = 0;
        for p in &rest {
            if held(p) {
                free.push(PRESCRIBED);
            } else {
                free.push(n_free);
                n_free += 1;
                fixed.extend([false, false, roller(p)]);
            }
        }
        let mut springs = Vec::new();
        for a in 0..rest.len() {
            for b in a + 1..rest.len() {
                let far = (0..3).map(|c| (rest[a][c] - rest[b][c]).abs()).fold(0.0, f64::max);
                if far <= 1.0 && (free[a] != PRESCRIBED || free[b] != PRESCRIBED) {
                    springs.push([a as u32, b as u32]);
                }
            }
        }
        Lattice::of(rest, free, fixed, springs, motion)
    }

    fn of(
        rest: Vec<[f64; 3]>,
        free: Vec<u32>,
        fixed: Vec<bool>,
        springs: Vec<[u32; 2]>,
        motion: fn(&[f64; 3]) -> [f64; 3],
    ) -> Lattice {
        let at = |i: u32| Vector3::from(rest[i as usize]);
        let length = springs.iter().map(|s| (at(s[0]) - at(s[1])).norm()).collect();
        let n_free = free.iter().filter(|&&f| f != PRESCRIBED).count();
        let nodes: Vec<u32> = springs.iter().flatten().map(|&i| free[i as usize]).collect();
        let pattern = Arc::new(Pattern::new(n_free, nodes.chunks(2)));
        let slots = pattern.slots(2, &nodes);
        let points = rest.clone();
        Lattice { points, rest, free, springs, length, slots, pattern, fixed, motion, linear: false }
    }

    fn start(&self) -> Vec<f64> {
        let free = self.free.iter().zip(&self.rest).filter(|(f, _)| **f != PRESCRIBED);
        free.flat_map(|(_, p)| *p).collect()
    }

    fn position(&self, x: &[f64], node: u32) -> Vector3<f64> {
        match self.free[node as usize] {
            PRESCRIBED => self.points[node as usize].into(),
            f => Vector3::from_column_slice(&x[3 * f as usize..3 * f as usize + 3]),
        }
    }

    /// Elongation, direction and length ratio of a spring.
    fn spring(&self, x: &[f64], s: usize) -> (f64, Vector3<f64>, f64) {
        let [a, b] = self.springs[s];
        let d = self.position(x, b) - self.position(x, a);
        if self.linear {
            let d0 = Vector3::from(self.rest[b as usize]) - Vector3::from(self.rest[a as usize]);
            let n = d0.normalize();
            return (n.dot(&(d - d0)), n, 1.0);
        }
        (d.norm() - self.length[s], d.normalize(), d.norm() / self.length[s])
    }
}

impl Potential for Lattice {
    fn pattern(&self) -> &Arc<Pattern> {
        &self.pattern
    }

    fn fixed(&self) -> &[bool] {
        &self.fixed
    }

    fn energy(&self, x: &[f64]) -> f64 {
        let energy = |s| match self.spring(x, s) {
            (_, _, ratio) if ratio < LEAST => f64::INFINITY,
            (e, _, _) => 0.5 * STIFFNESS * e * e,
        };
        (0..self.springs.len()).map(energy).sum()
    }

    fn gradient(&self, x: &[f64], g: &mut [f64]) {
        g.fill(0.0);
        self.slots.add_vectors(g, 16, |first, out| {
            for (s, out) in out.chunks_exact_mut(6).enumerate() {
                let (e, n, _) = self.spring(x, first + s);
                for i in 0..3 {
                    out[i] = -STIFFNESS * e * n[i];
                    out[3 + i] = STIFFNESS * e * n[i];
                }
            }
        });
    }

    fn hessian(&self, x: &[f64], convexity: f64, k: &mut BlockMatrix) {
        k.clear();
        k.add_groups(&self.slots, 16, |first, out| {
            for (s, out) in out.chunks_exact_mut(36).enumerate() {
                let (e, n, _) = self.spring(x, first + s);
                let across = if self.linear { 0.0 } else { STIFFNESS * e / (e + self.length[first + s]) };
                let across = across - convexity * across.min(0.0);
                for i in 0..6 {
                    for j in 0..6 {
                        let (p, q) = (i % 3, j % 3);
                        let along = n[p] * n[q];
                        let block = STIFFNESS * along + across * (f64::from(p == q) - along);
                        out[6 * i + j] = if (i < 3) == (j < 3) { block } else { -block };
                    }
                }
            }
        });
    }

    fn force_scale(&self, x: &[f64]) -> f64 {
        let forces = (0..self.springs.len()).map(|s| STIFFNESS * self.spring(x, s).0);
        forces.map(|f| f * f).sum::<f64>().sqrt()
    }
}

impl Admissible for Lattice {
    fn least_det_f(&self, x: &[f64]) -> (f64, String) {
        let ratio = |s| self.spring(x, s).2;
        let worst = (0..self.springs.len()).min_by(|&a, &b| ratio(a).total_cmp(&ratio(b))).unwrap();
        (ratio(worst), format!("spring {worst}"))
    }
}

impl Loading for Lattice {
    fn set_load(&mut self, t: f64, x: &mut [f64]) {
        for (i, p) in self.rest.iter().enumerate() {
            let u = (self.motion)(p);
            let to = [p[0] + t * u[0], p[1] + t * u[1], p[2] + t * u[2]];
            match self.free[i] as usize {
                f if f as u32 == PRESCRIBED => self.points[i] = to,
                f if self.fixed[3 * f + 2] => x[3 * f + 2] = to[2],
                _ => {}
            }
        }
    }
}

fn no_motion(_: &[f64; 3]) -> [f64; 3] {
    [0.0; 3]
}

fn norm(a: &[f64]) -> f64 {
    a.iter().map(|a| a * a).sum::<f64>().sqrt()
}

fn residual(lattice: &Lattice, x: &[f64]) -> f64 {
    let mut g = vec![0.0; x.len()];
    lattice.gradient(x, &mut g);
    for (g, _) in g.iter_mut().zip(&lattice.fixed).filter(|(_, fixed)| **fixed) {
        *g = 0.0;
    }
    norm(&g)
}

fn dense(k: &BlockMatrix) -> DMatrix<f64> {
    let n = k.pattern().n_nodes();
    let mut full = DMatrix::zeros(3 * n, 3 * n);
    for i in 0..n {
        for (&j, b) in k.pattern().row(i).iter().zip(k.row(i)) {
            for r in 0..3 {
                for c in 0..3 {
                    full[(3 * i + r, 3 * j as usize + c)] = b[3 * r + c];
                }
            }
        }
    }
    full
}

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

#[test]
fn quadratic_potential_takes_one_step() {
    let pull = |p: &[f64; 3]| [0.1 * p[2], 0.0, 0.3 * p[2]];
    let mut lattice = Lattice::new([5, 5, 6], |p| p[2] == 0.0 || p[2] == 5.0, |_| false, pull);
    lattice.linear = true;
    let mut x = lattice.start();
    let mut log = Vec::new();
    let settings = Settings { tolerance: 1e-10, ..Settings::default() };
    let advance = Solver::new("lattice", settings).advance(&mut lattice, &mut x, 0, &mut log).unwrap();
    assert!(residual(&lattice, &x) <= 1e-10 * lattice.force_scale(&x));
    // Carrying the load over solves it to the tolerance of the prediction, one Newton step to the last digit.
    assert_eq!((advance.load_steps, advance.iterations, advance.factorizations), (1, 1, 1), "{log:?}");
}

#[test]
fn converges_quadratically_where_springs_turn() {
    let shear = |p: &[f64; 3]| [0.4 * p[2], 0.0, 0.0];
    let mut lattice = Lattice::new([4, 4, 6], |p| p[2] == 0.0 || p[2] == 5.0, |_| false, shear);
    let mut x = lattice.start();
    let mut log = Vec::new();
    let settings = Settings { tolerance: 1e-12, ..Settings::default() };
    Solver::new("lattice", settings).advance(&mut lattice, &mut x, 0, &mut log).unwrap();
    let last: Vec<f64> = log.iter().rev().take(3).map(|r| (r.residual / r.force_scale).log10()).collect();
    assert!(last[0] <= -12.0 && log.len() <= 8, "log10 of the residuals, last first: {last:?}");
}

#[test]
fn indefinite_start_finds_a_minimum() {
    let mut lattice = Lattice::new([4, 4, 4], |p| p[2] == 0.0, |_| false, no_motion);
    let mut x: Vec<f64> = lattice
        .start()
        .chunks_exact(3)
        .flat_map(|p| [0.6 * p[0], 0.6 * p[1] + 0.01 * p[0], 0.6 * p[2]])
        .collect();
    let mut k = BlockMatrix::zeros(lattice.pattern.clone());
    lattice.hessian(&x, 0.0, &mut k);
    assert!(dense(&k).symmetric_eigenvalues().min() < 0.0, "the start is meant to be indefinite");
    let mut log = Vec::new();
    // At rest no forces are in play to which a residual could be relative.
    let settings = Settings { least_force: STIFFNESS, ..Settings::default() };
    Solver::new("lattice", settings).advance(&mut lattice, &mut x, 0, &mut log).unwrap();
    lattice.hessian(&x, 0.0, &mut k);
    assert!(dense(&k).symmetric_eigenvalues().min() > 0.0);
    assert!(log.iter().any(|r| r.projected));
    let rest = lattice.start();
    let away = x.iter().zip(&rest).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(away < 1e-4, "the rest shape is the minimum nearby, {away:.1e} m away");
}

#[test]
fn no_step_is_taken_through_an_inversion() {
    // Pressed and sheared at once: the straight prediction would press some springs below a third.
    let press = |p: &[f64; 3]| [0.0, 0.5 * p[2], -0.4 * p[2]];
    let mut lattice = Lattice::new([4, 4, 5], |p| p[2] == 0.0 || p[2] == 4.0, |_| false, press);
    let mut x = lattice.start();
    let mut log = Vec::new();
    Solver::new("lattice", Settings::default()).advance(&mut lattice, &mut x, 0, &mut log).unwrap();
    assert!(residual(&lattice, &x) <= 1e-6 * lattice.force_scale(&x));
    assert!(log.iter().all(|r| r.least_det_f >= LEAST && r.energy.is_finite()));
}

#[test]
fn impossible_load_keeps_the_last_equilibrium_and_says_where() {
    // A node guided along z between two plates that close: its two springs need two thirds of the height.
    let squash = |p: &[f64; 3]| [0.0, 0.0, -0.95 * p[2]];
    let rest = vec![[0.0; 3], [0.0, 0.0, 1.0], [0.0, 0.0, 2.0]];
    let free = vec![PRESCRIBED, 0, PRESCRIBED];
    let fixed = vec![true, true, false];
    let mut lattice = Lattice::of(rest, free, fixed, vec![[0, 1], [1, 2]], squash);
    let mut x = lattice.start();
    let mut log = Vec::new();
    let error =
        Solver::new("lattice", Settings::default()).advance(&mut lattice, &mut x, 3, &mut log).unwrap_err();
    let SolveError::NotConverged(stop) = &error else { panic!("{error}") };
    let NotConverged { load, reason, step, place, .. } = &**stop;
    assert_eq!((*step, reason), (3, &Reason::Inversion));
    assert!(place.starts_with("spring"), "{place}");
    assert!(
        (0.69..0.71).contains(load),
        "two thirds of the height are reached at load 0.702, stopped at {load}"
    );
    lattice.set_load(*load, &mut x);
    assert!(residual(&lattice, &x) <= 1e-6 * lattice.force_scale(&x).max(1e-9));
}

#[test]
fn unsupported_island_is_refused_with_its_free_motions() {
    let refused = |mut lattice: Lattice| {
        let mut x = lattice.start();
        match Solver::new("lattice", Settings::default()).advance(&mut lattice, &mut x, 0, &mut Vec::new()) {
            Err(SolveError::Unsupported { parts, .. }) => parts,
            other => panic!("{other:?}"),
        }
    };
    let floating = refused(Lattice::new([3, 3, 3], |_| false, |_| false, no_motion));
    assert_eq!(floating.len(), 1);
    assert_eq!(floating[0].directions.len(), 6, "{floating:?}");
    let on_rollers = refused(Lattice::new([3, 3, 3], |_| false, |p| p[2] == 0.0, no_motion));
    let names = &on_rollers[0].directions;
    assert_eq!(names.len(), 3, "{names:?}");
    assert!(names[0] == "translation along x" && names[1] == "translation along y", "{names:?}");
    assert!(names[2].starts_with("rotation about z"), "{names:?}");
    let hinged = refused(Lattice::new([3, 3, 3], |p| p[1] == 0.0 && p[2] == 0.0, |_| false, no_motion));
    assert_eq!(hinged[0].directions.len(), 1, "{hinged:?}");
    assert!(hinged[0].directions[0].contains("rotation about x"), "{hinged:?}");
}

#[test]
fn mechanism_is_named_with_node_and_direction() {
    // A node between two collinear springs: nothing resists it sideways.
    let rest = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 1.0, 0.0]];
    let free = vec![PRESCRIBED, 0, PRESCRIBED, PRESCRIBED];
    let springs = vec![[0, 1], [1, 2], [1, 3]];
    let mut lattice = Lattice::of(rest, free, vec![false; 3], springs, no_motion);
    let mut x = lattice.start();
    let error = Solver::new("chain", Settings::default()).advance(&mut lattice, &mut x, 0, &mut Vec::new());
    let Err(error) = error else { panic!("solved: {error:?}") };
    assert!(error.to_string().contains('z'), "{error}");
    assert!(matches!(error, SolveError::Unsupported { .. }), "{error}");
}

#[test]
fn same_bits_on_any_number_of_threads() {
    let twist = |p: &[f64; 3]| [-0.15 * p[2] * p[1] / 12.0, 0.15 * p[2] * p[0] / 12.0, -0.1 * p[2]];
    let solve = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let islands = |n: usize| {
                let lattice = Lattice::new([n, n, 13], |p| p[2] == 0.0 || p[2] == 12.0, |_| false, twist);
                let x = lattice.start();
                Island::new(&format!("island {n}"), Box::new(lattice), x, Settings::default())
            };
            let mut islands: Vec<Island> = [12, 5, 9].map(islands).into();
            let mut log = Vec::new();
            let results = advance_islands(&mut islands, 0, &mut log);
            assert!(results.iter().all(Result::is_ok), "{results:?}");
            let bits: Vec<u64> = islands.iter().flat_map(|i| &i.x).map(|x| x.to_bits()).collect();
            let names: Vec<String> = log.into_iter().map(|r| r.island).collect();
            (bits, names)
        })
    };
    let one = solve(1);
    assert!(one == solve(2), "1 and 2 threads");
    assert!(one == solve(3), "1 and 3 threads");
}

#[test]
fn buckled_column_is_left_for_a_stable_one() {
    // A slender column pressed exactly along its axis, five times beyond Euler's strain of 4π² (0.5 m / 24 m)²: the
    // straight state stays an equilibrium but is no minimum.
    let press = |p: &[f64; 3]| [0.0, 0.0, -0.08 * p[2]];
    let mut column = Lattice::new([2, 2, 25], |p| p[2] == 0.0 || p[2] == 24.0, |_| false, press);
    let mut x = column.start();
    let mut solver = Solver::new("column", Settings::default());
    let advance = solver.advance(&mut column, &mut x, 0, &mut Vec::new()).unwrap();
    assert!(!advance.indefinite_at.is_empty(), "the instability is reported");
    assert!(advance.tested_stable, "and what is handed back was tested");
    let mut k = BlockMatrix::zeros(column.pattern.clone());
    column.hessian(&x, 0.0, &mut k);
    let least = dense(&k).symmetric_eigenvalues().min();
    assert!(least > 0.0, "the equilibrium reported is stable, least eigenvalue {least:.1e}");
    let sideways = x.chunks_exact(3).map(|p| (p[0] - 0.5).abs().max((p[1] - 0.5).abs())).fold(0.0, f64::max);
    assert!(sideways > 1.5, "the column bends out, by {sideways:.2} m");
}

#[test]
fn equilibrium_that_is_no_minimum_is_found_out() {
    // One spring pushed together exactly along its line by a weaker pair: g = 0 all the way, K is not positive.
    let press = |_: &[f64; 3]| [0.0, 0.0, 0.0];
    let rest =
        vec![[0.0; 3], [0.0, 0.0, 1.0], [0.0, 0.0, 2.0], [4.0, 0.0, 1.0], [0.0, 4.0, 1.0], [1.0, 1.0, 2.0]];
    let free = vec![PRESCRIBED, 0, PRESCRIBED, PRESCRIBED, PRESCRIBED, 1];
    let springs = vec![[0, 1], [1, 2], [1, 3], [1, 4], [5, 1], [5, 2], [5, 3], [5, 4]];
    let mut lattice = Lattice::of(rest, free, vec![false; 6], springs, press);
    lattice.length[0] = 1.8; // both compressed by almost half: the middle wants to snap sideways
    lattice.length[1] = 1.8;
    let mut x = lattice.start();
    assert!(residual(&lattice, &x) < 1e-12);
    let settings = Settings { stability: Stability::Always, ..Settings::default() };
    let advance = Solver::new("pair", settings).advance(&mut lattice, &mut x, 0, &mut Vec::new()).unwrap();
    assert_eq!(advance.unstable_at, [1.0]);
    assert!(x[0].hypot(x[1]) > 0.1, "snapped to {x:?}");
    assert!(residual(&lattice, &x) <= 1e-6 * lattice.force_scale(&x));
}

#[test]
fn log_has_its_name_only_when_finished() {
    let folder = tempfile::tempdir().unwrap();
    let row = Iteration {
        island: "a, b".into(),
        step: 1,
        load: 0.5,
        iteration: 2,
        residual: 1e-3,
        force_scale: 2.0,
        energy: -3.0,
        step_length: 1.0,
        least_det_f: 0.9,
        linear_iterations: 4,
        factorizations: 1,
        projected: false,
        seconds: 0.1,
    };
    let path = folder.path().join("iterations.csv");
    std::fs::write(&path, "of an earlier run").unwrap();
    let mut log = IterationLog::create(folder.path()).unwrap();
    log.write(&[row.clone(), row]).unwrap();
    assert!(!path.exists(), "a run that is killed now leaves no finished log");
    drop(log);
    assert!(!path.exists());
    let mut log = IterationLog::create(folder.path()).unwrap();
    log.write(&[]).unwrap();
    assert_eq!(log.finish().unwrap(), path);
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.starts_with("island,step,load,iteration,residual_N,"), "{text}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing else is left");
}

/// A lattice whose Hessian is indefinite wherever it is looked at as it is.
struct Saddle(Lattice);

impl Potential for Saddle {
    fn pattern(&self) -> &Arc<Pattern> {
        self.0.pattern()
    }

    fn energy(&self, x: &[f64]) -> f64 {
        self.0.energy(x)
    }

    fn gradient(&self, x: &[f64], g: &mut [f64]) {
        self.0.gradient(x, g);
    }

    fn hessian(&self, x: &[f64], convexity: f64, k: &mut BlockMatrix) {
        self.0.hessian(x, convexity, k);
        if convexity == 0.0 {
            k.add_block(0, 0, &[-1e4 * STIFFNESS, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        }
    }

    fn force_scale(&self, x: &[f64]) -> f64 {
        self.0.force_scale(x)
    }
}

impl Admissible for Saddle {
    fn least_det_f(&self, x: &[f64]) -> (f64, String) {
        self.0.least_det_f(x)
    }
}

impl Loading for Saddle {
    fn set_load(&mut self, t: f64, x: &mut [f64]) {
        self.0.set_load(t, x);
    }
}

/// Once the fourth equilibrium was called solved without a look at its stability.
#[test]
fn an_equilibrium_that_stays_unstable_is_not_solved() {
    let pull = |p: &[f64; 3]| [0.0, 0.0, 0.1 * p[2]];
    let mut saddle = Saddle(Lattice::new([3, 3, 3], |p| p[2] == 0.0 || p[2] == 2.0, |_| false, pull));
    let mut x = saddle.0.start();
    let settings = Settings { stability: Stability::Always, least_step: 0.5, ..Settings::default() };
    let error = Solver::new("saddle", settings).advance(&mut saddle, &mut x, 0, &mut Vec::new()).unwrap_err();
    let SolveError::NotConverged(stop) = &error else { panic!("{error}") };
    assert_eq!(stop.reason, Reason::Unstable, "{error}");
}

/// A lattice whose energy may jump while it is softened, right beyond where it starts; what touches cuts steps in half.
struct Ledge {
    lattice: Lattice,
    jumps: bool,
    /// Where the load ends is guessed.
    guessed: bool,
    /// Whoever looks says that the softened way leads through somebody.
    leads_through: bool,
    softness: f64,
    /// Where softening began, one after the other, and how often overlaps were parted.
    schedule: Vec<f64>,
    parted: AtomicUsize,
}

impl Ledge {
    fn new(jumps: bool, guessed: bool) -> Ledge {
        let pull = |p: &[f64; 3]| [0.0, 0.0, 0.25 * p[2]];
        let lattice = Lattice::new([3, 3, 3], |p| p[2] == 0.0 || p[2] == 2.0, |_| false, pull);
        let (softness, leads_through) = (0.0, false);
        Ledge {
            lattice,
            jumps,
            guessed,
            leads_through,
            softness,
            schedule: Vec::new(),
            parted: AtomicUsize::new(0),
        }
    }

    /// Energy by which it jumps \[J\], and how far from the start \[m\].
    const JUMP: f64 = 1e3;
    const AT: f64 = 1e-8;
}

impl Potential for Ledge {
    fn pattern(&self) -> &Arc<Pattern> {
        self.lattice.pattern()
    }

    fn energy(&self, x: &[f64]) -> f64 {
        let jumps = self.jumps && self.softness > 0.0 && x[2] > 1.0 + Ledge::AT;
        let jump = if jumps { Ledge::JUMP } else { 0.0 };
        self.lattice.energy(x) + jump
    }

    fn gradient(&self, x: &[f64], g: &mut [f64]) {
        self.lattice.gradient(x, g);
    }

    fn hessian(&self, x: &[f64], convexity: f64, k: &mut BlockMatrix) {
        self.lattice.hessian(x, convexity, k);
    }

    fn force_scale(&self, x: &[f64]) -> f64 {
        self.lattice.force_scale(x)
    }
}

impl Admissible for Ledge {
    fn least_det_f(&self, x: &[f64]) -> (f64, String) {
        self.lattice.least_det_f(x)
    }

    fn touching(&self, x: &[f64]) -> Vec<f64> {
        let prescribed = self.lattice.points.iter().flatten();
        x.iter().chain(prescribed).copied().collect()
    }

    fn collision_free_step(&self, from: &[f64], x: &[f64]) -> f64 {
        let way = from.iter().zip(self.touching(x)).map(|(from, to)| (from - to).abs()).fold(0.0, f64::max);
        if way > 0.05 { 0.5 } else { 1.0 }
    }
}

impl Loading for Ledge {
    fn set_load(&mut self, t: f64, x: &mut [f64]) {
        self.lattice.set_load(t, x);
    }

    fn n_pieces(&self, _t: f64) -> usize {
        1
    }

    fn is_guessed(&self, t: f64) -> bool {
        self.guessed && t == 1.0
    }

    fn soften(&mut self, softness: f64) -> bool {
        if softness > 0.0 {
            self.schedule.push(softness);
        }
        self.softness = softness;
        true
    }

    fn untangle(&self, _x: &mut [f64], _softness: f64) -> bool {
        self.parted.fetch_add(1, Ordering::Relaxed);
        true
    }

    fn keeps_sides(&self, _from: &[f64], _x: &[f64]) -> bool {
        assert_eq!(self.softness, 0.0, "with contact as it is");
        !self.leads_through
    }
}

/// A guess is near equilibrium with hard contact: the softest stage, which others begin with, is left out.
#[test]
fn a_guess_begins_with_hard_contact() {
    let [plain, led] = [false, true].map(|guessed| {
        let mut ledge = Ledge::new(false, guessed);
        let mut x = ledge.lattice.start();
        Solver::new("ledge", Settings::default()).advance(&mut ledge, &mut x, 0, &mut Vec::new()).unwrap();
        assert!(residual(&ledge.lattice, &x) <= 1e-6 * ledge.lattice.force_scale(&x));
        ledge.schedule
    });
    // Both look first whether anything is met, with softest contact.
    let [look, softest, harder @ ..] = &plain[..] else { panic!("softened below {plain:?}") };
    assert_eq!((look, harder.is_empty()), (softest, false), "softened below {plain:?}");
    assert_eq!((&led[0], &led[1..]), (look, harder), "softened below {led:?}");
}

/// A softened way that leads through somebody is looked at once, and nothing is softened after it.
#[test]
fn a_softened_way_that_leads_through_is_the_last_one() {
    let mut ledge = Ledge { leads_through: true, ..Ledge::new(false, false) };
    let mut x = ledge.lattice.start();
    let advance =
        Solver::new("ledge", Settings::default()).advance(&mut ledge, &mut x, 0, &mut Vec::new()).unwrap();
    assert!(residual(&ledge.lattice, &x) <= 1e-6 * ledge.lattice.force_scale(&x));
    assert_eq!((advance.soft_ways, advance.wrong_ways), (0, 1));
    assert!(advance.load_steps > 1, "collision detection cuts the way");
    assert_eq!(ledge.parted.into_inner(), 1, "softened below {:?}", ledge.schedule);
}

/// Where softened contact does not settle, collision detection alone goes the first piece of the way; from there it is tried again.
#[test]
fn softened_contact_that_does_not_settle_waits_for_collision_detection() {
    let mut ledge = Ledge::new(true, false);
    let mut x = ledge.lattice.start();
    let mut log = Vec::new();
    let advance = Solver::new("ledge", Settings::default()).advance(&mut ledge, &mut x, 0, &mut log).unwrap();
    assert!(residual(&ledge.lattice, &x) <= 1e-6 * ledge.lattice.force_scale(&x));
    assert_eq!((advance.load_steps, advance.loose_steps, advance.retries), (2, 1, 0), "{log:?}");
    assert!(log[0].load < 1.0 && log[0].energy < Ledge::JUMP, "{:?}", log[0]);
    assert_eq!((advance.soft_ways, ledge.parted.into_inner()), (1, 1), "softened below {:?}", ledge.schedule);
    // Only the first stage did not settle.
    let tries = ledge.schedule.iter().filter(|softness| **softness == ledge.schedule[0]).count();
    assert!(tries > 1 && ledge.schedule.is_sorted_by(|a, b| a >= b), "softened below {:?}", ledge.schedule);
}
