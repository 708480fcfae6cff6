//! Faces, surfaces and node sets: what follows from connectivity alone.

use super::{CellBlock, CellKind, Mesh, MeshError};
use std::collections::BTreeMap;

/// Faces of a hexahedron, outward; order of the Abaqus labels S1 to S6.
const HEX_FACES: [[usize; 4]; 6] =
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
/// Faces of a tetrahedron, outward; order of the Abaqus labels S1 to S4. The last node is repeated.
const TET_FACES: [[usize; 4]; 4] = [[0, 2, 1, 1], [0, 1, 3, 3], [1, 2, 3, 3], [2, 0, 3, 3]];
/// Faces of a wedge, outward; order of the Abaqus labels S1 to S5.
const WEDGE_FACES: [[usize; 4]; 5] = [[0, 2, 1, 1], [3, 4, 5, 5], [0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]];

impl CellKind {
    /// Nodes of a cell of this kind.
    pub fn n_nodes(self) -> usize {
        match self {
            CellKind::Hex8 => 8,
            CellKind::Tet4 | CellKind::Quad4 => 4,
            CellKind::Tet10 => 10,
            CellKind::Wedge6 => 6,
            CellKind::Tri3 => 3,
            CellKind::Line2 => 2,
        }
    }

    /// Name in lower case, e.g. `hex8`.
    pub fn name(self) -> &'static str {
        match self {
            CellKind::Hex8 => "hex8",
            CellKind::Tet4 => "tet4",
            CellKind::Tet10 => "tet10",
            CellKind::Wedge6 => "wedge6",
            CellKind::Quad4 => "quad4",
            CellKind::Tri3 => "tri3",
            CellKind::Line2 => "line2",
        }
    }

    /// Has a volume.
    pub fn is_solid(self) -> bool {
        matches!(self, CellKind::Hex8 | CellKind::Tet4 | CellKind::Tet10 | CellKind::Wedge6)
    }

    /// Corner nodes of the faces as local indices, seen from outside counter-clockwise; a triangle repeats its
    /// last node. A quadrilateral or triangle is its own face; a line has none.
    pub fn faces(self) -> &'static [[usize; 4]] {
        match self {
            CellKind::Hex8 => &HEX_FACES,
            CellKind::Tet4 | CellKind::Tet10 => &TET_FACES,
            CellKind::Wedge6 => &WEDGE_FACES,
            CellKind::Quad4 => &[[0, 1, 2, 3]],
            CellKind::Tri3 => &[[0, 1, 2, 2]],
            CellKind::Line2 => &[],
        }
    }
}

impl CellBlock {
    /// Number of cells.
    pub fn n_cells(&self) -> usize {
        self.nodes.len() / self.kind.n_nodes()
    }

    /// Node indices of every cell.
    pub fn cells(&self) -> std::slice::ChunksExact<'_, u32> {
        self.nodes.chunks_exact(self.kind.n_nodes())
    }

    /// Nodes of face `face` of cell `cell`.
    pub fn face(&self, cell: usize, face: usize) -> [u32; 4] {
        let n = self.kind.n_nodes();
        self.kind.faces()[face].map(|i| self.nodes[cell * n + i])
    }

    /// Faces that belong to one cell of the block only, outward, in the order of the cells.
    ///
    /// For quadrilaterals and triangles: the cells themselves.
    pub fn boundary(&self) -> Result<Vec<[u32; 4]>, MeshError> {
        let n_faces = self.kind.faces().len();
        if !self.kind.is_solid() {
            return Ok((0..self.n_cells() * n_faces).map(|cell| self.face(cell, 0)).collect());
        }
        let mut faces: Vec<([u32; 4], usize)> = (0..self.n_cells() * n_faces)
            .map(|id| (face_key(self.face(id / n_faces, id % n_faces)), id))
            .collect();
        faces.sort_unstable();
        let mut outer = Vec::new();
        for shared in faces.chunk_by(|a, b| a.0 == b.0) {
            match shared {
                [(_, id)] => outer.push(*id),
                [] | [_, _] => {}
                [(_, id), ..] => {
                    let (cell, nodes) = (id / n_faces, self.face(id / n_faces, id % n_faces));
                    return Err(MeshError::NonManifold { block: self.name.clone(), cell, nodes });
                }
            }
        }
        outer.sort_unstable();
        Ok(outer.into_iter().map(|id| self.face(id / n_faces, id % n_faces)).collect())
    }
}

