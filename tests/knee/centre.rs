//! The knee centre of a functional calibration: on sliding skin, and on the subject whose knee centre is tabulated.

#![allow(non_snake_case)]

use multibody::anatomy::{Anatomy, lay_over};
use multibody::calibration::clusters::pose;
use multibody::calibration::functional::{self, Recording};
use multibody::calibration::knee_centre::{DISTANCE, KneeCentre};
use multibody::calibration::{HipCentre, Path, Spines, calibrate, path};
use multibody::kinematics::zxy_angles;
use multibody::natural::{Pose, SegmentId};
use multibody::trial::{MarkerTrack, Sex, Trial};
use multibody::trial_file::{KneeRule, TrialFile};
use multibody::walker::{Knee, walker};
use nalgebra::Vector3;
use support::shared;

const HIP: Vector3<f64> = Vector3::new(-0.07797, -0.09088, 0.07376);

/// Error of the knee centre in axes of the thigh of `truth` \[m\]: forward, up, to the right along the axis.
fn error(found: &Anatomy, truth: &Anatomy) -> Vector3<f64> {
    let (ours, theirs) = (&truth.clusters[SegmentId::Thigh.index()], &found.clusters[SegmentId::Thigh.index()]);
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
    let leg = anatomy.thigh.knee.norm() + anatomy.shank.ankle.norm();
    let patella_local = anatomy.thigh.knee + Vector3::new(DISTANCE * leg, -0.005, 0.0);
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
fn skin_that_slides_along_the_thigh_moves_the_centre_by_less_than_5_mm() {
    for slide in [-0.025, -0.018, -0.010, 0.0, 0.010, 0.018, 0.025] {
        let (recording, truth) = sliding([0.0, slide]);
        let found = |rule| {
            let recordings = std::slice::from_ref(&recording);
            functional::anatomy(recordings, HipCentre::Given(HIP), rule, Sex::Male).unwrap()
        };
        let (as_found, _) = found(KneeCentre::AsFound);
        let (corrected, quality) = found(KneeCentre::ByPatella(None));
        let flat = |e: Vector3<f64>| e.xy().norm();
        let (before, after) = (error(&as_found, &truth), error(&corrected, &truth));
        println!("slide {:5.1} mm: {:5.1} mm before, {:4.1} mm after", 1e3 * slide, 1e3 * flat(before), 1e3 * flat(after));
        assert!(flat(after) < 5e-3, "slide {slide}: {after}");
        if slide.abs() >= 0.018 {
            assert!(flat(before) > 10e-3, "slide {slide}: without correction the centre is off by {before}");
        }
        // The correction that is reported is the one that was made.
        let said = quality.knee_centre.unwrap();
        let made = (corrected.thigh.knee - as_found.thigh.knee).norm();
        assert!((said.moved().abs() - made).abs() < 1e-3, "{said:?} {made}");
    }
}

/// Slides across the thigh move the axis along it: forward the centre stays right, up it does not. The page of limits says so.
#[test]
fn skin_that_slides_across_the_thigh_is_corrected_forward_only() {
    for slide in [0.010, 0.018] {
        let (recording, truth) = sliding([slide, 0.0]);
        let (found, _) =
            functional::anatomy(&[recording], HipCentre::Given(HIP), KneeCentre::ByPatella(None), Sex::Male).unwrap();
        let off = error(&found, &truth);
        assert!(off.x.abs() < 5e-3 && off.y.abs() > 0.5 * slide, "slide {slide}: {off}");
    }
}

#[test]
fn a_distance_of_the_subject_is_kept() {
    let (recording, _) = sliding([0.0, 0.015]);
    let rule = KneeCentre::ByPatella(Some(0.060));
    let (_, quality) = functional::anatomy(&[recording], HipCentre::Given(HIP), rule, Sex::Male).unwrap();
    let said = quality.knee_centre.unwrap();
    assert_eq!(said.distance, 0.060);
}

/// Subject DM, whose knee centre stands in a table: calibrated from motion, as if there were no table, from every recording alone and from
/// all of them.
#[test]
fn on_subject_dm_the_centre_comes_nearer_to_the_table() {
    let Some(data) = shared("gait") else { return };
    let shipped = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../gait-data/trials/DM_ngait_og3.toml");
    let table = TrialFile::read(&shipped).unwrap();
    let (truth, _) = calibrate(&table.landmarks(Some(&data)).unwrap(), Sex::Male).unwrap();
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
        let (found, _) = calibrate(&file.landmarks(Some(&data)).unwrap(), Sex::Male).unwrap();
        error(&found, &truth)
    };
    for motions in [&["og1"][..], &["og3"], &["og4"], &["og1", "og3", "og4"]] {
        let (before, after) = (of(motions, KneeRule::Functional), of(motions, KneeRule::Patella));
        let mm = |e: Vector3<f64>| format!("{:.1} forward, {:.1} up", 1e3 * e.x, 1e3 * e.y);
        println!("{motions:?}: {} mm before, {} mm after", mm(before), mm(after));
        assert!(before.x > 8e-3 && after.x.abs() < 4e-3, "{motions:?}: {before} {after}");
        assert!(after.xy().norm() < before.xy().norm() - 3e-3, "{motions:?}");
    }
}
