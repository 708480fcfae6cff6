//! Fibres and strands: segments that carry axial force, along mesh edges, between points embedded in cells, or both.

use super::{Effect, EffectKind, Groups, NO_NODE, State, point};
use crate::material::line::LineLaw;
use rayon::prelude::*;

/// One end of a segment: a point x = Σ weight · x_node.
pub type End = Vec<(u32, f64)>;

/// A segment between two ends.
#[derive(Clone, Debug)]
pub struct Segment {
    /// Both ends.
    pub ends: [End; 2],
    /// Reference length \[m\]: the distance of the ends in the mesh, or the slack length of a strand.
    pub length: f64,
    /// Law.
    pub law: LineLaw,
}

/// Segments with `M` nodes each: 2 along mesh edges, more where ends are embedded.
pub struct Lines<const M: usize> {
    groups: Groups,
    /// Index of the control that holds the activation; `None`: never active.
    activation: Option<usize>,
    /// ∂(x₁ − x₀)/∂x_node of each segment.
    weights: Vec<[f64; M]>,
    lengths: Vec<f64>,
    laws: Vec<LineLaw>,
}

impl<const M: usize> Lines<M> {
    /// Segments over nodes at `points` \[m\]. Panics where the ends of a segment have more than `M` nodes together.
    pub fn new(name: &str, activation: Option<usize>, points: &[[f64; 3]], segments: &[Segment]) -> Self {
        let (mut all_nodes, mut all_weights, mut centroids) = (Vec::new(), Vec::new(), Vec::new());
        for s in segments {
            let (mut nodes, mut weights, mut centroid) = ([NO_NODE; M], [0.0; M], [0.0; 3]);
            let mut used = 0;
            for (end, sign) in s.ends.iter().zip([-1.0, 1.0]) {
                for &(n, w) in end {
                    // Ends in the same cell share its nodes.
                    let at = nodes[..used].iter().position(|&m| m == n).unwrap_or(used);
                    used = used.max(at + 1);
                    nodes[at] = n;
                    weights[at] += sign * w;
                    for i in 0..3 {
                        centroid[i] += 0.5 * w * points[n as usize][i];
                    }
                }
            }
            all_nodes.push(nodes);
            all_weights.push(weights);
            centroids.push(centroid);
        }
        Lines {
            groups: Groups::new(name, EffectKind::Fibre, &all_nodes, centroids),
            activation,
            weights: all_weights,
            lengths: segments.iter().map(|s| s.length).collect(),
            laws: segments.iter().map(|s| s.law).collect(),
        }
    }

    fn activation(&self, s: &State) -> f64 {
        self.activation.map_or(0.0, |c| s.controls[c])
    }

    /// Vector from end to end \[m\] and its length \[m\].
    fn span(&self, e: usize, x: &[f64]) -> ([f64; 3], f64) {
        let mut d = [0.0; 3];
        for (&n, w) in self.groups.nodes::<M>(e).iter().zip(&self.weights[e]) {
            if n != NO_NODE {
                let p = point(x, n);
                for i in 0..3 {
                    d[i] += w * p[i];
                }
            }
        }
        (d, (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt())
    }
}

/// Below this fraction of its reference length a segment has no direction: it carries no force.
const COLLAPSED: f64 = 1e-12;

impl<const M: usize> Effect for Lines<M> {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    fn energy(&self, s: &State) -> f64 {
        let a = self.activation(s);
        let energies: Vec<f64> = (0..self.laws.len())
            .into_par_iter()
            .with_min_len(512)
            .map(|e| {
                let lambda = (self.span(e, s.x).1 / self.lengths[e]).max(COLLAPSED);
                self.lengths[e] * self.laws[e].response(lambda, a).energy
            })
            .collect();
        energies.iter().sum()
    }

    fn line_state(&self, s: &State, group: usize) -> Option<(f64, f64)> {
        let lambda = self.span(group, s.x).1 / self.lengths[group];
        Some((lambda, self.laws[group].response(lambda.max(COLLAPSED), self.activation(s)).force))
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        let a = self.activation(s);
        for (e, out) in (first..).zip(out.chunks_exact_mut(3 * M)) {
            let (d, l) = self.span(e, s.x);
            let lambda = l / self.lengths[e];
            let pull = if lambda > COLLAPSED { self.laws[e].response(lambda, a).force / l } else { 0.0 };
            for (out, w) in out.chunks_exact_mut(3).zip(&self.weights[e]) {
                for i in 0..3 {
                    out[i] = pull * w * d[i];
                }
            }
        }
    }

    fn stiffness(&self, s: &State, convexity: f64, first: usize, out: &mut [f64]) {
        let a = self.activation(s);
        self.each_stiffness(s, first, out, |e, lambda, l| {
            let r = self.laws[e].response(lambda, a);
            let (axial, lateral) = (r.stiffness / self.lengths[e], r.force / l);
            [axial - convexity * axial.min(0.0), lateral - convexity * lateral.min(0.0)]
        });
    }

    fn taut_stiffness(&self, s: &State, first: usize, out: &mut [f64]) {
        let a = self.activation(s);
        self.each_stiffness(s, first, out, |e, lambda, l| {
            let r = self.laws[e].response(lambda, a);
            let axial = r.stiffness.max(self.laws[e].taut_stiffness(a)) / self.lengths[e];
            [axial, (r.force / l).max(0.0)]
        });
    }
}

impl<const M: usize> Lines<M> {
    /// Overwrites `out` with (k_axial n⊗n + k_lateral (I − n⊗n)) w_a w_b of segments `first`, `first + 1`, … `of` says both k \[N/m\] of a segment, its
    /// stretch and its length \[m\].
    fn each_stiffness(
        &self,
        s: &State,
        first: usize,
        out: &mut [f64],
        of: impl Fn(usize, f64, f64) -> [f64; 2],
    ) {
        for (e, out) in (first..).zip(out.chunks_exact_mut(9 * M * M)) {
            let (d, l) = self.span(e, s.x);
            let lambda = l / self.lengths[e];
            if lambda <= COLLAPSED {
                out.fill(0.0);
                continue;
            }
            let [axial, lateral] = of(e, lambda, l);
            let n = d.map(|d| d / l);
            let w = &self.weights[e];
            for p in 0..M {
                for i in 0..3 {
                    for q in 0..M {
                        for j in 0..3 {
                            let unit = if i == j { lateral } else { 0.0 };
                            out[(3 * p + i) * 3 * M + 3 * q + j] =
                                w[p] * w[q] * ((axial - lateral) * n[i] * n[j] + unit);
                        }
                    }
                }
            }
        }
    }
}
