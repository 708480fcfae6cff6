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

// ------------------------------------------------------------------------------------------------ good trials

#[test]
fn the_walker_comes_back_from_its_files() {
    let (original, _) = walker(Knee::Hinge);
    let loaded = Walking::new().load().unwrap();
    assert!(distance(&original.markers, &loaded.markers) < 1e-12);
    assert_eq!(original.time.len(), loaded.time.len());
    for (a, b) in original.time.iter().zip(&loaded.time) {
        assert!((a - b).abs() < 1e-9);
    }
    for i in 0..original.time.len() {
        assert!((original.ground.force[i] - loaded.ground.force[i]).norm() < 1e-9);
        assert!((original.ground.moment[i] - loaded.ground.moment[i]).norm() < 1e-9, "sample {i}");
    }
    // 0 % has no force; the first sample above 20 N is at 1 %, a cycle is 100 samples.
    assert_eq!(loaded.report, original.report.start + 1..original.report.end + 1);
}

#[test]
fn a_left_leg_is_a_mirrored_right_leg() {
    let right = Walking::new().load().unwrap();
    let mut left = Walking::new();
    left.map(|p| Vector3::new(p.x, p.y, -p.z)).replace("side = \"right\"", "side = \"left\"");
    for (name, _) in &mut left.markers {
        if name.len() == 4 {
            // RASI … LPSI: the mirrored right one is the left one
            *name =
                if name.starts_with('R') { name.replacen('R', "L", 1) } else { name.replacen('L', "R", 1) };
        }
    }
    for (f, p) in left.plates.iter_mut().flatten() {
        (f.z, p.z) = (-f.z, -p.z);
    }
    let file = TrialFile::read(&left.write()).unwrap();
    let trial = file.load(None).unwrap();
    // the right ASIS comes first in the list of the right leg, the left one in that of the mirrored leg
    let order = |t: &Trial| {
        let mut tracks = t.markers.clone();
        tracks[..4].sort_by(|a, b| a.position[0].unwrap().z.total_cmp(&b.position[0].unwrap().z));
        Trial { markers: tracks, ..t.clone() }
    };
    assert_same(&order(&trial), &order(&right), 1e-12, 1e-9);
    let Landmarks::Table { recorded, .. } = file.landmarks(None).unwrap().source else { panic!() };
    assert_eq!(recorded["right ASIS"], "LASI", "the leg under study is on the right past the reader");
    assert_eq!(recorded["left PSIS"], "RPSI");
    assert_eq!(recorded["heel"], "heel");
}

#[test]
fn a_c3d_file_in_laboratory_axes_gives_the_same_trial() {
    let mut walking = Walking::new();
    let reference = walking.load().unwrap();
    // ground X, Y, Z = lab -x, z, y
    let to_lab = |v: Vector3<f64>| [-v.x, v.z, v.y];
    // One plate, large enough for the walk; plate axes from the corners: x = lab -y, y = lab -x, z down.
    let (low, high) = (-4000.0, 4000.0);
    let corners = [[low, low, 0.0], [low, high, 0.0], [high, high, 0.0], [high, low, 0.0]];
    let to_plate = |[x, y, z]: [f64; 3]| Vector3::new(-y, -x, -z);
    let mut channels = vec![Vec::new(); 6];
    for (force, point) in &walking.plates[RIGHT_PLATE - 1] {
        let (f, p) = (to_plate(to_lab(*force)), to_plate(to_lab(*point)));
        let moment = p.cross(&f) * 1e3;
        for k in 0..3 {
            channels[k].push(f[k]);
            channels[3 + k].push(moment[k]);
        }
    }
    let rate = (walking.time.len() - 1) as f64 / (walking.time[walking.time.len() - 1] - walking.time[0]);
    let file = C3dFile {
        rate: rate as f32,
        samples: 1,
        first_frame: 1,
        names: walking.markers.iter().map(|m| m.0.clone()).collect(),
        points: walking.markers.iter().map(|m| m.1.iter().map(|p| p.map(to_lab)).collect()).collect(),
        channels,
        corners: vec![corners],
        ..C3dFile::default()
    };
    let axes = "motion = \"walk.c3d\"\naxes = { x = \"-x\", y = \"z\", z = \"y\" }";
    walking.replace("motion = \"walk.trc\"", axes).replace("file = \"walk.sto\"\n", "");
    let path = walking.write();
    std::fs::write(walking.folder().join("walk.c3d"), file.bytes()).unwrap();
    let trial = TrialFile::read(&path).unwrap().load(None).unwrap();
    // single precision: 1e-7 of 4 m and of 750 N · 4 m
    assert_same(&trial, &reference, 1e-6, 1e-3);
}

#[test]
fn recorded_cycles_agree_with_the_events() {
    let (Some(data), Some(events)) = (shared("gait"), shared("gait/events.csv")) else { return };
    let mut strikes: Vec<(String, f64)> = Vec::new();
    for row in csv::Reader::from_path(events).unwrap().records() {
        let row = row.unwrap();
        if &row[2] == "right" && &row[3] == "heel_strike" {
            strikes.push((row[0].to_string(), row[4].parse().unwrap()));
        }
    }
    strikes.sort_by(|a, b| a.1.total_cmp(&b.1));
    for name in SHIPPED {
        let trial = TrialFile::read(&shipped_trial(name)).unwrap().load(Some(&data)).unwrap();
        let times: Vec<f64> = strikes.iter().filter(|s| s.0 == name).map(|s| s.1).collect();
        let report = &trial.time[trial.report.clone()];
        let frame = 1.0 / 120.0;
        assert_eq!(times.len(), 2, "{name}");
        assert!((report[0] - times[0]).abs() < frame, "{name}: {} {}", report[0], times[0]);
        assert!(
            (report[report.len() - 1] - times[1]).abs() < frame,
            "{name}: {} {}",
            report[report.len() - 1],
            times[1]
        );
        assert!(
            trial.report.start > 25 && trial.report.end + 25 < trial.time.len(),
            "{name}: frames for the filters"
        );
        // no contact in swing, weight in stance: the samples are those of the right foot
        let at = |t: f64| trial.ground.force[trial.ground.time.partition_point(|s| *s < t)].y;
        let weight = 9.81 * trial.subject.mass;
        let middle = |fraction: f64| times[0] + fraction * (times[1] - times[0]);
        assert!((0.6..1.2).contains(&(at(middle(0.3)) / weight)), "{name}: {}", at(middle(0.3)));
        assert!(at(middle(0.8)).abs() < 20.0, "{name}: {}", at(middle(0.8)));
    }
}

