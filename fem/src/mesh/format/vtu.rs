//! VTK XML unstructured grids (`.vtu`): text, base64 and raw data, zlib-compressed or not.
//!
//! Beside points, cells and fields, the names of a [`Mesh`] travel as field data that every VTK reader passes over:
//! `block:NAME` = \[index, VTK cell type\] (with the cell array `block`), `node_set:NAME` and `surface:NAME` = node indices.
//! In files of other programs blocks come from an integer cell array `region`, `MaterialIds`, `PhysicalGroup`, `gmsh:physical` or
//! `block` (names `region_N`), else from the cell type.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};

use super::source::{Budget, format_error, shorten};
use super::vtu_array::{Array, Encoding, NumberType, Stored};
use super::{LengthUnit, push_cells, read_bytes};
use crate::mesh::{CellBlock, CellKind, Mesh, MeshError, Place};

pub use super::vtu_field::Field;
use super::vtu_field::{CELL_TYPES, VOXEL};
pub use super::vtu_write::write;

/// Contents of a `.vtu` file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Vtu {
    /// Points, cells, names.
    pub mesh: Mesh,
    /// Values at points.
    pub point_data: Vec<Field<'static>>,
    /// Values in cells, in the order of the blocks of `mesh`.
    pub cell_data: Vec<Field<'static>>,
}

/// Reads a `.vtu` file with its fields. `unit`: of the coordinates only; fields keep their values.
pub fn read(file: &Path, unit: LengthUnit) -> Result<Vtu, MeshError> {
    parse(&read_bytes(file)?, file, unit)
}

/// Reads the bytes of a `.vtu` file; `file` names it in errors.
pub fn parse(bytes: &[u8], file: &Path, unit: LengthUnit) -> Result<Vtu, MeshError> {
    let mut reader = Reader::new(bytes, file)?;
    reader.elements()?;
    reader.contents(unit, bytes.len())
}

#[derive(Clone, Copy, PartialEq)]
enum Section {
    Field,
    Point,
    Cell,
    Points,
    Cells,
}

