//! The patella in equilibrium on a rigid femur: cartilage on cartilage, ligament as strands, retinacula and heads of the quadriceps as strings that
//! slide over the femur.

use std::sync::Arc;

use fem::body::Pose;
use fem::effect::obstacle::{Layer, Obstacle, Pressed, Sample};
use fem::effect::{Effect, State};
use fem::geometry::{DistanceField, SearchSurface, Surface, SurfaceError};
use fem::material::line::{LineLaw, Strand};
use fem::mesh::{CellBlock, CellKind, Mesh};
use fem::plan::{Builder, Load, Names, Plan, SceneError, Term};
use fem::scene::{ContactMode, FreeBodySpec, PrescribedSpec, Scene, StrandSpec, TieSpec};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use thiserror::Error;

use super::anatomy::{Bone, KneeAnatomy, moved};
use super::femur;
use super::level::level;
use super::muscles::{BellyPlace, MuscleError, Muscles, PatellaPlace, Resolution};
use super::pose::Coordinates;
use super::quadriceps::{HEADS, Head, Shaft};
use super::string::{Memory, Pull, Strings, TautString};

/// Name of the patella as a body.
pub const PATELLA: &str = "patella";
/// Name of the tibia as a body.
pub const TIBIA: &str = "tibia";
/// Surface of the patella that lies on the femur.
pub const PATELLAR_CARTILAGE: &str = "patellar_cartilage";
/// Control of the force of the quadriceps \[N\].
pub const QUADRICEPS: &str = "quadriceps_n";

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
/// It is in no groove where that takes more \[m\], nor that far in front of it: as deep as tibia and femur may overlap, which is both layers of
/// cartilage and a millimetre.
const FARTHEST: f64 = 5.2e-3;
/// Angle \[degrees\] of its lateral axis to that of the femur beyond which it is turned over: it points more to somewhere else.
const TURNED_OVER: f64 = 45.0;
/// Shift to either side \[mm\] beyond which the patella is out of its groove: half its width.
const OUT: f64 = 21.5;
/// Heights \[m\] above the origin of the femur between which it is shaft.
const SHAFT: [f64; 2] = [0.1, 0.3];

/// Strands of one structure.
struct Structure {
    name: &'static str,
    /// Per strand the springs of the model whose ends at the patella it takes, from lateral to medial (ligament) or from above (retinacula).
    springs: &'static [&'static [&'static str]],
    /// Springs whose ends at the other bone it takes; none: the other ends of those at the patella.
    far: &'static [&'static str],
    /// The other bone.
    bone: Bone,
    /// Of all its strands together \[N/m\].
    stiffness: f64,
    /// In the reference pose of the knee.
    strain: f64,
}

/// Stiffness and strain: the study of the deep knee, N/mm where it prints N/mm²; 7 strands of the ligament, 5 of the retinacula.
/// Ends: means of those of the springs of the knee that the surfaces are of. The lateral retinaculum goes to the lateral epicondyle, from where
/// the collateral ligament comes, as its band to the femur does (epicondylopatellar band; Merican & Amis, J Bone Joint Surg Br 90:527, 2008): the
/// springs of that knee go to the front of the condyle, and at 97 N/mm they would pull with 1000 N at 137 degrees.
const STRUCTURES: [Structure; 5] = [
    Structure {
        name: "patellar_ligament_lateral",
        springs: &[&["PT1"], &["PT5"]],
        far: &[],
        bone: Bone::Tibia,
        stiffness: 173e3,
        strain: 0.02,
    },
    Structure {
        name: "patellar_ligament_central",
        springs: &[&["PT3"], &["PT3", "PT4"], &["PT4"]],
        far: &[],
        bone: Bone::Tibia,
        stiffness: 278e3,
        strain: 0.02,
    },
    Structure {
        name: "patellar_ligament_medial",
        springs: &[&["PT6"], &["PT2"]],
        far: &[],
        bone: Bone::Tibia,
        stiffness: 201e3,
        strain: 0.02,
    },
    Structure {
        name: "retinaculum_lateral",
        springs: &[&["lPFL1", "lPFL7", "lPFL5"], &["lPFL4", "lPFL3"], &["lPFL8", "lPFL6", "lPFL2"]],
        far: &["LCL1", "LCL2", "LCL3", "LCL4"],
        bone: Bone::Femur,
        stiffness: 97e3,
        strain: 0.01,
    },
    Structure {
        name: "retinaculum_medial",
        springs: &[&["mPFL1", "mPFL5", "mPFL4"], &["mPFL3", "mPFL6", "mPFL2"]],
        far: &[],
        bone: Bone::Femur,
        stiffness: 31e3,
        strain: 0.01,
    },
];

