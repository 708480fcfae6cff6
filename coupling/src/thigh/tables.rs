//! The tables of the built-in thigh (`gait-data/thigh/`), as text; [`fem`] reads them.

/// Sections of the 17 muscles, mm.
pub const MUSCLE_SECTIONS: &str = include_str!("../../../gait-data/thigh/muscle_sections.csv");
/// Closed surfaces of the five bones, mm.
pub const BONE_SECTIONS: &str = include_str!("../../../gait-data/thigh/bone_sections.csv");
/// Where muscles arise and end, mm.
pub const ATTACHMENTS: &str = include_str!("../../../gait-data/thigh/attachments.csv");
/// Segment frames of the pose in which the thigh was measured, mm.
pub const LIMB_FRAMES: &str = include_str!("../../../gait-data/thigh/limb_frames.csv");
