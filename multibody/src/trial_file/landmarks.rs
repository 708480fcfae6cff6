//! What the calibration gets: where each landmark is to be taken from, with the recordings it needs.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::ops::RangeInclusive;
use std::path::Path;

use super::load::mirror;
use super::recorded::Recorded;
use super::{HipCentre, HipRule, KneeRule, LandmarkEntry, Source, TrialFile, doubts};
use crate::calibration::knee_centre::KneeCentre;
use crate::calibration::table::{self, TableError, TableItem};
use crate::error::{InputError, Mistakes, Place, nearest};
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
    /// Which knee centre a functional calibration takes.
    pub knee_centre: KneeCentre,
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
                    self.markers.all().filter(|(name, _)| recording.find(name).is_some()).collect();
                wanted.extend(
                    self.landmark_markers().filter(|(name, _)| self.markers.all().all(|(n, _)| n != *name)),
                );
                if entry.static_trial.is_some() {
                    let mut wrong = Mistakes::default();
                    let tracks = self.tracks(&recording, &wanted, &mut wrong);
                    doubts::examine_standing(self, &recording, &tracks, &mut wrong);
                    wrong.finish()?;
                }
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
        Ok(LandmarkSpec { hip_centre: self.hip_centre(), knee_centre: self.knee_centre(), source })
    }

    fn mirrored_tracks(
        &self,
        recorded: &Recorded,
        wanted: &[(&str, SegmentId)],
    ) -> Result<Vec<MarkerTrack>, InputError> {
        let mut wrong = Mistakes::default();
        let mut tracks = self.tracks(recorded, wanted, &mut wrong);
        wrong.finish()?;
        if self.subject.side == Side::Left {
            mirror(&mut tracks);
        }
        Ok(tracks)
    }

    /// Every landmark marker once: one on the sacrum may stand for both posterior spines.
    fn landmark_markers(&self) -> impl Iterator<Item = (&str, SegmentId)> {
        let mut seen = HashSet::new();
        let named = |(_, name, segment)| Some((name?, segment));
        self.landmarks.markers().into_iter().filter_map(named).filter(move |m: &(&str, _)| seen.insert(m.0))
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

    /// Recorded names of landmarks that lie beside each other: the outer and the inner one.
    pub(super) fn outer_and_inner(&self) -> [(Option<&str>, Option<&str>); 3] {
        let e = &self.landmarks;
        let item = |item: &str| e.rename.get(item).map(String::as_str);
        [
            (e.lateral_epicondyle.as_deref(), e.medial_epicondyle.as_deref()),
            (e.lateral_malleolus.as_deref(), e.medial_malleolus.as_deref()),
            (
                e.metatarsal_5.as_deref().or(item("metatarsal head 5")),
                e.metatarsal_1.as_deref().or(item("metatarsal head 1")),
            ),
        ]
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
    pub(super) fn landmark_table(
        &self,
        data: Option<&Path>,
    ) -> Result<(Vec<TableItem>, HashMap<String, String>), InputError> {
        let path = self.find_table(self.landmarks.table.as_deref().unwrap_or(Path::new("")), data)?;
        let items = read_landmarks(&path)?;
        let mut wrong = Mistakes::default();
        for (item, marker) in &self.landmarks.rename {
            let Some(row) = items.iter().find(|i| i.item == *item) else {
                wrong.note(InputError::UnknownName {
                    file: self.path.clone(),
                    line: self.line_of(item),
                    name: item.clone(),
                    within: path.clone(),
                    nearest: nearest(item, items.iter().map(|i| i.item.as_str())),
                });
                continue;
            };
            match self.markers.all().find(|(name, _)| name == marker) {
                Some((_, segment)) if segment == row.segment => {}
                Some((_, segment)) => {
                    let remedy = format!(
                        "`[markers]` puts it on the {}, the table on the {}",
                        segment.name(),
                        row.segment.name()
                    );
                    wrong.note(self.bad_value(item, format!("`{marker}`"), &remedy));
                }
                None => {
                    let remedy = "`[markers]` does not list that marker";
                    wrong.note(self.bad_value(item, format!("`{marker}`"), remedy));
                }
            }
        }
        let mut recorded: HashMap<String, String> = HashMap::new();
        for (marker, segment) in self.markers.all() {
            let renamed =
                self.landmarks.rename.iter().find(|(_, m)| *m == marker).map(|(item, _)| item.as_str());
            let item = renamed.unwrap_or(marker);
            let known = |item: &str| items.iter().any(|i| i.item == item && i.segment == segment);
            // An item that the table does not have was named above.
            if !known(item)
                && renamed.is_none_or(|r| items.iter().any(|i| i.item == r && i.segment == segment))
            {
                let remedy = format!(
                    "the table has no item of that name on the {}; name its item in [landmarks.rename]",
                    segment.name()
                );
                wrong.note(self.bad_value(marker, "without a place", &remedy));
            }
            recorded.insert(item.to_string(), marker.to_string());
        }
        wrong.finish()?;
        Ok((items, recorded))
    }

    /// Looks for exchanged names by comparing distances with the table or with the calibration recordings.
    pub(super) fn compare_with_other_sources(
        &self,
        recorded: &Recorded,
        tracks: &[MarkerTrack],
        data: Option<&Path>,
        wrong: &mut Mistakes,
    ) {
        match self.landmarks.source {
            Source::Table => {
                let Some((items, names)) = wrong.keep(self.landmark_table(data)) else { return };
                let place = |marker: &str| {
                    let item = names.iter().find(|(_, m)| *m == marker)?.0;
                    items.iter().find(|i| i.item == *item).map(|i| i.position)
                };
                let reference = |a: &str, b: &str| Some((place(a)? - place(b)?).norm());
                doubts::compare_distances(recorded, tracks, "the table", reference, wrong);
            }
            Source::Markers => {}
            Source::Functional => {
                let wanted: Vec<_> = self.markers.all().collect();
                for motion in self.landmarks.motions.iter().filter(|m| **m != self.motion) {
                    let Some(other) = wrong.keep(self.record(motion, data)) else { continue };
                    let other = self.tracks(&other, &wanted, wrong);
                    let find = |name: &str| other.iter().find(|t| t.name == name);
                    let reference = |a: &str, b: &str| doubts::distance(find(a)?, find(b)?).map(|d| d.0);
                    let source = format!("`{}`", motion.display());
                    doubts::compare_distances(recorded, tracks, &source, reference, wrong);
                }
            }
        }
    }

    /// Each source has its own keys: none missing, none of another source. No marker stands for two landmarks.
    pub(super) fn check_landmarks(&self, wrong: &mut Mistakes) {
        let entry = &self.landmarks;
        let markers = entry.markers();
        let given: Vec<&str> = markers.iter().filter(|m| m.1.is_some()).map(|m| m.0).collect();
        let need = |keys: &[&str], wrong: &mut Mistakes| {
            for key in keys.iter().filter(|k| !given.contains(k)) {
                let remedy = "name that landmark marker in [landmarks]";
                wrong.note(self.bad_value("source", format!("without `{key}`"), remedy));
            }
        };
        let unused = |key: &str, present: bool, wrong: &mut Mistakes| {
            if present {
                let remedy = "this source of landmarks does not use it; remove it";
                wrong.note(self.bad_value(key, "given", remedy));
            }
        };
        let base =
            ["right_asis", "left_asis", "right_psis", "left_psis", "heel", "metatarsal_1", "metatarsal_5"];
        match entry.source {
            Source::Table => {
                if entry.table.is_none() {
                    wrong.note(self.bad_value("source", "\"table\" without `table`", "name the table"));
                }
                given.iter().for_each(|key| unused(key, true, wrong));
                unused("static", entry.static_trial.is_some(), wrong);
                unused("motions", !entry.motions.is_empty(), wrong);
            }
            Source::Markers => {
                need(&base, wrong);
                let of_markers =
                    ["lateral_epicondyle", "medial_epicondyle", "lateral_malleolus", "medial_malleolus"];
                need(&of_markers, wrong);
                unused("motions", !entry.motions.is_empty(), wrong);
            }
            Source::Functional => {
                need(&base, wrong);
                if entry.motions.is_empty() {
                    let value = "\"functional\" without `motions`";
                    wrong.note(self.bad_value("source", value, "list the recordings for it"));
                }
                unused("static", entry.static_trial.is_some(), wrong);
            }
        }
        if entry.source != Source::Functional {
            unused("knee_centre", entry.knee_centre.is_some(), wrong);
            unused("patella_distance_mm", entry.patella_distance_mm.is_some(), wrong);
        } else if entry.patella_distance_mm.is_some() {
            if entry.knee_centre == Some(KneeRule::Functional) {
                let remedy = "`knee_centre = \"functional\"` does not use it; remove one of them";
                wrong.note(self.bad_value("patella_distance_mm", "given", remedy));
            }
            if entry.patella.is_none() {
                let remedy = "it counts from the marker on the patella; name it in [landmarks]";
                wrong.note(self.bad_value("patella_distance_mm", "without `patella`", remedy));
            }
        }
        if entry.source == Source::Functional
            && entry.knee_centre == Some(KneeRule::Patella)
            && entry.patella.is_none()
        {
            let remedy = "name the marker on the patella in [landmarks], or take `functional`";
            wrong.note(self.bad_value("knee_centre", "\"patella\" without `patella`", remedy));
        }
        if entry.source != Source::Table {
            unused("table", entry.table.is_some(), wrong);
            unused("rename", !entry.rename.is_empty(), wrong);
            if entry.hip_centre == Some(HipCentre::By(HipRule::Table)) {
                let remedy = "there is no table; use \"harrington\" or three numbers";
                wrong.note(self.bad_value("hip_centre", "\"table\"", remedy));
            }
        }
        if let Some(HipCentre::At(p)) = entry.hip_centre
            && !HIP_REGION.iter().zip(&p).all(|(range, c)| range.contains(c))
        {
            let [x, y, z] = HIP_REGION.map(|r| format!("{} to {}", r.start(), r.end()));
            let remedy = format!(
                "give three numbers in m from the midpoint of the ASISs: forward ({x}), up ({y}), towards the leg ({z})"
            );
            wrong.note(self.bad_value("hip_centre", format!("{p:?}"), &remedy));
        }
        self.check_roles(wrong);
    }

    /// One marker cannot stand for two landmarks, nor be a landmark of one segment and move with another.
    fn check_roles(&self, wrong: &mut Mistakes) {
        let markers = self.landmarks.markers();
        let named = |k: usize| Some((markers[k].0, markers[k].1?, markers[k].2));
        for (key, name, segment) in (0..markers.len()).filter_map(named) {
            let first = (0..markers.len()).filter_map(named).find(|m| m.1 == name).map_or(key, |m| m.0);
            // A marker on the sacrum stands for both posterior spines: only their midpoint is used.
            let sacrum = [first, key].iter().all(|k| k.ends_with("_psis"));
            if first != key && !sacrum {
                let remedy =
                    format!("that marker stands for `{first}` already; one of the two is another marker");
                wrong.note(self.bad_value(key, format!("`{name}`"), &remedy));
            }
            // The patella has no segment of its own in [markers]; its marker does no harm on thigh or shank.
            let elsewhere = |m: &(&str, SegmentId)| m.0 == name && m.1 != segment && key != "patella";
            if let Some((_, other)) = self.markers.all().find(elsewhere) {
                let remedy = format!(
                    "this landmark is on the {}, but [markers] lists the marker for the {}; correct one of the two",
                    segment.name(),
                    other.name()
                );
                wrong.note(self.bad_value(key, format!("`{name}`"), &remedy));
            }
        }
        let mut items: BTreeMap<&str, &str> = BTreeMap::new();
        for (item, marker) in &self.landmarks.rename {
            if let Some(first) = items.insert(marker, item) {
                let remedy =
                    format!("that marker stands for `{first}` already; one of the two is another marker");
                wrong.note(self.bad_value(item, format!("`{marker}`"), &remedy));
            }
        }
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
