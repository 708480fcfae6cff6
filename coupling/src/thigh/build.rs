//! From blocks of muscles and their attachments to a mesh and a scene.

use mesher::part::{MusclePart, bone_surface};
use std::collections::{BTreeMap, BTreeSet};

use fem::geometry::SearchSurface;
use fem::material::line::FibreStrain;
use fem::mesh::{CellBlock, CellKind, Mesh};
use fem::scene::{
    ContactSpec, Course, FibreLawSpec, FibreSpec, MembraneLawSpec, MembraneSpec, Scene, SolidSpec,
    StrandSpec, TieSpec,
};
use mesher::attachment::{Attachment, Role, Site};
use mesher::fibres::{end_stiffness, fibres, mean_section};
use mesher::{Bone, MuscleBlock, to_mesh};
use nalgebra::Vector3;

use super::tendons::{LEAST_SHAPE, TOE, Tendon, add_patellar_ligament, add_tendons, is_seam};
use super::tissue::{
    CONTACT_LAYER, END_LAYERS, END_STIFFNESS, FIBRE_TOE, FIBRE_YOUNG, MATRIX, SHELL_SHEAR, SHELL_THICKNESS,
    TENDON_MODULUS, TENDON_SECTION,
};

/// A side grows from bone that is nearer than this \[m\]: the 3 mm of the table and the gap that the mesher keeps.
const PATCH_REACH: f64 = 3.5e-3;
/// Around its attachments a muscle takes no notice of the bone \[m\].
const ATTACHMENT_REACH: f64 = 8e-3;
/// Overlaps of the mesh with bone up to this depth are parted \[m\].
const CONTACT_REPAIR: f64 = 2e-3;
/// A tendon begins where its path is this far from the end of the muscle \[m\].
const TENDON_START: f64 = 2e-3;

/// What a scene of the thigh has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThighEffects {
    /// Fibres, so many nodes of a section apart; `None`: none.
    pub fibres: Option<usize>,
    /// Shells around the muscles.
    pub shells: bool,
}

/// A muscle of the thigh as a part of the mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct ThighMuscle {
    /// Name; also of its region and of the control of its fibres.
    pub name: String,
    /// Centre of each layer of nodes \[m\], origin first.
    pub line: Vec<Vector3<f64>>,
    /// Fraction of the line per layer.
    pub s: Vec<f64>,
    /// Area of each layer \[m²\].
    pub areas: Vec<f64>,
    /// Section of all fibres \[m²\].
    pub fibre_area: f64,
    /// Mean length of the fibres in the mesh, weighted with their sections \[m\].
    pub fibre_length: f64,
    /// First of its nodes in the mesh; they follow layer by layer.
    pub first_node: u32,
    /// Nodes of one layer.
    pub nodes_per_layer: u32,
    /// Nodes of the mesh on its surface that are tied to each segment.
    pub tied: BTreeMap<String, Vec<u32>>,
}

impl ThighMuscle {
    /// Unit tangent of the line at a layer, towards the insertion.
    pub fn tangent(&self, layer: usize) -> Vector3<f64> {
        let (a, b) = (layer.saturating_sub(1), (layer + 1).min(self.line.len() - 1));
        (self.line[b] - self.line[a]).normalize()
    }

    /// Nodes of a layer.
    pub fn layer_nodes(&self, layer: usize) -> std::ops::Range<u32> {
        let first = self.first_node + layer as u32 * self.nodes_per_layer;
        first..first + self.nodes_per_layer
    }

    /// Layer nearest to a fraction of the line.
    pub fn layer_at(&self, s: f64) -> usize {
        let far = |l: &usize| (self.s[*l] - s).abs();
        (0..self.s.len()).min_by(|a, b| far(a).total_cmp(&far(b))).expect("a muscle has layers")
    }
}

/// The deformable thigh: mesh, scene and where its muscles are.
#[derive(Clone, Debug)]
pub struct Thigh {
    /// All regions, tendons and shells.
    pub mesh: Mesh,
    /// Which effects there are.
    pub scene: Scene,
    /// The muscles.
    pub muscles: Vec<ThighMuscle>,
    /// Their solid tendons.
    pub tendons: Vec<Tendon>,
}

/// Segment that carries a bone of the tables.
pub fn segment_of(bone: &str) -> Option<&'static str> {
    Some(match bone {
        "hip_bone" | "sacrum" => "pelvis",
        "femur" => "thigh",
        "patella" => "patella",
        "tibia" | "fibula" => "shank",
        _ => return None,
    })
}

