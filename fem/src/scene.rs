//! What a person writes down: which regions of a mesh are what, what holds and what drives them.
//!
//! Everything here can be read from TOML; a misspelt key is an error. Units: m, N, Pa, kg/m³. Nothing is simulated
//! that the scene does not name.
//!
//! Quantities that change in time are *controls*: names (an activation, a pressure, a load factor) whose values a
//! [`crate::run::Drive`] gives. Bones are *bodies*: names whose poses the drive gives, relative to the mesh.

mod user_law;

pub use user_law::UserLaw;

use crate::element::Formulation;
use crate::material::line::FibreStrain;
use crate::mesh::LengthUnit;
use crate::solve::{Method, Settings, Stability};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A scene.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Scene {
    /// Mesh file, relative to the scene; absent where the mesh comes from the program.
    pub mesh: Option<PathBuf>,
    /// What a length of 1 in the mesh file means: `m` (default) or `mm`.
    pub mesh_unit: LengthUnit,
    /// Table of the drive ([`crate::drive`]), relative to the scene; absent where the drive comes from the program.
    pub drive: Option<PathBuf>,
    /// When a frame counts as solved, and how far apart frames are.
    pub solver: SolverSpec,
    /// Cuts whose section forces are tabulated.
    pub cuts: Vec<CutSpec>,
    /// Solid regions.
    pub solids: Vec<SolidSpec>,
    /// Fibres: segments that carry axial force and can be activated.
    pub fibres: Vec<FibreSpec>,
    /// Membranes.
    pub membranes: Vec<MembraneSpec>,
    /// Ligament strands.
    pub strands: Vec<StrandSpec>,
    /// Gravity; absent: weightless.
    pub gravity: Option<GravitySpec>,
    /// Inertia; absent: every frame is an equilibrium.
    pub inertia: Option<InertiaSpec>,
    /// Follower pressures.
    pub pressures: Vec<PressureSpec>,
    /// Follower pressures on patches whose rims move freely.
    pub patch_pressures: Vec<PatchPressureSpec>,
    /// Dead nodal forces.
    pub forces: Vec<ForceSpec>,
    /// Prescribed displacements, rollers among them.
    pub prescribed: Vec<PrescribedSpec>,
    /// Rollers on planes of any direction.
    pub rollers: Vec<RollerSpec>,
    /// Nodes tied to rigid bodies whose poses the drive prescribes, or the solver finds.
    pub ties: Vec<TieSpec>,
    /// Bodies of `ties` whose poses the solver finds.
    pub free_bodies: Vec<FreeBodySpec>,
    /// Forces on free bodies.
    pub body_forces: Vec<BodyForceSpec>,
    /// Solid regions whose nodes are means of those of a coarse grid of cubes.
    pub embedded: Vec<EmbeddedSpec>,
    /// Sets of nodes that move as one plane.
    pub planes: Vec<PlaneSpec>,
    /// Contact between surfaces; absent: they do not see each other.
    pub contact: Option<ContactSpec>,
}

/// When a frame counts as solved, and how far apart frames are.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct SolverSpec {
    /// Wanted residual relative to the forces in play, above 0 and below 1.
    pub tolerance: f64,
    /// Forces in play \[N\] are taken to be at least this.
    pub least_force: f64,
    /// Which solver.
    pub method: Method,
    /// Time steps that a frame may take per island where there are no matrices, at least 1.
    pub max_steps: usize,
    /// Explicit dynamics: time step over the longest that the masses bear, at least 1; above 1 masses are added where it takes them.
    pub time_step_factor: f64,
    /// Explicit dynamics: rate at which velocities fade \[1/s\].
    pub damping: f64,
    /// Frames between the rows of the drive so that none is more than this after the one before \[s\]; absent: none.
    pub longest_step: Option<f64>,
    /// Every state is shown to be a minimum of the potential, and left where it is none; otherwise only where it is doubtful.
    pub check_stability: bool,
}

impl Default for SolverSpec {
    fn default() -> SolverSpec {
        let Settings { tolerance, least_force, method, max_steps, time_step_factor, damping, .. } =
            Settings::default();
        SolverSpec {
            tolerance,
            least_force,
            method,
            max_steps,
            time_step_factor,
            damping,
            longest_step: None,
            check_stability: false,
        }
    }
}

