//! Effects: the additive parts of the potential Π(x) of the thigh.
//!
//! Each effect is an energy with its gradient and Hessian over the current node positions; the solver sees their sum. Loads without
//! potential come in as models that have one ([`anchored`]).

#![allow(non_snake_case)]

pub mod anchored;
pub mod chain;
pub mod embedded_solid;
pub mod follower_force;
pub mod inertia;
pub mod island_term;
pub mod line;
pub mod load;
pub mod membrane;
pub mod obstacle;
pub mod patch_pressure;
pub mod pressure;
pub mod solid;

pub use anchored::Anchored;
pub use chain::Chains;
pub use embedded_solid::EmbeddedSolid;
pub use follower_force::FollowerForce;
pub use inertia::TimeStep;
pub use island_term::IslandTerm;
pub use line::Lines;
pub use load::DeadLoad;
pub use membrane::Membrane;
pub use obstacle::Obstacle;
pub use patch_pressure::PatchPressure;
pub use pressure::Pressure;
pub use solid::Solid;

/// Where the nodes are and what drives the effects now.
#[derive(Clone, Copy, Debug)]
pub struct State<'a> {
    /// Current node positions \[m\], node-major (x₀y₀z₀x₁…).
    pub x: &'a [f64],
    /// Values of the controls (activations, pressures, load factors), in the order of the plan.
    pub controls: &'a [f64],
}

/// Position of node `n` \[m\].
#[inline(always)]
pub(crate) fn point(x: &[f64], n: u32) -> [f64; 3] {
    let i = 3 * n as usize;
    [x[i], x[i + 1], x[i + 2]]
}

/// Mean of some points.
pub(crate) fn mean<const N: usize>(X: &[[f64; 3]; N]) -> [f64; 3] {
    std::array::from_fn(|i| X.iter().map(|p| p[i]).sum::<f64>() / N as f64)
}

/// Marks an unused place in a group of nodes.
pub const NO_NODE: u32 = u32::MAX;

/// What an effect stands for in a free-body cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum EffectKind {
    /// Solid elements.
    Matrix,
    /// Fibres and strands.
    Fibre,
    /// Membranes.
    Membrane,
    /// Loads from outside: no internal force.
    Load,
}

/// Mean state of a solid element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidState {
    /// Volume in the reference configuration \[m³\].
    pub volume: f64,
    /// Current over reference volume.
    pub volume_ratio: f64,
    /// Cauchy stress, mean over the current volume \[Pa\].
    pub cauchy: nalgebra::Matrix3<f64>,
    /// Mean of F a₀ over the reference volume, a₀ the unit vector along the fibres at rest; absent where the law has none.
    pub fibre: Option<nalgebra::Vector3<f64>>,
}

/// Mean state of a membrane cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MembraneState {
    /// Current over reference area.
    pub area_ratio: f64,
    /// Cauchy stress times current thickness \[N/m\]: force per current length, in the plane of the cell; mean over its current area.
    pub tension: nalgebra::Matrix3<f64>,
}

/// The groups of nodes over which an effect is a sum, equally many nodes in each: the elements, say.
#[derive(Clone, Debug)]
pub struct Groups {
    name: String,
    kind: EffectKind,
    nodes_per_group: usize,
    nodes: Vec<u32>,
    centroids: Vec<[f64; 3]>,
}

impl Groups {
    /// Groups of `N` nodes; `centroids` in the reference configuration \[m\], not a number for loads: they are on no side
    /// of a cut.
    pub fn new<const N: usize>(
        name: &str,
        kind: EffectKind,
        nodes: &[[u32; N]],
        centroids: Vec<[f64; 3]>,
    ) -> Self {
        Groups::of_size(name, kind, N, nodes.as_flattened().to_vec(), centroids)
    }

