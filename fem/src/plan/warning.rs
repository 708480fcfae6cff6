//! What may be meant in a scene and its mesh, but hardly is: computed on, and said.

use super::contact::ContactSurface;
use crate::mesh::quality::corner_dets;
use crate::mesh::{LengthUnit, Mesh};
use crate::plan::{EmbeddedRegion, Motion};
use crate::scene::{ForceSpec, Scene};

/// Something that can be computed on and is probably a mistake, or that the answer depends on.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// Cells whose map is inverted at a corner, though not where it is integrated.
    CornerInverted {
        /// Their block.
        block: String,
        /// The cells.
        cells: Vec<usize>,
    },
    /// A mesh too large to be a body.
    Large {
        /// Its greatest extent \[m\].
        extent: f64,
    },
    /// A mesh too small for its unit.
    Small {
        /// Its greatest extent \[m\].
        extent: f64,
    },
    /// A contact surface with a rim.
    Open {
        /// The surface.
        surface: String,
        /// Number of edges of its rim.
        n_edges: usize,
        /// Nodes of one of them.
        nodes: [u32; 2],
    },
    /// Cubes of a grid that hold what does not hang together there.
    Divided {
        /// The region in the grid.
        region: String,
        /// Centres of the cubes in the mesh \[m\].
        cubes: Vec<[f64; 3]>,
    },
    /// A force on a node that is held or moved in its direction: the support takes it, and nothing deforms.
    HeldForce {
        /// The force.
        name: String,
        /// The node.
        node: u32,
        /// How many of its nodes are so.
        count: usize,
    },
}

/// Extent \[m\] beyond which a mesh is no body: the specimens of 10 mm and more that people mesh are larger than that where mm are read as m.
const LARGE: f64 = 10.0;
/// Extent \[m\] below which a mesh in mm is a body in m: 2 m, divided by a thousand.
const SMALL: f64 = 2e-3;

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Warning::CornerInverted { block, cells } => {
                let some: Vec<String> = cells.iter().take(10).map(ToString::to_string).collect();
                let more = if cells.len() > some.len() { ", ..." } else { "" };
                write!(
                    f,
                    "`{block}`: {} cells are inverted at a corner, though not at their Gauss points: {}{more}; displacements hardly feel \
                     it, stress near there is not to be trusted; mend the mesh",
                    cells.len(),
                    some.join(", ")
                )
            }
            Warning::Large { extent } => {
                write!(
                    f,
                    "the mesh is {extent:.3} m long; if its file is in mm, add `mesh_unit = \"mm\"` to the scene"
                )
            }
            Warning::Small { extent } => write!(
                f,
                "the mesh is {:.4} mm long; if its file is in m, remove `mesh_unit = \"mm\"` from the scene",
                extent * 1e3
            ),
            Warning::Open { surface, n_edges, nodes: [a, b] } => write!(
                f,
                "contact surface `{surface}` is open, with {n_edges} edges on its rim, one between nodes {a} and {b}: what lies behind its \
                 faces counts as inside, what lies beside its rim does not; close it where something can come round the rim"
            ),
            Warning::Divided { region, cubes } => {
                let [x, y, z] = cubes.first().map_or([f64::NAN; 3], |c| c.map(|x| x * 1e3));
                write!(
                    f,
                    "embedded `{region}`: {} cubes hold pieces that do not hang together there, the first about ({x:.1}, {y:.1}, {z:.1}) mm; each \
                     piece moves by itself; take smaller cubes where one body was meant",
                    cubes.len()
                )
            }
            Warning::HeldForce { name, node, count } => write!(
                f,
                "force `{name}` acts on {count} nodes that are held or moved there, node {node} first: their supports take it, and nothing \
                 deforms; nodes are counted from 0 in the order of the mesh file, whatever numbers that gives them"
            ),
        }
    }
}

/// Warnings about a mesh and its unit.
pub fn of_mesh(scene: &Scene, mesh: &Mesh) -> Vec<Warning> {
    let mut warnings = Vec::new();
    for block in mesh.blocks.iter().filter(|b| b.kind.is_solid()) {
        let bad =
            |nodes: &[u32]| !corner_dets(block.kind, &mesh.corners(nodes)).into_iter().all(|det| det > 0.0);
        let cells: Vec<usize> =
            block.cells().enumerate().filter(|(_, n)| bad(n)).map(|(cell, _)| cell).collect();
        if !cells.is_empty() {
            warnings.push(Warning::CornerInverted { block: block.name.clone(), cells });
        }
    }
    let extent = |c: usize| {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        mesh.points.iter().for_each(|p| (low, high) = (low.min(p[c]), high.max(p[c])));
        high - low
    };
    let extent = (0..3).map(extent).fold(0.0, f64::max);
    if extent > LARGE {
        warnings.push(Warning::Large { extent });
    } else if extent < SMALL && scene.mesh_unit == LengthUnit::Millimetre {
        warnings.push(Warning::Small { extent });
    }
    warnings
}

/// Warnings about forces on what is prescribed.
pub fn of_forces(scene: &Scene, motion: &[[Motion; 3]]) -> Vec<Warning> {
    let held = |(node, force): &&(u32, [f64; 3])| {
        let motion = motion.get(*node as usize);
        motion.is_some_and(|m| (0..3).any(|c| force[c] != 0.0 && !m[c].is_unknown()))
    };
    let of = |force: &ForceSpec| {
        let mut nodes = force.loads.iter().filter(held);
        let (node, _) = nodes.next()?;
        Some(Warning::HeldForce { name: force.name.clone(), node: *node, count: 1 + nodes.count() })
    };
    scene.forces.iter().filter_map(of).collect()
}

/// A warning about a grid whose cubes hold more than one piece.
pub fn of_grid(grid: &EmbeddedRegion) -> Option<Warning> {
    let EmbeddedRegion { region, divided, .. } = grid;
    (!divided.is_empty()).then(|| Warning::Divided { region: region.clone(), cubes: divided.clone() })
}

/// A warning about a contact surface that is open.
pub fn of_surface(surface: &ContactSurface) -> Option<Warning> {
    let nodes = *surface.rim.first()?;
    Some(Warning::Open { surface: surface.name.clone(), n_edges: surface.rim.len(), nodes })
}
