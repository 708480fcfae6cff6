//! Deep flexion of a knee: its surfaces, the poses of its tibia, and the measured poses of its patella, found in a folder of data, or made.

use std::path::{Path, PathBuf};

use fem::geometry::SearchSurface;
use fem::scene::ContactMode;
use nalgebra::{Isometry3, Point3, Vector3};

use super::anatomy::{Bone, KneeAnatomy};
use super::flexion::FlexionFrame;
use super::made::MadeKnee;
use super::pose::{Coordinates, TibiaPath, read_measured};
use super::quadriceps::HEADS;
use super::rigid::{Quadriceps, ReferencePose, RigidKnee};
use super::shape::Shape;
use crate::error::CouplingError;

/// Where what is needed may be in the folder of data, or beside it.
const KNEE: [&str; 2] = ["knee", "anatomy/knee"];
const TABLES: [&str; 3] = ["reference/deep", "../reference/deep", "deep"];
const PATH: &str = "tibia_path_deep.csv";
const MEASURED: &str = "dynamic_mri_knee.csv";
/// Row of the measured poses that is the reference pose: the one nearest to extension that is a mean of more than two frames.
const REFERENCE: usize = 1;
/// Flexion from frame to frame \[degrees\].
const STRIDE: f64 = 2.5;
/// Flexion at the end \[degrees\].
pub const DEEPEST: f64 = 137.5;
/// Depth \[m\] to which cartilages of tibia and femur may overlap: both are 4.2 mm thick together, and bones may go a millimetre into each other.
const DEPTH: f64 = 5.2e-3;

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
    pub measured: Vec<[Coordinates; 2]>,
    /// Files that were read; none of a made knee.
    pub files: Vec<PathBuf>,
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
        let rows = read_measured(&measured)?;
        let [tibia, patella] = *rows.get(REFERENCE).ok_or_else(|| {
            let needed = REFERENCE + 1;
            CouplingError::Option(format!("{} needs at least {needed} rows", measured.display()))
        })?;
        Ok(DeepFlexion {
            anatomy: KneeAnatomy::read(&folder)?,
            path: TibiaPath::read(&path)?,
            reference: ReferencePose { tibia, patella },
            measured: rows,
            files: vec![model, path, measured],
        })
    }

    /// Makes a knee: no data are read.
    pub fn made() -> Result<DeepFlexion, CouplingError> {
        let made = MadeKnee::new(&Shape::default());
        let MadeKnee { anatomy, path, reference } =
            made.map_err(|error| CouplingError::Option(error.to_string()))?;
        Ok(DeepFlexion { anatomy, path, reference, measured: Vec::new(), files: Vec::new() })
    }

    /// The knee, with its strands in their strain in the reference pose.
    pub fn knee(&self, mode: ContactMode) -> Result<RigidKnee, CouplingError> {
        self.knee_with(mode, Quadriceps::Forces(&HEADS))
    }

    /// The same with its quadriceps as tissue.
    pub fn knee_with(&self, mode: ContactMode, quadriceps: Quadriceps) -> Result<RigidKnee, CouplingError> {
        let knee = RigidKnee::with_quadriceps(&self.anatomy, &self.reference, mode, quadriceps);
        knee.map_err(|error| CouplingError::Option(error.to_string()))
    }

    /// Poses of the tibia, every 2.5 degrees from a flexion \[degrees\] to 137.5 as far as the table goes.
    pub fn poses(&self, first: f64) -> Vec<Coordinates> {
        let [from, to] = self.path.range();
        let n = ((DEEPEST - first) / STRIDE) as usize;
        let all = (0..=n).map(|k| first + k as f64 * STRIDE);
        all.filter(|f| (from..=to).contains(f)).map(|f| self.path.at(f)).collect()
    }

    /// Pairs of triangles of femoral and patellar cartilage that intersect (exact) with the patella at a pose: an answer that contact has no
    /// part in.
    pub fn crossings(&self, patella: &Coordinates) -> usize {
        let KneeAnatomy { femoral_cartilage, patellar_cartilage, .. } = &self.anatomy;
        let placed = |surface, bone, pose| SearchSurface::new(self.anatomy.placed(surface, bone, &pose));
        let femoral = placed(femoral_cartilage, Bone::Femur, Isometry3::identity());
        femoral.intersections(&placed(patellar_cartilage, Bone::Patella, patella.pose())).len()
    }

    /// Refuses poses that drive the bones of tibia and femur into each other by more than a millimetre, all at once.
    pub fn check_poses(&self, knee: &RigidKnee) -> Result<(), CouplingError> {
        let own = self.anatomy.frame(Bone::Tibia).inverse();
        let points: Vec<Point3<f64>> = (self.anatomy.tibial_cartilage.iter())
            .flat_map(|s| s.points.iter().map(|p| own * Point3::from(*p)))
            .collect();
        let mut problems = Vec::new();
        for (row, pose) in self.path.rows().iter().enumerate() {
            let place = |p: &Point3<f64>| Vector3::from((pose.pose() * p).coords);
            let depth = |p| knee.femur.near(&place(p), 0.0).map_or(0.0, |at| -at.distance);
            let deepest = points.iter().map(depth).fold(0.0, f64::max);
            if deepest > DEPTH {
                problems.push(format!(
                    "row {} ({} degrees): cartilages of tibia and femur overlap by {:.1} mm",
                    row + 1,
                    pose.flexion,
                    1e3 * deepest
                ));
            }
        }
        match problems.is_empty() {
            true => Ok(()),
            false => Err(CouplingError::Option(format!(
                "{}: {}; give poses in which cartilages overlap by at most {} mm",
                self.files
                    .get(1)
                    .map_or("the way of the made knee".into(), |file| file.display().to_string()),
                problems.join("; "),
                1e3 * DEPTH
            ))),
        }
    }
}

/// How far computed poses of the patella are off measured ones, per coordinate: root mean square \[degrees, mm\], and over the mean of the
/// measured values.
pub fn deviations(frames: &[FlexionFrame], measured: &[[Coordinates; 2]]) -> [[f64; 2]; 6] {
    let n = measured.len() as f64;
    std::array::from_fn(|c| {
        let off = frames.iter().zip(measured).map(|(f, row)| f.patella.to_array()[c] - row[1].to_array()[c]);
        let rmsd = (off.map(|d| d * d).sum::<f64>() / n).sqrt();
        let mean = measured.iter().map(|row| row[1].to_array()[c]).sum::<f64>() / n;
        [rmsd, rmsd / mean.abs()]
    })
}
