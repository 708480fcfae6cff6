//! Strands that slide: strings of massless nodes with one tension from end to end, whatever they lie on.
//!
//! The length of a string of n segments is taken as ℓ = √(n Σ |x_k+1 − x_k|²). That is never less than the sum of the segments (Cauchy and
//! Schwarz) and equal to it where all are equally long, so that of all strings around an obstacle the one of least ℓ is the shortest way with
//! its nodes evenly spread: free nodes need nothing that keeps them apart, and without friction the tension N = ∂w/∂λ is one along the way.
//! Π = L w(ℓ/L), or N ℓ where the tension is given. ℓ is convex. What a string lies on is [`Obstacle`](super::Obstacle).

use super::{Effect, EffectKind, Groups, State, point};
use crate::material::line::{LineLaw, LineResponse};
use nalgebra::Vector3;

/// Nodes of a string. On a ball its way is then too short by (1/24) (turn/segments)²: 0.2 % for half a turn.
pub const NODES: usize = 13;
/// Tension \[N\] with which a slack string holds together, so that its nodes are somewhere: a tenth of what an equilibrium may leave.
const SLACK: f64 = 1e-3;

/// What pulls in a string.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pull {
    /// A law over the slack length \[m\].
    Elastic(LineLaw, f64),
    /// A share of a control \[N\].
    Tension(usize, f64),
}

/// Strings.
pub struct Slings {
    groups: Groups,
    pulls: Vec<Pull>,
}

impl Slings {
    /// Strings over their nodes, from end to end, with what pulls in each.
    pub fn new(name: &str, points: &[[f64; 3]], strings: &[[u32; NODES]], pulls: Vec<Pull>) -> Slings {
        let middle = |s: &[u32; NODES]| points[s[NODES / 2] as usize];
        let groups = Groups::new(name, EffectKind::Fibre, strings, strings.iter().map(middle).collect());
        Slings { groups, pulls }
    }

    /// Vectors \[m\] along the segments, and ℓ \[m\].
    fn segments(&self, e: usize, x: &[f64]) -> ([Vector3<f64>; NODES - 1], f64) {
        let at = self.groups.nodes::<NODES>(e).map(|n| Vector3::from(point(x, n)));
        let d: [Vector3<f64>; NODES - 1] = std::array::from_fn(|k| at[k + 1] - at[k]);
        let squares: f64 = d.iter().map(|d| d.norm_squared()).sum();
        (d, (d.len() as f64 * squares).sqrt())
    }

    /// Energy \[J\], tension \[N\] and its derivative by ℓ \[N/m\].
    fn response(&self, e: usize, length: f64, controls: &[f64]) -> [f64; 3] {
        let [energy, tension, slope] = match self.pulls[e] {
            Pull::Elastic(law, slack) => {
                let LineResponse { energy, force, stiffness } = law.response(length / slack, 0.0);
                [slack * energy, force, stiffness / slack]
            }
            Pull::Tension(control, share) => [share * controls[control] * length, share * controls[control], 0.0],
        };
        [energy + SLACK * length, tension + SLACK, slope]
    }
}

impl Effect for Slings {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    fn energy(&self, s: &State) -> f64 {
        (0..self.pulls.len()).map(|e| self.response(e, self.segments(e, s.x).1, s.controls)[0]).sum()
    }

    /// Stretch over the slack length (over ℓ itself where the tension is given), and tension \[N\].
    fn line_state(&self, s: &State, group: usize) -> Option<(f64, f64)> {
        let length = self.segments(group, s.x).1;
        let stretch = match self.pulls[group] {
            Pull::Elastic(_, slack) => length / slack,
            Pull::Tension(..) => 1.0,
        };
        Some((stretch, self.response(group, length, s.controls)[1]))
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        for (e, out) in (first..).zip(out.chunks_exact_mut(3 * NODES)) {
            let (d, length) = self.segments(e, s.x);
            let pull = self.response(e, length, s.controls)[1] * d.len() as f64 / length;
            out.fill(0.0);
            for (k, d) in d.iter().enumerate() {
                for c in 0..3 {
                    out[3 * k + c] -= pull * d[c];
                    out[3 * (k + 1) + c] += pull * d[c];
                }
            }
        }
    }

    /// With q = ∂ℓ/∂x: N′ q⊗q + (N/ℓ) (n D − q⊗q), D the matrix of the sum of squares. Tension never pushes: all of it is convex but a falling
    /// N′, of which the fraction `convexity` is left out.
    fn stiffness(&self, s: &State, convexity: f64, first: usize, out: &mut [f64]) {
        for (e, out) in (first..).zip(out.chunks_exact_mut(9 * NODES * NODES)) {
            let (d, length) = self.segments(e, s.x);
            let [_, tension, slope] = self.response(e, length, s.controls);
            let n = d.len() as f64;
            let mut q = [0.0; 3 * NODES];
            for (k, d) in d.iter().enumerate() {
                for c in 0..3 {
                    q[3 * k + c] -= n / length * d[c];
                    q[3 * (k + 1) + c] += n / length * d[c];
                }
            }
            let along = slope - convexity * slope.min(0.0) - tension / length;
            for i in 0..3 * NODES {
                for j in 0..3 * NODES {
                    out[i * 3 * NODES + j] = along * q[i] * q[j];
                }
            }
            let spring = tension / length * n;
            for k in 0..d.len() {
                for c in 0..3 {
                    let [a, b] = [3 * k + c, 3 * (k + 1) + c];
                    for (i, j, sign) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
                        out[i * 3 * NODES + j] += sign * spring;
                    }
                }
            }
        }
    }
}
