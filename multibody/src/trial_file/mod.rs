//! The trial file: which recordings make a trial, whose, which part, and where the landmarks come from (TOML).
//!
//! [`TrialFile::read`] finds mistakes of the file itself, [`TrialFile::load`] those of the recordings it names. Files are looked
//! for in the folder of the trial file and in the data folder, and must lie inside one of them.

mod axes;
mod doubts;
mod emg;
mod force;
mod guess;
mod keys;
mod landmarks;
mod left;
mod load;
mod names;
mod paths;
mod recorded;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

pub use axes::{Axes, SignedAxis};
pub use emg::EmgEntry;
pub use guess::{Guess, Wishes, guess};
pub use keys::KEYS;
pub use landmarks::{LandmarkSpec, Landmarks, Roles, read_landmarks};
pub use left::{LeftEntry, LeftForce, LeftLandmarks};

use crate::calibration::knee_centre::KneeCentre;
use crate::error::{InputError, Mistakes, Place};
use crate::keys::examine;
use crate::natural::SegmentId;
use crate::read::file_bytes;
use crate::trial::{Filters, Sex, Side, Subject};

/// A trial file as written.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialFile {
    /// Where it was read from.
    #[serde(skip)]
    pub path: PathBuf,
    /// Its text, to name lines in errors.
    #[serde(skip)]
    text: String,
    /// The markers: a C3D or TRC file.
    pub motion: PathBuf,
    /// Overrides the unit of length that the motion file claims.
    pub units: Option<LengthUnit>,
    /// Exact zeros in the motion file mean: not seen.
    #[serde(default)]
    pub zeros_missing: bool,
    /// Which axes of the recordings point forward, up and right.
    #[serde(default)]
    pub axes: Axes,
    /// Who was recorded.
    pub subject: SubjectEntry,
    /// Ground reaction.
    pub force: ForceEntry,
    /// Part of the trial that is reported.
    pub range: RangeEntry,
    /// Markers that carry the segments.
    pub markers: MarkerEntry,
    /// Joint centres and landmarks.
    pub landmarks: LandmarkEntry,
    /// Low-pass filters.
    #[serde(default)]
    pub filter: FilterEntry,
    /// Choices of the model.
    #[serde(default)]
    pub model: ModelEntry,
    /// What to do about gaps.
    #[serde(default)]
    pub gaps: GapEntry,
    /// Electromyography.
    pub emg: Option<EmgEntry>,
    /// Recordings that differ from `motion` in axes, units or gaps.
    #[serde(default)]
    pub recording: Vec<RecordingEntry>,
    /// The left leg, where the file describes both.
    pub left: Option<LeftEntry>,
    /// Which leg of a file of both this is: its lines are named in errors.
    #[serde(skip)]
    leg: Option<Side>,
}

/// `[[recording]]`: what is absent is as for `motion`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingEntry {
    /// As named in `static` or `motions`.
    pub file: PathBuf,
    /// Which of its axes point forward, up and right.
    pub axes: Option<Axes>,
    /// Overrides the unit of length that it claims.
    pub units: Option<LengthUnit>,
    /// Exact zeros in it mean: not seen.
    pub zeros_missing: Option<bool>,
}

/// Units of length.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LengthUnit {
    /// Metres.
    M,
    /// Centimetres.
    Cm,
    /// Millimetres.
    Mm,
}

/// `[subject]`
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SubjectEntry {
    /// Name or code.
    pub name: String,
    /// Body mass \[kg\].
    pub mass_kg: f64,
    /// Standing height \[m\].
    pub height_m: f64,
    /// Selects the segment tables.
    pub sex: Sex,
    /// Leg under study.
    pub side: Side,
}

/// `[force]`: C3D force plates, or columns of a table.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForceEntry {
    /// Table with the forces; without it the force plates of the C3D motion file.
    pub file: Option<PathBuf>,
    /// Axes of the table where they differ from those of the motion.
    pub axes: Option<Axes>,
    /// Numbers of the plates that the foot under study steps on.
    pub plates: Vec<usize>,
    /// Plate of the next step of the same foot.
    pub next_plate: Option<usize>,
    /// The recording holds the force of the foot on the plate instead of the plate on the foot.
    #[serde(default)]
    pub on_plate: bool,
    /// Columns of the table for each plate.
    #[serde(default)]
    pub columns: Vec<PlateColumns>,
}