#[test]
fn recorded_landmarks_are_complete() {
    let Some(data) = shared("gait") else { return };
    for name in SHIPPED {
        let file = TrialFile::read(&shipped_trial(name)).unwrap();
        match file.landmarks(Some(&data)).unwrap().source {
            Landmarks::Table { items, recorded } => {
                assert_eq!(recorded.len(), file.markers.all().count(), "{name}");
                let places = |marker: &str| {
                    let item = recorded.iter().find(|(_, m)| *m == marker).unwrap().0;
                    items.iter().filter(|i| i.item == *item).count()
                };
                assert!(file.markers.all().all(|(marker, _)| places(marker) == 1), "{name}");
            }
            Landmarks::Functional { roles, tracks, motions } => {
                assert_eq!(motions.len(), 3, "{name}");
                for tracks in motions.iter().chain([&tracks]) {
                    for role in [
                        &roles.right_asis,
                        &roles.left_psis,
                        &roles.heel,
                        &roles.metatarsal_1,
                        &roles.metatarsal_5,
                    ] {
                        assert!(tracks.iter().any(|t| t.name == *role), "{name}: {role}");
                    }
                }
            }
            Landmarks::Markers { .. } => panic!("{name}"),
        }
    }
}

#[test]
fn landmark_markers_may_come_from_a_static_trial() {
    let mut walking = Walking::new();
    let table = walking.toml.find("[landmarks]").unwrap();
    walking.toml.truncate(table);
    walking.toml += "[landmarks]\nsource = \"markers\"\nstatic = \"still.trc\"\nright_asis = \"RASI\"\nleft_asis = \"LASI\"\n\
        right_psis = \"RPSI\"\nleft_psis = \"LPSI\"\nheel = \"heel\"\nmetatarsal_1 = \"metatarsal_head_1\"\n\
        metatarsal_5 = \"metatarsal_head_5\"\nlateral_epicondyle = \"KL\"\nmedial_epicondyle = \"KM\"\n\
        lateral_malleolus = \"AL\"\nmedial_malleolus = \"AM\"\n";
    let path = walking.write();
    let mut still = Walking::new();
    still.time.truncate(5);
    for (_, path) in &mut still.markers {
        path.truncate(5);
    }
    for (name, z) in [("KL", 120.0), ("KM", 40.0), ("AL", 110.0), ("AM", 50.0)] {
        still.markers.push((name.to_string(), vec![Some(Vector3::new(0.0, 500.0, z)); 5]));
    }
    std::fs::write(walking.folder().join("still.trc"), still.trc()).unwrap();
    let file = TrialFile::read(&path).unwrap();
    assert!(file.load(None).is_ok());
    let Landmarks::Markers { roles, tracks } = file.landmarks(None).unwrap().source else { panic!() };
    assert_eq!(roles.lateral_epicondyle.as_deref(), Some("KL"));
    assert_eq!(tracks.len(), file.markers.all().count() + 4);
    let knee = tracks.iter().find(|t| t.name == "KL").unwrap();
    assert_eq!(knee.position[0], Some(Vector3::new(0.0, 0.5, 0.12)));
}

#[test]
fn gaps_stay_gaps_unless_the_file_says_otherwise() {
    let whole = Walking::new().load().unwrap();
    let mut walking = Walking::new();
    walking.marker("heel")[70..75].fill(None);
    walking.marker("heel")[100..120].fill(None);
    walking.marker("thigh_superior")[90..=90].fill(None);
    let count =
        |trial: &Trial| trial.markers.iter().flat_map(|m| &m.position).filter(|p| p.is_none()).count();
    assert_eq!(count(&walking.load().unwrap()), 26);
    walking.toml += "[gaps]\nfill_up_to_frames = 5\n";
    let filled = walking.load().unwrap();
    assert_eq!(count(&filled), 20, "the gap of 20 frames is too long");
    for (a, b) in filled.markers.iter().zip(&whole.markers) {
        for (p, q) in a.position.iter().zip(&b.position) {
            let error = p.map_or(0.0, |p| (p - q.unwrap()).norm());
            assert!(error < 0.004, "{}: {error}", a.name); // the heel moves at up to 3 m/s, 37 mm per frame
        }
    }
}

#[test]
fn whole_frames_and_segments_may_be_lost() {
    let mut walking = Walking::new();
    for (name, path) in &mut walking.markers {
        path[60..64].fill(None);
        if name.starts_with("thigh") {
            path[80..200].fill(None);
        }
    }
    let trial = walking.load().unwrap();
    assert!(trial.markers.iter().all(|m| m.position[60..64].iter().all(Option::is_none)));
    assert!(
        trial
            .markers
            .iter()
            .flat_map(|m| m.position.iter().flatten())
            .all(|p| p.iter().all(|c| c.is_finite()))
    );
}

// ------------------------------------------------------------------------------------------------ markers

#[test]
fn a_misnamed_marker_is_named_with_its_neighbour() {
    let error = error_of(|w| {
        w.replace("\"thigh_superior\", ", "\"thigh_superor\", ");
        w.replace("\"thigh superior\" = \"thigh_superior\"", "\"thigh superior\" = \"thigh_superor\"");
    });
    let line = Walking::new().toml.lines().position(|l| l.starts_with("thigh =")).unwrap() + 1;
    refused!(
        error,
        InputError::UnknownName { .. },
        "walk.toml",
        &format!("line {line}"),
        "`thigh_superor`",
        "`thigh_superior`"
    );
}

#[test]
fn a_marker_that_is_never_seen_is_named() {
    refused!(
        error_of(|w| w.marker("heel").fill(None)),
        InputError::NeverSeen { .. },
        "walk.trc",
        "`heel`",
        "201 frames"
    );
    let zeros = |w: &mut Walking| {
        w.replace("motion = ", "zeros_missing = true\nmotion = ");
        w.marker("heel").fill(Some(Vector3::new(0.0, -0.0, 0.0)));
    };
    refused!(error_of(zeros), InputError::NeverSeen { zeros: true, .. }, "exact zeros");
    refused!(
        error_of(|w| w.marker("heel")[30] = Some(Vector3::zeros())),
        InputError::ExactZero { frame: 31, .. },
        "zeros_missing"
    );
}

