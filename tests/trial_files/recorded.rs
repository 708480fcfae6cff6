use super::*;

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
