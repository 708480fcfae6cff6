//! Muscles and bones from folders of surface files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::{End, Fit, SectionError, Settings, sections_from_surface};
use crate::table::{Table, bad};
use crate::{Bone, MuscleSections};
use fem::geometry::{SearchSurface, Surface};
use fem::mesh::{LengthUnit, MeshError};

/// The bones that a muscle arises from and ends on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MuscleEnds {
    /// Name of the muscle.
    pub muscle: String,
    /// Bones of origin and insertion; `None`: the muscle begins or ends at the tip of its surface.
    pub bones: [Option<String>; 2],
}

impl MuscleEnds {
    /// Reads a table with the columns `muscle`, `end` (`origin`, `insertion`; other rows are passed over) and `bone` (may be
    /// empty), such as `gait-data/thigh/attachments.csv`. Of several rows for one end, one with `end_face` in the column `kind` counts,
    /// else the first. `tendon_only` rows describe no part of a surface and are passed over. `file` is the name for messages.
    pub fn read_csv(text: &str, file: &Path) -> Result<Vec<MuscleEnds>, MeshError> {
        let mut table = Table::read(text, file)?;
        table.require(&["muscle", "end", "bone"])?;
        let mut ends: Vec<MuscleEnds> = Vec::new();
        let mut from_face: Vec<[bool; 2]> = Vec::new();
        for row in table.rows() {
            let row = row?;
            let kind = row.optional("kind").unwrap_or("end_face");
            let end = match row.cell("end")? {
                _ if kind == "tendon_only" => continue,
                "origin" => 0,
                "insertion" => 1,
                "contact" => continue,
                other => {
                    return Err(row.bad(format!("end `{other}`; there are origin, insertion and contact")));
                }
            };
            let name = row.cell("muscle")?;
            if name.is_empty() {
                return Err(row.bad("the muscle has no name".into()));
            }
            let known = ends.iter().position(|e| e.muscle == name);
            let i = known.unwrap_or_else(|| {
                ends.push(MuscleEnds { muscle: name.into(), bones: [None, None] });
                from_face.push([false; 2]);
                ends.len() - 1
            });
            let face = kind == "end_face";
            if ends[i].bones[end].is_none() || (face && !from_face[i][end]) {
                let bone = row.cell("bone")?;
                ends[i].bones[end] = (!bone.is_empty()).then(|| bone.into());
                from_face[i][end] = face;
            }
        }
        if ends.is_empty() {
            return Err(bad(file, 1, "the table names no muscle".into()));
        }
        Ok(ends)
    }
}

/// Muscles and bones read from surfaces.
#[derive(Clone, Debug)]
pub struct Anatomy {
    /// Sections of the muscles, in the order asked for.
    pub muscles: Vec<MuscleSections>,
    /// How well the loft of each fits its surface.
    pub fits: Vec<Fit>,
    /// The surface of each \[m\].
    pub surfaces: Vec<SearchSurface>,
    /// All bones of the folder, by name.
    pub bones: Vec<Bone>,
    /// The files read: muscles in the order asked for, then bones by name.
    pub files: Vec<PathBuf>,
    /// Surfaces in the folder of muscles that were not asked for.
    pub left_out: Vec<PathBuf>,
}

impl Anatomy {
    /// Reads the muscles named in `ends` from the folder `muscles` and all bones from the folder `bones`.
    ///
    /// The surface of `rectus_femoris` is the file `rectus_femoris` or `rectus_femoris_r` with the ending .stl, .obj or .ply.
    /// Refuses names without a file, surfaces that are not sound, and surfaces that give no sections, naming file and place.
    pub fn read(
        muscles: &Path,
        bones: &Path,
        ends: &[MuscleEnds],
        unit: LengthUnit,
        settings: &Settings,
    ) -> Result<Anatomy, SectionError> {
        let bone_files = surface_files(bones)?;
        let mut muscle_files = surface_files(muscles)?;
        let read = |file: &PathBuf| Surface::read_checked(file, unit).map(SearchSurface::new);
        let bone_surfaces: BTreeMap<String, SearchSurface> = bone_files
            .par_iter()
            .map(|(name, file)| Ok((name.clone(), read(file)?)))
            .collect::<Result<_, SectionError>>()?;
        let unknown =
            |what: &'static str, name: &str, folder: &Path, found: Vec<&String>| SectionError::Unknown {
                what,
                name: name.into(),
                folder: folder.into(),
                found: if found.is_empty() {
                    "no surface".into()
                } else {
                    found.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ")
                },
            };
        let mut wanted: Vec<(&str, PathBuf, [End; 2])> = Vec::new();
        for muscle in ends {
            let name = muscle.muscle.as_str();
            let file = muscle_files
                .get(name)
                .ok_or_else(|| unknown("muscle", name, muscles, muscle_files.keys().collect()))?
                .clone();
            let mut at = [End::Tip; 2];
            for (end, bone) in at.iter_mut().zip(&muscle.bones) {
                if let Some(bone) = bone {
                    let surface = bone_surfaces
                        .get(bone)
                        .ok_or_else(|| unknown("bone", bone, bones, bone_surfaces.keys().collect()))?;
                    *end = End::Bone(surface);
                }
            }
            wanted.push((name, file, at));
        }
        for (name, ..) in &wanted {
            muscle_files.remove(*name);
        }
        let found: Vec<(MuscleSections, Fit, SearchSurface)> = wanted
            .par_iter()
            .map(|(name, file, at)| {
                let surface = read(file)?;
                let (sections, fit) =
                    sections_from_surface(name, &surface, *at, settings).map_err(|reason| {
                        SectionError::InFile { file: file.clone(), reason: Box::new(reason) }
                    })?;
                Ok((sections, fit, surface))
            })
            .collect::<Result<_, SectionError>>()?;
        let files = wanted.into_iter().map(|(_, file, _)| file).chain(bone_files.into_values()).collect();
        let mut anatomy = Anatomy {
            muscles: Vec::new(),
            fits: Vec::new(),
            surfaces: Vec::new(),
            bones: bone_surfaces
                .into_iter()
                .map(|(name, s)| Bone { name, surface: s.surface().clone() })
                .collect(),
            files,
            left_out: muscle_files.into_values().collect(),
        };
        for (sections, fit, surface) in found {
            anatomy.muscles.push(sections);
            anatomy.fits.push(fit);
            anatomy.surfaces.push(surface);
        }
        Ok(anatomy)
    }
}

/// Surface files of a folder by the name of what they show: the name of the file without ending and without `_r` for the
/// right side.
fn surface_files(folder: &Path) -> Result<BTreeMap<String, PathBuf>, SectionError> {
    let io = |source| SectionError::Io { folder: folder.into(), source };
    let mut paths: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        paths.push(entry.map_err(io)?.path());
    }
    paths.sort();
    let mut files = BTreeMap::new();
    for path in paths {
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        let stem = path.file_stem().and_then(|s| s.to_str());
        let (Some("stl" | "obj" | "ply"), Some(stem)) = (ending.as_deref(), stem) else { continue };
        let name = stem.strip_suffix("_r").unwrap_or(stem).to_owned();
        if let Some(first) = files.insert(name, path.clone()) {
            return Err(SectionError::TwoFiles { first, second: path });
        }
    }
    Ok(files)
}
