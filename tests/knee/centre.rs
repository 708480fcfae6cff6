//! The knee centre of a functional calibration: on sliding skin, and on the subject whose knee centre is tabulated.

#![allow(non_snake_case)]

use multibody::anatomy::{Anatomy, ThighAxes, lay_over};
use multibody::calibration::clusters::pose;
use multibody::calibration::functional::{self, Recording};
use multibody::calibration::knee_centre::{DISTANCE, HEIGHT, KneeCentre};
use multibody::calibration::shifts::Shifts;
use multibody::calibration::{HipCentre, Path, Spines, calibrate, path};
use multibody::kinematics::zxy_angles;
use multibody::natural::{Pose, SegmentId};
use multibody::trial::{MarkerTrack, Sex, Trial};
use multibody::trial_file::{KneeRule, TrialFile};
use multibody::walker::{Knee, walker};
use nalgebra::Vector3;
use support::{shared, shipped_trial};

const HIP: Vector3<f64> = Vector3::new(-0.07797, -0.09088, 0.07376);

/// Error of the knee centre in axes of the thigh of `truth` \[m\]: forward, up, to the right along the axis.
fn error(found: &Anatomy, truth: &Anatomy) -> Vector3<f64> {
    let (ours, theirs) =
        (&truth.clusters[SegmentId::Thigh.index()], &found.clusters[SegmentId::Thigh.index()]);
    let pairs: Vec<_> = (ours.names.iter().zip(&ours.points))
        .map(|(name, point)| (theirs.points[theirs.names.iter().position(|n| n == name).unwrap()], *point))
        .collect();
    let Pose { R, p } = lay_over(&pairs).unwrap();
    p + R * found.thigh.knee - truth.thigh.knee
}

/// The built-in walker with a patella marker on the bone, and skin of the thigh that slides by `slide` \[m\] (forward, up) at 60 degrees of knee flexion, in
/// proportion to it.
fn sliding(slide: [f64; 2]) -> (Recording, Anatomy) {
    let (trial, anatomy) = walker(Knee::Hinge);
    let cluster = |s: SegmentId| &anatomy.clusters[s.index()];
    let posed = |trial: &Trial, s: SegmentId, k: usize| pose(cluster(s), &trial.markers, s, k).unwrap();
    let Anatomy { thigh: ThighAxes { knee, w }, .. } = anatomy;
    // The hip is the origin of the walker's thigh.
    let forward = (-knee).cross(&w).normalize();
    let up = w.cross(&forward).normalize();
    let patella_local = knee + knee.norm() * (DISTANCE * forward - HEIGHT * up);
    let mut tracks: Vec<MarkerTrack> = trial.markers.clone();
    let mut patella = Path::new();
    for k in 0..trial.time.len() {
        let (thigh, shank) = (posed(&trial, SegmentId::Thigh, k), posed(&trial, SegmentId::Shank, k));
        let flexion = -zxy_angles(&(thigh.R.transpose() * shank.R)).0;
        patella.push(Some(thigh.p + thigh.R * patella_local));
        let part = flexion.to_degrees() / 60.0;
        let moved = thigh.R * Vector3::new(slide[0] * part, slide[1] * part, 0.0);
        for track in tracks.iter_mut().filter(|t| t.segment == SegmentId::Thigh) {
            if let Some(p) = &mut track.position[k] {
                *p += moved;
            }
        }
    }
    let recording = Recording {
        spines: Spines::of(&tracks, ["right ASIS", "left ASIS", "right PSIS", "left PSIS"]),
        patella,
        heel: path(&tracks, "heel"),
        metatarsal_1: path(&tracks, "metatarsal head 1"),
        metatarsal_5: path(&tracks, "metatarsal head 5"),
        tracks,
    };
    (recording, anatomy)
}

#[test]
fn skin_that_slides_moves_the_centre_by_less_than_5_mm() {
    let along = [-0.025, -0.018, -0.010, 0.0, 0.010, 0.018, 0.025].map(|s| [0.0, s]);
    let across = [-0.025, -0.010, 0.010, 0.025].map(|s| [s, 0.0]);
    for slide in along.into_iter().chain(across) {
        let (recording, truth) = sliding(slide);
        let found = |rule| {
            let recordings = std::slice::from_ref(&recording);
            functional::anatomy(recordings, HipCentre::Given(HIP), rule, Sex::Male, &Shifts::none()).unwrap()
        };
        let (as_found, _) = found(KneeCentre::AsFound);
        let (corrected, quality) = found(KneeCentre::ByPatella(None));
        let flat = |e: Vector3<f64>| 1e3 * e.xy().norm();
        let (before, after) = (flat(error(&as_found, &truth)), flat(error(&corrected, &truth)));
        println!("slide {slide:?} m: {before:5.1} mm before, {after:4.1} mm after");
        assert!(after < 5.0, "slide {slide:?}: {after}");
        if slide[0].hypot(slide[1]) >= 0.018 {
            assert!(
                before > 10.0,
                "slide {slide:?}: without correction the centre is off by {before} mm only"
            );
        }
        // The correction that is reported is the one that was made.
        let said = quality.knee_centre.unwrap();
        let made = (corrected.thigh.knee - as_found.thigh.knee).norm();
        assert!((said.moved[0].hypot(said.moved[1]) - made).abs() < 1e-4, "{said:?} {made}");
        assert!(said.is_plausible());
    }
}

