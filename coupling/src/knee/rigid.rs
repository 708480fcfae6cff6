//! The patella in equilibrium on a rigid femur: cartilage on cartilage, ligament and retinacula as strands, quadriceps as a force.

use std::collections::BTreeMap;

use fem::body::Pose;
use fem::geometry::{SearchSurface, Surface};
use fem::mesh::{CellBlock, CellKind, Mesh};
use fem::plan::{Load, Plan, SceneError};
use fem::scene::{
    BodyForceSpec, ContactMode, ContactSpec, FreeBodySpec, PrescribedSpec, Scene, StrandSpec, TieSpec,
};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use thiserror::Error;

use super::anatomy::{Bone, KneeAnatomy};
use super::pose::Coordinates;
use super::tendon::Tendon;

/// Name of the patella as a body.
pub const PATELLA: &str = "patella";
/// Name of the tibia as a body.
pub const TIBIA: &str = "tibia";
/// Surface of the femur that takes part in contact.
pub const FEMORAL_CARTILAGE: &str = "femoral_cartilage";
/// Surface of the patella that takes part in contact.
pub const PATELLAR_CARTILAGE: &str = "patellar_cartilage";
/// Controls of the force of the quadriceps \[N\]: forward, up and lateral in the frame of the femur.
pub const QUADRICEPS: [&str; 3] = ["quadriceps_forward_n", "quadriceps_up_n", "quadriceps_lateral_n"];

/// Thickness \[m\] of cartilage at its rim: there the sheet goes on down to the bone, or what comes over the rim would lose its support at once.
const RIM: f64 = 2.2e-3;
/// Half the strain at which the toe of a strand ends: linear from 0.06 on (the study of the deep knee).
const TOE: f64 = 0.03;
/// Young's modulus \[Pa\] and Poisson's ratio of cartilage: as elastic foundations of knees commonly take; the law is that of Bei & Fregly, Med
/// Eng Phys 26:777 (2004).
const CARTILAGE: [f64; 2] = [5e6, 0.45];
/// Thickness \[m\] of both layers of cartilage: medians over the surfaces, 2.2 mm on the femur and 2.0 mm on the patella.
const THICKNESS: f64 = 4.2e-3;
/// Guarded: distance \[m\] at which cartilage repels cartilage; the least that starts free of forces.
const DISTANCE: f64 = 0.3e-3;
/// The patella goes forward in steps of this \[m\] until its cartilage is off that of the femur.
const STRIDE: f64 = 0.25e-3;
/// It is in no groove where that takes more \[m\].
const FARTHEST: f64 = 10e-3;
/// Points of the patella within this of its highest one \[m\] are its base, where the quadriceps pulls.
const BASE: f64 = 3e-3;

/// Strands of one structure.
struct Structure {
    name: &'static str,
    /// Per strand the springs of the model whose ends at the patella it takes, from lateral to medial (ligament) or from above (retinacula).
    springs: &'static [&'static [&'static str]],
    /// Springs whose ends at the femur it takes; none: the other ends of those at the patella.
    far: &'static [&'static str],
    /// Of all its strands together \[N/m\].
    stiffness: f64,
    /// In the reference pose of the knee.
    strain: f64,
}

/// Stiffness and strain: the study of the deep knee, N/mm where it prints N/mm²; 7 strands of the ligament, 5 of the retinacula.
/// Ends: means of those of the springs of the knee that the surfaces are of. The lateral retinaculum goes to the lateral epicondyle, from where
/// the collateral ligament comes: the springs of that knee go to the front of the condyle, and at 97 N/mm they would pull with 1000 N at 137
/// degrees. Strands are straight and run through the condyle, so those are slack from 30 degrees on.
const STRUCTURES: [Structure; 5] = [
    Structure {
        name: "patellar_ligament_lateral",
        springs: &[&["PT1"], &["PT5"]],
        far: &[],
        stiffness: 173e3,
        strain: 0.02,
    },
    Structure {
        name: "patellar_ligament_central",
        springs: &[&["PT3"], &["PT3", "PT4"], &["PT4"]],
        far: &[],
        stiffness: 278e3,
        strain: 0.02,
    },
    Structure {
        name: "patellar_ligament_medial",
        springs: &[&["PT6"], &["PT2"]],
        far: &[],
        stiffness: 201e3,
        strain: 0.02,
    },
    Structure {
        name: "retinaculum_lateral",
        springs: &[&["lPFL1", "lPFL7", "lPFL5"], &["lPFL4", "lPFL3"], &["lPFL8", "lPFL6", "lPFL2"]],
        far: &["LCL1", "LCL2", "LCL3", "LCL4"],
        stiffness: 97e3,
        strain: 0.01,
    },
    Structure {
        name: "retinaculum_medial",
        springs: &[&["mPFL1", "mPFL5", "mPFL4"], &["mPFL3", "mPFL6", "mPFL2"]],
        far: &[],
        stiffness: 31e3,
        strain: 0.01,
    },
];

