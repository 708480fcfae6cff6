//! What the calibration gets: where each landmark is to be taken from, with the recordings it needs.

use std::collections::HashMap;
use std::ops::RangeInclusive;
use std::path::Path;

use super::load::{Recorded, mirror};
use super::{HipCentre, HipRule, LandmarkEntry, Source, TrialFile, doubts};
use crate::calibration::table::{self, TableError, TableItem};
use crate::error::{InputError, Place, nearest};
use crate::natural::SegmentId;
use crate::read::{decode, file_bytes};
use crate::trial::{MarkerTrack, Side};

/// Where a hip centre can be, from the midpoint of the ASISs in pelvis axes of a right leg \[m\]: behind and below it, on the
/// side of the leg. Regressions on pelvis widths of 0.15 to 0.35 m fall well inside.
const HIP_REGION: [RangeInclusive<f64>; 3] = [-0.15..=0.0, -0.2..=0.0, 0.03..=0.2];

/// Landmarks of a trial file, ready for calibration. Everything is a right leg; a left one has been mirrored.
#[derive(Clone, Debug, PartialEq)]
pub struct LandmarkSpec {
    /// Where the hip centre comes from.
    pub hip_centre: HipCentre,
    /// Where the others come from.
    pub source: Landmarks,
}

/// Sources of landmarks.
#[derive(Clone, Debug, PartialEq)]
pub enum Landmarks {
    /// Local coordinates.
    Table {
        /// Rows of the table.
        items: Vec<TableItem>,
        /// Item → recorded marker, for every marker of `[markers]`.
        recorded: HashMap<String, String>,
    },
    /// Landmark markers.
    Markers {
        /// Names of the landmark markers.
        roles: Roles,
        /// Their paths and those of `[markers]`, in the static trial or the trial itself, ground axes \[m\].
        tracks: Vec<MarkerTrack>,
    },
    /// Functional calibration of knee axis and ankle centre.
    Functional {
        /// Names of the landmark markers.
        roles: Roles,
        /// Paths of the landmark markers and of `[markers]` in this trial, ground axes \[m\].
        tracks: Vec<MarkerTrack>,
        /// The same markers in each of the calibration recordings.
        motions: Vec<Vec<MarkerTrack>>,
    },
}

/// Recorded names of the landmark markers. "Right" is the side of the leg under study: names of a left leg have changed sides.
#[derive(Clone, Debug, Default, PartialEq)]
#[allow(missing_docs)] // the names are the anatomy
pub struct Roles {
    pub right_asis: String,
    pub left_asis: String,
    pub right_psis: String,
    pub left_psis: String,
    pub heel: String,
    pub metatarsal_1: String,
    pub metatarsal_5: String,
    /// Always present with source `markers`; so are the next three.
    pub lateral_epicondyle: Option<String>,
    pub medial_epicondyle: Option<String>,
    pub lateral_malleolus: Option<String>,
    pub medial_malleolus: Option<String>,
    pub fibula_head: Option<String>,
    pub patella: Option<String>,
}

