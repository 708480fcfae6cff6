//! The leg of one subject: shapes, joints, markers, muscles, inertia. Built once, never changed by a solver.

#![allow(non_snake_case)]

use nalgebra::{Matrix3, Matrix4, Vector3};
use thiserror::Error;

use crate::anatomy::{Anatomy, SegmentPosture};
use crate::joint::{self, Equation, Force};
use crate::muscle::path::{Muscle, muscles};
use crate::muscle::wrapped::wrapped_muscles;
use crate::natural::{Coordinates, End, Pose, SegmentId, Shape, VectorForm, point_form};
use crate::tables::{JointTable, segment_inertia};
use crate::trial::{Sex, Trial};

/// Distance from P to D of the patella \[m\] and its mass \[kg\] (point mass at P).
const PATELLA_LENGTH: f64 = 0.021;
const PATELLA_MASS: f64 = 0.0975;

/// Fraction of the reported frames in which the foot of a walker is flat on the floor.
pub(crate) const FLAT_FOOT: std::ops::RangeInclusive<f64> = 0.15..=0.45;

/// Which ankle the model has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ankle {
    /// Coincident point and two axes at a fixed angle; two degrees of freedom.
    #[default]
    Universal,
    /// Point contact and two isometric ligaments; one degree of freedom.
    Parallel,
}

/// What the knee is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum KneeKind {
    /// Cruciate ligaments that pull, as published.
    #[default]
    Natural,
    /// A prosthesis: no cruciate ligaments, shear both ways, compartments that may lift off ([`crate::tray`]).
    Implant,
}

/// A marker of the fit.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelMarker {
    /// Index into `Trial::markers`.
    pub track: usize,
    /// Name as in the recording.
    pub name: String,
    /// Segment that carries it.
    pub segment: SegmentId,
    /// Position as a form of the natural coordinates.
    pub position: VectorForm,
}

/// Inertia of one segment in natural coordinates (Dumas & Chèze 2007, with the matrix of second moments).
#[derive(Clone, Debug, PartialEq)]
pub struct Inertia {
    /// Mass \[kg\].
    pub mass: f64,
    /// Centre of mass in SCS from rP \[m\].
    pub com: Vector3<f64>,
    /// Inertia tensor about the centre of mass in SCS axes \[kg·m²\].
    pub tensor: Matrix3<f64>,
    /// Coefficients of the mass matrix on (u, rP, rD, w); each times the 3×3 identity.
    pub G: Matrix4<f64>,
    /// Coefficients of the centre of mass on (u, rP, rD, w).
    pub centre: VectorForm,
}

/// The rigid lower limb of one subject.
#[derive(Clone, Debug)]
pub struct Model {
    /// Constant lengths and angles of foot, shank, patella, thigh, pelvis.
    pub shapes: [Shape; 5],
    /// Which ankle.
    pub ankle: Ankle,
    /// What the knee is.
    pub knee: KneeKind,
    /// Joint equations: ankle, knee, patella, hip.
    pub equations: Vec<Equation>,
    /// Hip centre in pelvis SCS from rP \[m\].
    pub hip: Vector3<f64>,
    /// Markers of the fit.
    pub markers: Vec<ModelMarker>,
    /// The 43 muscles.
    pub muscles: Vec<Muscle>,
    /// Inertia of foot, shank, patella, thigh.
    pub inertia: [Inertia; 4],
    /// Mean rotation of the foot in the shank while the foot is flat (15 to 45 % of the cycle).
    pub neutral_foot: Matrix3<f64>,
    /// Where the landmarks sit.
    pub anatomy: Anatomy,
}

/// Why a model cannot be built.
#[derive(Debug, Error, PartialEq)]
pub enum ModelError {
    /// No frame shows three markers on each segment.
    #[error(
        "no frame of `{trial}` shows at least three markers of {segment} that are not on a line (seen at most {seen}); \
         name more markers of that segment in the trial file"
    )]
    NoPosture {
        /// Name of the trial.
        trial: String,
        /// Segment that lacks markers.
        segment: &'static str,
        /// Largest number of its markers that any frame shows.
        seen: usize,
    },
}

