//! Co-simulation units (FMI 3.0) of the rigid leg and of the deformable thigh.
//!
//! A unit is a zip with this crate as a shared library, `modelDescription.xml` and, as resources, the scene with everything that it reads.
//! [`export`] writes one; [`abi`] is what a master calls, and hands everything on to an [`instance::Instance`],
//! the one state machine of both sides. A [`side::Side`] is the mechanics behind it: [`rigid`] or [`thigh`], a session of [`coupling::session`].
//! [`foreign`] asks a unit of somebody else. `unsafe` is in two files alone: [`abi`], which C calls, and `host`, which calls C.

#![deny(unsafe_code)]

#[allow(unsafe_code, missing_docs)] // What each function is, the standard says.
pub mod abi;
pub mod description;
pub mod error;
pub mod export;
pub mod foreign;
#[allow(unsafe_code)]
mod host;
pub mod instance;
pub mod model;
pub mod registry;
pub mod resources;
pub mod rigid;
pub mod saved;
pub mod side;
pub mod thigh;
pub mod variable;
