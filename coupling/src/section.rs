//! Cuts through the muscles of the thigh at which rigid and deformable forces are compared.

use fem::measure::Cut;
use nalgebra::Vector3;

use crate::thigh::build::ThighMuscle;

/// Cut through the belly, half-way along the muscle's line, normal to it; and the unit tangent there, towards the insertion.
pub fn belly_cut(muscle: &ThighMuscle) -> (Cut, Vector3<f64>) {
    let layer = muscle.layer_at(0.5);
    let tangent = muscle.tangent(layer);
    let effects = ["", "/fibres", "/shell"].map(|part| format!("{}{part}", muscle.name)).to_vec();
    (Cut { point: muscle.line[layer].into(), normal: tangent.into(), effects }, tangent)
}
