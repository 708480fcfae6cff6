use super::*;

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
