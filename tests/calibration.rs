//! Does each source of landmarks find the landmarks that the markers were made with?

#![allow(non_snake_case)]

use multibody::anatomy::{Anatomy, lay_over};
use multibody::calibration::clusters::pose;
use multibody::calibration::functional::{self, Recording};
use multibody::calibration::knee_centre::KneeCentre;
use multibody::calibration::markers::{self, LandmarkPaths};
use multibody::calibration::shifts::Shifts;
use multibody::calibration::{CalibrationError, HipCentre, Path, Spines, path, table};
use multibody::natural::{Pose, SegmentId};
use multibody::trial::{Sex, Trial};
use multibody::walker::{Knee, shifted, walker};
use nalgebra::Vector3;

const SPINES: [&str; 4] = ["right ASIS", "left ASIS", "right PSIS", "left PSIS"];

/// The built-in walker with the path of every landmark of its table.
struct Walker {
    trial: Trial,
    anatomy: Anatomy,
    items: Vec<table::TableItem>,
}

impl Walker {
    fn new() -> Walker {
        let (trial, anatomy) = walker(Knee::Hinge);
        let items = table::read(include_str!("../gait-data/reference_subject.csv")).unwrap();
        Walker { trial, anatomy, items }
    }

    fn local(&self, segment: SegmentId, item: &str) -> Vector3<f64> {
        self.items.iter().find(|i| i.segment == segment && i.item == item).unwrap().position
    }

    /// A landmark carried by its segment.
    fn path(&self, segment: SegmentId, item: &str) -> Path {
        let local = self.local(segment, item);
        let cluster = &self.anatomy.clusters[segment.index()];
        (0..self.trial.time.len())
            .map(|k| pose(cluster, &self.trial.markers, segment, k).map(|Pose { R, p }| p + R * local))
            .collect()
    }

    fn spines(&self) -> Spines {
        Spines::of(&self.trial.markers, SPINES)
    }

    fn landmarks(&self) -> LandmarkPaths {
        use SegmentId::{Foot, Shank, Thigh};
        LandmarkPaths {
            spines: self.spines(),
            lateral_epicondyle: self.path(Thigh, "lateral epicondyle"),
            medial_epicondyle: self.path(Thigh, "medial epicondyle"),
            lateral_malleolus: self.path(Shank, "lateral malleolus"),
            medial_malleolus: self.path(Shank, "medial malleolus"),
            heel: self.path(Foot, "heel"),
            metatarsal_1: self.path(Foot, "metatarsal head 1"),
            metatarsal_5: self.path(Foot, "metatarsal head 5"),
        }
    }

    /// A point of another anatomy's cluster frame, in the frame of the table.
    fn in_table(&self, other: &Anatomy, segment: SegmentId) -> Pose {
        let (ours, theirs) = (&self.anatomy.clusters[segment.index()], &other.clusters[segment.index()]);
        let pairs: Vec<_> = ours
            .names
            .iter()
            .zip(&ours.points)
            .map(|(name, point)| {
                let k = theirs.names.iter().position(|n| n == name).unwrap();
                (theirs.points[k], *point)
            })
            .collect();
        lay_over(&pairs).unwrap()
    }
}

const HIP: Vector3<f64> = Vector3::new(-0.07797, -0.09088, 0.07376);