    /// The same where the number of nodes per group is found at run time.
    pub fn of_size(
        name: &str,
        kind: EffectKind,
        nodes_per_group: usize,
        nodes: Vec<u32>,
        centroids: Vec<[f64; 3]>,
    ) -> Self {
        assert_eq!(nodes.len(), nodes_per_group * centroids.len(), "one centroid per group of `{name}`");
        Groups { name: name.to_string(), kind, nodes_per_group, nodes, centroids }
    }

    /// Number of groups.
    pub fn len(&self) -> usize {
        self.centroids.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.centroids.is_empty()
    }

    /// Nodes of a group; `N` as in [`Groups::new`].
    #[inline(always)]
    pub fn nodes<const N: usize>(&self, group: usize) -> &[u32; N] {
        &self.nodes.as_chunks::<N>().0[group]
    }
}

/// One additive part of the potential: Π(x) is a sum over *groups* of equally many nodes (the elements, say).
pub trait Effect: Send + Sync {
    /// Its groups.
    fn groups(&self) -> &Groups;
    /// Name as in the scene.
    fn name(&self) -> &str {
        &self.groups().name
    }
    /// What it counts as in a section force.
    fn kind(&self) -> EffectKind {
        self.groups().kind
    }
    /// Number m of nodes of each group.
    fn nodes_per_group(&self) -> usize {
        self.groups().nodes_per_group
    }
    /// Nodes of all groups, m after m; [`NO_NODE`] fills up smaller groups.
    fn nodes(&self) -> &[u32] {
        &self.groups().nodes
    }
    /// Centroid of a group in the reference configuration \[m\].
    fn centroid(&self, group: usize) -> [f64; 3] {
        self.groups().centroids[group]
    }
    /// Whether there is an energy of which `forces` is the gradient. Where not, `energy` is 0 and `stiffness` the symmetric part of the
    /// derivative of the forces.
    fn has_potential(&self) -> bool {
        true
    }
    /// Π \[J\]; `+∞` where the state is not admissible.
    fn energy(&self, s: &State) -> f64;
    /// Overwrites `out` with ∂Π/∂x \[N\] of groups `first`, `first + 1`, …: 3m values each.
    fn forces(&self, s: &State, first: usize, out: &mut [f64]);
    /// Overwrites `out` with ∂²Π/∂x∂x \[N/m\] of groups `first`, `first + 1`, …: 3m × 3m row-major each,
    /// less the fraction `convexity` of the negative curvatures of every term: the true one with 0, positive semidefinite with 1.
    fn stiffness(&self, s: &State, convexity: f64, first: usize, out: &mut [f64]);
    /// The same, positive semidefinite, with what is slack as stiff as where it is taut: it may be so within a time step.
    fn taut_stiffness(&self, s: &State, first: usize, out: &mut [f64]) {
        self.stiffness(s, 1.0, first, out);
    }
    /// Whether the Hessian vanishes for good (dead loads), so that it need not be assembled.
    fn is_linear(&self) -> bool {
        false
    }
    /// Indices in the mesh of its cells where these are not its groups, in the order in which it counts cells; `None`: they are.
    fn cells(&self) -> Option<&[u32]> {
        None
    }
    /// Mean state of a solid element; `None` for anything else.
    fn solid_state(&self, _s: &State, _cell: usize) -> Option<SolidState> {
        None
    }
    /// Stretch and axial force \[N\] of a segment; `None` for anything else.
    fn line_state(&self, _s: &State, _group: usize) -> Option<(f64, f64)> {
        None
    }
    /// Mean state of a membrane cell; `None` for anything else.
    fn membrane_state(&self, _s: &State, _group: usize) -> Option<MembraneState> {
        None
    }
    /// Least det F over the quadrature points of a group and the cell where it is; `None` where the effect has no volume.
    fn group_det_f(&self, _s: &State, _group: usize) -> Option<(f64, usize)> {
        None
    }
    /// Least det F over the quadrature points and the cell where it is; `None` where the effect has no volume.
    fn least_det_f(&self, _s: &State) -> Option<(f64, usize)> {
        None
    }
}
