//! Hexahedral blocks of muscles, from cross-sections or from closed surfaces, and solid tendons that grow from their ends.
//!
//! [`MuscleSections`] say what a muscle looks like, a [`Loft`] is its surface, [`grid`] fills it with layers of hexahedra whose
//! third index direction runs from origin to insertion, the fibre direction.

pub mod attachment;
mod bones;
mod build;
mod draft;
pub mod fibres;
pub mod from_surface;
pub mod grid;
mod inset;
mod lbfgs;
pub mod limb;
mod loft;
pub mod part;
pub mod scale;
mod sections;
mod separate;
mod shape;
pub mod smooth;
mod table;
pub mod tendon;

use nalgebra::Vector3;

use fem::mesh::{CellBlock, CellKind, Mesh, unique_nodes};

pub use bones::Bone;
pub use build::{BoneCrossing, Built, GOALS, Goals, MuscleResult, build, loft_volume, mesh_end, sampled};
pub use draft::draft;
pub use loft::{Loft, LoftPoint};
pub use part::MusclePart;
pub use sections::{CORNERS, MuscleSections, N_OUTLINE, Station};

/// The hexahedra of one muscle: the same mesh of a cross-section in every layer of nodes, from origin to insertion.
#[derive(Clone, Debug, PartialEq)]
pub struct MuscleBlock {
    /// Name, e.g. `rectus_femoris`.
    pub name: String,
    /// Node coordinates \[m\], layer by layer: node `layer * nodes_per_section + local`.
    pub points: Vec<[f64; 3]>,
    /// Nodes of one layer.
    pub nodes_per_section: usize,
    /// Quadrilaterals of one layer in local node numbers, counter-clockwise about the fibre direction.
    pub section_cells: Vec<[u32; 4]>,
    /// Local numbers of the boundary nodes of a layer, counter-clockwise about the fibre direction.
    pub outline: Vec<u32>,
    /// Where each of them started on the outline of the loft, 0..14 with the corners at 0, 5, 7 and 12; increasing.
    pub outline_parameter: Vec<f64>,
    /// Fraction of the muscle's line per layer, from 0 at the origin.
    pub s: Vec<f64>,
}

impl MuscleBlock {
    /// Layers of nodes; one more than layers of cells.
    pub fn n_layers(&self) -> usize {
        self.s.len()
    }

    /// Index in `points` of a node of a layer.
    pub fn node(&self, layer: usize, local: u32) -> u32 {
        (layer * self.nodes_per_section) as u32 + local
    }

    /// Coordinates of a node of a layer \[m\].
    pub fn point(&self, layer: usize, local: u32) -> Vector3<f64> {
        Vector3::from(self.points[self.node(layer, local) as usize])
    }