#[test]
fn wrong_units_are_noticed_and_can_be_mended() {
    refused!(
        error_of(|w| w.unit = "m"),
        InputError::WrongUnits { .. },
        "walk.trc",
        "millimetres were read as metres",
        "`units`"
    );
    let small = |w: &mut Walking| {
        w.map(|p| p * 1e-3);
    };
    refused!(error_of(small), InputError::WrongUnits { .. }, "metres were read as millimetres");
    refused!(
        error_of(|w| w.unit = "cm"),
        InputError::WrongUnits { .. },
        "millimetres were read as centimetres"
    );
    let reference = Walking::new().load().unwrap();
    let mut mended = Walking::new();
    mended.unit = "m";
    mended.replace("motion = ", "units = \"mm\"\nmotion = ");
    assert_same(&mended.load().unwrap(), &reference, 1e-9, 1e-9);
}

#[test]
fn left_taken_for_right_is_noticed() {
    refused!(
        error_of(|w| {
            w.replace("side = \"right\"", "side = \"left\"");
        }),
        InputError::WrongSide { .. },
        "`side` is left",
        "thigh markers"
    );
    let plate = format!("plates = [{LEFT_PLATE}]");
    let other_plate = |w: &mut Walking| {
        w.replace("plates = [1]", &plate);
    };
    refused!(error_of(other_plate), InputError::WrongFoot { .. }, "plate 2", "right foot");
}

#[test]
fn a_trial_without_a_plate_is_refused() {
    let none = |w: &mut Walking| {
        w.replace("plates = [1]", "plates = []");
    };
    refused!(
        error_of(none),
        InputError::BadValue { .. },
        "`plates`",
        "name the plates that the foot steps on"
    );
}

#[test]
fn mirrored_and_turned_recordings_are_noticed() {
    let map = |change: fn(Vector3<f64>) -> Vector3<f64>| {
        error_of(|w| {
            w.map(change);
        })
    };
    refused!(map(|p| Vector3::new(p.x, p.y, -p.z)), InputError::WrongSide { .. }, "mirrored");
    refused!(map(|p| Vector3::new(-p.x, p.y, p.z)), InputError::WrongSide { .. }, "axes.x");
    refused!(map(|p| Vector3::new(-p.x, p.y, -p.z)), InputError::WrongSide { .. }, "axes.x");
    refused!(map(|p| Vector3::new(p.x, -p.z, p.y)), InputError::WrongSide { .. }, "axes.y");
    let axes = |text: &'static str| {
        error_of(|w| {
            w.replace("motion = ", &format!("axes = {text}\nmotion = "));
        })
    };
    refused!(axes("{ x = \"x\", y = \"y\", z = \"-z\" }"), InputError::BadValue { line: 1, .. }, "mirror");
    refused!(axes("{ x = \"x\", y = \"y\", z = \"x\" }"), InputError::BadValue { line: 1, .. }, "used once");
    refused!(axes("{ x = \"x\", y = \"y\", z = \"w\" }"), InputError::BadValue { line: 1, .. }, "`w`");
}

#[test]
fn exchanged_markers_are_named() {
    for (a, b) in [
        ("RASI", "LASI"),
        ("RPSI", "LPSI"),
        ("RASI", "RPSI"),
        ("LASI", "LPSI"),
        ("thigh_superior", "thigh_inferior"),
    ] {
        let error = error_of(|w| {
            w.exchange(a, b, 0);
        });
        refused!(error, InputError::Swapped { at: Place::Whole, .. }, a, b, "exchange their names");
    }
    for (a, b) in [
        ("thigh_lateral", "thigh_inferior"),
        ("R_Shank_Superior", "R_Shank_Inferior"),
        ("heel", "R_Hindfoot"),
    ] {
        let error = error_of(|w| {
            w.exchange(a, b, 120);
        });
        // What they did to the distances within the segment may be told after it.
        let error = match error {
            InputError::Several(all) => all.into_iter().next().unwrap(),
            one => one,
        };
        refused!(error, InputError::Swapped { at: Place::Frame(121), .. }, a, b, "each other's places");
    }
}

#[test]
fn copied_and_wandering_markers_are_named() {
    let copied = |w: &mut Walking| {
        *w.marker("thigh_inferior") = w.marker("thigh_superior").clone();
    };
    refused!(error_of(copied), InputError::Duplicated { .. }, "`thigh_superior`", "`thigh_inferior`");
    let wandering = |w: &mut Walking| {
        for (i, p) in w.marker("thigh_lateral").iter_mut().enumerate() {
            p.as_mut().unwrap().y += i as f64; // mm
        }
    };
    refused!(error_of(wandering), InputError::NotRigid { .. }, "`thigh_lateral`", "thigh");
    let listed_twice = |w: &mut Walking| {
        w.replace("shank = [", "shank = [\"heel\", ");
    };
    refused!(error_of(listed_twice), InputError::BadValue { .. }, "`heel`", "list it once");
}

// ------------------------------------------------------------------------------------------------ time and forces

#[test]
fn times_that_do_not_meet_are_refused() {
    let later = |w: &mut Walking| w.force_time.iter_mut().for_each(|t| *t += 10.0);
    refused!(error_of(later), InputError::NoOverlap { .. }, "walk.trc", "walk.sto", "one clock");
    let beyond = |w: &mut Walking| {
        w.replace("cycle = 1", "start_s = 0.0\nend_s = 9.0");
    };
    refused!(error_of(beyond), InputError::NoOverlap { .. }, "9.0000 s");
    refused!(error_of(|w| w.time.swap(3, 4)), InputError::Malformed { at: Place::Line(10), .. }, "time");
    let still = |w: &mut Walking| w.force_time[7] = w.force_time[6];
    refused!(error_of(still), InputError::TimeNotIncreasing { at: Place::Line(14), .. }, "walk.sto");
}

fn is_on_foot(marker: &str) -> bool {
    let on_foot = |m: &&MarkerTrack| m.segment == multibody::natural::SegmentId::Foot;
    walker(Knee::Hinge).0.markers.iter().filter(on_foot).any(|m| m.name.replace(' ', "_") == marker)
}

