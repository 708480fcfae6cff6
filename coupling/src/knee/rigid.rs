//! The patella in equilibrium on a rigid femur: cartilage on cartilage, ligament and retinacula as strands, quadriceps as a force.

use std::collections::BTreeMap;

use fem::body::Pose;
use fem::geometry::{SearchSurface, Surface};
use fem::mesh::{CellBlock, CellKind, Mesh};
use fem::plan::{Load, Plan, SceneError};
use fem::scene::{
    BodyForceSpec, ContactMode, ContactSpec, FreeBodySpec, PrescribedSpec, Scene, StrandSpec, TieSpec,
};
use nalgebra::{Isometry3, Point3, Vector3};

use super::anatomy::{Bone, KneeAnatomy};
use super::pose::Coordinates;

/// Name of the patella as a body.
pub const PATELLA: &str = "patella";
/// Name of the tibia as a body.
pub const TIBIA: &str = "tibia";
/// Surface of the femur that takes part in contact.
pub const FEMORAL_CARTILAGE: &str = "femoral_cartilage";
/// Surface of the patella that takes part in contact.
pub const PATELLAR_CARTILAGE: &str = "patellar_cartilage";
/// Control of the force of the quadriceps: its size \[N\].
pub const QUADRICEPS: &str = "quadriceps_n";

/// Thickness \[m\] of cartilage at its rim: there the sheet goes on down to the bone, or what comes over the rim would lose its support at once.
const RIM: f64 = 2.2e-3;
/// Half the strain at which the toe of a strand ends: linear from 0.06 on (the study of the deep knee).
const TOE: f64 = 0.03;
/// Young's modulus \[Pa\] and Poisson's ratio of cartilage: Smith, Brandon & Thelen, J Biomech 82:123 (2019), as the knee that the surfaces
/// are of.
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
/// Ends: means of those of the springs of the knee that the surfaces are of.
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

/// Middle of the four heads of the quadriceps \[m\] in the frame of the femur, with their shares of its force.
/// Middles: volumes of the surfaces of the muscles of the limb; shares: isometric forces of gait2392.
const HEADS: [([f64; 3], f64); 4] = [
    ([0.0390, 0.2856, 0.0637], 1169.0),
    ([0.0328, 0.1810, 0.0479], 1365.0),
    ([0.0114, 0.1880, 0.0686], 1871.0),
    ([0.0432, 0.1459, 0.0082], 1294.0),
];

/// A knee that is ready to be solved.
pub struct RigidKnee {
    /// What is solved.
    pub plan: Plan,
    /// From the own frame of each bone into the mesh.
    femur: Isometry3<f64>,
    tibia: Isometry3<f64>,
    patella: Isometry3<f64>,
    /// How far forward the patella starts of where it is in the folder \[m\].
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

/// Set of the nodes of a bone.
fn set(bone: Bone) -> &'static str {
    match bone {
        Bone::Femur => "femur",
        Bone::Tibia => TIBIA,
        Bone::Patella => PATELLA,
    }
}

impl RigidKnee {
    /// Puts a knee together. `None`: the patella is in no groove.
    pub fn new(anatomy: &KneeAnatomy, mode: ContactMode) -> Result<Option<RigidKnee>, SceneError> {
        let femur = anatomy.frame(Bone::Femur);
        let forward = femur.rotation * Vector3::x();
        let Some(lifted) = lift(anatomy, forward) else { return Ok(None) };
        let lift = forward * lifted;
        let moved = |surface: &Surface| Surface {
            points: surface.points.iter().map(|p| (Vector3::from(*p) + lift).into()).collect(),
            triangles: surface.triangles.clone(),
        };
        let mut draft = Draft::default();
        let patellar = moved(&anatomy.patellar_cartilage);
        draft.surface(FEMORAL_CARTILAGE, &with_wall(&anatomy.femoral_cartilage), set(Bone::Femur));
        draft.surface(PATELLAR_CARTILAGE, &with_wall(&patellar), PATELLA);
        let mut strands = Vec::new();
        for structure in &STRUCTURES {
            for (i, springs) in structure.springs.iter().enumerate() {
                let name = format!("{}_{}", structure.name, i + 1);
                let lateral = structure.name == "retinaculum_lateral";
                let far = if lateral && std::env::var_os("EPI").is_none() { &[][..] } else { structure.far };
                let ends = ends(anatomy, far, springs);
                let slack = (ends[1].1 - ends[0].1).norm() / (1.0 + structure.strain);
                let mut share = structure.stiffness / structure.springs.len() as f64;
                if lateral {
                    share *= std::env::var("KLAT").map_or(1.0, |k| k.parse::<f64>().unwrap() / 97.0);
                }
                add_strand(&mut draft, &name, ends, lift, slack, share * slack);
                strands.push((name, slack));
            }
        }
        let held = PrescribedSpec {
            nodes: set(Bone::Femur).to_string(),
            components: [true; 3],
            displacement: Vec::new(),
            control: None,
        };
        let Draft { mut scene, mesh } = draft;
        scene.prescribed.push(held);
        scene.ties = [TIBIA, PATELLA].map(|b| TieSpec { nodes: b.to_string(), body: b.to_string() }).into();
        scene.free_bodies.push(FreeBodySpec::new(PATELLA));
        let base = anatomy.base(BASE);
        scene.body_forces.push(BodyForceSpec {
            name: "quadriceps".to_string(),
            body: PATELLA.to_string(),
            point: (base + lift).into(),
            force: (femur.rotation * pull(&(femur.inverse() * base))).into(),
            follows: std::env::var_os("FOLLOW").is_some(),
            control: QUADRICEPS.to_string(),
        });
        scene.contact = Some(contact(mode));
        let plan = Plan::new(&scene, mesh)?;
        let [tibia, patella] = [Bone::Tibia, Bone::Patella].map(|b| anatomy.frame(b));
        let patella = nalgebra::Translation3::from(lift) * patella;
        Ok(Some(RigidKnee { plan, femur, tibia, patella, lifted, strands }))
    }

