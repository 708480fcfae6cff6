//! What every muscle of the thigh has: fibres, attachments, and a line of action beside that of the rigid leg.

use std::collections::BTreeSet;

use mesher::MuscleBlock;
use mesher::attachment::{Attachment, Role, Site};
use mesher::fibres::{fibres, mean_section};
use nalgebra::Vector3;
use serde::Serialize;

use super::build::Reaches;
use crate::steps::RigidMuscle;

/// Directions farther apart than this are explained \[deg\].
const EXPLAINED_ABOVE: f64 = 15.0;

/// One muscle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MuscleInventory {
    /// Name.
    pub name: String,
    /// Fibres, from end to end.
    pub fibres: usize,
    /// Sum of their sections \[mm²\].
    pub fibre_area_mm2: f64,
    /// The section that they shall fill \[mm²\]: physiological where it is known, else the mean section.
    pub section_mm2: f64,
    /// Mean section of the mesh \[mm²\].
    pub mean_section_mm2: f64,
    /// Origin.
    pub origin: Hold,
    /// Insertion.
    pub insertion: Hold,
    /// Line of action at mid belly; `None` where there is no rigid line to compare with.
    pub line: Option<Line>,
}

/// How one end of a muscle holds on to the bones.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Hold {
    /// Bones.
    pub bones: Vec<String>,
    /// Area of the end face, tied or held by a tendon \[mm²\].
    pub face_mm2: f64,
    /// Area of the side that grows from bone \[mm²\].
    pub side_mm2: f64,
    /// Length of the longest tendon from the end of the mesh to the bone \[mm\]; zero without one.
    pub tendon_mm: f64,
}

/// Direction of a muscle at mid belly, towards the insertion, beside that of its rigid lines.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// Of the mesh: tangent to the line through the centres of its sections.
    pub mesh: [f64; 3],
    /// Of the rigid leg: all its lines, each with its strength.
    pub rigid: [f64; 3],
    /// Angle between the two \[deg\].
    pub angle_deg: f64,
    /// The rigid line nearest in direction to the mesh.
    pub nearest_line: String,
    /// Its angle to the mesh \[deg\].
    pub nearest_line_deg: f64,
    /// Largest angle of a fibre at mid belly to the line of the mesh \[deg\].
    pub spread_deg: f64,
    /// Least angle of a fibre at mid belly to the rigid direction \[deg\].
    pub nearest_fibre_deg: f64,
    /// Angle between the straight lines from end to end, of the mesh and of its nearest rigid line \[deg\].
    pub ends_deg: f64,
    /// How far that rigid line begins from where the muscle holds on to its origin \[mm\].
    pub origin_off_mm: f64,
    /// How far it ends from the insertion, or from where the tendon meets the bone \[mm\].
    pub insertion_off_mm: f64,
    /// Why the directions differ, where they differ by more than 15 degrees; else empty.
    pub explanation: String,
}

/// Takes stock of the muscles. `section`: physiological cross-section of a muscle \[m²\]; `reaches`: whether a point of a muscle's side
/// \[m\] is close enough to a bone to grow from it; `rigid`: the lines of the rigid leg in the posture of the mesh, if any.
pub fn inventory(
    blocks: &[&MuscleBlock],
    attachments: &[Attachment],
    section: &dyn Fn(&str) -> Option<f64>,
    reaches: &Reaches,
    rigid: &[RigidMuscle],
) -> Vec<MuscleInventory> {
    let one = |block: &&MuscleBlock| {
        let wanted = section(&block.name).unwrap_or_else(|| mean_section(block));
        let fibres = fibres(block, wanted, 1);
        // Every fibre has the same section all along: the first layer counts them.
        let per_fibre = block.n_layers() - 1;
        let hold = |role: Role| {
            let own: Vec<&Attachment> =
                attachments.iter().filter(|a| a.muscle == block.name && a.role == role).collect();
            Grip::of(block, role, &own, reaches)
        };
        let (origin, insertion) = (hold(Role::Origin), hold(Role::Insertion));
        let rigid = rigid.iter().find(|m| m.name == block.name);
        let line = rigid.map(|rigid| line(block, rigid, [&origin.places, &insertion.places]));
        MuscleInventory {
            name: block.name.clone(),
            fibres: fibres.area.len() / per_fibre,
            fibre_area_mm2: 1e6 * fibres.area.iter().step_by(per_fibre).sum::<f64>(),
            section_mm2: 1e6 * wanted,
            mean_section_mm2: 1e6 * mean_section(block),
            origin: origin.hold,
            insertion: insertion.hold,
            line,
        }
    };
    blocks.iter().map(one).collect()
}

/// One end of a muscle, and the places where it holds on \[m\].
struct Grip {
    hold: Hold,
    places: Vec<Vector3<f64>>,
}

