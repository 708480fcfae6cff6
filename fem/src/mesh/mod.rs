//! Meshes: nodes, cells in blocks of one kind, named regions and surfaces.
//!
//! [`Mesh::read`] takes Gmsh, Abaqus and VTU files; [`Mesh::check`] refuses what cannot be computed on;
//! [`generate`] makes blocks, bars, spheres and cylinders; [`mod@format`] holds the file formats and the writers.

mod check;
mod error;
pub mod format;
pub mod generate;
mod prolongation;
pub mod quality;
mod topology;

pub use error::{MeshError, Place};
pub use format::LengthUnit;
pub use prolongation::Prolongation;
pub use topology::{edge_counts, unique_nodes};

/// Shape of a cell. Node order follows VTK (which FEBio, Abaqus and Gmsh share for these linear cells;
/// tet10 of Gmsh swaps its last two nodes).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum CellKind {
    /// Trilinear hexahedron, 8 nodes.
    Hex8,
    /// Linear tetrahedron, 4 nodes.
    Tet4,
    /// Quadratic tetrahedron, 10 nodes.
    Tet10,
    /// Linear wedge (triangular prism), 6 nodes.
    Wedge6,
    /// Bilinear quadrilateral, 4 nodes (membrane or surface).
    Quad4,
    /// Linear triangle, 3 nodes (surface).
    Tri3,
    /// Straight line of two nodes (truss, strand).
    Line2,
}

/// Cells of one kind, stored one after the other.
#[derive(Clone, Debug, PartialEq)]
pub struct CellBlock {
    /// Name of the region, e.g. `rectus_femoris`; unique in the mesh.
    pub name: String,
    /// Shape of every cell of the block.
    pub kind: CellKind,
    /// Node indices, `kind.n_nodes()` per cell.
    pub nodes: Vec<u32>,
}

/// A mesh; lengths in m once read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Node coordinates \[m\].
    pub points: Vec<[f64; 3]>,
    /// Cells by region.
    pub blocks: Vec<CellBlock>,
    /// Named sets of nodes, e.g. `proximal_end`; sorted, unique.
    pub node_sets: std::collections::BTreeMap<String, Vec<u32>>,
    /// Named surfaces as quadrilaterals or triangles (a triangle repeats its last node), seen from outside
    /// counter-clockwise.
    pub surfaces: std::collections::BTreeMap<String, Vec<[u32; 4]>>,
}
