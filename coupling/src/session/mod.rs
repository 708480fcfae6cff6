//! Either side of the coupling by itself, to be driven by somebody else: poses and activations go into the [thigh](ThighSession), forces,
//! lever arms and wrenches come out; time goes into the [rigid leg](RigidSession), and what its muscles can do where the thigh says it.
//!
//! Everything is told in the frame of the mesh with the femur at rest. The pose of a bone is the map from where the mesh has it to where it
//! is; twists and wrenches are those of the point of the bone that is at the hip centre of the mesh, so that twist times wrench is power for
//! every bone. Bones come in the order of [`BODIES`](crate::thigh::registration::BODIES), muscles in that of the mesh.
//!
//! What a session computes hangs on its state and its inputs alone, to the last bit: a state that was saved and restored goes on as if
//! nothing had been in between. [`ThighSide`] and [`RigidSide`] hold what never changes, for any number of sessions in any threads;
//! those of one thigh compute one after the other.

mod pose;
mod rigid;
mod state;
mod thigh;

pub use pose::{PoseNumbers, as_pose, numbers};
pub use rigid::{RigidResult, RigidSession, RigidSide};
pub use thigh::{MuscleResult, ThighResult, ThighSession, ThighSide};

use crate::error::CouplingError;

/// Refuses numbers that are not as many as wanted, not finite, or outside of a range.
fn examined(what: &str, values: &[f64], n: usize, range: [f64; 2]) -> Result<(), CouplingError> {
    let bad = |text: String| Err(CouplingError::Option(text));
    if values.len() != n {
        return bad(format!("{what}: {} numbers, must be {n}", values.len()));
    }
    let [least, most] = range;
    let wrong = |(_, v): &(usize, &f64)| !(**v >= least && **v <= most && v.is_finite());
    let all: Vec<String> =
        values.iter().enumerate().filter(wrong).map(|(i, v)| format!("number {} is {v}", i + 1)).collect();
    let must = match (least.is_finite(), most.is_finite()) {
        (true, true) => format!("from {least} to {most}"),
        (true, false) => format!("finite and at least {least}"),
        _ => "finite".into(),
    };
    if all.is_empty() { Ok(()) } else { bad(format!("{what}: {}; must be {must}", all.join(", "))) }
}
