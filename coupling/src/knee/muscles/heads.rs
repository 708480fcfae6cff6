//! The four heads of the quadriceps as blocks of hexahedra: the bellies of the built-in thigh, cut above the patella, each drawn out to a tendon
//! that ends on it.

use std::collections::BTreeSet;

use fem::geometry::DistanceField;
use fem::mesh::{CellBlock, CellKind, Mesh};
use mesher::attachment::{Attachment, Footprint, Role, Site};
use mesher::limb::Limb;
use mesher::tendon::Slip;
use mesher::{Bone, MuscleBlock, MuscleSections, Station};
use nalgebra::{Isometry3, Point3, Rotation3, Unit, Vector3};

use super::lying::places;
use super::{BellyPlace, MuscleError, PatellaPlace};
use crate::knee::anatomy::BellyFit;
use crate::knee::level::level;
use crate::knee::quadriceps::Shaft;
use crate::thigh::limb;

/// The heads, in the order of the mesh.
pub const MUSCLES: [&str; 4] = [RECTUS, "vastus_intermedius", "vastus_lateralis", "vastus_medialis"];
/// The one that comes from the pelvis.
pub const RECTUS: &str = "rectus_femoris";

/// Where a head ends on the patella: the middle of its footprint, and from there half of its longer and of its shorter side, in heights of the
/// patella above its origin, in its own frame.
struct Foot {
    centre: [f64; 3],
    half_sides: [[f64; 3]; 2],
}

/// Footprints in the order of [`MUSCLES`], laid by hand on the upper edge of the patella of the folder (17.2 mm high above its origin): rectus
/// femoris in front, vastus intermedius behind it, the others along the sides. Those of the thigh are of the patella of another person, 5 mm
/// inside this femur.
const FEET: [Foot; 4] = [
    Foot { centre: [0.06, 0.80, 0.00], half_sides: [[0.0, 0.0, 0.49], [0.11, -0.06, 0.0]] },
    Foot { centre: [-0.24, 0.96, 0.00], half_sides: [[-0.12, 0.0, 0.44], [0.11, -0.04, 0.03]] },
    Foot { centre: [-0.03, 0.73, 0.86], half_sides: [[-0.10, -0.16, 0.24], [0.12, 0.0, 0.05]] },
    Foot { centre: [-0.15, 0.60, -1.00], half_sides: [[-0.16, -0.20, -0.14], [0.12, 0.0, -0.10]] },
];

/// How far \[m\] above the patella bellies are cut, in the order of [`MUSCLES`]. They are drawn to below its upper edge, 3.6 mm into it; rectus and
/// intermedius are tendon from here on, the others fleshy.
const CUT: [f64; 4] = [25e-3, 25e-3, 18e-3, 14e-3];
/// Length \[m\] over which ends are moved: what of the bellies is below the middle of the thigh.
const BENT: f64 = 0.15;
/// A station nearer to the cut than this \[m\] makes way for it; stations are 10 to 25 mm apart.
const LEAST_INTERVAL: f64 = 4e-3;
/// How far \[m\] the mesh stays off the femur: 0.1 mm more than where contact begins, so that it starts free of forces.
const OFF: f64 = 0.4e-3;
/// Spacing \[m\] of the femur that is meshed around: its nodes lie some 0.03 mm off the smooth one over a condyle.
const FEMUR_SPACING: f64 = 2e-3;
/// A side grows from bone that is nearer than this \[m\]: 3.5 mm as in the thigh, and the 1.4 mm by which the femur of the knee is sunk.
const PATCH_REACH: f64 = 4.9e-3;
/// Sweeps over all faces at most.
const SWEEPS: usize = 50;
/// Layers of cells of a tendon at least.
const LEAST_LAYERS: usize = 2;
/// Worst cell, scaled Jacobian. The goal of the thigh is 0.3; the tendon of vastus medialis, whose belly ends 20 mm behind its foot, has 0.23 at
/// 10 mm and 0.16 at 4 mm.
const LEAST_SHAPE: f64 = 0.1;

/// A head in the frame of the femur \[m\].
#[derive(Clone, Debug)]
pub struct HeadMesh {
    /// Belly and tendon, layer by layer.
    pub block: MuscleBlock,
    /// The layer of nodes where the tendon begins.
    pub tendon_from: usize,
    /// Nodes that are held: on the femur, or on the pelvis, which is as fixed.
    pub held: Vec<u32>,
}

