//! A trial file for a recording, as far as the recording itself tells: marker roles by name sets, axes by how the subject walks, plates by whose
//! foot is on them.

mod axes;
mod columns;
mod forces;
mod landmarks;
mod sets;
mod subjects;

use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use super::{KEYS, names};
use crate::error::InputError;
use crate::keys::{Filled, template};
use crate::natural::SegmentId;
use crate::read::{self, MarkerRecording, c3d};
use crate::trial::{Sex, Side};
use sets::Found;
use subjects::Subject;

/// What the person who wants a trial file knows already.
#[derive(Clone, Debug, Default)]
pub struct Wishes {
    /// The recording, C3D or TRC.
    pub motion: PathBuf,
    /// Folder in which the trial file will lie.
    pub folder: PathBuf,
    /// Force table; else one is looked for beside a TRC file.
    pub force: Option<PathBuf>,
    /// Standing trial with the landmark markers; else one is looked for beside the recording.
    pub standing: Option<PathBuf>,
    /// Leg under study; else the one with a whole cycle on the plates, and of both the right one.
    pub side: Option<Side>,
    /// Name or code of the subject.
    pub name: Option<String>,
    /// Body mass \[kg\].
    pub mass_kg: Option<f64>,
    /// Standing height \[m\].
    pub height_m: Option<f64>,
    /// Sex.
    pub sex: Option<Sex>,
}

/// A trial file as text.
#[derive(Clone, Debug)]
pub struct Guess {
    /// The file.
    pub text: String,
    /// What is to be filled in by hand before it runs.
    pub open: Vec<String>,
    /// Folder for `--data`, where the recordings do not lie below the folder of the trial file.
    pub data: Option<PathBuf>,
}

/// A recording with what was seen in it.
struct Recording {
    path: PathBuf,
    markers: MarkerRecording,
    c3d: Option<c3d::C3d>,
    /// Names seen in some frame.
    seen: Vec<String>,
    zeros: bool,
    unit: Option<super::LengthUnit>,
}

impl Recording {
    fn read(path: &Path) -> Result<Recording, InputError> {
        let (mut markers, c3d) = match read::ending(path).as_str() {
            "c3d" => {
                let mut c3d = c3d::read(path)?;
                (std::mem::take(&mut c3d.markers), Some(c3d))
            }
            _ => (read::read_markers(path)?, None),
        };
        let zeros = markers.position.iter().flatten().any(|p| *p == Some(Vector3::zeros()));
        markers.zeros_to_gaps();
        let prefix = |name: &String| name.len() - names::bare(name).len();
        let shared = markers.names.first().map_or("", |n| &n[..prefix(n)]).to_string();
        if !shared.is_empty() && markers.names.iter().all(|n| n.starts_with(&shared)) {
            markers.names.iter_mut().for_each(|n| *n = n[shared.len()..].to_string());
        }
        let named = markers.names.iter().zip(&markers.position);
        let seen = named.filter(|(_, p)| p.iter().any(Option::is_some)).map(|(n, _)| n.clone()).collect();
        let unit = axes::unit(&markers);
        if let Some(unit) = unit {
            let factor = unit.metres() / read::metres_per(&markers.file_unit).unwrap_or(1.0);
            markers.position.iter_mut().flatten().flatten().for_each(|p| *p *= factor);
        }
        Ok(Recording { path: path.to_path_buf(), markers, c3d, seen, zeros, unit })
    }

    fn set(&self, side: Side) -> Option<Found> {
        sets::recognise(&self.seen.iter().map(String::as_str).collect::<Vec<_>>(), side)
    }

    /// Name of the subject in a C3D file.
    fn subject(&self) -> Option<String> {
        let names = self.c3d.as_ref()?.parameters.get("SUBJECTS", "NAMES")?;
        let read::Values::Text(names) = &names.values else { return None };
        names.first().filter(|n| !n.is_empty()).cloned()
    }

    fn stem(&self) -> String {
        self.path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
    }
}

