//! A way that would touch somewhere is bent there, and goes all the way elsewhere.
//!
//! One pair of surfaces about to meet would otherwise hold up every node of the island, one pair per iteration. Whether a pair
//! touches hangs on the motion of its points against each other only: it is shortened by what its detection allows, about the mean
//! of the pair, until no pair is left (Gauss-Seidel; in the spirit of the impact zones of Harmon et al., Robust treatment of
//! simultaneous collisions, ACM Trans. Graph. 27 (2008)).

use super::candidates::Primitives;
use super::{Contact, Mode, ccd};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Share of the distance of a pair that is left at least, and share of the activation distance that is left where there is as much.
const KEPT: f64 = 0.3;
const KEPT_OF_REACH: f64 = 0.4;
/// Share of its distance that a pair always may use up.
const LEAST_USE: f64 = 0.1;
/// Rounds after which the whole way is shortened.
const MOST_ROUNDS: usize = 16;
/// Edge lengths that a way may be long.
const LONGEST: f64 = 4.0;

impl Contact {
    /// Positions \[m\] that can be reached from `from` on a straight way without a touch: `to` where it can, something near it where not;
    /// nodes for which `moves` is false go to `to`. `None`: nothing near it can be reached.
    pub fn admit(&self, from: &[f64], to: &[f64], moves: &dyn Fn(u32) -> bool) -> Option<Vec<f64>> {
        if self.mode == Mode::Cheap {
            return None;
        }
        let start = self.surfaces.positions(from);
        let mut u: Vec<Vector3<f64>> = to
            .as_chunks::<3>()
            .0
            .iter()
            .zip(from.as_chunks::<3>().0)
            .map(|(to, from)| Vector3::from(*to) - Vector3::from(*from))
            .collect();
        if !(ccd::largest(u.iter().copied()) < LONGEST * self.surfaces.edge_length) {
            return None;
        }
        let at = |u: &[Vector3<f64>]| -> Vec<f64> {
            from.iter().zip(u.iter().flat_map(|u| u.iter())).map(|(x, u)| x + u).collect()
        };
        for _ in 0..MOST_ROUNDS {
            let now = at(&u);
            let blocked = self.blocked(&start, &self.surfaces.positions(&now));
            if blocked.is_empty() {
                return Some(now);
            }
            for (points, share) in blocked {
                self.hold_together(points, share, &mut u, moves);
            }
        }
        None
    }

    /// Pairs that would touch, a point and a triangle or two edges, by their four points, with the share of the way that each may go.
    fn blocked(&self, from: &[Vector3<f64>], to: &[Vector3<f64>]) -> Vec<([u32; 4], f64)> {
        let near = self.candidates_between(Primitives::Edges, from, to);
        let all = &self.surfaces;
        let kept =
            |first: f64| (KEPT * first).max((KEPT_OF_REACH * self.distance).min((1.0 - LEAST_USE) * first));
        let triangle = |&[s, t]: &[u32; 2]| {
            let [start, end] = [from, to].map(|p| self.triangle_points(s, t, p));
            let share = ccd::point_triangle_share(&start, &end, kept);
            let [a, b, c] = all.triangles[t as usize];
            (share < 1.0).then_some(([s, a, b, c], share))
        };
        let edge = |&[e, f]: &[u32; 2]| {
            let [start, end] = [from, to].map(|p| self.edge_points(e, f, p));
            let share = ccd::edge_edge_share(&start, &end, kept);
            let ([a, b], [c, d]) = (all.edges[e as usize].points, all.edges[f as usize].points);
            (share < 1.0).then_some(([a, b, c, d], share))
        };
        let triangles: Vec<_> =
            near.point_triangle.par_iter().with_min_len(512).filter_map(triangle).collect();
        let edges: Vec<_> = near.edge_edge.par_iter().with_min_len(512).filter_map(edge).collect();
        [triangles, edges].concat()
    }

    /// Leaves the share `share` of the motion `u` of the nodes of a pair against its mean, or against what of it cannot move.
    fn hold_together(
        &self,
        points: [u32; 4],
        share: f64,
        u: &mut [Vector3<f64>],
        moves: &dyn Fn(u32) -> bool,
    ) {
        let mut nodes: Vec<u32> = points
            .iter()
            .flat_map(|&p| self.surfaces.points[p as usize].parts().map(|(node, _)| node))
            .collect();
        nodes.sort_unstable();
        nodes.dedup();
        let stays = nodes.iter().any(|&n| !moves(n));
        let of: Vec<u32> = nodes.iter().copied().filter(|&n| !(stays && moves(n))).collect();
        let mean = of.iter().map(|&n| u[n as usize]).sum::<Vector3<f64>>() / of.len() as f64;
        for &n in nodes.iter().filter(|&&n| moves(n)) {
            let u = &mut u[n as usize];
            *u = mean + (*u - mean) * (0.9 * share);
        }
    }
}