impl Mesh {
    /// The block of this name.
    pub fn block(&self, name: &str) -> Result<&CellBlock, MeshError> {
        self.blocks
            .iter()
            .find(|b| b.name == name)
            .ok_or_else(|| unknown("block", name, self.blocks.iter().map(|b| &b.name)))
    }

    /// The node set of this name.
    pub fn node_set(&self, name: &str) -> Result<&[u32], MeshError> {
        let found = self.node_sets.get(name).map(Vec::as_slice);
        found.ok_or_else(|| unknown("node set", name, self.node_sets.keys()))
    }

    /// The surface of this name.
    pub fn surface(&self, name: &str) -> Result<&[[u32; 4]], MeshError> {
        let found = self.surfaces.get(name).map(Vec::as_slice);
        found.ok_or_else(|| unknown("surface", name, self.surfaces.keys()))
    }

    /// Number of cells in all blocks.
    pub fn n_cells(&self) -> usize {
        self.blocks.iter().map(CellBlock::n_cells).sum()
    }

    /// Removes nodes that belong to no cell and returns how many there were. Sets and surfaces follow; faces that lose a
    /// node go with it.
    ///
    /// Node indices out of range stay out of range, for [`Mesh::check`] to report.
    pub fn remove_unused_nodes(&mut self) -> usize {
        let mut used = vec![false; self.points.len()];
        for &node in self.blocks.iter().flat_map(|b| &b.nodes) {
            if let Some(used) = used.get_mut(node as usize) {
                *used = true;
            }
        }
        self.keep_nodes(&used)
    }

    /// Removes the nodes that `keep` says false of and returns how many there were.
    pub(crate) fn keep_nodes(&mut self, keep: &[bool]) -> usize {
        const GONE: u32 = u32::MAX;
        let mut n_kept = 0;
        let new_index: Vec<u32> = keep
            .iter()
            .map(|&kept| {
                n_kept += u32::from(kept);
                if kept { n_kept - 1 } else { GONE }
            })
            .collect();
        let n_removed = keep.len() - n_kept as usize;
        if n_removed == 0 {
            return 0;
        }
        let map = |node: u32| new_index.get(node as usize).copied().unwrap_or(GONE);
        let mut kept = keep.iter();
        self.points.retain(|_| *kept.next().unwrap_or(&true));
        self.blocks.iter_mut().flat_map(|b| &mut b.nodes).for_each(|n| *n = map(*n));
        for set in self.node_sets.values_mut() {
            set.iter_mut().for_each(|n| *n = map(*n));
            set.retain(|&n| n != GONE);
        }
        for faces in self.surfaces.values_mut() {
            faces.iter_mut().for_each(|face| *face = face.map(map));
            faces.retain(|face| !face.contains(&GONE));
        }
        n_removed
    }
}

/// Nodes of a list of faces or cells: sorted, each once.
pub fn unique_nodes(nodes: impl IntoIterator<Item = u32>) -> Vec<u32> {
    let mut set: Vec<u32> = nodes.into_iter().collect();
    set.sort_unstable();
    set.dedup();
    set
}

/// Edges of a surface, the lower node first, with the numbers of faces that pass it from that node on and back again: one each
/// inside a surface of one orientation, one in all on its rim.
pub fn edge_counts(faces: &[[u32; 4]]) -> BTreeMap<[u32; 2], [u32; 2]> {
    let mut edges = BTreeMap::<[u32; 2], [u32; 2]>::new();
    for f in faces {
        for (a, b) in (0..4).map(|k| (f[k], f[(k + 1) % 4])).filter(|(a, b)| a != b) {
            edges.entry([a.min(b), a.max(b)]).or_default()[usize::from(a > b)] += 1;
        }
    }
    edges
}

/// A face as a key that does not depend on where it starts or which way it turns. Triangles end with `u32::MAX`.
pub(crate) fn face_key([a, b, c, d]: [u32; 4]) -> [u32; 4] {
    let mut key = [a, b, c, if c == d { u32::MAX } else { d }];
    key.sort_unstable();
    key
}

fn unknown<'a>(what: &'static str, name: &str, known: impl Iterator<Item = &'a String>) -> MeshError {
    let known: Vec<_> = known.map(|n| format!("`{n}`")).collect();
    let known = if known.is_empty() { "none".into() } else { known.join(", ") };
    MeshError::Unknown { what, name: name.into(), known }
}
