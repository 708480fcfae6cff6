//! Solid tendons of heads that end side by side on one bone, sewn together at their edges: the quadriceps tendon. And the patellar
//! ligament, strands from the patella to the tibia.
//!
//! Fibres of the tendon run on from every fibre of the muscle, so each carries its own force to the bone; the matrix between them keeps
//! the tendon in shape, and seams pass force between neighbours that pull differently.

use fem::mesh::{CellBlock, CellKind, Mesh};
use fem::scene::{MembraneLawSpec, MembraneSpec, Scene, SolidSpec, StrandSpec, TieSpec};
use mesher::MuscleBlock;
use mesher::MusclePart;
use mesher::attachment::{Attachment, Role};
use mesher::tendon::Slip;
use nalgebra::Vector3;

use super::tissue::{END_STIFFNESS, MATRIX, SHELL_SHEAR};

/// Young's modulus of the quadriceps tendon along its fibres \[Pa\] (Orozco, Scientific Reports 8:2323, 2018, table 1).
pub const QUADRICEPS_TENDON: f64 = 370e6;
/// A tendon whose worst cell has a smaller scaled Jacobian is left to strands.
pub const LEAST_SHAPE: f64 = 0.3;
/// Layers of cells at least.
const LEAST_LAYERS: usize = 2;
/// Half the strain over which the tension of a tendon sets in.
pub(super) const TOE: f64 = 0.01;
/// Neighbours are sewn together where their edges are nearer than this in the mean \[m\].
const SEAM_REACH: f64 = 8e-3;
/// How the regions of seams begin; they belong to no muscle.
const SEAM: &str = "seam/";
/// Thickness of a seam \[m\]: the distal quadriceps is drawn as sheets of 2 to 4 mm.
const SEAM_THICKNESS: f64 = 3e-3;
/// Shear modulus of a seam \[Pa\]: that of the end layers of the muscles. None is published.
const SEAM_SHEAR: f64 = END_STIFFNESS * SHELL_SHEAR;
/// Row of the table of attachments that draws the patellar ligament, and the body that it comes from.
const LIGAMENT: &str = "patellar_ligament";
const LIGAMENT_FROM: &str = "patella";
/// Stiffness \[N/m\] of all its strands (Orozco 2018), and the fractions of the medial, central and lateral ones: 201, 278 and 173 N/mm in
/// the publication with seven strands.
const LIGAMENT_STIFFNESS: f64 = 545e3;
const LIGAMENT_FRACTIONS: [f64; 3] = [201.0 / 652.0, 278.0 / 652.0, 173.0 / 652.0];
/// Half the strain over which their tension sets in (same publication).
const LIGAMENT_TOE: f64 = 0.03;
/// How far apart they run \[m\].
const LIGAMENT_SPACING: f64 = 5e-3;

/// A solid tendon as a part of the mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Tendon {
    /// Its muscle.
    pub muscle: String,
    /// Least scaled Jacobian of its cells.
    pub least_scaled_jacobian: f64,
    /// Nodes of the mesh per layer, numbered as in a section of the muscle; first the end of the muscle, last the footprint.
    pub layers: Vec<Vec<u32>>,
    /// Which of a layer lie on its outline.
    outline: Vec<u32>,
}

/// Whether a membrane is a seam between two tendons.
pub fn is_seam(region: &str) -> bool {
    region.starts_with(SEAM)
}

/// Adds the tendons of all insertions that have a footprint to mesh and scene, ties them to bone and sews neighbours together. `first`: the
/// first node of each block. A tendon whose cells would have a scaled Jacobian below `least_shape` is left out, for strands.
pub fn add_tendons<'a>(
    blocks: &'a [MuscleBlock],
    first: &[u32],
    attachments: &'a [Attachment],
    mesh: &mut Mesh,
    scene: &mut Scene,
    least_shape: f64,
) -> Vec<Tendon> {
    let with_footprint = |(block, &first): (&'a MuscleBlock, &u32)| {
        let of_block = |a: &&Attachment| a.muscle == block.name && a.role == Role::Insertion;
        let a = attachments.iter().filter(of_block).find(|a| a.footprint.is_some())?;
        Some((block, first, a, a.footprint?))
    };
    let heads: Vec<_> = blocks.iter().zip(first).filter_map(with_footprint).collect();
    // The same number of layers, so that neighbours can be sewn together, about as long as the cells of the muscles.
    let wanted = heads.iter().map(|(block, _, _, footprint)| {
        let line = block.centre_line();
        let edge = line.windows(2).map(|p| (p[1] - p[0]).norm()).sum::<f64>() / (line.len() - 1) as f64;
        (Slip::new(block, footprint, 1).length() / edge).round() as usize
    });
    let n_layers = wanted.fold(LEAST_LAYERS, usize::max);
    let mut tendons = Vec::new();
    for (block, first, a, footprint) in heads {
        let slip = Slip::new(block, &footprint, n_layers);
        tendons.extend(add_tendon(block, first, a, &slip, mesh, scene, least_shape));
    }
    sew(&tendons, mesh, scene);
    tendons
}