#[test]
fn landmark_markers_give_the_landmarks_of_the_table() {
    let w = Walker::new();
    let found =
        markers::anatomy(&w.trial.markers, &w.landmarks(), HipCentre::Given(HIP), Sex::Male, &Shifts::none())
            .unwrap();
    // Points of the table are rounded to 0.01 mm.
    let close = |segment, point: &Vector3<f64>, want: &Vector3<f64>| {
        let Pose { R, p } = w.in_table(&found, segment);
        let distance = (p + R * point - want).norm();
        assert!(distance < 2e-5, "{segment:?}: {distance}");
    };
    close(SegmentId::Pelvis, &found.pelvis.hip, &w.anatomy.pelvis.hip);
    close(SegmentId::Pelvis, &found.pelvis.lumbar, &w.anatomy.pelvis.lumbar);
    close(SegmentId::Thigh, &found.thigh.knee, &w.anatomy.thigh.knee);
    close(SegmentId::Shank, &found.shank.ankle, &w.anatomy.shank.ankle);
    close(SegmentId::Foot, &found.foot.ankle, &Vector3::zeros());
    let turn = |segment, direction: &Vector3<f64>, want: &Vector3<f64>| {
        let angle = (w.in_table(&found, segment).R * direction).angle(want).to_degrees();
        assert!(angle < 0.05, "{segment:?}: {angle} degrees");
    };
    turn(SegmentId::Thigh, &found.thigh.w, &w.anatomy.thigh.w);
    turn(SegmentId::Foot, &found.foot.u, &w.anatomy.foot.u);
    turn(SegmentId::Foot, &found.foot.w, &w.anatomy.foot.w);
    turn(SegmentId::Shank, &found.shank.w, &w.anatomy.shank.w);
}

/// A landmark that is shifted in the table, and one whose marker was recorded where it is shifted to, give the same leg.
#[test]
fn shifted_landmarks_are_those_of_shifted_markers() {
    let w = Walker::new();
    let mut shifts = Shifts::none();
    let mut random = support::Random::new(11);
    let mut markers = w.landmarks();
    let hip = HIP + random.vector(5e-3);
    shifts.add("hip_centre", hip - HIP);
    let mut shift = |name: &str, segment: SegmentId, path: &mut Path| {
        let shift = random.vector(10e-3);
        assert!(shifts.add(name, shift));
        for (k, point) in path.iter_mut().enumerate() {
            let at = pose(&w.anatomy.clusters[segment.index()], &w.trial.markers, segment, k);
            *point = point.zip(at).map(|(p, Pose { R, .. })| p + R * shift);
        }
    };
    shift("lateral_epicondyle", SegmentId::Thigh, &mut markers.lateral_epicondyle);
    shift("medial_epicondyle", SegmentId::Thigh, &mut markers.medial_epicondyle);
    shift("lateral_malleolus", SegmentId::Shank, &mut markers.lateral_malleolus);
    shift("medial_malleolus", SegmentId::Shank, &mut markers.medial_malleolus);
    shift("heel", SegmentId::Foot, &mut markers.heel);
    shift("metatarsal_1", SegmentId::Foot, &mut markers.metatarsal_1);
    shift("metatarsal_5", SegmentId::Foot, &mut markers.metatarsal_5);
    let ours = shifted(&shifts).unwrap();
    let found =
        markers::anatomy(&w.trial.markers, &markers, HipCentre::Given(hip), Sex::Male, &Shifts::none())
            .unwrap();
    let close = |segment, point: &Vector3<f64>, want: &Vector3<f64>| {
        let Pose { R, p } = w.in_table(&found, segment);
        let distance = (p + R * point - want).norm();
        assert!(distance < 2e-5, "{segment:?}: {distance}");
    };
    close(SegmentId::Pelvis, &found.pelvis.hip, &ours.pelvis.hip);
    close(SegmentId::Thigh, &found.thigh.knee, &ours.thigh.knee);
    close(SegmentId::Shank, &found.shank.ankle, &ours.shank.ankle);
    let turn = |segment, direction: &Vector3<f64>, want: &Vector3<f64>| {
        let angle = (w.in_table(&found, segment).R * direction).angle(want).to_degrees();
        assert!(angle < 0.05, "{segment:?}: {angle} degrees");
    };
    turn(SegmentId::Thigh, &found.thigh.w, &ours.thigh.w);
    turn(SegmentId::Shank, &found.shank.w, &ours.shank.w);
    turn(SegmentId::Foot, &found.foot.u, &ours.foot.u);
    turn(SegmentId::Foot, &found.foot.w, &ours.foot.w);
    // They did move, and none did for no shift.
    assert!((ours.thigh.knee - w.anatomy.thigh.knee).norm() > 1e-3);
    assert_eq!(shifted(&Shifts::none()).unwrap(), w.anatomy);
    // The pelvis turns with its spines: raising the right one by 10 mm turns it by that over the width.
    let mut raised = Shifts::none();
    raised.add("right_asis", Vector3::new(0.0, 0.01, 0.0));
    raised.add("right_psis", Vector3::new(0.0, 0.01, 0.0));
    let turned = shifted(&raised).unwrap();
    let wanted = (0.01 / w.anatomy.pelvis.width).atan();
    assert!((turned.pelvis.w.angle(&w.anatomy.pelvis.w) - wanted).abs() < 1e-3 * wanted);
}

