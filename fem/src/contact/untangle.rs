//! Surfaces that overlap are moved apart, node by node.

#![allow(non_snake_case)]

use super::Contact;
use super::near::Near;
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};

/// Points too close, down to which parting takes no notice of edges that cross.
const FEW: usize = 10;
/// Rounds of parting the surfaces.
const MAX_ROUNDS: usize = 60;
/// Fraction of the shortest edge at a node that it moves in one round: farther, a small face would turn over, and with it inside and outside.
const STRIDE: f64 = 0.3;
/// Fraction of their lengths that is left of directions that cancel out: well above round-off, well below what shortens anything.
const ROUND_OFF: f64 = 1e-8;
/// Least weight of a node in a motion for which it is moved.
const WEIGHTY: f64 = 0.05;
/// Nodes go no farther at once than the motion that is wanted divided by this, where those that weigh most in it are held.
const HELD: f64 = 0.5;

/// What is too close, or overlaps.
struct TooClose {
    near: Vec<Near>,
    /// (edge, triangle) that cross; looked for where few points are near.
    crossings: Vec<[u32; 2]>,
}

impl TooClose {
    /// How much is missing to `gap` \[m\], over all points and crossings.
    fn missing(&self, gap: f64) -> f64 {
        self.near.iter().map(|n| gap - n.gap).sum::<f64>() + gap * self.crossings.len() as f64
    }
}

impl Contact {
    /// Displacements \[m\] of the nodes at `x` that take all surfaces at least `gap` \[m\] apart, `gap` well above zero; nodes
    /// for which `moves` is false stay. Where that cannot be reached: (node, surface) of what stays too close.
    pub fn untangle(
        &self,
        x: &[f64],
        gap: f64,
        moves: &dyn Fn(u32) -> bool,
    ) -> Result<Vec<f64>, Vec<(u32, usize)>> {
        let mut now = x.to_vec();
        let mut strides: Option<Vec<f64>> = None;
        let (mut best, mut least) = (None, f64::INFINITY);
        // Rounds in which an edge has crossed something, up to this one.
        let mut in_a_row = BTreeMap::<u32, i32>::new();
        for _ in 0..MAX_ROUNDS {
            let p = self.surfaces.positions(&now);
            let near = self.near(&p, gap);
            let crossings = if near.len() <= FEW { self.crossings(&p) } else { Vec::new() };
            if near.is_empty() && crossings.is_empty() {
                return Ok(now.iter().zip(x).map(|(a, b)| a - b).collect());
            }
            let found = TooClose { near, crossings };
            let missing = found.missing(gap);
            in_a_row =
                found.crossings.iter().map(|&[e, _]| (e, 1 + in_a_row.get(&e).unwrap_or(&0))).collect();
            tracing::trace!(
                near = found.near.len(),
                crossings = found.crossings.len(),
                missing,
                longest = in_a_row.values().max(),
                "parting"
            );
            let wishes = self.wishes(&found, &in_a_row, gap, &p, moves);
            let strides = strides.get_or_insert_with(|| self.strides(x.len() / 3, &p));
            for (node, way) in wishes {
                let fraction = (strides[node as usize] / way.norm()).min(1.0);
                for c in 0..3 {
                    now[3 * node as usize + c] += fraction * way[c];
                }
            }
            if missing < least {
                (best, least) = (Some(found), missing);
            }
        }
        let TooClose { near, crossings } = best.expect("there was a round");
        let pairs = near.iter().map(|n| (vec![n.point], n.triangle));
        let crossing = crossings.iter().map(|c| (self.surfaces.edges[c[0] as usize].points.to_vec(), c[1]));
        Err(pairs.chain(crossing).flat_map(|(points, t)| self.nodes_of_pair(&points, t)).collect())
    }

    /// How far each of `n` nodes moves in one round \[m\], with the collision points at `p`.
    fn strides(&self, n: usize, p: &[Vector3<f64>]) -> Vec<f64> {
        let mut strides = vec![f64::INFINITY; n];
        for edge in &self.surfaces.edges {
            let [a, b] = edge.points;
            let stride = STRIDE * (p[a as usize] - p[b as usize]).norm();
            for (node, _) in [a, b].iter().flat_map(|&e| self.surfaces.points[e as usize].weighted_nodes()) {
                let least = &mut strides[node as usize];
                *least = least.min(stride);
            }
        }
        strides
    }

