//! The numbers of a VTK XML data array: text, base64 or raw bytes, zlib-compressed or not.
//! Layout: VTK documentation, "VTK XML file formats"; binary data begins with its length in bytes, compressed data with
//! \[number of blocks, size of a block, size of the last block if partial, compressed sizes …\].

use std::io::Read;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;

use super::source::{Budget, format_error, shorten};
use crate::mesh::{MeshError, Place};

/// How binary arrays of a file are written.
pub(super) struct Encoding<'a> {
    pub file: &'a Path,
    /// Lengths are `UInt64`, not `UInt32`.
    pub header64: bool,
    pub big_endian: bool,
    pub zlib: bool,
    /// What follows the `_` of `AppendedData`, and whether it is raw (else base64).
    pub appended: Option<(&'a [u8], bool)>,
}

/// Type of the numbers of an array.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum NumberType {
    Int(usize),
    UInt(usize),
    Float(usize),
}

impl NumberType {
    pub fn from_name(name: &str) -> Option<NumberType> {
        Some(match name {
            "Int8" => NumberType::Int(1),
            "Int16" => NumberType::Int(2),
            "Int32" => NumberType::Int(4),
            "Int64" => NumberType::Int(8),
            "UInt8" => NumberType::UInt(1),
            "UInt16" => NumberType::UInt(2),
            "UInt32" => NumberType::UInt(4),
            "UInt64" => NumberType::UInt(8),
            "Float32" => NumberType::Float(4),
            "Float64" => NumberType::Float(8),
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            NumberType::Int(size) | NumberType::UInt(size) | NumberType::Float(size) => size,
        }
    }
}

/// One number of an array.
#[derive(Clone, Copy)]
pub(super) enum Number {
    Int(i128),
    Float(f64),
}

impl Number {
    pub fn float(self) -> f64 {
        match self {
            Number::Int(i) => i as f64,
            Number::Float(x) => x,
        }
    }

    pub fn index(self) -> Option<u32> {
        match self {
            Number::Int(i) => u32::try_from(i).ok(),
            Number::Float(_) => None,
        }
    }
}

/// Where the numbers of an array are.
pub(super) enum Stored<'a> {
    Ascii(&'a str),
    /// Base64 in the element.
    Inline(&'a str),
    /// At this byte of the appended data.
    Appended(usize),
}

/// A `DataArray` element.
pub(super) struct Array<'a> {
    pub name: String,
    pub number: NumberType,
    pub components: usize,
    pub stored: Stored<'a>,
    /// Byte of the element in the file.
    pub at: usize,
}

impl<'a> Array<'a> {
    pub fn error(&self, file: &Path, reason: impl std::fmt::Display) -> MeshError {
        format_error(file, Place::Byte(self.at), format!("data array `{}`: {reason}", shorten(&self.name)))
    }

    /// All numbers, converted one by one. `expected`: how many there must be, where that is known.
    pub fn read<T>(
        &self,
        encoding: &Encoding,
        budget: &mut Budget,
        expected: Option<usize>,
        convert: impl Fn(Number) -> Result<T, String>,
    ) -> Result<Vec<T>, MeshError> {
        self.try_read(encoding, budget, expected, convert).map_err(|reason| self.error(encoding.file, reason))
    }