#[test]
fn a_step_during_which_the_foot_is_lost_is_named() {
    // Seen in one frame of swing, or the markers would be missing altogether.
    let lost = |w: &mut Walking| {
        for (_, path) in w.markers.iter_mut().filter(|m| is_on_foot(&m.0)) {
            let seen = path[30];
            path.fill(None);
            path[30] = seen;
        }
    };
    refused!(
        error_of(lost),
        InputError::WrongForce { .. },
        "plate 1 is loaded from",
        "no marker of the right foot"
    );
}

#[test]
fn forces_that_cannot_be_are_refused() {
    let scaled = |factor: f64| error_of(|w| w.plates.iter_mut().flatten().for_each(|(f, _)| *f *= factor));
    refused!(scaled(0.0), InputError::NoContact { .. }, "plate 1", "20 N");
    refused!(scaled(1e-3), InputError::NoContact { .. }, "0.7 N");
    refused!(scaled(1e3), InputError::WrongForce { .. }, "body weights", "in N");
    refused!(scaled(-1.0), InputError::WrongForce { .. }, "on_plate");
    refused!(
        error_of(|w| w.plates[0][60].0.y = f64::NAN),
        InputError::BadNumber { at: Place::Line(67), .. },
        "f1_vy",
        "NaN"
    );
    let far = |w: &mut Walking| w.plates.iter_mut().flatten().for_each(|(_, p)| *p *= 1e3);
    let endless = |w: &mut Walking| w.plates[0][70].1.x = 1e308;
    refused!(error_of(endless), InputError::WrongForce { .. }, "plate 1", "in m");
    refused!(error_of(far), InputError::WrongFoot { .. } | InputError::WrongForce { .. }, "plate 1");
    let mut on_plate = Walking::new();
    let reference = on_plate.load().unwrap();
    on_plate.plates.iter_mut().flatten().for_each(|(f, _)| *f *= -1.0);
    on_plate.replace("plates = [1]", "plates = [1]\non_plate = true");
    assert_same(&on_plate.load().unwrap(), &reference, 1e-12, 1e-9);
}

#[test]
fn a_spike_is_no_heel_strike_and_the_other_foot_does_not_count() {
    let reference = Walking::new().load().unwrap();
    let mut walking = Walking::new();
    let at = reference.ground.time.len() - 65; // in swing
    walking.plates[0][at].0.y = 60.0;
    assert_eq!(walking.load().unwrap().report, reference.report);
    // Both feet step on one plate, one after the other: only the right steps are taken.
    let mut shared_plate = Walking::new();
    for i in 0..shared_plate.force_time.len() {
        // swing of the right leg, less the time on both feet
        if shared_plate.plates[0][i].0.y == 0.0 {
            shared_plate.plates[0][i] = shared_plate.plates[1][i];
        }
    }
    for i in 1..shared_plate.force_time.len() {
        let (before, now) = (shared_plate.plates[0][i - 1].0.y, shared_plate.plates[0][i].0.y);
        if (before > 0.0) && (now > 0.0) && (before - now).abs() > 200.0 {
            shared_plate.plates[0][i].0 = Vector3::zeros(); // the foot is off the plate for a moment
        }
    }
    let trial = shared_plate.load().unwrap();
    let middle_of_swing = (trial.report.start + trial.report.end) / 2 + 30;
    assert!(shared_plate.plates[0][middle_of_swing].0.y > 300.0, "the left foot is on the plate");
    assert_eq!(trial.ground.force[middle_of_swing], Vector3::zeros());
}

#[test]
fn a_cycle_that_is_not_there_is_refused() {
    let cycle = |n: &str| {
        error_of(|w| {
            w.replace("cycle = 1", &format!("cycle = {n}"));
        })
    };
    refused!(cycle("2"), InputError::NoCycle { wanted: 2, .. }, "3 heel strikes", "start_s");
    refused!(cycle("1000"), InputError::NoCycle { .. }, "1001 heel strikes");
    refused!(cycle("9223372036854775807"), InputError::BadValue { .. }, "count from 1");
    refused!(
        cycle("18446744073709551615"),
        InputError::BadValue { .. } | InputError::Malformed { .. },
        "walk.toml"
    );
    refused!(cycle("0"), InputError::BadValue { .. }, "count from 1");
}

// ------------------------------------------------------------------------------------------------ the trial file

#[test]
fn unknown_keys_are_named_with_the_nearest() {
    let with = |from: &str, to: &str| {
        let (from, to) = (from.to_string(), to.to_string());
        error_of(move |w| {
            w.replace(&from, &to);
        })
    };
    refused!(
        with("mass_kg", "mas_kg"),
        InputError::UnknownKey { line: 5, .. },
        "walk.toml",
        "line 5",
        "`mas_kg`",
        "`mass_kg`"
    );
    refused!(
        with("motion = ", "zero_missing = true\nmotion = "),
        InputError::UnknownKey { line: 1, .. },
        "`zeros_missing`"
    );
    refused!(
        with("source = ", "hip_center = \"table\"\nsource = "),
        InputError::UnknownKey { .. },
        "`hip_centre`"
    );
    refused!(with("[range]", "[fliter]\nmotion_hz = 5\n[range]"), InputError::UnknownKey { .. }, "`filter`");
    refused!(with("point = ", "pont = "), InputError::UnknownKey { .. }, "`pont`", "`point`");
    refused!(
        with("[range]", "[filter]\ncontact_threshold_n = 5\n[range]"),
        InputError::UnknownKey { .. },
        "`contact_threshold_N`"
    );
}