/// `[[force.columns]]`: names of the three components each.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlateColumns {
    /// Number of the plate.
    pub plate: usize,
    /// Force on the foot \[N\].
    pub force: [String; 3],
    /// Point of application \[m\].
    pub point: [String; 3],
    /// Moment about that point \[N·m\]. Absent: taken as zero.
    pub moment: Option<[String; 3]>,
}

/// `[range]`: either `cycle`, or `start_s` and `end_s`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RangeEntry {
    /// The n-th cycle from heel strike to heel strike on the named plates, 1-based.
    pub cycle: Option<usize>,
    /// First time \[s\].
    pub start_s: Option<f64>,
    /// Last time \[s\].
    pub end_s: Option<f64>,
}

/// `[markers]`, and `[left.markers]` where those of the pelvis may be absent: recorded names per segment.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarkerEntry<Pelvis = Vec<String>> {
    /// Pelvis.
    pub pelvis: Pelvis,
    /// Thigh.
    pub thigh: Vec<String>,
    /// Shank.
    pub shank: Vec<String>,
    /// Foot.
    pub foot: Vec<String>,
}

impl MarkerEntry {
    /// All markers with their segment, in the order of the file.
    pub fn all(&self) -> impl Iterator<Item = (&str, SegmentId)> {
        let lists = [&self.pelvis, &self.thigh, &self.shank, &self.foot];
        let segments = [SegmentId::Pelvis, SegmentId::Thigh, SegmentId::Shank, SegmentId::Foot];
        lists
            .into_iter()
            .zip(segments)
            .flat_map(|(names, segment)| names.iter().map(move |n| (n.as_str(), segment)))
    }
}

/// Where the landmarks come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// A table of local coordinates.
    Table,
    /// Landmark markers in this or in a static trial.
    Markers,
    /// Functional calibration of knee axis and ankle centre; the other landmarks are markers.
    Functional,
}

/// Where the hip centre comes from.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(untagged, expecting = "expected `table`, `regression`, `harrington`, or three numbers in m")]
pub enum HipCentre {
    /// By name.
    By(HipRule),
    /// From the midpoint of the ASISs, in pelvis axes of a right leg \[m\].
    At([f64; 3]),
}

/// Rules for the hip centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HipRule {
    /// The joint centre of the table.
    Table,
    /// Fractions of the pelvis width (Dumas & Wojtusch 2018).
    Regression,
    /// Harrington et al., J Biomech 2007;40:595.
    Harrington,
}

/// Which knee centre a functional calibration takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum KneeRule {
    /// Where it is from the patella marker in subjects whose knee centre is known.
    #[default]
    Patella,
    /// On the axis of rotation as found.
    Functional,
}

/// `[landmarks]`. Names are those of recorded markers.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)] // the names are the anatomy
pub struct LandmarkEntry {
    /// Table, markers or functional.
    pub source: Source,
    /// Default: that of the table, else `harrington`.
    pub hip_centre: Option<HipCentre>,
    /// Knee centre of a functional calibration. Default: `patella`.
    pub knee_centre: Option<KneeRule>,
    /// From the knee centre to the patella marker along the forward axis of the thigh, as measured on the subject \[mm\].
    pub patella_distance_mm: Option<f64>,
    /// Table of local coordinates (`item, kind, segment, …`), found also in a folder `subjects` beside that of the trial file.
    pub table: Option<PathBuf>,
    /// Item of the table → recorded marker, where the names differ.
    #[serde(default)]
    pub rename: BTreeMap<String, String>,
    /// Standing trial with the landmark markers; absent: the trial itself.
    #[serde(rename = "static")]
    pub static_trial: Option<PathBuf>,
    /// Recordings for the functional calibration.
    #[serde(default)]
    pub motions: Vec<PathBuf>,
    pub right_asis: Option<String>,
    pub left_asis: Option<String>,
    pub right_psis: Option<String>,
    pub left_psis: Option<String>,
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

/// `[filter]`
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FilterEntry {
    /// Cut-off for velocities and accelerations \[Hz\].
    pub motion_hz: f64,
    /// Cut-off for force and moment \[Hz\].
    pub force_hz: f64,
    /// Vertical force that counts as contact \[N\].
    #[serde(rename = "contact_threshold_N")]
    pub contact_threshold: f64,
}

impl Default for FilterEntry {
    fn default() -> Self {
        Self { motion_hz: 5.0, force_hz: 20.0, contact_threshold: 20.0 }
    }
}

/// Joint between shank and foot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ankle {
    /// Two hinges.
    #[default]
    Universal,
    /// Contact and two isometric ligaments.
    Parallel,
}

