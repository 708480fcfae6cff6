//! OpenSim storage files (`.sto`): a header of `key=value` lines, then tab-separated rows.
//!
//! Format: OpenSim documentation, "Storage (.sto) files": a name, `version`, `nRows`, `nColumns` (time included),
//! `inDegrees`, `endheader`, the labels, the rows. A missing value is `nan`; an empty cell would shift the row.

use std::io::{self, Write};

use super::tables::Series;

/// Writes `series`; `in_degrees` says whether angles among the columns are degrees.
pub fn write(out: &mut dyn Write, name: &str, series: &Series, in_degrees: bool) -> io::Result<()> {
    let name: String = name.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    writeln!(out, "{name}")?;
    writeln!(out, "version=1")?;
    writeln!(out, "nRows={}", series.time.len())?;
    writeln!(out, "nColumns={}", series.columns.len() + 1)?;
    writeln!(out, "inDegrees={}", if in_degrees { "yes" } else { "no" })?;
    writeln!(out, "endheader")?;
    write!(out, "time")?;
    for (name, _) in &series.columns {
        write!(out, "\t{name}")?;
    }
    writeln!(out)?;
    for (i, &t) in series.time.iter().enumerate() {
        write!(out, "{}", number(t))?;
        for (_, values) in &series.columns {
            write!(out, "\t{}", number(values[i]))?;
        }
        writeln!(out)?;
    }
    Ok(())
}

fn number(value: f64) -> String {
    if value.is_finite() { format!("{value:?}") } else { "nan".into() }
}