impl LandmarkEntry {
    /// Key, marker and segment of every landmark marker.
    fn markers(&self) -> [(&'static str, Option<&str>, SegmentId); 13] {
        use SegmentId::{Foot, Pelvis, Shank, Thigh};
        [
            ("right_asis", self.right_asis.as_deref(), Pelvis),
            ("left_asis", self.left_asis.as_deref(), Pelvis),
            ("right_psis", self.right_psis.as_deref(), Pelvis),
            ("left_psis", self.left_psis.as_deref(), Pelvis),
            ("heel", self.heel.as_deref(), Foot),
            ("metatarsal_1", self.metatarsal_1.as_deref(), Foot),
            ("metatarsal_5", self.metatarsal_5.as_deref(), Foot),
            ("lateral_epicondyle", self.lateral_epicondyle.as_deref(), Thigh),
            ("medial_epicondyle", self.medial_epicondyle.as_deref(), Thigh),
            ("lateral_malleolus", self.lateral_malleolus.as_deref(), Shank),
            ("medial_malleolus", self.medial_malleolus.as_deref(), Shank),
            ("fibula_head", self.fibula_head.as_deref(), Shank),
            ("patella", self.patella.as_deref(), SegmentId::Patella),
        ]
    }
}

impl TrialFile {
    /// Reads what the landmarks need. `data`: folder of the recordings, besides that of the trial file.
    pub fn landmarks(&self, data: Option<&Path>) -> Result<LandmarkSpec, InputError> {
        let entry = &self.landmarks;
        let source = match entry.source {
            Source::Table => {
                let (items, mut recorded) = self.landmark_table(data)?;
                if self.subject.side == Side::Left {
                    recorded =
                        recorded.into_iter().map(|(item, marker)| (other_side(&item), marker)).collect();
                }
                Landmarks::Table { items, recorded }
            }
            Source::Markers => {
                let recording = self.record(entry.static_trial.as_deref().unwrap_or(&self.motion), data)?;
                let mut wanted: Vec<_> =
                    self.markers.all().filter(|(name, _)| recording.markers.index(name).is_some()).collect();
                wanted.extend(
                    self.landmark_markers().filter(|(name, _)| self.markers.all().all(|(n, _)| n != *name)),
                );
                Landmarks::Markers { roles: self.roles(), tracks: self.mirrored_tracks(&recording, &wanted)? }
            }
            Source::Functional => {
                let mut wanted: Vec<_> = self.markers.all().collect();
                wanted.extend(
                    self.landmark_markers().filter(|(name, _)| self.markers.all().all(|(n, _)| n != *name)),
                );
                let load = |path: &Path| self.mirrored_tracks(&self.record(path, data)?, &wanted);
                Landmarks::Functional {
                    roles: self.roles(),
                    tracks: load(&self.motion)?,
                    motions: entry.motions.iter().map(|m| load(m)).collect::<Result<_, _>>()?,
                }
            }
        };
        Ok(LandmarkSpec { hip_centre: self.hip_centre(), source })
    }

    fn mirrored_tracks(
        &self,
        recorded: &Recorded,
        wanted: &[(&str, SegmentId)],
    ) -> Result<Vec<MarkerTrack>, InputError> {
        let mut tracks = self.tracks(recorded, wanted)?;
        if self.subject.side == Side::Left {
            mirror(&mut tracks);
        }
        Ok(tracks)
    }

    fn landmark_markers(&self) -> impl Iterator<Item = (&str, SegmentId)> {
        self.landmarks.markers().into_iter().filter_map(|(_, name, segment)| Some((name?, segment)))
    }

    /// Landmark markers that must be in the motion file itself.
    pub(super) fn landmark_markers_of_the_trial(&self) -> Vec<(&str, SegmentId)> {
        match (self.landmarks.source, &self.landmarks.static_trial) {
            (Source::Functional, _) | (Source::Markers, None) => self.landmark_markers().collect(),
            _ => Vec::new(),
        }
    }

    /// Recorded names of right ASIS, left ASIS, right PSIS, left PSIS, as far as the trial file tells.
    pub(super) fn pelvis_names(&self) -> [Option<&str>; 4] {
        let entry = &self.landmarks;
        match entry.source {
            Source::Table => ["right ASIS", "left ASIS", "right PSIS", "left PSIS"].map(|item| {
                let renamed = entry.rename.get(item).map(String::as_str);
                renamed.or_else(|| self.markers.all().map(|m| m.0).find(|name| *name == item))
            }),
            _ => [&entry.right_asis, &entry.left_asis, &entry.right_psis, &entry.left_psis]
                .map(Option::as_deref),
        }
    }

