//! The text of a file that people write, and errors that point into it.

use std::path::Path;

use multibody::InputError;
use multibody::keys::line_of;

/// The text that errors point into.
#[derive(Clone, Copy)]
pub(crate) struct Source<'a> {
    pub file: &'a Path,
    pub text: &'a str,
}

impl Source<'_> {
    /// Number of the line of a byte.
    pub fn line(&self, byte: usize) -> usize {
        line_of(self.text, byte)
    }

    /// A value that cannot be used, in a line.
    pub fn bad(&self, line: usize, key: &str, value: impl ToString, remedy: impl ToString) -> InputError {
        InputError::BadValue {
            file: self.file.to_path_buf(),
            line,
            key: key.into(),
            value: value.to_string(),
            remedy: remedy.to_string(),
        }
    }

    /// The same in the line of a byte.
    pub fn bad_at(&self, byte: usize, key: &str, value: impl ToString, remedy: impl ToString) -> InputError {
        self.bad(self.line(byte), key, value, remedy)
    }
}
