//! Writes Abaqus input files that [`super::abaqus::parse`] reads back to the identical mesh.

use std::collections::{BTreeSet, HashMap};
use std::fmt::Write;
use std::path::Path;

use super::write_whole;
use crate::mesh::topology::face_key;
use crate::mesh::{CellKind, Mesh, MeshError};

/// Writes `mesh` as an Abaqus input file in m: nodes, elements by block, node sets, surfaces.
///
/// Faces of solid cells are written under their labels (`S1` …), others as surface elements (`SFM3D4`, `SFM3D3`).
/// Coordinates are written with as many digits as the double needs.
pub fn write(file: &Path, mesh: &Mesh) -> Result<(), MeshError> {
    write_whole(file, text(file, mesh)?.as_bytes())
}

fn text(file: &Path, mesh: &Mesh) -> Result<String, MeshError> {
    check_names(file, mesh)?;
    let mut out = String::from("*HEADING\nlengths in m\n*NODE\n");
    for (i, [x, y, z]) in mesh.points.iter().enumerate() {
        add(&mut out, format_args!("{}, {x:e}, {y:e}, {z:e}\n", i + 1));
    }
    let mut element = 0;
    for block in &mesh.blocks {
        add(
            &mut out,
            format_args!("*ELEMENT, TYPE={}, ELSET={}\n", type_name(block.kind), quoted(&block.name)),
        );
        for nodes in block.cells() {
            element += 1;
            add(&mut out, format_args!("{element}"));
            add_list(&mut out, nodes);
        }
    }
    for (name, nodes) in &mesh.node_sets {
        add(&mut out, format_args!("*NSET, NSET={}\n", quoted(name)));
        for nodes in nodes.chunks(16) {
            let labels: Vec<String> = nodes.iter().map(|n| (n + 1).to_string()).collect();
            add(&mut out, format_args!("{}\n", labels.join(", ")));
        }
    }
    let faces = faces_of_solids(mesh);
    for (name, surface) in &mesh.surfaces {
        let labels: Option<Vec<_>> = surface
            .iter()
            .map(|face| faces.get(&face_key(*face)).filter(|found| found.nodes == *face))
            .collect();
        if let Some(labels) = labels {
            add(&mut out, format_args!("*SURFACE, TYPE=ELEMENT, NAME={}\n", quoted(name)));
            for found in labels {
                add(&mut out, format_args!("{}, S{}\n", found.element, found.face));
            }
            continue;
        }
        // Runs of equal shape, so that reading keeps the order of the faces.
        for run in surface.chunk_by(|a, b| (a[2] == a[3]) == (b[2] == b[3])) {
            let n = if run[0][2] == run[0][3] { 3 } else { 4 };
            add(&mut out, format_args!("*ELEMENT, TYPE=SFM3D{n}, ELSET={}\n", quoted(name)));
            for face in run {
                element += 1;
                add(&mut out, format_args!("{element}"));
                add_list(&mut out, &face[..n]);
            }
        }
    }
    Ok(out)
}

/// A name with anything but letters, digits and `_-.` needs quotes in Abaqus.
fn quoted(name: &str) -> String {
    let plain = name.chars().all(|c| c.is_ascii_alphanumeric() || "_-.".contains(c));
    if plain { name.to_owned() } else { format!("\"{name}\"") }
}

/// Writing to a string cannot fail.
fn add(out: &mut String, text: std::fmt::Arguments) {
    out.write_fmt(text).expect("a string takes any text");
}

fn add_list(out: &mut String, nodes: &[u32]) {
    nodes.iter().for_each(|n| add(out, format_args!(", {}", n + 1)));
    out.push('\n');
}

fn type_name(kind: CellKind) -> &'static str {
    match kind {
        CellKind::Hex8 => "C3D8",
        CellKind::Tet4 => "C3D4",
        CellKind::Tet10 => "C3D10",
        CellKind::Wedge6 => "C3D6",
        CellKind::Quad4 => "M3D4",
        CellKind::Tri3 => "M3D3",
        CellKind::Line2 => "T3D2",
    }
}

struct Face {
    nodes: [u32; 4],
    element: usize,
    face: usize,
}

/// Faces of all solid cells by their face_key nodes; of two cells that share one, the first.
fn faces_of_solids(mesh: &Mesh) -> HashMap<[u32; 4], Face> {
    let mut faces = HashMap::new();
    if mesh.surfaces.is_empty() {
        return faces;
    }
    let mut element = 0;
    for block in &mesh.blocks {
        for cell in 0..block.n_cells() {
            element += 1;
            let n_faces = if block.kind.is_solid() { block.kind.faces().len() } else { 0 };
            for face in 0..n_faces {
                let nodes = block.face(cell, face);
                faces.entry(face_key(nodes)).or_insert(Face { nodes, element, face: face + 1 });
            }
        }
    }
    faces
}

fn check_names(file: &Path, mesh: &Mesh) -> Result<(), MeshError> {
    let refuse = |name: &str, reason| Err(MeshError::Name { file: file.into(), name: name.into(), reason });
    let blocks: Vec<&str> = mesh.blocks.iter().map(|b| b.name.as_str()).collect();
    let sets = mesh.node_sets.keys().map(String::as_str).collect();
    let surfaces = mesh.surfaces.keys().map(String::as_str).collect();
    for names in [blocks, sets, surfaces] {
        let mut seen = BTreeSet::new();
        for name in names {
            if name.is_empty() || name.trim() != name || name.contains(['"', ',', '=', '\n', '\r']) {
                return refuse(
                    name,
                    "it must not be empty, begin or end with a blank, or contain \" , = or a line end",
                );
            }
            if !seen.insert(name.to_ascii_uppercase()) {
                return refuse(
                    name,
                    "Abaqus does not tell capital and small letters apart, and wants it only once",
                );
            }
        }
    }
    Ok(())
}