    /// Landmark names; "right" becomes the side under study.
    fn roles(&self) -> Roles {
        let e = &self.landmarks;
        let name = |n: &Option<String>| n.clone().unwrap_or_default(); // presence was checked when the file was read
        let mut roles = Roles {
            right_asis: name(&e.right_asis),
            left_asis: name(&e.left_asis),
            right_psis: name(&e.right_psis),
            left_psis: name(&e.left_psis),
            heel: name(&e.heel),
            metatarsal_1: name(&e.metatarsal_1),
            metatarsal_5: name(&e.metatarsal_5),
            lateral_epicondyle: e.lateral_epicondyle.clone(),
            medial_epicondyle: e.medial_epicondyle.clone(),
            lateral_malleolus: e.lateral_malleolus.clone(),
            medial_malleolus: e.medial_malleolus.clone(),
            fibula_head: e.fibula_head.clone(),
            patella: e.patella.clone(),
        };
        if self.subject.side == Side::Left {
            std::mem::swap(&mut roles.right_asis, &mut roles.left_asis);
            std::mem::swap(&mut roles.right_psis, &mut roles.left_psis);
        }
        roles
    }

    /// The table, and item → marker for every tracked marker.
    fn landmark_table(
        &self,
        data: Option<&Path>,
    ) -> Result<(Vec<TableItem>, HashMap<String, String>), InputError> {
        let path = self.find_table(self.landmarks.table.as_deref().unwrap_or(Path::new("")), data)?;
        let items = read_landmarks(&path)?;
        for (item, marker) in &self.landmarks.rename {
            let Some(row) = items.iter().find(|i| i.item == *item) else {
                return Err(InputError::UnknownName {
                    file: self.path.clone(),
                    line: self.line_of(item),
                    name: item.clone(),
                    within: path,
                    nearest: nearest(item, items.iter().map(|i| i.item.as_str())),
                });
            };
            match self.markers.all().find(|(name, _)| name == marker) {
                Some((_, segment)) if segment == row.segment => {}
                Some((_, segment)) => {
                    let remedy = format!(
                        "`[markers]` puts it on the {}, the table on the {}",
                        segment.name(),
                        row.segment.name()
                    );
                    return Err(self.bad_value(item, format!("`{marker}`"), &remedy));
                }
                None => {
                    return Err(self.bad_value(
                        item,
                        format!("`{marker}`"),
                        "`[markers]` does not list that marker",
                    ));
                }
            }
        }
        let mut recorded: HashMap<String, String> = HashMap::new();
        for (marker, segment) in self.markers.all() {
            let renamed =
                self.landmarks.rename.iter().find(|(_, m)| *m == marker).map(|(item, _)| item.as_str());
            let item = renamed.unwrap_or(marker);
            if !items.iter().any(|i| i.item == item && i.segment == segment) {
                let remedy = format!(
                    "the table has no item of that name on the {}; name its item in [landmarks.rename]",
                    segment.name()
                );
                return Err(self.bad_value(marker, "without a place", &remedy));
            }
            recorded.insert(item.to_string(), marker.to_string());
        }
        Ok((items, recorded))
    }

    /// Looks for exchanged names by comparing distances with the table or with the calibration recordings.
    pub(super) fn compare_with_other_sources(
        &self,
        recorded: &Recorded,
        tracks: &[MarkerTrack],
        data: Option<&Path>,
    ) -> Result<(), InputError> {
        match self.landmarks.source {
            Source::Table => {
                let (items, names) = self.landmark_table(data)?;
                let place = |marker: &str| {
                    let item = names.iter().find(|(_, m)| *m == marker)?.0;
                    items.iter().find(|i| i.item == *item).map(|i| i.position)
                };
                let reference = |a: &str, b: &str| Some((place(a)? - place(b)?).norm());
                doubts::compare_distances(recorded, tracks, "the table", reference)
            }
            Source::Markers => Ok(()),
            Source::Functional => {
                let wanted: Vec<_> = self.markers.all().collect();
                for motion in self.landmarks.motions.iter().filter(|m| **m != self.motion) {
                    let other = self.tracks(&self.record(motion, data)?, &wanted)?;
                    let find = |name: &str| other.iter().find(|t| t.name == name);
                    let reference = |a: &str, b: &str| doubts::distance(find(a)?, find(b)?).map(|d| d.0);
                    doubts::compare_distances(
                        recorded,
                        tracks,
                        &format!("`{}`", motion.display()),
                        reference,
                    )?;
                }
                Ok(())
            }
        }
    }

