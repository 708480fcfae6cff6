//! The page of `mesh`: verdict, pictures, quality per muscle.

use std::fmt::Write;

use mesher::{Bone, Built, GOALS, MuscleBlock};
use serde::Serialize;

use super::anatomy::{self, View};
use super::page::{document, label_table, section, table};
use super::svg::{escape, fixed};
use coupling::number::short;
use coupling::thigh::build::Thigh;
use coupling::thigh::inventory::{Hold, MuscleInventory};

/// Where the section is drawn: the middle between hip and knee centre of the built-in thigh \[m\].
const MID_THIGH: f64 = -0.206;

/// Everything that the page of `mesh` shows.
#[derive(Clone, Copy, Debug)]
pub struct MeshReport<'a> {
    /// Name of the input, e.g. `thigh`.
    pub name: &'a str,
    /// The meshes.
    pub built: &'a Built,
    /// Bones that the muscles keep out of.
    pub bones: &'a [Bone],
    /// Muscles with fibres, shells and tendons.
    pub thigh: &'a Thigh,
    /// Fibres, attachments and lines of action, a row per muscle.
    pub inventory: &'a [MuscleInventory],
    /// Settings as label and value.
    pub settings: &'a [(String, String)],
}

/// The numbers that decide.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshSummary {
    /// Muscles.
    pub muscles: usize,
    /// Hexahedra.
    pub elements: usize,
    /// Nodes.
    pub nodes: usize,
    /// Least scaled Jacobian of a cell.
    pub least_scaled_jacobian: f64,
    /// Least mean scaled Jacobian of a muscle.
    pub least_mean_scaled_jacobian: f64,
    /// Least distance between two muscles \[mm\].
    pub least_gap_mm: Option<f64>,
    /// Largest distance from the loft that 95 % of the surface nodes of a muscle keep \[mm\].
    pub largest_p95_deviation_mm: f64,
    /// Largest relative error of a volume \[%\].
    pub largest_volume_error_percent: f64,
    /// Mean way of the surface nodes along their normals while muscles were moved apart, of the muscle that moved most \[mm\].
    pub largest_mean_move_mm: f64,
    /// Largest such way of a node \[mm\].
    pub largest_move_mm: f64,
    /// Largest relative change of a muscle's volume by that \[%\].
    pub largest_volume_change_percent: f64,
    /// Deepest crossing with a bone \[mm\].
    pub deepest_bone_crossing_mm: f64,
    /// Goals that are missed.
    pub missed: Vec<String>,
}

impl MeshSummary {
    /// Counts and extremes of a report.
    pub fn of(report: &MeshReport) -> MeshSummary {
        let muscles = &report.built.muscles;
        let least = |values: &mut dyn Iterator<Item = f64>| values.fold(f64::INFINITY, f64::min);
        let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
        let gap = least(&mut muscles.iter().filter_map(|m| Some(m.gap?.0)));
        MeshSummary {
            muscles: muscles.len(),
            elements: muscles.iter().map(|m| m.block.n_cells()).sum(),
            nodes: muscles.iter().map(|m| m.block.points.len()).sum(),
            least_scaled_jacobian: least(&mut muscles.iter().map(|m| m.quality.least_scaled_jacobian)),
            least_mean_scaled_jacobian: least(&mut muscles.iter().map(|m| m.quality.mean_scaled_jacobian)),
            least_gap_mm: gap.is_finite().then_some(gap * 1e3),
            largest_p95_deviation_mm: most(&mut muscles.iter().map(|m| m.deviation[1] * 1e3)),
            largest_volume_error_percent: most(
                &mut muscles.iter().map(|m| 100.0 * (m.quality.volume / m.loft_volume - 1.0).abs()),
            ),
            largest_mean_move_mm: most(&mut muscles.iter().map(|m| m.moved[0] * 1e3)),
            largest_move_mm: most(&mut muscles.iter().map(|m| m.moved[1] * 1e3)),
            largest_volume_change_percent: most(
                &mut muscles.iter().map(|m| 100.0 * (m.quality.volume / m.volume_before - 1.0).abs()),
            ),
            deepest_bone_crossing_mm: most(&mut report.built.bone_crossings.iter().map(|c| c.depth * 1e3)),
            missed: report.built.missed(report.bones),
        }
    }
}

/// The page as one HTML file.
pub fn mesh_page(report: &MeshReport) -> String {
    let summary = MeshSummary::of(report);
    let body = [
        headline(report, &summary),
        pictures(report),
        qualities(report),
        holds(report),
        lines(report),
        details(report),
    ]
    .concat();
    document(&format!("{} · mesh · Sartorius", report.name), &body)
}

