//! Which side a unit is.

use std::sync::Arc;

use coupling::session::{RigidSide, ThighSide};

use crate::rigid::RigidUnit;
use crate::side::Side;
use crate::thigh::{Extras, ThighUnit};

/// What never changes of a unit, for any number of instances.
#[derive(Clone)]
pub enum Model {
    /// The rigid leg.
    Rigid(Arc<RigidSide>),
    /// The thigh, with what it says beyond the rest.
    Thigh(Arc<ThighSide>, Extras),
}

impl Model {
    /// A new instance.
    pub fn side(&self) -> Box<dyn Side> {
        match self {
            Model::Rigid(side) => Box::new(RigidUnit::new(side.clone())),
            Model::Thigh(side, extras) => Box::new(ThighUnit::new(side.clone(), *extras)),
        }
    }

    /// First and last time and step \[s\] that make sense without further thought.
    pub fn experiment(&self) -> [f64; 3] {
        match self {
            Model::Rigid(side) => {
                let times = side.times();
                let (first, last) = (times[0], times[times.len() - 1]);
                [first, last, (last - first) / (times.len().max(2) - 1) as f64]
            }
            // Two steps of the gait; time is a number of the master's.
            Model::Thigh(..) => [0.0, 2.0, 1.0],
        }
    }
}
