//! Tibiofemoral joint: two spheres on two planes and three isometric ligaments, one degree of freedom
//! (Feikes et al. 2003; Duprey et al. 2010). The geometry is not scaled to the subject.

use super::{Equation, Force};
use crate::natural::{End, SegmentId, Shape};
use crate::tables::JointTable;

/// Five equations: medial and lateral contact, ACL, PCL, MCL.
pub fn knee(table: &JointTable, thigh: &Shape, shank: &Shape) -> Vec<Equation> {
    let femur = |item: &str| thigh.point(SegmentId::Thigh, &table.point("tibiofemoral", item), End::Distal);
    let tibia = |item: &str| shank.point(SegmentId::Shank, &table.point("tibiofemoral", item), End::Proximal);
    let contact = |side: &str, name| {
        let normal = table.point("tibiofemoral", &format!("{side} plane normal"));
        Equation::Product {
            a: shank.direction(SegmentId::Shank, &normal),
            b: femur(&format!("{side} sphere centre")).minus(&tibia(&format!("{side} contact plane point"))),
            value: table.scalar("tibiofemoral", &format!("{side} sphere radius")),
            force: Force::Contact(name),
        }
    };
    let ligament = |item: &str, name| {
        let d = table.scalar("tibiofemoral", &format!("{item} length"));
        let span = femur(&format!("{item} origin")).minus(&tibia(&format!("{item} insertion")));
        Equation::Product { a: span.clone(), b: span, value: d * d, force: Force::Tension(name, d) }
    };
    vec![
        contact("medial", "knee_medial"),
        contact("lateral", "knee_lateral"),
        ligament("ACL", "acl"),
        ligament("PCL", "pcl"),
        ligament("MCL", "mcl"),
    ]
}
