//! Text files: encoding, lines, numbers.

use std::path::Path;

use super::malformed;
use crate::error::{InputError, Place};

/// The text of a file without byte order mark. UTF-16 and other encodings are refused.
pub(crate) fn decode<'a>(file: &Path, bytes: &'a [u8]) -> Result<&'a str, InputError> {
    let remedy = "save the file as UTF-8 text";
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err(malformed(file, Place::Byte(0), "the text is UTF-16", remedy));
    }
    let bytes = bytes.strip_prefix(&[0xef, 0xbb, 0xbf]).unwrap_or(bytes);
    if let Some(at) = bytes.iter().position(|&b| b == 0) {
        return Err(malformed(
            file,
            Place::Byte(at),
            "a zero byte in a text file (UTF-16, or not text at all)",
            remedy,
        ));
    }
    std::str::from_utf8(bytes)
        .map_err(|e| malformed(file, Place::Byte(e.valid_up_to()), "the text is not UTF-8", remedy))
}

/// A table with the line ends that its reader counts rightly: after a return it takes the next row for one of the line before.
pub fn with_plain_ends(text: &str) -> String {
    text.replace("\r\n", "\n")
}

/// A finite number; `what` is named in the error.
pub(super) fn number(file: &Path, line: usize, what: &str, cell: &str) -> Result<f64, InputError> {
    match cell.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(InputError::BadNumber {
            file: file.to_path_buf(),
            at: Place::Line(line),
            what: what.to_string(),
            value: if cell.trim().is_empty() {
                "empty".to_string()
            } else {
                format!("`{}`", shortened(cell.trim()))
            },
        }),
    }
}

/// At most 40 characters, for messages.
pub(super) fn shortened(text: &str) -> String {
    text.chars().take(40).collect()
}

/// Refuses a time that does not follow the last one.
pub(super) fn check_increasing(
    file: &Path,
    line: usize,
    time: f64,
    previous: Option<&f64>,
) -> Result<(), InputError> {
    match previous {
        Some(&previous) if time <= previous => Err(InputError::TimeNotIncreasing {
            file: file.to_path_buf(),
            at: Place::Line(line),
            time,
            previous,
        }),
        _ => Ok(()),
    }
}