struct Reader<'a> {
    file: &'a Path,
    /// XML up to the appended data.
    head: &'a str,
    encoding: Encoding<'a>,
    arrays: Vec<(Section, Array<'a>)>,
    /// Numbers of points and cells of the piece.
    counts: Option<(usize, usize)>,
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8], file: &'a Path) -> Result<Reader<'a>, MeshError> {
        let error = |at: usize, reason: &str| format_error(file, Place::Byte(at), reason);
        if !bytes.trim_ascii_end().ends_with(b"</VTKFile>") {
            return Err(error(
                bytes.len(),
                "the file does not end with </VTKFile>: not a VTK XML file, or cut off",
            ));
        }
        let tag = b"<AppendedData";
        let mut head = bytes;
        let mut appended = None;
        if let Some(start) = bytes.windows(tag.len()).position(|w| w == tag) {
            let mark =
                |from: usize, byte: u8| bytes[from..].iter().position(|b| *b == byte).map(|i| from + i + 1);
            let end = mark(start, b'>').ok_or_else(|| error(start, "<AppendedData …> is not closed"))?;
            let data = mark(end, b'_').ok_or_else(|| error(end, "appended data begin with `_`"))?;
            head = &bytes[..end];
            let raw = bytes[start..end].windows(5).any(|w| w == b"\"raw\"");
            appended = Some((&bytes[data..], raw));
        }
        let head = std::str::from_utf8(head)
            .map_err(|e| error(e.valid_up_to(), "not UTF-8 text; only UTF-8 VTK XML files are supported"))?;
        let encoding = Encoding { file, header64: false, big_endian: false, zlib: false, appended };
        Ok(Reader { file, head, encoding, arrays: Vec::new(), counts: None })
    }

    fn error(&self, at: usize, reason: impl Into<String>) -> MeshError {
        format_error(self.file, Place::Byte(at), reason)
    }

    fn attribute(&self, at: usize, element: &BytesStart, name: &str) -> Result<Option<String>, MeshError> {
        let attribute = element.try_get_attribute(name).map_err(|e| self.error(at, e.to_string()))?;
        let value = attribute.map(|a| a.normalized_value(XmlVersion::Implicit1_0)).transpose();
        value.map(|v| v.map(Cow::into_owned)).map_err(|e| self.error(at, e.to_string()))
    }

    fn number(&self, at: usize, element: &BytesStart, name: &str) -> Result<Option<usize>, MeshError> {
        let Some(text) = self.attribute(at, element, name)? else { return Ok(None) };
        let number = text.trim().parse().map_err(|_| {
            self.error(at, format!("{name}=\"{}\" is not a count (integer ≥ 0)", shorten(&text)))
        })?;
        Ok(Some(number))
    }

    /// Goes through the XML: notes encoding, counts, and where each array is.
    fn elements(&mut self) -> Result<(), MeshError> {
        let head: &'a str = self.head;
        let mut xml = quick_xml::Reader::from_str(head);
        xml.config_mut().expand_empty_elements = true;
        let mut section = None;
        let mut open: Option<Array<'a>> = None; // the DataArray whose text is awaited
        let mut depth_in_array = 0;
        loop {
            let at = xml.buffer_position() as usize;
            let event =
                xml.read_event().map_err(|e| self.error(xml.error_position() as usize, e.to_string()))?;
            match event {
                Event::Start(_) if open.is_some() => depth_in_array += 1, // InformationKey and the like
                Event::Start(e) => match e.name().as_ref() {
                    "VTKFile" => self.root(at, &e)?,
                    "Piece" => self.piece(at, &e)?,
                    "FieldData" => section = Some(Section::Field),
                    "PointData" => section = Some(Section::Point),
                    "CellData" => section = Some(Section::Cell),
                    "Points" => section = Some(Section::Points),
                    "Cells" => section = Some(Section::Cells),
                    "DataArray" if section.is_some() => open = Some(self.array(at, &e)?),
                    _ => {} // arrays of strings and what later versions may add
                },
                Event::Text(text) if depth_in_array == 0 => {
                    if let (Some(array), Cow::Borrowed(text)) = (&mut open, text.into_inner()) {
                        match &mut array.stored {
                            Stored::Ascii(slot) | Stored::Inline(slot) if !text.trim().is_empty() => {
                                if !slot.is_empty() {
                                    return Err(
                                        array.error(self.file, "its numbers are interrupted by markup")
                                    );
                                }
                                *slot = text;
                            }
                            _ => {}
                        }
                    }
                }
                Event::End(_) if depth_in_array > 0 => depth_in_array -= 1,
                Event::End(e) => match (e.name().as_ref(), section) {
                    ("DataArray", Some(section)) => {
                        self.arrays.extend(open.take().map(|array| (section, array)))
                    }
                    ("FieldData" | "PointData" | "CellData" | "Points" | "Cells", _) => section = None,
                    _ => {}
                },
                Event::Eof => return Ok(()),
                _ => {}
            }
        }
    }

    fn root(&mut self, at: usize, e: &BytesStart) -> Result<(), MeshError> {
        let kind = self.attribute(at, e, "type")?.unwrap_or_default();
        if kind != "UnstructuredGrid" {
            let kind = shorten(&kind);
            return Err(
                self.error(at, format!("VTK file of type `{kind}`; only `UnstructuredGrid` can be read"))
            );
        }
        self.encoding.big_endian = match self.attribute(at, e, "byte_order")?.as_deref() {
            None | Some("LittleEndian") => false,
            Some("BigEndian") => true,
            Some(other) => {
                return Err(self.error(at, format!("byte_order `{}` is not known", shorten(other))));
            }
        };
        self.encoding.header64 = match self.attribute(at, e, "header_type")?.as_deref() {
            None | Some("UInt32") => false,
            Some("UInt64") => true,
            Some(other) => {
                return Err(self.error(at, format!("header_type `{}` is not known", shorten(other))));
            }
        };
        self.encoding.zlib = match self.attribute(at, e, "compressor")?.as_deref() {
            None | Some("") => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                let other = shorten(other);
                return Err(
                    self.error(at, format!("compressor `{other}` is not supported; save with ZLib or none"))
                );
            }
        };
        Ok(())
    }

    fn piece(&mut self, at: usize, e: &BytesStart) -> Result<(), MeshError> {
        if self.counts.is_some() {
            return Err(self.error(at, "a second <Piece>: merge the pieces when saving"));
        }
        let points = self.number(at, e, "NumberOfPoints")?;
        let cells = self.number(at, e, "NumberOfCells")?;
        let (Some(points), Some(cells)) = (points, cells) else {
            return Err(self.error(at, "<Piece> needs NumberOfPoints and NumberOfCells"));
        };
        if u32::try_from(points).is_err() || u32::try_from(cells).is_err() {
            return Err(self.error(
                at,
                format!("{points} points and {cells} cells are more than 32-bit indices can name"),
            ));
        }
        self.counts = Some((points, cells));
        Ok(())
    }

    fn array(&self, at: usize, e: &BytesStart) -> Result<Array<'a>, MeshError> {
        let number = self.attribute(at, e, "type")?.unwrap_or_default();
        let number = NumberType::from_name(&number)
            .ok_or_else(|| self.error(at, format!("DataArray of the unknown type `{}`", shorten(&number))))?;
        let name = self.attribute(at, e, "Name")?.unwrap_or_default();
        let components = self.number(at, e, "NumberOfComponents")?.unwrap_or(1).max(1);
        let stored = match self.attribute(at, e, "format")?.as_deref() {
            Some("ascii") | None => Stored::Ascii(""),
            Some("binary") => Stored::Inline(""),
            Some("appended") => Stored::Appended(
                self.number(at, e, "offset")?
                    .ok_or_else(|| self.error(at, "an appended DataArray needs an offset"))?,
            ),
            Some(other) => {
                return Err(self.error(at, format!("DataArray format `{}` is not known", shorten(other))));
            }
        };
        Ok(Array { name, number, components, stored, at })
    }

    fn find(&self, section: Section, name: &str) -> Result<&Array<'a>, MeshError> {
        let mut found =
            self.arrays.iter().filter(|(s, a)| *s == section && (name.is_empty() || a.name == name));
        found.next().map(|(_, array)| array).ok_or_else(|| {
            let what =
                if name.is_empty() { "point coordinates".to_owned() } else { format!("cell array `{name}`") };
            self.error(self.head.len(), format!("the file has no {what}"))
        })
    }

    fn contents(&self, unit: LengthUnit, file_bytes: usize) -> Result<Vtu, MeshError> {
        let (n_points, n_cells) =
            self.counts.ok_or_else(|| self.error(self.head.len(), "the file has no <Piece>"))?;
        let mut budget = Budget::new(file_bytes, 7);
        let mut vtu = Vtu { mesh: self.mesh(unit, n_points, &mut budget)?, ..Vtu::default() };
        let block_of_cell = self.cells(n_points, n_cells, &mut vtu.mesh, &mut budget)?;
        self.names(n_points, &mut vtu.mesh, &mut budget)?;
        for (section, array) in &self.arrays {
            let (count, fields) = match section {
                Section::Point => (n_points, &mut vtu.point_data),
                Section::Cell if array.name != "block" => (n_cells, &mut vtu.cell_data),
                _ => continue,
            };
            let expected = count.checked_mul(array.components);
            let expected =
                expected.ok_or_else(|| array.error(self.file, "the number of components is too large"))?;
            let mut values = array.read(&self.encoding, &mut budget, Some(expected), |n| Ok(n.float()))?;
            if *section == Section::Cell && !block_of_cell.is_sorted() {
                values = in_block_order(&values, array.components, &block_of_cell);
            }
            fields.push(Field {
                name: array.name.clone().into(),
                components: array.components,
                values: values.into(),
            });
        }
        Ok(vtu)
    }

    fn mesh(&self, unit: LengthUnit, n_points: usize, budget: &mut Budget) -> Result<Mesh, MeshError> {
        let coordinates =
            self.find(Section::Points, "")?.read(&self.encoding, budget, Some(3 * n_points), |n| {
                let x = n.float();
                if x.is_finite() {
                    Ok(unit.to_metre(x))
                } else {
                    Err(format!("a coordinate is {x}; all must be finite"))
                }
            })?;
        let points = coordinates.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
        Ok(Mesh { points, ..Mesh::default() })
    }

    /// Reads the cells into blocks; returns the block of each cell of the file.
    fn cells(
        &self,
        n_points: usize,
        n_cells: usize,
        mesh: &mut Mesh,
        budget: &mut Budget,
    ) -> Result<Vec<u32>, MeshError> {
        let index = |n: super::vtu_array::Number| {
            n.index().ok_or_else(|| "not an index (integer, 0 to 2³²−1)".to_owned())
        };
        let types_array = self.find(Section::Cells, "types")?;
        let types = types_array.read(&self.encoding, budget, Some(n_cells), |n| {
            let number = index(n)?;
            let known = CELL_TYPES.iter().any(|t| t.0 == number);
            let hint =
                "known: 3 line, 5 triangle, 9 quad, 10 tetra, 11 voxel, 12 hexahedron, 13 wedge, 24 quadratic tetra";
            if known { Ok(number as u8) } else { Err(format!("cell type {number} is not supported; {hint}")) }
        })?;
        let offsets_array = self.find(Section::Cells, "offsets")?;
        let offsets = offsets_array.read(&self.encoding, budget, Some(n_cells), index)?;
        let n_entries = offsets.last().map_or(0, |n| *n as usize);
        let connectivity_array = self.find(Section::Cells, "connectivity")?;
        let connectivity = connectivity_array.read(&self.encoding, budget, Some(n_entries), |n| {
            let node = index(n)?;
            let exists = (node as usize) < n_points;
            if exists {
                Ok(node)
            } else {
                Err(format!("node {node} does not exist; the file has {n_points} points"))
            }
        })?;
        let ids = self.block_ids(n_cells, budget)?;
        let kind_of =
            |number: u8| CELL_TYPES.iter().find(|t| t.0 == u32::from(number)).map_or(CellKind::Hex8, |t| t.1);
        // Slots in the order of first appearance, or of the index written with the block.
        let mut slots: BTreeMap<(u32, CellKind), u32> = BTreeMap::new();
        let mut parts: Vec<(String, CellKind, Vec<u32>)> = Vec::new();
        let own = self.own_blocks(budget)?;
        for (i, (name, kind)) in own.iter().enumerate() {
            slots.insert((i as u32, *kind), i as u32);
            parts.push((name.clone(), *kind, Vec::new()));
        }
        let mut block_of_cell = Vec::with_capacity(n_cells);
        let mut start = 0;
        for cell in 0..n_cells {
            let (kind, end) = (kind_of(types[cell]), offsets[cell] as usize);
            if end.checked_sub(start) != Some(kind.n_nodes()) || end > connectivity.len() {
                let n = kind.n_nodes();
                let reason = format!("cell {cell} ({}, {n} nodes) goes from {start} to {end}", kind.name());
                return Err(offsets_array.error(self.file, reason));
            }
            let id = ids.as_ref().map_or(0, |ids| ids[cell]);
            let slot = match slots.get(&(id, kind)) {
                Some(slot) => *slot,
                None => {
                    budget.take(256).map_err(|reason| types_array.error(self.file, reason))?;
                    let name = if ids.is_some() { format!("region_{id}") } else { kind.name().to_owned() };
                    slots.insert((id, kind), parts.len() as u32);
                    parts.push((name, kind, Vec::new()));
                    parts.len() as u32 - 1
                }
            };
            let nodes = &mut parts[slot as usize].2;
            nodes.extend_from_slice(&connectivity[start..end]);
            if types[cell] == VOXEL {
                let n = nodes.len();
                nodes.swap(n - 6, n - 5); // voxels count x first, then y
                nodes.swap(n - 2, n - 1);
            }
            block_of_cell.push(slot);
            start = end;
        }
        for (name, kind, nodes) in parts {
            if own.is_empty() {
                push_cells(mesh, &name, kind, nodes);
            } else {
                mesh.blocks.push(CellBlock { name, kind, nodes });
            }
        }
        Ok(block_of_cell)
    }

    /// The number of the region of each cell, where the file has one.
    fn block_ids(&self, n_cells: usize, budget: &mut Budget) -> Result<Option<Vec<u32>>, MeshError> {
        const NAMES: [&str; 5] = ["block", "region", "MaterialIds", "PhysicalGroup", "gmsh:physical"];
        let found = NAMES.iter().find_map(|name| {
            let usable =
                |a: &Array| a.name == *name && a.components == 1 && !matches!(a.number, NumberType::Float(_));
            self.arrays.iter().find(|(s, a)| *s == Section::Cell && usable(a))
        });
        let Some((_, array)) = found else { return Ok(None) };
        let ids = array.read(&self.encoding, budget, Some(n_cells), |n| {
            n.index().ok_or_else(|| "a region number must be an integer from 0 to 2³²−1".to_owned())
        })?;
        Ok(Some(ids))
    }

    /// Blocks that [`write`] noted, in their order.
    fn own_blocks(&self, budget: &mut Budget) -> Result<Vec<(String, CellKind)>, MeshError> {
        let mut blocks = BTreeMap::new();
        for (section, array) in &self.arrays {
            let (Section::Field, Some(name)) = (section, array.name.strip_prefix("block:")) else { continue };
            let values = array
                .read(&self.encoding, budget, Some(2), |n| n.index().ok_or("not an index".to_owned()))?;
            let kind = CELL_TYPES.iter().find(|t| t.0 == values[1]).map(|t| t.1);
            let kind =
                kind.ok_or_else(|| array.error(self.file, format!("cell type {} is not known", values[1])))?;
            if blocks.insert(values[0], (name.to_owned(), kind)).is_some() {
                return Err(array.error(self.file, format!("two blocks have the index {}", values[0])));
            }
        }
        if !blocks.keys().copied().eq(0..blocks.len() as u32) {
            return Err(
                self.error(self.head.len(), "the indices of the field arrays `block:…` are not 0, 1, 2, …")
            );
        }
        Ok(blocks.into_values().collect())
    }

    fn names(&self, n_points: usize, mesh: &mut Mesh, budget: &mut Budget) -> Result<(), MeshError> {
        let node = |n: super::vtu_array::Number| match n.index() {
            Some(node) if (node as usize) < n_points => Ok(node),
            _ => Err(format!("names a node that does not exist; the file has {n_points} points")),
        };
        for (section, array) in &self.arrays {
            if *section != Section::Field {
                continue;
            }
            if let Some(name) = array.name.strip_prefix("node_set:") {
                mesh.node_sets.insert(name.to_owned(), array.read(&self.encoding, budget, None, node)?);
            } else if let Some(name) = array.name.strip_prefix("surface:") {
                let nodes = array.read(&self.encoding, budget, None, node)?;
                if !nodes.len().is_multiple_of(4) {
                    return Err(array.error(self.file, "faces have four node indices each"));
                }
                let faces = nodes.chunks_exact(4).map(|f| [f[0], f[1], f[2], f[3]]).collect();
                mesh.surfaces.insert(name.to_owned(), faces);
            }
        }
        Ok(())
    }
}

/// Values sorted by the block of their cell; cells of one block keep their order.
fn in_block_order(values: &[f64], components: usize, block_of_cell: &[u32]) -> Vec<f64> {
    let mut cells: Vec<u32> = (0..block_of_cell.len() as u32).collect();
    cells.sort_by_key(|&cell| block_of_cell[cell as usize]);
    cells.iter().flat_map(|&cell| &values[cell as usize * components..][..components]).copied().collect()
}