impl Model {
    /// Builds the model from the marker-based postures of the reported frames: lengths, angles and local marker
    /// positions are means over those frames.
    pub fn new(trial: &Trial, anatomy: Anatomy, ankle: Ankle) -> Result<Model, ModelError> {
        let postures: Vec<(usize, [SegmentPosture; 4])> =
            trial.report.clone().filter_map(|frame| Some((frame, anatomy.posture(trial, frame)?))).collect();
        if postures.is_empty() {
            return Err(no_posture(trial));
        }
        let shapes = mean_shapes(&postures);
        let markers = mean_markers(trial, &anatomy, &postures);
        let table = JointTable::built_in();
        let [foot, shank, patella, thigh, pelvis] = &shapes;

        let frames: Vec<Coordinates> = postures.iter().map(|(_, p)| coordinates(&shapes, p)).collect();
        let pose = |segment: SegmentId, Q: &Coordinates| shapes[segment.index()].pose(segment, Q);
        let n = frames.len() as f64;
        let hip = frames
            .iter()
            .zip(&postures)
            .map(|(Q, (_, p))| {
                let X = pose(SegmentId::Pelvis, Q);
                X.R.transpose() * (p[2][1] - X.p)
            })
            .sum::<Vector3<f64>>()
            / n;
        let neutral_foot = neutral_foot(trial, &postures, |frame_in_list| {
            let Q = &frames[frame_in_list];
            pose(SegmentId::Shank, Q).R.transpose() * pose(SegmentId::Foot, Q).R
        });

        let mut equations = match ankle {
            Ankle::Universal => {
                let talocrural = table.point("ankle_universal", "talocrural axis").normalize();
                let subtalar = table.point("ankle_universal", "subtalar axis").normalize();
                let angle = frames
                    .iter()
                    .map(|Q| {
                        let a = pose(SegmentId::Shank, Q).R * talocrural;
                        a.angle(&(pose(SegmentId::Foot, Q).R * subtalar))
                    })
                    .sum::<f64>()
                    / n;
                joint::ankle_universal(table, shank, foot, angle.cos())
            }
            Ankle::Parallel => joint::ankle_parallel(table, shank, foot, &neutral_foot),
        };
        equations.extend(joint::knee(table, thigh, shank));
        equations.extend(joint::patella(table, thigh, patella, shank));
        equations.extend(joint::hip(pelvis, thigh, &hip));

        Ok(Model {
            muscles: muscles(&shapes, &hip),
            inertia: leg_inertia(&shapes, trial.subject.mass, trial.subject.sex),
            shapes,
            ankle,
            knee: KneeKind::Natural,
            equations,
            hip,
            markers,
            neutral_foot,
            anatomy,
        })
    }

    /// The same leg with quadriceps and gastrocnemii over cylinders, so that no lever arm jumps ([`crate::muscle::wrapped`]).
    pub fn with_wrapped_muscles(self) -> Model {
        Model { muscles: wrapped_muscles(&self.shapes, &self.hip), ..self }
    }

    /// The same leg with another kind of knee.
    pub fn with_knee(self, knee: KneeKind) -> Model {
        Model { knee, ..self }
    }

    /// Number of joint equations (18 or 19).
    pub fn n_joint_rows(&self) -> usize {
        self.equations.iter().map(Equation::n_rows).sum()
    }

    /// Names of the joint coordinates that muscles move, in the order of lever arms and moments.
    pub fn coordinate_names(&self) -> Vec<String> {
        let ankle: &[&str] = match self.ankle {
            Ankle::Universal => &["ankle_flexion", "subtalar_inversion"],
            Ankle::Parallel => &["ankle_flexion"],
        };
        let leg = ["hip_flexion", "hip_adduction", "hip_rotation", "knee_flexion"];
        leg.iter().chain(ankle).map(|s| s.to_string()).collect()
    }