impl Thigh {
    /// Gives the fibres of a muscle (by its number) another law.
    pub fn set_fibre_law(&mut self, muscle: usize, law: FibreLawSpec) {
        let name = &self.muscles[muscle].name;
        let spec = self.scene.fibres.iter_mut().find(|f| f.activation.as_ref() == Some(name));
        spec.expect("a thigh with fibres").law = law;
    }

    /// Length of the fibres of a muscle (by its number) over that in the mesh, mean weighted with their sections, where the nodes are at `x`
    /// \[m\].
    pub fn fibre_stretch(&self, muscle: usize, x: &[f64]) -> f64 {
        let name = MusclePart::Fibres.of(&self.muscles[muscle].name);
        let spec = self.scene.fibres.iter().find(|f| f.name == name).expect("a thigh with fibres");
        let block =
            self.mesh.blocks.iter().find(|b| b.name == name).expect("fibres of the scene are in the mesh");
        let at = |n: u32| Vector3::from_column_slice(&x[3 * n as usize..3 * n as usize + 3]);
        let lines = block.nodes.as_chunks::<2>().0.iter().zip(&spec.area);
        let volume: f64 = lines.map(|(&[a, b], area)| area * (at(b) - at(a)).norm()).sum();
        volume / (self.muscles[muscle].fibre_area * self.muscles[muscle].fibre_length)
    }

    /// Faces of the solid tendons and of what joins them, and the strands as pairs of points \[m\]: to be drawn.
    pub fn tendon_faces(&self) -> Vec<Vec<Vector3<f64>>> {
        let solid = self
            .tendons
            .iter()
            .map(|t| [MusclePart::Tendon, MusclePart::TendonFibres].map(|part| part.of(&t.muscle)));
        let inside: Vec<String> = solid.clone().map(|[_, fibres]| fibres).collect();
        let strands = self.scene.strands.iter().map(|s| s.region.clone()).filter(|r| !inside.contains(r));
        let seams = self.scene.membranes.iter().map(|m| m.region.clone()).filter(|r| is_seam(r));
        let drawn: Vec<String> = solid.map(|[cells, _]| cells).chain(strands).chain(seams).collect();
        let corners = |nodes: &[u32]| nodes.iter().map(|&n| self.mesh.points[n as usize].into()).collect();
        let faces = |block: &CellBlock| -> Vec<Vec<Vector3<f64>>> {
            match block.kind {
                CellKind::Line2 => block.cells().map(corners).collect(),
                _ => block.boundary().iter().flatten().map(|face| corners(face)).collect(),
            }
        };
        self.mesh.blocks.iter().filter(|b| drawn.contains(&b.name)).flat_map(faces).collect()
    }

    /// Adds rigid bones and guarded contact of all muscles and bones. A bone that belongs to no segment is left out.
    ///
    /// A muscle takes no notice of a bone that one of its end faces or tendons reaches: it is drawn into the bone there, by up to
    /// 2 mm. Broad origins on the side keep contact with their bone beyond the patch.
    pub fn add_contact(&mut self, bones: &[Bone], attachments: &[Attachment]) {
        let mut surfaces: Vec<String> =
            self.muscles.iter().map(|m| MusclePart::Surface.of(&m.name)).collect();
        for bone in bones {
            let Some(segment) = segment_of(&bone.name) else { continue };
            let name = bone_surface(&bone.name);
            let first = self.mesh.points.len() as u32;
            self.mesh.points.extend(&bone.surface.points);
            let triangle = |&[a, b, c]: &[u32; 3]| [a + first, b + first, c + first, c + first];
            self.mesh.surfaces.insert(name.clone(), bone.surface.triangles.iter().map(triangle).collect());
            let nodes = bone.surface.triangles.iter().flatten().map(|n| n + first).collect();
            self.mesh.blocks.push(CellBlock { name: bone.name.clone(), kind: CellKind::Tri3, nodes });
            self.mesh.node_sets.insert(name.clone(), (first..self.mesh.points.len() as u32).collect());
            self.scene.ties.push(TieSpec { nodes: name.clone(), body: segment.into() });
            surfaces.push(name);
        }
        let names: Vec<&str> = surfaces.iter().map(String::as_str).collect();
        let ends = attachments
            .iter()
            .filter(|a| a.role != Role::Contact && !matches!(a.site, Site::SidePatch { .. }));
        let mut excluded: Vec<[String; 2]> = ends
            .map(|a| [MusclePart::Surface.of(&a.muscle), bone_surface(&a.bone)])
            .filter(|pair| pair.iter().all(|name| surfaces.contains(name)))
            .collect();
        excluded.sort();
        excluded.dedup();
        self.scene.contact = Some(ContactSpec {
            attachment: ATTACHMENT_REACH,
            repair: CONTACT_REPAIR,
            excluded,
            layer: CONTACT_LAYER,
            ..ContactSpec::new(&names)
        });
    }
}

