//! What rests on a rigid solid that is known by its smooth distance: samples of bodies, and nodes of strands.
//!
//! Π = Σ over samples A e(φ(x)), A the area that a sample stands for, x a fixed mean of the nodes of its group. No friction.

use super::{Effect, EffectKind, Groups, State, point};
use crate::contact::barrier::barrier;
use crate::element::psd::lift;
use crate::geometry::DistanceField;
use nalgebra::{Matrix3, Vector3};
use std::sync::Arc;

/// Energy per area \[J/m²\] of a layer between two solids, by their distance \[m\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Layer {
    /// An elastic foundation: pressure = `stiffness` \[Pa/m\] times depth. Nothing is guaranteed.
    Foundation {
        /// \[Pa/m\].
        stiffness: f64,
    },
    /// A barrier: no pressure at `distance` \[m\], infinite at contact (`contact/barrier.rs`). Where it is finite nothing touches.
    Barrier {
        /// \[Pa\].
        modulus: f64,
        /// \[m\].
        distance: f64,
    },
}

impl Layer {
    /// Distance \[m\] from which on there is no pressure.
    fn reach(&self) -> f64 {
        match *self {
            Layer::Foundation { .. } => 0.0,
            Layer::Barrier { distance, .. } => distance,
        }
    }

    /// e and its first two derivatives by the distance.
    fn at(&self, d: f64) -> [f64; 3] {
        match *self {
            Layer::Foundation { stiffness } => {
                let g = d.min(0.0);
                [0.5 * stiffness * g * g, stiffness * g, if d < 0.0 { stiffness } else { 0.0 }]
            }
            Layer::Barrier { modulus, distance } => {
                let [b, b1, b2] = barrier(d / distance);
                [modulus * distance * b, modulus * b1, modulus / distance * b2]
            }
        }
    }
}

/// A place that rests on the solid.
#[derive(Clone, Copy, Debug)]
pub struct Sample<const M: usize> {
    /// Weights of the nodes of its group.
    pub weights: [f64; M],
    /// Area \[m²\] that it stands for.
    pub area: f64,
    /// What is between it and the solid.
    pub layer: Layer,
}

/// What presses on a solid.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pressed {
    /// Force \[N\] of the solid on what rests on it.
    pub force: Vector3<f64>,
    /// Its moment \[N·m\] about the origin.
    pub moment: Vector3<f64>,
    /// Area \[m²\] under pressure.
    pub area: f64,
    /// Greatest pressure \[Pa\].
    pub pressure: f64,
    /// Least distance \[m\] of its samples, where below the reach of the layer.
    pub least: Option<f64>,
}

/// Samples that are looked at together: most of what may rest on a solid is far from it, and is left alone by the dozen.
const TOGETHER: usize = 32;

/// Some samples of a group that follow each other.
#[derive(Clone, Debug)]
struct Bunch<const M: usize> {
    samples: Vec<Sample<M>>,
    /// Mean of their weights.
    middle: [f64; M],
    /// What of the greatest distance of a node from that mean point a sample may be away from it.
    spread: f64,
    /// The greatest reach of their layers \[m\].
    reach: f64,
}

impl<const M: usize> Bunch<M> {
    fn new(samples: &[Sample<M>]) -> Bunch<M> {
        let mean = |k: usize| samples.iter().map(|s| s.weights[k]).sum::<f64>() / samples.len() as f64;
        let middle: [f64; M] = std::array::from_fn(mean);
        // x − x̄ = Σ (w − w̄) (node − x̄), because weights sum to one.
        let off = |s: &Sample<M>| (0..M).map(|k| (s.weights[k] - middle[k]).abs()).sum::<f64>();
        let spread = samples.iter().map(off).fold(0.0, f64::max);
        let reach = samples.iter().map(|s| s.layer.reach()).fold(0.0, f64::max);
        Bunch { samples: samples.to_vec(), middle, spread, reach }
    }
}

/// Groups of `M` nodes whose samples rest on a solid.
pub struct Obstacle<const M: usize> {
    groups: Groups,
    field: Arc<DistanceField>,
    /// Samples of each group.
    bunches: Vec<Vec<Bunch<M>>>,
}