impl SolverSpec {
    /// The settings of the solver that it stands for.
    pub fn settings(&self) -> Settings {
        let stability = if self.check_stability { Stability::Always } else { Stability::default() };
        Settings {
            tolerance: self.tolerance,
            least_force: self.least_force,
            method: self.method,
            max_steps: self.max_steps,
            time_step_factor: self.time_step_factor,
            damping: self.damping,
            stability,
            ..Settings::default()
        }
    }
}

/// A plane cut whose section force is tabulated; see [`crate::measure::section_force`].
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct CutSpec {
    /// Name, as reported.
    pub name: String,
    /// A point of the plane in the mesh \[m\].
    pub point: [f64; 3],
    /// Its normal in the mesh: force along it is positive in tension.
    pub normal: [f64; 3],
    /// Regions and fibres that it cuts; empty: all.
    #[serde(default)]
    pub effects: Vec<String>,
}

/// A solid region.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SolidSpec {
    /// Block of cells in the mesh.
    pub region: String,
    /// Law.
    pub law: LawSpec,
    /// `mean_dilatation` (default of hexahedra) or `plain` (default of tetrahedra and wedges).
    #[serde(default)]
    pub formulation: Option<FormulationSpec>,
    /// Density \[kg/m³\], for gravity and inertia.
    #[serde(default = "soft_tissue_density")]
    pub density: f64,
    /// Factor on the energy density of each cell (tissue that passes into tendon, say), one per cell; empty: 1 everywhere.
    /// Active stress is multiplied too, weight is not.
    #[serde(default)]
    pub scale: Vec<f64>,
}

impl SolidSpec {
    /// A region with everything else at its default.
    pub fn new(region: &str, law: impl Into<LawSpec>) -> SolidSpec {
        let (region, density) = (region.to_string(), soft_tissue_density());
        SolidSpec { region, law: law.into(), formulation: None, density, scale: Vec::new() }
    }
}

fn soft_tissue_density() -> f64 {
    1060.0
}

/// Name of a [`Formulation`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FormulationSpec {
    /// [`Formulation::Plain`].
    Plain,
    /// [`Formulation::MeanDilatation`].
    MeanDilatation,
}

impl From<FormulationSpec> for Formulation {
    fn from(spec: FormulationSpec) -> Formulation {
        match spec {
            FormulationSpec::Plain => Formulation::Plain,
            FormulationSpec::MeanDilatation => Formulation::MeanDilatation,
        }
    }
}

/// A solid law and its constants; see [`crate::material`].
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
#[allow(missing_docs)] // the constants are documented at the laws
pub enum LawSpec {
    NeoHookean {
        young: f64,
        nu: f64,
    },
    NeoHookeanUncoupled {
        mu: f64,
        bulk: f64,
    },
    MooneyRivlin {
        c10: f64,
        c01: f64,
        bulk: f64,
    },
    MooneyRivlinDyna {
        a: f64,
        b: f64,
        nu: f64,
    },
    StableNeoHookean {
        young: f64,
        nu: f64,
    },
    StVenantKirchhoff {
        young: f64,
        nu: f64,
    },
    LinearElastic {
        young: f64,
        nu: f64,
    },
    /// No tissue: what gives folded cells a shape. In no file.
    #[serde(skip)]
    FoldoverFree {
        epsilon: f64,
    },
    /// Blemker's muscle with its published curves.
    Blemker {
        g1: f64,
        g2: f64,
        bulk: f64,
        sigma_max: f64,
        lambda_ofl: f64,
        fibres: FibreDirection,
        /// Control that holds the activation; absent: passive.
        activation: Option<String>,
    },
    /// A law of a user's own; see [`LawSpec::user`].
    User(UserLaw),
}

/// Where the fibre direction of a solid comes from.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FibreDirection {
    /// The same everywhere; normalised.
    Uniform([f64; 3]),
    /// Parametric axis 0, 1 or 2 of each hexahedron at its centre.
    CellAxis(usize),
    /// One per cell; normalised.
    PerCell(Vec<[f64; 3]>),
}

