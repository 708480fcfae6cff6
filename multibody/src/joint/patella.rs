//! Patellofemoral joint: a hinge and the isometric patellar tendon (Sancisi & Parenti-Castelli 2011).

use nalgebra::Vector3;

use super::{Equation, Force};
use crate::natural::{End, SegmentId, Shape};
use crate::tables::JointTable;

/// Six equations: hinge point (3), two angles of the hinge axis, tendon length.
pub fn patella(table: &JointTable, thigh: &Shape, patella: &Shape, shank: &Shape) -> Vec<Equation> {
    let item = |name: &str| table.point("patellofemoral", name);
    let on_femur = thigh.point(SegmentId::Thigh, &item("hinge point on femur"), End::Distal);
    let on_patella = patella.point(SegmentId::Patella, &item("hinge point on patella"), End::Proximal);
    let axis = patella.direction(SegmentId::Patella, &item("hinge axis in patella"));
    // The angles follow from the axis in the femur, which the table gives to more digits.
    let axis_in_femur = item("hinge axis in femur").normalize();
    let angle = |femur_axis: Vector3<f64>| Equation::Product {
        a: thigh.direction(SegmentId::Thigh, &femur_axis),
        b: axis.clone(),
        value: femur_axis.dot(&axis_in_femur),
        force: Force::None,
    };
    let d = table.scalar("patellofemoral", "patellar tendon length");
    let apex = patella.point(SegmentId::Patella, &Vector3::zeros(), End::Distal);
    let tuberosity = shank.point(SegmentId::Shank, &item("patellar tendon insertion"), End::Proximal);
    let tendon = apex.minus(&tuberosity);
    vec![
        Equation::Coincide {
            gap: on_femur.minus(&on_patella),
            distal: SegmentId::Patella,
            contact: "patella",
        },
        angle(Vector3::x()),
        angle(Vector3::y()),
        Equation::Product {
            a: tendon.clone(),
            b: tendon,
            value: d * d,
            force: Force::Tension("patellar_tendon", d),
        },
    ]
}
