//! Deep flexion of a knee: its surfaces, the poses of its tibia, and the measured poses of its patella, found in a folder of data, or made.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fem::geometry::{DistanceField, SearchSurface, SignedDistance};
use fem::scene::ContactMode;
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use super::anatomy::{Bone, KneeAnatomy, SURFACES};
use super::femur;
use super::flexion::FlexionFrame;
use super::made::MadeKnee;
use super::pose::{Coordinates, Measured, TibiaPath};
use super::quadriceps::HEADS;
use super::rigid::{KneeError, Quadriceps, ReferencePose, RigidKnee};
use super::shape::Shape;
use crate::error::{CouplingError, Mistakes};

/// Where what is needed may be in the folder of data, or beside it.
const KNEE: [&str; 2] = ["knee", "anatomy/knee"];
const TABLES: [&str; 3] = ["reference/deep", "../reference/deep", "deep"];
const PATH: &str = "tibia_path_deep.csv";
const MEASURED: &str = "dynamic_mri_knee.csv";
/// Flexion from frame to frame \[degrees\].
const STRIDE: f64 = 2.5;
/// Flexion at the end \[degrees\].
pub const DEEPEST: f64 = 137.5;
/// Depth \[m\] to which cartilages of tibia and femur may overlap: both are 4.2 mm thick together, and bones may go a millimetre into each other.
const DEPTH: f64 = 5.2e-3;
/// Gap \[m\] between cartilage of the tibia and the femur at most, on either side: condyles that lift off by more are no knee.
const GAP: f64 = 10e-3;

/// Part of the greatest value below which a mean is what is left of values that cancel: tables have six digits.
const ROUND_OFF: f64 = 1e-9;

/// Files of a knee.
#[derive(Clone, Debug)]
pub struct KneeFiles {
    /// Frames of the bones and springs; surfaces lie beside it.
    pub model: PathBuf,
    /// Poses of the tibia.
    pub path: PathBuf,
    /// Measured poses.
    pub measured: PathBuf,
}

impl KneeFiles {
    /// All of them, surfaces too.
    pub fn all(&self) -> Vec<PathBuf> {
        let folder = self.model.parent().unwrap_or(Path::new(""));
        let surfaces = SURFACES.iter().map(|name| folder.join(name));
        [&self.model, &self.path, &self.measured].into_iter().cloned().chain(surfaces).collect()
    }
}

/// What deep flexion is computed from.
#[derive(Clone, Debug)]
pub struct DeepFlexion {
    /// Surfaces and springs.
    pub anatomy: KneeAnatomy,
    /// Poses of the tibia.
    pub path: TibiaPath,
    /// Where its strands have their strain.
    pub reference: ReferencePose,
    /// Measured poses of tibia and patella; none of a made knee.
    pub measured: Measured,
    /// Tables and the model that were read; none of a made knee.
    pub files: Option<KneeFiles>,
}

impl DeepFlexion {
    /// Reads what is found in a folder of data.
    pub fn find(data: &Path) -> Result<DeepFlexion, CouplingError> {
        let mut missing = Vec::new();
        let mut find = |places: &[&str], file: &str| {
            let found = places.iter().map(|p| data.join(p).join(file)).find(|p| p.is_file());
            if found.is_none() {
                missing.push(format!("{file} (looked for in {})", places.join(", ")));
            }
            found
        };
        let found = (find(&KNEE, "knee_model.json"), find(&TABLES, PATH), find(&TABLES, MEASURED));
        let (Some(model), Some(path), Some(measured)) = found else {
            return Err(CouplingError::Option(format!(
                "{} holds no data of a knee: {} missing; --data names the folder with `anatomy` and `reference`, or its `anatomy`",
                data.display(),
                missing.join("; ")
            )));
        };
        let folder = model.parent().expect("a file has a folder").to_path_buf();
        let files = KneeFiles { model, path, measured };
        let mut wrong = Mistakes::default();
        let measured = wrong.keep(Measured::read(&files.measured));
        let reference = measured.as_ref().and_then(|measured| {
            let none = || {
                CouplingError::Option(format!(
                    "{}: no row is a mean of more than two `frames`; give one near extension, strands have their strain there",
                    files.measured.display()
                ))
            };
            wrong.keep(measured.reference().ok_or_else(none)).map(|row| measured.rows[row])
        });
        let anatomy = wrong.keep(KneeAnatomy::read(&folder));
        let path = wrong.keep(TibiaPath::read(&files.path));
        wrong.finish()?;
        let all = anatomy.zip(path).zip(measured.zip(reference));
        let ((anatomy, path), (measured, [tibia, patella])) = all.expect("nothing was wrong with any");
        let reference = ReferencePose { tibia, patella };
        Ok(DeepFlexion { anatomy, path, reference, measured, files: Some(files) })
    }

