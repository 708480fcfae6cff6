//! Errors of the TOML reader, with line and the nearest known key.

use std::path::Path;

use crate::error::{InputError, Place, nearest};

/// `unknown field` becomes an unknown key with the most similar known one; all others keep their words.
pub(super) fn translate(file: &Path, text: &str, error: &toml::de::Error) -> InputError {
    let line =
        error.span().map_or(1, |span| 1 + text.get(..span.start).unwrap_or(text).matches('\n').count());
    let message = error.message().to_string();
    // unknown field `hights`, expected one of `name`, `height_m`, …
    let mut quoted = message.split('`').skip(1).step_by(2);
    if message.starts_with("unknown field") {
        let key = quoted.next().unwrap_or("").to_string();
        let nearest = nearest(&key, quoted);
        return InputError::UnknownKey { file: file.to_path_buf(), line, key, nearest };
    }
    let remedy = "see the trial files that come with the program".to_string();
    InputError::Malformed { file: file.to_path_buf(), at: Place::Line(line), problem: message, remedy }
}
