//! Two ankles: universal (toolbox of 2018) and parallel (Di Gregorio et al. 2007; papers of 2012 and 2014).

use nalgebra::{Matrix3, Vector3};

use super::{Equation, Force};
use crate::natural::{End, SegmentId, Shape};
use crate::tables::JointTable;

/// Generic shank length for the universal ankle point (Delp 1990) \[m\].
pub const GENERIC_SHANK: f64 = 0.3907;
/// Generic shank length for the shift of the parallel ankle into the Delp ankle \[m\].
const GENERIC_SHANK_SHIFT: f64 = 0.3964;

/// Coincident point and a constant angle between the talocrural axis (shank) and the subtalar axis (foot).
///
/// `cos_angle`: mean over the trial of the marker-based posture.
pub fn universal(table: &JointTable, shank: &Shape, foot: &Shape, cos_angle: f64) -> Vec<Equation> {
    let scale = shank.L / GENERIC_SHANK;
    let item = |name: &str| table.point("ankle_universal", name);
    let on_shank = shank.point(SegmentId::Shank, &(scale * item("joint point on shank")), End::Distal);
    let on_foot = foot.point(SegmentId::Foot, &(scale * item("joint point on foot")), End::Proximal);
    vec![
        Equation::Coincide { gap: on_shank.minus(&on_foot), distal: SegmentId::Foot, contact: "ankle" },
        Equation::Product {
            a: shank.direction(SegmentId::Shank, &item("talocrural axis").normalize()),
            b: foot.direction(SegmentId::Foot, &item("subtalar axis").normalize()),
            value: cos_angle,
            force: Force::None,
        },
    ]
}

/// A point contact and two isometric ligaments (TiCaL, CaFiL), shifted into the Delp ankle.
///
/// `neutral`: mean rotation of the foot in the shank in standing or mid-stance; the foot-side points are turned by
/// its inverse, because they hold where foot and shank frames agree.
pub fn parallel(table: &JointTable, shank: &Shape, foot: &Shape, neutral: &Matrix3<f64>) -> Vec<Equation> {
    let shift = shank.L / GENERIC_SHANK_SHIFT
        * table.point("ankle_parallel", "optional shift added to all six ankle points");
    let item = |name: &str| table.point("ankle_parallel", name) + shift;
    let on_shank =
        |name: &str| shank.point(SegmentId::Shank, &item(&format!("{name} (shank side)")), End::Distal);
    let on_foot = |name: &str| {
        let c: Vector3<f64> = neutral.transpose() * item(&format!("{name} (foot side)"));
        foot.point(SegmentId::Foot, &c, End::Proximal)
    };
    let ligament = |name: &str, force| {
        let d = table.scalar("ankle_parallel", &format!("{name} length"));
        let span = on_shank(name).minus(&on_foot(name));
        Equation::Product { a: span.clone(), b: span, value: d * d, force: Force::Tension(force, d) }
    };
    let contact = "lateral sphere centre = contact point";
    vec![
        Equation::Coincide {
            gap: on_shank(contact).minus(&on_foot(contact)),
            distal: SegmentId::Foot,
            contact: "ankle",
        },
        ligament("TiCaL", "tibiocalcaneal"),
        ligament("CaFiL", "calcaneofibular"),
    ]
}
