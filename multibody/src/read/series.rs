//! Tables over time: OpenSim storage files (STO, MOT) and our own CSV.

use std::path::Path;

use super::text::{check_increasing, decode, number, shortened, with_plain_ends};
use super::{ending, file_bytes, malformed};
use crate::error::{InputError, Place, nearest};

/// Named columns over time.
#[derive(Clone, Debug, PartialEq)]
pub struct TimeSeries {
    /// Names of the columns without time. Of a CSV file with SI suffix: `_mm` became `_m`, `_deg` `_rad`, `_Nmm` `_Nm`.
    pub columns: Vec<String>,
    /// Time of each row \[s\].
    pub time: Vec<f64>,
    /// Values by column, then row, SI; see `in_degrees`.
    pub values: Vec<Vec<f64>>,
    /// The storage file says `inDegrees=yes`: rotations are in degrees, see [`TimeSeries::angle`]. Such a file does
    /// not say which columns are rotations.
    pub in_degrees: bool,
}

impl TimeSeries {
    /// A column.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let index = self.columns.iter().position(|c| c == name)?;
        Some(&self.values[index])
    }

    /// A column that holds a rotation \[rad\].
    pub fn angle(&self, name: &str) -> Option<Vec<f64>> {
        let factor = if self.in_degrees { 1f64.to_radians() } else { 1.0 };
        Some(self.column(name)?.iter().map(|v| v * factor).collect())
    }

    /// The name that is spelt most like `name`.
    pub fn nearest(&self, name: &str) -> Option<String> {
        nearest(name, self.columns.iter().map(String::as_str))
    }
}

/// Reads a table from a `.sto`, `.mot` or `.csv` file.
pub fn read_series(path: &Path) -> Result<TimeSeries, InputError> {
    parse_series(path, &file_bytes(path)?)
}

/// Reads a table that is in memory; the ending of `file` tells the format.
pub fn parse_series(file: &Path, bytes: &[u8]) -> Result<TimeSeries, InputError> {
    match ending(file).as_str() {
        "sto" | "mot" => parse_storage(file, bytes),
        "csv" => parse_csv(file, bytes),
        _ => Err(InputError::UnknownKind { file: file.to_path_buf(), wanted: ".sto, .mot, .csv" }),
    }
}

/// Header of `key=value` lines up to `endheader`, a line of names, rows separated by tabs or spaces.
fn parse_storage(file: &Path, bytes: &[u8]) -> Result<TimeSeries, InputError> {
    let text = decode(file, bytes)?;
    let mut lines =
        text.lines().enumerate().map(|(i, line)| (i + 1, line.trim())).filter(|(_, line)| !line.is_empty());
    let (mut n_rows, mut n_columns, mut in_degrees) = (None, None, false);
    loop {
        let Some((line, row)) = lines.next() else {
            return Err(malformed(
                file,
                Place::Whole,
                "there is no line `endheader`",
                "is it a storage file?",
            ));
        };
        let row = row.to_lowercase();
        if row == "endheader" {
            break;
        }
        // `key=value`, or `key value` in files of older programs
        let (key, value) =
            row.split_once('=').or_else(|| row.split_once(char::is_whitespace)).unwrap_or((&row, ""));
        match key.trim() {
            "nrows" | "datarows" => n_rows = Some((line, number(file, line, "the number of rows", value)?)),
            "ncolumns" | "datacolumns" => {
                n_columns = Some((line, number(file, line, "the number of columns", value)?))
            }
            "indegrees" => in_degrees = value.trim() == "yes",
            _ => {}
        }
    }
    let Some((line, row)) = lines.next() else {
        return Err(malformed(file, Place::Whole, "the file ends after its header", "copy it again"));
    };
    let names: Vec<&str> = row.split_whitespace().collect();
    if names.first().is_none_or(|n| !n.eq_ignore_ascii_case("time")) {
        let problem = format!("the first column is `{}`", shortened(names.first().unwrap_or(&"")));
        return Err(malformed(file, Place::Line(line), problem, "it must be `time`"));
    }
    if let Some((line, claimed)) = n_columns.filter(|(_, n)| *n != names.len() as f64) {
        let problem = format!("{claimed} columns are claimed, {} named", names.len());
        return Err(malformed(file, Place::Line(line), problem, "correct the count or the names"));
    }
    let mut series =
        Builder::new(file, names[1..].iter().map(|n| n.to_string()).collect(), vec![1.0; names.len() - 1]);
    for (line, row) in lines {
        series.push(line, row.split_whitespace())?;
    }
    if let Some((line, claimed)) = n_rows.filter(|(_, n)| *n != series.time.len() as f64) {
        let problem = format!("{claimed} rows are claimed, the file holds {}", series.time.len());
        return Err(malformed(file, Place::Line(line), problem, "the file is cut off or the count is wrong"));
    }
    series.finish(in_degrees)
}

