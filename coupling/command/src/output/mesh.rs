//! What `mesh` writes.

use std::io::{self, Write};
use std::time::Instant;

use fem::mesh::format::{abaqus, vtu};
use fem::mesh::quality::scaled_jacobian;
use fem::mesh::{CellBlock, CellKind, Mesh};
use nalgebra::Vector3;

use super::atomic::OutputFolder;
use super::run::RunRecord;
use crate::error::CommandError;
use crate::report::mesh::{MeshReport, MeshSummary, mesh_page};
use coupling::thigh::inventory::Hold;

/// Writes meshes, table, page and, last of all, `run.json` into `out`, and returns the names of the files.
pub fn write_mesh(
    mut out: OutputFolder,
    report: &MeshReport,
    mut record: RunRecord,
) -> Result<Vec<String>, CommandError> {
    let started = Instant::now();
    let mesh = whole_mesh(report);
    let shape = cell_shape(&mesh);
    let field = vtu::Field::new("scaled_jacobian", 1, &shape);
    out.place(&format!("{}.vtu", report.name), |path| {
        vtu::write(path, &mesh, &[], &[field]).map_err(CommandError::from)
    })?;
    out.place(&format!("{}.inp", report.name), |path| {
        abaqus::write(path, &mesh).map_err(CommandError::from)
    })?;
    out.write("quality.csv", |w| write_quality(w, report))?;
    out.write("muscles.csv", |w| write_muscles(w, report))?;
    out.write("bone_crossings.csv", |w| write_crossings(w, report))?;
    let page = mesh_page(report);
    out.write("report.html", |w| w.write_all(page.as_bytes()))?;
    record.verdict = serde_json::to_value(MeshSummary::of(report)).ok();
    Ok(super::finish(out, &mut record, started)?)
}

/// Muscles with fibres, shells and tendons, and bones, as one mesh.
fn whole_mesh(report: &MeshReport) -> Mesh {
    let mut mesh = report.thigh.mesh.clone();
    for bone in report.bones {
        let shift = mesh.points.len() as u32;
        mesh.points.extend(&bone.surface.points);
        let nodes = bone.surface.triangles.iter().flatten().map(|n| n + shift).collect();
        mesh.blocks.push(CellBlock { name: bone.name.clone(), kind: CellKind::Tri3, nodes });
    }
    mesh
}

/// Scaled Jacobian of every solid cell, 1 for the others.
fn cell_shape(mesh: &Mesh) -> Vec<f64> {
    let shape = |block: &CellBlock, nodes: &[u32]| {
        let corners: Vec<Vector3<f64>> =
            nodes.iter().map(|&n| Vector3::from(mesh.points[n as usize])).collect();
        if block.kind.is_solid() { scaled_jacobian(block.kind, &corners) } else { 1.0 }
    };
    mesh.blocks.iter().flat_map(|block| block.cells().map(move |nodes| shape(block, nodes))).collect()
}

fn write_quality(w: &mut dyn Write, report: &MeshReport) -> io::Result<()> {
    writeln!(
        w,
        "muscle,elements,nodes,least_scaled_jacobian,mean_scaled_jacobian,least_gauss_det_mm3,volume_cm3,loft_volume_cm3,\
         mean_deviation_mm,p95_deviation_mm,largest_deviation_mm,mean_move_mm,largest_move_mm,\
         volume_before_moving_cm3,least_gap_mm,nearest_muscle,self_crossings"
    )?;
    let muscles = &report.built.muscles;
    for m in muscles {
        let (gap, nearest) = m.gap.map_or((String::new(), ""), |(gap, j)| {
            (format!("{:.4}", gap * 1e3), muscles[j].block.name.as_str())
        });
        let q = &m.quality;
        writeln!(
            w,
            "{},{},{},{:.4},{:.4},{:.6},{:.4},{:.4},{:.4},{:.4},{:.4},{:.4},{:.4},{:.4},{gap},{nearest},{}",
            m.block.name,
            m.block.n_cells(),
            m.block.points.len(),
            q.least_scaled_jacobian,
            q.mean_scaled_jacobian,
            q.least_gauss_det * 1e9,
            q.volume * 1e6,
            m.loft_volume * 1e6,
            m.deviation[0] * 1e3,
            m.deviation[1] * 1e3,
            m.deviation[2] * 1e3,
            m.moved[0] * 1e3,
            m.moved[1] * 1e3,
            m.volume_before * 1e6,
            m.self_crossings
        )?;
    }
    Ok(())
}

fn write_muscles(w: &mut dyn Write, report: &MeshReport) -> io::Result<()> {
    writeln!(
        w,
        "muscle,fibres,fibre_area_mm2,section_mm2,mean_section_mm2,origin_bones,origin_face_mm2,origin_side_mm2,origin_tendon_mm,\
         insertion_bones,insertion_face_mm2,insertion_side_mm2,insertion_tendon_mm,line_x,line_y,line_z,rigid_x,rigid_y,rigid_z,\
         angle_deg,nearest_rigid_line,nearest_rigid_line_deg,fibre_spread_deg,nearest_fibre_deg,end_to_end_deg,\
         rigid_origin_off_mm,rigid_insertion_off_mm,explanation"
    )?;
    for m in report.inventory {
        let hold = |h: &Hold| {
            format!("{},{:.2},{:.2},{:.2}", h.bones.join(" "), h.face_mm2, h.side_mm2, h.tendon_mm)
        };
        let line = m.line.as_ref().map_or(",".repeat(14), |l| {
            let [x, y, z] = l.mesh;
            let [a, b, c] = l.rigid;
            format!(
                "{x:.4},{y:.4},{z:.4},{a:.4},{b:.4},{c:.4},{:.2},{},{:.2},{:.2},{:.2},{:.2},{:.2},{:.2},\"{}\"",
                l.angle_deg,
                l.nearest_line,
                l.nearest_line_deg,
                l.spread_deg,
                l.nearest_fibre_deg,
                l.ends_deg,
                l.origin_off_mm,
                l.insertion_off_mm,
                l.explanation
            )
        });
        writeln!(
            w,
            "{},{},{:.4},{:.4},{:.2},{},{},{line}",
            m.name,
            m.fibres,
            m.fibre_area_mm2,
            m.section_mm2,
            m.mean_section_mm2,
            hold(&m.origin),
            hold(&m.insertion)
        )?;
    }
    Ok(())
}

fn write_crossings(w: &mut dyn Write, report: &MeshReport) -> io::Result<()> {
    writeln!(w, "muscle,bone,depth_mm,first_layer,last_layer,layers")?;
    for c in &report.built.bone_crossings {
        let block = &report.built.muscles[c.muscle].block;
        let bone = &report.bones[c.bone].name;
        let [first, last] = c.layers;
        writeln!(w, "{},{bone},{:.4},{first},{last},{}", block.name, c.depth * 1e3, block.n_layers() - 1)?;
    }
    Ok(())
}