impl HeadMesh {
    /// Nodes on the patella.
    pub fn footprint(&self) -> Vec<u32> {
        let last = self.block.n_layers() - 1;
        (0..self.block.nodes_per_section as u32).map(|k| self.block.node(last, k)).collect()
    }

    /// Cells of the belly; those of the tendon follow.
    pub fn n_belly_cells(&self) -> usize {
        self.block.section_cells.len() * self.tendon_from
    }
}

/// Meshes the heads with edges of about `edge` \[m\] around a femur.
pub fn heads(
    femur: &DistanceField,
    BellyPlace { to_femur, shaft, fit }: BellyPlace,
    patella: &PatellaPlace,
    edge: f64,
) -> Result<Vec<HeadMesh>, MuscleError> {
    let Limb { mut sections, mut attachments, .. } = limb()?;
    sections.retain(|m| MUSCLES.contains(&m.name.as_str()));
    sections.sort_by_key(|m| MUSCLES.iter().position(|name| *name == m.name));
    for (muscle, above) in sections.iter_mut().zip(CUT) {
        let kept = cut(muscle, patella.top + above);
        for a in attachments.iter_mut().filter(|a| a.muscle == muscle.name) {
            if let Site::SidePatch { s, .. } = &mut a.site {
                *s = s.map(|s| s / kept);
            }
        }
        carry(muscle, to_femur);
    }
    sections.iter_mut().for_each(|muscle| around(muscle, shaft, fit));
    let bone = Bone { name: "femur".into(), surface: level(femur, OFF, FEMUR_SPACING) };
    let built = mesher::build(&sections, std::slice::from_ref(&bone), edge);
    let mut heads = Vec::new();
    for result in built.muscles {
        let block = result.block;
        let origins = attachments.iter().filter(|a| a.muscle == block.name && a.role == Role::Origin);
        let held = held(&block, origins, femur);
        let tendon_from = block.n_layers() - 1;
        heads.push(HeadMesh { block, tendon_from, held });
    }
    let feet = FEET.map(|foot| Footprint {
        centre: (patella.pose * Point3::from(patella.height * Vector3::from(foot.centre))).coords,
        half_sides: foot.half_sides.map(|side| patella.pose * (patella.height * Vector3::from(side))),
    });
    // The same number of layers for all.
    let wanted = heads
        .iter()
        .zip(&feet)
        .map(|(head, footprint)| (Slip::new(&head.block, footprint, 1).length() / edge).round() as usize);
    let n_layers = wanted.fold(LEAST_LAYERS, usize::max);
    for (head, footprint) in heads.iter_mut().zip(&feet) {
        let slip = Slip::new(&head.block, footprint, n_layers);
        let step = 1.0 / head.tendon_from as f64;
        for layer in &slip.layers[1..] {
            head.block.points.extend(layer.iter().map(|p| <[f64; 3]>::from(*p)));
            let last = head.block.s[head.block.s.len() - 1];
            head.block.s.push(last + step);
        }
        lift_off(head, femur);
        let shape = least_shape(head);
        if shape.is_nan() || shape < LEAST_SHAPE {
            return Err(MuscleError::Shape { muscle: head.block.name.clone(), shape });
        }
    }
    Ok(heads)
}

/// Ends a muscle where its line comes down to `height` \[m\]; how much of the line is left.
fn cut(muscle: &mut MuscleSections, height: f64) -> f64 {
    let stations = &mut muscle.stations;
    let Some(i) = stations.iter().rposition(|s| s.centre.y > height).filter(|i| i + 1 < stations.len())
    else {
        return 1.0;
    };
    let (a, b) = (&stations[i], &stations[i + 1]);
    let t = (a.centre.y - height) / (a.centre.y - b.centre.y);
    let between = |p: &Vector3<f64>, q: &Vector3<f64>| p * (1.0 - t) + q * t;
    let normal = between(&a.normal, &b.normal).normalize();
    let axis = between(&a.axis, &b.axis);
    let last = Station {
        s: a.s * (1.0 - t) + b.s * t,
        centre: between(&a.centre, &b.centre),
        normal,
        axis: (axis - normal * normal.dot(&axis)).normalize(),
        outline: std::array::from_fn(|k| between(&a.outline[k], &b.outline[k])),
    };
    let is_close = (last.centre - a.centre).norm() < LEAST_INTERVAL;
    stations.truncate(if is_close { i } else { i + 1 });
    stations.push(last);
    let kept = stations[stations.len() - 1].s;
    stations.iter_mut().for_each(|station| station.s /= kept);
    kept
}