#[test]
fn values_out_of_range_are_named() {
    for (from, to, words) in [
        ("mass_kg = 70", "mass_kg = 0", "`mass_kg` is 0"),
        ("mass_kg = 70", "mass_kg = -70", "`mass_kg` is -70"),
        ("mass_kg = 70", "mass_kg = nan", "`mass_kg` is NaN"),
        ("height_m = 1.72", "height_m = 172", "Standing height in m"),
        ("cycle = 1", "cycle = 1\nstart_s = 0.0", "give `cycle`, or"),
        ("cycle = 1", "start_s = 1.0\nend_s = 0.5", "less than `end_s`"),
        ("plates = [1]", "plates = []", "`plates` is empty"),
        ("plates = [1]", "plates = [7]", "[[force.columns]]"),
        ("[range]", "[filter]\nmotion_hz = 0\n[range]", "`motion_hz` is 0"),
        ("[range]", "[filter]\nmotion_hz = 50\n[range]", "below"),
        ("[range]", "[filter]\nforce_hz = 1000\n[range]", "below"),
        ("[range]", "[axes]\nx = \"x\"\ny = \"y\"\nz = \"-z\"\n[range]", "line 10: `[axes]` is"),
        ("source = \"table\"", "source = \"functional\"", "without `right_asis`"),
        ("table = \"DM.csv\"\n", "", "without `table`"),
        ("source = \"table\"", "source = \"table\"\nright_asis = \"RASI\"", "does not use it"),
        ("source = \"table\"", "source = \"table\"\nhip_centre = [0.1, 77.0, 0.1]", "three numbers in m"),
        ("source = \"table\"", "source = \"table\"\nhip_centre = \"tabel\"", "\"regression\""),
        ("\"thigh superior\" =", "\"thigh superor\" =", "`thigh superior`"),
        ("\"thigh superior\" = \"thigh_superior\"", "\"thigh superior\" = \"heel\"", "on the foot"),
        // Numbers in the axes of a left leg, and with up taken for down.
        ("source = \"table\"", "source = \"table\"\nhip_centre = [-0.05, -0.08, -0.09]", "towards the leg"),
        ("source = \"table\"", "source = \"table\"\nhip_centre = [-0.05, 0.08, 0.09]", "up (-0.2 to 0)"),
        ("\"f1_vy\"", "\"f1_vyy\"", "`f1_vy`"),
        ("\"f1_vy\"", "\"f1_px\"", "uses that column twice"),
        ("side = \"right\"", "side = \"rigth\"", "`rigth`"),
    ] {
        let error = error_of(|w| {
            w.replace(from, to);
        });
        let message = error.to_string();
        assert!(
            message.contains(words) && message.contains("walk.toml") && message.contains("line"),
            "{to}: {message}"
        );
    }
}

#[test]
fn files_outside_the_folders_are_refused() {
    let outside = tempfile::tempdir().unwrap();
    std::fs::write(outside.path().join("walk.trc"), Walking::new().trc()).unwrap();
    let absolute = outside.path().join("walk.trc").display().to_string();
    for path in [
        "../walk.trc",
        "../../etc/passwd",
        "a/../../walk.trc",
        "/etc/passwd",
        absolute.as_str(),
        "../absent.trc",
    ] {
        let error = error_of(|w| {
            w.replace("walk.trc", path);
        });
        refused!(error, InputError::PathEscapes { .. }, path, "--data");
    }
    #[cfg(unix)]
    {
        let mut walking = Walking::new();
        walking.replace("walk.trc", "link.trc");
        let path = walking.write();
        std::os::unix::fs::symlink(&absolute, walking.folder().join("link.trc")).unwrap();
        // Whoever laid the link there has allowed it.
        assert!(TrialFile::read(&path).unwrap().load(None).is_ok());
    }
    let absent = |w: &mut Walking| {
        w.replace("walk.trc", "wlk.trc");
    };
    refused!(error_of(absent), InputError::NotFound { .. }, "wlk.trc", "--data");
    // the data folder is another allowed place
    let mut walking = Walking::new();
    walking.replace("walk.trc", "only_there.trc");
    let path = walking.write();
    std::fs::rename(outside.path().join("walk.trc"), outside.path().join("only_there.trc")).unwrap();
    assert!(TrialFile::read(&path).unwrap().load(Some(outside.path())).is_ok());
}

#[test]
fn damaged_trial_files_never_panic() {
    let walking = Walking::new();
    let bytes = walking.toml.as_bytes();
    let path = Path::new("walk.toml");
    for length in 0..bytes.len() {
        let _ = TrialFile::parse(path, &bytes[..length]);
    }
    let mut state = 7u64;
    let mut random = |n: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % n
    };
    let mut refused = 0;
    for _ in 0..3000 {
        let mut damaged = bytes.to_vec();
        for _ in 0..1 + random(3) {
            let at = random(damaged.len());
            damaged[at] = random(256) as u8;
        }
        refused += usize::from(TrialFile::parse(path, &damaged).is_err());
    }
    assert!(refused > 1000, "{refused}");
    let utf16: Vec<u8> = walking.toml.encode_utf16().flat_map(|c| c.to_le_bytes()).collect();
    refused!(TrialFile::parse(path, &utf16).unwrap_err(), InputError::Malformed { .. }, "UTF-16");
}

#[test]
fn damaged_recordings_are_named_through_the_trial_file() {
    let Some(data) = shared("gait") else { return };
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("jw")).unwrap();
    for name in ["jw_ngait_og1", "jw_ngait_og3", "jw_ngait_og7"] {
        let file = format!("jw/{name}.c3d");
        std::fs::copy(data.join(&file), folder.path().join(&file)).unwrap();
    }
    let trial = || TrialFile::read(&shipped_trial("jw_ngait_og3")).unwrap().load(Some(folder.path()));
    assert!(trial().is_ok());
    let whole = std::fs::read(data.join("jw/jw_ngait_og3.c3d")).unwrap();
    let path = folder.path().join("jw/jw_ngait_og3.c3d");
    let rewrite = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = whole.clone();
        change(&mut bytes);
        let _ = std::fs::remove_file(&path);
        std::fs::write(&path, bytes).unwrap();
        trial().expect_err("damage")
    };
    refused!(
        rewrite(&|b| b.truncate(400_000)),
        InputError::Malformed { at: Place::Byte(400_000), .. },
        "jw_ngait_og3.c3d",
        "cut off"
    );
    refused!(rewrite(&|b| b[2] = 57), InputError::Malformed { .. }, "57 points");
    refused!(rewrite(&|b| b[9] = 0xff), InputError::Malformed { .. }, "POINT:FRAMES");
    // the numbers are mm, the file claims m
    let units = |b: &mut Vec<u8>| {
        let at = b.windows(5).position(|w| w == b"UNITS").unwrap();
        assert_eq!(&b[at + 10..at + 12], b"mm");
        b[at + 10..at + 12].copy_from_slice(b"m ");
    };
    refused!(
        rewrite(&units),
        InputError::WrongUnits { .. } | InputError::Malformed { .. },
        "jw_ngait_og3.c3d"
    );
    // two names exchanged in the list of labels of one recording: the other recordings tell
    let names = |b: &mut Vec<u8>| {
        let place = |n: &[u8]| b.windows(n.len()).position(|w| w == n).unwrap();
        let (first, second) = (place(b"RThighSuperior "), place(b"RThighInferior "));
        b[first..first + 15].copy_from_slice(b"RThighInferior ");
        b[second..second + 15].copy_from_slice(b"RThighSuperior ");
    };
    refused!(rewrite(&names), InputError::Swapped { .. }, "RThighSuperior", "RThighInferior");
}