/// Why there is no such knee.
#[derive(Debug, Error)]
pub enum KneeError {
    /// The patella touches the femur wherever it is put.
    #[error(
        "the patella is in no groove: {} mm in front of its reference pose it still touches the femur; give a pose in which it lies in front of the trochlea",
        1e3 * FARTHEST
    )]
    NoGroove,
    /// A spring whose ends strands take is missing.
    #[error(
        "the model of the knee has no spring `{0}` between its bones; give its two ends, strands of the patella hold on there"
    )]
    NoSpring(&'static str),
    /// The scene cannot be.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

/// Tibia and patella against the femur where the strands have their reference strain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferencePose {
    /// The tibia.
    pub tibia: Coordinates,
    /// The patella.
    pub patella: Coordinates,
}

impl ReferencePose {
    /// As the bones are in the folder of the knee.
    pub fn of(anatomy: &KneeAnatomy) -> ReferencePose {
        let against = |bone| Coordinates::of(&(anatomy.frame(Bone::Femur).inverse() * anatomy.frame(bone)));
        ReferencePose { tibia: against(Bone::Tibia), patella: against(Bone::Patella) }
    }
}

/// A knee that is ready to be solved. The mesh is in the reference pose, the patella so far forward that it is off the femur.
pub struct RigidKnee {
    /// What is solved.
    pub plan: Plan,
    /// From the own frame of each bone into the mesh.
    femur: Isometry3<f64>,
    tibia: Isometry3<f64>,
    patella: Isometry3<f64>,
    /// Middle of the upper edge of the patella in its own frame \[m\].
    base: Point3<f64>,
    tendon: Tendon,
    /// How far forward the patella starts of its reference pose \[m\].
    pub lifted: f64,
    /// Names and slack lengths \[m\] of its strands.
    pub strands: Vec<(String, f64)>,
}

/// A mesh and a scene that grow together.
#[derive(Default)]
struct Draft {
    scene: Scene,
    mesh: Mesh,
}

impl Draft {
    fn surface(&mut self, name: &str, surface: &Surface, set: &str) {
        let first = self.mesh.points.len() as u32;
        self.mesh.points.extend(&surface.points);
        let triangles = surface.triangles.iter();
        self.mesh.surfaces.insert(
            name.to_string(),
            triangles.clone().map(|&[a, b, c]| [a, b, c, c].map(|n| n + first)).collect(),
        );
        let nodes = triangles.flatten().map(|n| n + first).collect();
        self.mesh.blocks.push(CellBlock { name: name.to_string(), kind: CellKind::Tri3, nodes });
        let set = self.mesh.node_sets.entry(set.to_string()).or_default();
        set.extend(first..self.mesh.points.len() as u32);
    }

    fn point(&mut self, at: Point3<f64>, set: &str) -> u32 {
        let node = self.mesh.points.len() as u32;
        self.mesh.points.push(at.into());
        self.mesh.node_sets.entry(set.to_string()).or_default().push(node);
        node
    }
}

impl Draft {
    fn strand(&mut self, name: &str, ends: [(Bone, Point3<f64>); 2], slack: f64, stiffness: f64) {
        let nodes = ends.map(|(bone, at)| self.point(at, set(bone))).to_vec();
        self.mesh.blocks.push(CellBlock { name: name.to_string(), kind: CellKind::Line2, nodes });
        let reference_strain = (ends[1].1 - ends[0].1).norm() / slack - 1.0;
        let region = name.to_string();
        self.scene.strands.push(StrandSpec { region, stiffness, toe: TOE, reference_strain });
    }
}

