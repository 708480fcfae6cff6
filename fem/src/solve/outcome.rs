//! How a load ended: what it took, or where and why it could be carried no farther.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{LooseComponent, Motion};

/// How an island came to equilibrium under the full load.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Advance {
    /// Load steps taken, and tried in vain.
    pub load_steps: usize,
    /// Load steps that failed and were tried again shorter.
    pub retries: usize,
    /// Load steps that contact or folding cells cut short and that the way went on from in looser equilibrium than
    /// was asked for (5 % of the forces in play). The end never is.
    pub loose_steps: usize,
    /// Ways that softened contact showed and that were taken.
    pub soft_ways: usize,
    /// Ways that softened contact showed and that were not taken, because they led through a body.
    pub wrong_ways: usize,
    /// Pairs of bodies of which one went through the other, by lines through them that go straight from frame to frame
    /// ([`Sides`](crate::measure::Sides)); counted at one island for all. In guarded contact, all of whose guesses are looked at, it has gone
    /// round it in between, as far as lines and sheets can tell.
    pub crossed_pairs: usize,
    /// Linear systems solved, for Newton's method and predictions: what [`Settings::max_work`](super::Settings::max_work) bounds.
    pub work: usize,
    /// Newton iterations, those of failed load steps included; time steps where there are no matrices.
    pub iterations: usize,
    /// Conjugate gradient iterations.
    pub linear_iterations: usize,
    /// Factorizations.
    pub factorizations: usize,
    /// Residual ‖g‖ \[N\] at the end.
    pub residual: f64,
    /// Residual \[N\] that was asked for at the end: the tolerance times the forces in play.
    pub wanted: f64,
    /// Forces in play \[N\] at the end.
    pub force_scale: f64,
    /// Potential \[J\] at the end.
    pub energy: f64,
    /// Least det F at the end.
    pub least_det_f: f64,
    /// Load steps (their ends) on whose way the Hessian was indefinite: buckling or a limit point is near, or the
    /// start of the step was far from equilibrium. Without stability checks softened contact, and the first two iterations
    /// after it, do not look.
    pub indefinite_at: Vec<f64>,
    /// Loads at which an equilibrium was found unstable (buckling, snap-through) and left for a stable one.
    pub unstable_at: Vec<f64>,
    /// How it moved, of explicit dynamics.
    pub motion: Option<Motion>,
    /// Whether the equilibrium at the end was tested and is a minimum of the potential; otherwise nobody asked.
    pub tested_stable: bool,
    /// Seconds in assembly (energy, gradient, Hessian).
    pub assembly_s: f64,
    /// Seconds in factorizations.
    pub factorization_s: f64,
    /// Seconds in conjugate gradients.
    pub linear_s: f64,
    /// Seconds in contact, most of it part of assembly: searching, barriers, collision detection.
    pub contact_s: f64,
    /// Seconds in all.
    pub total_s: f64,
}

impl Advance {
    /// Residual relative to the forces in play; 0 where there are none.
    pub fn relative_residual(&self) -> f64 {
        if self.force_scale > 0.0 { self.residual / self.force_scale } else { 0.0 }
    }
}

