//! The keyword blocks of an Abaqus input file: `*KEYWORD, PARAMETER=value` and the data lines below it.

use std::path::Path;

use super::source::{format_error, shorten};
use crate::mesh::{MeshError, Place};

/// One keyword with its data lines.
pub(super) struct Keyword<'a> {
    pub file: &'a Path,
    /// Line of the keyword, counted from 1.
    pub line: usize,
    /// In upper case, single blanks, without the star: `NODE`, `SOLID SECTION`.
    pub name: String,
    parameters: Vec<(String, &'a str)>,
    data: &'a str,
    data_line: usize,
}

impl<'a> Keyword<'a> {
    /// Value of a parameter without quotes; empty for a parameter without value.
    pub fn parameter(&self, name: &str) -> Option<&'a str> {
        self.parameters.iter().find(|p| p.0 == name).map(|p| p.1)
    }

    /// Value of a parameter that must be there.
    pub fn required(&self, name: &str) -> Result<&'a str, MeshError> {
        self.parameter(name)
            .filter(|v| !v.is_empty())
            .ok_or_else(|| self.error(self.line, format!("`*{}` needs the parameter {name}=", self.name)))
    }

    /// Number of data lines, comments included.
    pub fn n_lines(&self) -> usize {
        self.data.bytes().filter(|b| *b == b'\n').count()
    }

    /// Data lines with their numbers, without comments and empty lines.
    pub fn data(&self) -> impl Iterator<Item = (usize, &'a str)> + use<'a> {
        let first = self.data_line;
        self.data
            .lines()
            .enumerate()
            .map(move |(i, line)| (first + i, line.trim()))
            .filter(|(_, line)| !line.is_empty() && !line.starts_with("**"))
    }

    /// The fields of all data lines in a row, each with its line; what follows a last comma is not a field.
    pub fn fields(&self) -> impl Iterator<Item = (usize, &'a str)> + use<'a> {
        self.data().flat_map(|(number, line)| fields(line).map(move |field| (number, field)))
    }

    pub fn error(&self, line: usize, reason: impl Into<String>) -> MeshError {
        format_error(self.file, Place::Line(line), reason)
    }
}

/// The fields of a data line.
pub(super) fn fields(line: &str) -> impl Iterator<Item = &str> {
    line.strip_suffix(',').unwrap_or(line).split(',').map(str::trim)
}

/// Splits a file into its keywords.
pub(super) fn keywords<'a>(bytes: &'a [u8], file: &'a Path) -> Result<Vec<Keyword<'a>>, MeshError> {
    let text = std::str::from_utf8(bytes).map_err(|e| {
        let line = 1 + bytes[..e.valid_up_to()].iter().filter(|b| **b == b'\n').count();
        format_error(file, Place::Line(line), "not UTF-8 text; save the file as plain text (ASCII or UTF-8)")
    })?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut found: Vec<Keyword> = Vec::new();
    let mut data_start = 0;
    let (mut at, mut number) = (0, 0);
    let mut continued = false;
    for line in text.split_inclusive('\n') {
        number += 1;
        let start = at;
        at += line.len();
        let line = line.trim();
        if continued {
            // The keyword line before ended with a comma: these are more of its parameters.
            if let Some(keyword) = found.last_mut() {
                add_parameters(keyword, line.split(','));
                (data_start, keyword.data_line) = (at, number + 1);
            }
            continued = line.ends_with(',');
        } else if line.starts_with('*') && !line.starts_with("**") {
            if let Some(last) = found.last_mut() {
                last.data = &text[data_start..start];
            }
            let mut parts = line[1..].split(',');
            let name = parts.next().unwrap_or("").split_whitespace().collect::<Vec<_>>().join(" ");
            let mut keyword = Keyword {
                file,
                line: number,
                name: name.to_ascii_uppercase(),
                parameters: Vec::new(),
                data: "",
                data_line: number + 1,
            };
            add_parameters(&mut keyword, parts);
            found.push(keyword);
            data_start = at;
            continued = line.ends_with(',');
        } else if found.is_empty() && !line.is_empty() && !line.starts_with("**") {
            let reason = format!("a keyword `*…` expected, found `{}`", shorten(line));
            return Err(format_error(file, Place::Line(number), reason));
        }
    }
    if let Some(last) = found.last_mut() {
        last.data = &text[data_start.min(text.len())..];
    }
    Ok(found)
}

fn add_parameters<'a>(keyword: &mut Keyword<'a>, parts: impl Iterator<Item = &'a str>) {
    for part in parts.filter(|p| !p.trim().is_empty()) {
        let (name, value) = part.split_once('=').unwrap_or((part, ""));
        let value = value.trim();
        let value = value.strip_prefix('"').and_then(|v| v.strip_suffix('"')).unwrap_or(value);
        keyword.parameters.push((name.trim().to_ascii_uppercase(), value));
    }
}
