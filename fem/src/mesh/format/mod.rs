//! Mesh files: Gmsh 2.2 and 4.1, Abaqus `.inp` and VTK XML (`.vtu`, `.pvd`).
//!
//! Every reader works on the bytes of one file, follows no reference to another file, and answers damage with
//! [`MeshError::Format`]; memory stays below ten times the file plus 64 MiB.

pub mod abaqus;
mod abaqus_keywords;
mod abaqus_write;
pub mod gmsh;
pub mod pvd;
pub(crate) mod source;
pub mod vtu;
mod vtu_array;
mod vtu_field;
mod vtu_write;

use std::io::Write;
use std::path::{Path, PathBuf};

use super::{CellBlock, CellKind, Mesh, MeshError};

/// What a length of 1 in a file means. Inside, lengths are in m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
pub enum LengthUnit {
    /// Metre.
    #[default]
    #[serde(rename = "m")]
    Metre,
    /// Millimetre.
    #[serde(rename = "mm")]
    Millimetre,
}

impl LengthUnit {
    /// A length of the file in m.
    pub fn to_metre(self, length: f64) -> f64 {
        match self {
            LengthUnit::Metre => length,
            LengthUnit::Millimetre => length / 1000.0, // the nearest double to the decimal number
        }
    }
}

/// Format of a mesh file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `.msh`
    Gmsh,
    /// `.inp`
    Abaqus,
    /// `.vtu`
    Vtu,
}

impl Format {
    /// By the ending of the name.
    pub fn of(file: &Path) -> Option<Format> {
        let ending = file.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        match ending.as_deref() {
            Some("msh") => Some(Format::Gmsh),
            Some("inp") => Some(Format::Abaqus),
            Some("vtu") => Some(Format::Vtu),
            _ => None,
        }
    }
}

impl Mesh {
    /// Reads `.msh` (Gmsh 2.2, 4.1), `.inp` (Abaqus) or `.vtu` (VTK), by the ending of the name.
    ///
    /// `unit`: length unit of the coordinates in the file. Call [`Mesh::check`] before computing on the result.
    pub fn read(file: &Path, unit: LengthUnit) -> Result<Mesh, MeshError> {
        match Format::of(file) {
            Some(Format::Gmsh) => gmsh::parse(&read_bytes(file)?, file, unit),
            Some(Format::Abaqus) => abaqus::parse(&read_bytes(file)?, file, unit),
            Some(Format::Vtu) => Ok(vtu::parse(&read_bytes(file)?, file, unit)?.mesh),
            None => Err(MeshError::UnknownFormat { file: file.into() }),
        }
    }
}

/// Adds cells to the block of this name and kind; a name taken by cells of another kind gets the kind appended.
fn push_cells(mesh: &mut Mesh, name: &str, kind: CellKind, nodes: Vec<u32>) {
    let taken = mesh.blocks.iter().any(|b| b.name == name && b.kind != kind);
    let name = if taken { format!("{name}_{}", kind.name()) } else { name.to_owned() };
    match mesh.blocks.iter_mut().find(|b| b.name == name && b.kind == kind) {
        Some(block) => block.nodes.extend(nodes),
        None => mesh.blocks.push(CellBlock { name, kind, nodes }),
    }
}

/// The bytes of a file.
pub(crate) fn read_bytes(file: &Path) -> Result<Vec<u8>, MeshError> {
    std::fs::read(file).map_err(|source| MeshError::Io { file: file.into(), source })
}

/// Writes a file under a temporary name beside it, then renames: a reader sees the old file or the whole new one.
pub(crate) fn write_whole(file: &Path, bytes: &[u8]) -> Result<(), MeshError> {
    let mut name = file.file_name().unwrap_or_default().to_os_string();
    name.push(".part");
    let part: PathBuf = file.with_file_name(name);
    let write = || {
        let mut out = std::fs::File::create(&part)?;
        out.write_all(bytes)?;
        out.sync_all()?; // the rename must not reach the disk before the contents
        std::fs::rename(&part, file)
    };
    write().map_err(|source| MeshError::Io { file: file.into(), source })
}