/// A marker that is not on the patella asks for more than skin explains.
#[test]
fn a_marker_elsewhere_is_noticed() {
    let (mut recording, _) = sliding([0.0, 0.0]);
    recording.patella =
        recording.patella.iter().map(|p| p.map(|p| p + Vector3::new(0.0, 0.06, 0.0))).collect();
    let rule = KneeCentre::ByPatella(None);
    let (_, quality) =
        functional::anatomy(&[recording], HipCentre::Given(HIP), rule, Sex::Male, &Shifts::none()).unwrap();
    assert!(!quality.knee_centre.unwrap().is_plausible());
}

#[test]
fn a_distance_of_the_subject_is_kept() {
    let (recording, _) = sliding([0.0, 0.015]);
    let rule = KneeCentre::ByPatella(Some(0.060));
    let (_, quality) =
        functional::anatomy(&[recording], HipCentre::Given(HIP), rule, Sex::Male, &Shifts::none()).unwrap();
    let said = quality.knee_centre.unwrap();
    assert_eq!(said.distance, 0.060);
}

/// Subject DM, whose knee centre stands in a table: calibrated from motion, as if there were no table, from every recording alone and from
/// all of them.
#[test]
fn on_subject_dm_the_centre_comes_nearer_to_the_table() {
    let Some(data) = shared("gait") else { return };
    let shipped = shipped_trial("DM_ngait_og3");
    let table = TrialFile::read(&shipped).unwrap();
    let (truth, _) = calibrate(&table.landmarks(Some(&data)).unwrap(), Sex::Male, &Shifts::none()).unwrap();
    let text = std::fs::read_to_string(&shipped).unwrap();
    let (head, tail) = text.split_once("[landmarks]").unwrap();
    let (_, tail) = tail.split_once("[filter]").unwrap();
    let of = |motions: &[&str], rule: KneeRule| {
        let files: Vec<String> = motions.iter().map(|m| format!("\"dm/DM_ngait_{m}_new.trc\"")).collect();
        let landmarks = format!(
            "[landmarks]\nsource = \"functional\"\nmotions = [{}]\nhip_centre = [-0.07797, -0.09088, 0.07376]\nknee_centre = \"{}\"\n\
             right_asis = \"R_Asis\"\nleft_asis = \"L_Asis\"\nright_psis = \"R_Psis\"\nleft_psis = \"L_Psis\"\npatella = \"R_Patella\"\n\
             heel = \"R_Heel\"\nmetatarsal_1 = \"R_Midfoot_Medial\"\nmetatarsal_5 = \"R_Midfoot_Lateral\"\n\n[filter]",
            files.join(", "),
            if rule == KneeRule::Patella { "patella" } else { "functional" }
        );
        let file = TrialFile::parse(&shipped, format!("{head}{landmarks}{tail}").as_bytes()).unwrap();
        let (found, _) =
            calibrate(&file.landmarks(Some(&data)).unwrap(), Sex::Male, &Shifts::none()).unwrap();
        error(&found, &truth)
    };
    let mut mean = Vector3::zeros();
    let mut left = Vec::new();
    for motions in [&["og1"][..], &["og3"], &["og4"], &["og1", "og3", "og4"]] {
        let (before, after) = (of(motions, KneeRule::Functional), of(motions, KneeRule::Patella));
        let mm = |e: Vector3<f64>| format!("{:.1} forward, {:.1} up", 1e3 * e.x, 1e3 * e.y);
        println!("{motions:?}: {} mm before, {} mm after", mm(before), mm(after));
        assert!(before.x > 8e-3 && before.y > 8e-3, "{motions:?}: {before}");
        left.push((motions, after.xy().norm()));
        if motions.len() == 1 {
            mean += after / 3.0;
        }
    }
    // Distance and height are the means of this subject: on average over its recordings nothing is left.
    println!("mean {:.2} forward, {:.2} up", 1e3 * mean.x, 1e3 * mean.y);
    assert!(left.iter().all(|l| l.1 < 5e-3), "{left:?}");
    assert!(mean.xy().amax() < 0.2e-3, "{mean}");
}
