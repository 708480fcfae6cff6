//! The lines of quadriceps and gastrocnemii over cylinders.
//!
//! The published lines change their points at certain knee angles, and their lever arms jump there.
//! These go over a frictionless cylinder that turns with the thigh ([`super::wrap`]).
//!
//! | line | axis of the cylinder | radius |
//! |---|---|---|
//! | quadriceps | hinge of the patella (Sancisi & Parenti-Castelli 2011) | 35 mm, mean distance from that axis of the first points that bent knees have in gait2392 (33 to 38 mm) |
//! | gastrocnemius | parallel to the flexion axis of the thigh | the circle through both published points of the thigh that the straight knee's line leaves as a tangent (9 and 8 mm) |
//!
//! Lengths are of the generic thigh and scale with it.

#![allow(non_snake_case)]

use nalgebra::{Vector2, Vector3};

use super::path::{GENERIC_THIGH, Muscle, PathPoint, generic_points, muscles};
use super::wrap::Wrap;
use crate::natural::{End, SegmentId, Shape};
use crate::tables::JointTable;

/// Mean distance of the first points of bent knees from the patella's hinge axis, of the generic thigh \[m\].
const QUADRICEPS_RADIUS: f64 = 0.035;

/// The 43 muscles with quadriceps and gastrocnemii over cylinders; the others are the published ones.
///
/// `hip`: hip centre in pelvis SCS from rP \[m\].
pub fn wrapped_muscles(shapes: &[Shape; 5], hip: &Vector3<f64>) -> Vec<Muscle> {
    let thigh = &shapes[SegmentId::Thigh.index()];
    let scale = thigh.L / GENERIC_THIGH;
    let form = |local: &Vector3<f64>| thigh.point(SegmentId::Thigh, local, End::Distal);
    let direction = |d: &Vector3<f64>| thigh.direction(SegmentId::Thigh, d);
    let quadriceps = || {
        let table = JointTable::built_in();
        let axis = table.point("patellofemoral", "hinge axis in femur").normalize();
        let forward = (Vector3::x() - axis * axis.x).normalize();
        // The joint is not scaled, the muscle points are; the hinge stays where the joint has it.
        Wrap {
            after: 0,
            centre: form(&table.point("patellofemoral", "hinge point on femur")),
            axes: [direction(&forward), direction(&axis.cross(&forward)), direction(&axis)],
            radius: scale * QUADRICEPS_RADIUS,
            sense: -1.0,
        }
    };
    // `outer`: the point of the straight knee, `origin`: that of the bent one, `next`: where the line goes in the straight knee;
    // all in the thigh-distal frame of the generic leg.
    let gastrocnemius = |origin: Vector3<f64>, outer: Vector3<f64>, next: Vector3<f64>| {
        let along = (next - outer).xy().normalize();
        let inward = Vector2::new(-along.y, along.x);
        let chord = (origin - outer).xy();
        // |origin − outer − r inward| = r
        let radius = chord.norm_squared() / (2.0 * chord.dot(&inward));
        let centre = outer.xy() + radius * inward;
        Wrap {
            after: 0,
            centre: form(&(scale * Vector3::new(centre.x, centre.y, 0.0))),
            axes: [Vector3::x(), Vector3::y(), Vector3::z()].map(|d| direction(&d)),
            radius: scale * radius,
            sense: 1.0,
        }
    };
    let always = |point: &PathPoint| PathPoint { active: f64::NEG_INFINITY..f64::INFINITY, ..point.clone() };
    let mut all = muscles(shapes, hip);
    for muscle in &mut all {
        let path = &muscle.path;
        match muscle.name.as_str() {
            "recfem" | "vasmed" | "vasint" | "vaslat" => {
                muscle.path = vec![always(&path[0]), path[path.len() - 1].clone()];
                muscle.wrap = Some(quadriceps());
            }
            "gasmed" | "gaslat" => {
                let points = generic_points(&muscle.name);
                let distal = |k: usize| points[k] + Vector3::new(0.0, GENERIC_THIGH, 0.0);
                // In the straight knee the shank's origin is the thigh's end.
                muscle.wrap = Some(gastrocnemius(distal(1), distal(0), points[2]));
                muscle.path = std::iter::once(always(&path[1])).chain(path[2..].iter().cloned()).collect();
            }
            _ => {}
        }
    }
    all
}
