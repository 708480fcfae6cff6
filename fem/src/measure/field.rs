//! Energies, volumes, stresses of solids, stretch and force of fibres.

use super::Snapshot;
use crate::effect::{MembraneState, State};
use crate::plan::Plan;

/// Energy of one effect over all islands.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectEnergy {
    /// Name as in the scene.
    pub name: String,
    /// Energy \[J\].
    pub energy: f64,
}

/// Energy of each effect, in the order of [`Plan::effects`].
pub fn energies(plan: &Plan, at: Snapshot) -> Vec<EffectEnergy> {
    let mut all: Vec<EffectEnergy> =
        plan.effects.iter().map(|(name, _)| EffectEnergy { name: name.clone(), energy: 0.0 }).collect();
    for island in &plan.islands {
        let x = island.gather(at.x);
        let s = State { x: &x, controls: &at.load.controls };
        for effect in &island.effects {
            let entry = all.iter_mut().find(|e| e.name == effect.name()).expect("effect of the plan");
            entry.energy += effect.energy(&s);
        }
    }
    all
}

/// Kinetic energy \[J\] of all solids at the velocities `v` \[m/s\] of a frame; 0 without inertia.
pub fn kinetic_energy(plan: &Plan, v: &[f64]) -> f64 {
    let masses = plan.inertia.iter().flat_map(|inertia| &inertia.masses);
    masses.zip(v.chunks_exact(3)).map(|(m, v)| 0.5 * m * v.iter().map(|v| v * v).sum::<f64>()).sum()
}

/// One cell of a solid region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidField {
    /// Reference volume \[m³\].
    pub volume: f64,
    /// Current over reference volume.
    pub volume_ratio: f64,
    /// Cauchy stress, mean over the cell \[Pa\].
    pub cauchy: nalgebra::Matrix3<f64>,
    /// Its principal values, largest first \[Pa\].
    pub principal: [f64; 3],
    /// Fibre direction times stretch, deformed; absent where the law has no fibres.
    pub fibre: Option<nalgebra::Vector3<f64>>,
}

/// State of every cell of a solid region, in the order of its block; `None` where the plan has no such solid.
pub fn solid_field(plan: &Plan, at: Snapshot, region: &str) -> Option<Vec<SolidField>> {
    let states = states(plan, at, region, |effect, s, cell| {
        effect.solid_state(s, cell).map(|state| {
            let mut principal: [f64; 3] = state.cauchy.symmetric_eigenvalues().into();
            principal.sort_by(|a, b| b.total_cmp(a));
            SolidField {
                volume: state.volume,
                volume_ratio: state.volume_ratio,
                cauchy: state.cauchy,
                principal,
                fibre: state.fibre,
            }
        })
    });
    (!states.is_empty()).then_some(states)
}

/// Reference and current volume \[m³\] of a solid region; `None` where the plan has no such solid.
pub fn volume(plan: &Plan, at: Snapshot, region: &str) -> Option<(f64, f64)> {
    let cells = solid_field(plan, at, region)?;
    Some(cells.iter().fold((0.0, 0.0), |(v, now), c| (v + c.volume, now + c.volume * c.volume_ratio)))
}

/// One segment of a fibre or strand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FibreState {
    /// Current over reference length.
    pub stretch: f64,
    /// Axial force \[N\], tension positive.
    pub force: f64,
}

/// State of every segment of a fibre or strand effect, in its order; `None` where the plan has none of that name.
pub fn fibre_states(plan: &Plan, at: Snapshot, name: &str) -> Option<Vec<FibreState>> {
    let states = states(plan, at, name, |effect, s, group| {
        effect.line_state(s, group).map(|(stretch, force)| FibreState { stretch, force })
    });
    (!states.is_empty()).then_some(states)
}

/// State of every cell of a membrane region, in the order of its block; `None` where the plan has no such membrane.
pub fn membrane_field(plan: &Plan, at: Snapshot, region: &str) -> Option<Vec<MembraneState>> {
    let states = states(plan, at, region, |effect, s, group| effect.membrane_state(s, group));
    (!states.is_empty()).then_some(states)
}

/// What `look` finds in every cell of the effects of a name, in the order of the mesh.
fn states<T>(
    plan: &Plan,
    at: Snapshot,
    name: &str,
    look: impl Fn(&dyn crate::effect::Effect, &State, usize) -> Option<T>,
) -> Vec<T> {
    let mut found = Vec::new();
    for island in &plan.islands {
        let x = island.gather(at.x);
        let s = State { x: &x, controls: &at.load.controls };
        for (effect, cells) in island.effects.iter().zip(&island.cells).filter(|(e, _)| e.name() == name) {
            for (at, &cell) in cells.iter().enumerate() {
                found.extend(look(effect.as_ref(), &s, at).map(|state| (cell, state)));
            }
        }
    }
    found.sort_by_key(|(cell, _)| *cell);
    found.into_iter().map(|(_, state)| state).collect()
}
