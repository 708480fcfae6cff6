//! The surfaces of a knee, where its ligaments hold on, and the frames of its bones.
//!
//! A folder holds closed or open surfaces in STL (m, all in one frame) and `knee_model.json`: per body the transform of its own frame into
//! that one, and springs with their ends. Axes of the own frames: x forward, y up, z lateral. The femur without its cartilage is no part of that
//! knee: `femur_r.stl` in the folder `bones` beside it, into which the knee was fitted.

#![allow(non_snake_case)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use fem::geometry::{SearchSurface, SignedDistance, Surface, SurfaceError};
use fem::mesh::LengthUnit;
use multibody::InputError;
use multibody::error::Place;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;

use super::shape::Shape;
use crate::error::{CouplingError, Mistakes};

/// Bone of the femur, from the folder of the knee.
const FEMUR: &str = "../bones/femur_r.stl";
const FEMORAL_CARTILAGE: &str = "femoral_cartilage_r.stl";
const PATELLAR_CARTILAGE: &str = "patellar_cartilage_r.stl";
const TIBIAL_CARTILAGE: [&str; 2] = ["tibial_cartilage_medial_r.stl", "tibial_cartilage_lateral_r.stl"];
const PATELLA: &str = "patella_bone_r.stl";
/// Surfaces of a knee, from its folder.
pub(super) const SURFACES: [&str; 6] =
    [FEMUR, FEMORAL_CARTILAGE, PATELLA, PATELLAR_CARTILAGE, TIBIAL_CARTILAGE[0], TIBIAL_CARTILAGE[1]];
/// How far \[m\] to both sides of a sheet it is asked where the bone is: a quarter of the thickness of cartilage.
const ASIDE: f64 = 0.5e-3;
/// File of frames and springs.
const MODEL: &str = "knee_model.json";
/// How far from a rotation the matrix of a frame may be: what ten digits leave.
const ROTATION: f64 = 1e-8;

/// A bone of the knee.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Bone {
    /// Its distal end.
    Femur,
    /// Its proximal end.
    Tibia,
    /// The patella.
    Patella,
}

impl Bone {
    const ALL: [Bone; 3] = [Bone::Femur, Bone::Tibia, Bone::Patella];

    /// Its name in the file.
    fn body(self) -> &'static str {
        match self {
            Bone::Femur => "femur_distal_r",
            Bone::Tibia => "tibia_proximal_r",
            Bone::Patella => "patella_r",
        }
    }
}

/// A spring between two bones: its name and its ends, each in the frame of the surfaces \[m\].
#[derive(Clone, Debug, PartialEq)]
pub struct Spring {
    /// As in the file: `PT1`.
    pub name: String,
    /// Bone and place.
    pub ends: [(Bone, Point3<f64>); 2],
}

/// What the femur is as a solid.
#[derive(Clone, Debug)]
pub enum FemurSolid {
    /// What its cartilage and its bone enclose.
    Surfaces,
    /// Made, on the shaft of another femur in the frame of this one.
    Made {
        /// Its measures.
        shape: Shape,
        /// Closed.
        shaft: Surface,
    },
}

/// How the bellies of the built-in thigh are made to fit a knee: their ends are turned around the shaft to medial \[degrees\], and shifted away
/// from it by a part of their distance to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BellyFit {
    /// Degrees.
    pub turn: f64,
    /// Part of the distance.
    pub shift: f64,
}

/// The knee of the folder is not that of the built-in thigh, whose patella lies 14 mm more to lateral and 15 mm farther back. By search: tendons have
/// scaled Jacobians from 0.23 up with these, and one is turned over without.
const OTHER_PERSON: BellyFit = BellyFit { turn: 20.0, shift: 0.5 };
/// How far \[m\] bone that is of another person than the knee is sunk: so far is that of the folder off the subchondral sheet of its knee (root mean
/// square), and what is not of the knee must not stand out of it. Bellies are drawn up to the shaft of a made knee, too, and need the room.
pub const SUNK: f64 = 1.4e-3;