impl<const M: usize> Obstacle<M> {
    /// Groups of nodes, with the samples of each.
    pub fn new(
        name: &str,
        field: Arc<DistanceField>,
        nodes: &[[u32; M]],
        samples: Vec<Vec<Sample<M>>>,
    ) -> Obstacle<M> {
        // A load from outside: it is on no side of a cut.
        let groups = Groups::new(name, EffectKind::Load, nodes, vec![[f64::NAN; 3]; nodes.len()]);
        let bunches = samples.iter().map(|of| of.chunks(TOGETHER).map(Bunch::new).collect()).collect();
        Obstacle { groups, field, bunches }
    }

    /// Calls `see` with every sample of a group that bears: itself, place, e″, e′, e per area, gradient and Hessian of φ.
    fn each(&self, s: &State, group: usize, mut see: impl FnMut(&Sample<M>, &Felt)) {
        let nodes = self.groups.nodes::<M>(group).map(|n| Vector3::from(point(s.x, n)));
        let mean = |weights: &[f64; M]| (0..M).map(|k| weights[k] * nodes[k]).sum::<Vector3<f64>>();
        for bunch in &self.bunches[group] {
            let middle = mean(&bunch.middle);
            let farthest = nodes.iter().map(|n| (n - middle).norm()).fold(0.0, f64::max);
            if self.field.is_free(&middle, bunch.spread * farthest, bunch.reach) {
                continue;
            }
            for sample in &bunch.samples {
                let place = mean(&sample.weights);
                let Some(at) = self.field.near(&place, sample.layer.reach()) else { continue };
                let law = sample.layer.at(at.distance);
                see(sample, &Felt { place, distance: at.distance, law, n: at.gradient, bend: at.hessian });
            }
        }
    }

    /// What presses on the solid with the nodes at `x` \[m\].
    pub fn pressed(&self, x: &[f64]) -> Pressed {
        let s = State { x, controls: &[] };
        let mut sum = Pressed::default();
        for group in 0..self.groups.len() {
            self.each(&s, group, |sample, felt| {
                let f = -sample.area * felt.law[1] * felt.n;
                sum.force += f;
                sum.moment += felt.place.cross(&f);
                sum.area += sample.area;
                sum.pressure = sum.pressure.max(-felt.law[1]);
                sum.least = Some(sum.least.map_or(felt.distance, |least| least.min(felt.distance)));
            });
        }
        sum
    }
}

/// What a sample feels.
struct Felt {
    place: Vector3<f64>,
    distance: f64,
    law: [f64; 3],
    n: Vector3<f64>,
    bend: Matrix3<f64>,
}

impl<const M: usize> Effect for Obstacle<M> {
    fn groups(&self) -> &Groups {
        &self.groups
    }

    fn energy(&self, s: &State) -> f64 {
        let mut sum = 0.0;
        for group in 0..self.groups.len() {
            self.each(s, group, |sample, felt| sum += sample.area * felt.law[0]);
        }
        sum
    }

    fn forces(&self, s: &State, first: usize, out: &mut [f64]) {
        for (group, out) in (first..).zip(out.chunks_exact_mut(3 * M)) {
            out.fill(0.0);
            self.each(s, group, |sample, felt| {
                let f = sample.area * felt.law[1] * felt.n;
                for (k, w) in sample.weights.iter().enumerate() {
                    (0..3).for_each(|c| out[3 * k + c] += w * f[c]);
                }
            });
        }
    }

    /// A (e″ n⊗n + e′ ∂²φ/∂x²) w_a w_b; less the fraction `convexity` of its negative curvatures.
    fn stiffness(&self, s: &State, convexity: f64, first: usize, out: &mut [f64]) {
        for (group, out) in (first..).zip(out.chunks_exact_mut(9 * M * M)) {
            out.fill(0.0);
            self.each(s, group, |sample, felt| {
                let [_, e1, e2] = felt.law;
                let mut block = e2 * felt.n * felt.n.transpose() + e1 * felt.bend;
                lift(&mut block.data.0, convexity);
                block *= sample.area;
                for (p, wp) in sample.weights.iter().enumerate() {
                    for (q, wq) in sample.weights.iter().enumerate() {
                        for i in 0..3 {
                            let row = (3 * p + i) * 3 * M + 3 * q;
                            (0..3).for_each(|j| out[row + j] += wp * wq * block[(i, j)]);
                        }
                    }
                }
            });
        }
    }
}
