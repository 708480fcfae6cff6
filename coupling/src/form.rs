//! What of the rigid leg is as published, and what goes beyond.

use multibody::model::KneeKind;
use multibody::sharing::{MuscleCost, ReactionCost};
use serde::{Deserialize, Serialize};

/// What joints and muscles resist at rest, in force sharing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Passive {
    /// Nothing.
    #[default]
    None,
    /// Measured passive moments of hip, knee and ankle, off what the muscles must supply.
    Joints,
    /// Tensions are at least those of the resting muscles.
    Muscles,
    /// Both; what the resting muscles make of the measured moments stays with them, so that nothing counts twice.
    Both,
}

impl Passive {
    /// Whether measured moments are known.
    pub fn of_joints(self) -> bool {
        matches!(self, Passive::Joints | Passive::Both)
    }

    /// Whether tensions of resting muscles are known.
    pub fn of_muscles(self) -> bool {
        matches!(self, Passive::Muscles | Passive::Both)
    }
}

/// What bounds a tension from above.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Bounds {
    /// The maximal isometric force.
    #[default]
    Strength,
    /// The force at full activation at the length and velocity of the moment.
    State,
}

/// Choices of the rigid leg. The default is the published leg, to the bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Form {
    /// The knee centre of a functional calibration is corrected as the trial says; otherwise it is on the axis as found.
    pub corrected_knee_centre: bool,
    /// The kind of knee; `None`: that of the trial.
    pub knee: Option<KneeKind>,
    /// Quadriceps and gastrocnemii go over cylinders, so that no lever arm jumps.
    pub wrapped: bool,
    /// What is known of passive forces.
    pub passive: Passive,
    /// What bounds tensions.
    pub bounds: Bounds,
    /// What tensions cost, where nobody asks for another cost.
    pub muscle_cost: MuscleCost,
    /// What joint forces cost, where nobody asks for another cost.
    pub reaction_cost: ReactionCost,
}

impl Form {
    /// Moissenet et al. 2014 with the bounds of gait2392: what `compare` goes by.
    pub const PUBLISHED: Form = Form {
        corrected_knee_centre: false,
        knee: Some(KneeKind::Natural),
        wrapped: false,
        passive: Passive::None,
        bounds: Bounds::Strength,
        muscle_cost: MuscleCost::Force,
        reaction_cost: ReactionCost::Table,
    };
    /// What `optimize` goes by.
    pub const REVISED: Form = Form {
        corrected_knee_centre: true,
        knee: None,
        wrapped: true,
        passive: Passive::Both,
        bounds: Bounds::State,
        muscle_cost: MuscleCost::Volume,
        reaction_cost: ReactionCost::None,
    };
}

impl Default for Form {
    fn default() -> Self {
        Form::PUBLISHED
    }
}