    /// Names of the wanted multipliers, in the order of the publication: contacts and ligaments from ankle to hip,
    /// then the axial forces of foot, tibia, patella and femur. Contacts of points have suffixes `_x`, `_y`, `_z`.
    pub fn reaction_names(&self) -> Vec<String> {
        let mut names = Vec::new();
        for equation in &self.equations {
            match equation {
                Equation::Coincide { contact, .. } => {
                    names.extend(["x", "y", "z"].map(|axis| format!("{contact}_{axis}")));
                }
                Equation::Product { force: Force::Contact(name) | Force::Tension(name, _), .. } => {
                    names.push(name.to_string());
                }
                Equation::Product { force: Force::None, .. } => {}
            }
        }
        if self.knee == KneeKind::Implant {
            for name in &mut names {
                if let Some((_, shear)) = crate::tray::SHEAR.iter().find(|(ligament, _)| name == ligament) {
                    *name = shear.to_string();
                }
            }
        }
        names.extend(["foot_axial", "tibia_axial", "patella_axial", "femur_axial"].map(String::from));
        names
    }

    /// Marker-based start posture of one frame, patella placed in front; `None` without enough markers.
    pub fn start(&self, trial: &Trial, frame: usize) -> Option<Coordinates> {
        Some(coordinates(&self.shapes, &self.anatomy.posture(trial, frame)?))
    }

    /// Pose of a segment's SCS.
    pub fn pose(&self, segment: SegmentId, Q: &Coordinates) -> Pose {
        self.shapes[segment.index()].pose(segment, Q)
    }
}

/// Natural coordinates of a marker-based posture: each segment brought to its mean shape, patella placed in front.
fn coordinates(shapes: &[Shape; 5], posture: &[SegmentPosture; 4]) -> Coordinates {
    let mut Q = Coordinates::zeros();
    let segments = [SegmentId::Foot, SegmentId::Shank, SegmentId::Thigh, SegmentId::Pelvis];
    for (segment, [u, rP, rD, _]) in segments.iter().zip(posture) {
        let x = u.normalize();
        let z = x.cross(&(rP - rD)).normalize();
        let R = Matrix3::from_columns(&[x, z.cross(&x), z]);
        shapes[segment.index()].write(*segment, &Pose { R, p: *rP }, &mut Q);
    }
    crate::anatomy::place_patella(shapes, &mut Q);
    Q
}

fn no_posture(trial: &Trial) -> ModelError {
    let most = |segment: SegmentId| {
        let tracks: Vec<_> = trial.markers.iter().filter(|t| t.segment == segment).collect();
        let seen = |frame: usize| tracks.iter().filter(|t| t.position[frame].is_some()).count();
        trial.report.clone().map(seen).max().unwrap_or(0)
    };
    let segments = [SegmentId::Foot, SegmentId::Shank, SegmentId::Thigh, SegmentId::Pelvis];
    let (segment, seen) =
        segments.map(|s| (s, most(s))).into_iter().min_by_key(|s| s.1).expect("four segments");
    ModelError::NoPosture { trial: trial.name.clone(), segment: segment.name(), seen }
}

fn mean_shapes(postures: &[(usize, [SegmentPosture; 4])]) -> [Shape; 5] {
    let mean = |k: usize| {
        let shapes: Vec<Shape> =
            postures.iter().map(|(_, p)| Shape::of(&p[k][0], &p[k][1], &p[k][2], &p[k][3])).collect();
        let n = shapes.len() as f64;
        let angle = |cosine: fn(&Shape) -> f64| {
            (shapes.iter().map(|s| cosine(s).clamp(-1.0, 1.0).acos()).sum::<f64>() / n).cos()
        };
        Shape {
            L: shapes.iter().map(|s| s.L).sum::<f64>() / n,
            cos_alpha: angle(|s| s.cos_alpha),
            cos_beta: angle(|s| s.cos_beta),
            cos_gamma: angle(|s| s.cos_gamma),
        }
    };
    let patella = Shape { L: PATELLA_LENGTH, cos_alpha: 0.0, cos_beta: 0.0, cos_gamma: 0.0 };
    [mean(0), mean(1), patella, mean(2), mean(3)]
}

