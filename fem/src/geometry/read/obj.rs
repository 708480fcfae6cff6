//! Wavefront OBJ: vertices and polygons; everything else of the format describes looks.

use std::path::Path;

use super::{point, push_polygon, used_only};
use crate::geometry::Surface;
use crate::mesh::format::source::{Source, shorten};
use crate::mesh::{LengthUnit, MeshError};

/// Statements that do not change the shape.
const IGNORED: [&str; 12] =
    ["vn", "vt", "g", "o", "s", "usemtl", "mtllib", "l", "p", "usemap", "maplib", "mg"];

/// Reads the bytes of an OBJ file; `file` names it in errors. Polygons are cut into triangles.
pub fn parse(bytes: &[u8], file: &Path, unit: LengthUnit) -> Result<Surface, MeshError> {
    let mut source = Source::new(file, bytes);
    let mut surface = Surface::default();
    let mut polygon = Vec::new();
    while let Some((line, number)) = next(&mut source)? {
        let mut words = line.split_ascii_whitespace();
        let error = |reason: String| crate::mesh::format::source::format_error(file, number, reason);
        match words.next() {
            None => {}
            Some(word) if word.starts_with('#') || IGNORED.contains(&word) => {}
            Some("v") => {
                let mut xyz = [0.0; 3];
                for x in &mut xyz {
                    let word = words.next().unwrap_or_default();
                    *x = word
                        .parse()
                        .map_err(|_| error(format!("a coordinate expected, found `{}`", shorten(word))))?;
                }
                let at = point(&source, xyz, unit).map_err(|_| {
                    error(format!("the coordinates {xyz:?} must be finite; remove or repair this vertex"))
                })?;
                surface.points.push(at);
            }
            Some("f") => {
                polygon.clear();
                for word in words {
                    polygon.push(index(word, surface.points.len()).map_err(error)?);
                }
                if polygon.len() < 3 {
                    return Err(error(format!("a face of {} corners; at least 3 are needed", polygon.len())));
                }
                push_polygon(&mut surface.triangles, &polygon);
            }
            Some(word) => {
                return Err(error(format!(
                    "`{}` is not supported; export vertices and faces only",
                    shorten(word)
                )));
            }
        }
    }
    Ok(used_only(surface))
}

/// Next line and its place.
fn next<'a>(source: &mut Source<'a>) -> Result<Option<(&'a str, crate::mesh::Place)>, MeshError> {
    let place = source.place();
    Ok(source.line()?.map(|line| (line, place)))
}

/// Point number of a corner such as `7`, `7/1/3`, `7//3`, or `-1` (the last vertex so far).
fn index(word: &str, n_points: usize) -> Result<u32, String> {
    let text = word.split('/').next().unwrap_or_default();
    let number: i64 =
        text.parse().map_err(|_| format!("a vertex number expected, found `{}`", shorten(word)))?;
    let n = n_points as i64;
    let index = if number > 0 { number - 1 } else { n.saturating_add(number) };
    if number == 0 || index < 0 || index >= n {
        return Err(format!("vertex {number} does not exist; {n_points} vertices come before this face"));
    }
    u32::try_from(index).map_err(|_| "more vertices than 32-bit numbers can name".into())
}
