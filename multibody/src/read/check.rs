//! What a file is and whether it is good, in one paragraph.

use std::path::Path;

use super::{
    MarkerRecording, TimeSeries, c3d, decode, ending, file_bytes, is_knee_forces, read_knee_forces,
    read_series, read_trc,
};
use crate::error::{InputError, Mistakes};
use crate::natural::SegmentId;
use crate::trial::Trial;
use crate::trial_file::{LandmarkSpec, Landmarks, TrialFile, read_landmarks};

/// Reads a file of any kind that the program takes and says what it holds.
///
/// A trial file is read with everything it refers to; `data` is the folder of the recordings.
pub fn check(path: &Path, data: Option<&Path>) -> Result<String, InputError> {
    match ending(path).as_str() {
        "c3d" => {
            let file = c3d::read(path)?;
            let mut text = format!("C3D file. {}", markers(&file.markers));
            if !file.analog.names.is_empty() {
                text += &format!(
                    " {} analog channels at {} Hz ({}).",
                    file.analog.names.len(),
                    file.analog.rate_hz,
                    file.analog.names.join(", ")
                );
            }
            for plate in &file.plates {
                let c = plate.centre();
                text += &format!(
                    " Force plate {} (type {}) at ({:.3}, {:.3}, {:.3}) m",
                    plate.number, plate.kind, c.x, c.y, c.z
                );
                match plate.loads(path, &file.analog) {
                    Ok(loads) => {
                        let peak = loads.iter().map(|l| -l.force.z).fold(0.0, f64::max);
                        text += &format!(", up to {peak:.0} N upwards.");
                    }
                    Err(error) => text += &format!(", not usable: {error}."),
                }
            }
            for note in &file.notes {
                text += &format!(" Note: {note}.");
            }
            Ok(text)
        }
        "trc" => Ok(format!("TRC file. {}", markers(&read_trc(path)?))),
        "sto" | "mot" => Ok(format!("Storage file. {}", series(&read_series(path)?))),
        "toml" => trial(path, data),
        "csv" => table(path),
        _ => Err(InputError::UnknownKind {
            file: path.to_path_buf(),
            wanted: ".c3d, .trc, .sto, .mot, .csv, .toml",
        }),
    }
}

/// A CSV file is told by its first column.
fn table(path: &Path) -> Result<String, InputError> {
    let bytes = file_bytes(path)?;
    let text = decode(path, &bytes)?;
    if is_knee_forces(text) {
        let forces = read_knee_forces(path)?;
        let peak = |v: &[f64]| v.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        return Ok(format!(
            "Measured knee forces. {} rows, {:.4} to {:.4} s, up to {:.0} N medial and {:.0} N lateral.",
            forces.time.len(),
            forces.time[0],
            forces.time[forces.time.len() - 1],
            peak(&forces.medial),
            peak(&forces.lateral)
        ));
    }
    if text.starts_with("item,") {
        let items = read_landmarks(path)?;
        let count =
            |s: SegmentId| format!("{} {}", s.name(), items.iter().filter(|i| i.segment == s).count());
        let counts: Vec<String> = SegmentId::ALL.map(count).into();
        return Ok(format!("Table of landmarks. Items per segment: {}.", counts.join(", ")));
    }
    Ok(format!("Table. {}", series(&read_series(path)?)))
}

fn trial(path: &Path, data: Option<&Path>) -> Result<String, InputError> {
    let mut wrong = Mistakes::default();
    let file = TrialFile::examine(path, &file_bytes(path)?, &mut wrong);
    // Mistakes of the file do not hide those of the recordings.
    let load = |leg: &TrialFile, wrong: &mut Mistakes| {
        let (trial, landmarks) = (wrong.keep(leg.load(data)), wrong.keep(leg.landmarks(data)));
        wrong.keep(leg.emg(data));
        Some(words_of(leg, &trial?, &landmarks?))
    };
    let legs: Option<Vec<String>> =
        file.and_then(|file| file.each_leg(&mut wrong, load).into_iter().collect());
    wrong.finish()?;
    let legs = legs.ok_or(InputError::UnknownKind { file: path.to_path_buf(), wanted: "a trial file" })?;
    Ok(format!("Trial file{}. {}", if legs.len() > 1 { " of both legs" } else { "" }, legs.join("\n  ")))
}

