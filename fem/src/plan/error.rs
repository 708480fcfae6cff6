//! What can be wrong with a scene.

use thiserror::Error;

/// A mistake in a scene, found before anything is computed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The scene file cannot be read.
    #[error("scene `{path}`: {source}")]
    Read {
        /// The file.
        path: std::path::PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The scene file is no scene.
    #[error("scene `{path}`: {source}")]
    Parse {
        /// The file.
        path: std::path::PathBuf,
        /// Line, column and what was expected.
        source: Box<toml::de::Error>,
    },
    /// The mesh cannot be read or computed on.
    #[error(transparent)]
    Mesh(#[from] crate::mesh::MeshError),
    /// A scene file without a mesh.
    #[error("scene `{path}` names no mesh; add `mesh = \"FILE\"`")]
    NoMesh {
        /// The file.
        path: std::path::PathBuf,
    },
    /// A name that the mesh or the plan lacks.
    #[error("{user} names the {what} `{name}`, which is missing; nearest: {nearest}")]
    Unknown {
        /// Which part of the scene.
        user: String,
        /// Block, node set, surface, control, body.
        what: &'static str,
        /// The name.
        name: String,
        /// Names like it.
        nearest: String,
    },
    /// A law that needs fibres along mesh edges.
    #[error(
        "{user}: its law needs the length of whole fibres; let them follow a region of lines, or choose another law"
    )]
    NotEmbedded {
        /// Which part of the scene.
        user: String,
    },
    /// Two things that must not have the same name.
    #[error("{what} `{name}` is there twice; rename one")]
    Twice {
        /// Kind of thing.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A number that cannot be.
    #[error("{user}: {quantity} is {value}, must be {must}")]
    Value {
        /// Which part of the scene.
        user: String,
        /// The quantity with its unit.
        quantity: String,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// A list of the wrong length.
    #[error("{user}: {quantity} has {found} entries, needs {needed}")]
    Count {
        /// Which part of the scene.
        user: String,
        /// The list.
        quantity: &'static str,
        /// Its length.
        found: usize,
        /// What it should be.
        needed: String,
    },
    /// Cells of a kind that the effect cannot use.
    #[error("{user}: block `{block}` holds {found:?} cells, needs {needed}")]
    Kind {
        /// Which part of the scene.
        user: String,
        /// The block.
        block: String,
        /// Its cells.
        found: crate::mesh::CellKind,
        /// Kinds that would do.
        needed: &'static str,
    },
    /// An element with a bad reference shape.
    #[error(
        "element {cell} in `{block}` is inverted or flat in the mesh: det(dX/dxi) = {det:.2e} m^3; mend the mesh or the node order"
    )]
    Shape {
        /// The block.
        block: String,
        /// The cell.
        cell: usize,
        /// The determinant.
        det: f64,
    },
    /// A node prescribed in two ways.
    #[error("node {node}, component {component}: prescribed by both {first} and {second}; keep one")]
    Conflict {
        /// The node.
        node: u32,
        /// x, y or z.
        component: char,
        /// One part of the scene.
        first: String,
        /// The other.
        second: String,
    },
    /// An embedded point outside all solids.
    #[error("{user}: point ({x:.6}, {y:.6}, {z:.6}) m of line {line} lies in no solid cell; move it inside")]
    Outside {
        /// Which part of the scene.
        user: String,
        /// The line.
        line: usize,
        /// Coordinates \[m\].
        x: f64,
        /// Coordinates \[m\].
        y: f64,
        /// Coordinates \[m\].
        z: f64,
    },
    /// A pressure whose force would not be that of a pressure.
    #[error(
        "{user}: the rim of the surface moves freely at node {node}; close the surface, hold its rim or put the rim on rollers in planes through `origin`"
    )]
    OpenRim {
        /// Which part of the scene.
        user: String,
        /// A node of the rim.
        node: u32,
    },
    /// Surfaces overlap in the mesh.
    #[error(
        "surfaces overlap in the mesh: {}; mend the mesh, exclude the pairs, or allow a repair deeper than {:.3} mm",
        overlaps.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "), allowed * 1e3
    )]
    Overlap {
        /// Pairs and depths.
        overlaps: Vec<crate::contact::Overlap>,
        /// Depth \[m\] that would have been mended.
        allowed: f64,
    },
    /// A contact surface with a node that nothing holds.
    #[error(
        "{user}: node {node} belongs to no solid and is not prescribed; tie the surface to a body or hold it"
    )]
    Loose {
        /// Which part of the scene.
        user: String,
        /// The node.
        node: u32,
    },
    /// Nothing to simulate.
    #[error("the scene has no solids, fibres, membranes or strands; nothing can deform")]
    Empty,
}

/// The three names most like `name`, quoted.
pub(crate) fn nearest<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> String {
    let mut all: Vec<(usize, &str)> = names.map(|n| (distance(name, n), n)).collect();
    all.sort();
    match all.len() {
        0 => "there are none".to_string(),
        _ => all.iter().take(3).map(|(_, n)| format!("`{n}`")).collect::<Vec<_>>().join(", "),
    }
}

/// Number of edits between two names (Levenshtein, Soviet Physics Doklady 1966;10:707).
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let edit = (diagonal + usize::from(ca != *cb)).min(row[j] + 1).min(row[j + 1] + 1);
            diagonal = std::mem::replace(&mut row[j + 1], edit);
        }
    }
    row[b.len()]
}
