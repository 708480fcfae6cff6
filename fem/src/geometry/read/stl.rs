//! STL, text and binary: triangles without connectivity, restored by merging vertices with the same coordinates.

use std::collections::HashMap;
use std::path::Path;

use super::point;
use crate::geometry::Surface;
use crate::mesh::format::source::{Source, shorten};
use crate::mesh::{LengthUnit, MeshError};

/// Bytes before the first triangle: header and count.
const HEAD: usize = 84;
/// Bytes of a triangle: normal, three corners, attribute.
const TRIANGLE: usize = 50;

/// Reads the bytes of an STL file; `file` names it in errors. Corners with bit-identical coordinates (-0 counts as 0) become
/// one point, numbered as they first occur. Normals of the file are not used: the order of the corners says what is outside.
pub fn parse(bytes: &[u8], file: &Path, unit: LengthUnit) -> Result<Surface, MeshError> {
    let mut source = Source::new(file, bytes);
    let text = bytes.trim_ascii_start().get(..5).is_some_and(|b| b.eq_ignore_ascii_case(b"solid"));
    // Some programs begin binary files with "solid" as well; text has no zero bytes.
    if text && !bytes[..bytes.len().min(2 * HEAD)].contains(&0) {
        parse_text(&mut source, unit)
    } else {
        source.binary = true;
        parse_binary(&mut source, unit)
    }
}

/// Points by their coordinates.
#[derive(Default)]
struct Merged {
    surface: Surface,
    numbers: HashMap<[u64; 3], u32>,
}

impl Merged {
    fn number(&mut self, at: [f64; 3]) -> u32 {
        let next = self.surface.points.len() as u32;
        let number = *self.numbers.entry(at.map(|x| (x + 0.0).to_bits())).or_insert(next);
        if number == next {
            self.surface.points.push(at);
        }
        number
    }
}

fn parse_binary(source: &mut Source, unit: LengthUnit) -> Result<Surface, MeshError> {
    if source.bytes.len() < HEAD {
        return Err(source.error(format!(
            "{} bytes are neither a binary STL file (84 bytes at least) nor a text that begins with `solid`",
            source.bytes.len()
        )));
    }
    source.at = HEAD - 4;
    let count = u32::from_le_bytes(source.take()?) as usize;
    let found = source.bytes.len() - HEAD;
    if count.checked_mul(TRIANGLE) != Some(found) {
        source.at = HEAD - 4;
        return Err(source.error(format!(
            "{count} triangles of 50 bytes are announced, but {found} bytes follow ({} triangles); the file is cut off or damaged",
            found / TRIANGLE
        )));
    }
    let mut merged = Merged::default();
    merged.surface.triangles.reserve_exact(count);
    for _ in 0..count {
        source.take::<12>()?; // the normal
        let mut triangle = [0; 3];
        for number in &mut triangle {
            let mut xyz = [0.0; 3];
            for x in &mut xyz {
                *x = f64::from(f32::from_le_bytes(source.take()?));
            }
            *number = merged.number(point(source, xyz, unit)?);
        }
        source.take::<2>()?; // the attribute
        merged.surface.triangles.push(triangle);
    }
    Ok(merged.surface)
}

fn parse_text(source: &mut Source, unit: LengthUnit) -> Result<Surface, MeshError> {
    let mut merged = Merged::default();
    source.line()?; // solid and a name
    loop {
        let word = source.word()?.to_ascii_lowercase();
        match word.as_str() {
            "facet" => {
                expect(source, &["normal"])?;
                for _ in 0..3 {
                    source.parse::<f64>("a component of the normal")?;
                }
                expect(source, &["outer", "loop"])?;
                let mut triangle = [0; 3];
                for number in &mut triangle {
                    expect(source, &["vertex"])?;
                    let mut xyz = [0.0; 3];
                    for x in &mut xyz {
                        *x = source.parse("a coordinate")?;
                    }
                    *number = merged.number(point(source, xyz, unit)?);
                }
                expect(source, &["endloop", "endfacet"])?;
                merged.surface.triangles.push(triangle);
            }
            "endsolid" => {
                source.line()?; // the name
                if source.bytes[source.at..].trim_ascii().is_empty() {
                    return Ok(merged.surface);
                }
                expect(source, &["solid"])?; // the next body
                source.line()?;
            }
            _ => {
                return Err(
                    source.error(format!("`facet` or `endsolid` expected, found `{}`", shorten(&word)))
                );
            }
        }
    }
}

fn expect(source: &mut Source, words: &[&str]) -> Result<(), MeshError> {
    for expected in words {
        let found = source.word()?;
        if !found.eq_ignore_ascii_case(expected) {
            return Err(source.error(format!("`{expected}` expected, found `{}`", shorten(found))));
        }
    }
    Ok(())
}
