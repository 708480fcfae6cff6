//! The surfaces of a knee, where its ligaments hold on, and the frames of its bones.
//!
//! A folder holds closed or open surfaces in STL (m, all in one frame) and `knee_model.json`: per body the transform of its own frame into
//! that one, and springs with their ends. Axes of the own frames: x forward, y up, z lateral. The femur without its cartilage is no part of that
//! knee: `femur_r.stl` in the folder `bones` beside it, into which the knee was fitted.

#![allow(non_snake_case)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use fem::geometry::{SearchSurface, SignedDistance, Surface};
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
/// Distance \[m\] of cartilage to its bone at most: the thickest there is, that of the patella, has some 7 mm, and the femur is of another person, 1.4 mm
/// off in the mean.
const OFF_BONE: f64 = 10e-3;
/// The same of half of its points: twice what knees have in the mean.
const MOSTLY_OFF_BONE: f64 = 5e-3;
/// Distance \[m\] of the end of a spring to its bone at most; those of the knee that the surfaces are of are within 4 mm.
const OFF_END: f64 = 10e-3;
/// Of the tibia there is its cartilage only: the tuberosity, where the ligament of the patella ends, is some 50 mm below it.
const BELOW_JOINT: f64 = 100e-3;
/// Distance \[m\] between an end of a spring and where its file has it in the frame of the surfaces: numbers are written to a tenth of a micrometre.
const SAME_PLACE: f64 = 1e-5;
/// How far \[m\] from that of the surfaces the frame of a bone may be: farther is no leg.
const FAR_FRAME: f64 = 10.0;
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
        let [femur_tree, patella_tree] =
            [&femur, &patella].map(|bone| bone.as_ref().map(|bone| SearchSurface::new(bone.clone())));
        let sheets = [
            (FEMORAL_CARTILAGE, &femoral, FEMUR, &femur_tree),
            (PATELLAR_CARTILAGE, &patellar, PATELLA, &patella_tree),
        ];
        for (name, sheet, bone_name, bone) in sheets {
            if let (Some(sheet), Some(bone)) = (sheet, bone) {
                wrong.keep(lies_on(&folder.join(name), sheet, bone_name, bone));
            }
        }
        for (name, sheet) in TIBIAL_CARTILAGE.iter().zip([&medial, &lateral]) {
            if let (Some(sheet), Some((frames, _))) = (sheet, &model) {
                wrong.keep(looks_up(&folder.join(name), sheet, &frames[&Bone::Tibia]));
            }
        }
        if let (Some((_, springs)), Some(femur), Some(patella), Some(medial), Some(lateral)) =
            (&model, &femur_tree, &patella_tree, &medial, &lateral)
        {
            let joint = SearchSurface::new(medial.clone().with(lateral));
            wrong.keep(end_on_bones(&file, springs, [femur, &joint, patella]));
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

/// Refuses cartilage that does not lie on its bone, or looks into it.
fn lies_on(file: &Path, sheet: &Surface, bone_name: &str, bone: &SearchSurface) -> Result<(), CouplingError> {
    let bone = SignedDistance::new(bone)?;
    let mut off: Vec<f64> = sheet.points.iter().map(|p| bone.at(&(*p).into()).distance).collect();
    off.sort_by(f64::total_cmp);
    let [least, half, most] = [off[0], off[off.len() / 2], off[off.len() - 1]];
    if most.max(-least) > OFF_BONE || half.abs() > MOSTLY_OFF_BONE {
        let problem = format!(
            "it is {:.1} to {:.1} mm off {bone_name}, half of it beyond {:.1} mm, and cartilage lies on its bone, at most {} mm off and mostly {}",
            1e3 * least,
            1e3 * most,
            1e3 * half,
            1e3 * OFF_BONE,
            1e3 * MOSTLY_OFF_BONE
        );
        let remedy = "give both surfaces of one knee, in one frame and in metres";
        return Err(malformed(file, problem, remedy).into());
    }
    if looks_away(sheet, &bone) { Ok(()) } else { Err(turned_round(file)) }
}

/// Refuses cartilage of the tibia that looks down in the frame of that.
fn looks_up(file: &Path, sheet: &Surface, frame: &Isometry3<f64>) -> Result<(), CouplingError> {
    let area: Vector3<f64> = (0..sheet.triangles.len()).map(|t| sheet.area_vector(t)).sum();
    if area.dot(&(frame * Vector3::y())) > 0.0 { Ok(()) } else { Err(turned_round(file)) }
}

/// Refuses springs of which an end is off its bone: femur, cartilage of the tibia, patella.
fn end_on_bones(file: &Path, springs: &[Spring], bones: [&SearchSurface; 3]) -> Result<(), CouplingError> {
    let mut problems = Vec::new();
    for (bone, surface) in Bone::ALL.into_iter().zip(bones) {
        let (of, most) = match bone {
            Bone::Tibia => ("cartilage of the tibia", BELOW_JOINT),
            _ => (bone.body(), OFF_END),
        };
        for spring in springs {
            for (_, end) in spring.ends.iter().filter(|end| end.0 == bone) {
                let off = surface.nearest(&end.coords).map_or(f64::INFINITY, |at| at.0.distance);
                if !(off <= most) {
                    let name = &spring.name;
                    problems.push(format!(
                        "`{name}` ends {:.1} mm off {of}, at most {}",
                        1e3 * off,
                        1e3 * most
                    ));
                }
            }
        }
    }
    match problems.is_empty() {
        true => Ok(()),
        false => {
            let remedy = "give ends of springs on their bones, in the frame of each and in metres";
            Err(malformed(file, problems.join("; "), remedy).into())
        }
    }
}

/// Whether a sheet on a closed bone looks away from it: over all of it, more is gained than lost of the distance to the bone on both sides.
fn looks_away(sheet: &Surface, bone: &SignedDistance) -> bool {
    let gained = (0..sheet.triangles.len()).map(|t| {
        let (middle, area) = (sheet.corners(t).iter().sum::<Vector3<f64>>() / 3.0, sheet.area_vector(t));
        let aside = ASIDE * area.normalize();
        area.norm() * (bone.at(&(middle + aside)).distance - bone.at(&(middle - aside)).distance)
    });
    gained.sum::<f64>() > 0.0
}

fn turned_round(file: &Path) -> CouplingError {
    let problem = "its triangles look into the bone".to_string();
    malformed(file, problem, "turn all of them round: normals of cartilage look into the joint").into()
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
    /// The same in the frame of the surfaces, where it is given.
    limb: Option<[f64; 3]>,
}

fn malformed(file: &Path, problem: String, remedy: &str) -> InputError {
    InputError::Malformed { file: PathBuf::from(file), at: Place::Whole, problem, remedy: remedy.to_string() }
}

/// From the own frame of each bone into that of the surfaces.
pub(super) type Frames = BTreeMap<Bone, Isometry3<f64>>;

/// Frames and springs of a model.
fn parse(text: &str, file: &Path) -> Result<(Frames, Vec<Spring>), CouplingError> {
    // Some editors begin a file with a mark of its encoding.
    let model: ModelFile =
        serde_json::from_str(text.strip_prefix('\u{feff}').unwrap_or(text)).map_err(|e| {
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
                let far = (0..3).map(|r| rows[r][3].abs()).fold(0.0, f64::max);
                if !(far <= FAR_FRAME && rows[3] == [0.0, 0.0, 0.0, 1.0]) {
                    problems.push(format!(
                        "the matrix of `{}` is no motion within {FAR_FRAME} m with the last row 0 0 0 1",
                        bone.body()
                    ));
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
    let springs: Vec<Spring> = model.ligaments.iter().filter_map(spring).collect();
    let mut problems = Vec::new();
    for row in &model.ligaments {
        let off = row.points.iter().filter_map(|p| Some((end(p)?.1 - Point3::from(p.limb?)).norm()));
        let off = off.fold(0.0, f64::max);
        if !(off <= SAME_PLACE) {
            problems.push(format!(
                "`{}` has a point whose `native` is {:.3} mm from its `limb` by the matrix of its body",
                row.name,
                1e3 * off
            ));
        }
    }
    let mut names: Vec<&str> = springs.iter().map(|s| s.name.as_str()).collect();
    names.sort_unstable();
    let mut twice: Vec<&str> = names.windows(2).filter(|w| w[0] == w[1]).map(|w| w[0]).collect();
    twice.dedup();
    problems.extend(twice.into_iter().map(|name| format!("two springs are called `{name}`")));
    match problems.is_empty() {
        true => Ok((frames, springs)),
        false => {
            let remedy = "give every spring once, with its points in the frames of the bodies that they name";
            Err(malformed(file, problems.join("; "), remedy).into())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 20 mm in the middle of a face of a cube of 100 mm, at some heights over it.
    fn told(heights: [f64; 4], upward: bool) -> Option<String> {
        let corner = |k: usize| std::array::from_fn(|c| 0.1 * ((k >> c & 1) as f64 - 0.5));
        let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let cube = Surface { points: (0..8).map(corner).collect(), triangles };
        let places = [[-0.01, -0.01], [0.01, -0.01], [0.01, 0.01], [-0.01, 0.01]];
        let points = places.iter().zip(heights).map(|(p, h)| [p[0], p[1], 0.05 + h]).collect();
        let triangles = if upward { vec![[0, 1, 2], [0, 2, 3]] } else { vec![[0, 2, 1], [0, 3, 2]] };
        let sheet = Surface { points, triangles };
        lies_on("sheet.stl".as_ref(), &sheet, "bone.stl", &SearchSurface::new(cube))
            .err()
            .map(|e| e.to_string())
    }

    #[test]
    fn cartilage_lies_on_its_bone_and_looks_away_from_it() {
        assert_eq!(told([2e-3, 2e-3, 3e-3, 9e-3], true), None);
        // All of it within 10 mm, half of it beyond 5; and one corner beyond 10 mm, on either side.
        for heights in [[2e-3, 6e-3, 6e-3, 6e-3], [2e-3, 2e-3, 2e-3, 11e-3], [-11e-3, 2e-3, 2e-3, 2e-3]] {
            let said = told(heights, true).unwrap();
            assert!(said.contains("sheet.stl") && said.contains("cartilage lies on its bone"), "{said}");
        }
        assert!(told([2e-3; 4], false).unwrap().contains("look into the bone"));
    }
}
