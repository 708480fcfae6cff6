//! The parameter section of a C3D file: named groups of named arrays.
//!
//! Format: The C3D File Format, User Guide (Motion Lab Systems), chapter "The Parameter Section".

use std::collections::BTreeMap;
use std::path::Path;

use super::bytes::Bytes;
use super::malformed;
use crate::error::{InputError, Place};

/// The format allows 255 blocks of 512 bytes; some programs write more. The bound keeps the memory of a damaged file small.
const LONGEST_SECTION: usize = 1 << 20;

/// What a parameter holds, first index fastest.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Strings, trimmed; the first dimension of the file is their length.
    Text(Vec<String>),
    /// Bytes, as written.
    Bytes(Vec<u8>),
    /// 16-bit integers, as written (counts may use all 16 bits).
    Integers(Vec<i16>),
    /// Floating-point numbers.
    Reals(Vec<f64>),
}

/// One array of a group.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Offset of the first value in the file.
    pub byte: usize,
    /// Sizes of the dimensions; empty for a single value.
    pub dimensions: Vec<u8>,
    /// Content.
    pub values: Values,
}

impl Parameter {
    /// The numbers, whatever their type; no numbers for text. 16-bit integers are signed.
    pub fn numbers(&self) -> Vec<f64> {
        match &self.values {
            Values::Text(_) => Vec::new(),
            Values::Bytes(v) => v.iter().map(|&n| n as f64).collect(),
            Values::Integers(v) => v.iter().map(|&n| n as f64).collect(),
            Values::Reals(v) => v.clone(),
        }
    }

    /// The numbers as counts: 16-bit integers are unsigned, others must be whole.
    pub fn counts(&self) -> Option<Vec<usize>> {
        match &self.values {
            Values::Text(_) => None,
            Values::Bytes(v) => Some(v.iter().map(|&n| n as usize).collect()),
            Values::Integers(v) => Some(v.iter().map(|&n| n as u16 as usize).collect()),
            Values::Reals(v) => v
                .iter()
                .map(|&n| (n >= 0.0 && n <= u32::MAX as f64 && n.fract() == 0.0).then_some(n as usize))
                .collect(),
        }
    }
}

/// All parameters, by group and name in capitals.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parameters {
    groups: BTreeMap<String, BTreeMap<String, Parameter>>,
}

impl Parameters {
    /// A parameter, e.g. `get("POINT", "RATE")`.
    pub fn get(&self, group: &str, name: &str) -> Option<&Parameter> {
        self.groups.get(group)?.get(name)
    }

    /// First number of a parameter.
    pub fn number(&self, group: &str, name: &str) -> Option<f64> {
        self.get(group, name)?.numbers().first().copied()
    }

    /// First value of a parameter as a count.
    pub fn count(&self, group: &str, name: &str) -> Option<usize> {
        self.get(group, name)?.counts()?.first().copied()
    }

    /// All strings of a parameter and of its continuations (`LABELS`, `LABELS2`, …).
    pub fn texts(&self, group: &str, name: &str) -> Vec<String> {
        self.continued(group, name)
            .flat_map(|p| match &p.values {
                Values::Text(t) => t.clone(),
                _ => Vec::new(),
            })
            .collect()
    }

    /// All numbers of a parameter and of its continuations (`SCALE`, `SCALE2`, …).
    pub fn numbers(&self, group: &str, name: &str) -> Vec<f64> {
        self.continued(group, name).flat_map(|p| p.numbers()).collect()
    }