    /// Each source has its own keys: none missing, none of another source.
    pub(super) fn check_landmarks(&self) -> Result<(), InputError> {
        let entry = &self.landmarks;
        let markers = entry.markers();
        let given: Vec<&str> = markers.iter().filter(|m| m.1.is_some()).map(|m| m.0).collect();
        let need = |keys: &[&str]| match keys.iter().find(|k| !given.contains(k)) {
            Some(key) => Err(self.bad_value(
                "source",
                format!("without `{key}`"),
                "name that landmark marker in [landmarks]",
            )),
            None => Ok(()),
        };
        let unused = |key: &str, present: bool| {
            let remedy = "this source of landmarks does not use it; remove it";
            if present { Err(self.bad_value(key, "given", remedy)) } else { Ok(()) }
        };
        let base =
            ["right_asis", "left_asis", "right_psis", "left_psis", "heel", "metatarsal_1", "metatarsal_5"];
        match entry.source {
            Source::Table => {
                if entry.table.is_none() {
                    return Err(self.bad_value("source", "\"table\" without `table`", "name the table"));
                }
                unused(given.first().unwrap_or(&""), !given.is_empty())?;
                unused("static", entry.static_trial.is_some())?;
                unused("motions", !entry.motions.is_empty())?;
            }
            Source::Markers => {
                need(&base)?;
                need(&["lateral_epicondyle", "medial_epicondyle", "lateral_malleolus", "medial_malleolus"])?;
                unused("motions", !entry.motions.is_empty())?;
            }
            Source::Functional => {
                need(&base)?;
                if entry.motions.is_empty() {
                    return Err(self.bad_value(
                        "source",
                        "\"functional\" without `motions`",
                        "list the recordings for it",
                    ));
                }
                unused("static", entry.static_trial.is_some())?;
            }
        }
        if entry.source != Source::Table {
            unused("table", entry.table.is_some())?;
            unused("rename", !entry.rename.is_empty())?;
            if entry.hip_centre == Some(HipCentre::By(HipRule::Table)) {
                return Err(self.bad_value(
                    "hip_centre",
                    "\"table\"",
                    "there is no table; use \"harrington\" or three numbers",
                ));
            }
        }
        if let Some(HipCentre::At(p)) = entry.hip_centre
            && !HIP_REGION.iter().zip(&p).all(|(range, c)| range.contains(c))
        {
            let [x, y, z] = HIP_REGION.map(|r| format!("{} to {}", r.start(), r.end()));
            let remedy = format!(
                "give three numbers in m from the midpoint of the ASISs: forward ({x}), up ({y}), towards the leg ({z})"
            );
            return Err(self.bad_value("hip_centre", format!("{p:?}"), &remedy));
        }
        Ok(())
    }
}

/// Items of a mirrored pelvis change sides.
fn other_side(item: &str) -> String {
    if let Some(rest) = item.strip_prefix("right ") {
        format!("left {rest}")
    } else if let Some(rest) = item.strip_prefix("left ") {
        format!("right {rest}")
    } else {
        item.to_string()
    }
}

/// Reads a table of landmarks.
pub fn read_landmarks(path: &Path) -> Result<Vec<TableItem>, InputError> {
    let bytes = file_bytes(path)?;
    table::read(decode(path, &bytes)?).map_err(|e| {
        let (at, problem) = match e {
            TableError::Row { line, what } => (Place::Line(line as usize), what),
            other => (Place::Whole, other.to_string()),
        };
        InputError::Malformed {
            file: path.to_path_buf(),
            at,
            problem,
            remedy: "correct the table".to_string(),
        }
    })
}
