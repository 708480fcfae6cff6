//! What can be wrong with a mesh or a mesh file, with the place and the remedy.

use std::fmt;
use std::path::PathBuf;

use thiserror::Error;

/// A mesh that cannot be used, or a mesh file that cannot be read or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The file could not be opened, read, written or renamed.
    #[error("{}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// What the operating system answered.
        #[source]
        source: std::io::Error,
    },
    /// The file does not follow its format, or uses a part of it that is not supported.
    #[error("{}, {place}: {}", file.display(), with_remedy(reason))]
    Format {
        /// The file.
        file: PathBuf,
        /// Where in the file.
        place: Place,
        /// What is wrong and how to mend it. Where it does not say how, the message adds what always helps.
        reason: String,
    },
    /// The name of the file does not say what format it has.
    #[error("{}: unknown mesh format; known endings: .msh (Gmsh 2.2, 4.1), .inp (Abaqus), .vtu (VTK XML)", file.display())]
    UnknownFormat {
        /// The file.
        file: PathBuf,
    },
    /// A name that the target format cannot carry.
    #[error("the name `{name}` cannot be written to {}: {reason}", file.display())]
    Name {
        /// The file to be written.
        file: PathBuf,
        /// Name of the block, set or surface.
        name: String,
        /// What the format asks of names.
        reason: &'static str,
    },
    /// An array of values that does not fit the mesh.
    #[error(
        "field `{name}`: {found} values, but {expected} are needed ({components} for each point or cell)"
    )]
    FieldLength {
        /// Name of the field.
        name: String,
        /// Values per point or cell.
        components: usize,
        /// Values given.
        found: usize,
        /// Values needed.
        expected: usize,
    },
    /// A muscle or bone of which it is unknown which segment carries it.
    #[error(
        "`{name}` has no {what} in the table of attachments, so it is unknown which segment carries it; add a row"
    )]
    Unattached {
        /// Muscle or bone.
        name: String,
        /// What is missing.
        what: String,
    },
    /// A muscle whose sections cannot be inset.
    #[error("`{name}` cannot be inset by {} mm, station {station}: {reason}; give a smaller inset", by * 1e3)]
    Inset {
        /// Muscle.
        name: String,
        /// How far \[m\].
        by: f64,
        /// First section that would not be one.
        station: usize,
        /// Why.
        reason: String,
    },
    /// A mesh without cells.
    #[error("the mesh has no cells; export it with its elements")]
    Empty,
    /// More nodes than 32-bit indices can name.
    #[error("{n_nodes} nodes are more than 32-bit node indices can name; coarsen the mesh")]
    TooManyNodes {
        /// Number of nodes.
        n_nodes: usize,
    },
    /// Two blocks of one name.
    #[error("two blocks are named `{block}`; block names must be unique")]
    DuplicateBlock {
        /// Name of the block.
        block: String,
    },
    /// A block whose list of nodes does not divide into whole cells.
    #[error(
        "block `{block}`: {n_indices} node indices do not divide into cells of {n_nodes} nodes; export the mesh again"
    )]
    RaggedBlock {
        /// Name of the block.
        block: String,
        /// Length of its list of nodes.
        n_indices: usize,
        /// Nodes of one cell.
        n_nodes: usize,
    },
    /// A coordinate that is NaN or infinite.
    #[error("node {node} has the coordinates {point:?} m; all must be finite")]
    NotFinite {
        /// Index of the node.
        node: usize,
        /// Its coordinates \[m\].
        point: [f64; 3],
    },
    /// A cell that names a node the mesh lacks.
    #[error(
        "block `{block}`, cell {cell}: node {node} does not exist (the mesh has {n_nodes} nodes, counted from 0); mend the cell"
    )]
    NodeOutOfRange {
        /// Name of the block.
        block: String,
        /// Index of the cell in the block.
        cell: usize,
        /// The node index.
        node: u32,
        /// Number of nodes of the mesh.
        n_nodes: usize,
    },
    /// A cell that uses one node twice.
    #[error("block `{block}`, cell {cell}: node {node} is used twice; collapsed cells are not supported")]
    RepeatedNode {
        /// Name of the block.
        block: String,
        /// Index of the cell in the block.
        cell: usize,
        /// The node index.
        node: u32,
    },
    /// A solid cell that is turned inside out somewhere.
    #[error(
        "block `{block}`, cell {cell}: det of the map from the parent cell is {det:.3e} at Gauss point {point} \
         (must be positive): inverted, flat, or numbered in the wrong order"
    )]
    Inverted {
        /// Name of the block.
        block: String,
        /// Index of the cell in the block.
        cell: usize,
        /// Index of the Gauss point.
        point: usize,
        /// The determinant \[m³\]; NaN where coordinates overflow.
        det: f64,
    },
    /// A line without length or a face without area.
    #[error("block `{block}`, cell {cell}: length or area is {size:.3e}, must be positive and finite")]
    Degenerate {
        /// Name of the block.
        block: String,
        /// Index of the cell in the block.
        cell: usize,
        /// Length \[m\] or area \[m²\].
        size: f64,
    },
    /// Nodes that belong to no cell: they would float freely.
    #[error(
        "{count} nodes belong to no cell, the first is node {first}; remove them (`Mesh::remove_unused_nodes`)"
    )]
    UnusedNodes {
        /// How many.
        count: usize,
        /// Index of the first.
        first: usize,
    },
    /// A node set that is not sorted, not unique or names a node the mesh lacks.
    #[error(
        "node set `{set}`: entry {entry} (node {node}) is out of range, out of order or doubled; mend the set"
    )]
    NodeSet {
        /// Name of the set.
        set: String,
        /// Position in the set.
        entry: usize,
        /// The node index.
        node: u32,
    },
    /// A face of a named surface that is not a triangle or quadrilateral of existing nodes.
    #[error(
        "surface `{surface}`, face {face}: {nodes:?} is not a triangle (last node repeated) or quadrilateral of existing nodes; mend the surface"
    )]
    SurfaceFace {
        /// Name of the surface.
        surface: String,
        /// Index of the face.
        face: usize,
        /// Its node indices.
        nodes: [u32; 4],
    },
    /// A face that belongs to more than two cells.
    #[error(
        "block `{block}`, cell {cell}: its face {nodes:?} belongs to more than two cells; remove doubled cells"
    )]
    NonManifold {
        /// Name of the block.
        block: String,
        /// One of the cells.
        cell: usize,
        /// Nodes of the face.
        nodes: [u32; 4],
    },
    /// A block, node set or surface that the mesh lacks.
    #[error("the mesh has no {what} `{name}`; it has: {known}")]
    Unknown {
        /// `block`, `node set` or `surface`.
        what: &'static str,
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
}

/// A reason that ends in a remedy: its own after a semicolon or in a question, else what always helps. What it quotes says neither.
fn with_remedy(reason: &str) -> String {
    let has_own = reason.split('`').step_by(2).any(|said| said.contains("; ") || said.contains('?'));
    match has_own {
        true => reason.to_string(),
        false => format!("{reason}; repair the file there, or export it again"),
    }
}

/// Where in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Line, counted from 1.
    Line(usize),
    /// Byte, counted from 0 (binary parts).
    Byte(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Byte(byte) => write!(f, "byte {byte}"),
        }
    }
}
