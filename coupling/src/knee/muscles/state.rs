//! What is measured of muscles at a pose: stress, volume, and whether something goes through something.

use fem::measure::{Snapshot, intersections, solid_field};
use fem::plan::Plan;
use mesher::MusclePart;

use super::{MUSCLES, Muscles, RECTUS};

/// Part of the volume of rectus femoris below whose stress the percentile is.
const PERCENTILE: f64 = 0.95;

/// The heads at a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MuscleState {
    /// Greatest principal stress in the belly of rectus femoris \[Pa\]: the 95th percentile by volume, and the maximum.
    pub stress: [f64; 2],
    /// Least volume of a cell over that at rest.
    pub least_volume: f64,
    /// Pairs of triangles that intersect: of two heads, and of a head and the femur beside what grows from it.
    pub crossings: [usize; 2],
}

impl MuscleState {
    /// Measures.
    pub fn of(plan: &Plan, at: Snapshot, muscles: &Muscles) -> MuscleState {
        let mut least_volume = f64::INFINITY;
        for name in MUSCLES {
            for region in [name.to_string(), MusclePart::Tendon.of(name)] {
                let cells = solid_field(plan, at, &region).unwrap_or_default();
                least_volume = cells.iter().map(|c| c.volume_ratio).fold(least_volume, f64::min);
            }
        }
        let mut stresses: Vec<[f64; 2]> = solid_field(plan, at, RECTUS)
            .unwrap_or_default()
            .iter()
            .map(|c| [c.principal[0], c.volume])
            .collect();
        stresses.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let volume: f64 = stresses.iter().map(|s| s[1]).sum();
        let mut below = 0.0;
        let percentile = stresses.iter().find(|s| {
            below += s[1];
            below >= PERCENTILE * volume
        });
        let of_heads = intersections(plan, at).iter().map(|(_, n)| n).sum();
        let of_femur = muscles.through_femur(at.x);
        MuscleState {
            stress: [percentile, stresses.last()].map(|s| s.map_or(0.0, |s| s[0])),
            least_volume,
            crossings: [of_heads, of_femur],
        }
    }
}