/// Fibres.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FibreSpec {
    /// Name, as reported.
    pub name: String,
    /// Where they run.
    pub course: Course,
    /// Law.
    pub law: FibreLawSpec,
    /// Cross-section \[m²\]: one for all, or one per line of two nodes (per polyline where embedded).
    pub area: Vec<f64>,
    /// Control that holds the activation; absent: passive.
    #[serde(default)]
    pub activation: Option<String>,
}

/// Where fibres run.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Course {
    /// Along a block of two-node lines of the mesh.
    Region(String),
    /// Along polylines through solid regions: reference points \[m\], tied to the cells in which they lie.
    Embedded(Vec<Vec<[f64; 3]>>),
}

/// A fibre law and its constants; see [`crate::material::line`].
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum FibreLawSpec {
    /// [`crate::material::line::ThermalFibre`].
    Thermal {
        /// Young's modulus \[Pa\].
        young: f64,
        /// Contraction strain at full activation.
        contraction: f64,
        /// Strain measure.
        strain: FibreStrain,
        /// Strain over which tension sets in; absent: the fibre resists compression too.
        #[serde(default)]
        toe: Option<f64>,
    },
    /// [`crate::material::line::HillFibre`].
    Hill {
        /// Greatest active stress \[Pa\].
        sigma_max: f64,
        /// Stretch at which the fibre has its optimal length.
        lambda_opt: f64,
    },
    /// [`crate::material::force_length::ForceLength`], for fibres along mesh edges: lines of the region that follow each other (the
    /// second node of one is the first of the next) are one fibre with one tension.
    ForceLength {
        /// Stretches of the samples, increasing.
        stretch: Vec<f64>,
        /// Activations of the samples, increasing.
        activation: Vec<f64>,
        /// Stress \[Pa\], not negative: a row per activation, a column per stretch.
        stress: Vec<Vec<f64>>,
    },
}

/// A membrane region.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct MembraneSpec {
    /// Block of quadrilaterals or triangles in the mesh.
    pub region: String,
    /// Thickness \[m\].
    pub thickness: f64,
    /// Law.
    pub law: MembraneLawSpec,
}

/// A membrane law; see [`crate::material::membrane::MembraneLaw`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
#[allow(missing_docs)] // the constants are documented at the laws
pub enum MembraneLawSpec {
    StVenantKirchhoff { young: f64, nu: f64 },
    NeoHookean { mu: f64 },
}

/// Ligament strands along a block of two-node lines; see [`crate::material::line::Strand`].
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct StrandSpec {
    /// Block of two-node lines in the mesh.
    pub region: String,
    /// Force per unit strain of each strand \[N\].
    pub stiffness: f64,
    /// Half the strain at which the toe ends.
    #[serde(default = "blankevoort_toe")]
    pub toe: f64,
    /// Strain in the mesh as it is.
    #[serde(default)]
    pub reference_strain: f64,
}

fn blankevoort_toe() -> f64 {
    0.03
}

/// Gravity on all solids.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct GravitySpec {
    /// Acceleration \[m/s²\] at unit value of the control.
    pub acceleration: [f64; 3],
    /// Control that scales it.
    pub control: String,
}

/// Inertia of all solids, by backward Euler from frame to frame: see [`crate::effect::TimeStep`]. The drive starts at time 0, and its
/// times are seconds. Surfaces then never pass through each other, not even on the way to a first guess. Among the forces in play, to
/// which the wanted residual is relative, are those that would stop everything within a step.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct InertiaSpec {
    /// Solids that move at the start.
    #[serde(default)]
    pub velocities: Vec<VelocitySpec>,
}

/// How fast a solid is at the start.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct VelocitySpec {
    /// Its block of cells.
    pub region: String,
    /// Velocity \[m/s\] of all its nodes; of those that solids share the last one counts.
    pub velocity: [f64; 3],
}

/// Pressure that stays normal to a surface.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PressureSpec {
    /// Surface of the mesh; normals by the right-hand rule, positive pressure pushes against them. It may be closed or have any number
    /// of openings; the rim of each is held or slides in the plane of the opening. What lies in an opening feels nothing: pressure on a
    /// lid is a pressure on the surface of the lid.
    pub surface: String,
    /// Was a point in the planes of all openings \[m\]. Not needed: openings are found from the surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<[f64; 3]>,
    /// Control that holds the pressure \[Pa\].
    pub control: String,
}