/// A knee as it is in the folder, or made.
#[derive(Clone, Debug)]
pub struct KneeAnatomy {
    /// Cartilage of femur and patella: open sheets whose normals look into the joint.
    pub femoral_cartilage: Surface,
    /// The same of the patella.
    pub patellar_cartilage: Surface,
    /// The patella without cartilage, closed.
    pub patella: Surface,
    /// The femur without cartilage, closed.
    pub femur: Surface,
    /// Cartilage of the tibia, medial and lateral.
    pub tibial_cartilage: [Surface; 2],
    /// From the own frame of a bone into that of the surfaces.
    pub(super) frames: Frames,
    /// Springs between these bones.
    pub springs: Vec<Spring>,
    /// The femur as a solid.
    pub solid: FemurSolid,
    /// How bellies are made to fit.
    pub fit: BellyFit,
}

impl KneeAnatomy {
    /// Reads a folder; all mistakes of its model and of its surfaces at once.
    pub fn read(folder: &Path) -> Result<KneeAnatomy, CouplingError> {
        let mut wrong = Mistakes::default();
        let file = folder.join(MODEL);
        let text = std::fs::read_to_string(&file)
            .map_err(|source| CouplingError::from(InputError::Io { file: file.clone(), source }));
        let model = wrong.keep(text.and_then(|text| parse(&text, &file)));
        let mut sheet = |name: &str| wrong.keep(Surface::read_sheet(&folder.join(name), LengthUnit::Metre));
        let sheets = [
            sheet(FEMORAL_CARTILAGE),
            sheet(PATELLAR_CARTILAGE),
            sheet(TIBIAL_CARTILAGE[0]),
            sheet(TIBIAL_CARTILAGE[1]),
        ];
        let mut body = |name: &str| wrong.keep(Surface::read_checked(&folder.join(name), LengthUnit::Metre));
        let [femur, patella] = [body(FEMUR), body(PATELLA)];
        let [femoral, patellar, medial, lateral] = sheets;
        for (name, sheet, bone) in
            [(FEMORAL_CARTILAGE, &femoral, &femur), (PATELLAR_CARTILAGE, &patellar, &patella)]
        {
            let (Some(sheet), Some(bone)) = (sheet, bone) else { continue };
            if wrong.keep(looks_away(sheet, bone)) == Some(false) {
                let problem = "its triangles look into the bone".to_string();
                let remedy = "turn all of them round: normals of cartilage look into the joint";
                wrong.note(malformed(&folder.join(name), problem, remedy).into());
            }
        }
        wrong.finish()?;
        let sound = "nothing was wrong with it";
        let (frames, springs) = model.expect(sound);
        Ok(KneeAnatomy {
            femoral_cartilage: femoral.expect(sound),
            patellar_cartilage: patellar.expect(sound),
            patella: patella.expect(sound),
            femur: femur.expect(sound),
            tibial_cartilage: [medial.expect(sound), lateral.expect(sound)],
            frames,
            springs,
            solid: FemurSolid::Surfaces,
            fit: OTHER_PERSON,
        })
    }

    /// From the own frame of a bone into that of the surfaces.
    pub fn frame(&self, bone: Bone) -> Isometry3<f64> {
        self.frames[&bone]
    }

    /// A surface of a bone where a pose has that bone, given from its own frame.
    pub fn placed(&self, surface: &Surface, bone: Bone, pose: &Isometry3<f64>) -> Surface {
        moved(surface, &(pose * self.frame(bone).inverse()))
    }

    /// Of the patella in its own frame \[m\]: how far forward the middle of its points is, and how far up and to lateral it goes.
    pub fn patella_half_axes(&self) -> [f64; 3] {
        let frame = self.frame(Bone::Patella).inverse();
        let own: Vec<Point3<f64>> = self.patella.points.iter().map(|p| frame * Point3::from(*p)).collect();
        let most = |c: usize| own.iter().fold(f64::MIN, |most, p| most.max(p[c]));
        let middle = own.iter().map(|p| p.x).sum::<f64>() / own.len() as f64;
        [middle, most(1), most(2)]
    }
}

