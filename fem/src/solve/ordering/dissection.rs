//! Nested dissection of the node graph by planes: best for compact bodies.
//!
//! A set of nodes is halved by the plane through the median of its nodes, normal to the axis (of the frame and of
//! the set's own principal axes) that leaves the smallest separator; the separator is eliminated after both halves.
//! George, Nested dissection of a regular finite element mesh, SIAM J. Numer. Anal. 10 (1973);
//! Gilbert, Miller, Teng, Geometric mesh partitioning, SIAM J. Sci. Comput. 19 (1998).

use super::{Pattern, Supernode};
use nalgebra::{Matrix3, Vector3};

/// Sets no larger than this are not divided further: dense elimination is then as cheap (measured 24..64: within 5 %).
const LEAF: usize = 40;

/// Divides all nodes of `pattern`; `points`: a place for every node, three coordinates each.
pub fn dissect(pattern: &Pattern, points: &[f64]) -> Vec<Supernode> {
    let nodes: Vec<u32> = (0..pattern.n_nodes() as u32).collect();
    let mut dissection = Dissection { pattern, points, side: vec![OUTSIDE; pattern.n_nodes()] };
    dissection.divide(nodes)
}

const OUTSIDE: u8 = 0;
const LOW: u8 = 1;
const HIGH: u8 = 2;
const SEPARATOR: u8 = 3;

struct Dissection<'a> {
    pattern: &'a Pattern,
    points: &'a [f64],
    /// Where each node of the set at hand belongs; `OUTSIDE` for all others.
    side: Vec<u8>,
}

impl Dissection<'_> {
    fn divide(&mut self, nodes: Vec<u32>) -> Vec<Supernode> {
        if nodes.len() <= LEAF {
            return vec![Supernode { nodes, children: Vec::new() }];
        }
        let mut best: Option<Vec<(u32, u8)>> = None;
        let mut least = usize::MAX;
        for axis in self.axes(&nodes) {
            let sides = self.halve(&nodes, axis);
            let size = sides.iter().filter(|(_, s)| *s == SEPARATOR).count();
            if size < least {
                least = size;
                best = Some(sides);
            }
        }
        let sides = best.expect("at least one axis");
        let pick = |side| sides.iter().filter(|(_, s)| *s == side).map(|(n, _)| *n).collect::<Vec<u32>>();
        let (low, high, separator) = (pick(LOW), pick(HIGH), pick(SEPARATOR));
        if low.is_empty() || high.is_empty() {
            return vec![Supernode { nodes, children: Vec::new() }]; // nothing to gain: everybody touches everybody
        }
        let mut children = self.divide(low);
        children.extend(self.divide(high));
        if separator.is_empty() {
            return children; // the halves do not touch
        }
        vec![Supernode { nodes: separator, children }]
    }

    /// Normals to try: the axes of the frame and the principal axes along which the set is long.
    fn axes(&self, nodes: &[u32]) -> Vec<Vector3<f64>> {
        let n = nodes.len() as f64;
        let mean = nodes.iter().map(|&i| self.point(i)).sum::<Vector3<f64>>() / n;
        let covariance: Matrix3<f64> = nodes
            .iter()
            .map(|&i| {
                let r = self.point(i) - mean;
                r * r.transpose()
            })
            .sum();
        let eigen = covariance.symmetric_eigen();
        let widest = eigen.eigenvalues.max();
        let principal = (0..3)
            .filter(|&i| eigen.eigenvalues[i] >= widest / 4.0)
            .map(|i| eigen.eigenvectors.column(i).into());
        let frame = (0..3).filter(|&i| covariance[(i, i)] >= widest / 4.0).map(|i| Vector3::ith(i, 1.0));
        frame.chain(principal).collect()
    }

    fn point(&self, node: u32) -> Vector3<f64> {
        Vector3::from_column_slice(&self.points[3 * node as usize..3 * node as usize + 3])
    }

    /// Halves by the median along `axis`; returns the side of every node, in the order of `nodes`.
    fn halve(&mut self, nodes: &[u32], axis: Vector3<f64>) -> Vec<(u32, u8)> {
        let mut along: Vec<(f64, u32)> = nodes.iter().map(|&i| (self.point(i).dot(&axis), i)).collect();
        let middle = along.len() / 2;
        along.select_nth_unstable_by(middle, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (k, &(_, i)) in along.iter().enumerate() {
            self.side[i as usize] = if k < middle { LOW } else { HIGH };
        }
        let border = |me: &Self, from: u8, to: u8| -> Vec<u32> {
            let touches = |i: u32| me.pattern.row(i as usize).iter().any(|&j| me.side[j as usize] == to);
            nodes.iter().copied().filter(|&i| me.side[i as usize] == from && touches(i)).collect()
        };
        let (low, high) = (border(self, LOW, HIGH), border(self, HIGH, LOW));
        let mut separator = if low.len() <= high.len() { low } else { high };
        for &i in &separator {
            self.side[i as usize] = SEPARATOR;
        }
        self.thin(&mut separator);
        let sides = nodes.iter().map(|&i| (i, self.side[i as usize])).collect();
        for &i in nodes {
            self.side[i as usize] = OUTSIDE;
        }
        sides
    }

    /// Moves separator nodes that touch one side only to that side, until there are none.
    fn thin(&mut self, separator: &mut Vec<u32>) {
        loop {
            let before = separator.len();
            separator.retain(|&i| {
                let touches =
                    |side: u8| self.pattern.row(i as usize).iter().any(|&j| self.side[j as usize] == side);
                let new = match (touches(LOW), touches(HIGH)) {
                    (true, true) => return true,
                    (false, true) => HIGH,
                    _ => LOW,
                };
                self.side[i as usize] = new;
                false
            });
            if separator.len() == before {
                return;
            }
        }
    }
}