/// Set of the nodes of a bone.
fn set(bone: Bone) -> &'static str {
    match bone {
        Bone::Femur => "femur",
        Bone::Tibia => TIBIA,
        Bone::Patella => PATELLA,
    }
}

impl RigidKnee {
    /// Puts a knee together.
    pub fn new(
        anatomy: &KneeAnatomy,
        reference: &ReferencePose,
        mode: ContactMode,
    ) -> Result<RigidKnee, KneeError> {
        let femur = anatomy.frame(Bone::Femur);
        let [tibia, patella] = [reference.tibia, reference.patella].map(|c| femur * c.pose());
        let to_reference = |bone: Bone| match bone {
            Bone::Femur => Isometry3::identity(),
            Bone::Tibia => tibia * anatomy.frame(bone).inverse(),
            Bone::Patella => patella * anatomy.frame(bone).inverse(),
        };
        let sheets = [&anatomy.femoral_cartilage, &anatomy.patellar_cartilage].map(with_wall);
        let [femoral, patellar] = sheets;
        let patellar = moved(&patellar, &to_reference(Bone::Patella));
        let forward = femur.rotation * Vector3::x();
        let lifted = lift(&femoral, &patellar, forward).ok_or(KneeError::NoGroove)?;
        let lift = Translation3::from(forward * lifted);
        let mut draft = Draft::default();
        draft.surface(FEMORAL_CARTILAGE, &femoral, set(Bone::Femur));
        draft.surface(PATELLAR_CARTILAGE, &moved(&patellar, &lift.into()), PATELLA);
        let mut strands = Vec::new();
        for structure in &STRUCTURES {
            for (i, springs) in structure.springs.iter().enumerate() {
                let name = format!("{}_{}", structure.name, i + 1);
                let ends =
                    ends(anatomy, structure.far, springs)?.map(|(bone, at)| (bone, to_reference(bone) * at));
                let slack = (ends[1].1 - ends[0].1).norm() / (1.0 + structure.strain);
                let share = structure.stiffness / structure.springs.len() as f64;
                draft.strand(&name, [ends[0], (ends[1].0, lift * ends[1].1)], slack, share * slack);
                strands.push((name, slack));
            }
        }
        let base = anatomy.frame(Bone::Patella).inverse() * anatomy.base(BASE);
        let patella = lift * patella;
        let Draft { mut scene, mesh } = draft;
        let (nodes, components) = (set(Bone::Femur).to_string(), [true; 3]);
        scene.prescribed.push(PrescribedSpec { nodes, components, displacement: Vec::new(), control: None });
        scene.ties = [TIBIA, PATELLA].map(|b| TieSpec { nodes: b.to_string(), body: b.to_string() }).into();
        scene.free_bodies.push(FreeBodySpec::new(PATELLA));
        for (axis, control) in QUADRICEPS.into_iter().enumerate() {
            scene.body_forces.push(BodyForceSpec {
                name: control.to_string(),
                body: PATELLA.to_string(),
                point: (patella * base).into(),
                force: (femur.rotation * Vector3::ith(axis, 1.0)).into(),
                follows: false,
                control: control.to_string(),
            });
        }
        scene.contact = Some(contact(mode));
        let plan = Plan::new(&scene, mesh)?;
        let own: Vec<Point3<f64>> =
            anatomy.femoral_cartilage.points.iter().map(|p| femur.inverse() * Point3::from(*p)).collect();
        Ok(RigidKnee { plan, femur, tibia, patella, base, tendon: Tendon::new(own), lifted, strands })
    }

    /// The load with the tibia at a pose against the femur and a force \[N\] of the quadriceps, which pulls as it does with the patella at
    /// `patella`, a pose as a body.
    pub fn load(&self, tibia: &Coordinates, quadriceps: f64, patella: &Pose) -> Result<Load, SceneError> {
        let pose: Pose = self.femur * tibia.pose() * self.tibia.inverse();
        let base = self.femur.inverse() * patella * self.patella * self.base;
        let pull = quadriceps * self.tendon.direction(&base);
        let controls: [(&str, f64); 3] = std::array::from_fn(|axis| (QUADRICEPS[axis], pull[axis]));
        self.plan.load(&controls, &[(TIBIA, pose)])
    }

