//! Where the landmarks can come from: markers on them, a standing trial, the table of a known subject, or motion.

use std::path::{Path, PathBuf};

use super::sets::Found;
use super::subjects::Subject;
use super::{Recording, Wishes, below, list, quoted};
use crate::error::InputError;
use crate::keys::Filled;
use crate::natural::SegmentId;
use crate::read;
use crate::trial::Side;

/// Landmarks of every source but a table.
const BASE: [&str; 7] =
    ["right_asis", "left_asis", "right_psis", "left_psis", "heel", "metatarsal_1", "metatarsal_5"];
/// Landmarks of source = "markers".
const JOINTS: [&str; 4] =
    ["lateral_epicondyle", "medial_epicondyle", "lateral_malleolus", "medial_malleolus"];

/// `[landmarks]`.
pub(super) fn fill(
    wishes: &Wishes,
    recording: &Recording,
    found: &Found,
    side: Side,
    subject: Option<&Subject>,
    filled: &mut Filled,
    open: &mut Vec<String>,
    folders: &mut Vec<PathBuf>,
) -> Result<(), InputError> {
    let mut named = |path: &Path| {
        let (name, data) = below(path, &wishes.folder);
        if let Some(data) = data.filter(|d| !folders.contains(d)) {
            folders.push(data);
        }
        name
    };
    if let Some((rule, from)) = subject.and_then(|s| s.hip_centre) {
        filled.set("landmarks.hip_centre", rule);
        filled.note("landmarks.hip_centre", format!("From the midpoint of the ASISs, {from}."));
    }
    if let Some(table) = subject.and_then(|s| s.table).filter(|_| side == Side::Right) {
        filled.set("landmarks.source", "\"table\"");
        filled.set("landmarks.table", quoted(table));
        filled.note("landmarks.table", "Comes with the program.");
        for (row, name) in found.markers.iter().filter(|(row, _)| row.track) {
            if let Some(item) = &row.item {
                filled.set(&format!("landmarks.rename.{item}"), quoted(name));
            }
        }
        return Ok(());
    }
    let has = |found: &Found, keys: &[&str]| keys.iter().all(|k| found.landmark(k).is_some());
    let standing = match &wishes.standing {
        Some(path) => Some(Recording::read(path)?),
        None if has(found, &JOINTS) => None,
        None => beside(recording).into_iter().find(|other| other.set(side).is_some_and(|f| has(&f, &JOINTS))),
    };
    let stood = standing.as_ref().and_then(|s| s.set(side));
    if let Some(standing) = &standing {
        filled.set("landmarks.static", quoted(&named(&standing.path)));
        if standing.unit != recording.unit || standing.zeros != recording.zeros {
            filled.set("recording.0.file", quoted(&named(&standing.path)));
            filled.set("recording.0.zeros_missing", standing.zeros.to_string());
            if let Some(unit) = standing.unit {
                filled.set("recording.0.units", format!("\"{}\"", unit.name()));
            }
        }
    }
    let by_markers = standing.is_some() || has(found, &JOINTS);
    let with = stood.as_ref().unwrap_or(found);
    let mut keys = BASE.to_vec();
    if by_markers {
        filled.set("landmarks.source", "\"markers\"");
        keys.extend(JOINTS);
        keys.push("fibula_head");
    } else {
        filled.set("landmarks.source", "\"functional\"");
        filled.note("landmarks", "Epicondyles and malleoli have no markers: knee axis and ankle centre come from motion, a larger source of error than a");
        filled.note("landmarks", "standing trial with these markers (--static FILE).");
        let motions: Vec<String> = series(recording, found, side).iter().map(|p| named(p)).collect();
        filled.set("landmarks.motions", list(&motions));
        keys.push("patella");
    }
    for key in keys {
        match with.landmark(key) {
            Some(name) => filled.set(&format!("landmarks.{key}"), quoted(name)),
            None if ["patella", "fibula_head"].contains(&key) => {}
            None => {
                filled.note(
                    &format!("landmarks.{key}"),
                    format!("FILL IN: no marker was recognised as {}.", key.replace('_', " ")),
                );
                open.push(format!("landmarks.{key}"));
            }
        }
    }
    Ok(())
}

/// Recordings of the same kind in the same folder, by name.
fn others(recording: &Recording) -> Vec<PathBuf> {
    let folder = recording.path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    files.retain(|p| read::ending(p) == read::ending(&recording.path));
    files.sort();
    files
}

/// Standing trials beside the recording, by their names.
fn beside(recording: &Recording) -> Vec<Recording> {
    let stands = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        ["static", "stand", "cal"].iter().any(|word| name.contains(word))
    };
    others(recording).iter().filter(|p| stands(p)).filter_map(|p| Recording::read(p).ok()).collect()
}

/// The recording and those beside it whose names differ in the last number only and that show the same segments.
fn series(recording: &Recording, found: &Found, side: Side) -> Vec<PathBuf> {
    let start = |path: &Path| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        stem.trim_end_matches(|c: char| c.is_ascii_digit()).to_string()
    };
    let own = recording.path.file_name();
    let segments = [SegmentId::Pelvis, SegmentId::Thigh, SegmentId::Shank, SegmentId::Foot];
    let same = |other: &Found| segments.iter().all(|s| other.tracked(*s) == found.tracked(*s));
    let alike = |path: &PathBuf| {
        path.file_name() == own
            || (start(path) == start(&recording.path)
                && Recording::read(path).is_ok_and(|r| r.set(side).is_some_and(|f| same(&f))))
    };
    others(recording).into_iter().filter(alike).collect()
}