/// Why there is no such knee.
#[derive(Debug, Error)]
pub enum KneeError {
    /// All that is wrong with what it is put together from.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Several(Vec<KneeError>),
    /// The patella is elsewhere in its reference pose.
    #[error(
        "the patella is in no groove in its reference pose: {0}; give a pose in which it lies in front of the trochlea"
    )]
    NoGroove(String),
    /// Springs whose ends strands take are missing.
    #[error(
        "no spring {} from the bones that it belongs to; give the two ends of each, strands of the patella hold on there",
        .0.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
    )]
    NoSprings(Vec<&'static str>),
    /// The femur has no shaft that tells where upward is.
    #[error(
        "the femur has no shaft {} to {} mm above the origin of its knee, along which the quadriceps lies; give a bone that goes so far up",
        1e3 * SHAFT[0], 1e3 * SHAFT[1]
    )]
    NoShaft,
    /// A string finds no way.
    #[error("`{0}` finds no way over the femur; give it ends outside of the bone")]
    NoWay(String),
    /// The bone of the femur is no closed surface.
    #[error("femur: {0}; of a folder it is bones/femur_r.stl beside the knee")]
    Surface(#[from] SurfaceError),
    /// The muscles cannot be meshed.
    #[error(transparent)]
    Muscles(#[from] MuscleError),
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

/// A knee that is ready to be solved. The mesh is in the frame of the femur and in the reference pose, the patella so far forward that it is off
/// the femur.
pub struct RigidKnee {
    /// What is solved.
    pub plan: Plan,
    /// Its muscles, where they are tissue.
    pub muscles: Option<Muscles>,
    /// Distance to the femur in its frame.
    pub femur: Arc<DistanceField>,
    /// Pose of the tibia that the strands are made for.
    pub reference: Coordinates,
    tibia: Isometry3<f64>,
    patella: Isometry3<f64>,
    /// How far forward the patella starts of its reference pose \[m\].
    pub lifted: f64,
    /// Names of its strands: of the ligament, of the retinacula, and the heads of the quadriceps.
    pub strands: Vec<String>,
    ligament: Vec<([u32; 2], Strand, f64)>,
    strings: Strings,
    cartilage: Obstacle<4>,
}

/// How a strand is at some state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrandState {
    /// Over its slack length; 0 where the tension is given.
    pub strain: f64,
    /// Tension \[N\].
    pub tension: f64,
}

/// The quadriceps.
#[derive(Clone, Copy, Debug)]
pub enum Quadriceps<'a> {
    /// Strings of given tension.
    Forces(&'a [Head]),
    /// Passive tissue.
    Tissue(Resolution),
}

/// A mesh and a scene that grow together.
#[derive(Default)]
struct Draft {
    scene: Scene,
    mesh: Mesh,
    names: Vec<String>,
    ligament: Vec<([u32; 2], Strand, f64)>,
    strings: Vec<StringEnd>,
}

/// A string with the node that it ends at, and its memory: at first of its way as the mesh has it.
#[derive(Clone)]
struct StringEnd {
    node: u32,
    string: TautString,
    pull: StringPull,
    memory: Memory,
}

/// What pulls in a string, before controls have numbers.
#[derive(Clone, Copy)]
enum StringPull {
    Elastic(Strand, f64),
    Share(f64),
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

    fn point(&mut self, at: Point3<f64>, set: Option<&str>) -> u32 {
        let node = self.mesh.points.len() as u32;
        self.mesh.points.push(at.into());
        if let Some(set) = set {
            self.mesh.node_sets.entry(set.to_string()).or_default().push(node);
        }
        node
    }

    /// The quadriceps as tissue.
    fn muscles(
        &mut self,
        femur: (Arc<DistanceField>, SearchSurface),
        bellies: BellyPlace,
        patella: &PatellaPlace,
        resolution: Resolution,
    ) -> Result<Muscles, MuscleError> {
        let muscles = Muscles::add(&mut self.mesh, &mut self.scene, femur, bellies, patella, resolution)?;
        for (bone, nodes) in [(Bone::Femur, &muscles.held), (Bone::Patella, &muscles.on_patella)] {
            self.mesh.node_sets.entry(set(bone).to_string()).or_default().extend(nodes);
        }
        Ok(muscles)
    }

    /// A straight strand that has a strain in the reference pose, from where the patella has gone by `lift`.
    fn strand(&mut self, name: &str, ends: [End; 2], lift: &Translation3<f64>, structure: &Structure) {
        let slack = (ends[1].1 - ends[0].1).norm() / (1.0 + structure.strain);
        let law = Strand { stiffness: structure.each() * slack, toe: TOE };
        let places = [ends[0].1, lift * ends[1].1];
        let reference_strain = (places[1] - places[0]).norm() / slack - 1.0;
        let nodes: [u32; 2] = std::array::from_fn(|e| self.point(places[e], Some(set(ends[e].0))));
        self.mesh.blocks.push(CellBlock {
            name: name.to_string(),
            kind: CellKind::Line2,
            nodes: nodes.to_vec(),
        });
        let (region, stiffness, toe) = (name.to_string(), law.stiffness, law.toe);
        self.scene.strands.push(StrandSpec { region, stiffness, toe, reference_strain });
        self.ligament.push((nodes, law, slack));
        self.names.push(name.to_string());
    }

    /// A string to the patella, from where that has gone.
    fn string(
        &mut self,
        name: &str,
        string: TautString,
        to: Point3<f64>,
        pull: StringPull,
    ) -> Result<(), KneeError> {
        let way = string.way(&to, None);
        if !way.length.is_finite() {
            return Err(KneeError::NoWay(name.into()));
        }
        let node = self.point(to, Some(PATELLA));
        let from = self.point(way.places[0], Some(set(Bone::Femur)));
        // For the eye; its way is no part of the mesh.
        self.mesh.blocks.push(CellBlock {
            name: name.into(),
            kind: CellKind::Line2,
            nodes: vec![from, node],
        });
        self.strings.push(StringEnd { node, string, pull, memory: Memory::new(way) });
        self.names.push(name.to_string());
        Ok(())
    }
}

/// A bone and a place on it \[m\] in the frame of the femur.
type End = (Bone, Point3<f64>);

impl Structure {
    /// Stiffness \[N/m\] of one of its strands.
    fn each(&self) -> f64 {
        self.stiffness / self.springs.len() as f64
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
        RigidKnee::with_quadriceps(anatomy, reference, mode, Quadriceps::Forces(&HEADS))
    }

    /// The same with other heads of the quadriceps, or with its muscles.
    pub fn with_quadriceps(
        anatomy: &KneeAnatomy,
        reference: &ReferencePose,
        mode: ContactMode,
        quadriceps: Quadriceps,
    ) -> Result<RigidKnee, KneeError> {
        let [tibia, patella] = [reference.tibia, reference.patella].map(|c| c.pose());
        let own = |bone: Bone| anatomy.frame(bone).inverse();
        // From the frame of the surfaces into that of the femur, in the reference pose.
        let to_reference = |bone: Bone| match bone {
            Bone::Femur => own(bone),
            Bone::Tibia => tibia * own(bone),
            Bone::Patella => patella * own(bone),
        };
        let of_femur = |surface| anatomy.placed(surface, Bone::Femur, &Isometry3::identity());
        let [bone, sheet] = [&anatomy.femur, &anatomy.femoral_cartilage].map(of_femur);
        let field = Arc::new(match quadriceps {
            Quadriceps::Forces(_) => femur::field(anatomy)?,
            Quadriceps::Tissue(_) => femur::whole(anatomy)?,
        });
        let solid = match mode {
            ContactMode::Cheap => field.clone(),
            // What samples of the patella stay off encloses the triangles of the femur.
            ContactMode::Guarded => Arc::new(field.raised(femur::below(&field, &sheet))),
        };
        let patellar = anatomy.placed(&anatomy.patellar_cartilage, Bone::Patella, &patella);
        let mut wrong = Vec::new();
        let missing = missing_springs(anatomy);
        if !missing.is_empty() {
            wrong.push(KneeError::NoSprings(missing));
        }
        let lifted =
            lifted(&solid, &patellar, &reference.patella).map_err(|why| wrong.push(KneeError::NoGroove(why)));
        let shaft = Shaft::of(&bone.points, SHAFT);
        if shaft.is_none() {
            wrong.push(KneeError::NoShaft);
        }
        let (Ok(lifted), Some(shaft), true) = (lifted, shaft, wrong.is_empty()) else {
            return Err(KneeError::Several(wrong));
        };
        let lift = Translation3::new(lifted, 0.0, 0.0);
        let mut draft = Draft::default();
        let patellar = moved(&patellar, &lift.into());
        draft.surface(PATELLAR_CARTILAGE, &patellar, PATELLA);
        for structure in &STRUCTURES {
            for (i, springs) in structure.springs.iter().enumerate() {
                let name = format!("{}_{}", structure.name, i + 1);
                let ends =
                    ends(anatomy, structure, springs).map(|(bone, at)| (bone, to_reference(bone) * at));
                if ends[0].0 != Bone::Femur {
                    draft.strand(&name, ends, &lift, structure);
                    continue;
                }
                let [from, to] = ends.map(|end| end.1);
                let string = TautString::new(field.clone(), from);
                let slack = string.way(&to, None).length / (1.0 + structure.strain);
                if !slack.is_finite() {
                    return Err(KneeError::NoWay(name));
                }
                let law = Strand { stiffness: structure.each() * slack, toe: TOE };
                draft.string(&name, string, lift * to, StringPull::Elastic(law, slack))?;
            }
        }
        let muscles = match quadriceps {
            Quadriceps::Forces(heads) => {
                let bounds = anatomy.patella_half_axes();
                for head in heads {
                    let [lateral, up] = head.insertion;
                    let at = patella * Point3::new(bounds[0], up * bounds[1], lateral * bounds[2]);
                    let string = TautString::new(field.clone(), head.origin(&at, &shaft.direction));
                    draft.string(head.name, string, lift * at, StringPull::Share(head.share))?;
                }
                None
            }
            Quadriceps::Tissue(resolution) => {
                let top = anatomy.patella.points.iter().map(|p| p[1]).fold(f64::MIN, f64::max);
                let height = anatomy.patella_half_axes()[1];
                let place = PatellaPlace { pose: lift * patella, height, top };
                let triangles = SearchSurface::new(level(&field, 0.0, field.spacing()).with(&sheet));
                Some(draft.muscles(
                    (solid.clone(), triangles),
                    BellyPlace { to_femur: &own(Bone::Femur), shaft: &shaft, fit: anatomy.fit },
                    &place,
                    resolution,
                )?)
            }
        };
        let Draft { mut scene, mesh, names: strands, ligament, strings } = draft;
        let (nodes, components) = (set(Bone::Femur).to_string(), [true; 3]);
        scene.prescribed.push(PrescribedSpec { nodes, components, displacement: Vec::new(), control: None });
        scene.ties = [TIBIA, PATELLA].map(|b| TieSpec { nodes: b.to_string(), body: b.to_string() }).into();
        scene.free_bodies.push(FreeBodySpec::new(PATELLA));
        let own = |mesh: &Mesh, names: &mut Names| {
            let control = names.control(QUADRICEPS);
            let on_femur = muscles.as_ref().map(Muscles::term);
            let cartilage = resting_patella(mesh, &solid, &patellar, layer(mode));
            Ok([cartilage, pulling_strings(&strings, control)].into_iter().chain(on_femur).collect())
        };
        let plan = Plan::with_terms(&scene, mesh, &own)?;
        let frame = plan.free_bodies[0].frame;
        let samples = samples(&plan.mesh, frame, &patellar, layer(mode));
        let cartilage = Obstacle::new("cartilage", solid, &[frame], vec![samples]);
        let control = plan.controls.iter().position(|c| c == QUADRICEPS).expect("named by the strings");
        let nodes: Vec<[u32; 1]> = strings.iter().map(|s| [s.node]).collect();
        let strings = built("strings", &nodes, &strings, control);
        Ok(RigidKnee {
            plan,
            muscles,
            femur: field.clone(),
            reference: reference.tibia,
            tibia,
            patella: lift * patella,
            lifted,
            strands,
            ligament,
            strings,
            cartilage,
        })
    }

    /// The load with the tibia at a pose against the femur and a force \[N\] of the quadriceps.
    pub fn load(&self, tibia: &Coordinates, quadriceps: f64) -> Result<Load, SceneError> {
        let pose: Pose = tibia.pose() * self.tibia.inverse();
        self.plan.load(&[(QUADRICEPS, quadriceps)], &[(TIBIA, pose)])
    }

    /// The patella against the femur, given its pose as a body.
    pub fn coordinates(&self, patella: &Pose) -> Coordinates {
        Coordinates::of(&(patella * self.patella))
    }

    /// What the cartilage of the patella bears, with the nodes at `x` \[m\], 3 per node.
    pub fn pressed(&self, x: &[f64]) -> Pressed {
        self.cartilage.pressed(x)
    }

    /// How its strands are, in their order, with the nodes at `x` \[m\], 3 per node.
    pub fn strand_states(&self, x: &[f64], controls: &[f64]) -> Vec<StrandState> {
        let place = |n: u32| Vector3::from_column_slice(&x[3 * n as usize..][..3]);
        let straight = self.ligament.iter().map(|(nodes, law, slack)| {
            let stretch = (place(nodes[1]) - place(nodes[0])).norm() / slack;
            StrandState { strain: stretch - 1.0, tension: LineLaw::Strand(*law).response(stretch, 0.0).force }
        });
        let state = State { x, controls };
        let n = self.strands.len() - self.ligament.len();
        let sliding = (0..n).map(|group| {
            let (stretch, tension) = self.strings.line_state(&state, group).expect("a string");
            StrandState { strain: stretch - 1.0, tension }
        });
        straight.chain(sliding).collect()
    }

    /// Lets strings forget the ways of trials: the nodes at `x` \[m\], 3 per node, are in equilibrium.
    pub fn settle(&self, x: &[f64]) {
        self.strings.settle(x);
    }

    /// Whether some of the cartilage of the patella is beside the knee of the femur, with the nodes at `x` \[m\], 3 per node.
    pub fn is_beside_femur(&self, x: &[f64]) -> bool {
        let nodes = self.plan.mesh.surfaces[PATELLAR_CARTILAGE].iter().flatten();
        let mut places = nodes.map(|n| Vector3::from_column_slice(&x[3 * *n as usize..][..3]));
        places.any(|place| femur::is_at_knee(&place))
    }

    /// Where every strand goes with the nodes at `x` \[m\], in the order of [`RigidKnee::strands`].
    pub fn ways(&self, x: &[f64]) -> Vec<Vec<Point3<f64>>> {
        let place = |n: u32| Point3::from(Vector3::from_column_slice(&x[3 * n as usize..][..3]));
        let straight = self.ligament.iter().map(|(nodes, ..)| nodes.iter().map(|&n| place(n)).collect());
        let n = self.strands.len() - self.ligament.len();
        straight.chain((0..n).map(|e| self.strings.way(e, x).places.to_vec())).collect()
    }
}

/// Strings that end at `nodes`, with the number of the control of the quadriceps.
fn built(name: &str, nodes: &[[u32; 1]], strings: &[StringEnd], control: usize) -> Strings {
    let pull = |pull: StringPull| match pull {
        StringPull::Elastic(law, slack) => Pull::Elastic(law, slack),
        StringPull::Share(share) => Pull::Tension(control, share),
    };
    let with_pulls = strings.iter().map(|s| (s.string.clone(), pull(s.pull))).collect();
    Strings::new(name, nodes, with_pulls, strings.iter().map(|s| s.memory.clone()).collect())
}

fn pulling_strings(strings: &[StringEnd], control: usize) -> Term {
    let nodes = strings.iter().map(|s| s.node).collect();
    let strings = strings.to_vec();
    let build: Builder = Box::new(move |name, _, nodes, groups| {
        let nodes: Vec<[u32; 1]> = nodes.iter().map(|n| [*n]).collect();
        let strings: Vec<StringEnd> = groups.iter().map(|g| strings[*g as usize].clone()).collect();
        Ok(Box::new(built(name, &nodes, &strings, control)) as Box<dyn Effect>)
    });
    Term { name: "strings".into(), nodes_per_group: 1, nodes, couples: true, build }
}

/// The cartilage of the patella on the femur.
fn resting_patella(mesh: &Mesh, field: &Arc<DistanceField>, patellar: &Surface, layer: Layer) -> Term {
    let frame = &mesh.blocks.last().expect("the frame of the patella").nodes;
    let frame: [u32; 4] = frame.as_slice().try_into().expect("four nodes of a frame");
    let samples = samples(mesh, frame, patellar, layer);
    let field = field.clone();
    let build: Builder = Box::new(move |name, _, nodes, _| {
        let frame: [u32; 4] = nodes.try_into().expect("the frame of one body");
        let obstacle = Obstacle::new(name, field.clone(), &[frame], vec![samples.clone()]);
        Ok(Box::new(obstacle) as Box<dyn Effect>)
    });
    Term { name: "cartilage".into(), nodes_per_group: 4, nodes: frame.to_vec(), couples: true, build }
}

/// Points of a surface as fixed means of a frame, each with a third of the triangles around it.
fn samples(mesh: &Mesh, frame: [u32; 4], surface: &Surface, layer: Layer) -> Vec<Sample<4>> {
    let [o, x, ..] = frame.map(|n| Vector3::from(mesh.points[n as usize]));
    let size = (x - o).norm();
    let mut areas = vec![0.0; surface.points.len()];
    for (t, corners) in surface.triangles.iter().enumerate() {
        corners.iter().for_each(|c| areas[*c as usize] += surface.area_vector(t).norm() / 3.0);
    }
    let sample = |(p, area): (&[f64; 3], f64)| {
        let a = (Vector3::from(*p) - o) / size;
        Sample { weights: [1.0 - a.sum(), a.x, a.y, a.z], area, layer }
    };
    surface.points.iter().zip(areas).map(sample).collect()
}

/// Why a patella at a place against the femur is in no groove, by its place and its axes alone: too far aside, turned over, or with its back, where its
/// cartilage is, turned away from the middle of the femur.
pub(super) fn out_of_groove(patella: &Coordinates) -> Option<String> {
    let aside = patella.place[2];
    if aside.abs() > OUT {
        return Some(format!(
            "it is {aside:.1} mm to lateral of the middle of the femur, at most {OUT} either way"
        ));
    }
    let pose = patella.pose();
    let turned = (pose * Vector3::z()).angle(&Vector3::z()).to_degrees();
    if turned > TURNED_OVER {
        return Some(format!(
            "its lateral axis is {turned:.1} degrees off that of the femur, at most {TURNED_OVER}"
        ));
    }
    let looks_at_femur = (pose * Vector3::x()).dot(&pose.translation.vector) > 0.0;
    (!looks_at_femur).then(|| "its cartilage looks away from the femur".to_string())
}

/// How far forward the patella has to go from its reference pose so that nothing touches \[m\]; why it is in no groove there.
fn lifted(femur: &DistanceField, patellar: &Surface, reference: &Coordinates) -> Result<f64, String> {
    if let Some(why) = out_of_groove(reference) {
        return Err(why);
    }
    let gaps = patellar.points.iter().filter_map(|p| Some(femur.at(&Vector3::from(*p))?.distance));
    let gap = gaps.fold(f64::INFINITY, f64::min);
    if gap > FARTHEST {
        return Err(match gap.is_finite() {
            true => {
                format!("its cartilage is {:.1} mm off the femur, at most {} mm", 1e3 * gap, 1e3 * FARTHEST)
            }
            false => "it is not beside the knee of the femur".to_string(),
        });
    }
    let is_off = |p: &Vector3<f64>| femur.near(p, DISTANCE).is_none_or(|at| at.distance >= DISTANCE);
    let mut steps = (0..=(FARTHEST / STRIDE) as usize).map(|k| k as f64 * STRIDE);
    let far_enough =
        steps.find(|by| patellar.points.iter().all(|p| is_off(&(Vector3::from(*p) + *by * Vector3::x()))));
    far_enough.ok_or_else(|| format!("{} mm in front of it, it still touches the femur", 1e3 * FARTHEST))
}

/// Springs that structures take ends of and that are not there, or not on the bones.
fn missing_springs(anatomy: &KneeAnatomy) -> Vec<&'static str> {
    let has = |name: &str, of: &dyn Fn(Bone) -> bool| {
        anatomy.springs.iter().any(|s| s.name == name && s.ends.iter().any(|end| of(end.0)))
    };
    let mut missing = Vec::new();
    for structure in &STRUCTURES {
        let near = structure.springs.iter().copied().flatten();
        let is_far = |bone| bone == structure.bone;
        missing.extend(near.clone().filter(|name| !has(name, &|bone| bone == Bone::Patella)));
        match structure.far {
            [] => missing.extend(near.filter(|name| !has(name, &is_far))),
            far => missing.extend(far.iter().filter(|name| !has(name, &is_far))),
        }
    }
    missing.sort_unstable();
    missing.dedup();
    missing
}

