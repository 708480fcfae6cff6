//! Force sharing: which muscle, contact, ligament and bone forces carry the loads of a frame.
//!
//! One strictly convex quadratic programme per frame ([`SharingProblem`]). [`SharingSolver`] keeps what
//! can be kept from frame to frame; its answers do not depend on what it solved before.
//!
//! ```text
//! SharingProblem ─ scaled ─▶ Canonical ─ interior (Clarabel) ─▶ active set ─ active_set ─▶ exact answer
//!                                                                      residuals, verdict ◀─ verdict
//! ```
//!
//! [`extremes`] says what the problem leaves open whatever the cost: the ends of joint forces over all admissible tensions.
//!
//! A frame that cannot be solved is never passed over: it gets the answer that violates the moments
//! least, with what is missing and which bounds stand in the way ([`Sharing::blocking`]).

mod active_set;
mod extremes;
mod infeasible;
mod interior;
mod problem;
mod scaled;
mod semidefinite;
mod simplex;
mod solve;
mod verdict;
mod weights;

pub use extremes::extremes;
pub use problem::{Names, SharingError, SharingProblem};
pub use solve::{Raised, Sharing, SharingOptions, SharingSolver, share_frames};
pub use verdict::{Blocking, KKT_TOLERANCE, Multipliers, Residuals, residuals};
pub use weights::{
    Capacity, LeverArm, MuscleCost, REACTIONS, Reaction, ReactionCost, SHEAR, muscle_weights, reactions,
};
