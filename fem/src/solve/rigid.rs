//! Rigid motions that nothing resists: found and named before the first step.

use super::{BlockMatrix, Pattern};
use nalgebra::{DMatrix, Matrix6, RowVector6, Vector3};
use std::collections::BTreeMap;

/// Sum over the nodes of (|K u| / stiffness of the node / displacement)² that counts as no resistance, where round-off explains it.
const NO_RESISTANCE: f64 = 1e-13;
/// Round-off in a row of K, relative to its largest entry: of the sums over neighbours and quadrature points, 64 units in the last place.
/// More by the distance from the origin over the distance to the neighbours, whose coordinates are subtracted from each other. A body of
/// K/G = 10⁸ held by faces in shear resists with 10⁻⁸ of the stiffness of its nodes.
const ROUND_OFF: f64 = 64.0 * f64::EPSILON;

/// A part of the mesh that can move rigidly without any force.
#[derive(Clone, Debug, PartialEq)]
pub struct LooseComponent {
    /// Its least free node.
    pub node: usize,
    /// Its number of free nodes.
    pub n_nodes: usize,
    /// The free motions, e.g. "translation along x", "rotation about (0.71, 0.71, 0.00) through the centroid".
    pub directions: Vec<String>,
}

impl std::fmt::Display for LooseComponent {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{} nodes from free node {} on: {}", self.n_nodes, self.node, self.directions.join(", "))
    }
}

/// Parts of the graph (components) whose rigid motions are neither resisted by `k` nor prescribed by `fixed`. `followers`: fixed unknowns that
/// take over the displacement of another, with it.
///
/// `x`: positions of the free nodes \[m\], best those of the unstressed shape.
pub fn loose_components(
    k: &BlockMatrix,
    fixed: &[bool],
    followers: &[[usize; 2]],
    x: &[f64],
) -> Vec<LooseComponent> {
    let leaders: BTreeMap<usize, usize> = followers.iter().map(|&[of, leader]| (of, leader)).collect();
    let loose = |nodes: Vec<usize>| loose_component(k, fixed, &leaders, x, &nodes);
    components(k.pattern()).into_iter().filter_map(loose).collect()
}

/// Connected components, each sorted.
fn components(pattern: &Pattern) -> Vec<Vec<usize>> {
    let mut seen = vec![false; pattern.n_nodes()];
    let mut all = Vec::new();
    for start in 0..pattern.n_nodes() {
        if std::mem::replace(&mut seen[start], true) {
            continue;
        }
        let mut nodes = vec![start];
        let mut next = 0;
        while next < nodes.len() {
            for &j in pattern.row(nodes[next]) {
                if !std::mem::replace(&mut seen[j as usize], true) {
                    nodes.push(j as usize);
                }
            }
            next += 1;
        }
        nodes.sort_unstable();
        all.push(nodes);
    }
    all
}

/// The rigid motions R of a part whose forces K R are round-off at every node against the stiffness of that node (not
/// against the stiffest: tissue beside steel still supports), with a unit spring on every fixed unknown, between it and its leader where it
/// has one.
fn loose_component(
    k: &BlockMatrix,
    fixed: &[bool],
    leaders: &BTreeMap<usize, usize>,
    x: &[f64],
    nodes: &[usize],
) -> Option<LooseComponent> {
    let at = |i: usize| Vector3::from_column_slice(&x[3 * i..3 * i + 3]);
    let centre = nodes.iter().map(|&i| at(i)).sum::<Vector3<f64>>() / nodes.len() as f64;
    let radius = nodes.iter().map(|&i| (at(i) - centre).norm_squared()).sum::<f64>() / nodes.len() as f64;
    let radius = if radius > 0.0 { radius.sqrt() } else { 1.0 };
    let motion = |i: usize, mode: usize| match mode {
        0..3 => Vector3::ith(mode, 1.0),
        _ => Vector3::ith(mode - 3, 1.0).cross(&(at(i) - centre)) / radius,
    };
    let mut resistance = Triangle::default();
    let mut gram = Matrix6::<f64>::zeros();
    let mut round_off = 0.0;
    for &i in nodes {
        let others = k.pattern().row(i).iter().map(|&j| j as usize).filter(|j| *j != i);
        let nearest = others.map(|j| (at(j) - at(i)).norm()).fold(f64::INFINITY, f64::min);
        round_off += (ROUND_OFF * (1.0 + at(i).norm() / nearest)).powi(2);
        let u: [Vector3<f64>; 6] = std::array::from_fn(|m| motion(i, m));
        let mut force = [Vector3::zeros(); 6];
        for (&j, b) in k.pattern().row(i).iter().zip(k.row(i)) {
            let b = nalgebra::Matrix3::from_row_slice(b);
            for (m, force) in force.iter_mut().enumerate() {
                *force += b * motion(j as usize, m);
            }
        }
        let own = (0..3).map(|c| k.diagonal(3 * i + c)).fold(0.0, f64::max);
        let own = if own > 0.0 { own } else { 1.0 };
        for c in 0..3 {
            resistance.add(RowVector6::from_fn(|_, m| force[m][c] / own));
            if fixed.get(3 * i + c) == Some(&true) {
                let leader = leaders.get(&(3 * i + c));
                let of_leader = |m: usize| leader.map_or(0.0, |&l| motion(l / 3, m)[l % 3]);
                resistance.add(RowVector6::from_fn(|_, m| u[m][c] - of_leader(m)));
            }
        }
        for m in 0..6 {
            for n in 0..6 {
                gram[(m, n)] += u[m].dot(&u[n]);
            }
        }
    }
    // Rotations that move no node (of a single node, or about the line of nodes in a row) are no motions.
    let gram = gram.symmetric_eigen();
    let moving: Vec<usize> =
        (0..6).filter(|&e| gram.eigenvalues[e] > 1e-9 * gram.eigenvalues.max()).collect();
    let basis = DMatrix::from_fn(6, moving.len(), |r, c| {
        gram.eigenvectors[(r, moving[c])] / (gram.eigenvalues[moving[c]] / nodes.len() as f64).sqrt()
    });
    let resistance = resistance.finish() * &basis;
    if resistance.iter().any(|r| !r.is_finite()) {
        return None; // beyond what a number can hold: the solver says so
    }
    // Singular values, as their squares would drown in the round-off of the largest.
    let svd = resistance.svd(false, true);
    let directions = svd.v_t.expect("asked for").transpose();
    let none = (NO_RESISTANCE.min(round_off)).sqrt() * svd.singular_values.max().max(1.0);
    let free: Vec<usize> = (0..moving.len()).filter(|&e| svd.singular_values[e] <= none).collect();
    if free.is_empty() {
        return None;
    }
    let space = basis * DMatrix::from_fn(moving.len(), free.len(), |r, c| directions[(r, free[c])]);
    Some(LooseComponent { node: nodes[0], n_nodes: nodes.len(), directions: name(space, centre) })
}