/// Pressure that stays normal to a surface whose rim may move freely: nothing but the force p n da on the patch as it is. It has no energy, so
/// the solver finds an equilibrium in some more iterations and says nothing of its stability; where the rim allows it take a
/// [`PressureSpec`].
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PatchPressureSpec {
    /// Surface of the mesh; normals by the right-hand rule, positive pressure pushes against them.
    pub surface: String,
    /// Control that holds the pressure \[Pa\].
    pub control: String,
}

/// Dead forces on nodes.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ForceSpec {
    /// Name, as reported.
    pub name: String,
    /// Nodes, counted from 0 in the order of the mesh file, and forces \[N\] at unit value of the control.
    pub loads: Vec<(u32, [f64; 3])>,
    /// Control that scales them.
    pub control: String,
}

/// Displacement components that are prescribed.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PrescribedSpec {
    /// Node set.
    pub nodes: String,
    /// Which of x, y, z.
    pub components: [bool; 3],
    /// Displacement \[m\] at unit value of the control: none (held), one for all nodes, or one per node of the set.
    #[serde(default)]
    pub displacement: Vec<[f64; 3]>,
    /// Control that scales it; absent: held where it is.
    #[serde(default)]
    pub control: Option<String>,
}

/// Nodes that slide in planes of any direction. A node of two such sets slides along the line in which the planes meet, one of three is held.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RollerSpec {
    /// Node set.
    pub nodes: String,
    /// Normal of the planes; normalised.
    pub normal: [f64; 3],
    /// Displacement \[m\] along the normal at unit value of the control.
    #[serde(default)]
    pub displacement: f64,
    /// Control that scales it; absent: the planes stay where they are.
    #[serde(default)]
    pub control: Option<String>,
}

/// Nodes that move with a rigid body.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct TieSpec {
    /// Node set.
    pub nodes: String,
    /// Body.
    pub body: String,
}

/// A rigid body whose pose is an unknown; see [`crate::plan::FreeBody`].
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FreeBodySpec {
    /// Body of the ties.
    pub body: String,
    /// Coordinates that are held at what they are in the mesh.
    #[serde(default)]
    pub held: Vec<Coordinate>,
    /// Its origin in the mesh \[m\], whose displacement its coordinates x, y and z are; absent: the mean of its nodes.
    #[serde(default)]
    pub origin: Option<[f64; 3]>,
    /// Young's modulus \[Pa\] of the cube that stands for it: of cortical bone. It is rigid to the strain of such a cube.
    #[serde(default = "cortical_bone")]
    pub young: f64,
}

impl FreeBodySpec {
    /// A body none of whose coordinates is held, everything else at its default.
    pub fn new(body: &str) -> FreeBodySpec {
        FreeBodySpec { body: body.to_string(), held: Vec::new(), origin: None, young: cortical_bone() }
    }
}

/// Rho, Kuhn-Spearing & Zioupos, Med Eng Phys 1998;20:92: 17 GPa along the bone.
fn cortical_bone() -> f64 {
    17e9
}

/// A coordinate of a free body: the displacement of its origin along an axis, or an angle of R = Rz Rx Ry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)] // named by what they are
pub enum Coordinate {
    X,
    Y,
    Z,
    TurnX,
    TurnY,
    TurnZ,
}

/// A force at a point of a free body.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct BodyForceSpec {
    /// Name, as reported.
    pub name: String,
    /// The body.
    pub body: String,
    /// Where it acts: a point of the body in the mesh \[m\].
    pub point: [f64; 3],
    /// Force \[N\] at unit value of the control.
    pub force: [f64; 3],
    /// Whether it turns with the body; otherwise it keeps its direction.
    #[serde(default)]
    pub follows: bool,
    /// Control that scales it.
    pub control: String,
}

/// A solid region whose free nodes are fixed means of the corners of the cube of a grid in which they lie; see
/// [`crate::plan::EmbeddedRegion`].
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct EmbeddedSpec {
    /// The solid.
    pub region: String,
    /// Edge of a cube \[m\]: at least twice that of the cells of the region, or exactly theirs.
    pub cell: f64,
    /// Over what the volume ratio of mean dilatation is one.
    #[serde(default)]
    pub dilatation: DilatationSpec,
}

