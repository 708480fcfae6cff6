//! Gmsh `.msh`, versions 2.2 and 4.1, text and binary (little-endian).
//! Layout: Gmsh reference manual, "MSH file format" and "Legacy formats: MSH version 2".
//!
//! A physical group becomes a block under its name (`physical_N` without one); a group of surfaces also becomes a
//! surface and a node set, a group of curves or points a node set. Of elements without physical group, those of the
//! highest dimension become blocks `volume_N` (`surface_N`, `curve_N`), the others surfaces and node sets of such names.
//! A name used for two kinds of cells gets the kind appended. Nodes that only points of the geometry hold are dropped.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::source::{Budget, Labels, Source, shorten};
use super::{LengthUnit, push_cells};
use crate::mesh::{CellKind, Mesh, MeshError, unique_nodes};

/// Reads the bytes of a `.msh` file; `file` names it in errors.
pub fn parse(bytes: &[u8], file: &Path, unit: LengthUnit) -> Result<Mesh, MeshError> {
    let mut reader = Reader::new(bytes, file);
    reader.format()?;
    while let Some(section) = reader.next_section()? {
        match section {
            "PhysicalNames" => reader.physical_names()?,
            "Entities" if reader.version == Version::V4 => reader.entities()?,
            "Nodes" if reader.version == Version::V2 => reader.nodes_v2()?,
            "Nodes" => reader.nodes_v4()?,
            "Elements" if reader.version == Version::V2 => reader.elements_v2()?,
            "Elements" => reader.elements_v4()?,
            other => {
                reader.skip(other)?;
                continue;
            }
        }
        reader.end(section)?;
    }
    reader.mesh(unit)
}

#[derive(Clone, Copy, PartialEq)]
enum Version {
    V2,
    V4,
}

/// Elements of one kind of one physical group (or, without, of one entity).
struct Group {
    dim: usize,
    /// Physical tag, or entity tag where `physical` is false.
    tag: i32,
    physical: bool,
    /// `None`: points.
    kind: Option<CellKind>,
    nodes: Vec<u32>,
    /// Middle nodes of quadratic sides: kept for the node sets only.
    middle: Vec<u32>,
    /// Further physical groups of the same elements: named as sets and surfaces only.
    also: Vec<i32>,
}