    /// Hexahedra in the node order of VTK, layer by layer in the order of `section_cells`; the edges 0-4, 1-5, 2-6 and 3-7
    /// run along the fibres.
    pub fn cells(&self) -> impl Iterator<Item = [u32; 8]> + '_ {
        (0..self.n_layers() - 1).flat_map(move |layer| {
            self.section_cells.iter().map(move |&[a, b, c, d]| {
                let low = [a, b, c, d].map(|n| self.node(layer, n));
                let high = [a, b, c, d].map(|n| self.node(layer + 1, n));
                [low[0], low[1], low[2], low[3], high[0], high[1], high[2], high[3]]
            })
        })
    }

    /// Number of hexahedra.
    pub fn n_cells(&self) -> usize {
        self.section_cells.len() * (self.n_layers() - 1)
    }

    /// Faces of the end at the origin (`layer` 0) or at the insertion (the last), seen from outside counter-clockwise.
    pub fn end_faces(&self, layer: usize) -> Vec<[u32; 4]> {
        let outward = |[a, b, c, d]: [u32; 4]| if layer == 0 { [a, d, c, b] } else { [a, b, c, d] };
        self.section_cells.iter().map(|&cell| outward(cell).map(|n| self.node(layer, n))).collect()
    }

    /// Faces of the lateral surface, seen from outside counter-clockwise; layer by layer in the order of `outline`.
    pub fn side_faces(&self) -> Vec<[u32; 4]> {
        let n = self.outline.len();
        let mut faces = Vec::with_capacity(n * (self.n_layers() - 1));
        for layer in 0..self.n_layers() - 1 {
            for k in 0..n {
                let (a, b) = (self.outline[k], self.outline[(k + 1) % n]);
                faces.push([
                    self.node(layer, a),
                    self.node(layer, b),
                    self.node(layer + 1, b),
                    self.node(layer + 1, a),
                ]);
            }
        }
        faces
    }

    /// All boundary faces, outward: end at the origin, side, end at the insertion.
    pub fn surface(&self) -> Vec<[u32; 4]> {
        let mut faces = self.end_faces(0);
        faces.extend(self.side_faces());
        faces.extend(self.end_faces(self.n_layers() - 1));
        faces
    }

    /// Half the sum of the cross products of the diagonals of a layer's cells \[m²\]: its length is the area seen along it.
    pub fn area_vector(&self, layer: usize) -> Vector3<f64> {
        let diagonals = |&[a, b, c, d]: &[u32; 4]| {
            let p = [a, b, c, d].map(|n| self.point(layer, n));
            (p[2] - p[0]).cross(&(p[3] - p[1])) / 2.0
        };
        self.section_cells.iter().map(diagonals).sum()
    }

    /// Area of a layer, seen along its mean normal \[m²\].
    pub fn area(&self, layer: usize) -> f64 {
        self.area_vector(layer).norm()
    }

    /// Centroid of every layer, cells weighted with their area \[m\].
    pub fn centre_line(&self) -> Vec<Vector3<f64>> {
        (0..self.n_layers())
            .map(|layer| {
                let (mut sum, mut area) = (Vector3::zeros(), 0.0);
                for cell in &self.section_cells {
                    let p = cell.map(|n| self.point(layer, n));
                    let weight = (p[2] - p[0]).cross(&(p[3] - p[1])).norm();
                    sum += (p[0] + p[1] + p[2] + p[3]) * (weight / 4.0);
                    area += weight;
                }
                sum / area
            })
            .collect()
    }

    /// Volume of the hexahedra \[m³\], exact for their bilinear faces.
    pub fn volume(&self) -> f64 {
        let origin = self.point(0, self.outline[0]);
        self.surface()
            .iter()
            .map(|f| quad_volume(f.map(|n| Vector3::from(self.points[n as usize]) - origin)))
            .sum()
    }
}

/// Signed volume between a bilinear face and the origin: the mean over its two splits into triangles.
pub(crate) fn quad_volume([a, b, c, d]: [Vector3<f64>; 4]) -> f64 {
    let tet = |a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>| a.dot(&b.cross(c)) / 6.0;
    (tet(&a, &b, &c) + tet(&a, &c, &d) + tet(&a, &b, &d) + tet(&b, &c, &d)) / 2.0
}

/// The blocks as one mesh: a block of hexahedra per muscle under its name, node sets `<muscle>/origin` and `<muscle>/insertion`
/// (end layers), surface `<muscle>/surface` (closed, outward).
pub fn to_mesh(blocks: &[MuscleBlock]) -> Mesh {
    let mut mesh = Mesh::default();
    for block in blocks {
        let shift = mesh.points.len() as u32;
        mesh.points.extend(&block.points);
        let nodes = block.cells().flatten().map(|n| n + shift).collect();
        mesh.blocks.push(CellBlock { name: block.name.clone(), kind: CellKind::Hex8, nodes });
        for (end, layer) in [(MusclePart::Origin, 0), (MusclePart::Insertion, block.n_layers() - 1)] {
            let nodes =
                unique_nodes((0..block.nodes_per_section as u32).map(|n| block.node(layer, n) + shift));
            mesh.node_sets.insert(end.of(&block.name), nodes);
        }
        let faces = block.surface().into_iter().map(|face| face.map(|n| n + shift)).collect();
        mesh.surfaces.insert(MusclePart::Surface.of(&block.name), faces);
    }
    mesh
}