/// How a path is written in the trial file, and the folder for `--data` where it does not lie below that of the trial file.
fn below(path: &Path, folder: &Path) -> (String, Option<PathBuf>) {
    let real = |p: &Path| p.canonicalize().unwrap_or(p.to_path_buf());
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let file = path.file_name().unwrap_or_default();
    match real(parent).strip_prefix(real(folder)) {
        Ok(inside) => (inside.join(file).display().to_string().replace('\\', "/"), None),
        Err(_) => (file.to_string_lossy().into_owned(), Some(parent.to_path_buf())),
    }
}

/// Text as TOML.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_string()).to_string()
}

fn list(names: &[impl AsRef<str>]) -> String {
    format!("[{}]", names.iter().map(|n| quoted(n.as_ref())).collect::<Vec<_>>().join(", "))
}

/// Writes a trial file for a recording.
pub fn guess(wishes: &Wishes) -> Result<Guess, InputError> {
    let recording = Recording::read(&wishes.motion)?;
    let mut filled = Filled::default();
    let mut open = Vec::new();
    let (motion, data) = below(&recording.path, &wishes.folder);
    filled.set("motion", quoted(&motion));
    if let Some(unit) = recording.unit {
        filled.set("units", format!("\"{}\"", unit.name()));
        filled.note(
            "units",
            format!(
                "The recording claims {}, but its numbers have the size of {}.",
                recording.markers.file_unit,
                unit.name()
            ),
        );
    }
    if recording.zeros {
        filled.set("zeros_missing", "true");
    }

    let sides = wishes.side.map_or(vec![Side::Right, Side::Left], |s| vec![s]);
    let legs: Vec<(Side, Found)> = sides.into_iter().filter_map(|s| Some((s, recording.set(s)?))).collect();
    let complete = |found: &Found| {
        [SegmentId::Thigh, SegmentId::Shank, SegmentId::Foot]
            .iter()
            .filter(|s| found.tracked(**s).len() >= 3)
            .count()
    };
    let most = legs.iter().map(|(_, f)| complete(f)).max().unwrap_or(0);
    let fullest = legs.iter().rev().max_by_key(|(_, found)| complete(found));
    let turned = fullest.and_then(|(_, found)| orientation(&recording, found));
    let table = forces::table(wishes, &recording)?;
    let steps: Vec<forces::Steps> = legs
        .iter()
        .map(|(side, found)| {
            forces::steps(&recording, *side, found, turned.as_ref().map(|t| t.0), table.as_ref())
        })
        .collect();
    // The more complete set of markers, then the more heel strikes on plates, then the right leg.
    let best = (0..legs.len())
        .filter(|&k| complete(&legs[k].1) == most)
        .rev()
        .max_by_key(|&k| steps[k].strikes().min(2));
    let leg = best.map(|k| (&legs[k], &steps[k]));

    match &turned {
        Some((axes, why)) => {
            for (key, axis) in [("x", axes.x), ("y", axes.y), ("z", axes.z)] {
                filled.set(&format!("axes.{key}"), format!("\"{axis}\""));
            }
            filled.note("axes", format!("Forward: {why}."));
        }
        None => {
            filled.note(
                "axes",
                "FILL IN: pelvis and foot were not recognised, so the axes could not be guessed.",
            );
            open.push("axes".to_string());
        }
    }
    let side = leg.map_or(wishes.side.unwrap_or(Side::Right), |((side, _), _)| *side);
    let set = leg.map(|((_, found), _)| found.set);
    let subject = subjects::known(recording.subject().as_deref(), &recording.stem(), set);
    fill_subject(wishes, &recording, subject, side, &mut filled);
    filled.set("subject.side", format!("\"{}\"", side.name()));
    if let Some((_, steps)) = leg {
        steps.fill(table.as_ref().map(|t| below(&t.path, &wishes.folder).0), &mut filled, &mut open);
    } else {
        filled.note("markers", "FILL IN: no marker set was recognised by its names.");
    }
    for segment in [SegmentId::Pelvis, SegmentId::Thigh, SegmentId::Shank, SegmentId::Foot] {
        let key = format!("markers.{}", segment.name());
        let tracked = leg.map(|((_, found), _)| found.tracked(segment)).unwrap_or_default();
        if tracked.len() < 3 {
            let found = if tracked.is_empty() {
                "none was".to_string()
            } else {
                format!("only {} were", tracked.join(", "))
            };
            filled.note(
                &key,
                format!("FILL IN: the {} needs three markers, {found} recognised.", segment.name()),
            );
            open.push(key.clone());
        }
        filled.set(&key, list(&tracked));
    }
    let mut folders: Vec<PathBuf> = data.into_iter().collect();
    if let Some(((_, found), _)) = leg {
        landmarks::fill(wishes, &recording, found, side, subject, &mut filled, &mut open, &mut folders)?;
    }
    if let (Side::Right, Some(k)) = (side, legs.iter().position(|(s, _)| *s == Side::Left)) {
        offer_left(&legs[k].1, &steps[k], &mut filled);
    }
    heading(&recording, leg.map(|((_, found), steps)| (found, steps)), &folders, &mut filled);
    let text = template(KEYS, &filled);
    let required = |line: &str| Some(line.strip_prefix("# FILL IN: ")?.split_once(" = ")?.0.to_string());
    open.extend(text.lines().filter_map(required));
    open.sort();
    open.dedup();
    Ok(Guess { text, open, data: folders.into_iter().next() })
}

