//! Where muscles hold on to bones: end faces, patches of the side, and tendons (`gait-data/thigh/attachments.csv`).

use std::path::Path;

use nalgebra::Vector3;

use super::table::Table;
use super::{MuscleBlock, N_OUTLINE};
use fem::mesh::MeshError;

/// Which end of the muscle an attachment serves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The origin.
    Origin,
    /// The insertion.
    Insertion,
    /// None: the muscle only touches the bone there.
    Contact,
}

/// Which part of the muscle is meant.
#[derive(Clone, Debug, PartialEq)]
pub enum Site {
    /// The first or last section as a whole.
    EndFace,
    /// A part of the side.
    SidePatch {
        /// Range of s along the muscle.
        s: [f64; 2],
        /// From and to which outline parameter (0..14), counter-clockwise; `from > to` passes through 14 = 0.
        outline: [f64; 2],
    },
    /// The part of an end section that is nearest to where the tendon starts.
    EndSpot,
}

/// One attachment of a muscle.
#[derive(Clone, Debug, PartialEq)]
pub struct Attachment {
    /// Muscle.
    pub muscle: String,
    /// Origin, insertion or mere contact.
    pub role: Role,
    /// Which part of the muscle.
    pub site: Site,
    /// Segment that carries the bone: `pelvis`, `thigh`, `patella` or `shank`.
    pub segment: String,
    /// Bone, e.g. `hip_bone`.
    pub bone: String,
    /// Points of the tendon \[m\] from the muscle to the bone; empty: the muscle itself reaches the bone.
    pub tendon: Vec<Vector3<f64>>,
    /// Where the line of action of the rigid leg ends \[m\].
    pub reference_point: Option<Vector3<f64>>,
    /// Where the tendon, if it is to be a solid, meets the bone.
    pub footprint: Option<Footprint>,
}

/// A patch of bone on which a solid tendon ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Middle \[m\].
    pub centre: Vector3<f64>,
    /// From there to its ends along the longer and the shorter side \[m\].
    pub half_sides: [Vector3<f64>; 2],
}

/// Columns that are read.
const COLUMNS: [&str; 11] = [
    "muscle",
    "end",
    "kind",
    "segment",
    "bone",
    "s_from",
    "s_to",
    "side",
    "tendon",
    "tendon_path_mm",
    "reference_point_mm",
];
/// Segments that a muscle of the thigh can hold on to.
const SEGMENTS: [&str; 4] = ["pelvis", "thigh", "patella", "shank"];

impl Attachment {
    /// Reads the table, lengths in mm. `file` is the name for messages. Rows of tendons that belong to no muscle
    /// (the patellar ligament) are kept with that name.
    pub fn read_csv(text: &str, file: &Path) -> Result<Vec<Attachment>, MeshError> {
        let mut table = Table::read(text, file)?;
        table.require(&COLUMNS)?;
        let mut attachments = Vec::new();
        for row in table.rows() {
            let row = row?;
            let cell = |name: &str| row.optional(name).unwrap_or_default();
            attachments.push(attachment(cell).map_err(|reason| row.bad(reason))?);
        }
        Ok(attachments)
    }

    /// Nodes of the block that are meant, sorted; empty for a patch that no node lies in.
    pub fn nodes(&self, block: &MuscleBlock) -> Vec<u32> {
        let layer = if self.role == Role::Origin { 0 } else { block.n_layers() - 1 };
        match &self.site {
            Site::EndFace => (0..block.nodes_per_section as u32).map(|n| block.node(layer, n)).collect(),
            Site::SidePatch { s, outline } => (0..block.n_layers())
                .filter(|&l| s[0] <= block.s[l] && block.s[l] <= s[1])
                .flat_map(|l| {
                    let inside = block.outline_parameter.iter().map(|&t| between(t, *outline));
                    block
                        .outline
                        .iter()
                        .zip(inside)
                        .filter(|(_, inside)| *inside)
                        .map(move |(&n, _)| block.node(l, n))
                })
                .collect(),
            Site::EndSpot => {
                let Some(start) = self.tendon.first() else { return Vec::new() };
                let mut near: Vec<(f64, u32)> = (0..block.nodes_per_section as u32)
                    .map(|n| ((block.point(layer, n) - start).norm(), block.node(layer, n)))
                    .collect();
                near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                let mut nodes: Vec<u32> = near.iter().take(END_SPOT_NODES).map(|n| n.1).collect();
                nodes.sort_unstable();
                nodes
            }
        }
    }
}

