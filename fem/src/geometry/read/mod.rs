//! Surface files: STL, OBJ and PLY.
//!
//! Every reader works on the bytes of one file, follows no reference to another file, and answers damage with
//! [`crate::mesh::MeshError::Format`]; memory stays below forty times the file plus 64 KiB.

pub mod obj;
pub mod ply;
pub mod stl;

use std::path::Path;

use super::{Surface, SurfaceError, surface::cut};
use crate::mesh::LengthUnit;
use crate::mesh::MeshError;
use crate::mesh::format::read_bytes;
use crate::mesh::format::source::Source;

impl Surface {
    /// Reads `.stl`, `.obj` or `.ply`, by the ending of the name. Points of no triangle are left out.
    ///
    /// `unit`: length unit of the coordinates in the file. Call [`Surface::check`] before computing on the result, or read
    /// with [`Surface::read_checked`].
    pub fn read(file: &Path, unit: LengthUnit) -> Result<Surface, SurfaceError> {
        let parse = match file.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("stl") => stl::parse,
            Some("obj") => obj::parse,
            Some("ply") => ply::parse,
            _ => return Err(SurfaceError::UnknownFormat { file: file.into() }),
        };
        Ok(parse(&read_bytes(file)?, file, unit)?)
    }

    /// Reads a file and refuses a surface that is not sound, naming the file.
    pub fn read_checked(file: &Path, unit: LengthUnit) -> Result<Surface, SurfaceError> {
        Surface::read_if(file, unit, Surface::check)
    }

    /// The same of an open sheet ([`Surface::check_sheet`]).
    pub fn read_sheet(file: &Path, unit: LengthUnit) -> Result<Surface, SurfaceError> {
        Surface::read_if(file, unit, Surface::check_sheet)
    }

    fn read_if(
        file: &Path,
        unit: LengthUnit,
        check: fn(&Surface) -> Result<(), SurfaceError>,
    ) -> Result<Surface, SurfaceError> {
        let surface = Surface::read(file, unit)?;
        match check(&surface) {
            Ok(()) => Ok(surface),
            Err(reason) => Err(SurfaceError::InFile { file: file.into(), reason: Box::new(reason) }),
        }
    }
}

/// A point of a file in m; refuses what is not finite.
fn point(source: &Source, xyz: [f64; 3], unit: LengthUnit) -> Result<[f64; 3], MeshError> {
    if xyz.iter().all(|x| x.is_finite()) {
        Ok(xyz.map(|x| unit.to_metre(x)))
    } else {
        Err(source.error(format!("the coordinates {xyz:?} must be finite; remove or repair this vertex")))
    }
}

/// The triangles of a polygon of at least three points: a quadrilateral along the diagonal of its smallest number, more
/// points as a fan.
fn push_polygon(triangles: &mut Vec<[u32; 3]>, polygon: &[u32]) {
    match *polygon {
        [a, b, c, d] if c != d => triangles.extend(cut([a, b, c, d]).into_iter().flatten()),
        [first, ref rest @ ..] => triangles.extend(rest.windows(2).map(|w| [first, w[0], w[1]])),
        [] => {}
    }
}

/// Without the points of no triangle.
fn used_only(surface: Surface) -> Surface {
    let mut used = vec![false; surface.points.len()];
    surface.triangles.iter().flatten().for_each(|&p| used[p as usize] = true);
    if used.iter().all(|&u| u) {
        return surface;
    }
    let all: Vec<u32> = (0..).take(surface.triangles.len()).collect();
    surface.subset(&all).0
}
