//! The rigid lower limb: from markers and ground reaction to muscle forces and activations.
//!
//! The road: a [`trial::Trial`] is fitted ([`ik`]) to a [`model::Model`] under its joint equations and becomes a
//! [`trial::Motion`]; [`loads`] turns that into [`loads::Loads`]; [`sharing`] turns those into a [`trial::Effort`].
//! Everything past the readers is SI, in ground axes X forward, Y up, Z to the right, and a right leg.

pub mod activation;
pub mod anatomy;
pub mod calibration;
pub mod capability;
pub mod dynamics;
pub mod emg;
pub mod equilibrium;
pub mod error;
pub mod filter;
pub mod ik;
pub mod joint;
pub mod keys;
pub mod kinematics;
pub mod loads;
pub mod model;
pub mod motion;
pub mod muscle;
pub mod natural;
pub mod passive;
pub mod read;
pub mod share;
pub mod sharing;
pub mod shipped;
pub mod tables;
pub mod tangent;
pub mod tray;
pub mod trial;
pub mod trial_file;
pub mod walker;

pub use error::InputError;
pub use trial_file::TrialFile;