/// Whether a point of a muscle's side \[m\] is close enough to a bone to grow from it; names of the muscle and the bone first.
pub type Reaches = dyn Fn(&str, &str, &Vector3<f64>) -> bool;

/// [`Reaches`] of these bones; one that has no surface is never far. `before`: surfaces of muscles before their sections were inset, whose
/// nearest point counts.
pub fn reaches(bones: &[Bone], before: BTreeMap<String, SearchSurface>) -> Box<Reaches> {
    let search: BTreeMap<String, SearchSurface> =
        bones.iter().map(|b| (b.name.clone(), SearchSurface::new(b.surface.clone()))).collect();
    Box::new(move |muscle, bone, point| {
        let nearest = before.get(muscle).and_then(|surface| surface.nearest(point));
        let point = nearest.map_or(*point, |(closest, ..)| closest.on_b);
        search.get(bone).is_none_or(|s| s.nearest(&point).is_some_and(|(p, ..)| p.distance <= PATCH_REACH))
    })
}

/// Puts the thigh together. `sections`: physiological cross-section of a muscle \[m²\], that of its fibres; without one, the
/// mean section of the mesh. `reaches`: whether a point of a muscle's side \[m\] is close enough to a bone to grow from it.
pub fn build(
    blocks: &[MuscleBlock],
    attachments: &[Attachment],
    sections: &dyn Fn(&str) -> Option<f64>,
    reaches: &Reaches,
    effects: ThighEffects,
) -> Thigh {
    put_together(blocks, attachments, sections, reaches, effects, LEAST_SHAPE)
}

/// [`build`] of a [draft](mesher::draft), whose cells say nothing about the shape of the tendons that grow from them.
pub fn build_draft(
    blocks: &[MuscleBlock],
    attachments: &[Attachment],
    sections: &dyn Fn(&str) -> Option<f64>,
    reaches: &Reaches,
    effects: ThighEffects,
) -> Thigh {
    put_together(blocks, attachments, sections, reaches, effects, f64::NEG_INFINITY)
}

fn put_together(
    blocks: &[MuscleBlock],
    attachments: &[Attachment],
    sections: &dyn Fn(&str) -> Option<f64>,
    reaches: &Reaches,
    effects: ThighEffects,
    least_shape: f64,
) -> Thigh {
    let mut mesh = to_mesh(blocks);
    let mut scene = Scene::default();
    let mut muscles = Vec::new();
    let mut firsts = Vec::new();
    let mut first = 0;
    for block in blocks {
        firsts.push(first);
        let mut muscle = ThighMuscle {
            name: block.name.clone(),
            line: block.centre_line(),
            s: block.s.clone(),
            areas: (0..block.n_layers()).map(|l| block.area(l)).collect(),
            fibre_area: 0.0,
            fibre_length: 0.0,
            first_node: first,
            nodes_per_layer: block.nodes_per_section as u32,
            tied: BTreeMap::new(),
        };
        scene.solids.push(SolidSpec {
            region: block.name.clone(),
            law: MATRIX,
            formulation: None,
            density: 1060.0,
            scale: end_stiffness(block, END_STIFFNESS, END_LAYERS),
        });
        if let Some(spacing) = effects.fibres {
            muscle.fibre_area = sections(&block.name).unwrap_or_else(|| mean_section(block));
            muscle.fibre_length = add_fibres(block, muscle.fibre_area, spacing, first, &mut mesh, &mut scene);
        }
        if effects.shells {
            let region = MusclePart::Shell.of(&block.name);
            let nodes = block.side_faces().into_iter().flatten().map(|n| n + first).collect();
            mesh.blocks.push(CellBlock { name: region.clone(), kind: CellKind::Quad4, nodes });
            scene.membranes.push(MembraneSpec {
                region,
                thickness: SHELL_THICKNESS,
                law: MembraneLawSpec::NeoHookean { mu: SHELL_SHEAR },
            });
        }
        tie(block, first, attachments, reaches, &mut mesh, &mut scene, &mut muscle);
        muscles.push(muscle);
        first += block.points.len() as u32;
    }
    let tendons = add_tendons(blocks, &firsts, attachments, &mut mesh, &mut scene, least_shape);
    for ((block, first), muscle) in blocks.iter().zip(firsts).zip(&muscles) {
        let of_block = |a: &&Attachment| a.muscle == block.name && !a.tendon.is_empty();
        let is_solid =
            |a: &&Attachment| a.footprint.is_some() && tendons.iter().any(|t| t.muscle == block.name);
        let left = attachments.iter().filter(of_block).filter(|a| !is_solid(a));
        hang(block, first, left, muscle, &mut mesh, &mut scene);
    }
    add_patellar_ligament(attachments, &mut mesh, &mut scene);
    Thigh { mesh, scene, muscles, tendons }
}

