//! Spherical hip.

use nalgebra::Vector3;

use super::Equation;
use crate::natural::{End, SegmentId, Shape};

/// The hip centre, `centre` in pelvis SCS \[m\] from rP, coincides with rP of the thigh.
pub fn hip(pelvis: &Shape, thigh: &Shape, centre: &Vector3<f64>) -> Vec<Equation> {
    let on_pelvis = pelvis.point(SegmentId::Pelvis, centre, End::Proximal);
    let on_thigh = thigh.point(SegmentId::Thigh, &Vector3::zeros(), End::Proximal);
    vec![Equation::Coincide { gap: on_pelvis.minus(&on_thigh), distal: SegmentId::Thigh, contact: "hip" }]
}