/// The triangle R of a QR factorization of a matrix of six columns, row by row.
#[derive(Default)]
struct Triangle {
    rows: Vec<RowVector6<f64>>,
}

/// Rows that are kept before they are reduced to a triangle.
const ROWS: usize = 256;

impl Triangle {
    fn add(&mut self, row: RowVector6<f64>) {
        self.rows.push(row);
        if self.rows.len() == ROWS {
            self.reduce();
        }
    }

    fn reduce(&mut self) {
        let r =
            DMatrix::from_fn(self.rows.len().max(6), 6, |i, j| self.rows.get(i).map_or(0.0, |row| row[j]))
                .qr()
                .r();
        self.rows = (0..6).map(|i| RowVector6::from_fn(|_, j| r[(i, j)])).collect();
    }

    fn finish(mut self) -> DMatrix<f64> {
        self.reduce();
        DMatrix::from_fn(6, 6, |i, j| self.rows[i][j])
    }
}

/// Names a basis of the space of free motions, brought to echelon form so that pure motions show as such.
fn name(space: DMatrix<f64>, centre: Vector3<f64>) -> Vec<String> {
    let mut rows = space.transpose();
    let mut done = 0;
    for column in 0..6 {
        let Some(pivot) = (done..rows.nrows())
            .filter(|&r| rows[(r, column)].abs() > 1e-6)
            .max_by(|&a, &b| rows[(a, column)].abs().total_cmp(&rows[(b, column)].abs()))
        else {
            continue;
        };
        rows.swap_rows(pivot, done);
        let scale = rows[(done, column)];
        rows.row_mut(done).unscale_mut(scale);
        for r in (0..rows.nrows()).filter(|&r| r != done) {
            let factor = rows[(r, column)];
            let minus = rows.row(done) * factor;
            rows.row_mut(r).zip_apply(&minus, |a, b| *a -= b);
        }
        done += 1;
    }
    let axis = |v: Vector3<f64>| {
        let v = v.normalize();
        match (0..3).find(|&i| v[i].abs() > 1.0 - 1e-6) {
            Some(i) => ["x", "y", "z"][i].to_string(),
            None => format!("({:.2}, {:.2}, {:.2})", v[0], v[1], v[2]),
        }
    };
    let through = format!("({:.3e}, {:.3e}, {:.3e})", centre[0], centre[1], centre[2]);
    rows.row_iter()
        .map(|r| {
            let translation = Vector3::new(r[0], r[1], r[2]);
            let rotation = Vector3::new(r[3], r[4], r[5]);
            match (translation.norm() > 1e-5, rotation.norm() > 1e-5) {
                (true, false) => format!("translation along {}", axis(translation)),
                (false, _) => format!("rotation about {} through {through}", axis(rotation)),
                (true, true) => format!(
                    "rotation about {} through {through} with translation along {}",
                    axis(rotation),
                    axis(translation)
                ),
            }
        })
        .collect()
}