struct Reader<'a> {
    source: Source<'a>,
    version: Version,
    /// (dimension, physical tag) → name.
    names: BTreeMap<(usize, i32), String>,
    /// (dimension, entity tag) → its physical tags (4.1).
    physical_of: HashMap<(usize, i32), Vec<i32>>,
    points: Vec<[f64; 3]>,
    labels: Option<Labels>,
    groups: Vec<Group>,
    group_of: HashMap<(usize, i32, bool, Option<CellKind>), usize>,
    budget: Budget,
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8], file: &'a Path) -> Reader<'a> {
        Reader {
            source: Source::new(file, bytes),
            version: Version::V4,
            names: BTreeMap::new(),
            physical_of: HashMap::new(),
            points: Vec::new(),
            labels: None,
            groups: Vec::new(),
            group_of: HashMap::new(),
            budget: Budget::new(bytes.len(), 2),
        }
    }

    fn format(&mut self) -> Result<(), MeshError> {
        if self.source.line()? != Some("$MeshFormat") {
            return Err(self.source.error("not a Gmsh file: the first line must be `$MeshFormat`"));
        }
        self.version = match self.source.word()? {
            "2.2" | "2" | "2.1" => Version::V2,
            "4.1" => Version::V4,
            other => {
                let other = shorten(other);
                return Err(self.source.error(format!(
                    "MSH version {other} is not supported; save as 4.1 or 2.2 (`gmsh in.msh -save -format msh41`)"
                )));
            }
        };
        let binary: u8 = self.source.parse("file type 0 (text) or 1 (binary)")?;
        let data_size: u8 = self.source.parse("data size")?;
        if binary > 1 || data_size != 8 {
            return Err(self.source.error("file type must be 0 (text) or 1 (binary) and data size 8"));
        }
        if binary == 1 {
            self.source.line()?; // the rest of the line
            self.source.binary = true;
            let one = i32::from_le_bytes(self.source.take()?);
            if one != 1 {
                return Err(self
                    .source
                    .error("byte order is not little-endian: save the file on this kind of machine"));
            }
        }
        self.end("MeshFormat")
    }

    /// Name of the next section, `None` at the end of the file.
    fn next_section(&mut self) -> Result<Option<&'a str>, MeshError> {
        while let Some(line) = self.source.line()? {
            if let Some(name) = line.strip_prefix('$') {
                return Ok(Some(name));
            } else if !line.is_empty() {
                return Err(self.source.error(format!("a section `$…` expected, found `{}`", shorten(line))));
            }
        }
        Ok(None)
    }

    fn end(&mut self, section: &str) -> Result<(), MeshError> {
        let word = self.source.word()?;
        if word.strip_prefix("$End") == Some(section) {
            return self.source.line().map(|_| ());
        }
        Err(self.source.error(format!("`$End{section}` expected, found `{}`", shorten(word))))
    }

    /// Skips a section that holds no mesh.
    fn skip(&mut self, section: &str) -> Result<(), MeshError> {
        let end = format!("$End{section}");
        let rest = &self.source.bytes[self.source.at..];
        let Some(found) = rest.windows(end.len()).position(|w| w == end.as_bytes()) else {
            return Err(self.source.error(format!("section `${}` has no end", shorten(section))));
        };
        if self.source.binary {
            self.source.at += found;
        } else {
            let target = self.source.at + found;
            while self.source.at < target && self.source.line()?.is_some() {} // keeps count of lines
            return Ok(());
        }
        self.source.line().map(|_| ())
    }

    fn int(&mut self) -> Result<i32, MeshError> {
        if self.source.binary {
            Ok(i32::from_le_bytes(self.source.take()?))
        } else {
            self.source.parse("integer")
        }
    }

    fn size(&mut self) -> Result<u64, MeshError> {
        if self.source.binary {
            Ok(u64::from_le_bytes(self.source.take()?))
        } else {
            self.source.parse("count or tag (integer ≥ 0)")
        }
    }

    fn real(&mut self) -> Result<f64, MeshError> {
        if self.source.binary {
            Ok(f64::from_le_bytes(self.source.take()?))
        } else {
            self.source.parse("number")
        }
    }

    fn dim(&mut self) -> Result<usize, MeshError> {
        let dim = self.int()?;
        usize::try_from(dim)
            .ok()
            .filter(|d| *d <= 3)
            .ok_or_else(|| self.source.error(format!("dimension {dim} is not 0 to 3")))
    }

    fn physical_names(&mut self) -> Result<(), MeshError> {
        let count: u64 = self.source.parse("number of physical names")?;
        self.source.line()?;
        for _ in 0..count {
            let line = self.source.line()?.unwrap_or("");
            let mut parts = line.splitn(3, char::is_whitespace);
            let dim = parts.next().and_then(|d| d.parse::<usize>().ok());
            let tag = parts.next().and_then(|t| t.parse::<i32>().ok());
            let name = parts.next().and_then(|n| n.trim().strip_prefix('"')?.strip_suffix('"'));
            let (Some(dim), Some(tag), Some(name)) = (dim, tag, name) else {
                let found = shorten(line);
                return Err(self.source.error(format!("`dimension tag \"name\"` expected, found `{found}`")));
            };
            self.charge(128 + name.len())?;
            self.names.insert((dim, tag), name.to_owned());
        }
        Ok(())
    }

    /// Which physical groups each point, curve, surface and volume belongs to.
    fn entities(&mut self) -> Result<(), MeshError> {
        let counts = [self.size()?, self.size()?, self.size()?, self.size()?];
        for (dim, count) in counts.into_iter().enumerate() {
            for _ in 0..count {
                let tag = self.int()?;
                for _ in 0..if dim == 0 { 3 } else { 6 } {
                    self.real()?; // the point, or the box around the entity
                }
                let mut physical = Vec::new();
                for _ in 0..self.size()? {
                    physical.push(self.int()?);
                }
                if dim > 0 {
                    for _ in 0..self.size()? {
                        self.int()?; // what bounds it
                    }
                }
                if !physical.is_empty() {
                    self.charge(128 + 8 * physical.len())?;
                    self.physical_of.insert((dim, tag), physical);
                }
            }
        }
        Ok(())
    }

    fn nodes_v2(&mut self) -> Result<(), MeshError> {
        let count: u64 = self.source.parse("number of nodes")?;
        if self.source.binary {
            self.source.line()?;
        }
        let least_bytes = if self.source.binary { 28 } else { 8 };
        let mut tags = Vec::with_capacity(self.source.capacity(count, least_bytes));
        self.points.reserve_exact(self.source.capacity(count, least_bytes));
        for _ in 0..count {
            let tag = self.int()?;
            tags.push(
                u64::try_from(tag).map_err(|_| self.source.error(format!("node tag {tag} is negative")))?,
            );
            self.point(tag.unsigned_abs().into())?;
        }
        self.label(tags)
    }

    fn nodes_v4(&mut self) -> Result<(), MeshError> {
        let (n_blocks, count) = (self.size()?, self.size()?);
        let (_least, _greatest) = (self.size()?, self.size()?);
        let least_bytes = if self.source.binary { 32 } else { 8 };
        let mut tags = Vec::with_capacity(self.source.capacity(count, least_bytes));
        self.points.reserve_exact(self.source.capacity(count, least_bytes));
        for _ in 0..n_blocks {
            let dim = self.dim()?;
            let _entity = self.int()?;
            let n_parameters = if self.int()? != 0 { dim } else { 0 };
            let first = tags.len();
            for _ in 0..self.size()? {
                tags.push(self.size()?);
            }
            for i in first..tags.len() {
                self.point(tags[i])?;
                for _ in 0..n_parameters {
                    self.real()?;
                }
            }
        }
        if tags.len() as u64 != count {
            return Err(self.source.error(format!("{count} nodes announced, {} found", tags.len())));
        }
        self.label(tags)
    }

    fn point(&mut self, tag: u64) -> Result<(), MeshError> {
        let point = [self.real()?, self.real()?, self.real()?];
        if point.iter().any(|x| !x.is_finite()) {
            return Err(self
                .source
                .error(format!("node {tag} has coordinates {point:?}; all must be finite")));
        }
        self.points.push(point);
        Ok(())
    }

    fn label(&mut self, tags: Vec<u64>) -> Result<(), MeshError> {
        if self.labels.is_some() {
            return Err(self.source.error("a second section `$Nodes`"));
        }
        let labels = Labels::new(tags.into_iter())
            .map_err(|tag| self.source.error(format!("node tag {tag} is given twice")))?;
        self.labels = Some(labels);
        Ok(())
    }

    fn elements_v2(&mut self) -> Result<(), MeshError> {
        let count: u64 = self.source.parse("number of elements")?;
        if !self.source.binary {
            for _ in 0..count {
                let (_tag, kind) = (self.int()?, self.kind()?);
                let n_tags = self.int()?;
                self.element_v2(kind, n_tags)?;
            }
            return Ok(());
        }
        self.source.line()?;
        let mut n_read = 0;
        while n_read < count {
            let kind = self.kind()?;
            let (n_follow, n_tags) = (self.int()?, self.int()?);
            if n_follow < 1 {
                return Err(self
                    .source
                    .error(format!("{n_follow} elements announced in a group; at least 1 expected")));
            }
            for _ in 0..n_follow {
                let _tag = self.int()?;
                self.element_v2(kind, n_tags)?;
            }
            n_read += n_follow as u64;
        }
        Ok(())
    }

    /// Tags and nodes of one element: physical group and entity first among the tags.
    fn element_v2(&mut self, kind: ElementType, n_tags: i32) -> Result<(), MeshError> {
        let (mut physical, mut entity) = (0, 0);
        for i in 0..n_tags {
            let tag = self.int()?;
            match i {
                0 => physical = tag,
                1 => entity = tag,
                _ => {}
            }
        }
        let group =
            if physical == 0 { self.group(kind, entity, false)? } else { self.group(kind, physical, true)? };
        self.element(kind, group)
    }

    fn elements_v4(&mut self) -> Result<(), MeshError> {
        let (n_blocks, count) = (self.size()?, self.size()?);
        let (_least, _greatest) = (self.size()?, self.size()?);
        let mut n_read = 0;
        for _ in 0..n_blocks {
            let (dim, entity) = (self.dim()?, self.int()?);
            let kind = self.kind()?;
            if kind.dim != dim {
                return Err(self
                    .source
                    .error(format!("elements of dimension {} on an entity of dimension {dim}", kind.dim)));
            }
            let n_elements = self.size()?;
            let physical = self.physical_of.get(&(dim, entity)).cloned().unwrap_or_default();
            // The sign of a physical tag says how the entity is turned in it.
            let group = match physical.split_first() {
                None => self.group(kind, entity, false)?,
                Some((first, rest)) => {
                    let group = self.group(kind, first.saturating_abs(), true)?;
                    let also = &mut self.groups[group].also;
                    also.extend(rest.iter().map(|t| t.saturating_abs()));
                    also.sort_unstable();
                    also.dedup();
                    group
                }
            };
            for _ in 0..n_elements {
                let _tag = self.size()?;
                self.element(kind, group)?;
            }
            n_read += n_elements;
        }
        if n_read != count {
            return Err(self.source.error(format!("{count} elements announced, {n_read} found")));
        }
        Ok(())
    }

    fn kind(&mut self) -> Result<ElementType, MeshError> {
        let number = self.int()?;
        ELEMENT_TYPES
            .iter()
            .find(|t| t.number == number)
            .copied()
            .ok_or_else(|| self.source.error(format!(
                "element type {number} is not supported; known: 1 line, 2 triangle, 3 quadrilateral, 4 tetrahedron, \
                 5 hexahedron, 9 and 8 (sides of) 11 quadratic tetrahedron, 15 point"
            )))
    }

    fn group(&mut self, kind: ElementType, tag: i32, physical: bool) -> Result<usize, MeshError> {
        let key = (kind.dim, tag, physical, kind.kind);
        if let Some(&group) = self.group_of.get(&key) {
            return Ok(group);
        }
        self.charge(512)?;
        self.group_of.insert(key, self.groups.len());
        self.groups.push(Group {
            dim: kind.dim,
            tag,
            physical,
            kind: kind.kind,
            nodes: Vec::new(),
            middle: Vec::new(),
            also: Vec::new(),
        });
        Ok(self.groups.len() - 1)
    }

    /// Nodes of one element.
    fn element(&mut self, kind: ElementType, group: usize) -> Result<(), MeshError> {
        let mut nodes = [0u32; 10];
        for slot in &mut nodes[..kind.n_nodes] {
            // Negative tags (2.2) fail here as well: no node has one.
            let tag = if self.version == Version::V2 { self.int()? as i64 as u64 } else { self.size()? };
            let Some(labels) = &self.labels else {
                return Err(self.source.error("`$Elements` come before `$Nodes`"));
            };
            *slot = labels.get(tag).ok_or_else(|| {
                self.source.error(format!("an element names node {tag}, which `$Nodes` lacks"))
            })?;
        }
        if kind.kind == Some(CellKind::Tet10) {
            nodes.swap(8, 9); // Gmsh: edge 2-3 before 1-3
        }
        let n_kept = kind.kind.map_or(1, CellKind::n_nodes);
        self.groups[group].nodes.extend_from_slice(&nodes[..n_kept]);
        self.groups[group].middle.extend_from_slice(&nodes[n_kept..kind.n_nodes]);
        Ok(())
    }

    fn charge(&mut self, bytes: usize) -> Result<(), MeshError> {
        self.budget.take(bytes).map_err(|reason| self.source.error(reason))
    }

    fn mesh(mut self, unit: LengthUnit) -> Result<Mesh, MeshError> {
        if self.labels.take().is_none() || self.groups.is_empty() {
            return Err(self.source.error("the file ends without nodes or without elements"));
        }
        let mut mesh = Mesh { points: std::mem::take(&mut self.points), ..Mesh::default() };
        mesh.points.iter_mut().flatten().for_each(|x| *x = unit.to_metre(*x));
        let top = self.groups.iter().map(|g| g.dim).max().unwrap_or(0);
        let mut geometry_only = vec![true; mesh.points.len()];
        let mut by_point = vec![false; mesh.points.len()];
        let mut groups = std::mem::take(&mut self.groups);
        groups.sort_by_key(|g| std::cmp::Reverse(g.dim)); // solids first
        for group in groups {
            let marks = if group.dim == 0 { &mut by_point } else { &mut geometry_only };
            group.nodes.iter().chain(&group.middle).for_each(|&n| marks[n as usize] = group.dim == 0);
            self.name_sets(&mut mesh, &group, top)?;
            let Some(kind) = group.kind.filter(|_| group.physical || group.dim == top) else { continue };
            push_cells(&mut mesh, &self.name(group.dim, group.tag, group.physical), kind, group.nodes);
        }
        let keep: Vec<bool> = geometry_only.iter().zip(&by_point).map(|(&g, &p)| !(g && p)).collect();
        mesh.keep_nodes(&keep);
        Ok(mesh)
    }

    /// Sets and surfaces of a group of lower dimension, and of the further physical groups of any.
    fn name_sets(&mut self, mesh: &mut Mesh, group: &Group, top: usize) -> Result<(), MeshError> {
        let own =
            (group.dim < 3 && (group.physical || group.dim < top)).then_some((group.tag, group.physical));
        for (tag, physical) in own.into_iter().chain(group.also.iter().map(|&tag| (tag, true))) {
            let name = self.name(group.dim, tag, physical);
            self.charge(24 * (group.nodes.len() + group.middle.len()) + 128)?;
            let set = mesh.node_sets.entry(name.clone()).or_default();
            *set = unique_nodes(set.iter().chain(&group.nodes).chain(&group.middle).copied());
            if let Some(kind) = group.kind.filter(|_| group.dim == 2) {
                let n = kind.n_nodes();
                let faces = group.nodes.chunks_exact(n).map(|c| [c[0], c[1], c[2], c[n - 1]]);
                mesh.surfaces.entry(name).or_default().extend(faces);
            }
        }
        Ok(())
    }

    fn name(&self, dim: usize, tag: i32, physical: bool) -> String {
        match self.names.get(&(dim, tag)).filter(|_| physical) {
            Some(name) => name.clone(),
            None if physical => format!("physical_{tag}"),
            None => format!("{}_{tag}", ["point", "curve", "surface", "volume"][dim]),
        }
    }
}

#[derive(Clone, Copy)]
struct ElementType {
    number: i32,
    dim: usize,
    n_nodes: usize,
    kind: Option<CellKind>,
}

const fn element_type(number: i32, dim: usize, n_nodes: usize, kind: Option<CellKind>) -> ElementType {
    ElementType { number, dim, n_nodes, kind }
}

const ELEMENT_TYPES: [ElementType; 10] = [
    element_type(1, 1, 2, Some(CellKind::Line2)),
    element_type(2, 2, 3, Some(CellKind::Tri3)),
    element_type(3, 2, 4, Some(CellKind::Quad4)),
    element_type(4, 3, 4, Some(CellKind::Tet4)),
    element_type(5, 3, 8, Some(CellKind::Hex8)),
    element_type(6, 3, 6, Some(CellKind::Wedge6)),
    element_type(8, 1, 3, Some(CellKind::Line2)),
    element_type(9, 2, 6, Some(CellKind::Tri3)),
    element_type(11, 3, 10, Some(CellKind::Tet10)),
    element_type(15, 0, 1, None),
];