impl Grip {
    fn of(block: &MuscleBlock, role: Role, own: &[&Attachment], reaches: &Reaches) -> Grip {
        let place = |n: u32| Vector3::from(block.points[n as usize]);
        // Not of the layer as a whole: the ends of broad muscles are curved.
        let area = |face: &[u32; 4]| {
            let p = face.map(place);
            (p[2] - p[0]).cross(&(p[3] - p[1])).norm() / 2.0
        };
        let layer = if role == Role::Origin { 0 } else { block.n_layers() - 1 };
        let mut hold = Hold::default();
        let mut places = Vec::new();
        let mut on_side = BTreeSet::new();
        for a in own {
            if !hold.bones.contains(&a.bone) {
                hold.bones.push(a.bone.clone());
            }
            match a.site {
                Site::EndFace => hold.face_mm2 = 1e6 * block.end_faces(layer).iter().map(area).sum::<f64>(),
                Site::EndSpot => {}
                Site::SidePatch { .. } => {
                    on_side.extend(
                        a.nodes(block).into_iter().filter(|&n| reaches(&a.muscle, &a.bone, &place(n))),
                    );
                }
            }
            if let (false, Some(&end)) = (matches!(a.site, Site::SidePatch { .. }), a.tendon.last()) {
                let nodes = a.nodes(block);
                let start = nodes.iter().map(|&n| place(n)).sum::<Vector3<f64>>() / nodes.len() as f64;
                let way: Vec<Vector3<f64>> = std::iter::once(start).chain(a.tendon.iter().copied()).collect();
                let length: f64 = way.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
                hold.tendon_mm = hold.tendon_mm.max(1e3 * length);
                places.push(end);
            } else if a.site == Site::EndFace {
                places.extend(a.nodes(block).into_iter().map(place));
            }
        }
        for face in block.side_faces() {
            let corners = face.iter().filter(|n| on_side.contains(n)).count();
            hold.side_mm2 += 1e6 * area(&face) / 4.0 * corners as f64;
        }
        places.extend(on_side.into_iter().map(place));
        Grip { hold, places }
    }
}

fn line(block: &MuscleBlock, rigid: &RigidMuscle, places: [&Vec<Vector3<f64>>; 2]) -> Line {
    let degrees = |a: &Vector3<f64>, b: &Vector3<f64>| a.angle(b).to_degrees();
    let last = block.n_layers() - 1;
    let far = |l: &usize| (block.s[*l] - 0.5).abs();
    let belly = (1..last).min_by(|a, b| far(a).total_cmp(&far(b))).expect("a muscle has layers");
    let centres = block.centre_line();
    let mesh = (centres[belly + 1] - centres[belly - 1]).normalize();
    // All lines pull alike: the direction of the muscle, not of a step.
    let all = rigid.lines.iter().map(|l| l.f_max * l.direction()).sum::<Vector3<f64>>().normalize();
    let nearest = rigid
        .lines
        .iter()
        .min_by(|a, b| degrees(&mesh, &a.direction()).total_cmp(&degrees(&mesh, &b.direction())));
    let nearest = nearest.expect("a rigid muscle has lines");
    let fibres =
        (0..block.nodes_per_section as u32).map(|n| block.point(belly + 1, n) - block.point(belly - 1, n));
    let to_mesh = fibres.clone().map(|f| degrees(&f, &mesh));
    let to_rigid = fibres.map(|f| degrees(&f, &all));
    let ends = [nearest.path[0], nearest.path[nearest.path.len() - 1]];
    let off = |i: usize| {
        let from = |p: &Vector3<f64>| 1e3 * (p - ends[i]).norm();
        places[i].iter().map(from).fold(f64::INFINITY, f64::min)
    };
    let mut line = Line {
        mesh: mesh.into(),
        rigid: all.into(),
        angle_deg: degrees(&mesh, &all),
        nearest_line: nearest.name.clone(),
        nearest_line_deg: degrees(&mesh, &nearest.direction()),
        spread_deg: to_mesh.fold(0.0, f64::max),
        nearest_fibre_deg: to_rigid.fold(f64::INFINITY, f64::min),
        ends_deg: degrees(&(centres[last] - centres[0]), &(ends[1] - ends[0])),
        origin_off_mm: off(0),
        insertion_off_mm: off(1),
        explanation: String::new(),
    };
    if line.angle_deg > EXPLAINED_ABOVE {
        line.explanation = explain(&line, rigid.lines.len());
    }
    line
}

/// What the numbers say about a large angle.
fn explain(line: &Line, n_lines: usize) -> String {
    let mut parts = Vec::new();
    if line.nearest_fibre_deg <= EXPLAINED_ABOVE {
        parts.push(format!(
            "broad: its fibres at mid belly fan out by up to {:.0} degrees and one of them runs {:.0} degrees from the rigid direction",
            line.spread_deg, line.nearest_fibre_deg
        ));
    } else {
        parts.push(format!(
            "drawn elsewhere: no fibre at mid belly runs within {:.0} degrees of the rigid direction",
            line.nearest_fibre_deg
        ));
    }
    parts.push(format!(
        "rigid line {} begins {:.0} mm and ends {:.0} mm from the attachments of the mesh, straight from end to end they are {:.0} degrees apart",
        line.nearest_line, line.origin_off_mm, line.insertion_off_mm, line.ends_deg
    ));
    if n_lines > 1 {
        parts.push(format!(
            "of {n_lines} rigid lines the nearest is {:.0} degrees away",
            line.nearest_line_deg
        ));
    }
    parts.join("; ")
}
