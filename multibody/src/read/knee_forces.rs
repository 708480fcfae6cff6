//! Measured knee forces: medial and lateral, or the four load cells of an instrumented tibial tray.

use std::path::Path;

use super::text::{decode, shortened};
use super::{file_bytes, malformed, series};
use crate::error::{InputError, Place};

/// Newtons per pound-force.
const POUND_FORCE: f64 = 4.448_221_6;

/// Share of each load cell in the medial force; the rest is lateral. Subject JW, fourth Grand Challenge Competition to
/// Predict In Vivo Knee Loads (Fregly et al., J Orthop Res 2012;30:503).
const MEDIAL_SHARE: [(&str, f64); 4] = [("AM", 0.9871), ("PM", 0.9683), ("AL", 0.0387), ("PL", 0.0211)];

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

/// Reads a CSV file with the columns `time_s, medial_N, lateral_N`, or `Time(sec), PM, AM, AL, PL, …` in pounds-force.
pub fn read_knee_forces(path: &Path) -> Result<KneeForces, InputError> {
    parse(path, &file_bytes(path)?)
}

fn parse(file: &Path, bytes: &[u8]) -> Result<KneeForces, InputError> {
    let text = decode(file, bytes)?;
    let mut lines = text
        .lines()
        .enumerate()
        .map(|(i, l)| (i + 1, l))
        .filter(|(_, l)| !l.trim().is_empty() && !l.starts_with('#'));
    let (line, names) =
        lines.next().ok_or_else(|| malformed(file, Place::Whole, "the file is empty", "copy it again"))?;
    let separator = if names.contains('\t') { '\t' } else { ',' };
    let names: Vec<String> = names.split(separator).map(|n| n.trim().to_string()).collect();
    let cells = match names[0].as_str() {
        "Time(sec)" => true,
        "time_s" => false,
        other => {
            let problem = format!("the first column is `{}`", shortened(other));
            return Err(malformed(file, Place::Line(line), problem, "it must be `time_s` or `Time(sec)`"));
        }
    };
    let mut builder = series::Builder::new(file, names[1..].to_vec(), vec![1.0; names.len() - 1]);
    for (line, row) in lines {
        builder.push(line, row.split(separator))?;
    }
    let table = builder.finish(false)?;
    let column = |name: &str| {
        table.column(name).ok_or_else(|| {
            let remedy =
                "wanted are medial_N and lateral_N after time_s, or PM, AM, AL and PL after Time(sec)";
            malformed(file, Place::Line(line), format!("there is no column `{name}`"), remedy)
        })
    };
    if !cells {
        return Ok(KneeForces {
            medial: column("medial_N")?.to_vec(),
            lateral: column("lateral_N")?.to_vec(),
            time: table.time.clone(),
        });
    }
    let mut medial = vec![0.0; table.time.len()];
    let mut lateral = medial.clone();
    for (name, share) in MEDIAL_SHARE {
        for (i, pounds) in column(name)?.iter().enumerate() {
            medial[i] += POUND_FORCE * share * pounds;
            lateral[i] += POUND_FORCE * (1.0 - share) * pounds;
        }
    }
    Ok(KneeForces { time: table.time, medial, lateral })
}
