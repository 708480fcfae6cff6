//! Inertia of a scene: masses of the nodes, and how fast they are at the start.

use super::SceneError;
use super::error::nearest;
use super::island::Island;
use super::load::Motion;
use super::solids;
use super::term::check;
use crate::effect::{IslandTerm, TimeStep};
use crate::mesh::Mesh;
use crate::scene::{InertiaSpec, Scene};

/// Masses and first velocities of the whole mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Inertia {
    /// Mass of each node \[kg\], lumped.
    pub masses: Vec<f64>,
    /// Velocities at the start \[m/s\], 3 per node.
    pub velocities: Vec<f64>,
}

impl Inertia {
    /// What it adds to the potential of an island over `h` \[s\] from the places `x` \[m\] and velocities `v` \[m/s\] of its local nodes.
    pub fn over(&self, h: f64, island: &Island, x: &[f64], v: &[f64]) -> Box<dyn IslandTerm> {
        let mass = island.nodes.iter().zip(&island.motion).flat_map(|(&n, motion)| {
            motion.map(|c| if c.is_unknown() { self.masses[n as usize] } else { 0.0 })
        });
        Box::new(TimeStep::new(h, mass.collect(), x.to_vec(), v))
    }
}

impl Island {
    /// Masses \[kg\] of its nodes on the unknowns that move them, `masses` those of the nodes of the mesh: of nodes that are means of others
    /// on these, as much as each moves them.
    pub fn lumped(&self, masses: &[f64]) -> Vec<f64> {
        let mut lumped = vec![0.0; 3 * self.free_nodes.len()];
        for (n, mesh_node) in (0..).zip(&self.nodes) {
            let own = vec![(n, 1.0)];
            for &(node, weight) in self.means.get(&n).unwrap_or(&own) {
                for c in 0..3 {
                    if let Some((free, c)) = self.unknown(node, c) {
                        lumped[3 * free as usize + c] += weight * masses[*mesh_node as usize];
                    }
                }
            }
        }
        lumped
    }

    /// Puts velocities of the unknowns into those of all local nodes.
    pub fn put_velocities(&self, unknowns: &[f64], all: &mut [f64]) {
        for (&n, v) in self.free_nodes.iter().zip(unknowns.as_chunks::<3>().0) {
            for c in 0..3 {
                if matches!(self.motion[n as usize][c], Motion::Free | Motion::Slides(_)) {
                    all[3 * n as usize + c] = v[c];
                }
            }
        }
    }
}

/// The inertia of a scene; `None` where it does not call for it.
pub fn inertia(scene: &Scene, mesh: &Mesh) -> Result<Option<Inertia>, SceneError> {
    let Some(InertiaSpec { velocities: given }) = &scene.inertia else { return Ok(None) };
    let mut velocities = vec![0.0; 3 * mesh.points.len()];
    for spec in given {
        let user = format!("velocity of `{}`", spec.region);
        spec.velocity.iter().try_for_each(|v| check(&user, "velocity [m/s]", *v, true, "a finite number"))?;
        let known = || scene.solids.iter().map(|s| s.region.as_str());
        let block = mesh.blocks.iter().find(|b| b.name == spec.region && known().any(|k| k == b.name));
        let block = block.ok_or_else(|| SceneError::Unknown {
            user: "inertia".to_string(),
            what: "solid",
            name: spec.region.clone(),
            nearest: nearest(&spec.region, known()),
        })?;
        for &n in &block.nodes {
            velocities[3 * n as usize..3 * n as usize + 3].copy_from_slice(&spec.velocity);
        }
    }
    let mut masses = vec![0.0; mesh.points.len()];
    for spec in &scene.solids {
        for (node, mass) in solids::masses(spec, mesh)? {
            masses[node as usize] += mass;
        }
    }
    Ok(Some(Inertia { masses, velocities }))
}