/// Local coordinates of each marker: mean over the frames of its coefficients on (u, v, w) of the marker-based posture.
fn mean_markers(
    trial: &Trial,
    anatomy: &Anatomy,
    postures: &[(usize, [SegmentPosture; 4])],
) -> Vec<ModelMarker> {
    let mut markers = Vec::new();
    for (track_index, track) in trial.markers.iter().enumerate() {
        let list = match track.segment {
            SegmentId::Foot => 0,
            SegmentId::Shank => 1,
            SegmentId::Patella => continue,
            SegmentId::Thigh => 2,
            SegmentId::Pelvis => 3,
        };
        if !anatomy.clusters[track.segment.index()].names.contains(&track.name) {
            continue;
        }
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        for (frame, posture) in postures {
            let Some(position) = track.position[*frame] else { continue };
            let [u, rP, rD, w] = posture[list];
            let basis = Matrix3::from_columns(&[u, rP - rD, w]);
            if let Some(n) = basis.lu().solve(&(position - rP)) {
                sum += n;
                count += 1.0;
            }
        }
        if count > 0.0 {
            markers.push(ModelMarker {
                track: track_index,
                name: track.name.clone(),
                segment: track.segment,
                position: point_form(track.segment, &(sum / count), End::Proximal),
            });
        }
    }
    markers
}

/// Mean rotation of foot in shank over 15 to 45 % of the reported frames.
fn neutral_foot(
    trial: &Trial,
    postures: &[(usize, [SegmentPosture; 4])],
    foot_in_shank: impl Fn(usize) -> Matrix3<f64>,
) -> Matrix3<f64> {
    let start = trial.report.start as f64;
    let length = trial.report.len() as f64;
    let flat = |k: &usize| {
        let fraction = (postures[*k].0 as f64 - start) / length;
        FLAT_FOOT.contains(&fraction)
    };
    let mut sum: Matrix3<f64> = (0..postures.len()).filter(flat).map(&foot_in_shank).sum();
    if sum.norm() == 0.0 {
        sum = (0..postures.len()).map(&foot_in_shank).sum();
    }
    let svd = sum.svd(true, true);
    svd.u.expect("computed") * svd.v_t.expect("computed")
}

fn leg_inertia(shapes: &[Shape; 5], body_mass: f64, sex: Sex) -> [Inertia; 4] {
    let sex = match sex {
        Sex::Male => "male",
        Sex::Female => "female",
    };
    let segment = |id: SegmentId| {
        let (shape, t) = (&shapes[id.index()], segment_inertia(id.name(), sex));
        let mass = t.mass * body_mass;
        let square = |r: f64| mass * (r * shape.L).powi(2);
        let product = |r: f64| r.signum() * square(r);
        let (xx, yy, zz) = (square(t.gyration.x), square(t.gyration.y), square(t.gyration.z));
        let (xy, xz, yz) = (product(t.products.x), product(t.products.y), product(t.products.z));
        let tensor = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        inertia(id, shape, mass, shape.L * t.com, tensor)
    };
    let patella = &shapes[SegmentId::Patella.index()];
    [
        segment(SegmentId::Foot),
        segment(SegmentId::Shank),
        inertia(SegmentId::Patella, patella, PATELLA_MASS, Vector3::zeros(), Matrix3::zeros()),
        segment(SegmentId::Thigh),
    ]
}

/// Mass matrix of a segment on (u, rP, rD, w): ∫ N^T N dm with the second moments S about P
/// (the published text has the inertia tensor in their place; only S gives the rigid body's kinetic energy).
pub fn inertia(id: SegmentId, shape: &Shape, mass: f64, com: Vector3<f64>, tensor: Matrix3<f64>) -> Inertia {
    let about_p = tensor + mass * (com.dot(&com) * Matrix3::identity() - com * com.transpose());
    let S = 0.5 * about_p.trace() * Matrix3::identity() - about_p;
    let B_inv = shape.basis().try_inverse().expect("a segment's u, v, w are independent");
    let J = B_inv * S * B_inv.transpose();
    let n = mass * shape.coefficients(&com);
    // r = n1 u + (1 + n2) rP − n2 rD + n3 w, so the coefficients are affine in (n1, n2, n3).
    let linear = nalgebra::Matrix4x3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0);
    let constant = nalgebra::Vector4::new(0.0, 1.0, 0.0, 0.0);
    let cross = linear * n * constant.transpose();
    let G =
        linear * J * linear.transpose() + cross + cross.transpose() + mass * constant * constant.transpose();
    Inertia { mass, com, tensor, G, centre: shape.point(id, &com, End::Proximal) }
}