/// Ends of a strand, that at the patella last: means of those of some springs, none of which is [missing](missing_springs).
fn ends(anatomy: &KneeAnatomy, structure: &Structure, near: &[&str]) -> [(Bone, Point3<f64>); 2] {
    let mean = |names: &[&str], of: &dyn Fn(Bone) -> bool| {
        let named = names.iter().flat_map(|name| anatomy.springs.iter().find(|s| s.name == *name));
        let ends: Vec<_> = named.filter_map(|s| s.ends.into_iter().find(|end| of(end.0))).collect();
        let sum: Vector3<f64> = ends.iter().map(|end| end.1.coords).sum();
        (ends[0].0, Point3::from(sum / ends.len() as f64))
    };
    let far = if structure.far.is_empty() { near } else { structure.far };
    [mean(far, &|bone| bone == structure.bone), mean(near, &|bone| bone == Bone::Patella)]
}

/// Cartilage as an elastic foundation: pressure over depth is (1 − ν) E / ((1 + ν) (1 − 2 ν) h).
fn layer(mode: ContactMode) -> Layer {
    let [young, nu] = CARTILAGE;
    let modulus = (1.0 - nu) * young / ((1.0 + nu) * (1.0 - 2.0 * nu));
    match mode {
        ContactMode::Cheap => Layer::Foundation { stiffness: modulus / THICKNESS },
        ContactMode::Guarded => Layer::Barrier { modulus, distance: DISTANCE },
    }
}
