//! What is measured of muscles at a pose: stress, volume, and whether something goes through something.

use fem::measure::{Snapshot, intersections, solid_field};
use fem::mesh::CellBlock;
use fem::plan::Plan;
use mesher::MusclePart;
use nalgebra::Point3;

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
    /// The head with the edge of a cell that is drawn out most, by its number in [`MUSCLES`], and to how many times its length at rest.
    pub drawn_out: (usize, f64),
    /// Pairs of triangles that intersect: of two heads, and of a head and the femur beside what grows from it.
    pub crossings: [usize; 2],
}

impl MuscleState {
    /// Measures.
    pub fn of(plan: &Plan, at: Snapshot, muscles: &Muscles) -> MuscleState {
        let mut least_volume = f64::INFINITY;
        let mut drawn_out = (0, 0.0);
        for (head, name) in MUSCLES.into_iter().enumerate() {
            let longest = plan.mesh.block(name).map_or(0.0, |belly| stretch(plan, at, belly));
            if longest > drawn_out.1 {
                drawn_out = (head, longest);
            }
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
            drawn_out,
            crossings: [of_heads, of_femur],
        }
    }
}

/// To how many times its length at rest the edge of a cell is drawn out at most.
fn stretch(plan: &Plan, at: Snapshot, block: &CellBlock) -> f64 {
    let now = at.x.as_chunks::<3>().0;
    let long = |points: &[[f64; 3]], [a, b]: [u32; 2]| {
        let [a, b] = [a, b].map(|n| Point3::from(points[n as usize]));
        (b - a).norm()
    };
    let edges = block.cells().flat_map(|cell| {
        let sides = block.kind.faces().iter().flat_map(|face| (0..4).map(|k| [face[k], face[(k + 1) % 4]]));
        sides.map(|edge| edge.map(|n| cell[n]))
    });
    edges.map(|edge| long(now, edge) / long(&plan.mesh.points, edge)).fold(0.0, f64::max)
}