/// Turns the end of a belly around the shaft of the femur and shifts it away from it, and what is before it less and less.
fn around(muscle: &mut MuscleSections, shaft: &Shaft, fit: BellyFit) {
    let axis = Unit::new_normalize(shaft.direction);
    let mut left = 0.0;
    let mut after: Option<Vector3<f64>> = None;
    for station in muscle.stations.iter_mut().rev() {
        left += after.map_or(0.0, |next| (next - station.centre).norm());
        after = Some(station.centre);
        let t = (1.0 - left / BENT).max(0.0);
        let part = t * t * (3.0 - 2.0 * t);
        let turn = Rotation3::from_axis_angle(&axis, part * fit.turn.to_radians());
        let foot = shaft.nearest(&station.centre);
        let out = turn * (station.centre - foot) * (part * fit.shift);
        let place = |p: &Vector3<f64>| foot + turn * (p - foot) + out;
        station.centre = place(&station.centre);
        station.outline = station.outline.map(|p| place(&p));
        (station.normal, station.axis) = (turn * station.normal, turn * station.axis);
    }
}

fn carry(muscle: &mut MuscleSections, by: &Isometry3<f64>) {
    let place = |p: &Vector3<f64>| (by * Point3::from(*p)).coords;
    for s in &mut muscle.stations {
        s.centre = place(&s.centre);
        s.outline = s.outline.map(|p| place(&p));
        (s.normal, s.axis) = (by * s.normal, by * s.axis);
    }
}

/// Nodes where a belly grows from bone, sorted.
fn held<'a>(
    block: &MuscleBlock,
    origins: impl Iterator<Item = &'a Attachment>,
    femur: &DistanceField,
) -> Vec<u32> {
    let mut nodes = Vec::new();
    for a in origins {
        let near = |n: &u32| {
            let at = femur.near(&Vector3::from(block.points[*n as usize]), PATCH_REACH);
            at.is_some_and(|at| at.distance < PATCH_REACH)
        };
        let own = a.nodes(block);
        match a.site {
            Site::SidePatch { .. } => nodes.extend(own.into_iter().filter(near)),
            _ => {
                let layer = (0..block.nodes_per_section as u32).map(|k| block.node(0, k));
                nodes.extend(layer);
            }
        }
    }
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}

/// Moves nodes of the side, free of stress, until places on faces that do not grow from bone are [`OFF`] the femur: the mesher keeps nodes off it,
/// and knows nothing of tendons. Where that takes more than [`SWEEPS`] something is left, which [`Lying`](super::lying::Lying) refuses where it
/// is in the bone.
fn lift_off(head: &mut HeadMesh, femur: &DistanceField) {
    let fixed: BTreeSet<u32> = head.held.iter().copied().chain(head.footprint()).collect();
    let mut faces = head.block.side_faces();
    faces.retain(|face| face.iter().all(|n| head.held.binary_search(n).is_err()));
    for _ in 0..SWEEPS {
        let mut moved = false;
        for face in &faces {
            let corners = face.map(|n| Vector3::from(head.block.points[n as usize]));
            for (weights, _) in places(&corners) {
                let at = |k: usize, points: &[[f64; 3]]| Vector3::from(points[face[k] as usize]);
                let place: Vector3<f64> = (0..4).map(|k| weights[k] * at(k, &head.block.points)).sum();
                let Some(near) = femur.near(&place, OFF) else { continue };
                let free = (0..4).filter(|k| !fixed.contains(&face[*k]));
                // Of four free nodes it is a quarter at least; where some are fixed, the others do not do their part.
                let share = free.clone().map(|k| weights[k] * weights[k]).sum::<f64>().max(0.25);
                for k in free.filter(|k| weights[*k] > 0.0) {
                    let by = (OFF - near.distance) * weights[k] / share * near.gradient;
                    head.block.points[face[k] as usize] = (at(k, &head.block.points) + by).into();
                    moved = true;
                }
            }
        }
        if !moved {
            break;
        }
    }
}

/// Least scaled Jacobian of the cells of a head.
fn least_shape(head: &HeadMesh) -> f64 {
    let nodes = head.block.cells().flatten().collect();
    let block = CellBlock { name: String::new(), kind: CellKind::Hex8, nodes };
    let mesh = Mesh { points: head.block.points.clone(), ..Mesh::default() };
    mesh.quality(&block).map_or(0.0, |q| q.least_scaled_jacobian)
}
