//! Surfaces that overlap are moved apart, node by node.

use super::Contact;
use super::near::Near;
use super::normals::Normals;
use crate::geometry::closest::edge_edge;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Points too close, down to which parting takes no notice of edges that cross.
const FEW: usize = 10;
/// Rounds of parting the surfaces.
const MAX_ROUNDS: usize = 60;
/// Fraction of the shortest edge at a node that it moves in one round: farther, a small face would turn over, and with it inside and outside.
const STRIDE: f64 = 0.3;
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
        for _ in 0..MAX_ROUNDS {
            let p = self.surfaces.positions(&now);
            let near = self.near(&p, gap);
            let crossings = if near.len() <= FEW { self.crossings(&p) } else { Vec::new() };
            if near.is_empty() && crossings.is_empty() {
                return Ok(now.iter().zip(x).map(|(a, b)| a - b).collect());
            }
            let found = TooClose { near, crossings };
            let wishes = self.wishes(&found, gap, &p, moves);
            let strides = strides.get_or_insert_with(|| self.strides(x.len() / 3, &p));
            for (node, way) in wishes {
                let fraction = (strides[node as usize] / way.norm()).min(1.0);
                for c in 0..3 {
                    now[3 * node as usize + c] += fraction * way[c];
                }
            }
            let missing = found.missing(gap);
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

    /// The way \[m\] that each node would have to go; of all that are asked of it, the longest.
    fn wishes(
        &self,
        found: &TooClose,
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
        let normals = if found.crossings.is_empty() { Vec::new() } else { self.normals(p) };
        for &[e, t] in &found.crossings {
            let halves = |e: u32| all.edges[e as usize].points.map(|point| (point, 0.5));
            match self.way_back(e, t, gap, p, &normals) {
                Some((f, way)) => push(&halves(e), &halves(f), way),
                // Through a triangle alone: it leaves by the front, bit by bit.
                None => {
                    let corners = all.triangles[t as usize];
                    let [a, b, c] = corners.map(|c| p[c as usize]);
                    let thirds = corners.map(|corner| (corner, 1.0 / 3.0));
                    push(&halves(e), &thirds, (b - a).cross(&(c - a)).normalize() * gap);
                }
            }
        }
        wishes
    }

    /// Of the edges of triangle `t`, through which edge `e` passes, the one that it has crossed least, and the way \[m\] of `e` against it
    /// to `gap` on the other side.
    fn way_back(
        &self,
        e: u32,
        t: u32,
        gap: f64,
        p: &[Vector3<f64>],
        normals: &[Normals],
    ) -> Option<(u32, Vector3<f64>)> {
        let crossed = self.surfaces.triangle_edges[t as usize].iter().filter_map(|&f| {
            let closest = edge_edge(&self.edge_points(e, f, p));
            let depth = closest.squared().sqrt();
            (depth > 0.0 && self.have_crossed(e, f, &closest, normals))
                .then(|| (f, depth, closest.w * (-(depth + gap) / depth)))
        });
        crossed.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(f, _, way)| (f, way))
    }
}