    /// The load with the tibia at a pose against the femur and a force of the quadriceps \[N\].
    pub fn load(&self, tibia: &Coordinates, quadriceps: f64) -> Result<Load, SceneError> {
        let pose: Pose = self.femur * tibia.pose() * self.tibia.inverse();
        self.plan.load(&[(QUADRICEPS, quadriceps)], &[(TIBIA, pose)])
    }

    /// The patella against the femur, given its pose as a body.
    pub fn coordinates(&self, patella: &Pose) -> Coordinates {
        Coordinates::of(&(self.femur.inverse() * patella * self.patella))
    }
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
fn lift(anatomy: &KneeAnatomy, forward: Vector3<f64>) -> Option<f64> {
    let femur = SearchSurface::new(with_wall(&anatomy.femoral_cartilage));
    let mut patella = SearchSurface::new(with_wall(&anatomy.patellar_cartilage));
    let first = patella.surface().points.clone();
    (0..=(FARTHEST / STRIDE) as usize).map(|k| k as f64 * STRIDE).find(|by| {
        let points: Vec<[f64; 3]> =
            first.iter().map(|p| (Vector3::from(*p) + forward * *by).into()).collect();
        patella.set_points(&points);
        patella.least_gap(&femur).is_some_and(|gap| gap.closest.distance >= DISTANCE)
    })
}

/// Ends of a strand, that at the patella last: means of those of some springs.
fn ends(anatomy: &KneeAnatomy, far: &[&str], near: &[&str]) -> [(Bone, Point3<f64>); 2] {
    let mean = |names: &[&str], of: &dyn Fn(Bone) -> bool| {
        let found: Vec<(Bone, Point3<f64>)> = names
            .iter()
            .filter_map(|name| anatomy.springs.iter().find(|s| s.name == *name))
            .filter_map(|s| s.ends.into_iter().find(|end| of(end.0)))
            .collect();
        let sum: Vector3<f64> = found.iter().map(|end| end.1.coords).sum();
        (found[0].0, Point3::from(sum / found.len() as f64))
    };
    let far = match far {
        [] => mean(near, &|bone| bone != Bone::Patella),
        _ => mean(far, &|bone| bone == Bone::Femur),
    };
    [far, mean(near, &|bone| bone == Bone::Patella)]
}

fn add_strand(
    draft: &mut Draft,
    name: &str,
    [(bone, far), (_, near)]: [(Bone, Point3<f64>); 2],
    lift: Vector3<f64>,
    slack: f64,
    stiffness: f64,
) {
    let near = near + lift;
    let nodes = vec![draft.point(far, set(bone)), draft.point(near, PATELLA)];
    draft.mesh.blocks.push(CellBlock { name: name.to_string(), kind: CellKind::Line2, nodes });
    let reference_strain = (near - far).norm() / slack - 1.0;
    draft.scene.strands.push(StrandSpec { region: name.to_string(), stiffness, toe: TOE, reference_strain });
}

/// Direction of the quadriceps from a point of the femur's frame, of length 1.
fn pull(from: &Point3<f64>) -> Vector3<f64> {
    let of = |(middle, share): &([f64; 3], f64)| (Point3::from(*middle) - from).normalize() * *share;
    HEADS.iter().map(of).sum::<Vector3<f64>>().normalize()
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
