//! A time series for ParaView: `NAME.pvd` beside `NAME_0000.vtu`, `NAME_0001.vtu`, …, or, where a step has parts, `NAME_0000_PART.vtu`.
//!
//! The collection is rewritten after every step, whole, so that ParaView can follow a simulation as it runs
//! ("Reload files") and a killed run leaves every step that was finished.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use super::vtu::Field;
use super::{vtu_write, write_whole};
use crate::mesh::{Mesh, MeshError};

/// A part of a step: cells of one kind with the fields that they have.
#[derive(Clone, Debug)]
pub struct Part {
    /// Name, which the file has too.
    pub name: &'static str,
    /// Points where they are in the step \[m\], and cells.
    pub mesh: Mesh,
    /// Values at the points.
    pub point_data: Vec<Field<'static>>,
    /// Values in the cells.
    pub cell_data: Vec<Field<'static>>,
}

/// Writes steps as they come.
#[derive(Debug)]
pub struct PvdWriter {
    folder: PathBuf,
    name: String,
    /// Time, and files of the parts with their names.
    steps: Vec<(f64, Vec<(String, &'static str)>)>,
}

impl PvdWriter {
    /// Starts the series `folder/name.pvd`, empty; makes the folder.
    pub fn create(folder: &Path, name: &str) -> Result<PvdWriter, MeshError> {
        if name.is_empty() || name.starts_with('.') || name.contains(['/', '\\', ':']) {
            let reason = "it must be a plain file name";
            return Err(MeshError::Name { file: folder.into(), name: name.into(), reason });
        }
        std::fs::create_dir_all(folder).map_err(|source| MeshError::Io { file: folder.into(), source })?;
        let writer = PvdWriter { folder: folder.into(), name: name.into(), steps: Vec::new() };
        writer.write_collection()?;
        Ok(writer)
    }

    /// Writes the next step and then the collection with it. `time` in s (or the load factor); fields as in [`super::vtu::write`].
    pub fn push(
        &mut self,
        time: f64,
        mesh: &Mesh,
        point_data: &[Field],
        cell_data: &[Field],
    ) -> Result<PathBuf, MeshError> {
        let file_name = format!("{}_{:04}.vtu", self.name, self.steps.len());
        let file = self.folder.join(&file_name);
        vtu_write::write(&file, mesh, point_data, cell_data)?;
        self.steps.push((time, vec![(file_name, "")]));
        self.write_collection()?;
        Ok(file)
    }

    /// Writes the next step in parts and then the collection with it. Of steps of the same time the collection names the last.
    pub fn push_parts(&mut self, time: f64, parts: &[Part]) -> Result<(), MeshError> {
        let stem = format!("{}_{:04}", self.name, self.steps.len());
        let files = write_parts(&self.folder, &stem, parts)?;
        self.steps.push((time, files));
        self.write_collection()
    }

    /// Writes a state that belongs to no series: `NAME_LABEL.pvd` with the files of its parts.
    pub fn write_apart(&self, label: &str, time: f64, parts: &[Part]) -> Result<(), MeshError> {
        let name = format!("{}_{label}", self.name);
        let steps = vec![(time, write_parts(&self.folder, &name, parts)?)];
        PvdWriter { folder: self.folder.clone(), name, steps }.write_collection()
    }

    fn write_collection(&self) -> Result<(), MeshError> {
        let mut text = String::from(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"LittleEndian\">\n<Collection>\n",
        );
        for (i, (time, files)) in self.steps.iter().enumerate() {
            if self.steps[i + 1..].iter().any(|later| later.0 == *time) {
                continue;
            }
            for (part, (file, name)) in files.iter().enumerate() {
                let file = quick_xml::escape::escape(file);
                writeln!(
                    text,
                    "<DataSet timestep=\"{time}\" group=\"\" part=\"{part}\" name=\"{name}\" file=\"{file}\"/>"
                )
                .expect("a string takes any text");
            }
        }
        text.push_str("</Collection>\n</VTKFile>\n");
        write_whole(&self.folder.join(format!("{}.pvd", self.name)), text.as_bytes())
    }
}

/// Writes `STEM_PART.vtu` for every part; the names of the files and of the parts.
fn write_parts(folder: &Path, stem: &str, parts: &[Part]) -> Result<Vec<(String, &'static str)>, MeshError> {
    let write = |part: &Part| {
        let file = format!("{stem}_{}.vtu", part.name);
        vtu_write::write(&folder.join(&file), &part.mesh, &part.point_data, &part.cell_data)?;
        Ok((file, part.name))
    };
    parts.iter().map(write).collect()
}
