//! What a thigh is meshed from, as a whole: sections of its muscles, its bones, and where the muscles hold on to them.

use nalgebra::Vector3;

use super::attachment::{Attachment, Role, Site};
use super::scale::{SegmentMap, map_sections};
use super::{Bone, MuscleSections};
use fem::mesh::MeshError;

/// Sections, bones and attachments in one posture \[m\].
#[derive(Clone, Debug, PartialEq)]
pub struct Limb {
    /// Muscles.
    pub sections: Vec<MuscleSections>,
    /// Bones.
    pub bones: Vec<Bone>,
    /// Where the muscles hold on to the bones.
    pub attachments: Vec<Attachment>,
}

/// Affine maps of the four segments that carry muscles of the thigh.
#[derive(Clone, Debug, PartialEq)]
pub struct LimbMap {
    /// Pelvis: hip bone and sacrum.
    pub pelvis: SegmentMap,
    /// Thigh: femur.
    pub thigh: SegmentMap,
    /// Patella.
    pub patella: SegmentMap,
    /// Shank: tibia and fibula.
    pub shank: SegmentMap,
    /// Hip centre before \[m\].
    pub hip: Vector3<f64>,
    /// Knee centre before \[m\].
    pub knee: Vector3<f64>,
}

/// A muscle ends where its course turns away by more than this from the reference insertion \[rad\].
const MOST_TURN: f64 = 45.0 * std::f64::consts::PI / 180.0;

impl LimbMap {
    /// A limb of other size in the same posture: every segment grows by its factor in all directions, pelvis and thigh about the hip
    /// centre, shank and patella with the knee.
    pub fn sized(hip: Vector3<f64>, knee: Vector3<f64>, pelvis: f64, thigh: f64, shank: f64) -> LimbMap {
        let map = |from, to, factor| SegmentMap { linear: nalgebra::Matrix3::identity() * factor, from, to };
        let knee_after = hip + (knee - hip) * thigh;
        LimbMap {
            pelvis: map(hip, hip, pelvis),
            thigh: map(hip, hip, thigh),
            patella: map(knee, knee_after, thigh),
            shank: map(knee, knee_after, shank),
            hip,
            knee,
        }
    }

    /// The map of a segment; `None` for one that carries no muscle of the thigh.
    pub fn of(&self, segment: &str) -> Option<&SegmentMap> {
        Some(match segment {
            "pelvis" => &self.pelvis,
            "thigh" => &self.thigh,
            "patella" => &self.patella,
            "shank" => &self.shank,
            _ => return None,
        })
    }
}

impl Limb {
    /// The limb carried by its segments: bones and attachments with their segment, muscles blended along the segments they span
    /// ([`map_sections`]).
    ///
    /// Refuses muscles without an origin or insertion and bones that nothing holds on to: their segment is unknown.
    pub fn mapped(&self, map: &LimbMap) -> Result<Limb, MeshError> {
        let unknown = |name: &str, what: &str| MeshError::Unattached { name: name.into(), what: what.into() };
        let mut limb = self.clone();
        for muscle in &mut limb.sections {
            let segment = |role: Role, what: &str| {
                let of_end = |a: &&Attachment| a.muscle == muscle.name && a.role == role;
                let end = self.attachments.iter().find(of_end);
                end.map(|a| a.segment.as_str()).ok_or_else(|| unknown(&muscle.name, what))
            };
            let (from, to) = (segment(Role::Origin, "origin")?, segment(Role::Insertion, "insertion")?);
            // From the pelvis down: the thigh hangs on the hip, patella and shank on the knee.
            let below = if to == "patella" { &map.patella } else { &map.shank };
            let (maps, joints) =
                ([map.pelvis.clone(), map.thigh.clone(), below.clone()], [map.hip, map.knee]);
            let level = |segment: &str| match segment {
                "pelvis" => 0,
                "thigh" => 1,
                _ => 2,
            };
            let (first, last) = (level(from).min(level(to)), level(to).max(level(from)));
            let before = muscle.clone();
            *muscle = map_sections(&before, &maps[first..=last], &joints[first..last]);
            for a in limb.attachments.iter_mut().filter(|a| a.muscle == muscle.name) {
                if let Site::SidePatch { s, .. } = &mut a.site {
                    *s = s.map(|s| same_place(s, &before, muscle));
                }
            }
        }
        for bone in &mut limb.bones {
            let row = self.attachments.iter().find(|a| a.bone == bone.name);
            let map = row.and_then(|a| map.of(&a.segment)).ok_or_else(|| unknown(&bone.name, "muscle"))?;
            bone.surface.points.iter_mut().for_each(|p| *p = map.apply(&Vector3::from(*p)).into());
        }
        for a in &mut limb.attachments {
            let map = map.of(&a.segment).ok_or_else(|| unknown(&a.segment, "map"))?;
            a.tendon.iter_mut().chain(&mut a.reference_point).for_each(|p| *p = map.apply(p));
            if let Some(footprint) = &mut a.footprint {
                footprint.centre = map.apply(&footprint.centre);
                footprint.half_sides = footprint.half_sides.map(|side| map.linear * side);
            }
        }
        Ok(limb)
    }

    /// Lets `muscle` insert at the reference point of its table and not where it is drawn: it ends at the last section from which the
    /// point lies ahead, and a tendon runs on from there. Returns how much of its line is kept; `None`, and nothing changed, where the
    /// table has no such point or no section sees it ahead.
    pub fn insert_at_reference(&mut self, muscle: &str) -> Option<f64> {
        let drawn = |a: &&Attachment| a.muscle == muscle && a.role == Role::Insertion;
        let row = self.attachments.iter().filter(drawn).find(|a| a.reference_point.is_some())?.clone();
        let point = row.reference_point?;
        let stations = &mut self.sections.iter_mut().find(|m| m.name == muscle)?.stations;
        let ahead = |s: &super::Station| s.normal.angle(&(point - s.centre)) <= MOST_TURN;
        let last = stations.iter().rposition(ahead).filter(|&i| i > 0)?;
        let kept = stations[last].s;
        stations.truncate(last + 1);
        stations.iter_mut().for_each(|station| station.s /= kept);
        self.attachments.retain(|a| !drawn(&a));
        for a in self.attachments.iter_mut().filter(|a| a.muscle == muscle) {
            if let Site::SidePatch { s, .. } = &mut a.site {
                *s = s.map(|s| (s / kept).min(1.0));
            }
        }
        self.attachments.push(Attachment {
            site: Site::EndFace,
            tendon: vec![point],
            footprint: None,
            ..row
        });
        Some(kept)
    }
}

/// The fraction `s` of a line after its stations have moved along it.
fn same_place(s: f64, before: &MuscleSections, after: &MuscleSections) -> f64 {
    let (old, new) = (&before.stations, &after.stations);
    let i = (old[1..old.len() - 1]).partition_point(|station| station.s <= s);
    let f = (s - old[i].s) / (old[i + 1].s - old[i].s);
    new[i].s + f * (new[i + 1].s - new[i].s)
}
