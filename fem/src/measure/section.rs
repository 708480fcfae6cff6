//! Section forces by a free-body cut.
//!
//! A plane through the reference shape divides the elements by their centroids. The forces of the elements on one
//! side on the nodes that both sides share are the force between the sides, whatever the mesh; the sum over all effects is
//! exact by equilibrium, and the kinds (matrix, fibre, membrane) add up to it. Under gravity there is also the part of the
//! weight behind the cut that the mesh puts on the shared nodes: half a layer of cells otherwise missing.

use super::Snapshot;
use crate::body::Wrench;
use crate::effect::{EffectKind, NO_NODE, State};
use crate::plan::Plan;
use std::collections::BTreeMap;

/// A plane cut through some effects.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut {
    /// A point of the plane \[m\], reference.
    pub point: [f64; 3],
    /// Normal of the plane, reference.
    pub normal: [f64; 3],
    /// Names of the effects that it cuts (region, fibres, membranes of one muscle); empty: all.
    pub effects: Vec<String>,
}

/// The force that the side ahead of the cut (along its normal) exerts on the side behind it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SectionForce {
    /// All effects \[N, N·m about the current centroid of the cut nodes\].
    pub total: Wrench,
    /// Force of each kind of effect \[N\]; kinds that are not there have no entry.
    pub by_kind: BTreeMap<EffectKind, [f64; 3]>,
    /// Nodes that both sides share.
    pub n_nodes: usize,
}

impl SectionForce {
    /// Component along a direction \[N\], tension positive for the normal of the cut.
    pub fn along(&self, direction: [f64; 3]) -> f64 {
        along(self.total.force, direction)
    }

    /// Component of one kind along a direction \[N\]; zero where it is not there.
    pub fn along_of(&self, kind: EffectKind, direction: [f64; 3]) -> f64 {
        self.by_kind.get(&kind).map_or(0.0, |f| along(*f, direction))
    }
}

fn along(f: [f64; 3], d: [f64; 3]) -> f64 {
    let norm = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    (f[0] * d[0] + f[1] * d[1] + f[2] * d[2]) / norm
}

/// Force through a cut. Zero, with no nodes, where the plane misses the effects.
pub fn section_force(plan: &Plan, at: Snapshot, cut: &Cut) -> SectionForce {
    let chosen = |name: &str| cut.effects.is_empty() || cut.effects.iter().any(|e| e == name);
    let n = plan.mesh.points.len();
    let (mut behind, mut ahead) = (vec![false; n], vec![false; n]);
    let mut forces = BTreeMap::<EffectKind, Vec<f64>>::new();
    for island in &plan.islands {
        let x = island.gather(at.x);
        let s = State { x: &x, controls: &at.load.controls };
        for effect in island.effects.iter().filter(|e| e.kind() != EffectKind::Load && chosen(e.name())) {
            let g = forces.entry(effect.kind()).or_insert_with(|| vec![0.0; 3 * n]);
            let m = effect.nodes_per_group();
            let mut f = vec![0.0; 3 * m];
            for (group, nodes) in effect.nodes().chunks_exact(m).enumerate() {
                let c = effect.centroid(group);
                let is_ahead = (0..3).map(|i| (c[i] - cut.point[i]) * cut.normal[i]).sum::<f64>() > 0.0;
                let side = if is_ahead { &mut ahead } else { &mut behind };
                // Forces balance at the nodes that bear them: those of a grid where the mesh is embedded in one.
                let bearers = |n: u32| plan.bearers(island.nodes[n as usize]);
                let used = || nodes.iter().filter(|n| **n != NO_NODE);
                used().flat_map(|&n| bearers(n)).for_each(|(n, _)| side[n as usize] = true);
                if is_ahead {
                    continue;
                }
                effect.forces(&s, group, &mut f);
                for (&n, f) in used().zip(f.chunks_exact(3)) {
                    for (n, w) in bearers(n) {
                        for i in 0..3 {
                            g[3 * n as usize + i] += w * f[i];
                        }
                    }
                }
            }
        }
    }
    let shared: Vec<usize> = (0..n).filter(|&n| behind[n] && ahead[n]).collect();
    add_weights(plan, at, cut, chosen, &shared, &mut forces);
    let mut out = SectionForce { n_nodes: shared.len(), ..Default::default() };
    let mut centre = [0.0; 3];
    for &n in &shared {
        for i in 0..3 {
            centre[i] += at.x[3 * n + i] / shared.len() as f64;
        }
    }
    for (kind, g) in forces {
        let mut sum = Wrench::default();
        for &n in &shared {
            let arm = std::array::from_fn(|i| at.x[3 * n + i] - centre[i]);
            sum.add(arm, [g[3 * n], g[3 * n + 1], g[3 * n + 2]]);
        }
        for i in 0..3 {
            out.total.force[i] += sum.force[i];
            out.total.moment[i] += sum.moment[i];
        }
        out.by_kind.insert(kind, sum.force);
    }
    out
}

/// Adds the weights of the cells behind the cut on the shared nodes, as forces ∂Π/∂x \[N\] of the part [`EffectKind::Load`].
fn add_weights(
    plan: &Plan,
    at: Snapshot,
    cut: &Cut,
    chosen: impl Fn(&str) -> bool,
    shared: &[usize],
    forces: &mut BTreeMap<EffectKind, Vec<f64>>,
) {
    for w in plan.weights.iter().filter(|w| chosen(&w.region)) {
        let g = forces.entry(EffectKind::Load).or_insert_with(|| vec![0.0; at.x.len()]);
        let cells = w.nodes.chunks_exact(w.nodes_per_cell).zip(w.forces.chunks_exact(w.nodes_per_cell));
        for (nodes, weights) in cells {
            let sum = |i: usize| nodes.iter().map(|&n| plan.mesh.points[n as usize][i]).sum::<f64>();
            let centroid = |i: usize| sum(i) / nodes.len() as f64;
            if (0..3).map(|i| (centroid(i) - cut.point[i]) * cut.normal[i]).sum::<f64>() > 0.0 {
                continue;
            }
            let borne = nodes.iter().zip(weights).flat_map(|(&n, f)| {
                plan.bearers(n).into_iter().map(move |(of, part)| (of as usize, part, f))
            });
            for (n, part, f) in borne.filter(|(n, ..)| shared.binary_search(n).is_ok()) {
                for i in 0..3 {
                    g[3 * n + i] -= part * (at.load.controls[w.control] * f[i]);
                }
            }
        }
    }
}