/// Axes from the markers of the pelvis and of the foot.
fn orientation(recording: &Recording, found: &Found) -> Option<(super::Axes, String)> {
    let centre = |segment| axes::centre(&recording.markers, &found.tracked(segment));
    let of = |key: &str| found.landmark(key).map(|n| axes::centre(&recording.markers, &[n]));
    let mean = |path: Vec<Option<Vector3<f64>>>| {
        let n = path.iter().flatten().count();
        (n > 0).then(|| path.iter().flatten().sum::<Vector3<f64>>() / n as f64)
    };
    let front = of("right_asis").and_then(mean).zip(of("left_asis").and_then(mean));
    let back = of("right_psis").and_then(mean).zip(of("left_psis").and_then(mean));
    let back_to_front = front.zip(back).map(|((a, b), (c, d))| 0.5 * (a + b - c - d));
    axes::axes(&centre(SegmentId::Pelvis), &centre(SegmentId::Foot), back_to_front)
}

fn fill_subject(
    wishes: &Wishes,
    recording: &Recording,
    subject: Option<&Subject>,
    side: Side,
    filled: &mut Filled,
) {
    let name = wishes.name.clone().or(subject.map(|s| s.name.to_string())).or(recording.subject());
    filled.set("subject.name", quoted(&name.unwrap_or(recording.stem())));
    let given = |v: Option<f64>| v.map(|v| format!("{v:?}"));
    let sex = wishes.sex.map(|s| if s == Sex::Male { "\"male\"" } else { "\"female\"" }.to_string());
    for (key, wish, known) in [
        ("mass_kg", given(wishes.mass_kg), subject.map(|s| s.mass_kg)),
        ("height_m", given(wishes.height_m), subject.map(|s| s.height_m)),
        ("sex", sex, subject.map(|s| s.sex)),
    ] {
        if let Some(value) = wish.or(known.map(str::to_string)) {
            filled.set(&format!("subject.{key}"), value);
        }
    }
    if subject.is_some() {
        filled.note("subject", "A subject of the Grand Challenge Competitions to Predict In Vivo Knee Loads (Fregly et al., J Orthop Res 2012;30:503-513).");
    }
    let other = if side == Side::Right { Side::Left } else { Side::Right };
    if wishes.side.is_none() && recording.set(other).is_some_and(|f| f.tracked(SegmentId::Thigh).len() >= 3) {
        filled.note(
            "subject.side",
            format!("Both legs have markers; for the other one: --side {}.", other.name()),
        );
    }
}

