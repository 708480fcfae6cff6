//! Is a mesh fit to compute on?
#![allow(non_snake_case)]

use nalgebra::Vector3;

use super::{CellBlock, CellKind, Mesh, MeshError, quality};

impl Mesh {
    /// Refuses, naming block and cell: empty meshes, doubled block names, node indices out of range, nodes repeated in
    /// a cell, coordinates that are not finite, solid cells that are not positive at every Gauss point, lines and faces
    /// without size, nodes of no cell, sets and surfaces that name nodes the mesh lacks.
    pub fn check(&self) -> Result<(), MeshError> {
        let n_nodes = self.points.len();
        if u32::try_from(n_nodes).is_err() {
            return Err(MeshError::TooManyNodes { n_nodes });
        }
        if self.n_cells() == 0 {
            return Err(MeshError::Empty);
        }
        if let Some(node) = self.points.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(MeshError::NotFinite { node, point: self.points[node] });
        }
        let mut used = vec![false; n_nodes];
        for (i, block) in self.blocks.iter().enumerate() {
            if self.blocks[..i].iter().any(|b| b.name == block.name) {
                return Err(MeshError::DuplicateBlock { block: block.name.clone() });
            }
            self.check_block(block, &mut used)?;
        }
        if let Some(first) = used.iter().position(|used| !used) {
            return Err(MeshError::UnusedNodes { count: used.iter().filter(|used| !**used).count(), first });
        }
        self.check_names()
    }

    fn check_block(&self, block: &CellBlock, used: &mut [bool]) -> Result<(), MeshError> {
        let name = || block.name.clone();
        let n = block.kind.n_nodes();
        if !block.nodes.len().is_multiple_of(n) {
            return Err(MeshError::RaggedBlock { block: name(), n_indices: block.nodes.len(), n_nodes: n });
        }
        for (cell, nodes) in block.cells().enumerate() {
            for (i, &node) in nodes.iter().enumerate() {
                let Some(used) = used.get_mut(node as usize) else {
                    let n_nodes = self.points.len();
                    return Err(MeshError::NodeOutOfRange { block: name(), cell, node, n_nodes });
                };
                *used = true;
                if nodes[..i].contains(&node) {
                    return Err(MeshError::RepeatedNode { block: name(), cell, node });
                }
            }
            let corners = self.corners(nodes);
            if block.kind.is_solid() {
                for (point, (det, _)) in quality::gauss_dets(block.kind, &corners).into_iter().enumerate() {
                    if !(det > 0.0 && det.is_finite()) {
                        return Err(MeshError::Inverted { block: name(), cell, point, det });
                    }
                }
            } else {
                let size = length_or_area(block.kind, &corners);
                if !(size > 0.0 && size.is_finite()) {
                    return Err(MeshError::Degenerate { block: name(), cell, size });
                }
            }
        }
        Ok(())
    }

    fn check_names(&self) -> Result<(), MeshError> {
        let n_nodes = self.points.len();
        for (set, nodes) in &self.node_sets {
            for (entry, &node) in nodes.iter().enumerate() {
                if node as usize >= n_nodes || (entry > 0 && nodes[entry - 1] >= node) {
                    return Err(MeshError::NodeSet { set: set.clone(), entry, node });
                }
            }
        }
        for (surface, faces) in &self.surfaces {
            for (face, &nodes) in faces.iter().enumerate() {
                let [a, b, c, d] = nodes;
                let distinct = a != b && a != c && b != c && d != a && d != b;
                if !distinct || nodes.iter().any(|&n| n as usize >= n_nodes) {
                    return Err(MeshError::SurfaceFace { surface: surface.clone(), face, nodes });
                }
            }
        }
        Ok(())
    }
}

/// Length of a line \[m\], area of the mean plane of a face \[m²\].
fn length_or_area(kind: CellKind, X: &[Vector3<f64>]) -> f64 {
    match kind {
        CellKind::Line2 => (X[1] - X[0]).norm(),
        CellKind::Tri3 => (X[1] - X[0]).cross(&(X[2] - X[0])).norm() / 2.0,
        _ => (X[2] - X[0]).cross(&(X[3] - X[1])).norm() / 2.0,
    }
}
