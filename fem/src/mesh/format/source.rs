//! A cursor over the bytes of a mesh file: lines, words and little-endian numbers, each failure with its place.

use std::path::Path;
use std::str::FromStr;

use crate::mesh::{MeshError, Place};

/// The unread rest of a file.
pub(crate) struct Source<'a> {
    pub file: &'a Path,
    pub bytes: &'a [u8],
    /// Next unread byte.
    pub at: usize,
    /// Line of `at`, counted from 1, as long as only text has been read.
    line: usize,
    /// The part being read is binary: places are bytes.
    pub binary: bool,
}

impl<'a> Source<'a> {
    pub fn new(file: &'a Path, bytes: &'a [u8]) -> Source<'a> {
        Source { file, bytes, at: 0, line: 1, binary: false }
    }

    pub fn error(&self, reason: impl Into<String>) -> MeshError {
        format_error(self.file, self.place(), reason)
    }

    /// Where the unread rest begins.
    pub fn place(&self) -> Place {
        if self.binary { Place::Byte(self.at) } else { Place::Line(self.line) }
    }

    /// Next line without its end and surrounding blanks; `None` at the end of the file.
    pub fn line(&mut self) -> Result<Option<&'a str>, MeshError> {
        let rest = &self.bytes[self.at..];
        if rest.is_empty() {
            return Ok(None);
        }
        let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        let line = std::str::from_utf8(&rest[..length]).map_err(|_| self.error("not UTF-8 text"))?;
        self.at += (length + 1).min(rest.len());
        self.line += 1;
        Ok(Some(line.trim()))
    }

    /// Next word, over line ends.
    pub fn word(&mut self) -> Result<&'a str, MeshError> {
        while let Some(b) = self.bytes.get(self.at).filter(|b| b.is_ascii_whitespace()) {
            self.line += usize::from(*b == b'\n');
            self.at += 1;
        }
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        if length == 0 {
            return Err(self.error("the file ends here, in the middle of a section"));
        }
        let word = std::str::from_utf8(&rest[..length]).map_err(|_| self.error("not UTF-8 text"))?;
        self.at += length;
        Ok(word)
    }

    /// Next word as a number; `what` names it in the error.
    pub fn parse<T: FromStr>(&mut self, what: &str) -> Result<T, MeshError> {
        let word = self.word()?;
        word.parse().map_err(|_| self.error(format!("{what} expected, found `{}`", shorten(word))))
    }

    /// Next `N` bytes of a binary part.
    pub fn take<const N: usize>(&mut self) -> Result<[u8; N], MeshError> {
        let Some(bytes) = self.bytes[self.at..].first_chunk::<N>() else {
            return Err(self.error(format!("the file ends here, {N} bytes of a binary section expected")));
        };
        self.at += N;
        Ok(*bytes)
    }

    /// As many entries as were announced, at most what can fit into the rest of the file: a count may lie.
    ///
    /// `least_bytes`: bytes of the shortest possible entry.
    pub fn capacity(&self, announced: u64, least_bytes: usize) -> usize {
        let possible = (self.bytes.len() - self.at) / least_bytes;
        usize::try_from(announced).unwrap_or(usize::MAX).min(possible)
    }
}

/// A format error of `file`.
pub(crate) fn format_error(file: &Path, place: Place, reason: impl Into<String>) -> MeshError {
    MeshError::Format { file: file.into(), place, reason: reason.into() }
}

/// The first 40 characters, for messages.
pub(crate) fn shorten(text: &str) -> String {
    let mut short: String = text.chars().take(40).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    short
}

/// From the labels of a file to indices 0, 1, 2, …: sorted pairs, half the memory of a hash map.
#[derive(Default)]
pub(crate) struct Labels(Vec<(u64, u32)>);

impl Labels {
    /// `labels` in the order of their indices; the doubled one, if any, as error.
    pub fn new(labels: impl Iterator<Item = u64>) -> Result<Labels, u64> {
        let mut pairs: Vec<(u64, u32)> = labels.zip(0..).collect();
        pairs.sort_unstable();
        match pairs.windows(2).find(|w| w[0].0 == w[1].0) {
            Some(w) => Err(w[0].0),
            None => Ok(Labels(pairs)),
        }
    }

    /// Index of a label.
    pub fn get(&self, label: u64) -> Option<u32> {
        // Labels mostly count 1, 2, 3, …: look there first.
        let guess = self.0.first().map_or(0, |first| label.wrapping_sub(first.0));
        if let Some(pair) = usize::try_from(guess).ok().and_then(|i| self.0.get(i)).filter(|p| p.0 == label) {
            return Some(pair.1);
        }
        self.0.binary_search_by_key(&label, |p| p.0).ok().map(|i| self.0[i].1)
    }

    /// Pairs of label and index with first <= label <= last.
    pub fn range(&self, first: u64, last: u64) -> &[(u64, u32)] {
        let from = self.0.partition_point(|p| p.0 < first);
        let to = self.0.partition_point(|p| p.0 <= last);
        &self.0[from..to.max(from)]
    }
}

/// Bytes that lists which a file repeats or unpacks may still take, so that small files cannot ask for large memory.
pub(crate) struct Budget {
    left: usize,
    limit: usize,
}

impl Budget {
    /// `factor` times the file plus 32 MiB.
    pub fn new(file_bytes: usize, factor: usize) -> Budget {
        let limit = file_bytes.saturating_mul(factor).saturating_add(32 << 20);
        Budget { left: limit, limit }
    }

    /// Takes `bytes`, or says why not.
    pub fn take(&mut self, bytes: usize) -> Result<(), String> {
        match self.left.checked_sub(bytes) {
            Some(left) => {
                self.left = left;
                Ok(())
            }
            None => Err(format!(
                "the contents unpack to more than {} MiB, which a file of this size should not; split or repair it",
                self.limit >> 20
            )),
        }
    }
    /// Returns `bytes` taken before, once they are freed.
    pub fn give_back(&mut self, bytes: usize) {
        self.left += bytes;
    }
}
