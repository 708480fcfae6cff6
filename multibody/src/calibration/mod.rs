//! Sources of landmarks; each ends in an [`Anatomy`].

#![allow(non_snake_case)]

pub mod clusters;
pub mod functional;
pub mod knee_centre;
pub mod markers;
pub mod shifts;
pub mod table;

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use crate::anatomy::{Anatomy, Cluster, PelvisAxes};
use crate::natural::{Pose, SegmentId};
use crate::trial::{MarkerTrack, Sex};
use crate::trial_file::{self, HipRule, LandmarkSpec, Landmarks, Roles};
use shifts::Shifts;

/// Where the hip centre is taken from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HipCentre {
    /// Regression of Dumas & Wojtusch 2018 on the pelvis width (`pelvis_centres.csv`).
    Regression,
    /// Harrington et al. 2007, J Biomech 40:595, on pelvis width and depth, as commonly quoted.
    Harrington,
    /// Given, from the midpoint of the ASISs in pelvis axes \[m\].
    Given(Vector3<f64>),
}

/// A named point followed over the frames of a recording; `None` where it was not seen.
pub type Path = Vec<Option<Vector3<f64>>>;

/// Why landmarks cannot be had from a recording.
#[derive(Debug, Error, PartialEq)]
pub enum CalibrationError {
    /// A segment shows fewer than three markers.
    #[error("no frame shows three markers of the {segment} that are not on a line; name more of its markers")]
    Cluster {
        /// Segment.
        segment: &'static str,
    },
    /// A landmark is not seen together with the cluster of its segment.
    #[error(
        "landmark `{landmark}` is never seen together with three markers of the {segment}; \
         check its marker name, or take landmarks from a table"
    )]
    Landmark {
        /// Landmark.
        landmark: &'static str,
        /// Segment.
        segment: &'static str,
    },
    /// The table of landmarks lacks something.
    #[error("{0}")]
    Table(String),
    /// Two landmarks that must be apart are not.
    #[error(
        "landmarks `{a}` and `{b}` are {distance_mm:.1} mm apart, at least {least_mm:.0} mm are needed; \
         does one marker stand for both?"
    )]
    TooClose {
        /// First landmark.
        a: &'static str,
        /// Second landmark.
        b: &'static str,
        /// Distance \[mm\].
        distance_mm: f64,
        /// Least distance \[mm\].
        least_mm: f64,
    },
    /// Too little motion for a functional calibration.
    #[error(
        "the {joint} turns by only {range_deg:.0} degrees in the calibration files; \
         a functional calibration needs at least {needed_deg:.0}"
    )]
    Range {
        /// Joint.
        joint: &'static str,
        /// Range that was found \[deg\].
        range_deg: f64,
        /// Range that is needed \[deg\].
        needed_deg: f64,
    },
}

/// Anatomy from the landmarks that a trial file asks for, each shifted as `shifts` says; with the quality of a functional calibration, which takes
/// knee and ankle axes from motion and has no use for epicondyles and malleoli.
pub fn calibrate(
    spec: &LandmarkSpec,
    sex: Sex,
    shifts: &Shifts,
) -> Result<(Anatomy, Option<functional::Quality>), CalibrationError> {
    let rule = match spec.hip_centre {
        trial_file::HipCentre::By(HipRule::Table) => None,
        trial_file::HipCentre::By(HipRule::Regression) => Some(HipCentre::Regression),
        trial_file::HipCentre::By(HipRule::Harrington) => Some(HipCentre::Harrington),
        trial_file::HipCentre::At(c) => Some(HipCentre::Given(Vector3::from(c))),
    };
    // Only a table of landmarks holds a hip centre; trial files of other sources are refused when they ask for it.
    let without_table = rule.unwrap_or(HipCentre::Harrington);
    let optional = |tracks: &[MarkerTrack], name: &Option<String>| {
        name.as_deref().map(|n| path(tracks, n)).unwrap_or_default()
    };
    let spines = |roles: &Roles, tracks: &[MarkerTrack]| {
        Spines::of(tracks, [&roles.right_asis, &roles.left_asis, &roles.right_psis, &roles.left_psis])
    };
    match &spec.source {
        Landmarks::Table { items, recorded } => table::anatomy(items, recorded, rule, sex, shifts)
            .map(|anatomy| (anatomy, None))
            .map_err(|e| CalibrationError::Table(e.to_string())),
        Landmarks::Markers { roles, tracks } => {
            let landmarks = markers::LandmarkPaths {
                spines: spines(roles, tracks),
                lateral_epicondyle: optional(tracks, &roles.lateral_epicondyle),
                medial_epicondyle: optional(tracks, &roles.medial_epicondyle),
                lateral_malleolus: optional(tracks, &roles.lateral_malleolus),
                medial_malleolus: optional(tracks, &roles.medial_malleolus),
                heel: path(tracks, &roles.heel),
                metatarsal_1: path(tracks, &roles.metatarsal_1),
                metatarsal_5: path(tracks, &roles.metatarsal_5),
            };
            Ok((markers::anatomy(tracks, &landmarks, without_table, sex, shifts)?, None))
        }
        Landmarks::Functional { roles, motions, .. } => {
            let recordings: Vec<functional::Recording> = motions
                .iter()
                .map(|tracks| functional::Recording {
                    tracks: tracks.clone(),
                    spines: spines(roles, tracks),
                    patella: optional(tracks, &roles.patella),
                    heel: path(tracks, &roles.heel),
                    metatarsal_1: path(tracks, &roles.metatarsal_1),
                    metatarsal_5: path(tracks, &roles.metatarsal_5),
                })
                .collect();
            let (anatomy, quality) =
                functional::anatomy(&recordings, without_table, spec.knee_centre, sex, shifts)?;
            Ok((anatomy, Some(quality)))
        }
    }
}

