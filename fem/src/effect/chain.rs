//! Muscle fibres that carry one force from end to end: the tension of a chain of segments follows from its whole length.
//!
//! A force-length curve has a falling part. Sarcomere by sarcomere (or segment by segment) it makes a fibre tear apart into long and
//! short pieces, the finer the mesh the shorter. A muscle as gait models know it has one length, so here a fibre has one, too:
//! Π = A L w(l/L, a) with l the length of the chain and L that in the mesh, and every segment pulls with A σ(l/L, a), σ = ∂w/∂λ.

use super::{Effect, EffectKind, Groups, State, point};
use crate::material::force_length::{FibreStress, ForceLength};
use rayon::prelude::*;
use std::ops::Range;

/// A fibre: segments that follow each other.
#[derive(Clone, Debug)]
pub struct Chain {
    /// Nodes of each segment.
    pub segments: Vec<[u32; 2]>,
    /// Length in the mesh \[m\] of the whole fibre, also of segments that are not listed because nothing moves them.
    pub length: f64,
    /// Section \[m²\].
    pub area: f64,
}

/// Fibres with a tabulated force-length law.
pub struct Chains {
    groups: Groups,
    law: ForceLength,
    activation: Option<usize>,
    /// Length of each segment in the mesh \[m\].
    lengths: Vec<f64>,
    /// Chain of each segment.
    chain: Vec<u32>,
    chains: Vec<Fibre>,
}

/// What of a fibre is in an effect.
struct Fibre {
    segments: Range<usize>,
    /// Length in the mesh of what is not in it \[m\].
    elsewhere: f64,
    length: f64,
    area: f64,
}

impl Chains {
    /// Fibres over nodes at `points` \[m\].
    pub fn new(
        name: &str,
        activation: Option<usize>,
        law: ForceLength,
        points: &[[f64; 3]],
        fibres: &[Chain],
    ) -> Chains {
        let (mut nodes, mut centroids, mut lengths) = (Vec::new(), Vec::new(), Vec::new());
        let (mut chain, mut chains) = (Vec::new(), Vec::new());
        for (c, fibre) in fibres.iter().enumerate() {
            let first = nodes.len();
            let mut here = 0.0;
            for pair in &fibre.segments {
                let [a, b] = pair.map(|n| points[n as usize]);
                let length = norm(std::array::from_fn(|i| b[i] - a[i]));
                nodes.push(*pair);
                centroids.push(std::array::from_fn(|i| 0.5 * (a[i] + b[i])));
                lengths.push(length);
                chain.push(c as u32);
                here += length;
            }
            chains.push(Fibre {
                segments: first..nodes.len(),
                elsewhere: fibre.length - here * (1.0 + ROUNDING * ROUNDING).sqrt(),
                length: fibre.length,
                area: fibre.area,
            });
        }
        let groups = Groups::new(name, EffectKind::Fibre, &nodes, centroids);
        Chains { groups, law, activation, lengths, chain, chains }
    }

    fn span(&self, e: usize, x: &[f64]) -> ([f64; 3], f64) {
        let [a, b] = self.groups.nodes::<2>(e).map(|n| point(x, n));
        let d = std::array::from_fn(|i| b[i] - a[i]);
        (d, norm(d).hypot(ROUNDING * self.lengths[e]))
    }

    fn state(&self, chain: &Fibre, s: &State) -> FibreStress {
        let length: f64 = chain.segments.clone().map(|e| self.span(e, s.x).1).sum();
        let a = self.activation.map_or(0.0, |c| s.controls[c]);
        self.law.at((length + chain.elsewhere) / chain.length, a)
    }

    /// Calls `see(segment, place in the batch, tension)` for segments `first`, `first + 1`, … of a batch of `n`.
    fn each(&self, s: &State, first: usize, n: usize, mut see: impl FnMut(usize, usize, f64)) {
        let mut known = (u32::MAX, 0.0);
        for place in 0..n {
            let e = first + place;
            if known.0 != self.chain[e] {
                let chain = &self.chains[self.chain[e] as usize];
                known = (self.chain[e], chain.area * self.state(chain, s).stress);
            }
            see(e, place, known.1);
        }
    }
}

fn norm(d: [f64; 3]) -> f64 {
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
}

/// The length of a segment is taken as √(|d|² + ε² L²), ε this fraction of its length L at rest. The tension of a chain does not fall as one of
/// its segments shortens, so that a soft matrix lets some vanish, and |d| has a kink there on which no descent gets on. Tensions lose
/// 0.02 % at rest.
const ROUNDING: f64 = 0.02;

impl Effect for Chains {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    fn energy(&self, s: &State) -> f64 {
        let of = |c: &Fibre| c.area * c.length * self.state(c, s).energy;
        let energies: Vec<f64> = self.chains.par_iter().with_min_len(16).map(of).collect();
        energies.iter().sum()
    }

    fn line_state(&self, s: &State, group: usize) -> Option<(f64, f64)> {
        let chain = &self.chains[self.chain[group] as usize];
        let lambda = self.span(group, s.x).1 / self.lengths[group];
        Some((lambda, chain.area * self.state(chain, s).stress))
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        self.each(s, first, out.len() / 6, |e, place, tension| {
            let (d, l) = self.span(e, s.x);
            let pull = tension / l;
            for i in 0..3 {
                out[6 * place + i] = -pull * d[i];
                out[6 * place + 3 + i] = pull * d[i];
            }
        });
    }

    /// N/l (I − n⊗n). What the tension gains with the length of the whole chain (∂σ/∂λ, a matrix of rank one that couples all nodes of
    /// a fibre) is left out: it would fill the factor, and the ends of a fibre are held, so that its length hardly answers to its
    /// tension.
    fn stiffness(&self, s: &State, _convexity: f64, first: usize, out: &mut [f64]) {
        self.each(s, first, out.len() / 36, |e, place, tension| {
            let out = &mut out[36 * place..36 * (place + 1)];
            let (d, l) = self.span(e, s.x);
            let (n, k) = (d.map(|d| d / l), tension / l);
            for i in 0..3 {
                for j in 0..3 {
                    let v = k * (f64::from(u8::from(i == j)) - n[i] * n[j]);
                    out[6 * i + j] = v;
                    out[6 * i + 3 + j] = -v;
                    out[6 * (3 + i) + j] = -v;
                    out[6 * (3 + i) + 3 + j] = v;
                }
            }
        });
    }
}
