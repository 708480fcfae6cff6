//! Fibre calibration: which contraction makes a muscle pull with which force, found on that muscle alone.
//!
//! Every muscle is held in its own reference posture (the mesh as it is) and its fibres are contracted in steps; the force
//! through its belly at each step makes a curve. The wanted force is then looked up: the curve knows nothing of the gait
//! step, of neighbours or of contact.

use fem::plan::{Plan, SceneError};
use fem::run::{DriveFrame, Session};
use fem::solve::{Settings, SolveError};

use crate::fibres::alone::calibrate_each;
use crate::fibres::cache::Cache;
use crate::thigh::build::{Thigh, ThighMuscle};
use crate::thigh::section::belly_force;
use crate::thigh::tissue::FIBRE_YOUNG;

/// Samples of a curve at most.
const MOST_ROUNDS: usize = 16;
/// Forces below this are not worth a curve \[N\].
const LEAST_FORCE: f64 = 1.0;

/// Section force against contraction of one muscle.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FibreCurve {
    /// Contraction strain, from 0, increasing.
    pub contraction: Vec<f64>,
    /// Force through the belly along the muscle's line \[N\], increasing.
    pub force: Vec<f64>,
}

impl FibreCurve {
    /// Contraction that makes `force` \[N\]; `None` beyond the end of the curve. Piecewise monotone cubic (Fritsch and Carlson 1980)
    /// in the force; zero for no force.
    pub fn contraction_for(&self, force: f64) -> Option<f64> {
        if force <= 0.0 {
            return Some(0.0);
        }
        let k = self.force.iter().position(|&f| f >= force)?.max(1) - 1;
        let slope =
            |i: usize| (self.contraction[i + 1] - self.contraction[i]) / (self.force[i + 1] - self.force[i]);
        let last = self.force.len() - 2;
        // Harmonic means of the neighbouring slopes keep the curve monotone.
        let tangent = |i: usize| match i {
            0 => slope(0),
            i if i > last => slope(last),
            i => 2.0 / (1.0 / slope(i - 1) + 1.0 / slope(i)),
        };
        let h = self.force[k + 1] - self.force[k];
        let t = (force - self.force[k]) / h;
        let (a, b) = (self.contraction[k], self.contraction[k + 1]);
        let (ma, mb) = (tangent(k) * h, tangent(k + 1) * h);
        let (t2, t3) = (t * t, t * t * t);
        Some(
            (2.0 * t3 - 3.0 * t2 + 1.0) * a
                + (t3 - 2.0 * t2 + t) * ma
                + (3.0 * t2 - 2.0 * t3) * b
                + (t3 - t2) * mb,
        )
    }
}

/// Why a muscle has no curve.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// The scene of the calibration is wrong.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The muscle alone found no equilibrium.
    #[error("calibration of the fibres: {0}")]
    Solve(#[from] SolveError),
    /// Fibres that pull, and no force through the belly to match.
    #[error(
        "calibration of `{muscle}`: its fibres would have to pull {gain:.2} times as hard as the force through the belly; \
         its mesh or its attachments are at fault"
    )]
    Gain {
        /// The muscle.
        muscle: String,
        /// Tension of the fibres over force through the belly.
        gain: f64,
    },
    /// No factor on the matrix of an embedded muscle gives the force of its mesh.
    #[error(
        "calibration of `{muscle}`: in its grid it resists with {of_grid:.2} N, its mesh with {of_mesh:.2} N, and no factor on its matrix makes them \
         equal (last {last:.2} N); take smaller cubes"
    )]
    Factor {
        /// The muscle.
        muscle: String,
        /// Force of its mesh \[N\].
        of_mesh: f64,
        /// Force of its grid \[N\].
        of_grid: f64,
        /// Force with the last factor tried \[N\].
        last: f64,
    },
    /// A force that no activation explains.
    #[error("`{muscle}`: no activation up to 1.8 makes the {wanted:.0} N of the Hill model at its length")]
    BeyondHill {
        /// The muscle.
        muscle: String,
        /// Wanted force \[N\].
        wanted: f64,
    },
    /// More contraction gave less force.
    #[error(
        "calibration of `{muscle}`: the force through the belly falls from {before:.1} to {after:.1} N while its fibres contract to {contraction:.3}; \
         its mesh or its attachments are at fault"
    )]
    NotMonotone {
        /// The muscle.
        muscle: String,
        /// Force at the step before \[N\].
        before: f64,
        /// Force at this step \[N\].
        after: f64,
        /// Contraction at this step.
        contraction: f64,
    },
    /// The muscle is too weak for the force.
    #[error(
        "calibration of `{muscle}`: {wanted:.0} N are wanted, its fibres reach {reached:.0} N at {contraction} contraction"
    )]
    TooWeak {
        /// The muscle.
        muscle: String,
        /// Wanted force \[N\].
        wanted: f64,
        /// Greatest force of the curve \[N\].
        reached: f64,
        /// Contraction there.
        contraction: f64,
    },
}

impl CalibrationError {
    /// Whether the input was good and the muscle is at fault.
    pub fn is_verdict(&self) -> bool {
        !matches!(self, CalibrationError::Scene(_))
    }
}