/// A line of names that begins with `time_s`, then rows. Lines that begin with `#` are comments.
fn parse_csv(file: &Path, bytes: &[u8]) -> Result<TimeSeries, InputError> {
    let text = with_plain_ends(decode(file, bytes)?);
    let mut reader =
        csv::ReaderBuilder::new().comment(Some(b'#')).flexible(true).from_reader(text.as_bytes());
    let broken = |e: csv::Error| {
        let line = e.position().map_or(1, |p| p.line() as usize);
        malformed(file, Place::Line(line), e.to_string(), "repair the row")
    };
    let names = reader.headers().map_err(broken)?.clone();
    if names.get(0).map(str::trim) != Some("time_s") {
        let problem = format!("the first column is `{}`", shortened(names.get(0).unwrap_or("")));
        return Err(malformed(file, Place::Line(1), problem, "it must be `time_s`"));
    }
    let (names, factors) = names.iter().skip(1).map(|n| si_name(n.trim())).unzip();
    let mut series = Builder::new(file, names, factors);
    for row in reader.records() {
        let row = row.map_err(broken)?;
        let line = row.position().map_or(0, |p| p.line() as usize);
        series.push(line, row.iter())?;
    }
    series.finish(false)
}

/// Name with an SI suffix, and the factor that goes with it.
fn si_name(name: &str) -> (String, f64) {
    for (suffix, si, factor) in
        [("_mm", "_m", 1e-3), ("_deg", "_rad", 1f64.to_radians()), ("_Nmm", "_Nm", 1e-3)]
    {
        if let Some(stem) = name.strip_suffix(suffix) {
            return (format!("{stem}{si}"), factor);
        }
    }
    (name.to_string(), 1.0)
}

/// Collects rows of a time and one number per column.
pub(super) struct Builder<'a> {
    file: &'a Path,
    columns: Vec<String>,
    factors: Vec<f64>,
    pub time: Vec<f64>,
    values: Vec<Vec<f64>>,
}

impl<'a> Builder<'a> {
    pub fn new(file: &'a Path, columns: Vec<String>, factors: Vec<f64>) -> Self {
        let values = vec![Vec::new(); columns.len()];
        Self { file, columns, factors, time: Vec::new(), values }
    }

    pub fn push<'c>(
        &mut self,
        line: usize,
        mut cells: impl Iterator<Item = &'c str>,
    ) -> Result<(), InputError> {
        let time = number(self.file, line, "time", cells.next().unwrap_or(""))?;
        check_increasing(self.file, line, time, self.time.last())?;
        for (column, name) in self.columns.iter().enumerate() {
            let cell = cells.next().unwrap_or("");
            self.values[column].push(number(self.file, line, name, cell)? * self.factors[column]);
        }
        if let Some(extra) = cells.next() {
            let problem =
                format!("`{}` follows the last of {} columns", shortened(extra), self.columns.len() + 1);
            return Err(malformed(
                self.file,
                Place::Line(line),
                problem,
                "repair the row or the line of names",
            ));
        }
        self.time.push(time);
        Ok(())
    }

    pub fn finish(self, in_degrees: bool) -> Result<TimeSeries, InputError> {
        if self.time.is_empty() {
            return Err(malformed(self.file, Place::Whole, "the table has no rows", "copy the file again"));
        }
        Ok(TimeSeries { columns: self.columns, time: self.time, values: self.values, in_degrees })
    }
}
