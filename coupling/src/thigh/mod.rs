//! The deformable thigh as the coupling sees it.

pub mod build;
pub mod inventory;
pub mod lines;
pub mod registration;
pub mod section;
pub mod tables;
pub mod tendons;
pub mod tissue;
pub mod trial;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use fem::geometry::{SearchSurface, Surface};
use fem::mesh::{LengthUnit, MeshError};
use mesher::attachment::{Attachment, Site};
use mesher::from_surface::{Anatomy, MuscleEnds, SectionError, Settings};
use mesher::limb::Limb;
use mesher::{Bone, Built, Loft, MuscleBlock, MuscleSections, sampled};

use crate::thigh::tables::{ATTACHMENTS, BONE_SECTIONS, MUSCLE_SECTIONS};
use build::{Thigh, ThighEffects, reaches};

/// A thigh at a resolution, without contact.
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

/// Muscles whose drawn insertion is not trusted: semimembranosus is drawn onto the front of the tibia and not onto the back of the
/// medial condyle (`gait-data/thigh/attachments.csv`, from gait2392).
const AT_REFERENCE: [&str; 1] = ["semimembranosus"];

/// Outline parameters of a whole side, just short of the full turn.
const ALL_ROUND: [f64; 2] = [0.0, 13.999];

/// The tables of the built-in thigh.
pub fn limb() -> Result<Limb, MeshError> {
    Ok(with_attachments(
        MuscleSections::read_csv(MUSCLE_SECTIONS, Path::new("muscle_sections.csv"))?,
        Bone::read_csv(BONE_SECTIONS, Path::new("bone_sections.csv"))?,
        Attachment::read_csv(ATTACHMENTS, Path::new("attachments.csv"))?,
    ))
}

/// A limb whose muscles insert where they are trusted to.
fn with_attachments(sections: Vec<MuscleSections>, bones: Vec<Bone>, attachments: Vec<Attachment>) -> Limb {
    let mut limb = Limb { sections, bones, attachments };
    for muscle in AT_REFERENCE {
        limb.insert_at_reference(muscle);
    }
    limb
}

/// Meshes the built-in thigh with edges of about `edge` \[m\]; `only` these muscles, all where it is empty.
pub fn built_in(edge: f64, only: &[String], effects: ThighEffects) -> Result<BuiltIn, MeshError> {
    from_limb(limb()?, edge, 0.0, only, effects)
}

/// The same from a limb of one's own, e.g. one scaled to a subject ([`crate::subject::limb_map`]). Every muscle is inset by
/// `inset` \[m\] ([`MuscleSections::inset`]); the mesher keeps its own gap in any case.
pub fn from_limb(
    mut limb: Limb,
    edge: f64,
    inset: f64,
    only: &[String],
    effects: ThighEffects,
) -> Result<BuiltIn, MeshError> {
    let before = choose(&mut limb, inset, only)?;
    let built = mesher::build(&limb.sections, &limb.bones, edge);
    let blocks: Vec<MuscleBlock> = built.muscles.iter().map(|m| m.block.clone()).collect();
    let Limb { bones, attachments, .. } = limb;
    let areas = lines::physiological_sections();
    let thigh =
        build::build(&blocks, &attachments, &|m| areas.get(m).copied(), &reaches(&bones, before), effects);
    Ok(BuiltIn { thigh, bones, attachments, built })
}

/// The thigh that [`from_limb`] would make, on a [draft](mesher::draft) of its mesh: to be counted, not to be solved.
pub fn draft(
    mut limb: Limb,
    edge: f64,
    inset: f64,
    only: &[String],
    effects: ThighEffects,
) -> Result<Thigh, MeshError> {
    let before = choose(&mut limb, inset, only)?;
    let blocks = mesher::draft(&limb.sections, edge);
    let Limb { bones, attachments, .. } = limb;
    let areas = lines::physiological_sections();
    let section = |muscle: &str| areas.get(muscle).copied();
    Ok(build::build_draft(&blocks, &attachments, &section, &reaches(&bones, before), effects))
}

/// Leaves the muscles that are wanted and insets them by `inset` \[m\]; their surfaces before that.
fn choose(
    limb: &mut Limb,
    inset: f64,
    only: &[String],
) -> Result<BTreeMap<String, SearchSurface>, MeshError> {
    limb.sections.retain(|m| only.is_empty() || only.contains(&m.name));
    let mut before = BTreeMap::new();
    if inset > 0.0 {
        for muscle in &mut limb.sections {
            before.insert(muscle.name.clone(), SearchSurface::new(side(muscle)));
            *muscle = muscle.inset(inset)?;
        }
    }
    Ok(before)
}

/// The side of a muscle.
fn side(sections: &MuscleSections) -> Surface {
    let block = sampled(&Loft::new(sections), [10, 4], 1.0);
    Surface::from_faces(&block.points, &block.side_faces()).0
}

/// The muscles whose closed surfaces \[m\] lie in the folder `muscles`, beside their bones in the folder `bones`; both in the frame of
/// the built-in thigh. They hold on to bone where those of the built-in thigh do. Second: the files read.
pub fn limb_of_surfaces(
    muscles: &Path,
    bones: &Path,
    only: &[String],
) -> Result<(Limb, Vec<PathBuf>), SectionError> {
    let mut ends = MuscleEnds::read_csv(ATTACHMENTS, Path::new("attachments.csv"))?;
    ends.retain(|m| only.is_empty() || only.contains(&m.muscle));
    let Anatomy { muscles: sections, bones, files, .. } =
        Anatomy::read(muscles, bones, &ends, LengthUnit::Metre, &Settings::default())?;
    let mut attachments = Attachment::read_csv(ATTACHMENTS, Path::new("attachments.csv"))?;
    for a in &mut attachments {
        // Outlines of a surface's sections begin anywhere, so no part of them is named: a side grows from its bone where that is near.
        if let Site::SidePatch { outline, .. } = &mut a.site {
            *outline = ALL_ROUND;
        }
    }
    Ok((with_attachments(sections, bones, attachments), files))
}
