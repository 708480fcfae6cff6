//! Does contact keep surfaces apart, exactly and without artefacts?

#![allow(non_snake_case)]

mod kernels;
mod scenes;
mod softened;