/// What the knee is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Knee {
    /// A natural knee.
    #[default]
    Natural,
    /// A prosthesis.
    Implant,
}

/// `[model]`
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ModelEntry {
    /// Which ankle.
    pub ankle: Ankle,
    /// What the knee is.
    pub knee: Knee,
}

/// `[gaps]`
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GapEntry {
    /// Longest gap inside a marker path that is filled by a cubic through its neighbours; 0 fills none.
    pub fill_up_to_frames: usize,
}

impl TrialFile {
    /// Reads a trial file and checks it as far as it can be checked without the recordings.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        Self::parse(path, &file_bytes(path)?)
    }

    /// Reads a trial file that is in memory; `path` tells the folder and is named in errors.
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self, InputError> {
        let mut wrong = Mistakes::default();
        let file = Self::examine(path, bytes, &mut wrong);
        wrong.finish()?;
        file.ok_or_else(|| InputError::Malformed {
            file: path.to_path_buf(),
            at: Place::Whole,
            problem: "no trial file".into(),
            remedy: "see docs/keys.md".into(),
        })
    }

    /// Notes every mistake. What can be used in spite of them comes back, so that the recordings can be examined, too.
    pub fn examine(path: &Path, bytes: &[u8], wrong: &mut Mistakes) -> Option<Self> {
        let text = wrong.keep(crate::read::decode(path, bytes))?;
        let mut file: TrialFile = examine(path, text, KEYS, wrong)?.fill(path, text, wrong)?;
        file.path = path.to_path_buf();
        file.text = text.to_string();
        file.check_left(wrong);
        file.each_leg(wrong, TrialFile::check_values);
        Some(file)
    }

    /// Short name: that of the file without ending.
    pub fn name(&self) -> String {
        self.path.file_stem().map(|s| s.to_string_lossy().to_string()).unwrap_or_default()
    }

    /// Filters of the trial.
    pub fn filters(&self) -> Filters {
        Filters {
            motion_hz: self.filter.motion_hz,
            force_hz: Some(self.filter.force_hz),
            contact_threshold: self.filter.contact_threshold,
        }
    }

    /// Who was recorded.
    pub fn subject(&self) -> Subject {
        let SubjectEntry { name, mass_kg, height_m, sex, .. } = &self.subject;
        Subject { name: name.clone(), mass: *mass_kg, height: *height_m, sex: *sex }
    }

    /// Hip centre, with the default of the source.
    pub fn hip_centre(&self) -> HipCentre {
        let default = match self.landmarks.source {
            Source::Table => HipRule::Table,
            Source::Markers | Source::Functional => HipRule::Harrington,
        };
        self.landmarks.hip_centre.unwrap_or(HipCentre::By(default))
    }

    /// Knee centre of a functional calibration.
    pub fn knee_centre(&self) -> KneeCentre {
        match self.landmarks.knee_centre.unwrap_or_default() {
            KneeRule::Functional => KneeCentre::AsFound,
            KneeRule::Patella => {
                KneeCentre::ByPatella(self.landmarks.patella_distance_mm.map(|mm| 1e-3 * mm))
            }
        }
    }

    /// What more than one key must agree on; each by itself was examined with the table of keys.
    fn check_values(&self, wrong: &mut Mistakes) {
        let range = &self.range;
        match (range.cycle, range.start_s, range.end_s) {
            (Some(_), None, None) => {}
            (None, Some(a), Some(b)) if a.is_finite() && b.is_finite() && a < b => {}
            (None, Some(a), Some(_)) => {
                wrong.note(self.bad_value("start_s", a, "it must be less than `end_s`"));
            }
            _ => wrong.note(self.bad_value(
                "[range]",
                "incomplete or contradicts itself",
                "give `cycle`, or `start_s` and `end_s`",
            )),
        }
        let own = std::iter::once(("[axes]", &self.axes));
        let force = self.force.axes.iter().map(|a| ("[force.axes]", a));
        let others = self.recording.iter().filter_map(|r| Some(("[recording.axes]", r.axes.as_ref()?)));
        for (key, axes) in own.chain(force).chain(others) {
            let turn = axes.rotation().determinant();
            if turn != 1.0 {
                let remedy = if turn == 0.0 {
                    "each of x, y and z must be used once"
                } else {
                    "these axes mirror the recording; forward x, up y, right z must be a right-handed set"
                };
                wrong.note(self.bad_value(key, axes, remedy));
            }
        }
        wrong.keep(self.check_plates());
        self.check_recordings(wrong);
        self.check_markers(wrong);
        self.check_landmarks(wrong);
    }

    /// A foot steps on at least one plate.
    fn check_plates(&self) -> Result<(), InputError> {
        match self.force.plates.is_empty() {
            true => Err(self.bad_value("plates", "empty", "name the plates that the foot steps on")),
            false => Ok(()),
        }
    }

    /// `[[recording]]` says something of a recording that is used, once.
    fn check_recordings(&self, wrong: &mut Mistakes) {
        let named = || self.landmarks.static_trial.iter().chain(&self.landmarks.motions);
        for (k, entry) in self.recording.iter().enumerate() {
            let file = entry.file.display();
            if !named().any(|n| *n == entry.file) {
                let remedy =
                    "name a recording of `static` or `motions`; for `motion` the keys stand at the top";
                wrong.note(self.bad_value("[[recording]]", format!("of `{file}`"), remedy));
            }
            if self.recording[..k].iter().any(|r| r.file == entry.file) {
                wrong.note(self.bad_value("[[recording]]", format!("of `{file}` again"), "say it once"));
            }
        }
    }

    fn check_markers(&self, wrong: &mut Mistakes) {
        let mut seen: BTreeMap<&str, SegmentId> = BTreeMap::new();
        for (name, segment) in self.markers.all() {
            if let Some(first) = seen.insert(name, segment) {
                let remedy = format!("the marker is listed for the {} already; list it once", first.name());
                wrong.note(self.bad_value(segment.name(), format!("`{name}`"), &remedy));
            }
        }
        for segment in [SegmentId::Pelvis, SegmentId::Thigh, SegmentId::Shank, SegmentId::Foot] {
            let n = self.markers.all().filter(|(_, s)| *s == segment).count();
            if n < 3 {
                let remedy = "a segment needs three markers";
                wrong.note(self.bad_value(segment.name(), format!("{n} markers"), remedy));
            }
        }
    }

    fn bad_value(&self, key: &str, value: impl std::fmt::Display, remedy: &str) -> InputError {
        InputError::BadValue {
            file: self.path.clone(),
            line: self.line_of(key),
            key: key.to_string(),
            value: value.to_string(),
            remedy: remedy.to_string(),
        }
    }

    /// Line where a key is set, or where a name stands in quotes; 1 where it does not appear. Of a file of both legs, the line of this one.
    fn line_of(&self, word: &str) -> usize {
        let quoted = format!("\"{word}\"");
        // [force] of the left leg is [left.force].
        let of_left = word.replacen('[', "[left.", 1);
        let sets = |line: &str| {
            let word = if line.starts_with("[left.") { &of_left } else { word };
            line.strip_prefix(word)
                .is_some_and(|rest| word.starts_with('[') || rest.trim_start().starts_with('='))
        };
        let mut side = Side::Right;
        let mut found = Vec::new();
        for (line, text) in self.text.lines().map(str::trim_start).enumerate() {
            if text.starts_with('[') {
                side = if text.starts_with("[left") { Side::Left } else { Side::Right };
            }
            if sets(text) || text.contains(&quoted) {
                found.push((side, line + 1));
            }
        }
        let own = found.iter().find(|(side, _)| self.leg.is_none_or(|leg| leg == *side));
        own.or(found.first()).map_or(1, |(_, line)| *line)
    }
}
