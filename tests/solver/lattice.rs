//! A lattice of springs, whose answers need no finite element: a spring that is compressed has an
//! indefinite Hessian, and one shorter than a third of its length counts as inverted.

use fem::solve::{Admissible, BlockMatrix, Loading, PRESCRIBED, Pattern, Potential, Slots};
use nalgebra::{DMatrix, Vector3};
use std::sync::Arc;

/// Springs between the nodes of a grid, edges and diagonals of every cell.
pub struct Lattice {
    /// Current positions of prescribed nodes, rest positions of free ones; node-major.
    pub points: Vec<[f64; 3]>,
    pub rest: Vec<[f64; 3]>,
    /// Free index of every node.
    pub free: Vec<u32>,
    pub springs: Vec<[u32; 2]>,
    pub length: Vec<f64>,
    pub slots: Slots,
    pub pattern: Arc<Pattern>,
    pub fixed: Vec<bool>,
    /// Displacement of a prescribed point at load 1.
    pub motion: fn(&[f64; 3]) -> [f64; 3],
    pub linear: bool,
}

/// Stiffness \[N/m\] of every spring.
pub const STIFFNESS: f64 = 100.0;

/// Length ratio at which a spring counts as inverted.
pub const LEAST: f64 = 1.0 / 3.0;

impl Lattice {
    /// `n` nodes along each axis, 1 m apart; `held`: is this point prescribed; `roller`: is its z prescribed.
    pub fn new(
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

    pub fn of(
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

    pub fn start(&self) -> Vec<f64> {
        let free = self.free.iter().zip(&self.rest).filter(|(f, _)| **f != PRESCRIBED);
        free.flat_map(|(_, p)| *p).collect()
    }

    pub fn position(&self, x: &[f64], node: u32) -> Vector3<f64> {
        match self.free[node as usize] {
            PRESCRIBED => self.points[node as usize].into(),
            f => Vector3::from_column_slice(&x[3 * f as usize..3 * f as usize + 3]),
        }
    }

    /// Elongation, direction and length ratio of a spring.
    pub fn spring(&self, x: &[f64], s: usize) -> (f64, Vector3<f64>, f64) {
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

pub fn no_motion(_: &[f64; 3]) -> [f64; 3] {
    [0.0; 3]
}

fn norm(a: &[f64]) -> f64 {
    a.iter().map(|a| a * a).sum::<f64>().sqrt()
}

pub fn residual(lattice: &Lattice, x: &[f64]) -> f64 {
    let mut g = vec![0.0; x.len()];
    lattice.gradient(x, &mut g);
    for (g, _) in g.iter_mut().zip(&lattice.fixed).filter(|(_, fixed)| **fixed) {
        *g = 0.0;
    }
    norm(&g)
}

pub fn dense(k: &BlockMatrix) -> DMatrix<f64> {
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
