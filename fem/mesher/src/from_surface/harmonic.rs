//! A harmonic function on a closed surface, and its level lines.
//!
//! Discrete Laplacian with cotangent weights (U. Pinkall, K. Polthier, Exp Math 1993;2:15). Weights of obtuse pairs of
//! triangles would be negative and could make maxima between the ends; they are raised to a small positive value, so that
//! every vertex is a weighted mean of its neighbours and level lines are closed and do not cross.

use nalgebra::Vector3;

use fem::geometry::{Surface, SurfaceError};

/// Least weight of an edge; an edge between equilateral triangles has 1/√3.
const LEAST_WEIGHT: f64 = 0.01;
/// Relative residual at which the solution ends.
const TOLERANCE: f64 = 1e-10;

/// The function that is 0 on `zero`, 1 on `one` and harmonic between: one value per point. The two sets must be disjoint, not
/// empty, and the surface connected.
pub(super) fn solve(surface: &Surface, zero: &[u32], one: &[u32]) -> Vec<f64> {
    let matrix = Weights::new(surface);
    let n = surface.points.len();
    let mut value = vec![0.5; n];
    let mut free = vec![true; n];
    for (patch, x) in [(zero, 0.0), (one, 1.0)] {
        for &p in patch {
            (value[p as usize], free[p as usize]) = (x, false);
        }
    }
    // Conjugate gradients with the diagonal as preconditioner; fixed points have no residual.
    let residual = |value: &[f64]| -> Vec<f64> {
        (0..n).map(|i| if free[i] { -matrix.row_times(i, value) } else { 0.0 }).collect()
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut r = residual(&value);
    let mut z: Vec<f64> = (0..n).map(|i| r[i] / matrix.diagonal[i]).collect();
    let mut p = z.clone();
    let mut rz = dot(&r, &z);
    let stop = TOLERANCE * TOLERANCE * rz;
    for _ in 0..10 * n {
        if !(rz > stop) {
            break;
        }
        let kp: Vec<f64> = (0..n).map(|i| if free[i] { matrix.row_times(i, &p) } else { 0.0 }).collect();
        let alpha = rz / dot(&p, &kp);
        for i in 0..n {
            value[i] += alpha * p[i];
            r[i] -= alpha * kp[i];
            z[i] = r[i] / matrix.diagonal[i];
        }
        let next = dot(&r, &z);
        let beta = next / rz;
        rz = next;
        for i in 0..n {
            p[i] = z[i] + beta * p[i];
        }
    }
    value
}

/// The Laplacian as rows of neighbours.
struct Weights {
    /// First entry of every row, and one past the last.
    first: Vec<usize>,
    neighbours: Vec<(u32, f64)>,
    diagonal: Vec<f64>,
}

impl Weights {
    fn new(surface: &Surface) -> Weights {
        let mut entries: Vec<(u32, u32, f64)> = Vec::with_capacity(6 * surface.triangles.len());
        for (t, &[a, b, c]) in surface.triangles.iter().enumerate() {
            let x = surface.corners(t);
            for (k, (i, j)) in [(b, c), (c, a), (a, b)].into_iter().enumerate() {
                let (u, v) = (x[(k + 1) % 3] - x[k], x[(k + 2) % 3] - x[k]);
                let half_cotangent = u.dot(&v) / u.cross(&v).norm() / 2.0;
                entries.extend([(i, j, half_cotangent), (j, i, half_cotangent)]);
            }
        }
        entries.sort_unstable_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)));
        let n = surface.points.len();
        let mut weights = Weights { first: vec![0], neighbours: Vec::new(), diagonal: vec![0.0; n] };
        for row in entries.chunk_by(|a, b| a.0 == b.0) {
            let i = row[0].0 as usize;
            for edge in row.chunk_by(|a, b| a.1 == b.1) {
                let weight = edge.iter().map(|e| e.2).sum::<f64>().max(LEAST_WEIGHT);
                weights.neighbours.push((edge[0].1, weight));
                weights.diagonal[i] += weight;
            }
            weights.first.push(weights.neighbours.len());
        }
        weights
    }

    fn row_times(&self, i: usize, x: &[f64]) -> f64 {
        let row = &self.neighbours[self.first[i]..self.first[i + 1]];
        self.diagonal[i] * x[i] - row.iter().map(|&(j, w)| w * x[j as usize]).sum::<f64>()
    }
}

/// A closed line of points on the surface.
pub(super) type Line = Vec<Vector3<f64>>;

/// Level lines of a function given at the points of a closed surface.
pub(super) struct Levels<'a> {
    surface: &'a Surface,
    value: &'a [f64],
    neighbours: Vec<[Option<u32>; 3]>,
}

impl<'a> Levels<'a> {
    pub fn new(surface: &'a Surface, value: &'a [f64]) -> Result<Levels<'a>, SurfaceError> {
        Ok(Levels { surface, value, neighbours: surface.neighbours()? })
    }

    /// The closed lines at `level`, larger values on their left seen from outside: around a simple tube, counter-clockwise
    /// about the direction in which the function grows. Longest first.
    pub fn at(&self, level: f64) -> Vec<Line> {
        let above = |p: u32| self.value[p as usize] >= level;
        let triangles = &self.surface.triangles;
        // The line leaves a triangle through the edge along which the function passes the level upwards.
        let exit = |t: usize| {
            let c = triangles[t];
            (0..3).find(|&k| !above(c[k]) && above(c[(k + 1) % 3]))
        };
        let mut done = vec![false; triangles.len()];
        let mut lines = Vec::new();
        for start in 0..triangles.len() {
            let mut line = Line::new();
            let mut t = start;
            while !done[t] {
                let Some(k) = exit(t) else { break };
                done[t] = true;
                let (p, q) = (triangles[t][k] as usize, triangles[t][(k + 1) % 3] as usize);
                let f = (level - self.value[p]) / (self.value[q] - self.value[p]);
                let (x, y) = (Vector3::from(self.surface.points[p]), Vector3::from(self.surface.points[q]));
                line.push(x + f * (y - x));
                match self.neighbours[t][k] {
                    Some(next) => t = next as usize,
                    None => break, // a border: not in a closed surface
                }
            }
            if line.len() >= 3 {
                lines.push(line);
            }
        }
        lines.sort_by(|a, b| length(b).total_cmp(&length(a)));
        lines
    }
}

/// Length of a closed line \[m\].
pub(super) fn length(line: &[Vector3<f64>]) -> f64 {
    (0..line.len()).map(|i| (line[(i + 1) % line.len()] - line[i]).norm()).sum()
}

/// Area vector of a closed line \[m²\], and the centroid of the area it spans \[m\].
pub(super) fn area_and_centroid(line: &[Vector3<f64>]) -> (Vector3<f64>, Vector3<f64>) {
    let n = line.len();
    let middle = line.iter().sum::<Vector3<f64>>() / n as f64;
    let part = |i: usize| (line[i] - middle).cross(&(line[(i + 1) % n] - middle)) / 2.0;
    let area: Vector3<f64> = (0..n).map(part).sum();
    let direction = area / area.norm();
    let moment: Vector3<f64> =
        (0..n).map(|i| (line[i] + line[(i + 1) % n] - 2.0 * middle) / 3.0 * part(i).dot(&direction)).sum();
    (area, middle + moment / area.norm())
}