/// The four spines of the pelvis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spines {
    /// Anterior superior iliac spine of the leg under study (right once mirrored).
    pub asis_right: Path,
    /// The other anterior spine.
    pub asis_left: Path,
    /// Posterior spine of the leg under study.
    pub psis_right: Path,
    /// The other posterior spine.
    pub psis_left: Path,
}

impl Spines {
    /// From the paths of four named markers.
    pub fn of(tracks: &[MarkerTrack], names: [&str; 4]) -> Spines {
        let [asis_right, asis_left, psis_right, psis_left] = names.map(|n| path(tracks, n));
        Spines { asis_right, asis_left, psis_right, psis_left }
    }
}

/// Path of a named marker; empty where there is none.
pub fn path(tracks: &[MarkerTrack], name: &str) -> Path {
    tracks.iter().find(|t| t.name == name).map(|t| t.position.clone()).unwrap_or_default()
}

/// Pelvis landmarks in the frame of its cluster.
pub(crate) fn pelvis(
    cluster: &Cluster,
    tracks: &[MarkerTrack],
    spines: &Spines,
    hip: HipCentre,
    sex: Sex,
    shifts: &Shifts,
) -> Result<PelvisAxes, CalibrationError> {
    let local = |path: &Path, landmark, name: &str| {
        clusters::mean_local(cluster, tracks, SegmentId::Pelvis, path, 0..path.len())
            .map(|mean| mean + shifts.of(name))
            .ok_or(CalibrationError::Landmark { landmark, segment: "pelvis" })
    };
    let asis = (
        local(&spines.asis_right, "asis_right", "right_asis")?,
        local(&spines.asis_left, "asis_left", "left_asis")?,
    );
    let psis = (
        local(&spines.psis_right, "psis_right", "right_psis")?,
        local(&spines.psis_left, "psis_left", "left_psis")?,
    );
    apart(("asis_right", &asis.0), ("asis_left", &asis.1), 0.05)?;
    apart(
        ("the midpoint of the ASISs", &(0.5 * (asis.0 + asis.1))),
        ("of the PSISs", &(0.5 * (psis.0 + psis.1))),
        0.05,
    )?;
    let (R, origin) = clusters::pelvis_axes(&asis.0, &asis.1, &psis.0, &psis.1);
    let width = (asis.0 - asis.1).norm();
    let depth = (0.5 * (psis.0 + psis.1) - origin).norm();
    let lumbar = width * crate::tables::pelvis_centre("lumbar", sex_name(sex));
    let hip = hip_centre(hip, width, depth, sex);
    Ok(PelvisAxes {
        u: R.column(0).into(),
        w: R.column(2).into(),
        lumbar: origin + R * lumbar,
        hip: origin + R * hip + shifts.of("hip_centre"),
        width,
        origin,
    })
}

/// Refuses landmarks nearer to each other than `least` \[m\]: axes between them would be noise.
pub(crate) fn apart(
    (a, at_a): (&'static str, &Vector3<f64>),
    (b, at_b): (&'static str, &Vector3<f64>),
    least: f64,
) -> Result<(), CalibrationError> {
    let distance = (at_a - at_b).norm();
    if distance >= least {
        return Ok(());
    }
    Err(CalibrationError::TooClose { a, b, distance_mm: 1e3 * distance, least_mm: 1e3 * least })
}

/// Hip centre of a rule, from the midpoint of the ASISs in pelvis axes \[m\].
pub(crate) fn hip_centre(rule: HipCentre, width: f64, depth: f64, sex: Sex) -> Vector3<f64> {
    match rule {
        HipCentre::Regression => width * crate::tables::pelvis_centre("hip_right", sex_name(sex)),
        HipCentre::Harrington => harrington(width, depth),
        HipCentre::Given(c) => c,
    }
}

fn sex_name(sex: Sex) -> &'static str {
    match sex {
        Sex::Male => "male",
        Sex::Female => "female",
    }
}

/// Hip centre of Harrington et al. from the midpoint of the ASISs in pelvis axes \[m\]; `width` of the ASISs and `depth` between the midpoints of
/// ASISs and PSISs \[m\].
pub fn harrington(width: f64, depth: f64) -> Vector3<f64> {
    Vector3::new(-0.24 * depth - 0.0099, -0.30 * width - 0.0109, 0.33 * width + 0.0073)
}

/// Pose of a frame given by axes and origin, inverse applied to a point.
pub(crate) fn into_local(pose: &Pose, point: &Vector3<f64>) -> Vector3<f64> {
    pose.R.transpose() * (point - pose.p)
}

/// Relative pose of `b` in `a`.
pub(crate) fn relative(a: &Pose, b: &Pose) -> (Matrix3<f64>, Vector3<f64>) {
    (a.R.transpose() * b.R, into_local(a, &b.p))
}