/// Why a load step went no further.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Reason {
    /// Every direction of descent inverts an element.
    Inversion,
    /// Surfaces in contact leave no room for any step.
    Touch,
    /// The energy does not fall along the Newton direction.
    NoDescent,
    /// The iterations ran out.
    Iterations,
    /// The Hessian is singular: no force resists this unknown.
    Singular {
        /// Its node.
        node: String,
        /// x, y or z.
        direction: char,
    },
    /// Round-off of the positions alone makes forces greater than the residual that is wanted.
    RoundOff {
        /// These forces \[N\].
        floor: f64,
        /// Tolerance that could be reached.
        reachable: f64,
        /// Where a mesh far from the origin is why: its distance and its extent \[m\].
        far: Option<(f64, f64)>,
    },
    /// The shape grows without bound: there is no equilibrium at this load, or none anywhere near.
    RunsAway {
        /// Extent in the last equilibrium \[m\].
        before: f64,
        /// Extent where it was given up \[m\].
        after: f64,
    },
    /// The forces balance in a shape with an inverted element, which a law that is finite there allows.
    Inverted,
    /// The work that a frame may take is done.
    Work {
        /// Linear systems that it may solve.
        most: usize,
    },
    /// The motion has not come to rest.
    NotSettled {
        /// Time steps that it may take.
        steps: usize,
    },
    /// Something that moves freely weighs nothing.
    NoMass {
        /// Its node.
        node: String,
    },
    /// At the end of a frame energy is missing, or too much.
    Imbalance {
        /// How much \[J\].
        missing: f64,
        /// The energies in play \[J\].
        in_play: f64,
    },
    /// A motion gets stiffer, again and again, than its masses bear, however few steps are taken at a time.
    BlowsUp,
    /// Every equilibrium that was found is a saddle of the potential.
    Unstable,
    /// A gradient or energy that is not a number.
    NotFinite,
}

impl std::fmt::Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Reason::Inversion => write!(f, "every step would invert an element"),
            Reason::Touch => write!(f, "every step would make surfaces touch"),
            Reason::NoDescent => write!(f, "the energy does not fall along the Newton direction"),
            Reason::Iterations => write!(f, "the iterations ran out"),
            Reason::Singular { node, direction } => {
                write!(f, "nothing resists {node} along {direction}; support it or give it stiffness")
            }
            Reason::RoundOff { floor, far: Some((distance, extent)), .. } => write!(
                f,
                "round-off of the positions alone makes forces of {floor:.1e} N, because the mesh, {extent:.1e} m \
                 large, lies {distance:.1e} m from the origin; move it there"
            ),
            Reason::RoundOff { floor, reachable, far: None } => write!(
                f,
                "round-off of the positions alone makes forces of {floor:.1e} N; the stiffest parts are too stiff \
                 beside the softest, or the tolerance is too small (about {reachable:.0e} can be reached)"
            ),
            Reason::RunsAway { before, after } => write!(
                f,
                "the shape grows without bound, from {before:.1e} m to {after:.1e} m: there is no equilibrium beyond (a limit \
                 point), or nothing holds it"
            ),
            Reason::Inverted => write!(f, "the forces balance, but in a shape with an inverted element"),
            Reason::Work { most } => write!(
                f,
                "{most} linear systems are solved, and no frame may take more; a way of shorter frames shows where it \
                 gets hard, `max_work` allows for more"
            ),
            Reason::NotSettled { steps } => write!(
                f,
                "it has not come to rest in {steps} time steps, and no frame may take more; `max_steps` allows for more, and Newton's method \
                 needs fewer where stiffness and softness are far apart"
            ),
            Reason::NoMass { node } => write!(f, "{node} has no mass: no solid with inertia is there"),
            Reason::BlowsUp => write!(
                f,
                "the motion blows up, however few steps are taken at a time and with however much mass; a smaller `time_step_factor`, or a slower way, \
                 may carry it through"
            ),
            Reason::Imbalance { missing, in_play } => write!(
                f,
                "{missing:.2e} J are missing or too much at the end, beside {in_play:.2e} J in play: the motion is too fast for its time steps; \
                 take a smaller `time_step_factor`, or let the load go more slowly"
            ),
            Reason::Unstable => {
                write!(f, "every equilibrium found is unstable, and left for another one that is")
            }
            Reason::NotFinite => write!(f, "forces are not finite numbers"),
        }
    }
}

