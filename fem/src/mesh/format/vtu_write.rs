//! Writes `.vtu` files: appended raw data, zlib-compressed.

use std::fmt::Write;
use std::io::Write as _;
use std::path::Path;

use rayon::prelude::*;

use super::vtu_field::{CELL_TYPES, Field};
use super::write_whole;
use crate::mesh::{CellKind, Mesh, MeshError};

/// Bytes of one compressed block.
const BLOCK_BYTES: usize = 1 << 18;

/// Writes mesh, point data and cell data as a `.vtu` file, under a temporary name until it is whole.
///
/// `point_data`: values per point; `cell_data`: values per cell in the order of the blocks. The array `block` (index of the block)
/// and the names of blocks, node sets and surfaces are added, so that [`super::vtu::parse`] gives the identical mesh.
pub fn write(file: &Path, mesh: &Mesh, point_data: &[Field], cell_data: &[Field]) -> Result<(), MeshError> {
    write_whole(file, &to_bytes(mesh, point_data, cell_data)?)
}

/// The XML so far, and the data it points into.
struct Writer {
    xml: String,
    data: Vec<u8>,
}

pub(super) fn to_bytes(mesh: &Mesh, point_data: &[Field], cell_data: &[Field]) -> Result<Vec<u8>, MeshError> {
    let (n_points, n_cells) = (mesh.points.len(), mesh.n_cells());
    for (fields, count) in [(point_data, n_points), (cell_data, n_cells)] {
        for Field { name, components, values } in fields {
            let expected = components * count;
            if values.len() != expected {
                let (name, found) = (name.to_string(), values.len());
                return Err(MeshError::FieldLength { name, components: *components, found, expected });
            }
        }
    }
    let mut out = Writer { xml: String::new(), data: Vec::new() };
    out.text(concat!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" ",
        "header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\">\n<UnstructuredGrid>\n<FieldData>\n"
    ));
    for (i, block) in mesh.blocks.iter().enumerate() {
        let note = [i as u32, vtk_type(block.kind).into()];
        out.ints(&format!("block:{}", block.name), 1, true, note.into_iter());
    }
    for (name, nodes) in &mesh.node_sets {
        out.ints(&format!("node_set:{name}"), 1, true, nodes.iter().copied());
    }
    for (name, faces) in &mesh.surfaces {
        out.ints(&format!("surface:{name}"), 4, true, faces.iter().flatten().copied());
    }
    out.text(&format!(
        "</FieldData>\n<Piece NumberOfPoints=\"{n_points}\" NumberOfCells=\"{n_cells}\">\n<PointData>\n"
    ));
    point_data.iter().for_each(|f| out.floats(&f.name, f.components, f.values.iter().copied()));
    out.text("</PointData>\n<CellData>\n");
    cell_data.iter().for_each(|f| out.floats(&f.name, f.components, f.values.iter().copied()));
    let blocks = mesh.blocks.iter().enumerate();
    out.ints("block", 1, false, blocks.flat_map(|(i, b)| std::iter::repeat_n(i as u32, b.n_cells())));
    out.text("</CellData>\n<Points>\n");
    out.floats("Points", 3, mesh.points.iter().flatten().copied());
    out.text("</Points>\n<Cells>\n");
    let nodes = mesh.blocks.iter().flat_map(|b| b.cells().flatten());
    out.ints("connectivity", 1, false, nodes.copied());
    let sizes = mesh.blocks.iter().flat_map(|b| std::iter::repeat_n(b.kind.n_nodes() as i64, b.n_cells()));
    let offsets = sizes.scan(0i64, |end, size| {
        *end += size;
        Some(*end)
    });
    out.array("offsets", "Int64", 1, false, offsets.flat_map(i64::to_le_bytes).collect());
    let types = mesh.blocks.iter().flat_map(|b| std::iter::repeat_n(vtk_type(b.kind), b.n_cells()));
    out.array("types", "UInt8", 1, false, types.collect());
    out.text("</Cells>\n</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_");
    let mut bytes = out.xml.into_bytes();
    bytes.append(&mut out.data);
    bytes.extend_from_slice(b"\n</AppendedData>\n</VTKFile>\n");
    Ok(bytes)
}

impl Writer {
    fn text(&mut self, text: &str) {
        self.xml.push_str(text);
    }

    fn floats(&mut self, name: &str, components: usize, values: impl Iterator<Item = f64>) {
        self.array(name, "Float64", components, false, values.flat_map(f64::to_le_bytes).collect());
    }

    fn ints(&mut self, name: &str, components: usize, field: bool, values: impl Iterator<Item = u32>) {
        self.array(name, "UInt32", components, field, values.flat_map(u32::to_le_bytes).collect());
    }

    fn array(&mut self, name: &str, number: &str, components: usize, field: bool, bytes: Vec<u8>) {
        let size = match number {
            "UInt8" => 1,
            "UInt32" => 4,
            _ => 8,
        };
        let name = quick_xml::escape::escape(name);
        let offset = self.data.len();
        let tuples = bytes.len() / size / components;
        let tuples = if field { format!(" NumberOfTuples=\"{tuples}\"") } else { String::new() };
        writeln!(
            self.xml,
            "<DataArray type=\"{number}\" Name=\"{name}\" NumberOfComponents=\"{components}\"{tuples} format=\"appended\" offset=\"{offset}\"/>"
        )
        .expect("a string takes any text");
        let packed: Vec<Vec<u8>> = bytes.par_chunks(BLOCK_BYTES).map(zlib).collect();
        let partial = bytes.len() % BLOCK_BYTES;
        let header = [packed.len(), BLOCK_BYTES, partial];
        for word in header.into_iter().chain(packed.iter().map(Vec::len)) {
            self.data.extend_from_slice(&(word as u64).to_le_bytes());
        }
        packed.iter().for_each(|block| self.data.extend_from_slice(block));
    }
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).and_then(|()| encoder.finish()).expect("a vector takes any bytes")
}

fn vtk_type(kind: CellKind) -> u8 {
    CELL_TYPES.iter().find(|t| t.1 == kind).map_or(0, |t| t.0 as u8)
}