/// Adds the fibres of a muscle whose nodes begin at `first`; `section`: of all of them \[m²\], `spacing`: see [`fibres`]. Returns their mean length \[m\].
pub(super) fn add_fibres(
    block: &MuscleBlock,
    section: f64,
    spacing: usize,
    first: u32,
    mesh: &mut Mesh,
    scene: &mut Scene,
) -> f64 {
    let fibres = fibres(block, section, spacing);
    let name = MusclePart::Fibres.of(&block.name);
    let place = |n: u32| Vector3::from(block.points[n as usize]);
    let volume: f64 = fibres
        .segments
        .iter()
        .zip(&fibres.area)
        .map(|(&[a, b], area)| area * (place(b) - place(a)).norm())
        .sum();
    let nodes = fibres.segments.iter().flatten().map(|n| n + first).collect();
    mesh.blocks.push(CellBlock { name: name.clone(), kind: CellKind::Line2, nodes });
    scene.fibres.push(FibreSpec {
        name: name.clone(),
        course: Course::Region(name),
        law: FibreLawSpec::Thermal {
            young: FIBRE_YOUNG,
            contraction: 1.0,
            strain: FibreStrain::Engineering,
            toe: Some(FIBRE_TOE),
        },
        area: fibres.area,
        activation: Some(block.name.clone()),
    });
    volume / section
}

/// Ties what grows from bone.
fn tie(
    block: &MuscleBlock,
    first: u32,
    attachments: &[Attachment],
    reaches: &Reaches,
    mesh: &mut Mesh,
    scene: &mut Scene,
    muscle: &mut ThighMuscle,
) {
    let mut taken = BTreeSet::new();
    let mut sets = BTreeMap::<&str, Vec<u32>>::new();
    let own = || attachments.iter().filter(|a| a.muscle == block.name && a.role != Role::Contact);
    // Faces before patches: a node of both goes with the end.
    let faces = own().filter(|a| a.site == Site::EndFace && a.tendon.is_empty());
    let patches = own().filter(|a| matches!(a.site, Site::SidePatch { .. }));
    for a in faces.chain(patches) {
        for node in a.nodes(block) {
            let near = a.site == Site::EndFace
                || reaches(&a.muscle, &a.bone, &Vector3::from(block.points[node as usize]));
            if near && taken.insert(node) {
                sets.entry(&a.segment).or_default().push(node + first);
            }
        }
    }
    for (segment, mut nodes) in sets {
        nodes.sort_unstable();
        let set = MusclePart::On(segment).of(&block.name);
        mesh.node_sets.insert(set.clone(), nodes.clone());
        scene.ties.push(TieSpec { nodes: set, body: segment.into() });
        muscle.tied.insert(segment.into(), nodes);
    }
}

/// Hangs a muscle on bone by strands from nodes of its ends that are not tied, a fan of them per tendon.
fn hang<'a>(
    block: &MuscleBlock,
    first: u32,
    tendons: impl Iterator<Item = &'a Attachment>,
    muscle: &ThighMuscle,
    mesh: &mut Mesh,
    scene: &mut Scene,
) {
    let taken: BTreeSet<u32> = muscle.tied.values().flatten().copied().collect();
    for (k, a) in tendons.enumerate() {
        let nodes: Vec<u32> = a.nodes(block).into_iter().filter(|n| !taken.contains(&(n + first))).collect();
        if nodes.is_empty() {
            continue;
        }
        let place = |n: &u32| Vector3::from(block.points[*n as usize]);
        let centre = nodes.iter().map(place).sum::<Vector3<f64>>() / nodes.len() as f64;
        let last = a.tendon.last().expect("not empty");
        let anchor = a.tendon.iter().find(|p| (*p - centre).norm() > TENDON_START).unwrap_or(last);
        let on_bone = mesh.points.len() as u32;
        mesh.points.push((*anchor).into());
        let region = MusclePart::Strands(k + 1).of(&block.name);
        let lines = nodes.iter().flat_map(|n| [n + first, on_bone]).collect();
        mesh.blocks.push(CellBlock { name: region.clone(), kind: CellKind::Line2, nodes: lines });
        let stiffness = TENDON_MODULUS * TENDON_SECTION / nodes.len() as f64;
        scene.strands.push(StrandSpec { region: region.clone(), stiffness, toe: TOE, reference_strain: 0.0 });
        let set = format!("{region}/anchor");
        mesh.node_sets.insert(set.clone(), vec![on_bone]);
        scene.ties.push(TieSpec { nodes: set, body: a.segment.clone() });
    }
}