/// Why there is no equilibrium to report. The positions left behind are the last good ones.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SolveError {
    /// The start is no admissible state.
    #[error(
        "`{island}`, step {step}: the start is inadmissible, {place} has det F = {det_f:.2e}; mend the mesh there"
    )]
    Inadmissible {
        /// Name of the island.
        island: String,
        /// Step of the run.
        step: usize,
        /// The worst element.
        place: String,
        /// Its least det F.
        det_f: f64,
    },
    /// Bodies went through each other, in a mode of contact that cannot keep them from it.
    #[error(
        "step {step}: {} went through each other, which the cheap mode of contact does not see where a step is large; divide the \
         step, or take the guarded mode",
        pairs.iter().map(|[a, b]| format!("`{a}` and `{b}`")).collect::<Vec<_>>().join(", ")
    )]
    WentThrough {
        /// Step of the run.
        step: usize,
        /// The pairs.
        pairs: Vec<[String; 2]>,
    },
    /// A step that failed would end with prescribed faces in each other: what is between them has no room.
    #[error(
        "step {step}: at its end {} overlap, which are prescribed there and which nothing keeps apart; what is between them has no room",
        pairs.iter().map(|([a, b], n)| format!("faces of `{a}` and `{b}` ({n} pairs of triangles)")).collect::<Vec<_>>().join(", ")
    )]
    NoRoom {
        /// Step of the run.
        step: usize,
        /// The surfaces, and how many pairs of their triangles intersect.
        pairs: Vec<([String; 2], usize)>,
    },
    /// What is prescribed turns an element inside out.
    #[error(
        "`{island}`, step {step}: all nodes of {place} are prescribed, and there it is turned inside out, det F = {det_f:.2e}; \
         mend their displacements or the poses of their bodies"
    )]
    Folded {
        /// Name of the island.
        island: String,
        /// Step of the run.
        step: usize,
        /// The worst element.
        place: String,
        /// Its least det F.
        det_f: f64,
    },
    /// The load of a step is none of the plan, or not of finite numbers.
    #[error("step {step}: {source}")]
    Load {
        /// Step of the run.
        step: usize,
        /// What is wrong with it.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// Parts of the mesh can move freely.
    #[error(
        "`{island}` is not supported, it moves without resistance: {}; prescribe nodes or tie it to something",
        parts.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
    )]
    Unsupported {
        /// Name of the island.
        island: String,
        /// What can move, and how.
        parts: Vec<LooseComponent>,
    },
    /// Solver settings that cannot be.
    #[error("solver settings: {}", mistakes.join("; "))]
    Settings {
        /// All of them, with their remedies.
        mistakes: Vec<String>,
    },
    /// A start or load of another plan.
    #[error("{what} has {found} entries, the plan needs {needed}")]
    Count {
        /// The list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// What it should be, with what it counts.
        needed: String,
    },
    /// Inertia needs time.
    #[error(
        "step {step}: no time passes from {from} s to {to} s, and inertia needs some; times of the drive must increase from 0 on"
    )]
    NoTime {
        /// Step of the run.
        step: usize,
        /// Time before \[s\].
        from: f64,
        /// Time of the frame \[s\].
        to: f64,
    },
    /// The load could not be carried to its end.
    #[error("{0}")]
    NotConverged(Box<NotConverged>),
}

/// Where and why the load could be carried no farther.
#[derive(Clone, Debug, PartialEq)]
pub struct NotConverged {
    /// Name of the island.
    pub island: String,
    /// Step of the run.
    pub step: usize,
    /// Load of the last equilibrium to the tolerance that was asked for; its positions are kept.
    pub load: f64,
    /// What stopped the last attempt to go farther.
    pub reason: Reason,
    /// Newton iterations of that attempt.
    pub iterations: usize,
    /// Residual \[N\] where it stopped.
    pub residual: f64,
    /// Residual \[N\] that was wanted there.
    pub wanted: f64,
    /// Least det F where it stopped.
    pub det_f: f64,
    /// The element that has it.
    pub place: String,
}

impl std::fmt::Display for NotConverged {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let NotConverged { island, step, load, reason, iterations, residual, wanted, det_f, place } = self;
        write!(
            f,
            "`{island}`, step {step}: not converged beyond load {load:.4}: {reason}; after {iterations} iterations the \
             residual was {residual:.2e} N, wanted {wanted:.1e} N; least det F = {det_f:.2e} in {place}"
        )
    }
}
