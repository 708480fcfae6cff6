//! Does a trial file give the trial that was recorded, and name the mistake when something is wrong?

use std::collections::BTreeMap;
use std::path::Path;

use multibody::InputError;
use multibody::anatomy::Anatomy;
use multibody::calibration::shifts::Shifts;
use multibody::calibration::{calibrate, functional};
use multibody::error::Place;
use multibody::natural::SegmentId;
use multibody::read::c3d;
use multibody::trial::{MarkerTrack, Sex, Side, Trial};
use multibody::trial_file::{Landmarks, TrialFile};
use multibody::walker::{Knee, walker};
use nalgebra::Vector3;
use support::c3d_file::C3dFile;
use support::walking::{LEFT_PLATE, RIGHT_PLATE, Walking};
use support::{sartorius, shared, shipped_trial};

const SHIPPED: [&str; 5] = ["DM_ngait_og3", "DM_ngait_og4", "jw_ngait_og1", "jw_ngait_og3", "jw_ngait_og7"];

/// The error of a walking recording after one change.
fn error_of(change: impl FnOnce(&mut Walking)) -> InputError {
    let mut walking = Walking::new();
    change(&mut walking);
    walking.load().expect_err("the change should have been noticed")
}

/// The error must be of this kind, and its message hold all the words.
macro_rules! refused {
    ($error:expr, $kind:pat, $($word:expr),+) => {{
        let error = $error;
        let message = error.to_string();
        assert!(matches!(error, $kind), "{error:?}");
        $(assert!(message.contains($word), "`{}` is not in: {message}", $word);)+
    }};
}

/// Largest distance of two sets of paths \[m\]; gaps must agree.
fn distance(a: &[MarkerTrack], b: &[MarkerTrack]) -> f64 {
    assert_eq!(a.len(), b.len());
    let pairs = a.iter().zip(b).flat_map(|(a, b)| a.position.iter().zip(&b.position));
    pairs.fold(0.0, |largest: f64, pair| match pair {
        (Some(p), Some(q)) => largest.max((p - q).norm()),
        (None, None) => largest,
        other => panic!("{other:?}"),
    })
}

fn assert_same(a: &Trial, b: &Trial, metres: f64, newton_metres: f64) {
    assert_eq!(a.report, b.report);
    assert!(distance(&a.markers, &b.markers) < metres, "{}", distance(&a.markers, &b.markers));
    for i in 0..a.ground.time.len() {
        assert!((a.ground.force[i] - b.ground.force[i]).norm() < newton_metres, "sample {i}");
        assert!((a.ground.moment[i] - b.ground.moment[i]).norm() < newton_metres, "sample {i}");
    }
}

mod both_legs;
mod keys;
mod markers;
mod recorded;
mod time_and_forces;
