//! Both legs in one trial file: `[left]` says what is different for the left one.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Deserialize;

use super::{MarkerEntry, RangeEntry, TrialFile};
use crate::error::Mistakes;
use crate::natural::SegmentId;
use crate::trial::Side;

/// `[left]`: the left leg of a trial whose other tables are those of the right leg. What is absent is as for the right leg.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeftEntry {
    /// Markers that carry the segments; those of the pelvis absent: as in `[markers]`.
    pub markers: MarkerEntry<Option<Vec<String>>>,
    /// Plates of the left foot.
    pub force: LeftForce,
    /// Part of the trial that is reported; absent: that of the right leg, cycles counted on the plates of the left foot.
    pub range: Option<RangeEntry>,
    /// Landmarks.
    #[serde(default)]
    pub landmarks: LeftLandmarks,
}

/// `[left.force]`. File, axes and columns are those of `[force]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeftForce {
    /// Numbers of the plates that the left foot steps on.
    pub plates: Vec<usize>,
    /// Plate of the next step of the left foot.
    pub next_plate: Option<usize>,
}

/// `[left.landmarks]`: a table, or the markers on the left leg. Source, hip centre, recordings and the markers of the pelvis are those of
/// `[landmarks]`; a hip centre in numbers stays in axes of a right leg.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)] // the names are the anatomy
pub struct LeftLandmarks {
    /// Table of local coordinates; absent: that of the right leg, mirrored.
    pub table: Option<PathBuf>,
    /// Item of the table → recorded marker; those of the pelvis as for the right leg.
    #[serde(default)]
    pub rename: BTreeMap<String, String>,
    pub lateral_epicondyle: Option<String>,
    pub medial_epicondyle: Option<String>,
    pub lateral_malleolus: Option<String>,
    pub medial_malleolus: Option<String>,
    pub fibula_head: Option<String>,
    pub patella: Option<String>,
    pub heel: Option<String>,
    pub metatarsal_1: Option<String>,
    pub metatarsal_5: Option<String>,
}

impl TrialFile {
    /// The legs that the file describes, the one of its main tables first.
    pub fn sides(&self) -> Vec<Side> {
        let left = self.left.iter().map(|_| Side::Left).filter(|side| *side != self.subject.side);
        std::iter::once(self.subject.side).chain(left).collect()
    }

    /// The same file for one of its [legs](Self::sides) alone.
    pub fn leg(&self, side: Side) -> TrialFile {
        let mut file = self.clone();
        let Some(left) = file.left.take() else { return file };
        file.leg = Some(side);
        if side == self.subject.side {
            return file;
        }
        file.subject.side = Side::Left;
        let MarkerEntry { pelvis, thigh, shank, foot } = left.markers;
        file.markers = MarkerEntry { pelvis: pelvis.unwrap_or(file.markers.pelvis), thigh, shank, foot };
        file.force.plates = left.force.plates;
        file.force.next_plate = left.force.next_plate;
        file.range = left.range.unwrap_or(file.range);
        let (all, own) = (&mut file.landmarks, left.landmarks);
        all.table = own.table.or(all.table.take());
        // Items of the pelvis keep their markers where the left leg uses them, too.
        all.rename.retain(|_, marker| file.markers.pelvis.contains(marker));
        all.rename.extend(own.rename);
        // Of the leg, nothing goes over from the other one.
        all.lateral_epicondyle = own.lateral_epicondyle;
        all.medial_epicondyle = own.medial_epicondyle;
        all.lateral_malleolus = own.lateral_malleolus;
        all.medial_malleolus = own.medial_malleolus;
        all.fibula_head = own.fibula_head;
        all.patella = own.patella;
        all.heel = own.heel;
        all.metatarsal_1 = own.metatarsal_1;
        all.metatarsal_5 = own.metatarsal_5;
        file
    }

    /// Does something with every leg, the one of the main tables first. What is wrong with both is noted once, the rest with its leg.
    pub fn each_leg<T>(
        &self,
        wrong: &mut Mistakes,
        mut with: impl FnMut(&TrialFile, &mut Mistakes) -> T,
    ) -> Vec<T> {
        let sides = self.sides();
        let mut all = Vec::new();
        let mut one = |side: Side| {
            let mut own = Mistakes::default();
            let done = with(&self.leg(side), &mut own);
            all.push((side.name(), own));
            done
        };
        let done = sides.into_iter().map(&mut one).collect();
        wrong.note_legs(all);
        done
    }

    /// What is wrong with `[left]` beside the main tables; each by itself is examined as a [leg](Self::leg).
    pub(super) fn check_left(&self, wrong: &mut Mistakes) {
        if self.left.is_none() {
            return;
        }
        if self.subject.side == Side::Left {
            let remedy = "with [left], the other tables are those of the right leg: give `side = \"right\"`, or take [left] out";
            wrong.note(self.bad_value("side", "left", remedy));
            return;
        }
        let left = self.leg(Side::Left);
        for (name, segment) in left.markers.all().filter(|(_, s)| *s != SegmentId::Pelvis) {
            if self.markers.all().any(|(other, _)| other == name) {
                let remedy = "the marker is on the right leg already: name the one of the left leg";
                wrong.note(
                    left.bad_value(segment.name(), format!("`{name}`"), remedy).of_leg(Side::Left.name()),
                );
            }
        }
    }
}
