//! What couples the rigid leg with the deformable thigh: the only crate that knows both, apart from the command on top of it.
//!
//! [`optimize`] is the rigid leg end to end, [`scene`] what a person writes down, [`steps`] what it says of a gait step, [`thigh`] the mesh, [`fibres`] what its muscles
//! pull with, [`study`] the road from a scene to forces compared, [`two_way`] the passes back into force sharing, [`mod@solve`] bodies of
//! one's own.

pub mod configuration;
pub mod cost;
pub mod error;
pub mod fibres;
pub mod measured;
pub mod number;
pub mod optimize;
pub mod scene;
pub mod solve;
pub mod steps;
pub mod study;
pub mod subject;
pub mod thigh;
pub mod two_way;
