//! Natural coordinates Q = [u, rP, rD, w] of five segments.

/// Number of coordinates: 5 segments × 12 (foot, shank, patella, thigh, pelvis).
pub const N_COORDINATES: usize = 60;
/// All natural coordinates of one frame.
pub type Coordinates = nalgebra::SVector<f64, N_COORDINATES>;

/// The five segments, in the order of the coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SegmentId {
    /// Foot.
    Foot,
    /// Shank.
    Shank,
    /// Patella.
    Patella,
    /// Thigh.
    Thigh,
    /// Pelvis.
    Pelvis,
}

impl SegmentId {
    /// All segments in the order of the coordinates.
    pub const ALL: [SegmentId; 5] =
        [SegmentId::Foot, SegmentId::Shank, SegmentId::Patella, SegmentId::Thigh, SegmentId::Pelvis];

    /// Position in [`SegmentId::ALL`].
    pub fn index(self) -> usize {
        self as usize
    }

    /// Lower-case name, as in files.
    pub fn name(self) -> &'static str {
        ["foot", "shank", "patella", "thigh", "pelvis"][self.index()]
    }
}