/// Nodes of an end section that a partial tendon takes hold of.
const END_SPOT_NODES: usize = 6;

/// Whether an outline parameter lies in a range that may pass through 14 = 0.
fn between(t: f64, [from, to]: [f64; 2]) -> bool {
    let period = N_OUTLINE as f64;
    let (t, from, to) = (t.rem_euclid(period), from.rem_euclid(period), to.rem_euclid(period));
    if from <= to { (from..=to).contains(&t) } else { t >= from || t <= to }
}

fn attachment<'a>(cell: impl Fn(&str) -> &'a str) -> Result<Attachment, String> {
    let number = |text: &str, name: &str| {
        let value = text.parse().ok().filter(|v: &f64| v.is_finite());
        value.ok_or_else(|| format!("{name} is `{text}`; give a finite number"))
    };
    let point = |text: &str, name: &str| {
        let numbers: Vec<f64> =
            text.split_whitespace().map(|t| number(t, name)).collect::<Result<_, String>>()?;
        match numbers[..] {
            [x, y, z] if [x, y, z].iter().all(|v| v.abs() < 2000.0) => Ok(Vector3::new(x, y, z) * 1e-3),
            [_, _, _] => {
                Err(format!("{name} holds `{text}`, farther than 2 m from the hip; lengths are in mm"))
            }
            _ => Err(format!("{name} holds `{text}`; give three numbers in mm")),
        }
    };
    let role = match cell("end") {
        "origin" => Role::Origin,
        "insertion" => Role::Insertion,
        "contact" => Role::Contact,
        other => return Err(format!("end is `{other}`; known are origin, insertion, contact")),
    };
    let site = match cell("kind") {
        "end_face" => Site::EndFace,
        "tendon_only" => Site::EndSpot,
        "side_patch" => {
            let s = [number(cell("s_from"), "s_from")?, number(cell("s_to"), "s_to")?];
            if !(0.0 <= s[0] && s[0] <= s[1] && s[1] <= 1.0) {
                return Err(format!("s runs from {} to {}; give 0 <= s_from <= s_to <= 1", s[0], s[1]));
            }
            let side = cell("side");
            let range = side.split_once("(points ").and_then(|(_, r)| r.strip_suffix(')')?.split_once('-'));
            let Some((from, to)) = range else {
                return Err(format!("side is `{side}`; it must end in (points FROM-TO)"));
            };
            let outline = [number(from, "side")?, number(to, "side")?];
            if outline.iter().any(|t| !(0.0..N_OUTLINE as f64).contains(t)) {
                return Err(format!("side is `{side}`; points are numbered 0 to {}", N_OUTLINE - 1));
            }
            Site::SidePatch { s, outline }
        }
        other => return Err(format!("kind is `{other}`; known are end_face, side_patch, tendon_only")),
    };
    let segment = cell("segment");
    if !SEGMENTS.contains(&segment) {
        return Err(format!("segment is `{segment}`; known are {}", SEGMENTS.join(", ")));
    }
    let tendon = match (cell("tendon"), cell("tendon_path_mm")) {
        ("yes", path) => {
            path.split(';').map(|p| point(p, "tendon_path_mm")).collect::<Result<Vec<_>, _>>()?
        }
        ("no", _) => Vec::new(),
        (other, _) => return Err(format!("tendon is `{other}`; give yes or no")),
    };
    let reference_point = match cell("reference_point_mm") {
        "" => None,
        text => Some(point(text, "reference_point_mm")?),
    };
    let footprint = match cell("footprint_mm") {
        "" => None,
        text => {
            let parts: Vec<Vector3<f64>> =
                text.split(';').map(|p| point(p, "footprint_mm")).collect::<Result<_, _>>()?;
            let [centre, long, short] = parts[..] else {
                return Err(format!("footprint_mm is `{text}`; give its middle and two half sides"));
            };
            if long.cross(&short).norm() == 0.0 {
                return Err(format!("footprint_mm is `{text}`; its half sides span no area"));
            }
            Some(Footprint { centre, half_sides: [long, short] })
        }
    };
    Ok(Attachment {
        muscle: cell("muscle").into(),
        role,
        site,
        segment: segment.into(),
        bone: cell("bone").into(),
        tendon,
        reference_point,
        footprint,
    })
}