/// Whether a sheet on a closed bone looks away from it: over all of it, more is gained than lost of the distance to the bone on both sides.
fn looks_away(sheet: &Surface, bone: &Surface) -> Result<bool, SurfaceError> {
    let bone = SearchSurface::new(bone.clone());
    let bone = SignedDistance::new(&bone)?;
    let gained = (0..sheet.triangles.len()).map(|t| {
        let (middle, area) = (sheet.corners(t).iter().sum::<Vector3<f64>>() / 3.0, sheet.area_vector(t));
        let aside = ASIDE * area.normalize();
        area.norm() * (bone.at(&(middle + aside)).distance - bone.at(&(middle - aside)).distance)
    });
    Ok(gained.sum::<f64>() > 0.0)
}

/// A surface somewhere else.
pub fn moved(surface: &Surface, by: &Isometry3<f64>) -> Surface {
    let points = surface.points.iter().map(|p| (by * Point3::from(*p)).into()).collect();
    Surface { points, triangles: surface.triangles.clone() }
}

/// What is read of the model.
#[derive(Deserialize)]
struct ModelFile {
    body_to_limb: BTreeMap<String, [[f64; 4]; 4]>,
    ligaments: Vec<LigamentRow>,
}

#[derive(Deserialize)]
struct LigamentRow {
    name: String,
    points: Vec<PointRow>,
}

#[derive(Deserialize)]
struct PointRow {
    body: String,
    native: [f64; 3],
}

fn malformed(file: &Path, problem: String, remedy: &str) -> InputError {
    InputError::Malformed { file: PathBuf::from(file), at: Place::Whole, problem, remedy: remedy.to_string() }
}

/// From the own frame of each bone into that of the surfaces.
pub(super) type Frames = BTreeMap<Bone, Isometry3<f64>>;

/// Frames and springs of a model.
fn parse(text: &str, file: &Path) -> Result<(Frames, Vec<Spring>), CouplingError> {
    let model: ModelFile = serde_json::from_str(text).map_err(|e| {
        let problem = format!("line {}: {e}", e.line());
        malformed(file, problem, "it holds `body_to_limb` and `ligaments` as in the folder of the knee")
    })?;
    let mut problems = Vec::new();
    let mut frames = BTreeMap::new();
    for bone in Bone::ALL {
        match model.body_to_limb.get(bone.body()) {
            None => problems.push(format!("`body_to_limb` has no `{}`", bone.body())),
            Some(rows) => {
                let R = Matrix3::from_fn(|r, c| rows[r][c]);
                if !((R.transpose() * R - Matrix3::identity()).amax() < ROTATION && R.determinant() > 0.0) {
                    problems.push(format!("the matrix of `{}` is no rotation", bone.body()));
                    continue;
                }
                let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(R));
                let place = Translation3::new(rows[0][3], rows[1][3], rows[2][3]);
                frames.insert(bone, Isometry3::from_parts(place, rotation));
            }
        }
    }
    if !problems.is_empty() {
        return Err(
            malformed(file, problems.join("; "), "give the frames of femur, tibia and patella").into()
        );
    }
    let end = |p: &PointRow| {
        let bone = Bone::ALL.into_iter().find(|b| b.body() == p.body)?;
        Some((bone, frames[&bone] * Point3::from(p.native)))
    };
    let spring = |row: &LigamentRow| match row.points.as_slice() {
        [a, b] => Some(Spring { name: row.name.clone(), ends: [end(a)?, end(b)?] }),
        _ => None,
    };
    let springs = model.ligaments.iter().filter_map(spring).collect();
    Ok((frames, springs))
}