    fn try_read<T>(
        &self,
        encoding: &Encoding,
        budget: &mut Budget,
        expected: Option<usize>,
        convert: impl Fn(Number) -> Result<T, String>,
    ) -> Result<Vec<T>, String> {
        let wrong_count = |found: usize| match expected {
            Some(expected) if expected != found => Err(format!("{expected} numbers expected, {found} found")),
            _ => Ok(()),
        };
        let mut values = Vec::new();
        match self.stored {
            Stored::Ascii(text) => {
                let count = text.split_ascii_whitespace().count();
                wrong_count(count)?;
                budget.take(count.saturating_mul(size_of::<T>()))?;
                values.reserve_exact(count);
                for word in text.split_ascii_whitespace() {
                    values.push(convert(self.number_in(word)?)?);
                }
            }
            Stored::Inline(text) => {
                let bytes = from_base64(text.trim().as_bytes(), encoding, budget)?;
                self.numbers_in(&bytes, encoding, budget, wrong_count, convert, &mut values)?;
                budget.give_back(bytes.len());
            }
            Stored::Appended(offset) => {
                let (data, raw) = encoding.appended.ok_or("the file has no appended data")?;
                let rest = data
                    .get(offset..)
                    .ok_or_else(|| format!("offset {offset} is beyond the appended data"))?;
                if raw && !encoding.zlib {
                    let bytes = uncompressed(rest, encoding)?;
                    self.numbers_in(bytes, encoding, budget, wrong_count, convert, &mut values)?;
                } else {
                    let bytes = if raw {
                        inflate(rest, encoding, budget)?
                    } else {
                        from_base64(rest, encoding, budget)?
                    };
                    self.numbers_in(&bytes, encoding, budget, wrong_count, convert, &mut values)?;
                    budget.give_back(bytes.len());
                }
            }
        }
        Ok(values)
    }

    fn number_in(&self, word: &str) -> Result<Number, String> {
        let number = match self.number {
            NumberType::Float(_) => word.parse().ok().map(Number::Float),
            _ => word.parse::<i64>().ok().map(|i| Number::Int(i.into())),
        };
        number.ok_or_else(|| format!("`{}` is not a number of its type", shorten(word)))
    }

    fn numbers_in<T>(
        &self,
        bytes: &[u8],
        encoding: &Encoding,
        budget: &mut Budget,
        wrong_count: impl Fn(usize) -> Result<(), String>,
        convert: impl Fn(Number) -> Result<T, String>,
        values: &mut Vec<T>,
    ) -> Result<(), String> {
        let size = self.number.size();
        if !bytes.len().is_multiple_of(size) {
            return Err(format!("{} bytes do not divide into numbers of {size} bytes", bytes.len()));
        }
        let count = bytes.len() / size;
        wrong_count(count)?;
        budget.take(count.saturating_mul(size_of::<T>()))?;
        values.reserve_exact(count);
        for chunk in bytes.chunks_exact(size) {
            let mut word = [0u8; 8];
            word[..size].copy_from_slice(chunk);
            if encoding.big_endian {
                word[..size].reverse();
            }
            let unsigned = u64::from_le_bytes(word);
            values.push(convert(match self.number {
                NumberType::UInt(_) => Number::Int(unsigned.into()),
                // Shift up and back down: carries the sign of the shorter number.
                NumberType::Int(_) => {
                    Number::Int(((unsigned << (64 - 8 * size)) as i64 >> (64 - 8 * size)).into())
                }
                NumberType::Float(4) => Number::Float(f32::from_bits(unsigned as u32).into()),
                NumberType::Float(_) => Number::Float(f64::from_bits(unsigned)),
            })?);
        }
        Ok(())
    }
}

/// One word of a header.
fn header_word(bytes: &[u8], index: usize, encoding: &Encoding) -> Result<usize, String> {
    let size = if encoding.header64 { 8 } else { 4 };
    let chunk = bytes.get(index * size..(index + 1) * size).ok_or("the data end inside their header")?;
    let mut word = [0u8; 8];
    word[..size].copy_from_slice(chunk);
    if encoding.big_endian {
        word[..size].reverse();
    }
    usize::try_from(u64::from_le_bytes(word)).map_err(|_| "a length in the header is too large".into())
}

/// The bytes after a length.
fn uncompressed<'b>(bytes: &'b [u8], encoding: &Encoding) -> Result<&'b [u8], String> {
    let length = header_word(bytes, 0, encoding)?;
    let rest = &bytes[if encoding.header64 { 8 } else { 4 }..];
    rest.get(..length).ok_or_else(|| format!("{length} bytes announced, {} left", rest.len()))
}

