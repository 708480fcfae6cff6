//! Writes a unit.

use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use crate::description::{Description, IDENTIFIER};
use crate::error::UnitError;
use crate::model::Model;
use crate::resources::Resources;

/// Folder of the library in a unit, and its file name, for the machine that this is compiled for (FMI 3.0, 2.5.1.4).
pub fn library_name() -> Result<String, UnitError> {
    let (architecture, system) = (std::env::consts::ARCH, std::env::consts::OS);
    let (system, ending) = match system {
        "linux" => ("linux", "so"),
        "macos" => ("darwin", "dylib"),
        "windows" => ("windows", "dll"),
        other => {
            return Err(UnitError::Wrong(format!(
                "no units are written on {other}, only on Linux, macOS and Windows"
            )));
        }
    };
    Ok(format!("binaries/{architecture}-{system}/{IDENTIFIER}.{ending}"))
}

/// The shared library of this crate: beside the program, where `cargo build` and packages put it, or in `deps` below, where cargo puts the
/// libraries of what it builds along.
pub fn find_library() -> Result<PathBuf, UnitError> {
    let program = std::env::current_exe()
        .map_err(|e| UnitError::Wrong(format!("the program does not know where it lies: {e}")))?;
    let name = format!("{}{IDENTIFIER}{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let folder = program.parent().unwrap_or(Path::new(""));
    // Tests of cargo lie in `deps` themselves.
    let places = [folder.join("deps").join(&name), folder.join(&name)];
    // The newer one, where both are: cargo leaves old ones behind.
    let age = |path: &PathBuf| std::fs::metadata(path).and_then(|m| m.modified()).ok();
    places.iter().filter(|p| p.is_file()).max_by_key(|p| age(p)).cloned().ok_or_else(|| {
        UnitError::Wrong(format!(
            "the library that a unit carries, {name}, is neither in {} nor in its folder deps; run `cargo build --release` in the repository and take its sartorius, or copy the library from target/release/deps beside the program",
            folder.display()
        ))
    })
}

/// The bytes of a unit: with the same library and resources always the same.
pub fn unit(
    description: &Description,
    model: &Model,
    library: &[u8],
    resources: &Resources,
) -> Result<Vec<u8>, UnitError> {
    let bad = |e: &dyn std::fmt::Display| UnitError::Wrong(format!("the unit cannot be written: {e}"));
    let xml = description.xml(model).map_err(|e| bad(&e))?;
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    // The time in the archive is the first that it can hold.
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .last_modified_time(zip::DateTime::default());
    let mut add = |name: &str, content: &[u8]| -> Result<(), UnitError> {
        zip.start_file(name, options).map_err(|e| bad(&e))?;
        zip.write_all(content).map_err(|e| bad(&e))
    };
    add("modelDescription.xml", xml.as_bytes())?;
    add(&library_name()?, library)?;
    for (name, content) in &resources.files {
        add(&format!("resources/{name}"), content)?;
    }
    Ok(zip.finish().map_err(|e| bad(&e))?.into_inner())
}