impl EmbeddedSpec {
    /// With everything else at its default.
    pub fn new(region: &str, cell: f64) -> EmbeddedSpec {
        EmbeddedSpec { region: region.to_string(), cell, dilatation: DilatationSpec::default() }
    }
}

/// Over what the volume ratio of mean dilatation is one in an embedded region.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DilatationSpec {
    /// Over what a cube holds.
    #[default]
    Cube,
    /// Over every cell of the mesh. It locks, as one cube then has to keep many volumes; to see by how much.
    Element,
}

/// Nodes whose displacement along a direction is one common unknown.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PlaneSpec {
    /// Node set.
    pub nodes: String,
    /// Axis 0, 1 or 2, or a vector of any direction.
    pub axis: Direction,
}

/// A direction: the number of an axis, or a vector, normalised.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "0, 1 or 2 for an axis, or a vector of three numbers")]
pub enum Direction {
    /// 0, 1 or 2.
    Axis(usize),
    /// Any vector but zero.
    Vector([f64; 3]),
}

impl From<usize> for Direction {
    fn from(axis: usize) -> Direction {
        Direction::Axis(axis)
    }
}

/// Frictionless contact; see [`crate::contact`]. What is prescribed on both sides is not looked at: only the drive moves it.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ContactSpec {
    /// Surfaces that take part: surfaces of the mesh, or blocks of cells (their boundary). Nodes of a rigid surface are
    /// tied to a body or held.
    pub surfaces: Vec<String>,
    /// Pairs of `surfaces` that may meet, a name twice for contact with itself; empty: every surface with every other.
    #[serde(default)]
    pub pairs: Vec<[String; 2]>,
    /// Pairs that are left out.
    #[serde(default)]
    pub excluded: Vec<[String; 2]>,
    /// `guarded` (default): nothing passes through; `cheap`: surfaces penetrate each other a little.
    #[serde(default)]
    pub mode: ContactMode,
    /// Guarded: distance \[m\] below which surfaces repel each other, less where they start closer. Cheap: depth at which the
    /// pressure is `stiffness`.
    #[serde(default = "contact_distance")]
    pub distance: f64,
    /// Stiffness \[Pa\] of the layer of that thickness; absent: Young's modulus of the softer side at small strain, of each face that of the
    /// cell behind it; in guarded mode times `layer`.
    #[serde(default)]
    pub stiffness: Option<f64>,
    /// Guarded: how many times as stiff as what lies behind it the layer is. Where fibres press harder than their matrix could, 1 is too
    /// little: the layer is squeezed to nothing.
    #[serde(default = "contact_layer")]
    pub layer: f64,
    /// Greatest distance \[m\] between the points at which contact is computed; absent: the edge length of the finer
    /// side, half of it in guarded mode.
    #[serde(default)]
    pub spacing: Option<f64>,
    /// Depth \[m\] up to which an overlap in the mesh is mended by moving its nodes, free of stress; deeper ones are
    /// refused. What cannot be parted (near ties) takes no notice of the other surface. Surfaces that touch are always
    /// parted, by a tenth of `distance`.
    #[serde(default)]
    pub repair: f64,
    /// Surfaces within this distance \[m\] of a node tied to a body take no notice of that body (around attachments);
    /// cells with a tied node never do.
    #[serde(default)]
    pub attachment: f64,
}

fn contact_layer() -> f64 {
    1.0
}

impl ContactSpec {
    /// Every surface with every other, everything else at its default.
    pub fn new(surfaces: &[&str]) -> ContactSpec {
        ContactSpec {
            surfaces: surfaces.iter().map(|s| s.to_string()).collect(),
            pairs: Vec::new(),
            excluded: Vec::new(),
            mode: ContactMode::Guarded,
            distance: contact_distance(),
            stiffness: None,
            layer: contact_layer(),
            spacing: None,
            repair: 0.0,
            attachment: 0.0,
        }
    }
}

/// How contact keeps surfaces apart; see [`crate::contact`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactMode {
    /// A barrier and continuous collision detection: no accepted state has an intersection.
    #[default]
    Guarded,
    /// A penalty on the penetration.
    Cheap,
}

fn contact_distance() -> f64 {
    0.3e-3
}