/// Decodes what base64 text begins with: one array.
fn from_base64(text: &[u8], encoding: &Encoding, budget: &mut Budget) -> Result<Vec<u8>, String> {
    let word = if encoding.header64 { 8 } else { 4 };
    let piece = |from: usize, n_bytes: usize| -> Result<Vec<u8>, String> {
        let to = n_bytes.div_ceil(3).checked_mul(4).and_then(|n| n.checked_add(from)).unwrap_or(usize::MAX);
        let chars =
            text.get(from..to).ok_or_else(|| format!("{n_bytes} bytes announced, the text ends before"))?;
        BASE64.decode(chars).map_err(|e| format!("not base64: {e}"))
    };
    if text.is_empty() {
        return Ok(Vec::new()); // some writers leave empty arrays out altogether
    }
    let first = header_word(&piece_of_header(text, word)?, 0, encoding)?;
    if !encoding.zlib {
        let total = first.checked_add(word).ok_or("a length in the header is too large")?;
        budget.take(first.min(text.len()))?;
        let mut bytes = piece(0, total)?;
        bytes.truncate(total);
        bytes.drain(..word.min(bytes.len()));
        return Ok(bytes);
    }
    let n_header = first
        .checked_add(3)
        .and_then(|n| n.checked_mul(word))
        .ok_or("a length in the header is too large")?;
    let mut bytes = piece(0, n_header)?;
    bytes.truncate(n_header);
    let mut n_data = 0usize;
    for block in 0..first {
        n_data = n_data.saturating_add(header_word(&bytes, 3 + block, encoding)?);
    }
    bytes.extend(piece(n_header.div_ceil(3) * 4, n_data)?);
    inflate(&bytes, encoding, budget)
}

/// The first word of a header, from text that may be padded behind it.
fn piece_of_header(text: &[u8], word: usize) -> Result<Vec<u8>, String> {
    let n_chars = word.div_ceil(3) * 4;
    let chars = text.get(..n_chars).ok_or("the text ends inside the header")?;
    BASE64.decode(chars).map_err(|e| format!("not base64: {e}"))
}

/// Unpacks zlib blocks. Takes the unpacked size from the budget.
fn inflate(bytes: &[u8], encoding: &Encoding, budget: &mut Budget) -> Result<Vec<u8>, String> {
    let n_blocks = header_word(bytes, 0, encoding)?;
    if n_blocks == 0 {
        return Ok(Vec::new());
    }
    let (full, partial) = (header_word(bytes, 1, encoding)?, header_word(bytes, 2, encoding)?);
    let last = if partial == 0 { full } else { partial };
    let total =
        (n_blocks - 1).checked_mul(full).and_then(|n| n.checked_add(last)).ok_or("block sizes overflow")?;
    let word = if encoding.header64 { 8 } else { 4 };
    let n_header =
        n_blocks.checked_add(3).and_then(|n| n.checked_mul(word)).ok_or("number of blocks overflows")?;
    let mut rest = bytes.get(n_header..).ok_or("the data end inside their header")?;
    budget.take(total)?;
    let mut out = Vec::with_capacity(total);
    for block in 0..n_blocks {
        let packed = header_word(bytes, 3 + block, encoding)?;
        let (data, behind) =
            rest.split_at_checked(packed).ok_or_else(|| format!("block {block} is cut off"))?;
        let size = if block + 1 == n_blocks { last } else { full };
        let before = out.len();
        flate2::read::ZlibDecoder::new(data)
            .take(size as u64)
            .read_to_end(&mut out)
            .map_err(|e| format!("block {block} cannot be unpacked: {e}"))?;
        if out.len() - before != size {
            return Err(format!("block {block} unpacks to {} bytes, {size} announced", out.len() - before));
        }
        rest = behind;
    }
    Ok(out)
}
