//! The deformable thigh: from bone motion and activation to deformation, stress and section forces.
//!
//! A [`scene::Scene`] says what exists, [`plan::Plan::new`] finds every mistake and keeps only what follows from it,
//! [`run::run`] carries it along a drive. Everything that stores energy is an [`effect::Effect`] with its gradient and
//! Hessian; [`solve`] finds the minimum of their sum and knows no mechanics; [`measure`] looks at the result.

// Comparisons are written so that NaN fails them.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod body;
pub mod contact;
pub mod drive;
pub mod effect;
pub mod element;
pub mod explicit;
pub mod geometry;
pub mod material;
pub mod measure;
pub mod mesh;
pub mod nested;
pub mod output;
pub mod parts;
pub mod plan;
pub mod restart;
pub mod run;
pub mod scene;
pub mod solve;
pub mod verification;
