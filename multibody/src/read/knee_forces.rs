//! Measured knee forces: medial and lateral, or the four load cells of an instrumented tibial tray.

use std::path::Path;

use super::text::{check_increasing, decode, number, shortened};
use super::{file_bytes, malformed};
use crate::error::{InputError, Place};

/// No knee bears more \[N\]: a thousand body weights.
const LARGEST_FORCE: f64 = 1e6;

/// Newtons per pound-force.
const POUND_FORCE: f64 = 4.448_221_6;

/// Fraction of each load cell in the medial force; the rest is lateral. Subject JW, fourth Grand Challenge Competition to
/// Predict In Vivo Knee Loads (Fregly et al., J Orthop Res 2012;30:503).
const MEDIAL_FRACTION: [(&str, f64); 4] = [("AM", 0.9871), ("PM", 0.9683), ("AL", 0.0387), ("PL", 0.0211)];

/// Tibiofemoral contact force, compression positive.
#[derive(Clone, Debug, PartialEq)]
pub struct KneeForces {
    /// Time of each row \[s\].
    pub time: Vec<f64>,
    /// Medial compartment \[N\].
    pub medial: Vec<f64>,
    /// Lateral compartment \[N\].
    pub lateral: Vec<f64>,
}

/// Reads a CSV file with the columns `time_s, medial_N, lateral_N`, or `Time(sec), PM, AM, AL, PL, …` in pounds-force, as the
/// competition distributes them: lines may end in carriage returns and in commas, and a cell without a number is a gap of the sensor
/// (not a number). Other columns are not looked at.
pub fn read_knee_forces(path: &Path) -> Result<KneeForces, InputError> {
    parse(path, &file_bytes(path)?)
}

/// Whether a text begins as a file of knee forces does.
pub(super) fn is_knee_forces(text: &str) -> bool {
    let first = text.split(['\n', '\r']).find(|line| is_content(line)).unwrap_or("");
    let names = cells(first);
    names[0] == CELLS_TIME || names[0] == PLAIN_TIME && names.contains(&"medial_N")
}

/// First columns of the two layouts.
const CELLS_TIME: &str = "Time(sec)";
const PLAIN_TIME: &str = "time_s";

fn is_content(line: &str) -> bool {
    !line.starts_with('#') && !line.chars().all(|c| c.is_whitespace() || c == ',')
}

/// Cells of a line without the empty ones at its end; at least one.
fn cells(line: &str) -> Vec<&str> {
    let separator = if line.contains('\t') { '\t' } else { ',' };
    let mut cells: Vec<&str> =
        line.split(separator).map(|cell| cell.trim().trim_matches('"').trim()).collect();
    while cells.len() > 1 && cells.last().is_some_and(|cell| cell.is_empty()) {
        cells.pop();
    }
    cells
}

fn parse(file: &Path, bytes: &[u8]) -> Result<KneeForces, InputError> {
    let text = decode(file, bytes)?.replace("\r\n", "\n").replace('\r', "\n");
    let mut lines = text.lines().enumerate().map(|(i, l)| (i + 1, l)).filter(|(_, l)| is_content(l));
    let (line, names) =
        lines.next().ok_or_else(|| malformed(file, Place::Whole, "the file is empty", "copy it again"))?;
    let names = cells(names);
    // Per wanted column, what a unit of it adds to the medial and to the lateral force.
    let wanted: Vec<(&'static str, [f64; 2])> = match names[0] {
        CELLS_TIME => MEDIAL_FRACTION
            .iter()
            .map(|&(name, fraction)| (name, [POUND_FORCE * fraction, POUND_FORCE * (1.0 - fraction)]))
            .collect(),
        PLAIN_TIME => vec![("medial_N", [1.0, 0.0]), ("lateral_N", [0.0, 1.0])],
        other => {
            let problem = format!("the first column is `{}`", shortened(other));
            return Err(malformed(file, Place::Line(line), problem, "it must be `time_s` or `Time(sec)`"));
        }
    };
    let column = |&(name, fractions): &(&'static str, [f64; 2])| {
        let remedy = "wanted are medial_N and lateral_N after time_s, or PM, AM, AL and PL after Time(sec)";
        let problem = || format!("there is no column `{name}`");
        let at = names.iter().position(|n| *n == name);
        Ok((name, at.ok_or_else(|| malformed(file, Place::Line(line), problem(), remedy))?, fractions))
    };
    let columns = wanted.iter().map(column).collect::<Result<Vec<_>, InputError>>()?;
    let mut forces = KneeForces { time: Vec::new(), medial: Vec::new(), lateral: Vec::new() };
    for (line, row) in lines {
        let row = cells(row);
        if let Some(extra) = row.get(names.len()) {
            let problem = format!("`{}` follows the last of {} columns", shortened(extra), names.len());
            let remedy = "repair the row or the line of names";
            return Err(malformed(file, Place::Line(line), problem, remedy));
        }
        let time = number(file, line, "time", row[0])?;
        check_increasing(file, line, time, forces.time.last())?;
        let mut force = [0.0; 2];
        for &(name, at, fractions) in &columns {
            let cell = row.get(at).copied().unwrap_or("");
            let value = match cell.is_empty() || cell.eq_ignore_ascii_case("nan") {
                true => f64::NAN,
                false => number(file, line, name, cell)?,
            };
            // What a column adds nothing to does not suffer from its gaps.
            for (sum, fraction) in force.iter_mut().zip(fractions).filter(|(_, fraction)| *fraction != 0.0) {
                *sum += fraction * value;
            }
        }
        if let Some(wrong) = force.iter().find(|f| f.abs() > LARGEST_FORCE) {
            let problem = format!("a force of {wrong:.1e} N");
            let remedy = "no knee bears that; correct the row or the unit";
            return Err(malformed(file, Place::Line(line), problem, remedy));
        }
        forces.time.push(time);
        forces.medial.push(force[0]);
        forces.lateral.push(force[1]);
    }
    for (side, values) in [("medial", &forces.medial), ("lateral", &forces.lateral)] {
        if values.iter().all(|v| v.is_nan()) {
            let problem = format!("no row holds a {side} force");
            return Err(malformed(file, Place::Whole, problem, "copy the file again"));
        }
    }
    Ok(forces)
}