    /// The patella against the femur, given its pose as a body.
    pub fn coordinates(&self, patella: &Pose) -> Coordinates {
        Coordinates::of(&(self.femur.inverse() * patella * self.patella))
    }
}

fn moved(surface: &Surface, by: &Isometry3<f64>) -> Surface {
    let points = surface.points.iter().map(|p| (by * Point3::from(*p)).into()).collect();
    Surface { points, triangles: surface.triangles.clone() }
}

/// A sheet with a wall along its rim, down into the bone.
fn with_wall(sheet: &Surface) -> Surface {
    let mut normals = vec![Vector3::zeros(); sheet.points.len()];
    let mut sides = BTreeMap::<[u32; 2], usize>::new();
    for (t, corners) in sheet.triangles.iter().enumerate() {
        for k in 0..3 {
            let [a, b] = [corners[k], corners[(k + 1) % 3]];
            normals[a as usize] += sheet.area_vector(t);
            *sides.entry([a.min(b), a.max(b)]).or_default() += 1;
        }
    }
    let mut walled = sheet.clone();
    let mut below = BTreeMap::<u32, u32>::new();
    for corners in &sheet.triangles {
        for k in 0..3 {
            let [a, b] = [corners[k], corners[(k + 1) % 3]];
            if sides[&[a.min(b), a.max(b)]] == 2 {
                continue;
            }
            let [c, d] = [a, b].map(|n| {
                *below.entry(n).or_insert_with(|| {
                    let at = Vector3::from(sheet.points[n as usize]) - RIM * normals[n as usize].normalize();
                    walled.points.push(at.into());
                    walled.points.len() as u32 - 1
                })
            });
            walled.triangles.extend([[b, a, c], [b, c, d]]);
        }
    }
    walled
}

/// How far forward the patella has to go so that nothing touches \[m\].
fn lift(femoral: &Surface, patellar: &Surface, forward: Vector3<f64>) -> Option<f64> {
    let femur = SearchSurface::new(femoral.clone());
    let mut patella = SearchSurface::new(patellar.clone());
    (0..=(FARTHEST / STRIDE) as usize).map(|k| k as f64 * STRIDE).find(|by| {
        patella.set_points(&moved(patellar, &Translation3::from(forward * *by).into()).points);
        patella.least_gap(&femur).is_some_and(|gap| gap.closest.distance >= DISTANCE)
    })
}

/// Ends of a strand, that at the patella last: means of those of some springs.
fn ends(
    anatomy: &KneeAnatomy,
    far: &[&'static str],
    near: &[&'static str],
) -> Result<[(Bone, Point3<f64>); 2], KneeError> {
    let mean = |names: &[&'static str], of: &dyn Fn(Bone) -> bool| {
        let (mut bone, mut sum) = (Bone::Femur, Vector3::zeros());
        for name in names {
            let spring = anatomy.springs.iter().find(|s| s.name == *name);
            let end = spring.and_then(|s| s.ends.into_iter().find(|end| of(end.0)));
            let (on, at) = end.ok_or(KneeError::NoSpring(name))?;
            (bone, sum) = (on, sum + at.coords);
        }
        Ok::<_, KneeError>((bone, Point3::from(sum / names.len() as f64)))
    };
    let far = match far {
        [] => mean(near, &|bone| bone != Bone::Patella)?,
        _ => mean(far, &|bone| bone == Bone::Femur)?,
    };
    Ok([far, mean(near, &|bone| bone == Bone::Patella)?])
}

/// Cartilage as an elastic foundation: pressure over depth is (1 − ν) E / ((1 + ν) (1 − 2 ν) h).
fn contact(mode: ContactMode) -> ContactSpec {
    let [young, nu] = CARTILAGE;
    let modulus = (1.0 - nu) * young / ((1.0 + nu) * (1.0 - 2.0 * nu));
    let distance = if mode == ContactMode::Cheap { THICKNESS } else { DISTANCE };
    ContactSpec {
        mode,
        distance,
        stiffness: Some(modulus),
        ..ContactSpec::new(&[FEMORAL_CARTILAGE, PATELLAR_CARTILAGE])
    }
}