#[test]
fn check_reports_on_trial_files() {
    let walking = Walking::new();
    let text = multibody::read::check(&walking.write(), None).unwrap();
    assert!(
        text.contains("15 markers") && text.contains("101 frames") && text.contains("table of"),
        "{text}"
    );
    let mut bad = Walking::new();
    bad.marker("heel").fill(None);
    refused!(multibody::read::check(&bad.write(), None).unwrap_err(), InputError::NeverSeen { .. }, "heel");
}

// ------------------------------------------------------------------------------------------------ both legs

/// The curves of a leg on the page of both.
fn curves(page: &str, leg: &str) -> Vec<String> {
    let mark = format!("data-name=\"{leg}\" d=\"");
    page.split(&mark).skip(1).map(|rest| rest.split('"').next().unwrap().to_string()).collect()
}

/// A left leg that is the mirror image of the right one is the same leg, from the markers to the page.
#[test]
fn the_left_leg_of_a_mirrored_walker_is_its_right_leg() {
    let walking = Walking::new().with_mirror_image();
    let path = walking.write();
    let file = TrialFile::read(&path).unwrap();
    assert_eq!(file.sides(), [Side::Right, Side::Left]);
    let [right, left] = [Side::Right, Side::Left].map(|side| file.leg(side).load(None).unwrap());
    assert_eq!((right.side, left.side), (Side::Right, Side::Left));
    assert_same(&right, &left, 1e-12, 1e-9);

    let run = sartorius(&["optimize", "walk.toml", "--out", "out"], &walking.folder());
    let said = String::from_utf8_lossy(&run.stdout).into_owned();
    assert_eq!(run.status.code(), Some(0), "{said}{}", String::from_utf8_lossy(&run.stderr));
    assert!(said.contains(", right leg, ") && said.contains(", left leg, mirrored, "), "{said}");
    let out = walking.folder().join("out");
    for table in
        ["kinematics", "muscle_forces", "activations", "joint_forces", "joint_moments", "ground_reaction"]
    {
        let read = |side: &str| std::fs::read_to_string(out.join(side).join(format!("{table}.csv"))).unwrap();
        let (right, left) = (read("right"), read("left"));
        assert_eq!(right.lines().next(), left.lines().next(), "{table}");
        let numbers = |text: &str| -> Vec<f64> {
            text.lines().skip(1).flat_map(|l| l.split(',')).map(|n| n.parse().unwrap()).collect()
        };
        let (right, left) = (numbers(&right), numbers(&left));
        assert!(right.len() > 500 && right.len() == left.len(), "{table}");
        for (a, b) in right.iter().zip(&left) {
            assert!((a - b).abs() <= 1e-7 * (1.0 + a.abs()), "{table}: {a} and {b}");
        }
    }
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    for text in
        ["Right 101 of 101, left 101 of 101 frames solved", "href=\"left/report.html\"", ">Lateral</b>"]
    {
        assert!(page.contains(text), "{text}");
    }
    assert!(curves(&page, "right").len() > 60);
    assert_eq!(curves(&page, "right"), curves(&page, "left"), "the same curves in every figure");
    let record: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("run.json")).unwrap()).unwrap();
    assert_eq!(record["status"], "solved");
    assert_eq!(record["subject"], "walker, male, 70 kg, 1.72 m, both legs");
    assert_eq!(record["again"]["arguments"][1], "trial/walk.toml");
    assert!(record["again"]["files"]["trial/walk.toml"].as_str().unwrap().contains("[left.force]"));
    for stage in ["right marker fit", "left marker fit", "left read", "write"] {
        assert!(record["seconds"][stage].is_number(), "{stage}");
    }
    assert_eq!(record["inputs"].as_array().unwrap().len(), 4, "each file once");
    assert_eq!(record["verdict"]["right"]["solved"], record["verdict"]["left"]["solved"]);
    assert!(record["files"].as_array().unwrap().iter().any(|f| f == "left/kinematics.csv"));
}

