//! Can the forces of the knee be believed: bands, knee centre, paths, prosthesis, passive forces, electromyography.

mod bands;
mod centre;
mod emg;
mod form;
mod passive;
mod paths;
mod postures;
mod squat;
mod tray;