    /// Makes a knee: no data are read.
    pub fn made() -> Result<DeepFlexion, CouplingError> {
        let made = MadeKnee::new(&Shape::default());
        let MadeKnee { anatomy, path, reference } =
            made.map_err(|error| CouplingError::Option(error.to_string()))?;
        Ok(DeepFlexion { anatomy, path, reference, measured: Measured::default(), files: None })
    }

    /// The knee, with its strands in their strain in the reference pose.
    pub fn knee(&self, mode: ContactMode) -> Result<RigidKnee, CouplingError> {
        self.knee_with(mode, Quadriceps::Forces(&HEADS))
    }

    /// The same with its quadriceps as tissue.
    pub fn knee_with(&self, mode: ContactMode, quadriceps: Quadriceps) -> Result<RigidKnee, CouplingError> {
        let knee = RigidKnee::with_quadriceps(&self.anatomy, &self.reference, mode, quadriceps);
        knee.map_err(|error| match error {
            KneeError::Several(all) => {
                let mut wrong = Mistakes::default();
                all.iter().for_each(|error| wrong.note(self.with_its_file(error)));
                wrong.finish().expect_err("something is wrong")
            }
            one => self.with_its_file(&one),
        })
    }

    /// What is wrong with a knee, and the file that says so.
    fn with_its_file(&self, error: &KneeError) -> CouplingError {
        CouplingError::Option(match (error, &self.files) {
            (KneeError::NoGroove(_), Some(files)) => {
                let row = self.measured.reference().expect("it has a reference pose");
                let (file, line) = (files.measured.display(), self.measured.lines[row]);
                format!("{file}, line {line}: {error}")
            }
            (KneeError::NoSprings(_), Some(files)) => format!("{}: {error}", files.model.display()),
            _ => error.to_string(),
        })
    }

    /// Poses of the tibia, every 2.5 degrees from a flexion \[degrees\] to 137.5 as far as the table goes.
    pub fn poses(&self, first: f64) -> Vec<Coordinates> {
        let [from, to] = self.path.range();
        let n = ((DEEPEST - first) / STRIDE) as usize;
        let all = (0..=n).map(|k| first + k as f64 * STRIDE);
        all.filter(|f| (from..=to).contains(f)).map(|f| self.path.at(f)).collect()
    }

    /// Pairs of triangles of femoral and patellar cartilage that intersect (exact) with the patella at each of some poses: an answer that contact has
    /// no part in.
    pub fn crossings(&self, patellas: &[Coordinates]) -> Vec<usize> {
        let KneeAnatomy { femoral_cartilage, patellar_cartilage, .. } = &self.anatomy;
        let placed = |surface, bone, pose| SearchSurface::new(self.anatomy.placed(surface, bone, &pose));
        let femoral = placed(femoral_cartilage, Bone::Femur, Isometry3::identity());
        let patellar = |patella: &Coordinates| placed(patellar_cartilage, Bone::Patella, patella.pose());
        patellas.par_iter().map(|p| femoral.intersections(&patellar(p)).len()).collect()
    }

    /// Where the poses of the tibia come from, in words.
    fn path_told(&self) -> String {
        self.files.as_ref().map_or("the way of the made knee".into(), |f| f.path.display().to_string())
    }

    /// A knee that is put together from this scene, and what is to be said of its way from a flexion \[degrees\] on. All at once: what is wrong with
    /// the way, with the knee, and with its poses.
    pub fn checked(
        &self,
        first: f64,
        build: &dyn Fn() -> Result<RigidKnee, CouplingError>,
    ) -> Result<(RigidKnee, Option<String>), CouplingError> {
        let mut wrong = Mistakes::default();
        let short = wrong.keep(self.short_of(first));
        let knee = wrong.keep(build());
        // Under muscles the distance to all of the femur is known, poses are judged by that around the knee.
        let femur = match &knee {
            Some(knee) if knee.muscles.is_none() => Some(knee.femur.clone()),
            _ => wrong.keep(femur::field(&self.anatomy).map_err(CouplingError::from)).map(Arc::new),
        };
        if let Some(femur) = femur {
            wrong.keep(self.check_poses(&femur));
        }
        wrong.finish()?;
        let sound = "nothing was wrong with it";
        Ok((knee.expect(sound), short.expect(sound)))
    }

    /// How far the table of poses falls short of a way from a flexion \[degrees\] on, in words; refuses one that has nothing of it.
    pub fn short_of(&self, first: f64) -> Result<Option<String>, CouplingError> {
        let ([from, to], file) = (self.path.range(), self.path_told());
        // One pose is no way.
        if self.poses(first).len() < 2 {
            return Err(CouplingError::Option(format!(
                "{file}: poses from {from} to {to} degrees of flexion have less than a step of the way from {first} to {DEEPEST}; give poses there"
            )));
        }
        let is_short = from > first || to < DEEPEST;
        Ok(is_short.then(|| {
            format!(
                "{file} has poses from {from} to {to} degrees only, so the way is cut to that, of {first} to {DEEPEST}"
            )
        }))
    }