/// The real walker: the right leg is as if it were alone. The left one of the published form is not solved throughout, which is told in one line; the
/// default solves both.
#[test]
fn both_legs_of_a_recorded_walk() {
    const PUBLISHED: [&str; 2] = ["--form", "published"];
    let Some(data) = shared("gait") else { return };
    let at = tempfile::tempdir().unwrap();
    let run = |trial: &str, more: &[&str]| {
        let arguments = ["optimize", trial, "--data", data.to_str().unwrap(), "--out", trial];
        sartorius(&[&arguments, more].concat(), at.path())
    };
    let both = run("jw_ngait_og3_both", &PUBLISHED);
    let said = String::from_utf8(both.stdout).unwrap();
    assert_eq!(both.status.code(), Some(3), "frames of the left leg have no solution: {said}");
    assert!(said.contains("137 of 137 frames solved") && said.contains("118 of 127 frames solved"), "{said}");
    let unsolved: Vec<&str> = said.lines().filter(|l| l.starts_with("  frame")).collect();
    assert_eq!(unsolved.len(), 1, "{said}");
    assert!(unsolved[0].starts_with("  frames 108–116 (3.175 to 3.242 s): infeasible, hip flexion lacks"));
    let record: serde_json::Value =
        serde_json::from_slice(&std::fs::read(at.path().join("jw_ngait_og3_both/run.json")).unwrap())
            .unwrap();
    assert_eq!(record["status"], "not_converged");
    assert_eq!(record["reason"], "left leg: 9 of 127 frames are not solved; see left/verdicts.csv");

    // Every figure has both legs, and they are two.
    let read = |file: &str| std::fs::read_to_string(at.path().join("jw_ngait_og3_both").join(file)).unwrap();
    let page = read("report.html");
    let (right, left) = (curves(&page, "right"), curves(&page, "left"));
    assert!(right.len() > 60 && right.len() == left.len());
    assert!(right.iter().zip(&left).all(|(a, b)| a != b));
    // Frames without solution are a gap in the curves of forces of the left leg alone.
    let has_gap = |curve: &&String| curve.matches('M').count() == 2;
    assert!(left.iter().filter(has_gap).count() > 40 && !right.iter().any(|curve| has_gap(&curve)));
    assert!(page.contains("<td class=\"n\">137 of 137</td><td class=\"n\">118 of 127</td>"));
    for (leg, frames) in [("right", 137), ("left", 127)] {
        assert_eq!(read(&format!("{leg}/kinematics.csv")).lines().count(), 1 + frames);
    }

    assert_eq!(run("jw_ngait_og3", &PUBLISHED).status.code(), Some(0));
    for table in ["kinematics.csv", "muscle_forces.csv", "verdicts.csv", "gait2392_motion.mot"] {
        let read = |folder: &str| std::fs::read_to_string(at.path().join(folder).join(table)).unwrap();
        let without_title = |text: String| text.split_once('\n').unwrap().1.to_string();
        let (alone, of_both) = (read("jw_ngait_og3"), read("jw_ngait_og3_both/right"));
        assert_eq!(without_title(alone), without_title(of_both), "{table}");
    }

    let json = run("jw_ngait_og3_both", &["--form", "published", "--json", "--quiet"]);
    let verdict: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!((&verdict["right"]["solved"], &verdict["left"]["solved"]), (&137.into(), &118.into()));
    assert!(json.stderr.is_empty());

    let json = run("jw_ngait_og3_both", &["--json", "--quiet"]);
    assert_eq!(json.status.code(), Some(0));
    let verdict: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!((&verdict["right"]["solved"], &verdict["left"]["solved"]), (&137.into(), &127.into()));
}

/// One knee is instrumented: that of the right leg.
#[test]
fn measured_knee_forces_are_those_of_the_right_knee() {
    let walking = Walking::new().with_mirror_image();
    walking.write();
    let rows: String = (0..150).map(|i| format!("{},500,400\n", 0.01 * f64::from(i))).collect();
    std::fs::write(walking.folder().join("knee.csv"), format!("time_s,medial_N,lateral_N\n{rows}")).unwrap();
    let run = sartorius(
        &["optimize", "walk.toml", "--out", "o", "--measured", "knee.csv", "--json"],
        &walking.folder(),
    );
    let verdict: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    assert!(verdict["right"]["measured"].is_array() && verdict["left"]["measured"].is_null(), "{verdict}");
    let page = std::fs::read_to_string(walking.folder().join("o/left/report.html")).unwrap();
    assert!(page.contains("compared with the right leg"));
}

/// A scene takes one leg, and says so.
#[test]
fn a_scene_with_a_trial_of_both_legs_takes_the_right_one_and_says_so() {
    let walking = Walking::new().with_mirror_image();
    walking.write();
    std::fs::write(walking.folder().join("s.toml"), "trial = \"walk.toml\"\nmuscles = \"none\"\n").unwrap();
    for command in ["compare", "plan", "step"] {
        let run = sartorius(&[command, "s.toml", "--quiet"], &walking.folder());
        let said = String::from_utf8(run.stderr).unwrap();
        assert_eq!(run.status.code(), Some(0), "{said}");
        assert!(said.starts_with("note: walk.toml describes both legs; this is of the right one"), "{said}");
    }
    let record = std::fs::read(walking.folder().join("out/compare-s/run.json")).unwrap();
    let record: serde_json::Value = serde_json::from_slice(&record).unwrap();
    assert!(record["subject"].as_str().unwrap().ends_with("right leg"));
    let notes = record["notes"].as_array().unwrap();
    assert!(notes.iter().any(|note| note.as_str().unwrap().contains("both legs")), "{notes:?}");
    let page = std::fs::read_to_string(walking.folder().join("out/compare-s/report.html")).unwrap();
    assert!(page.contains("describes both legs"));
}

/// What `optimize` and `check` say of a walker of two legs after a change: the exit code and standard error of each.
fn said_of_both(change: impl FnOnce(&mut Walking)) -> [(i32, String); 2] {
    let mut walking = Walking::new().with_mirror_image();
    change(&mut walking);
    walking.write();
    let before = std::fs::read_dir(walking.folder()).unwrap().count();
    let said = [&["optimize", "walk.toml", "--out", "out"][..], &["check", "walk.toml"]].map(|arguments| {
        let run = sartorius(arguments, &walking.folder());
        (run.status.code().unwrap(), String::from_utf8(run.stderr).unwrap())
    });
    assert_eq!(std::fs::read_dir(walking.folder()).unwrap().count(), before, "nothing is written");
    said
}

/// Number of the line that begins with this text, after another line.
fn line_after(text: &str, after: &str, start: &str) -> usize {
    let first = text.lines().position(|l| l.starts_with(after)).unwrap();
    first + 1 + text.lines().skip(first).position(|l| l.starts_with(start)).unwrap()
}

#[test]
fn mistakes_in_both_legs_are_told_at_once_with_the_leg_and_the_line() {
    let mut lines = [0; 3];
    let said = said_of_both(|w| {
        w.replace("[left.force]\nplates = [2]", "[left.force]\nplates = [7]");
        w.replace("[force]\nfile = \"walk.sto\"\nplates = [1]", "[force]\nfile = \"walk.sto\"\nplates = [9]");
        w.replace("[\"M_heel\"", "[\"M_hell\"");
        lines = [
            line_after(&w.toml, "[left.force]", "plates"),
            line_after(&w.toml, "[force]", "plates"),
            line_after(&w.toml, "[left.markers]", "foot"),
        ];
    });
    for (code, text) in said {
        assert_eq!(code, 2, "{text}");
        for (leg, line, what) in [
            ("left", lines[0], "`plates` is 7"),
            ("right", lines[1], "`plates` is 9"),
            ("left", lines[2], "`M_hell` is not in"),
        ] {
            let start = format!("error: {leg} leg: walk.toml, line {line}: {what}");
            assert!(text.lines().any(|l| l.starts_with(&start)), "{start}\n{text}");
        }
    }
    // What is wrong with both is told once, and of no leg.
    for (code, text) in said_of_both(|w| {
        w.replace("\"walk.trc\"", "\"wolk.trc\"");
    }) {
        assert_eq!((code, text.matches("wolk.trc").count(), text.contains(" leg:")), (2, 1, false), "{text}");
    }
}

