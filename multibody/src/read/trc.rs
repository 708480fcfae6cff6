//! TRC files: markers as tab-separated text. An empty cell is a gap.

use std::path::Path;

use nalgebra::Vector3;

use super::text::{check_increasing, decode, number, shortened};
use super::{LARGEST_POSITION, LARGEST_RATE, MarkerRecording, file_bytes, malformed, metres_per};
use crate::error::{InputError, Place};

/// Reads a TRC file.
pub fn read_trc(path: &Path) -> Result<MarkerRecording, InputError> {
    parse_trc(path, &file_bytes(path)?)
}

/// Reads a TRC file that is in memory; `file` is named in errors.
pub fn parse_trc(file: &Path, bytes: &[u8]) -> Result<MarkerRecording, InputError> {
    let text = decode(file, bytes)?;
    let mut lines = text.lines().enumerate().map(|(i, line)| (i + 1, line));
    let mut next = |what: &str| {
        lines.next().ok_or_else(|| {
            malformed(file, Place::Whole, format!("the file ends before {what}"), "copy it again")
        })
    };
    let (_, first) = next("its first line")?;
    if !first.starts_with("PathFileType") {
        let problem = format!("the file begins with `{}`, a TRC file with `PathFileType`", shortened(first));
        return Err(malformed(file, Place::Line(1), problem, "is it a TRC file?"));
    }
    let (_, keys) = next("the names of the settings (line 2)")?;
    let (_, settings) = next("the settings (line 3)")?;
    let setting = |key: &str| {
        let column = keys.split_whitespace().position(|k| k == key);
        column.and_then(|c| settings.split_whitespace().nth(c)).ok_or_else(|| {
            malformed(
                file,
                Place::Line(3),
                format!("`{key}` is absent"),
                "lines 2 and 3 must hold the settings of the file",
            )
        })
    };
    let rate_hz = number(file, 3, "DataRate", setting("DataRate")?)?;
    if !(rate_hz > 0.0 && rate_hz <= LARGEST_RATE) {
        return Err(malformed(file, Place::Line(3), format!("DataRate is {rate_hz} Hz"), "correct the rate"));
    }
    let n_frames = number(file, 3, "NumFrames", setting("NumFrames")?)?;
    let n_markers = number(file, 3, "NumMarkers", setting("NumMarkers")?)?;
    let file_unit = setting("Units")?.to_string();
    let Some(metres) = metres_per(&file_unit) else {
        return Err(malformed(
            file,
            Place::Line(3),
            format!("Units is `{file_unit}`"),
            "known are m, cm, mm",
        ));
    };
    let (_, labels) = next("the marker names (line 4)")?;
    let names: Vec<String> =
        labels.split('\t').skip(2).map(str::trim).filter(|n| !n.is_empty()).map(String::from).collect();
    if names.len() as f64 != n_markers {
        let problem = format!("NumMarkers is {n_markers}, line 4 names {}", names.len());
        return Err(malformed(file, Place::Line(4), problem, "correct the count or the names"));
    }
    next("the coordinate names (line 5)")?;

    let mut position = vec![Vec::new(); names.len()];
    let mut time: Vec<f64> = Vec::new();
    let mut first_frame = 1;
    for (line, row) in lines.filter(|(_, row)| !row.trim().is_empty()) {
        let mut cells = row.split('\t');
        let frame = number(file, line, "the frame number", cells.next().unwrap_or(""))?;
        if time.is_empty() {
            first_frame = if (0.0..1e9).contains(&frame) { frame as usize } else { 1 };
        }
        let t = number(file, line, "the time", cells.next().unwrap_or(""))?;
        check_increasing(file, line, t, time.last())?;
        let expected = time.first().unwrap_or(&t) + time.len() as f64 / rate_hz;
        if (t - expected).abs() > 0.25 / rate_hz {
            let problem = format!("time {t} s where {expected:.6} s is due at {rate_hz} Hz");
            return Err(malformed(
                file,
                Place::Line(line),
                problem,
                "a row is missing or the rate is wrong; gaps are empty cells",
            ));
        }
        time.push(t);
        for (name, path) in names.iter().zip(&mut position) {
            path.push(point(file, line, name, &mut cells, metres)?);
        }
        if let Some(extra) = cells.find(|c| !c.trim().is_empty()) {
            let problem = format!("`{}` follows the last of {} markers", shortened(extra), names.len());
            return Err(malformed(
                file,
                Place::Line(line),
                problem,
                "line 4 lacks a name, or the row is broken",
            ));
        }
    }
    if time.len() as f64 != n_frames {
        let problem = format!("NumFrames is {n_frames}, the file holds {} rows", time.len());
        return Err(malformed(file, Place::Line(3), problem, "the file is cut off or the count is wrong"));
    }
    Ok(MarkerRecording { names, rate_hz, first_frame, time, position, file_unit })
}

/// The next three cells: all empty is a gap, some empty an error.
fn point<'a>(
    file: &Path,
    line: usize,
    name: &str,
    cells: &mut impl Iterator<Item = &'a str>,
    metres: f64,
) -> Result<Option<Vector3<f64>>, InputError> {
    let xyz = [cells.next(), cells.next(), cells.next()];
    if xyz.iter().all(|c| c.is_some_and(|c| c.trim().is_empty())) {
        return Ok(None);
    }
    if xyz[2].is_none() {
        return Err(malformed(
            file,
            Place::Line(line),
            format!("the row ends at marker `{name}`"),
            "the row is cut off",
        ));
    }
    let mut place = Vector3::zeros();
    for (k, cell) in xyz.into_iter().enumerate() {
        let what = format!("{} of marker `{name}`", ["x", "y", "z"][k]);
        place[k] = number(file, line, &what, cell.unwrap_or(""))? * metres;
        if place[k].abs() > LARGEST_POSITION {
            let value = cell.unwrap_or("").to_string();
            return Err(InputError::BadNumber {
                file: file.to_path_buf(),
                at: Place::Line(line),
                what,
                value,
            });
        }
    }
    Ok(Some(place))
}
