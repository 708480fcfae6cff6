//! The femur as what patella and strands lie on: a smooth distance to its cartilage, and to its bone where there is none.

use std::collections::BTreeMap;

use fem::geometry::closest::Feature;
use fem::geometry::{DistanceField, SearchSurface, SignedDistance, Surface, SurfaceError};
use nalgebra::{Isometry3, Vector3};

use super::anatomy::{Bone, FemurSolid, KneeAnatomy, SUNK};
use super::solid::MadeFemur;

/// Corner by corner the box \[m\] in the frame of the femur in which something may lie on it: from the backs of the condyles to the front, from
/// below them to where the tendon of the quadriceps has left the bone, from side to side.
const BOX: [[f64; 3]; 2] = [[-0.032, -0.034, -0.050], [0.060, 0.062, 0.050]];
/// Spacing \[m\] of its samples: the mean edge of the surfaces of cartilage is 0.76 mm.
const SPACING: f64 = 1e-3;
/// Thickness \[m\] of cartilage at its rim (median over the sheet): there it slopes down to the bone.
const RIM: f64 = 2.2e-3;
/// What is farther \[m\] than the four spacings within which samples are exact is of no interest, and twice as far.
const MARGIN: f64 = 8e-3;

/// Whether a place \[m\] in the frame of the femur is beside its knee.
pub(super) fn is_at_knee(place: &Vector3<f64>) -> bool {
    let [lo, hi] = BOX;
    (0..3).all(|c| (lo[c]..=hi[c]).contains(&place[c]))
}

/// The distance to a femur around its knee, in its own frame.
pub fn field(anatomy: &KneeAnatomy) -> Result<DistanceField, SurfaceError> {
    sampled(anatomy, BOX.map(Vector3::from))
}

/// The same of all of the femur.
pub fn whole(anatomy: &KneeAnatomy) -> Result<DistanceField, SurfaceError> {
    let own = |surface| anatomy.placed(surface, Bone::Femur, &Isometry3::identity()).bounds();
    let ((lo, hi), (from, to)) = (own(&anatomy.femur), own(&anatomy.femoral_cartilage));
    let margin = Vector3::repeat(MARGIN);
    sampled(anatomy, [lo.inf(&from) - margin, hi.sup(&to) + margin])
}

fn sampled(anatomy: &KneeAnatomy, within: [Vector3<f64>; 2]) -> Result<DistanceField, SurfaceError> {
    let own = |surface| anatomy.placed(surface, Bone::Femur, &Isometry3::identity());
    match &anatomy.solid {
        FemurSolid::Surfaces => laid(&own(&anatomy.femoral_cartilage), own(&anatomy.femur), within),
        FemurSolid::Made { shape, shaft } => {
            let shaft = SearchSurface::new(shaft.clone());
            Ok(MadeFemur::new(shape, &shaft, SUNK)?.sampled(within, SPACING))
        }
    }
}

/// The distance to an open sheet of cartilage, normals outward, that is laid on a bone.
fn laid(
    cartilage: &Surface,
    bone: Surface,
    [lo, hi]: [Vector3<f64>; 2],
) -> Result<DistanceField, SurfaceError> {
    let bone = SearchSurface::new(bone);
    let bone = SignedDistance::new(&bone)?;
    let sloped = with_slope(cartilage, &bone);
    let n_sheet = cartilage.triangles.len();
    let mut normals = vec![Vector3::zeros(); sloped.points.len()];
    for (t, corners) in sloped.triangles.iter().enumerate() {
        corners.iter().for_each(|c| normals[*c as usize] += sloped.area_vector(t));
    }
    let sheet = SearchSurface::new(sloped);
    let (from, to) = sheet.surface().bounds();
    let distance = |p: &Vector3<f64>| {
        let of_bone = || bone.at(p).distance + SUNK;
        // So far off nothing is looked for in the sheet; what stands in its place is less than its distance and does not jump.
        let away = (from - p).sup(&(p - to)).sup(&Vector3::zeros()).norm();
        if away > MARGIN {
            return of_bone().min(away);
        }
        let Some((closest, triangle, part)) = sheet.nearest(p) else { return of_bone() };
        let corners = sheet.surface().triangles[triangle as usize];
        // The normal between the corners, and not that of the triangle: at edges and corners that one may look the wrong way.
        let normal: Vector3<f64> = corners.iter().map(|c| normals[*c as usize]).sum();
        let signed = closest.distance.copysign((p - closest.on_b).dot(&normal));
        let is_foot = |k: u8| corners[k as usize % 3] as usize >= cartilage.points.len();
        let at_foot = match part {
            Feature::Face => false,
            Feature::Edge(e) => is_foot(e) && is_foot(e + 1),
            Feature::Vertex(v) => is_foot(v),
        };
        match (triangle as usize) < n_sheet {
            true => signed,
            // Beyond the foot of the slope there is bone.
            false if at_foot && signed < 0.0 => of_bone(),
            false => signed.min(of_bone()),
        }
    };
    Ok(DistanceField::new(lo, hi, SPACING, distance))
}

/// How far \[m\] a smooth femur lies below the points of its cartilage at most: so far it has to be raised for whatever stays off it to stay off
/// the triangles. A smooth distance rounds off what is curved outward: 0.02 mm over a condyle, 0.2 mm along the rim of the sheet.
pub fn below(field: &DistanceField, cartilage: &Surface) -> f64 {
    let depth = |p: &[f64; 3]| field.at(&Vector3::from(*p)).map_or(0.0, |at| at.distance);
    cartilage.points.iter().map(depth).fold(0.0, f64::max)
}

/// A sheet with a slope along its rim, down to the bone and twice as far out. Where the bone turns away, the foot goes down to the sunk bone: a
/// tangent alone would stand out as a fin, on which a muscle catches.
fn with_slope(sheet: &Surface, bone: &SignedDistance) -> Surface {
    let mut normals = vec![Vector3::zeros(); sheet.points.len()];
    let mut outward = normals.clone();
    let mut sides = BTreeMap::<[u32; 2], usize>::new();
    for (t, corners) in sheet.triangles.iter().enumerate() {
        for k in 0..3 {
            let [a, b] = [corners[k], corners[(k + 1) % 3]];
            normals[a as usize] += sheet.area_vector(t);
            *sides.entry([a.min(b), a.max(b)]).or_default() += 1;
        }
    }
    let place = |n: u32| Vector3::from(sheet.points[n as usize]);
    let mut rim = Vec::new();
    for (t, corners) in sheet.triangles.iter().enumerate() {
        for k in 0..3 {
            let [a, b] = [corners[k], corners[(k + 1) % 3]];
            if sides[&[a.min(b), a.max(b)]] == 1 {
                rim.push([a, b]);
                let out = (place(b) - place(a)).cross(&sheet.area_vector(t).normalize());
                [a, b].iter().for_each(|n| outward[*n as usize] += out);
            }
        }
    }
    let mut sloped = sheet.clone();
    let mut below = BTreeMap::<u32, u32>::new();
    for [a, b] in rim {
        let [c, d] = [a, b].map(|n| {
            *below.entry(n).or_insert_with(|| {
                let [down, out] = [-normals[n as usize].normalize(), outward[n as usize].normalize()];
                let foot = place(n) + RIM * (down + 2.0 * out);
                let at = bone.at(&foot);
                let above = (at.distance + SUNK).max(0.0);
                sloped.points.push((foot - above * at.gradient(&foot)).into());
                sloped.points.len() as u32 - 1
            })
        });
        sloped.triangles.extend([[b, a, c], [b, c, d]]);
    }
    sloped
}