fn add_tendon(
    block: &MuscleBlock,
    first: u32,
    attachment: &Attachment,
    slip: &Slip,
    mesh: &mut Mesh,
    scene: &mut Scene,
    least_shape: f64,
) -> Option<Tendon> {
    let n = block.nodes_per_section as u32;
    let before = mesh.points.len() as u32;
    let node = |layer: usize, local: u32| match layer {
        0 => first + block.node(block.n_layers() - 1, local),
        _ => before + (layer as u32 - 1) * n + local,
    };
    let layers: Vec<Vec<u32>> =
        (0..slip.layers.len()).map(|l| (0..n).map(|k| node(l, k)).collect()).collect();
    let mut cells = Vec::new();
    for pair in layers.windows(2) {
        for cell in &block.section_cells {
            cells.extend(cell.map(|k| pair[0][k as usize]));
            cells.extend(cell.map(|k| pair[1][k as usize]));
        }
    }
    let (region, fibres) = (MusclePart::Tendon.of(&block.name), MusclePart::TendonFibres.of(&block.name));
    mesh.points.extend(slip.layers[1..].iter().flatten().map(|p| <[f64; 3]>::from(*p)));
    let solid = CellBlock { name: region.clone(), kind: CellKind::Hex8, nodes: cells };
    let shape = mesh.quality(&solid).map_or(0.0, |q| q.least_scaled_jacobian);
    if shape.is_nan() || shape < least_shape {
        mesh.points.truncate(before as usize);
        return None;
    }
    mesh.blocks.push(solid);
    scene.solids.push(SolidSpec {
        scale: vec![END_STIFFNESS; block.section_cells.len() * (layers.len() - 1)],
        ..SolidSpec::new(&region, MATRIX)
    });
    let along = |k: u32| layers.windows(2).flat_map(move |pair| [pair[0][k as usize], pair[1][k as usize]]);
    let lines = (0..n).flat_map(along).collect();
    mesh.blocks.push(CellBlock { name: fibres.clone(), kind: CellKind::Line2, nodes: lines });
    scene.strands.push(StrandSpec {
        region: fibres,
        stiffness: QUADRICEPS_TENDON * block.area(block.n_layers() - 1) / f64::from(n),
        toe: TOE,
        reference_strain: 0.0,
    });
    let set = format!("{region}/footprint");
    mesh.node_sets.insert(set.clone(), layers[layers.len() - 1].clone());
    scene.ties.push(TieSpec { nodes: set, body: attachment.segment.clone() });
    Some(Tendon {
        muscle: block.name.clone(),
        least_scaled_jacobian: shape,
        layers,
        outline: block.outline.clone(),
    })
}

/// Joins every two tendons whose edges run close to each other by a strip of membrane between the two nearest columns of nodes.
fn sew(tendons: &[Tendon], mesh: &mut Mesh, scene: &mut Scene) {
    for (i, a) in tendons.iter().enumerate() {
        for b in &tendons[i + 1..] {
            let apart = |m: u32, n: u32| {
                let place = |n: u32| Vector3::from(mesh.points[n as usize]);
                let gaps = a.layers.iter().zip(&b.layers);
                gaps.map(|(p, q)| (place(p[m as usize]) - place(q[n as usize])).norm()).sum::<f64>()
                    / a.layers.len() as f64
            };
            let columns = a.outline.iter().flat_map(|&m| b.outline.iter().map(move |&n| (m, n)));
            let nearest = columns
                .map(|(m, n)| (apart(m, n), m, n))
                .min_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
            let Some((_, m, n)) = nearest.filter(|(gap, ..)| *gap <= SEAM_REACH) else { continue };
            let side = a.layers.iter().zip(&b.layers).map(|(p, q)| [p[m as usize], q[n as usize]]);
            let side: Vec<[u32; 2]> = side.collect();
            let nodes = side.windows(2).flat_map(|w| [w[0][0], w[0][1], w[1][1], w[1][0]]).collect();
            let region = format!("{SEAM}{}+{}", a.muscle, b.muscle);
            mesh.blocks.push(CellBlock { name: region.clone(), kind: CellKind::Quad4, nodes });
            scene.membranes.push(MembraneSpec {
                region,
                thickness: SEAM_THICKNESS,
                law: MembraneLawSpec::NeoHookean { mu: SEAM_SHEAR },
            });
        }
    }
}

/// Adds the patellar ligament as three strands from patella to tibia, where the table draws it and something pulls at the patella.
pub fn add_patellar_ligament(attachments: &[Attachment], mesh: &mut Mesh, scene: &mut Scene) {
    let row = attachments.iter().find(|a| a.muscle == LIGAMENT);
    let (Some(row), true) = (row, scene.ties.iter().any(|t| t.body == LIGAMENT_FROM)) else { return };
    let [from, .., to] = row.tendon[..] else { return };
    let across = (to - from).cross(&Vector3::x()).normalize();
    let first = mesh.points.len() as u32;
    for (k, fraction) in LIGAMENT_FRACTIONS.iter().enumerate() {
        let aside = across * (LIGAMENT_SPACING * (k as f64 - 1.0));
        let region = format!("{LIGAMENT}_{}", k + 1);
        let node = first + 2 * k as u32;
        mesh.points.extend([from + aside, to + aside].map(<[f64; 3]>::from));
        mesh.blocks.push(CellBlock {
            name: region.clone(),
            kind: CellKind::Line2,
            nodes: vec![node, node + 1],
        });
        // Force per unit strain.
        let stiffness = LIGAMENT_STIFFNESS * fraction * (to - from).norm();
        scene.strands.push(StrandSpec { region, stiffness, toe: LIGAMENT_TOE, reference_strain: 0.0 });
    }
    for (end, body) in [(0, LIGAMENT_FROM), (1, row.segment.as_str())] {
        let set = format!("{LIGAMENT}/on_{body}");
        mesh.node_sets.insert(set.clone(), (0..3).map(|k| first + 2 * k + end).collect());
        scene.ties.push(TieSpec { nodes: set, body: body.into() });
    }
}