    /// The way \[m\] that each node would have to go; of all that are asked of it, the longest. An edge that crosses goes by `gap`, and twice as
    /// far with every round `in_a_row`: so any depth is come by in few rounds, and nobody goes much farther than that.
    fn wishes(
        &self,
        found: &TooClose,
        in_a_row: &BTreeMap<u32, i32>,
        gap: f64,
        p: &[Vector3<f64>],
        moves: &dyn Fn(u32) -> bool,
    ) -> BTreeMap<u32, Vector3<f64>> {
        let all = &self.surfaces;
        let mut wishes = BTreeMap::<u32, Vector3<f64>>::new();
        // Points with their fractions in the one that moves, on either side; the least motion of the nodes that brings it about.
        let mut push = |a: &[(u32, f64)], b: &[(u32, f64)], way: Vector3<f64>| {
            let mut nodes = BTreeMap::<u32, f64>::new();
            for (side, points) in [(1.0, a), (-1.0, b)] {
                for &(point, fraction) in points {
                    for (node, weight) in all.points[point as usize].weighted_nodes() {
                        *nodes.entry(node).or_default() += side * fraction * weight;
                    }
                }
            }
            nodes.retain(|&node, weight| weight.abs() > WEIGHTY && moves(node));
            let (squares, heaviest) =
                nodes.values().fold((0.0, 0.0_f64), |(sum, most), w| (sum + w * w, most.max(w.abs())));
            let scale = squares.max(HELD * heaviest);
            for (node, weight) in nodes {
                let (wish, way) = (wishes.entry(node).or_default(), way * (weight / scale));
                if way.norm() > wish.norm() {
                    *wish = way;
                }
            }
        };
        for n in &found.near {
            let corners = all.triangles[n.triangle as usize];
            let at: [(u32, f64); 3] = std::array::from_fn(|c| (corners[c], n.at[c]));
            push(&[(n.point, 1.0)], &at, n.out * (1.05 * gap - n.gap));
        }
        let around = self.around(&found.crossings);
        for &[e, t] in &found.crossings {
            if let Some(way) = self.shortening(e, t, &around, p) {
                let halves = all.edges[e as usize].points.map(|point| (point, 0.5));
                let thirds = all.triangles[t as usize].map(|corner| (corner, 1.0 / 3.0));
                push(&halves, &thirds, way * gap * f64::powi(2.0, in_a_row[&e] - 1));
            }
        }
        wishes
    }

    /// Triangles at every edge that crosses one.
    fn around(&self, crossings: &[[u32; 2]]) -> BTreeMap<u32, Vec<u32>> {
        let all = &self.surfaces;
        let mut around: BTreeMap<u32, Vec<u32>> = crossings.iter().map(|c| (c[0], Vec::new())).collect();
        let surfaces: BTreeSet<usize> =
            around.keys().map(|&e| all.surface(all.edges[e as usize].points[0])).collect();
        for t in surfaces.into_iter().flat_map(|s| all.list[s].triangles.clone()) {
            for e in all.triangle_edges[t] {
                if let Some(at) = around.get_mut(&e) {
                    at.push(t as u32);
                }
            }
        }
        around
    }

    /// Unit direction in which edge `e` moves against triangle `t`, through which it passes, so that the line along which both surfaces
    /// intersect gets shorter fastest (Volino and Magnenat-Thalmann, ACM Transactions on Graphics 25 (2006), 1154): Σ R − 2 (E·R)/(E·N) N over
    /// the triangles `around` the edge, R along the line into them. `None` where it does not get shorter, as on flat surfaces.
    fn shortening(
        &self,
        e: u32,
        t: u32,
        around: &BTreeMap<u32, Vec<u32>>,
        p: &[Vector3<f64>],
    ) -> Option<Vector3<f64>> {
        let all = &self.surfaces;
        let normal = |t: u32| {
            let [a, b, c] = all.triangles[t as usize].map(|c| p[c as usize]);
            (b - a).cross(&(c - a)).try_normalize(0.0)
        };
        let ends = all.edges[e as usize].points;
        let [a, b] = ends.map(|c| p[c as usize]);
        let (E, N) = ((b - a).try_normalize(0.0)?, normal(t)?);
        let (mut way, mut most) = (Vector3::zeros(), 0.0);
        for &own in &around[&e] {
            let apex = all.triangles[own as usize].into_iter().find(|c| !ends.contains(c))?;
            let inward = p[apex as usize] - a;
            let Some(R) = N.cross(&normal(own)?).try_normalize(0.0) else { continue };
            let R = R * R.dot(&(inward - E * E.dot(&inward))).signum();
            // Times E·N, which may be next to nothing.
            let part = R * E.dot(&N) - N * (2.0 * E.dot(&R));
            (way, most) = (way + part, most + part.norm());
        }
        (way * E.dot(&N).signum()).try_normalize(ROUND_OFF * most)
    }
}
