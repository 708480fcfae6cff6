//! Every key of the trial file.

use crate::keys::Kind::{
    Count, Counts, Either, File, Files, Flag, Map, Names, Number, Section, Sections, Text, Texts, Vector,
    Word,
};
use crate::keys::Need::{Default, Optional, Required};
use crate::keys::{Key, key};

const AXIS: crate::keys::Kind = Word(&["x", "y", "z", "-x", "-y", "-z"]);
const LENGTH: crate::keys::Kind = Word(&["m", "cm", "mm"]);

/// One row per field of [`super::TrialFile`] and what is in it; a test compares them.
#[rustfmt::skip]
pub const KEYS: &[Key] = &[
    key("motion", File, Required, "", "Recording with the markers, C3D or TRC, below the folder of this file or of --data", "\"walk.c3d\""),
    key("units", LENGTH, Optional("as the recording says"), "", "Unit of length of the recording where the one it claims is wrong", "\"mm\""),
    key("zeros_missing", Flag, Default("false"), "", "Markers at exactly 0, 0, 0 were not seen: how some programs write a gap", "true"),

    key("axes", Section, Optional("x forward, y up, z right"), "", "Which axes of the recordings point forward (direction of walking), up, and to the right", ""),
    key("axes.x", AXIS, Required, "", "Axis of the recording that points forward", "\"x\""),
    key("axes.y", AXIS, Required, "", "Axis of the recording that points up", "\"y\""),
    key("axes.z", AXIS, Required, "", "Axis of the recording that points to the right of the walker", "\"z\""),

    key("subject", Section, Required, "", "Who was recorded", ""),
    key("subject.name", Text, Required, "", "Name or code of the subject", "\"S01\""),
    key("subject.mass_kg", Number(10.0, 400.0), Required, "kg", "Body mass in kg", "70.0"),
    key("subject.height_m", Number(0.5, 2.6), Required, "m", "Standing height in m", "1.72"),
    key("subject.sex", Word(&["male", "female"]), Required, "", "Selects the tables of segment mass and inertia", "\"female\""),
    key("subject.side", Word(&["right", "left"]), Required, "", "Leg under study; a left leg is mirrored, so results are always those of a right leg", "\"right\""),

    key("range", Section, Required, "", "Part of the recording that is reported: a cycle, or start_s and end_s", ""),
    key("range.cycle", Count(1, 1000), Optional("start_s and end_s are given"), "", "The n-th gait cycle from heel strike to heel strike on the named plates; cycles count from 1", "1"),
    key("range.start_s", Number(f64::MIN, f64::MAX), Optional("cycle is given"), "s", "First time that is reported, on the clock of the recording", "1.25"),
    key("range.end_s", Number(f64::MIN, f64::MAX), Optional("cycle is given"), "s", "Last time that is reported", "2.5"),

    key("force", Section, Required, "", "Ground reaction: force plates of the C3D file, or columns of a table", ""),
    key("force.file", File, Optional("the force plates of the C3D file"), "", "Table with the forces over time: STO, MOT or CSV", "\"walk_grf.sto\""),
    key("force.plates", Counts(1, 1000), Required, "", "Numbers of the plates that the foot under study steps on", "[1]"),
    key("force.next_plate", Count(1, 1000), Optional("the next step is not on a plate"), "", "Plate of the next step of the same foot: its heel strike ends the cycle", "2"),
    key("force.on_plate", Flag, Default("false"), "", "The recording holds the force of the foot on the plate instead of that of the plate on the foot", "true"),
    key("force.axes", Section, Optional("those of the markers"), "", "Axes of the force table where they differ from those of the markers", ""),
    key("force.axes.x", AXIS, Required, "", "Axis of the force table that points forward", "\"x\""),
    key("force.axes.y", AXIS, Required, "", "Axis of the force table that points up", "\"y\""),
    key("force.axes.z", AXIS, Required, "", "Axis of the force table that points to the right", "\"z\""),
    key("force.columns", Sections, Optional("the forces are in the C3D file"), "", "Columns of the force table, once for each plate named", ""),
    key("force.columns.plate", Count(1, 1000), Required, "", "Number of the plate", "1"),
    key("force.columns.force", Names, Required, "N", "Columns of the force on the foot along x, y, z of the table", "[\"ground_force_1_vx\", \"ground_force_1_vy\", \"ground_force_1_vz\"]"),
    key("force.columns.point", Names, Required, "m", "Columns of the point where it acts", "[\"ground_force_1_px\", \"ground_force_1_py\", \"ground_force_1_pz\"]"),
    key("force.columns.moment", Names, Optional("no moment about that point"), "N·m", "Columns of the moment about that point", "[\"ground_torque_1_x\", \"ground_torque_1_y\", \"ground_torque_1_z\"]"),

    key("markers", Section, Required, "", "Markers that move with each segment of the leg, three or more of each; names as in the recording, with or without its prefix (`JW:`)", ""),
    key("markers.pelvis", Texts, Required, "", "Markers on the pelvis", "[\"RASI\", \"LASI\", \"RPSI\", \"LPSI\"]"),
    key("markers.thigh", Texts, Required, "", "Markers on the thigh", "[\"RTHI\", \"RKNE\", \"RKNM\"]"),
    key("markers.shank", Texts, Required, "", "Markers on the shank; none on the patella, which moves by itself", "[\"RTIB\", \"RANK\", \"RANM\"]"),
    key("markers.foot", Texts, Required, "", "Markers on the foot; none on the toes, which move against it", "[\"RHEE\", \"RTOE\", \"RMT5\"]"),

    key("landmarks", Section, Required, "", "Where joint centres and bony landmarks come from", ""),
    key("landmarks.source", Word(&["table", "markers", "functional"]), Required, "", "A table of local coordinates, markers on the landmarks, or functional calibration of knee and ankle from motion", "\"markers\""),
    key("landmarks.hip_centre", Either(&[Word(&["table", "regression", "harrington"]), Vector]), Optional("\"table\" with a table, else \"harrington\""), "m", "Hip centre: that of the table, a rule, or three numbers from the midpoint of the ASISs: forward, up, towards the leg", "\"harrington\""),
    key("landmarks.knee_centre", Word(&["patella", "functional"]), Optional("\"patella\" with source = \"functional\", else not used"), "", "Knee centre of a functional calibration: corrected by the patella marker, because skin that slides moves the axis, or on the axis as found", "\"patella\""),
    key("landmarks.patella_distance_mm", Number(30.0, 120.0), Optional("0.1776 lengths of the thigh"), "mm", "From the knee centre to the patella marker along the forward axis of the thigh, knee straight, where it was measured on the subject", "70.0"),
    key("landmarks.table", File, Optional("needed by source = \"table\" alone"), "", "Table of local coordinates (CSV), also looked for in a folder `subjects` beside that of this file", "\"DM.csv\""),
    key("landmarks.rename", Map, Optional("names of the table are those of the markers"), "", "Item of the table = recorded marker, where the names differ", "\"right ASIS\" = \"RASI\""),
    key("landmarks.static", File, Optional("the landmark markers are in `motion`"), "", "Standing trial with the landmark markers (source = \"markers\")", "\"standing.c3d\""),
    key("landmarks.motions", Files, Optional("needed by source = \"functional\" alone"), "", "Recordings for the functional calibration; knee and ankle must turn by 15 degrees", "[\"walk1.c3d\", \"walk2.c3d\"]"),
    key("landmarks.right_asis", Text, Optional("not used with a table"), "", "Marker on the right anterior superior iliac spine", "\"RASI\""),
    key("landmarks.left_asis", Text, Optional("not used with a table"), "", "Marker on the left anterior superior iliac spine", "\"LASI\""),
    key("landmarks.right_psis", Text, Optional("not used with a table"), "", "Marker on the right posterior superior iliac spine; one on the sacrum stands for both", "\"RPSI\""),
    key("landmarks.left_psis", Text, Optional("not used with a table"), "", "Marker on the left posterior superior iliac spine", "\"LPSI\""),
    key("landmarks.lateral_epicondyle", Text, Optional("needed by source = \"markers\" alone"), "", "Marker on the outer epicondyle of the femur", "\"RKNE\""),
    key("landmarks.medial_epicondyle", Text, Optional("needed by source = \"markers\" alone"), "", "Marker on the inner epicondyle of the femur", "\"RKNM\""),
    key("landmarks.lateral_malleolus", Text, Optional("needed by source = \"markers\" alone"), "", "Marker on the outer malleolus", "\"RANK\""),
    key("landmarks.medial_malleolus", Text, Optional("needed by source = \"markers\" alone"), "", "Marker on the inner malleolus", "\"RANM\""),
    key("landmarks.fibula_head", Text, Optional("not used"), "", "Marker on the head of the fibula; read and not used today", "\"RFIB\""),
    key("landmarks.patella", Text, Optional("the knee centre is where the axis comes nearest to the line from hip to ankle"), "", "Marker on the patella: places the knee centre along a functional axis", "\"RPAT\""),
    key("landmarks.heel", Text, Optional("not used with a table"), "", "Marker on the heel", "\"RHEE\""),
    key("landmarks.metatarsal_1", Text, Optional("not used with a table"), "", "Marker on the head of metatarsal 1 (inner ball of the foot)", "\"RMT1\""),
    key("landmarks.metatarsal_5", Text, Optional("not used with a table"), "", "Marker on the head of metatarsal 5 (outer ball of the foot)", "\"RMT5\""),

    key("recording", Sections, Optional("all recordings have the axes, units and gaps of `motion`"), "", "A recording named above that differs from `motion` in axes, units, or how gaps are written", ""),
    key("recording.file", File, Required, "", "The recording, as named in `static` or `motions`", "\"standing.c3d\""),
    key("recording.units", LENGTH, Optional("as for `motion`"), "", "Its unit of length where the one it claims is wrong", "\"mm\""),
    key("recording.zeros_missing", Flag, Optional("as for `motion`"), "", "Whether markers at exactly 0, 0, 0 were not seen in it", "true"),
    key("recording.axes", Section, Optional("as for `motion`"), "", "Its axes", ""),
    key("recording.axes.x", AXIS, Required, "", "Its axis that points forward", "\"y\""),
    key("recording.axes.y", AXIS, Required, "", "Its axis that points up", "\"z\""),
    key("recording.axes.z", AXIS, Required, "", "Its axis that points to the right", "\"x\""),

    key("filter", Section, Optional("the defaults of its keys"), "", "Low-pass filters", ""),
    key("filter.motion_hz", Number(0.1, 1e4), Default("5.0"), "Hz", "Cut-off for velocities and accelerations; postures are not filtered", "6.0"),
    key("filter.force_hz", Number(0.1, 1e4), Default("20.0"), "Hz", "Cut-off for the ground reaction", "20.0"),
    key("filter.contact_threshold_N", Number(0.1, 500.0), Default("20.0"), "N", "Vertical force above which the foot is on the plate", "20.0"),

    key("model", Section, Optional("the defaults of its keys"), "", "Choices of the model", ""),
    key("model.ankle", Word(&["universal", "parallel"]), Default("\"universal\""), "", "Joint between shank and foot: two hinges, or a parallel mechanism of contact and two ligaments", "\"parallel\""),
    key("model.knee", Word(&["natural", "implant"]), Default("\"natural\""), "", "What the knee is: natural, with cruciate ligaments that pull; or a prosthesis, whose post and surfaces take shear both ways and whose compartments may lift off", "\"implant\""),

    key("emg", Section, Optional("no electromyography is compared"), "", "Electromyography of the leg under study (of both legs: of the right one): when muscles were excited, beside when they pull", ""),
    key("emg.file", File, Optional("the analog channels of the C3D motion"), "", "Table with the channels over time: CSV, STO or MOT, or another C3D file", "\"walk_emg.csv\""),
    key("emg.delay_ms", Number(0.0, 200.0), Default("50.0"), "ms", "Electromechanical delay: how long force comes after excitation", "50.0"),
    key("emg.channels", Map, Required, "", "Channel of the recording = muscle line, or several with spaces between", "\"medgas\" = \"gasmed\""),

    key("gaps", Section, Optional("the defaults of its keys"), "", "What to do about gaps in marker paths", ""),
    key("gaps.fill_up_to_frames", Count(0, 1_000_000), Default("0"), "frames", "Longest gap that is filled by a cubic through its neighbours; 0 fills none", "10"),

    key("left", Section, Optional("the leg of `side` alone"), "", "The left leg of a recording of both: `optimize` solves both, and everything else here is then of the right one (`side = \"right\"`)", ""),

    key("left.markers", Section, Required, "", "Markers that move with each segment of the left leg", ""),
    key("left.markers.pelvis", Texts, Optional("those of the right leg"), "", "Markers on the pelvis", "[\"RASI\", \"LASI\", \"RPSI\", \"LPSI\"]"),
    key("left.markers.thigh", Texts, Required, "", "Markers on the left thigh", "[\"LTHI\", \"LKNE\", \"LKNM\"]"),
    key("left.markers.shank", Texts, Required, "", "Markers on the left shank", "[\"LTIB\", \"LANK\", \"LANM\"]"),
    key("left.markers.foot", Texts, Required, "", "Markers on the left foot", "[\"LHEE\", \"LTOE\", \"LMT5\"]"),

    key("left.force", Section, Required, "", "Plates of the left foot; file, axes and columns are those of [force]", ""),
    key("left.force.plates", Counts(1, 1000), Required, "", "Numbers of the plates that the left foot steps on", "[2]"),
    key("left.force.next_plate", Count(1, 1000), Optional("the next step is not on a plate"), "", "Plate of the next step of the left foot: its heel strike ends the cycle", "3"),

    key("left.range", Section, Optional("as for the right leg, cycles counted on the plates of the left foot"), "", "Part of the recording that is reported of the left leg: a cycle, or start_s and end_s", ""),
    key("left.range.cycle", Count(1, 1000), Optional("start_s and end_s are given"), "", "The n-th gait cycle of the left leg", "1"),
    key("left.range.start_s", Number(f64::MIN, f64::MAX), Optional("cycle is given"), "s", "First time that is reported, on the clock of the recording", "1.75"),
    key("left.range.end_s", Number(f64::MIN, f64::MAX), Optional("cycle is given"), "s", "Last time that is reported", "3.0"),

    key("left.landmarks", Section, Optional("with a table, that of the right leg, mirrored"), "", "Landmarks of the left leg; source, hip centre, recordings and the markers of the pelvis are those of [landmarks]", ""),
    key("left.landmarks.table", File, Optional("that of the right leg"), "", "Table of local coordinates of the left leg (CSV)", "\"DM_left.csv\""),
    key("left.landmarks.rename", Map, Optional("names of the table are those of the markers"), "", "Item of the table = recorded marker of the left leg; items of the pelvis are as for the right one", "\"lateral epicondyle\" = \"LKNE\""),
    key("left.landmarks.lateral_epicondyle", Text, Optional("needed by source = \"markers\" alone"), "", "Marker on the outer epicondyle of the left femur", "\"LKNE\""),
    key("left.landmarks.medial_epicondyle", Text, Optional("needed by source = \"markers\" alone"), "", "Marker on the inner epicondyle of the left femur", "\"LKNM\""),
    key("left.landmarks.lateral_malleolus", Text, Optional("needed by source = \"markers\" alone"), "", "Marker on the outer malleolus", "\"LANK\""),
    key("left.landmarks.medial_malleolus", Text, Optional("needed by source = \"markers\" alone"), "", "Marker on the inner malleolus", "\"LANM\""),
    key("left.landmarks.fibula_head", Text, Optional("not used"), "", "Marker on the head of the fibula; read and not used today", "\"LFIB\""),
    key("left.landmarks.patella", Text, Optional("the knee centre is where the axis comes nearest to the line from hip to ankle"), "", "Marker on the left patella", "\"LPAT\""),
    key("left.landmarks.heel", Text, Optional("not used with a table"), "", "Marker on the left heel", "\"LHEE\""),
    key("left.landmarks.metatarsal_1", Text, Optional("not used with a table"), "", "Marker on the head of metatarsal 1 of the left foot", "\"LMT1\""),
    key("left.landmarks.metatarsal_5", Text, Optional("not used with a table"), "", "Marker on the head of metatarsal 5 of the left foot", "\"LMT5\""),
];

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::KEYS;
    use crate::keys::{Filled, differences, template};
    use crate::trial_file::TrialFile;

    #[test]
    fn every_field_has_a_row_and_every_row_a_field() {
        assert_eq!(differences::<TrialFile>(KEYS), Vec::<String>::new());
    }

    /// Every required key with its example, and nothing else.
    const LEAST: &str = r#"
        motion = "walk.c3d"
        [subject]
        name = "S01"
        mass_kg = 70.0
        height_m = 1.72
        sex = "female"
        side = "right"
        [range]
        cycle = 1
        [force]
        plates = [1]
        [markers]
        pelvis = ["RASI", "LASI", "RPSI", "LPSI"]
        thigh = ["RTHI", "RKNE", "RKNM"]
        shank = ["RTIB", "RANK", "RANM"]
        foot = ["RHEE", "RTOE", "RMT5"]
        [landmarks]
        source = "table"
        table = "DM.csv"
    "#;

    #[test]
    fn a_template_with_the_defaults_written_out_says_the_same_as_one_without() {
        let read = |text: &str| TrialFile::parse(Path::new("x.toml"), text.as_bytes()).unwrap();
        let mut filled = Filled::default();
        let mut section = String::new();
        for line in LEAST.lines().map(str::trim).filter(|l| !l.is_empty()) {
            match line.split_once(" = ") {
                Some((key, value)) if section.is_empty() => filled.set(key, value),
                Some((key, value)) => filled.set(&format!("{section}.{key}"), value),
                None => section = line.trim_matches(['[', ']']).to_string(),
            }
        }
        let text = template(KEYS, &filled);
        assert!(text.contains("motion_hz = 5.0 #") && text.contains("# next_plate = 2 #"), "{text}");
        let (least, whole) = (read(LEAST), read(&text));
        assert_eq!(TrialFile { text: least.text.clone(), ..whole }, least);
    }
}
