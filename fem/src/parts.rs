//! A frame as ParaView sees it: cells of every kind apart, so that each has its own fields and none has holes.

use std::collections::BTreeSet;

use crate::body::Pose;
use crate::effect;
use crate::geometry::Surface;
use crate::measure::{contact_tractions, fibre_states, membrane_field, solid_field};
use crate::mesh::format::pvd::Part;
use crate::mesh::format::vtu;
use crate::mesh::{CellBlock, CellKind, Mesh};
use crate::plan::Plan;
use crate::run::Frame;

/// What is shown beside what a plan computes.
#[derive(Clone, Debug, Default)]
pub struct Beside {
    /// Time of every frame of the drive for the collection \[s\], where the drive counts otherwise; empty: that of the drive. Of frames
    /// of the same time the last is shown.
    pub times: Vec<f64>,
    /// Rigid surfaces that move along.
    pub bones: Vec<MovingBone>,
}

/// A rigid surface and where it is.
#[derive(Clone, Debug)]
pub struct MovingBone {
    /// Name. Where the mesh of the plan has a block of this name, that block is shown, with its contact pressure.
    pub name: String,
    /// The surface as meshed \[m\].
    pub surface: Surface,
    /// Pose in every frame of the drive.
    pub poses: Vec<Pose>,
}

impl Beside {
    pub(crate) fn time(&self, frame: usize, of_drive: f64) -> f64 {
        self.times.get(frame).copied().unwrap_or(of_drive)
    }
}

/// Names of the parts, in the order of the collection.
pub const PARTS: [&str; 6] = ["solids", "fibres", "membranes", "strands", "bones", "others"];

/// What a block shows as: index into [`PARTS`].
fn part_of(plan: &Plan, block: &CellBlock, beside: &Beside) -> usize {
    let name = &block.name;
    let mut effects = plan.islands.iter().flat_map(|island| &island.effects);
    match effects.find(|e| e.name() == name).map(|e| e.kind()) {
        Some(effect::EffectKind::Matrix) => 0,
        Some(effect::EffectKind::Fibre) if plan.strands.contains(name) => 3,
        Some(effect::EffectKind::Fibre) => 1,
        Some(effect::EffectKind::Membrane) => 2,
        _ if beside.bones.iter().any(|b| &b.name == name) => 4,
        _ => 5,
    }
}

/// The parts of a frame that have cells: meshes whose points are where the nodes are in the frame, with the [`fields`] that belong to
/// them. `index`: which frame of the drive it is, for what moves beside it; `None` leaves that out.
pub fn parts(plan: &Plan, frame: &Frame, beside: &Beside, index: Option<usize>) -> Vec<Part> {
    let (points, cells) = fields(plan, frame);
    let kinds: Vec<usize> = plan.mesh.blocks.iter().map(|b| part_of(plan, b, beside)).collect();
    let place = |n: usize| [frame.x[3 * n], frame.x[3 * n + 1], frame.x[3 * n + 2]];
    let mut parts = Vec::new();
    for (kind, name) in PARTS.into_iter().enumerate() {
        let mut part = Part { name, mesh: Mesh::default(), point_data: Vec::new(), cell_data: Vec::new() };
        let own = |at: usize| kinds[at] == kind;
        let used: BTreeSet<u32> = plan
            .mesh
            .blocks
            .iter()
            .enumerate()
            .filter(|(at, _)| own(*at))
            .flat_map(|(_, b)| b.nodes.iter().copied())
            .collect();
        let nodes: Vec<u32> = used.into_iter().collect();
        let new = |n: &u32| nodes.binary_search(n).ok().map(|i| i as u32);
        part.mesh.points = nodes.iter().map(|&n| place(n as usize)).collect();
        let mut rows = Vec::new(); // of the cells of the mesh
        let mut first = 0;
        for (at, block) in plan.mesh.blocks.iter().enumerate() {
            if own(at) {
                let renamed = block.nodes.iter().filter_map(new).collect();
                part.mesh.blocks.push(CellBlock { nodes: renamed, ..block.clone() });
                rows.extend(first..first + block.n_cells());
            }
            first += block.n_cells();
        }
        for (set, members) in &plan.mesh.node_sets {
            if let Some(members) = members.iter().map(new).collect::<Option<Vec<u32>>>() {
                part.mesh.node_sets.insert(set.clone(), members);
            }
        }
        for (surface, faces) in &plan.mesh.surfaces {
            let face = |f: &[u32; 4]| Some([new(&f[0])?, new(&f[1])?, new(&f[2])?, new(&f[3])?]);
            if let Some(faces) = faces.iter().map(face).collect::<Option<Vec<_>>>() {
                part.mesh.surfaces.insert(surface.clone(), faces);
            }
        }
        let nodes: Vec<usize> = nodes.into_iter().map(|n| n as usize).collect();
        part.point_data = points.iter().map(|f| rows_of(f, &nodes)).collect();
        // Inside a body nothing presses.
        for field in part.point_data.iter_mut().filter(|f| f.name == CONTACT_PRESSURE) {
            field.values.to_mut().iter_mut().filter(|v| v.is_nan()).for_each(|v| *v = 0.0);
        }
        part.cell_data = cells
            .iter()
            .map(|f| rows_of(f, &rows))
            .filter(|f| !f.values.iter().all(|v| v.is_nan()))
            .collect();
        if let (true, Some(index)) = (name == "bones", index) {
            let absent = |b: &&MovingBone| plan.mesh.blocks.iter().all(|block| block.name != b.name);
            beside.bones.iter().filter(absent).for_each(|bone| add_bone(&mut part, bone, index));
        }
        if !part.mesh.blocks.is_empty() {
            parts.push(part);
        }
    }
    parts
}