/// `[left]` beside a right leg, commented out, where the markers of that leg are complete and its landmarks are markers.
fn offer_left(found: &Found, steps: &forces::Steps, filled: &mut Filled) {
    let segments = [SegmentId::Thigh, SegmentId::Shank, SegmentId::Foot];
    // A table of a known subject is of the right leg.
    let has_table = filled.values.contains_key("landmarks.table");
    if has_table || segments.iter().any(|s| found.tracked(*s).len() < 3) {
        return;
    }
    let mut left = Filled::default();
    steps.fill(None, &mut left, &mut Vec::new());
    left.values.retain(|path, _| {
        path.starts_with("range.") || path.ends_with("plates") || path.ends_with("next_plate")
    });
    for segment in segments {
        left.set(&format!("markers.{}", segment.name()), list(&found.tracked(segment)));
    }
    // The landmarks that the right leg has.
    for path in filled.values.keys() {
        if let Some(name) = path.strip_prefix("landmarks.").and_then(|key| found.landmark(key)) {
            left.set(path, quoted(name));
        }
    }
    let offers = left.values.into_iter().map(|(path, value)| (format!("left.{path}"), value));
    filled.offers.extend(offers);
    filled.note("left", "The left leg has its markers, too. For both legs take the # from [left.markers], [left.force], [left.landmarks] and from");
    filled.note("left", "the lines in them that hold names of this recording.");
}

/// What the recording holds, at the top of the file.
fn heading(
    recording: &Recording,
    leg: Option<(&Found, &forces::Steps)>,
    folders: &[PathBuf],
    filled: &mut Filled,
) {
    let file = recording.path.file_name().unwrap_or_default().to_string_lossy();
    let m = &recording.markers;
    let mut text = vec![
        format!("Trial file for {file}, written by `sartorius template trial`."),
        "A line with FILL IN needs a value; every other line holds what was found, or the default of its key.".to_string(),
    ];
    let data = folders.first().map_or(String::new(), |f| format!(" --data {}", f.display()));
    text.push(format!("Is it good: sartorius check THIS_FILE{data}"));
    if folders.len() > 1 {
        let rest: Vec<String> = folders[1..].iter().map(|f| f.display().to_string()).collect();
        text.push(format!(
            "FILL IN: one folder takes all recordings; copy those of {} there.",
            rest.join(", ")
        ));
    }
    text.push(String::new());
    text.push(format!(
        "{} frames at {} Hz, {:.4} to {:.4} s. {} markers, {} of them seen.",
        m.time.len(),
        (m.rate_hz * 100.0).round() / 100.0,
        m.time.first().unwrap_or(&0.0),
        m.time.last().unwrap_or(&0.0),
        m.names.len(),
        recording.seen.len()
    ));
    let used: Vec<&str> =
        leg.iter().flat_map(|(found, _)| found.markers.iter().map(|(_, n)| n.as_str())).collect();
    if let Some((found, _)) = leg {
        text.push(format!("Names of the set {}.", found.set));
    }
    let unused: Vec<&str> = recording.seen.iter().map(String::as_str).filter(|n| !used.contains(n)).collect();
    wrapped(&mut text, "Markers without a role here: ", &unused);
    if let Some((_, steps)) = leg {
        text.extend(steps.summary.iter().cloned());
    }
    if let Some(c3d) = &recording.c3d {
        let plates: Vec<usize> = c3d.plates.iter().flat_map(|p| p.channels.iter().copied()).collect();
        let others = c3d.analog.names.iter().enumerate().filter(|(k, _)| !plates.contains(k));
        wrapped(
            &mut text,
            "Analog channels that are not used: ",
            &others.map(|(_, n)| n.as_str()).collect::<Vec<_>>(),
        );
    }
    text.push(String::new());
    filled.heading = text;
}

/// A list in lines of no more than about 140 characters.
fn wrapped(text: &mut Vec<String>, start: &str, names: &[&str]) {
    if names.is_empty() {
        return;
    }
    let mut line = start.to_string();
    for (k, name) in names.iter().enumerate() {
        if line.len() + name.len() > 140 {
            text.push(std::mem::replace(&mut line, "  ".to_string()).trim_end().to_string());
        }
        line += name;
        line += if k + 1 < names.len() { ", " } else { "." };
    }
    text.push(line);
}
