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
    /// A node whose constraints in several directions contradict each other.
    #[error(
        "node {node}: {first} and {second} prescribe different things along one direction; keep one, or take the node out of one set"
    )]
    Contradiction {
        /// The node.
        node: u32,
        /// One part of the scene.
        first: String,
        /// The other.
        second: String,
    },
    /// A plane of which no node can lead the others.
    #[error(
        "plane `{nodes}`: every node of the set is prescribed along its normal or slides on a roller; leave one of them free"
    )]
    NoLeader {
        /// The set.
        nodes: String,
    },
    /// A grid whose cubes do not suit the region that is to be embedded in it.
    #[error("embedded `{region}`: cubes of {:.6} mm {why}", cell * 1e3)]
    Cube {
        /// The region.
        region: String,
        /// Edge of a cube \[m\].
        cell: f64,
        /// What is wrong with them, and what to do.
        why: String,
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
        "{user}: the rim of the surface {how} at the edge between nodes {} and {}, where pressure on an open surface has no potential; \
         close the surface there, hold its rim, or let the rim of each opening slide in the plane of that opening",
        nodes[0], nodes[1]
    )]
    OpenRim {
        /// Which part of the scene.
        user: String,
        /// The edge of the rim.
        nodes: [u32; 2],
        /// How it leaves the plane of the opening.
        how: &'static str,
    },
    /// A surface whose faces do not all look to the same side.
    #[error(
        "{user}: the faces beside the edge between nodes {} and {} turn opposite ways; order their nodes so that all normals point out of \
         the solid",
        nodes[0], nodes[1]
    )]
    Orientation {
        /// Which part of the scene.
        user: String,
        /// The edge.
        nodes: [u32; 2],
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
    /// Surfaces that count as touching, as they are so close, and cannot be moved apart.
    #[error(
        "contact: surfaces closer than {:.3} mm, a tenth of the contact distance, count as touching and are moved apart by that, which is \
         not possible here: {}; lower `distance` ({:.3} mm now) to ten times the gap or less, or exclude the pairs",
        gap * 1e3, pairs.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "), distance * 1e3
    )]
    TooClose {
        /// Pairs with their gaps.
        pairs: Vec<crate::contact::Overlap>,
        /// Gap \[m\] below which surfaces are moved apart.
        gap: f64,
        /// The contact distance \[m\].
        distance: f64,
    },
    /// A contact surface that branches.
    #[error(
        "{user}: {} faces meet at the edge between nodes {} and {}, so that there is no inside; split the surface or mend it",
        n_faces, nodes[0], nodes[1]
    )]
    Branching {
        /// Which part of the scene.
        user: String,
        /// The edge.
        nodes: [u32; 2],
        /// Number of faces that have it.
        n_faces: u32,
    },
    /// A face of a contact surface that is a line or a point.
    #[error(
        "{user}: the face over nodes {} has a triangle without area at ({:.6e}, {:.6e}, {:.6e}) m, so that it has no outside; merge its nodes \
         that lie on each other, or move them apart",
        nodes.map(|n| n.to_string()).join(", "), place[0], place[1], place[2]
    )]
    FlatFace {
        /// Which part of the scene.
        user: String,
        /// Nodes of the face; the last of a triangle twice.
        nodes: [u32; 4],
        /// A corner of the triangle \[m\].
        place: [f64; 3],
    },
    /// A set without nodes.
    #[error(
        "{user} names the node set `{name}`, which is empty; name nodes in it, or leave it out of the scene"
    )]
    EmptySet {
        /// Which part of the scene.
        user: String,
        /// The set.
        name: String,
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
    /// More than one mistake.
    #[error("{} mistakes:\n- {}", .0.len(), .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n- "))]
    Several(Vec<SceneError>),
    /// A pose for a body whose pose the solver finds.
    #[error(
        "drive: the body `{body}` is free, its pose is found and not given; take it out of the drive, or out of `free_bodies`"
    )]
    FreePose {
        /// The body.
        body: String,
    },
    /// A free body where inertia is asked for.
    #[error(
        "free body `{body}` has no mass, so that nothing is known of how it moves in time; leave out `inertia`, or prescribe the body"
    )]
    Massless {
        /// The body.
        body: String,
    },
    /// Contact between two surfaces neither of which deforms.
    #[error("contact between `{}` and `{}`: both are rigid, so that nothing says how stiff the layer between them is; add `stiffness` [Pa] to `contact`", pair[0], pair[1])]
    RigidPair {
        /// The surfaces.
        pair: [String; 2],
    },
    /// Nothing to simulate.
    #[error("the scene has no solids, fibres, membranes or strands; nothing can deform")]
    Empty,
}

/// Mistakes as they are found, so that all are named at once.
#[derive(Default)]
pub(crate) struct Mistakes(Vec<SceneError>);

impl Mistakes {
    /// Adds a mistake, but not what was said before: parts of a plan share names of the scene.
    pub fn add(&mut self, mistake: SceneError) {
        let all = match mistake {
            SceneError::Several(all) => all,
            one => vec![one],
        };
        for one in all {
            let says = one.to_string();
            if self.0.iter().all(|old| old.to_string() != says) {
                self.0.push(one);
            }
        }
    }

    /// The value; where there is none its mistake is added.
    pub fn keep<T>(&mut self, result: Result<T, SceneError>) -> Option<T> {
        result.map_err(|mistake| self.add(mistake)).ok()
    }

    /// Whether none was found.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The only mistake, or [`SceneError::Several`].
    pub fn into_error(mut self) -> SceneError {
        match self.0.len() {
            1 => self.0.remove(0),
            _ => SceneError::Several(self.0),
        }
    }

    /// An error where any mistake was found.
    pub fn end(self) -> Result<(), SceneError> {
        if self.is_empty() { Ok(()) } else { Err(self.into_error()) }
    }
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
