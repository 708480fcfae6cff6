//! Abaqus input files: `*NODE`, `*ELEMENT`, `*NSET`, `*ELSET`, `*SURFACE`; other keywords are passed over.
//! Layout: Abaqus Keywords Reference Guide.
//!
//! Elements become blocks by the `ELSET=` of their `*ELEMENT`; without one by the first `*… SECTION` whose set holds them,
//! else under the name of the part or of the element type. Surface elements (`SFM3D3`, `SFM3D4`) become surfaces.
//! Names are compared without regard to case, as Abaqus does; the first spelling is kept.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::abaqus_keywords::{Keyword, fields, keywords};
use super::source::{Budget, Labels, format_error, shorten};
use super::{LengthUnit, push_cells};
use crate::mesh::{CellKind, Mesh, MeshError, Place, unique_nodes};

pub use super::abaqus_write::write;

/// Reads the bytes of an `.inp` file; `file` names it in errors.
pub fn parse(bytes: &[u8], file: &Path, unit: LengthUnit) -> Result<Mesh, MeshError> {
    let keywords = keywords(bytes, file)?;
    let mut reader = Reader::new(file, bytes.len());
    for keyword in &keywords {
        refuse_unsupported(keyword)?;
        match keyword.name.as_str() {
            "NODE" => reader.nodes(keyword, unit)?,
            "PART" => reader.part(keyword)?,
            _ => {}
        }
    }
    reader.number_nodes()?;
    for keyword in keywords.iter().filter(|k| k.name == "ELEMENT") {
        reader.elements(keyword)?;
    }
    reader.number_elements()?;
    for keyword in &keywords {
        match keyword.name.as_str() {
            "NSET" => reader.node_set(keyword)?,
            "ELSET" => reader.element_set(keyword)?,
            _ => {}
        }
    }
    for keyword in keywords.iter().filter(|k| k.name == "SURFACE") {
        reader.surface(keyword)?;
    }
    if reader.elements.is_empty() {
        let line = 1 + bytes.iter().filter(|b| **b == b'\n').count();
        return Err(format_error(file, Place::Line(line), "the file ends without `*ELEMENT`"));
    }
    Ok(reader.mesh(&keywords))
}

/// What would change the mesh if it were passed over.
fn refuse_unsupported(keyword: &Keyword) -> Result<(), MeshError> {
    let remedy = match keyword.name.as_str() {
        "INCLUDE" => "put the contents of the included file in its place",
        "NGEN" | "NFILL" | "NCOPY" | "NMAP" | "ELGEN" | "ELCOPY" | "SYSTEM" | "TRANSFORM SHELL TO SOLID" => {
            "write out nodes and elements one by one"
        }
        "INSTANCE" if keyword.data().next().is_some() => {
            "instances that are moved or carry their own mesh are not supported; write a flat file (in Abaqus/CAE: model \
             attributes, `Do not use parts and assemblies in input files`)"
        }
        _ if keyword.parameter("INPUT").is_some() && matches!(keyword.name.as_str(), "NODE" | "ELEMENT") => {
            "put the contents of the file named by INPUT= in its place"
        }
        _ => return Ok(()),
    };
    Err(keyword.error(keyword.line, format!("`*{}` is not supported: {remedy}", shorten(&keyword.name))))
}

/// Kinds by element type; `None` where a type is not known. The flag: a surface, not a block.
fn kind_of(element_type: &str) -> Option<(CellKind, bool)> {
    Some(match element_type.to_ascii_uppercase().as_str() {
        "C3D8" | "C3D8R" | "C3D8H" | "C3D8RH" | "C3D8I" | "C3D8IH" | "C3D8S" => (CellKind::Hex8, false),
        "C3D4" | "C3D4H" => (CellKind::Tet4, false),
        "C3D10" | "C3D10H" | "C3D10I" | "C3D10M" | "C3D10MH" | "C3D10HS" => (CellKind::Tet10, false),
        "C3D6" | "C3D6H" => (CellKind::Wedge6, false),
        "T3D2" | "T3D2H" | "SPRINGA" => (CellKind::Line2, false),
        "S4" | "S4R" | "M3D4" | "M3D4R" | "R3D4" => (CellKind::Quad4, false),
        "S3" | "S3R" | "M3D3" | "R3D3" => (CellKind::Tri3, false),
        "SFM3D4" | "SFM3D4R" => (CellKind::Quad4, true),
        "SFM3D3" => (CellKind::Tri3, true),
        _ => return None,
    })
}