/// Curves of all muscles of the thigh, each alone, over the forces that are `wanted` \[N\], a list per step in the order of the muscles.
/// A muscle that is wanted at rest only has no curve but the zero. What `cache` has is not computed.
///
/// A muscle is first pulled taut, then let down past the least wanted force: taut it is solved in a few iterations, slack in hundreds.
pub fn calibrate(
    thigh: &Thigh,
    wanted: &[Vec<f64>],
    settings: &Settings,
    cache: Option<&Cache>,
) -> Result<Vec<FibreCurve>, CalibrationError> {
    let range = |i: usize| {
        let some = || wanted.iter().map(|step| step[i]).filter(|f| *f >= LEAST_FORCE);
        [some().fold(f64::INFINITY, f64::min), some().fold(0.0, f64::max)]
    };
    let all: Vec<usize> = (0..thigh.muscles.len()).collect();
    calibrate_each(
        thigh,
        &all,
        cache,
        |i| format!("thermal {:?}{settings:?}", range(i)),
        |i, muscle| calibrate_one(muscle, range(i), settings),
    )
}

/// Curve of the only muscle of a thigh over a range of forces \[N\].
fn calibrate_one(
    thigh: &Thigh,
    [least, greatest]: [f64; 2],
    settings: &Settings,
) -> Result<FibreCurve, CalibrationError> {
    let muscle = &thigh.muscles[0];
    let mut search = Search::new(muscle, least, greatest);
    if search.next.is_some() {
        let plan = Plan::new(&thigh.scene, thigh.mesh.clone())?;
        let mut session = Session::new(&plan, settings, None)?;
        for round in 0..MOST_ROUNDS {
            let Some(contraction) = search.next else { break };
            let load = plan.load(&[(&muscle.name, contraction)], &[])?;
            let done = session.advance(&DriveFrame { time: round as f64, load });
            if let Some(error) = done.errors.into_iter().next() {
                return Err(error.into());
            }
            search.see(belly_force(&plan, done.frame.snapshot(), muscle).along());
        }
    }
    search.curve()
}

/// Search for the contractions that make the wanted range of forces.
struct Search<'a> {
    muscle: &'a ThighMuscle,
    /// Least and greatest wanted force \[N\].
    range: [f64; 2],
    /// Contraction and force, in the order found.
    samples: Vec<(f64, f64)>,
    /// Contraction to be tried next.
    next: Option<f64>,
}

impl<'a> Search<'a> {
    fn new(muscle: &'a ThighMuscle, least: f64, greatest: f64) -> Search<'a> {
        let line = &muscle.line;
        let length: f64 = line.windows(2).map(|p| (p[1] - p[0]).norm()).sum();
        let slack = 1.0 - (line[line.len() - 1] - line[0]).norm() / length;
        let first = slack + 1.5 * greatest / (FIBRE_YOUNG * muscle.fibre_area);
        Search {
            muscle,
            range: [least, greatest],
            samples: Vec::new(),
            next: (greatest > 0.0).then_some(first),
        }
    }

    /// Takes the force at the contraction that was tried.
    fn see(&mut self, force: f64) {
        let Some(tried) = self.next.take() else { return };
        self.samples.push((tried, force));
        let [least, greatest] = self.range;
        let stiffness = FIBRE_YOUNG * self.muscle.fibre_area;
        let strongest = self.samples.iter().map(|s| s.1).fold(0.0, f64::max);
        if strongest < 1.05 * greatest {
            self.next = Some(tried + 1.2 * (1.05 * greatest - force).max(0.0) / stiffness + 0.005);
        } else if force > 0.9 * least {
            // Steps that shrink with the force, so that weak pulls are as well resolved as strong ones.
            let below = force - (0.6 * force).max(0.8 * least);
            self.next = Some(tried - below.max(0.1 * force) / self.slope()).filter(|c| *c > 0.0);
        }
    }

    /// Force per contraction at the last samples \[N\].
    fn slope(&self) -> f64 {
        let stiffness = FIBRE_YOUNG * self.muscle.fibre_area;
        match self.samples[..] {
            [.., a, b] if b.0 != a.0 => ((b.1 - a.1) / (b.0 - a.0)).clamp(0.1 * stiffness, 1.5 * stiffness),
            _ => stiffness,
        }
    }

    fn curve(mut self) -> Result<FibreCurve, CalibrationError> {
        let mut curve = FibreCurve { contraction: vec![0.0], force: vec![0.0] };
        self.samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (contraction, after) in self.samples {
            let before = *curve.force.last().expect("starts at 0");
            if after.is_nan() || after <= before {
                let muscle = self.muscle.name.clone();
                return Err(CalibrationError::NotMonotone { muscle, before, after, contraction });
            }
            curve.contraction.push(contraction);
            curve.force.push(after);
        }
        let (reached, wanted) = (*curve.force.last().expect("starts at 0"), self.range[1]);
        if reached < wanted {
            let contraction = *curve.contraction.last().expect("starts at 0");
            return Err(CalibrationError::TooWeak {
                muscle: self.muscle.name.clone(),
                wanted,
                reached,
                contraction,
            });
        }
        Ok(curve)
    }
}