fn headline(report: &MeshReport, s: &MeshSummary) -> String {
    let mut out = format!(
        "<header>\n<p class=\"eyebrow\">Sartorius · hexahedral muscle meshes</p>\n<h1>{}</h1>\n",
        escape(report.name)
    );
    let (class, verdict, detail) = if s.missed.is_empty() {
        (
            "ok",
            "All goals reached".to_string(),
            "Gaps and crossings by an exact test of all triangles.".to_string(),
        )
    } else {
        ("bad", format!("{} goals missed", s.missed.len()), s.missed.join("; "))
    };
    let _ =
        writeln!(out, "<p class=\"verdict {class}\"><b>{verdict}</b><span>{}</span></p>", escape(&detail));
    let tiles = [
        ("Elements", s.elements.to_string(), "", format!("{} nodes in {} muscles", s.nodes, s.muscles)),
        (
            "Least scaled Jacobian",
            fixed(s.least_scaled_jacobian, 2),
            "",
            format!(
                "wanted {}; least mean of a muscle {}",
                GOALS.least_scaled_jacobian,
                fixed(s.least_mean_scaled_jacobian, 2)
            ),
        ),
        (
            "Least gap",
            fixed(s.least_gap_mm.unwrap_or(f64::NAN), 3),
            "mm",
            format!("between two muscles; wanted {}", short(GOALS.gap * 1e3)),
        ),
        (
            "Off the sections' surface",
            fixed(s.largest_p95_deviation_mm, 2),
            "mm",
            "95 % of the surface nodes, worst muscle".to_string(),
        ),
        ("Volume", fixed(s.largest_volume_error_percent, 1), "%", "largest error of a muscle".to_string()),
    ];
    out.push_str("<div class=\"tiles\">\n");
    for (label, value, unit, below) in tiles {
        let _ = writeln!(
            out,
            "<div class=\"tile\"><span>{label}</span><b>{value} <small>{unit}</small></b><span>{}</span></div>",
            escape(&below)
        );
    }
    out.push_str("</div>\n</header>\n");
    out
}

fn blocks<'a>(report: &MeshReport<'a>) -> Vec<&'a MuscleBlock> {
    report.built.muscles.iter().map(|m| &m.block).collect()
}

fn pictures(report: &MeshReport) -> String {
    let muscles = blocks(report);
    let tendons = report.thigh.tendon_faces();
    let figure =
        |title: &str, svg: String| format!("<figure><figcaption><b>{title}</b></figcaption>\n{svg}</figure>");
    let views = [
        figure("From the front", anatomy::view(&muscles, report.bones, &tendons, View::Front)),
        figure("From the right", anatomy::view(&muscles, report.bones, &tendons, View::Side)),
    ];
    let cut = figure(
        &format!("Section at y = {} mm, seen from above; the front is at the top", fixed(MID_THIGH * 1e3, 0)),
        anatomy::section(&muscles, report.bones, MID_THIGH),
    );
    let row = format!("<div class=\"views\">\n{}\n{cut}</div>\n", views.join("\n"));
    let content = [anatomy::legend(&muscles), row].concat();
    section(
        "Pictures",
        "Every face and every cut cell of the mesh is drawn; solid tendons and strands are pale.",
        &content,
    )
}

