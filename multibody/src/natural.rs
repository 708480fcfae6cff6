//! Natural coordinates Q = [u, rP, rD, w] of five segments.

/// Number of coordinates: 5 segments × 12 (foot, shank, patella, thigh, pelvis).
pub const N_COORDINATES: usize = 60;
/// All natural coordinates of one frame.
pub type Coordinates = nalgebra::SVector<f64, N_COORDINATES>;
