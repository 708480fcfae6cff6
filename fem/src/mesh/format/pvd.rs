//! A time series for ParaView: `NAME.pvd` beside `NAME_0000.vtu`, `NAME_0001.vtu`, …
//!
//! The collection is rewritten after every step, whole, so that ParaView can follow a simulation as it runs
//! ("Reload files") and a killed run leaves every step that was finished.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use super::vtu::Field;
use super::{vtu_write, write_whole};
use crate::mesh::{Mesh, MeshError};

/// Writes steps as they come.
#[derive(Debug)]
pub struct PvdWriter {
    folder: PathBuf,
    name: String,
    steps: Vec<(f64, String)>,
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
        self.steps.push((time, file_name));
        self.write_collection()?;
        Ok(file)
    }

    fn write_collection(&self) -> Result<(), MeshError> {
        let mut text = String::from(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"LittleEndian\">\n<Collection>\n",
        );
        for (time, file) in &self.steps {
            let file = quick_xml::escape::escape(file);
            writeln!(text, "<DataSet timestep=\"{time}\" group=\"\" part=\"0\" file=\"{file}\"/>")
                .expect("a string takes any text");
        }
        text.push_str("</Collection>\n</VTKFile>\n");
        write_whole(&self.folder.join(format!("{}.pvd", self.name)), text.as_bytes())
    }
}
