use super::*;

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
