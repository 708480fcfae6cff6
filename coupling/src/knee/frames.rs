//! A bent knee as ParaView sees it: what moves frame by frame, and the femur, which does not.

use std::path::Path;

use fem::geometry::Surface;
use fem::measure::solid_field;
use fem::mesh::format::pvd::{Part, PvdWriter};
use fem::mesh::format::vtu::Field;
use fem::mesh::{CellBlock, CellKind, Mesh, MeshError};
use nalgebra::{Isometry3, Point3};

use super::anatomy::{Bone, KneeAnatomy};
use super::flexion::Bent;

/// Name of the series of frames.
pub const FRAMES: &str = "knee";
/// Name of the femur beside it.
pub const FEMUR: &str = "femur";

/// Writes `knee.pvd` with a step per frame, its time the knee flexion \[degrees\], and `femur.pvd`, all in the frame of the femur.
pub fn write_frames(folder: &Path, anatomy: &KneeAnatomy, bent: &Bent) -> Result<(), MeshError> {
    let own = |bone: Bone| anatomy.frame(bone).inverse();
    let mut femur = Mesh::default();
    add(&mut femur, "femur", &anatomy.femur, &own(Bone::Femur));
    add(&mut femur, "femoral_cartilage", &anatomy.femoral_cartilage, &own(Bone::Femur));
    PvdWriter::create(folder, FEMUR)?.push(0.0, &femur, &[], &[])?;
    let mut series = PvdWriter::create(folder, FRAMES)?;
    for (k, frame) in bent.frames.iter().enumerate() {
        let mut bones = Part { name: "bones", mesh: Mesh::default(), point_data: vec![], cell_data: vec![] };
        let tibia = frame.tibia.pose() * own(Bone::Tibia);
        let patella = frame.patella.pose() * own(Bone::Patella);
        for (name, surface) in ["medial", "lateral"].into_iter().zip(&anatomy.tibial_cartilage) {
            add(&mut bones.mesh, &format!("tibial_cartilage_{name}"), surface, &tibia);
        }
        add(&mut bones.mesh, "patella", &anatomy.patella, &patella);
        add(&mut bones.mesh, "patellar_cartilage", &anatomy.patellar_cartilage, &patella);
        let mut strands = Mesh::default();
        let (mut tension, mut strain) = (Vec::new(), Vec::new());
        for ((name, way), state) in bent.knee.strands.iter().zip(&frame.ways).zip(&frame.strands) {
            let first = strands.points.len() as u32;
            strands.points.extend(way.iter().map(|p| <[f64; 3]>::from(*p)));
            let segments = (first..strands.points.len() as u32 - 1).flat_map(|n| [n, n + 1]).collect();
            strands.blocks.push(CellBlock { name: name.clone(), kind: CellKind::Line2, nodes: segments });
            tension.extend(std::iter::repeat_n(state.tension, way.len() - 1));
            strain.extend(std::iter::repeat_n(state.strain, way.len() - 1));
        }
        let cell_data = vec![field("tension_N", tension), field("strain", strain)];
        let strands = Part { name: "strands", mesh: strands, point_data: vec![], cell_data };
        let muscles = bent.knee.muscles.as_ref().map(|_| muscles(bent, k));
        let parts: Vec<Part> = [bones, strands].into_iter().chain(muscles).collect();
        series.push_parts(frame.tibia.flexion, &parts)?;
    }
    Ok(())
}

/// Cells of the heads of the quadriceps in a frame, with their greatest principal stress \[Pa\].
fn muscles(bent: &Bent, k: usize) -> Part {
    let (plan, at) = (&bent.knee.plan, bent.run.frames[k].snapshot());
    let mut mesh = Mesh { points: at.x.as_chunks::<3>().0.to_vec(), ..Mesh::default() };
    let mut stress = Vec::new();
    for block in plan.mesh.blocks.iter().filter(|b| b.kind == CellKind::Hex8) {
        mesh.blocks.push(block.clone());
        let cells = solid_field(plan, at, &block.name).unwrap_or_default();
        stress.extend(cells.iter().map(|c| c.principal[0]));
    }
    Part { name: "muscles", mesh, point_data: vec![], cell_data: vec![field("principal_stress_Pa", stress)] }
}

fn field(name: &'static str, values: Vec<f64>) -> Field<'static> {
    Field { name: name.into(), components: 1, values: values.into() }
}

/// Adds a surface where a pose has it.
fn add(mesh: &mut Mesh, name: &str, surface: &Surface, pose: &Isometry3<f64>) {
    let first = mesh.points.len() as u32;
    mesh.points.extend(surface.points.iter().map(|p| <[f64; 3]>::from(pose * Point3::from(*p))));
    let nodes = surface.triangles.iter().flatten().map(|n| n + first).collect();
    mesh.blocks.push(CellBlock { name: name.into(), kind: CellKind::Tri3, nodes });
}
