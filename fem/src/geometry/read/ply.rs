//! PLY (Stanford polygon format), text and binary of both byte orders.

use std::path::Path;

use super::{point, push_polygon, used_only};
use crate::geometry::Surface;
use crate::mesh::format::source::{Source, shorten};
use crate::mesh::{LengthUnit, MeshError};

#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Text,
    Little,
    Big,
}

#[derive(Clone, Copy, PartialEq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

/// A property of an element: its name, type, and the type of its count if it is a list.
struct Property {
    name: String,
    value: Scalar,
    count: Option<Scalar>,
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

/// Reads the bytes of a PLY file; `file` names it in errors. Polygons are cut into triangles; properties other than the
/// coordinates and the corners of faces are skipped.
pub fn parse(bytes: &[u8], file: &Path, unit: LengthUnit) -> Result<Surface, MeshError> {
    let mut source = Source::new(file, bytes);
    let (encoding, elements) = header(&mut source)?;
    source.binary = encoding != Encoding::Text;
    let mut surface = Surface::default();
    let mut list = Vec::new();
    for element in &elements {
        let is = |name: &str| element.name == name;
        let find = |names: &[&str]| element.properties.iter().position(|p| names.contains(&p.name.as_str()));
        let xyz_at = [find(&["x"]), find(&["y"]), find(&["z"])];
        let corners_at = find(&["vertex_indices", "vertex_index"]);
        if element.properties.is_empty() && element.count > 0 {
            return Err(source.error(format!("element `{}` has no properties", element.name)));
        }
        if is("vertex") && xyz_at.contains(&None) {
            return Err(source.error("the element `vertex` needs the properties x, y and z"));
        }
        if is("face") && corners_at.is_none_or(|i| element.properties[i].count.is_none()) {
            return Err(source.error("the element `face` needs the list vertex_indices"));
        }
        for _ in 0..element.count {
            let mut xyz = [0.0; 3];
            for (i, property) in element.properties.iter().enumerate() {
                list.clear();
                let n = match property.count {
                    None => 1,
                    Some(count) => whole(&mut source, count, encoding, "the length of a list")?,
                };
                for _ in 0..n {
                    if is("face") && corners_at == Some(i) {
                        list.push(corner(&mut source, property.value, encoding, surface.points.len())?);
                    } else {
                        let value = scalar(&mut source, property.value, encoding)?;
                        if let Some(k) = xyz_at.iter().position(|&at| at == Some(i)) {
                            xyz[k] = value;
                        }
                    }
                }
                if is("face") && corners_at == Some(i) {
                    if n < 3 {
                        return Err(source.error(format!("a face of {n} corners; at least 3 are needed")));
                    }
                    push_polygon(&mut surface.triangles, &list);
                }
            }
            if is("vertex") {
                surface.points.push(point(&source, xyz, unit)?);
            }
        }
    }
    let rest = &source.bytes[source.at..];
    if !(rest.is_empty() || encoding == Encoding::Text && rest.trim_ascii().is_empty()) {
        return Err(source.error(format!(
            "{} bytes follow the last element; the counts of the header are wrong",
            rest.len()
        )));
    }
    Ok(used_only(surface))
}

fn header(source: &mut Source) -> Result<(Encoding, Vec<Element>), MeshError> {
    if source.line()? != Some("ply") {
        return Err(source.error("a PLY file begins with the line `ply`"));
    }
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let Some(line) = source.line()? else {
            return Err(source.error("the file ends before `end_header`"));
        };
        let words: Vec<&str> = line.split_ascii_whitespace().take(6).collect();
        match words[..] {
            [] | ["comment" | "obj_info", ..] => {}
            ["format", "ascii", "1.0"] => encoding = Some(Encoding::Text),
            ["format", "binary_little_endian", "1.0"] => encoding = Some(Encoding::Little),
            ["format", "binary_big_endian", "1.0"] => encoding = Some(Encoding::Big),
            ["element", name, count] => {
                let count = count
                    .parse()
                    .map_err(|_| source.error(format!("`{}` is not a count", shorten(count))))?;
                elements.push(Element { name: name.into(), count, properties: Vec::new() });
            }
            ["property", "list", count, value, name] => {
                let property = Property {
                    name: name.into(),
                    value: kind(source, value)?,
                    count: Some(kind(source, count)?),
                };
                last(source, &mut elements)?.properties.push(property);
            }
            ["property", value, name] => {
                let property = Property { name: name.into(), value: kind(source, value)?, count: None };
                last(source, &mut elements)?.properties.push(property);
            }
            ["end_header"] => break,
            _ => return Err(source.error(format!("`{}` is not understood", shorten(line)))),
        }
    }
    let Some(encoding) = encoding else {
        return Err(
            source.error("the header has no line `format ascii|binary_little_endian|binary_big_endian 1.0`")
        );
    };
    // Faces name vertices that come before them.
    let place = |name: &str| elements.iter().position(|e| e.name == name);
    match (place("vertex"), place("face")) {
        (Some(v), Some(f)) if v < f => Ok((encoding, elements)),
        _ => Err(source.error("the elements `vertex` and `face` are needed, in this order")),
    }
}

fn last<'e>(source: &Source, elements: &'e mut [Element]) -> Result<&'e mut Element, MeshError> {
    elements.last_mut().ok_or_else(|| source.error("a property comes before the first element"))
}

fn kind(source: &Source, name: &str) -> Result<Scalar, MeshError> {
    Ok(match name {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => return Err(source.error(format!("`{}` is not a PLY type", shorten(name)))),
    })
}

/// Next number of the body; every type fits into a double.
fn scalar(source: &mut Source, kind: Scalar, encoding: Encoding) -> Result<f64, MeshError> {
    macro_rules! binary {
        ($type:ty) => {{
            let bytes = source.take()?;
            f64::from(if encoding == Encoding::Little {
                <$type>::from_le_bytes(bytes)
            } else {
                <$type>::from_be_bytes(bytes)
            })
        }};
    }
    if encoding == Encoding::Text {
        return source.parse("a number");
    }
    Ok(match kind {
        Scalar::I8 => binary!(i8),
        Scalar::U8 => binary!(u8),
        Scalar::I16 => binary!(i16),
        Scalar::U16 => binary!(u16),
        Scalar::I32 => binary!(i32),
        Scalar::U32 => binary!(u32),
        Scalar::F32 => binary!(f32),
        Scalar::F64 => binary!(f64),
    })
}

/// Next number of the body as a whole number from 0 to 2³² - 1.
fn whole(source: &mut Source, kind: Scalar, encoding: Encoding, what: &str) -> Result<u32, MeshError> {
    let value = scalar(source, kind, encoding)?;
    if matches!(kind, Scalar::F32 | Scalar::F64)
        || !(value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0)
    {
        return Err(source.error(format!("{what} must be a whole number of an integer type, found {value}")));
    }
    Ok(value as u32)
}

/// Next number of the body as a point that exists.
fn corner(source: &mut Source, kind: Scalar, encoding: Encoding, n_points: usize) -> Result<u32, MeshError> {
    let corner = whole(source, kind, encoding, "a vertex number")?;
    if corner as usize >= n_points {
        return Err(
            source.error(format!("vertex {corner} does not exist; the file has {n_points} (counted from 0)"))
        );
    }
    Ok(corner)
}
