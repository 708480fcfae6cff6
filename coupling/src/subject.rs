//! Who was recorded, in words; the built-in thigh in the size of a subject.

use mesher::limb::LimbMap;
use multibody::model::Model;
use multibody::natural::SegmentId;
use multibody::trial::{Sex, Side, Trial};

use crate::number::{plain, short};
use crate::thigh::registration::MeshFrames;

/// Distance of the ASISs of the measured body \[m\] and length of its shank, knee centre to the midpoint of the malleolar tips less the
/// 10 mm by which the tips lie below palpated ones \[m\] (`gait-data/thigh/limb_frames.csv`, notes).
const PELVIS_WIDTH: f64 = 0.2573;
const SHANK_LENGTH: f64 = 0.4146 - 0.010;

/// Gravity for body weights \[m/s²\], the same as in the mechanics.
pub const GRAVITY: f64 = 9.81;

/// How many times as large as the built-in thigh a subject's segments are.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Factors {
    /// Distance of the ASISs.
    pub pelvis: f64,
    /// Hip to knee centre.
    pub thigh: f64,
    /// Knee to ankle centre.
    pub shank: f64,
}

/// Size of the subject of `model` relative to the built-in thigh.
pub fn factors(model: &Model) -> Factors {
    let MeshFrames { hip, knee, .. } = MeshFrames::built_in();
    let length = |segment: SegmentId| model.shapes[segment.index()].L;
    Factors {
        pelvis: model.anatomy.pelvis.width / PELVIS_WIDTH,
        thigh: length(SegmentId::Thigh) / (knee - hip).norm(),
        shank: length(SegmentId::Shank) / SHANK_LENGTH,
    }
}

/// Name or code, sex, mass, height and leg of who was recorded, as every result names them.
pub fn words(trial: &Trial) -> String {
    let leg = match trial.side {
        Side::Right => "right leg",
        Side::Left => "left leg, mirrored",
    };
    format!("{}, {leg}", who(trial))
}

/// Name or code, sex, mass and height of who was recorded.
pub fn who(trial: &Trial) -> String {
    let subject = &trial.subject;
    let sex = match subject.sex {
        Sex::Male => "male",
        Sex::Female => "female",
    };
    format!("{}, {sex}, {} kg, {} m", subject.name, short(subject.mass), plain(subject.height, 2))
}

/// Carries the built-in thigh to that size: segments grow alike in all directions, for girths are seldom known, the pelvis about the
/// hip centre; the posture stays.
pub fn limb_map(factors: &Factors) -> LimbMap {
    let MeshFrames { hip, knee, .. } = MeshFrames::built_in();
    LimbMap::sized(hip, knee, factors.pelvis, factors.thigh, factors.shank)
}
