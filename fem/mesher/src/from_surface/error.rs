//! Why a surface gives no sections.

use std::path::PathBuf;

use thiserror::Error;

use fem::geometry::SurfaceError;
use fem::mesh::MeshError;

/// A surface that gives no sections, or a folder of surfaces that does not hold what is asked for.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SectionError {
    /// A surface that is not sound, or cannot be read.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The table of ends cannot be read.
    #[error(transparent)]
    Table(#[from] MeshError),
    /// The folder cannot be read.
    #[error("{}: {source}", folder.display())]
    Io {
        /// The folder.
        folder: PathBuf,
        /// What the operating system answered.
        #[source]
        source: std::io::Error,
    },
    /// No file has the name of this muscle or bone.
    #[error("{what} `{name}`: {} has no surface of that name; it has: {found}", folder.display())]
    Unknown {
        /// `muscle` or `bone`.
        what: &'static str,
        /// The name asked for.
        name: String,
        /// The folder.
        folder: PathBuf,
        /// Names of the surfaces there are.
        found: String,
    },
    /// Two files of one name.
    #[error("{} and {} have the same name; keep one of them", first.display(), second.display())]
    TwoFiles {
        /// One file.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// The surface in this file gives no sections.
    #[error("{}: {reason}", file.display())]
    InFile {
        /// The file.
        file: PathBuf,
        /// Why not.
        #[source]
        reason: Box<SectionError>,
    },
    /// A patch without points, or with points that the surface lacks.
    #[error(
        "{muscle}: the {end} patch has {given} points of which the surface holds {held}; give points 0 to {last}"
    )]
    Patch {
        /// Name of the muscle.
        muscle: String,
        /// `origin` or `insertion`.
        end: &'static str,
        /// Points given.
        given: usize,
        /// Points among them that there are.
        held: usize,
        /// Number of the last point of the surface.
        last: usize,
    },
    /// Origin and insertion are the same part of the surface.
    #[error(
        "{muscle}: origin and insertion patch share point {point} at {at:.6?} m; choose patches that are apart"
    )]
    SharedEnds {
        /// Name of the muscle.
        muscle: String,
        /// A common point.
        point: u32,
        /// Its coordinates \[m\].
        at: [f64; 3],
    },
    /// No loft can be made of the level lines.
    #[error(
        "{muscle}: the surface cannot be mapped to sections at {at:.6?} m: {reason}; give other end patches, or close holes and \
         cut off branches there"
    )]
    Unmappable {
        /// Name of the muscle.
        muscle: String,
        /// Where: centre of the section \[m\].
        at: [f64; 3],
        /// Why.
        reason: String,
    },
}
