//! Cuts through the muscles of the thigh at which rigid and deformable forces are compared.

use fem::measure::{Cut, SectionForce, Snapshot, section_force};
use fem::plan::Plan;
use mesher::MusclePart;
use nalgebra::Vector3;

use crate::thigh::build::ThighMuscle;

/// Force through the belly of a muscle.
pub struct BellyForce {
    /// All parts.
    pub section: SectionForce,
    /// Unit tangent of the muscle's line where it is now, towards the insertion.
    pub tangent: Vector3<f64>,
}

impl BellyForce {
    /// Force along the muscle's line \[N\], tension positive.
    pub fn along(&self) -> f64 {
        self.section.along(self.tangent.into())
    }
}

/// Force through the belly, half-way along the muscle's line, of the material that lies there: cut normal to the line in the mesh, counted
/// along the line as it is now.
pub fn belly_force(plan: &Plan, at: Snapshot, muscle: &ThighMuscle) -> BellyForce {
    let layer = muscle.layer_at(0.5);
    let normal = muscle.tangent(layer);
    let effects =
        [MusclePart::Belly, MusclePart::Fibres, MusclePart::Shell].map(|part| part.of(&muscle.name)).to_vec();
    let cut = Cut { point: muscle.line[layer].into(), normal: normal.into(), effects };
    let centre = |layer: usize| -> Vector3<f64> {
        let nodes = muscle.layer_nodes(layer);
        let n = nodes.len() as f64;
        nodes
            .map(|n| Vector3::from_column_slice(&at.x[3 * n as usize..3 * n as usize + 3]))
            .sum::<Vector3<f64>>()
            / n
    };
    let (before, after) = (layer.saturating_sub(1), (layer + 1).min(muscle.line.len() - 1));
    let tangent = (centre(after) - centre(before)).normalize();
    BellyForce { section: section_force(plan, at, &cut), tangent }
}