    /// Refuses poses that drive the bones of tibia and femur into each other by more than a millimetre or pull them apart, all at once: rows of both
    /// tables, and the poses between rows that the way goes through. `field`: the distance to the femur around its knee.
    pub fn check_poses(&self, field: &DistanceField) -> Result<(), CouplingError> {
        let own = self.anatomy.frame(Bone::Tibia).inverse();
        let points =
            self.anatomy.tibial_cartilage.each_ref().map(|sheet| {
                sheet.points.iter().map(|p| own * Point3::from(*p)).collect::<Vec<Point3<f64>>>()
            });
        let femur = self.anatomy.placed(&self.anatomy.femur, Bone::Femur, &Isometry3::identity());
        let femur = SearchSurface::new(femur);
        // Around the knee there is a smooth distance to cartilage and bone, elsewhere that to the bone.
        let bone = SignedDistance::new(&femur)?;
        let depth = |p: &Vector3<f64>| field.at(p).map_or_else(|| -bone.at(p).distance, |at| -at.distance);
        let path = self.path.rows().iter().zip(self.path.lines());
        let rows = path.map(|(pose, line)| (format!("line {line} ({} degrees)", pose.flexion), *pose));
        let between = self.poses(0.0).into_iter().filter(|pose| !self.path.rows().contains(pose));
        let between = between.map(|pose| (format!("between its rows, at {} degrees", pose.flexion), pose));
        let measured = self.measured.rows.iter().zip(&self.measured.lines);
        let measured =
            measured.map(|(row, line)| (format!("line {line} ({} degrees)", row[0].flexion), row[0]));
        let said = |poses: Vec<(String, Coordinates)>| {
            let deep = poses.par_iter().flat_map_iter(|(place, pose)| {
                let pose = pose.pose();
                let deepest = |points: &[Point3<f64>]| {
                    points.iter().map(|p| depth(&(pose * p).coords)).fold(f64::NEG_INFINITY, f64::max)
                };
                let sides = ["medial", "lateral"].into_iter().zip(points.each_ref().map(|p| deepest(p)));
                let apart = sides.filter(|(_, by)| *by > DEPTH || *by < -GAP).map(move |(side, by)| {
                    let how = if by > 0.0 { "overlaps with the femur by" } else { "is off the femur by" };
                    format!("{place}: {side} cartilage of the tibia {how} {:.1} mm", 1e3 * by.abs())
                });
                apart.collect::<Vec<String>>()
            });
            deep.collect::<Vec<String>>()
        };
        let measured_told = self.files.as_ref().map_or(String::new(), |f| f.measured.display().to_string());
        let mut wrong = Mistakes::default();
        for (file, problems) in [
            (self.path_told(), said(rows.chain(between).collect())),
            (measured_told, said(measured.collect())),
        ] {
            if !problems.is_empty() {
                wrong.note(CouplingError::Option(format!(
                    "{file}: {}; give poses in which they overlap by at most {} mm, both cartilages and one more, and are at most {} mm apart",
                    problems.join("; "),
                    1e3 * DEPTH,
                    1e3 * GAP
                )));
            }
        }
        wrong.finish()
    }
}

/// How far a computed coordinate of the patella is off the measured one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// Root mean square \[degrees, mm\].
    pub rmsd: f64,
    /// The same over the mean of the measured values; none where that is zero.
    pub nrmsd: Option<f64>,
}

/// How far computed poses of the patella are off measured ones, per coordinate.
pub fn deviations(frames: &[FlexionFrame], measured: &Measured) -> [Deviation; 6] {
    let measured = &measured.rows;
    let n = measured.len() as f64;
    std::array::from_fn(|c| {
        let off = frames.iter().zip(measured).map(|(f, row)| f.patella.to_array()[c] - row[1].to_array()[c]);
        let rmsd = (off.map(|d| d * d).sum::<f64>() / n).sqrt();
        let values = || measured.iter().map(|row| row[1].to_array()[c]);
        let (mean, most) = (values().sum::<f64>() / n, values().fold(0.0, |most: f64, v| most.max(v.abs())));
        Deviation { rmsd, nrmsd: (mean.abs() > ROUND_OFF * most).then(|| rmsd / mean.abs()) }
    })
}

/// Sum over all coordinates of the deviation over the mean; none where one has none.
pub fn nrmsd_sum(all: &[Deviation; 6]) -> Option<f64> {
    all.iter().map(|of| of.nrmsd).sum()
}
