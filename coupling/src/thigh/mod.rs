//! The deformable thigh as the coupling sees it.

pub mod build;
pub mod lines;

use std::path::Path;

use fem::mesh::MeshError;
use fem::mesh::muscle::attachment::Attachment;
use fem::mesh::muscle::{Bone, Built, MuscleBlock, MuscleSections};

use crate::thigh_tables::{ATTACHMENTS, BONE_SECTIONS, MUSCLE_SECTIONS};
use build::{Thigh, ThighEffects, reaches};

/// The built-in thigh at a resolution, without contact.
pub struct BuiltIn {
    /// Mesh and scene.
    pub thigh: Thigh,
    /// Bones.
    pub bones: Vec<Bone>,
    /// Where the muscles hold on to them.
    pub attachments: Vec<Attachment>,
    /// How good the mesh is.
    pub built: Built,
}

/// Meshes the built-in thigh with edges of about `edge` \[m\]; `only` these muscles, all where it is empty.
pub fn built_in(edge: f64, only: &[String], effects: ThighEffects) -> Result<BuiltIn, MeshError> {
    let mut sections = MuscleSections::read_csv(MUSCLE_SECTIONS, Path::new("muscle_sections.csv"))?;
    sections.retain(|m| only.is_empty() || only.contains(&m.name));
    let bones = Bone::read_csv(BONE_SECTIONS, Path::new("bone_sections.csv"))?;
    let attachments = Attachment::read_csv(ATTACHMENTS, Path::new("attachments.csv"))?;
    let built = fem::mesh::muscle::build(&sections, &bones, edge);
    let blocks: Vec<MuscleBlock> = built.muscles.iter().map(|m| m.block.clone()).collect();
    let areas = lines::physiological_sections();
    let thigh = build::build(&blocks, &attachments, &|m| areas.get(m).copied(), &reaches(&bones), effects);
    Ok(BuiltIn { thigh, bones, attachments, built })
}