/// What a trial file says of one leg.
fn words_of(file: &TrialFile, trial: &Trial, landmarks: &LandmarkSpec) -> String {
    let source = match &landmarks.source {
        Landmarks::Table { items, .. } => format!("a table of {} items", items.len()),
        Landmarks::Markers { .. } => "landmark markers".to_string(),
        Landmarks::Functional { motions, .. } => {
            format!("functional calibration on {} recordings", motions.len())
        }
    };
    let report = &trial.time[trial.report.clone()];
    let gaps: usize = trial
        .markers
        .iter()
        .map(|m| m.position[trial.report.clone()].iter().filter(|p| p.is_none()).count())
        .sum();
    let peak = trial.ground.force.iter().map(|f| f.y).fold(0.0, f64::max);
    let doubts: String = file.doubts(trial).iter().map(|doubt| format!("\n  doubt: {doubt}")).collect();
    format!(
        "{} ({:?} leg, {} kg, {} m). {} markers in {} frames, {:.4} to {:.4} s; reported are {} frames, {:.4} to {:.4} s, with {} \
         missing marker positions. Ground reaction from {} samples, up to {:.0} N ({:.2} body weights). Landmarks from {source}.{doubts}",
        file.subject.name,
        trial.side,
        trial.subject.mass,
        trial.subject.height,
        trial.markers.len(),
        trial.time.len(),
        trial.time[0],
        trial.time[trial.time.len() - 1],
        report.len(),
        report[0],
        report[report.len() - 1],
        gaps,
        trial.ground.time.len(),
        peak,
        peak / (9.81 * trial.subject.mass),
    )
}

fn markers(recording: &MarkerRecording) -> String {
    let frames = recording.time.len();
    let mut text = format!(
        "{} markers in {frames} frames at {} Hz, {:.4} to {:.4} s, first frame {}, written in {}.",
        recording.names.len(),
        recording.rate_hz,
        recording.time.first().unwrap_or(&f64::NAN),
        recording.time.last().unwrap_or(&f64::NAN),
        recording.first_frame,
        recording.file_unit
    );
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for place in recording.position.iter().flatten().flatten() {
        for k in 0..3 {
            low[k] = low[k].min(place[k]);
            high[k] = high[k].max(place[k]);
        }
    }
    if low[0].is_finite() {
        let range = |k: usize| format!("{:.3} to {:.3}", low[k], high[k]);
        text += &format!(" Positions: x {}, y {}, z {} m.", range(0), range(1), range(2));
    }
    let count = |wanted: fn(&Option<nalgebra::Vector3<f64>>) -> bool, path: &[Option<_>]| {
        path.iter().filter(|p| wanted(p)).count()
    };
    let mut gaps = Vec::new();
    let mut zeros = 0;
    for (name, path) in recording.names.iter().zip(&recording.position) {
        match count(|p| p.is_none(), path) {
            0 => {}
            n if n == frames => gaps.push(format!("{name} never seen")),
            n => gaps.push(format!("{name} {n} frames")),
        }
        zeros += usize::from(count(|p| *p == Some(nalgebra::Vector3::zeros()), path) > 0);
    }
    text += &if gaps.is_empty() { " No gaps.".to_string() } else { format!(" Gaps: {}.", gaps.join(", ")) };
    if zeros > 0 {
        text += &format!(" {zeros} markers hold exact zeros, which may mean missing (`zeros_missing`).");
    }
    text
}

fn series(table: &TimeSeries) -> String {
    let (first, last) =
        (table.time.first().copied().unwrap_or(f64::NAN), table.time.last().copied().unwrap_or(f64::NAN));
    let rate = (table.time.len() - 1) as f64 / (last - first);
    let mut text = format!(
        "{} columns besides time, {} rows, {first:.4} to {last:.4} s",
        table.columns.len(),
        table.time.len()
    );
    if rate.is_finite() {
        text += &format!(", {rate:.1} Hz on average");
    }
    text += if table.in_degrees { ", rotations in degrees." } else { "." };
    let ranges = table.columns.iter().zip(&table.values).map(|(name, v)| {
        let (low, high) =
            v.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &x| (a.min(x), b.max(x)));
        format!("{name} {low:.4} to {high:.4}")
    });
    text + " " + &ranges.collect::<Vec<_>>().join(", ") + "."
}