fn qualities(report: &MeshReport) -> String {
    let header = [
        "Muscle",
        "Elements",
        "Nodes",
        "Least scaled Jacobian",
        "Mean",
        "Volume, cm³",
        "of the loft, %",
        "Off the loft: mean, mm",
        "95 %",
        "largest",
        "Moved apart: mean, mm",
        "largest, mm",
        "volume, %",
        "Least gap, mm",
        "to",
    ];
    let muscles = &report.built.muscles;
    let rows: Vec<Vec<String>> = muscles
        .iter()
        .map(|m| {
            let (gap, to) = m.gap.map_or(("–".into(), String::new()), |(gap, j)| {
                (fixed(gap * 1e3, 3), muscles[j].block.name.replace('_', " "))
            });
            vec![
                m.block.name.replace('_', " "),
                m.block.n_cells().to_string(),
                m.block.points.len().to_string(),
                fixed(m.quality.least_scaled_jacobian, 3),
                fixed(m.quality.mean_scaled_jacobian, 3),
                fixed(m.quality.volume * 1e6, 1),
                fixed(100.0 * (m.quality.volume / m.loft_volume - 1.0), 2),
                fixed(m.deviation[0] * 1e3, 2),
                fixed(m.deviation[1] * 1e3, 2),
                fixed(m.deviation[2] * 1e3, 2),
                fixed(m.moved[0] * 1e3, 2),
                fixed(m.moved[1] * 1e3, 2),
                fixed(100.0 * (m.quality.volume / m.volume_before - 1.0), 2),
                gap,
                to,
            ]
        })
        .collect();
    let mut content = table(&header, 1, &rows);
    let crossings: Vec<Vec<String>> = report
        .built
        .bone_crossings
        .iter()
        .map(|c| {
            let block = &muscles[c.muscle].block;
            let end = if c.layers[1] == 0 {
                "origin".to_string()
            } else if c.layers[0] + 2 == block.n_layers() {
                "insertion".to_string()
            } else {
                format!("layers {} to {} of {}", c.layers[0], c.layers[1], block.n_layers() - 1)
            };
            vec![
                block.name.replace('_', " "),
                report.bones[c.bone].name.replace('_', " "),
                end,
                fixed(c.depth * 1e3, 2),
            ]
        })
        .collect();
    if !crossings.is_empty() {
        content.push_str("<h3>Muscles that reach into a bone</h3>\n");
        content.push_str(&table(&["Muscle", "Bone", "Where", "Depth, mm"], 3, &crossings));
    }
    section(
        "Quality",
        "Gap: least distance between the triangles of two surfaces, quadrilaterals cut in two and in four. Moved apart: way of the surface nodes along their normals, and change of volume, to keep clear of neighbours and bones. Off the loft: distance of the nodes of the lateral surface from the surface through the sections, which holds what smoothing and separating moved.",
        &content,
    )
}

fn holds(report: &MeshReport) -> String {
    let header = [
        "Muscle",
        "Origin",
        "Insertion",
        "Fibres",
        "their area, mm²",
        "Section to fill, mm²",
        "Mean of the mesh, mm²",
        "Origin: end face, mm²",
        "side, mm²",
        "tendon, mm",
        "Insertion: end face, mm²",
        "side, mm²",
        "tendon, mm",
    ];
    let bones = |h: &Hold| h.bones.join(", ").replace('_', " ");
    let length = |x: f64| if x > 0.0 { fixed(x, 0) } else { "–".into() };
    let rows: Vec<Vec<String>> = report
        .inventory
        .iter()
        .map(|m| {
            let mut row = vec![
                m.name.replace('_', " "),
                bones(&m.origin),
                bones(&m.insertion),
                m.fibres.to_string(),
                fixed(m.fibre_area_mm2, 1),
                fixed(m.section_mm2, 1),
                fixed(m.mean_section_mm2, 0),
            ];
            for hold in [&m.origin, &m.insertion] {
                row.extend([length(hold.face_mm2), length(hold.side_mm2), length(hold.tendon_mm)]);
            }
            row
        })
        .collect();
    section(
        "Fibres and attachments",
        "Section to fill: the physiological cross-section of the rigid leg's lines where the muscle has some, else the mean section. Side: the part of the lateral surface that grows from bone. Tendon: its length from the end of the mesh to the bone.",
        &table(&header, 3, &rows),
    )
}

fn lines(report: &MeshReport) -> String {
    let header = [
        "Muscle",
        "Why more than 15",
        "Angle, degrees",
        "Nearest rigid line, degrees",
        "Fibres fan out by",
        "Nearest fibre to the rigid line",
        "End to end",
        "Rigid origin off, mm",
        "Rigid insertion off, mm",
    ];
    let with_lines = report.inventory.iter().filter_map(|m| Some((m, m.line.as_ref()?)));
    let rows: Vec<Vec<String>> = with_lines
        .map(|(m, l)| {
            let numbers = [
                (l.angle_deg, 1),
                (l.nearest_line_deg, 1),
                (l.spread_deg, 1),
                (l.nearest_fibre_deg, 1),
                (l.ends_deg, 1),
                (l.origin_off_mm, 0),
                (l.insertion_off_mm, 0),
            ];
            let texts = [m.name.replace('_', " "), l.explanation.clone()];
            texts.into_iter().chain(numbers.map(|(x, digits)| fixed(x, digits))).collect()
        })
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    section(
        "Lines of action",
        "Tangent to the line through the centres of the sections at mid belly, against the direction of the rigid leg's lines, standing. Off: how far the nearest rigid line begins and ends from where the mesh holds on to bone.",
        &table(&header, 2, &rows),
    )
}

fn details(report: &MeshReport) -> String {
    section("Details", "", &label_table("Settings", report.settings))
}