/// Elements of one `ELSET=` (or none) and kind.
struct Group {
    /// Name of the set, else of the part, else of the element type.
    name: String,
    /// `*ELEMENT` named a set.
    named: bool,
    surface: bool,
    kind: CellKind,
    nodes: Vec<u32>,
    /// Indices of its elements in [`Reader::elements`], ascending; only while `named` is false.
    elements: Vec<u32>,
}

struct Reader<'a> {
    file: &'a Path,
    budget: Budget,
    node_tags: Vec<u64>,
    points: Vec<[f64; 3]>,
    nodes: Labels,
    part: Option<String>,
    groups: Vec<Group>,
    /// (set name in upper case, element type's kind and use) → index into `groups`.
    group_of: HashMap<(String, CellKind, bool), u32>,
    element_tags: Vec<u64>,
    /// Group and position in the group of each element.
    elements: Vec<(u32, u32)>,
    element_labels: Labels,
    node_sets: Named<u32>,
    element_sets: Named<u32>,
    surfaces: Named<[u32; 4]>,
}

/// Lists by name in upper case, each with its first spelling.
type Named<T> = BTreeMap<String, (String, Vec<T>)>;

impl<'a> Reader<'a> {
    fn new(file: &'a Path, file_bytes: usize) -> Reader<'a> {
        Reader {
            file,
            budget: Budget::new(file_bytes, 2),
            node_tags: Vec::new(),
            points: Vec::new(),
            nodes: Labels::default(),
            part: None,
            groups: Vec::new(),
            group_of: HashMap::new(),
            element_tags: Vec::new(),
            elements: Vec::new(),
            element_labels: Labels::default(),
            node_sets: Named::new(),
            element_sets: Named::new(),
            surfaces: Named::new(),
        }
    }

    fn part(&mut self, keyword: &Keyword) -> Result<(), MeshError> {
        if self.part.is_some() {
            let reason = "a second `*PART`: several parts in one file are not supported; write a flat file (in \
                          Abaqus/CAE: model attributes, `Do not use parts and assemblies in input files`)";
            return Err(keyword.error(keyword.line, reason));
        }
        self.part = Some(keyword.required("NAME")?.to_owned());
        Ok(())
    }

    fn nodes(&mut self, keyword: &Keyword, unit: LengthUnit) -> Result<(), MeshError> {
        let first = self.points.len();
        self.points.reserve(keyword.n_lines());
        self.node_tags.reserve(keyword.n_lines());
        for (line, data) in keyword.data() {
            let mut fields = fields(data);
            let tag = self.label(keyword, line, fields.next().unwrap_or(""))?;
            let mut point = [0.0; 3]; // trailing zeros may be left out
            for x in &mut point {
                let Some(field) = fields.next().filter(|f| !f.is_empty()) else { continue };
                *x = number(field).filter(|x| x.is_finite()).ok_or_else(|| {
                    keyword.error(
                        line,
                        format!("coordinate `{}` of node {tag} is not a finite number", shorten(field)),
                    )
                })?;
            }
            self.node_tags.push(tag);
            self.points.push(point.map(|x| unit.to_metre(x)));
        }
        if let Some(name) = keyword.parameter("NSET") {
            let members = (first as u32..self.points.len() as u32).collect();
            self.add_node_set(keyword, keyword.line, name, members)?;
        }
        Ok(())
    }

    fn number_nodes(&mut self) -> Result<(), MeshError> {
        let place = Place::Line(1);
        if u32::try_from(self.points.len()).is_err() {
            return Err(MeshError::TooManyNodes { n_nodes: self.points.len() });
        }
        self.nodes = Labels::new(std::mem::take(&mut self.node_tags).into_iter()).map_err(|tag| {
            format_error(self.file, place, format!("node {tag} is given twice in the file"))
        })?;
        Ok(())
    }

    fn elements(&mut self, keyword: &Keyword) -> Result<(), MeshError> {
        let element_type = keyword.required("TYPE")?;
        let (kind, surface) = kind_of(element_type).ok_or_else(|| {
            let known = "C3D8, C3D4, C3D10, T3D2, S4, M3D4, S3, M3D3, R3D4, R3D3, SFM3D4, SFM3D3, SPRINGA and their variants";
            let found = shorten(element_type);
            keyword.error(keyword.line, format!("element type `{found}` is not supported; known: {known}"))
        })?;
        let elset = keyword.parameter("ELSET");
        let group = self.group(keyword, elset, element_type, kind, surface)?;
        let first = self.elements.len();
        self.elements.reserve(keyword.n_lines());
        self.element_tags.reserve(keyword.n_lines());
        let mut fields = keyword.fields();
        while let Some((line, field)) = fields.next() {
            let tag = self.label(keyword, line, field)?;
            for _ in 0..kind.n_nodes() {
                let node = fields.next().ok_or_else(|| {
                    keyword.error(line, format!("element {tag} has fewer than {} nodes", kind.n_nodes()))
                })?;
                let label = self.label(keyword, node.0, node.1)?;
                let node = self.nodes.get(label).ok_or_else(|| {
                    keyword
                        .error(node.0, format!("element {tag} names node {label}, which no `*NODE` defines"))
                })?;
                self.groups[group].nodes.push(node);
            }
            let cell = self.groups[group].nodes.len() / kind.n_nodes() - 1;
            if surface {
                let nodes = face_nodes(&self.groups[group], cell, "").unwrap_or_default();
                entry(&mut self.surfaces, &self.groups[group].name).push(nodes);
            }
            if elset.is_none() {
                self.groups[group].elements.push(self.elements.len() as u32);
            }
            self.elements.push((group as u32, cell as u32));
            self.element_tags.push(tag);
        }
        if let Some(name) = elset {
            let members = (first as u32..self.elements.len() as u32).collect();
            self.add_element_set(keyword, keyword.line, name, members)?;
        }
        Ok(())
    }

    fn group(
        &mut self,
        keyword: &Keyword,
        elset: Option<&str>,
        element_type: &str,
        kind: CellKind,
        surface: bool,
    ) -> Result<usize, MeshError> {
        let key = (elset.unwrap_or("").to_ascii_uppercase(), kind, surface);
        if let Some(&group) = self.group_of.get(&key) {
            return Ok(group as usize);
        }
        self.charge(keyword, keyword.line, 512)?;
        let name = elset.or(self.part.as_deref()).unwrap_or(element_type).to_owned();
        self.group_of.insert(key, self.groups.len() as u32);
        let named = elset.is_some();
        self.groups.push(Group { name, named, surface, kind, nodes: Vec::new(), elements: Vec::new() });
        Ok(self.groups.len() - 1)
    }

    fn number_elements(&mut self) -> Result<(), MeshError> {
        self.element_labels =
            Labels::new(std::mem::take(&mut self.element_tags).into_iter()).map_err(|tag| {
                format_error(self.file, Place::Line(1), format!("element {tag} is given twice in the file"))
            })?;
        Ok(())
    }

    fn node_set(&mut self, keyword: &Keyword) -> Result<(), MeshError> {
        let name = keyword.required("NSET")?;
        if keyword.parameter("ELSET").is_some() {
            return Err(keyword.error(keyword.line, "`*NSET` with ELSET= is not supported; list the nodes"));
        }
        self.members(keyword, false, |reader, line, members| {
            reader.add_node_set(keyword, line, name, members)
        })
    }

    fn element_set(&mut self, keyword: &Keyword) -> Result<(), MeshError> {
        let name = keyword.required("ELSET")?;
        self.members(keyword, true, |reader, line, members| {
            reader.add_element_set(keyword, line, name, members)
        })
    }

    /// Hands the members on the data lines of a set to `add`: labels, names of earlier sets, or ranges.
    fn members(
        &mut self,
        keyword: &Keyword,
        elements: bool,
        mut add: impl FnMut(&mut Self, usize, Vec<u32>) -> Result<(), MeshError>,
    ) -> Result<(), MeshError> {
        let generate = keyword.parameter("GENERATE").is_some();
        add(self, keyword.line, Vec::new())?; // an empty set is a set
        for (line, data) in keyword.data() {
            let mut members = Vec::new();
            if generate {
                let fields: Vec<_> =
                    fields(data).map(|f| self.label(keyword, line, f)).collect::<Result<_, _>>()?;
                let (first, last, step) = match fields[..] {
                    [one] => (one, one, 1),
                    [first, last] => (first, last, 1),
                    [first, last, step] if step > 0 => (first, last, step),
                    _ => return Err(keyword.error(line, "`first, last, increment > 0` expected")),
                };
                let labels = if elements { &self.element_labels } else { &self.nodes };
                let range = labels.range(first, last);
                // A label that does not exist must not be left out in silence.
                let wanted = if last < first { 0 } else { (last - first) / step + 1 };
                members = range.iter().filter(|(l, _)| (l - first) % step == 0).map(|p| p.1).collect();
                if members.len() as u64 != wanted {
                    let found = members.len();
                    return Err(keyword
                        .error(line, format!("{wanted} labels generated, but only {found} of them exist")));
                }
                self.charge(keyword, line, 4 * members.len())?;
            } else {
                for field in fields(data).filter(|f| !f.is_empty()) {
                    let (labels, sets) = if elements {
                        (&self.element_labels, &self.element_sets)
                    } else {
                        (&self.nodes, &self.node_sets)
                    };
                    if let Some(index) = field.parse().ok().and_then(|label| labels.get(label)) {
                        members.push(index);
                    } else if let Some((_, set)) = sets.get(&field.to_ascii_uppercase()) {
                        members.extend_from_slice(set);
                        let bytes = 4 * set.len();
                        self.charge(keyword, line, bytes)?;
                    } else {
                        let what = if elements { "element" } else { "node" };
                        let reason =
                            format!("`{}` is no {what} and no {what} set defined before", shorten(field));
                        return Err(keyword.error(line, reason));
                    }
                }
            }
            add(self, line, members)?;
        }
        Ok(())
    }

    fn add_node_set(
        &mut self,
        keyword: &Keyword,
        line: usize,
        name: &str,
        members: Vec<u32>,
    ) -> Result<(), MeshError> {
        self.charge_list(keyword, line, name, 4 * members.len())?;
        entry(&mut self.node_sets, name).extend(members);
        Ok(())
    }

    fn add_element_set(
        &mut self,
        keyword: &Keyword,
        line: usize,
        name: &str,
        members: Vec<u32>,
    ) -> Result<(), MeshError> {
        self.charge_list(keyword, line, name, 4 * members.len())?;
        entry(&mut self.element_sets, name).extend(members);
        Ok(())
    }

    fn surface(&mut self, keyword: &Keyword) -> Result<(), MeshError> {
        let name = keyword.required("NAME")?;
        let of_nodes = keyword.parameter("TYPE").is_some_and(|t| t.eq_ignore_ascii_case("NODE"));
        if of_nodes {
            return self.members_of_node_surface(keyword, name);
        }
        self.charge_list(keyword, keyword.line, name, 0)?;
        entry(&mut self.surfaces, name);
        for (line, data) in keyword.data() {
            let mut parts = fields(data);
            let (of, face) = (parts.next().unwrap_or(""), parts.next().unwrap_or(""));
            let one = of.parse().ok().and_then(|label| self.element_labels.get(label)).map(|e| vec![e]);
            let set = self.element_sets.get(&of.to_ascii_uppercase());
            let Some(elements) = one.or_else(|| set.map(|s| s.1.clone())) else {
                return Err(
                    keyword.error(line, format!("`{}` is no element and no element set", shorten(of)))
                );
            };
            self.charge(keyword, line, 16 * elements.len())?;
            for element in elements {
                let (group, cell) = self.elements[element as usize];
                let nodes =
                    face_nodes(&self.groups[group as usize], cell as usize, face).ok_or_else(|| {
                        let kind = self.groups[group as usize].kind.name();
                        keyword.error(
                            line,
                            format!(
                                "`{}` is no face of a {kind}; S1, S2, …, SPOS or SNEG expected",
                                shorten(face)
                            ),
                        )
                    })?;
                entry(&mut self.surfaces, name).push(nodes);
            }
        }
        Ok(())
    }

    fn members_of_node_surface(&mut self, keyword: &Keyword, name: &str) -> Result<(), MeshError> {
        for (line, data) in keyword.data() {
            let of = fields(data).next().unwrap_or("");
            let one = of.parse().ok().and_then(|label| self.nodes.get(label)).map(|n| vec![n]);
            let set = self.node_sets.get(&of.to_ascii_uppercase()).map(|s| s.1.clone());
            let Some(members) = one.or(set) else {
                return Err(keyword.error(line, format!("`{}` is no node and no node set", shorten(of))));
            };
            self.add_node_set(keyword, line, name, members)?;
        }
        Ok(())
    }

    fn label(&self, keyword: &Keyword, line: usize, field: &str) -> Result<u64, MeshError> {
        field.parse().map_err(|_| {
            keyword.error(line, format!("a label (positive integer) expected, found `{}`", shorten(field)))
        })
    }

    fn charge(&mut self, keyword: &Keyword, line: usize, bytes: usize) -> Result<(), MeshError> {
        self.budget.take(bytes).map_err(|reason| keyword.error(line, reason))
    }

    /// Charges `bytes`, and a new name where there is one.
    fn charge_list(
        &mut self,
        keyword: &Keyword,
        line: usize,
        name: &str,
        bytes: usize,
    ) -> Result<(), MeshError> {
        let bytes = if bytes == 0 { 256 + 3 * name.len() } else { bytes };
        self.charge(keyword, line, bytes)
    }

    fn mesh(self, keywords: &[Keyword]) -> Mesh {
        let sections =
            keywords.iter().filter(|k| k.name.ends_with(" SECTION")).filter_map(|k| k.parameter("ELSET"));
        // For each element: 1 + index of the first section that holds it.
        let mut section_of = vec![0u32; self.elements.len()];
        let mut section_names = Vec::new();
        for name in sections {
            let Some((spelling, members)) = self.element_sets.get(&name.to_ascii_uppercase()) else {
                continue;
            };
            section_names.push(spelling.clone());
            for &element in members {
                let section = &mut section_of[element as usize];
                if *section == 0 {
                    *section = section_names.len() as u32;
                }
            }
        }
        let mut mesh = Mesh { points: self.points, ..Mesh::default() };
        for group in self.groups {
            if group.surface {
                continue; // its faces are in `surfaces` already
            }
            if group.named {
                push_cells(&mut mesh, &group.name, group.kind, group.nodes);
            } else {
                let n = group.kind.n_nodes();
                let mut parts: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
                for (&element, nodes) in group.elements.iter().zip(group.nodes.chunks_exact(n)) {
                    parts.entry(section_of[element as usize]).or_default().extend_from_slice(nodes);
                }
                for (section, nodes) in parts {
                    let name = section.checked_sub(1).map_or(&group.name, |i| &section_names[i as usize]);
                    push_cells(&mut mesh, name, group.kind, nodes);
                }
            }
        }
        for (name, nodes) in self.node_sets.into_values() {
            mesh.node_sets.insert(name, unique_nodes(nodes));
        }
        mesh.surfaces.extend(self.surfaces.into_values());
        mesh
    }
}

/// The list of this name, made where it is new.
fn entry<'m, T>(named: &'m mut Named<T>, name: &str) -> &'m mut Vec<T> {
    &mut named.entry(name.to_ascii_uppercase()).or_insert_with(|| (name.to_owned(), Vec::new())).1
}

/// Nodes of the face `S1`, …, `SPOS`, `SNEG` of a cell.
fn face_nodes(group: &Group, cell: usize, label: &str) -> Option<[u32; 4]> {
    let n = group.kind.n_nodes();
    let nodes = &group.nodes[cell * n..(cell + 1) * n];
    let label = label.to_ascii_uppercase();
    let (index, back) = match (label.as_str(), group.kind.is_solid()) {
        ("SPOS" | "", false) => (0, false),
        ("SNEG", false) => (0, true),
        (_, true) => (label.strip_prefix('S')?.parse::<usize>().ok()?.checked_sub(1)?, false),
        _ => return None,
    };
    let [a, b, c, d] = group.kind.faces().get(index)?.map(|i| nodes[i]);
    Some(match (back, c == d) {
        (false, _) => [a, b, c, d],
        (true, false) => [d, c, b, a],
        (true, true) => [c, b, a, a],
    })
}

/// A number, also with the exponent letter `D` of Fortran.
fn number(field: &str) -> Option<f64> {
    field.parse().ok().or_else(|| field.replace(['d', 'D'], "e").parse().ok())
}