#[test]
fn one_marker_for_two_landmarks_is_refused() {
    let w = Walker::new();
    let mut landmarks = w.landmarks();
    landmarks.medial_epicondyle = landmarks.lateral_epicondyle.clone();
    let error =
        markers::anatomy(&w.trial.markers, &landmarks, HipCentre::Given(HIP), Sex::Male, &Shifts::none())
            .unwrap_err();
    assert!(matches!(error, CalibrationError::TooClose { a: "lateral_epicondyle", .. }), "{error}");
}

#[test]
fn the_functional_knee_axis_is_the_hinge_of_the_walker() {
    let w = Walker::new();
    let recording = Recording {
        tracks: w.trial.markers.clone(),
        spines: w.spines(),
        patella: Path::new(),
        heel: path(&w.trial.markers, "heel"),
        metatarsal_1: path(&w.trial.markers, "metatarsal head 1"),
        metatarsal_5: path(&w.trial.markers, "metatarsal head 5"),
    };
    let (found, quality) = functional::anatomy(
        &[recording],
        HipCentre::Given(HIP),
        KneeCentre::AsFound,
        Sex::Male,
        &Shifts::none(),
    )
    .unwrap();
    // The walker's adduction and rotation vary by some hundredths of a degree around its hinge.
    let Pose { R, p } = w.in_table(&found, SegmentId::Thigh);
    let axis = R * found.thigh.w;
    assert!(axis.angle(&w.anatomy.thigh.w).to_degrees() < 1.0, "{axis}");
    let gap = p + R * found.thigh.knee - w.anatomy.thigh.knee;
    let off_axis = gap - axis * gap.dot(&axis);
    assert!(off_axis.norm() < 2e-3, "{off_axis}");
    assert!(quality.knee_rms < 1e-3 && quality.knee_range.to_degrees() > 50.0, "{quality:?}");
}

#[test]
fn a_stiff_knee_cannot_be_calibrated() {
    let w = Walker::new();
    // Ten frames of mid-stance: the knee hardly moves.
    let mut tracks = w.trial.markers.clone();
    let frames = w.trial.report.start + 30..w.trial.report.start + 40;
    tracks.iter_mut().for_each(|t| t.position = t.position[frames.clone()].to_vec());
    let recording = Recording {
        spines: Spines::of(&tracks, SPINES),
        patella: Path::new(),
        heel: path(&tracks, "heel"),
        metatarsal_1: path(&tracks, "metatarsal head 1"),
        metatarsal_5: path(&tracks, "metatarsal head 5"),
        tracks,
    };
    let error = functional::anatomy(
        &[recording],
        HipCentre::Given(HIP),
        KneeCentre::AsFound,
        Sex::Male,
        &Shifts::none(),
    )
    .unwrap_err();
    assert!(matches!(error, CalibrationError::Range { joint: "knee", .. }), "{error}");
}

/// Lines are counted as an editor does, whatever they end with.
#[test]
fn a_table_of_landmarks_is_told_of_by_its_lines() {
    let text = "item,kind,segment,x_or_value,y,z\na,landmark,thigh,0,0,0\nb,landmark,leg,0,0,0\n";
    for text in [text.to_string(), text.replace('\n', "\r\n")] {
        let said = table::read(&text).unwrap_err();
        assert!(
            matches!(&said, table::TableError::Row { line: 3, what } if what.contains("`leg`")),
            "{said}"
        );
    }
}