const CONTACT_PRESSURE: &str = "contact_pressure_Pa";

/// The rows of a field.
fn rows_of(field: &vtu::Field<'static>, rows: &[usize]) -> vtu::Field<'static> {
    let n = field.components;
    let values: Vec<f64> = rows.iter().flat_map(|r| &field.values[n * r..n * (r + 1)]).copied().collect();
    vtu::Field { name: field.name.clone(), components: n, values: values.into() }
}

/// Adds a bone that the plan does not know, with its displacement; other fields do not exist on it.
fn add_bone(part: &mut Part, bone: &MovingBone, index: usize) {
    let pose = bone.poses[index];
    let shift = part.mesh.points.len() as u32;
    let moved: Vec<[f64; 3]> =
        bone.surface.points.iter().map(|p| (pose * nalgebra::Point3::from(*p)).coords.into()).collect();
    let nodes = bone.surface.triangles.iter().flatten().map(|n| n + shift).collect();
    part.mesh.blocks.push(CellBlock { name: bone.name.clone(), kind: CellKind::Tri3, nodes });
    part.point_data.retain(|f| f.name == DISPLACEMENT);
    if part.point_data.is_empty() {
        part.point_data.push(vtu::Field {
            name: DISPLACEMENT.into(),
            components: 3,
            values: Vec::new().into(),
        });
    }
    let rest = bone.surface.points.iter();
    let by = moved.iter().zip(rest).flat_map(|(p, rest)| [p[0] - rest[0], p[1] - rest[1], p[2] - rest[2]]);
    part.point_data[0].values.to_mut().extend(by);
    part.mesh.points.extend(moved);
}

const DISPLACEMENT: &str = "displacement_m";

/// Fields of a frame over the whole mesh of its plan, at nodes and in cells; not a number where one does not exist.
///
/// | where | field |
/// |---|---|
/// | nodes | `displacement_m` from the mesh, with inertia `velocity_m_per_s`, with contact `contact_pressure_Pa` (force per reference area) |
/// | solids | `cauchy_Pa` (mean over the cell, 3×3 by rows), `von_mises_Pa`, `pressure_Pa`, `volume_ratio`; where the law has fibres `stretch` and `fibre_direction` (unit vector, deformed) |
/// | fibres, strands | `stretch`, `force_N`, `fibre_direction` (unit vector, deformed) |
/// | membranes | `tension_N_per_m` (Cauchy stress times thickness, 3×3 by rows), `area_ratio` |
pub fn fields(plan: &Plan, frame: &Frame) -> (Vec<vtu::Field<'static>>, Vec<vtu::Field<'static>>) {
    let mut points = vec![field(
        DISPLACEMENT,
        3,
        frame.x.iter().zip(plan.reference()).map(|(x, rest)| x - rest).collect(),
    )];
    if !frame.v.is_empty() {
        points.push(field("velocity_m_per_s", 3, frame.v.clone()));
    }
    let surfaces: BTreeSet<&str> = plan
        .islands
        .iter()
        .filter_map(|island| island.contact.as_ref())
        .flat_map(|contact| contact.surfaces.list.iter().map(|s| s.name.as_str()))
        .collect();
    if !surfaces.is_empty() {
        let mut pressure = vec![f64::NAN; plan.mesh.points.len()];
        for (node, t) in surfaces.iter().flat_map(|s| contact_tractions(plan, frame.snapshot(), s)) {
            pressure[node as usize] = t.iter().map(|c| c * c).sum::<f64>().sqrt();
        }
        points.push(field(CONTACT_PRESSURE, 1, pressure));
    }
    (points, cell_fields(plan, frame))
}

fn field(name: &'static str, components: usize, values: Vec<f64>) -> vtu::Field<'static> {
    vtu::Field { name: name.into(), components, values: values.into() }
}

/// Names and components of the fields in cells.
const CELL_FIELDS: [(&str, usize); 9] = [
    ("von_mises_Pa", 1),
    ("pressure_Pa", 1),
    ("volume_ratio", 1),
    ("cauchy_Pa", 9),
    ("stretch", 1),
    ("force_N", 1),
    ("fibre_direction", 3),
    ("tension_N_per_m", 9),
    ("area_ratio", 1),
];

fn cell_fields(plan: &Plan, frame: &Frame) -> Vec<vtu::Field<'static>> {
    let n = plan.mesh.n_cells();
    let mut columns = CELL_FIELDS.map(|(_, components)| vec![f64::NAN; components * n]);
    let mut set = |column: usize, cell: usize, values: &[f64]| {
        let n = CELL_FIELDS[column].1;
        columns[column][n * cell..n * (cell + 1)].copy_from_slice(values);
    };
    let mut first = 0;
    for block in &plan.mesh.blocks {
        if let Some(cells) = solid_field(plan, frame.snapshot(), &block.name) {
            for (cell, state) in (first..).zip(cells) {
                let [a, b, c] = state.principal;
                set(0, cell, &[(((a - b).powi(2) + (b - c).powi(2) + (c - a).powi(2)) / 2.0).sqrt()]);
                set(1, cell, &[-(a + b + c) / 3.0]);
                set(2, cell, &[state.volume_ratio]);
                set(3, cell, state.cauchy.transpose().as_slice()); // stored by columns
                if let Some(fibre) = state.fibre {
                    set(4, cell, &[fibre.norm()]);
                    set(6, cell, unit(fibre).as_slice());
                }
            }
        } else if block.kind == CellKind::Line2
            && let Some(lines) = fibre_states(plan, frame.snapshot(), &block.name)
            && lines.len() == block.n_cells()
        {
            for ((cell, state), ends) in (first..).zip(lines).zip(block.cells()) {
                let at = |n: u32| nalgebra::Vector3::from_column_slice(&frame.x[3 * n as usize..][..3]);
                set(4, cell, &[state.stretch]);
                set(5, cell, &[state.force]);
                set(6, cell, unit(at(ends[1]) - at(ends[0])).as_slice());
            }
        } else if let Some(cells) = membrane_field(plan, frame.snapshot(), &block.name) {
            for (cell, state) in (first..).zip(cells) {
                set(7, cell, state.tension.transpose().as_slice());
                set(8, cell, &[state.area_ratio]);
            }
        }
        first += block.n_cells();
    }
    let all = CELL_FIELDS.into_iter().zip(columns);
    let filled = all.filter(|(_, values)| values.iter().any(|v| !v.is_nan()));
    filled.map(|((name, components), values)| field(name, components, values)).collect()
}

/// Direction of a vector; zero where it has none.
fn unit(v: nalgebra::Vector3<f64>) -> nalgebra::Vector3<f64> {
    v.try_normalize(0.0).unwrap_or_default()
}