#[test]
fn a_left_leg_that_contradicts_the_right_one_is_refused() {
    let refused = |from: &str, to: &str, words: &[&str]| {
        let mut walking = Walking::new().with_mirror_image();
        walking.replace(from, to);
        let error = TrialFile::read(&walking.write()).expect_err(to).to_string();
        words.iter().for_each(|word| assert!(error.contains(word), "`{word}` is not in: {error}"));
    };
    refused("thigh = [\"M_", "thigh = [\"", &["left leg: ", "right leg already"]);
    refused("side = \"right\"", "side = \"left\"", &["`side` is left", "take [left] out"]);
    refused("[left.force]\nplates = [2]", "[left.force]\nplates = []", &["left leg: ", "`plates` is empty"]);
    refused("[left.force]\nplates = [2]", "[left.force]\nplate = [2]", &["did you mean `plates`"]);
    let range = "[left.range]\nstart_s = 1\nend_s = 0\n[left.force]";
    refused("[left.force]", range, &["left leg: ", "`start_s` is 1"]);
}

/// Without markers of its own for the pelvis, the left leg has those of the right one.
#[test]
fn the_left_leg_has_the_pelvis_of_the_right_one() {
    let mut walking = Walking::new().with_mirror_image();
    let pelvis = "pelvis = [\"M_RASI\", \"M_LASI\", \"M_RPSI\", \"M_LPSI\"]\n";
    walking.replace(pelvis, "");
    for item in ["right ASIS", "left ASIS", "right PSIS", "left PSIS"] {
        let line = walking.toml.lines().rfind(|l| l.starts_with(&format!("\"{item}\""))).unwrap().to_string();
        walking.toml = walking.toml.replace(&(line + "\n"), "");
    }
    let file = TrialFile::read(&walking.write()).unwrap();
    let left = file.leg(Side::Left);
    assert_eq!(left.markers.pelvis, ["RASI", "LASI", "RPSI", "LPSI"]);
    let trial = left.load(None).unwrap();
    assert!(trial.markers.iter().any(|m| m.name == "RASI"));
    let Landmarks::Table { recorded, .. } = left.landmarks(None).unwrap().source else { panic!() };
    assert_eq!((recorded["right ASIS"].as_str(), recorded["heel"].as_str()), ("LASI", "M_heel"));
}

/// Recordings of a walker in a mirror, right names for left ones, give the calibration of the walker himself.
#[test]
fn functional_landmarks_of_a_left_leg_are_those_of_its_mirror_image() {
    let Some(data) = shared("gait") else { return };
    let other = |name: &str| match name.split_at(1) {
        ("R", rest) => format!("L{rest}"),
        ("L", rest) => format!("R{rest}"),
        _ => name.to_string(),
    };
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("jw")).unwrap();
    for trial in ["jw_ngait_og1", "jw_ngait_og3", "jw_ngait_og7"] {
        let recorded = c3d::read(&data.join("jw").join(trial).with_extension("c3d")).unwrap().markers;
        let mut mirrored = Walking::new();
        // The y axis of the laboratory points to the right.
        let image = |p: &Option<Vector3<f64>>| p.map(|p| Vector3::new(p.x, -p.y, p.z) * 1e3);
        let paths = recorded.names.iter().zip(&recorded.position);
        let bare = |name: &str| name.rsplit(':').next().unwrap_or(name).to_string();
        mirrored.markers =
            paths.map(|(name, path)| (other(&bare(name)), path.iter().map(image).collect())).collect();
        mirrored.time = recorded.time;
        let path = folder.path().join("jw").join(trial).with_extension("trc");
        std::fs::write(path, mirrored.trc()).unwrap();
    }
    let text = std::fs::read_to_string(shipped_trial("jw_ngait_og3_both")).unwrap();
    let path = folder.path().join("both.toml");
    std::fs::write(&path, text.replace(".c3d", ".trc")).unwrap();
    let calibrated = |file: &Path, side, data: Option<&Path>| {
        let spec = TrialFile::read(file).unwrap().leg(side).landmarks(data).unwrap();
        let (anatomy, quality) = calibrate(&spec, Sex::Male, &Shifts::none()).unwrap();
        (anatomy, quality.unwrap())
    };
    let (right, seen) = calibrated(&shipped_trial("jw_ngait_og3_both"), Side::Right, Some(&data));
    let (left, seen_mirrored) = calibrated(&path, Side::Left, None);
    let numbers = |q: functional::Quality| [q.knee_rms, q.knee_range, q.ankle_rms, q.ankle_range];
    for (a, b) in numbers(seen).into_iter().zip(numbers(seen_mirrored)) {
        assert!((a - b).abs() < 1e-6, "{seen:?} and {seen_mirrored:?}");
    }
    // Distances of the joint centres from the markers do not depend on the axes of a cluster.
    let distances = |anatomy: &Anatomy| -> BTreeMap<String, f64> {
        let centres = [
            (SegmentId::Pelvis, anatomy.pelvis.hip),
            (SegmentId::Thigh, anatomy.thigh.knee),
            (SegmentId::Shank, anatomy.shank.ankle),
            (SegmentId::Foot, anatomy.foot.ankle),
        ];
        let of = |(segment, centre): (SegmentId, Vector3<f64>)| {
            let cluster = &anatomy.clusters[segment.index()];
            let names = cluster.names.clone().into_iter();
            names.zip(cluster.points.clone()).map(move |(name, p)| (name, (p - centre).norm()))
        };
        centres.into_iter().flat_map(of).collect()
    };
    let (right, left) = (distances(&right), distances(&left));
    assert_eq!(right.len(), left.len());
    assert!(right.len() >= 13, "all tracked markers");
    for (name, distance) in right {
        let mirrored = left[&other(&name)];
        assert!((distance - mirrored).abs() < 1e-6, "{name}: {distance} and {mirrored} m");
    }
}