    fn continued<'a>(&'a self, group: &'a str, name: &'a str) -> impl Iterator<Item = &'a Parameter> {
        let first = self.get(group, name).into_iter();
        first.chain((2..).map_while(move |k| self.get(group, &format!("{name}{k}"))))
    }

    /// Reads the records that begin at `start`. Each record says where the next one begins; the next must lie behind
    /// the content of this one, so the walk ends.
    pub(super) fn parse(file: &Path, bytes: Bytes, start: usize) -> Result<Self, InputError> {
        let cut = |at| {
            malformed(file, Place::Byte(at), "the parameter section is cut off", "export the file again")
        };
        let mut names: BTreeMap<i8, String> = BTreeMap::new();
        let mut arrays = Vec::new();
        let mut at = start;
        loop {
            if at - start > LONGEST_SECTION {
                let problem = format!("the parameter section is longer than {LONGEST_SECTION} bytes");
                return Err(malformed(
                    file,
                    Place::Byte(at),
                    problem,
                    "the header is damaged; export the file again",
                ));
            }
            let name_length = bytes.u8(at).ok_or_else(|| cut(at))? as i8; // negative: locked
            let group = bytes.u8(at + 1).ok_or_else(|| cut(at))? as i8;
            if name_length == 0 || group == 0 {
                break;
            }
            let length = name_length.unsigned_abs() as usize;
            let name = bytes.slice(at + 2, length).ok_or_else(|| cut(at))?;
            let name = String::from_utf8_lossy(name).trim().to_uppercase();
            let link = at + 2 + length;
            let offset = bytes.u16(link).ok_or_else(|| cut(link))? as usize;
            let end = if group < 0 {
                names.insert(group, name);
                link + 2
            } else {
                let (parameter, end) = parse_array(file, bytes, link + 2, &name)?;
                arrays.push((group, name, parameter));
                end
            };
            if offset == 0 {
                break;
            }
            let next = link + offset;
            if next < end {
                let problem = format!(
                    "the next parameter is said to begin at byte {next}, inside this one (it ends at {end})"
                );
                return Err(malformed(
                    file,
                    Place::Byte(link),
                    problem,
                    "the header is damaged; export the file again",
                ));
            }
            at = next;
        }
        let mut groups: BTreeMap<String, BTreeMap<String, Parameter>> = BTreeMap::new();
        for (group, name, parameter) in arrays {
            if let Some(group) = names.get(&group.wrapping_neg()) {
                groups.entry(group.clone()).or_default().insert(name, parameter);
            }
        }
        Ok(Self { groups })
    }
}

/// Type, dimensions and values; returns the byte behind them.
fn parse_array(file: &Path, bytes: Bytes, at: usize, name: &str) -> Result<(Parameter, usize), InputError> {
    let damaged = |problem: String| {
        malformed(file, Place::Byte(at), problem, "the header is damaged; export the file again")
    };
    let cut = || damaged(format!("parameter {name} reaches beyond the end of the file"));
    let kind = bytes.u8(at).ok_or_else(cut)? as i8;
    let n_dimensions = bytes.u8(at + 1).ok_or_else(cut)? as usize;
    if n_dimensions > 7 {
        return Err(damaged(format!(
            "parameter {name} has {n_dimensions} dimensions, at most 7 are allowed"
        )));
    }
    let dimensions = bytes.slice(at + 2, n_dimensions).ok_or_else(cut)?.to_vec();
    let first = at + 2 + n_dimensions;
    let size = match kind {
        -1 | 1 => 1,
        2 => 2,
        4 => 4,
        _ => return Err(damaged(format!("parameter {name} has type {kind}, known are -1, 1, 2, 4"))),
    };
    let count = dimensions.iter().try_fold(1usize, |n, &d| n.checked_mul(d as usize)).ok_or_else(cut)?;
    let length = count.checked_mul(size).ok_or_else(cut)?;
    let raw = bytes.slice(first, length).ok_or_else(cut)?;
    let places = (0..count).map(|i| first + i * size);
    let values = match kind {
        -1 => Values::Text(strings(raw, &dimensions)),
        1 => Values::Bytes(raw.to_vec()),
        2 => Values::Integers(places.filter_map(|p| bytes.i16(p)).collect()),
        _ => Values::Reals(places.filter_map(|p| bytes.f32(p)).collect()),
    };
    Ok((Parameter { byte: first, dimensions, values }, first + length))
}

/// Cuts characters into strings of the first dimension's length. Bytes that are not UTF-8 are replaced.
fn strings(raw: &[u8], dimensions: &[u8]) -> Vec<String> {
    let width = match dimensions {
        [] => 1,
        [width, ..] => *width as usize,
    };
    if width == 0 {
        return Vec::new();
    }
    let clean = |c: &[u8]| {
        String::from_utf8_lossy(c).trim_matches(|c: char| c == '\0' || c.is_whitespace()).to_string()
    };
    raw.chunks(width).map(clean).collect()
}
