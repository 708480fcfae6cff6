use super::*;

/// The shipped trial file and the one written for its recording, without the folders in which recordings lie.
fn written_and_shipped(
    recording: &str,
    name: &str,
) -> Option<(TrialFile, TrialFile, PathBuf, tempfile::TempDir)> {
    let data = shared("gait")?;
    let folder = tempfile::tempdir().unwrap();
    let trials = folder.path().join("trials");
    fs::create_dir_all(folder.path().join("subjects")).unwrap();
    fs::create_dir_all(&trials).unwrap();
    fs::copy(root().join("gait-data/subjects/DM.csv"), folder.path().join("subjects/DM.csv")).unwrap();
    let made =
        guess(&Wishes { motion: data.join(recording), folder: trials.clone(), ..Wishes::default() }).unwrap();
    assert_eq!(made.open, Vec::<String>::new(), "{}", made.text);
    let path = trials.join(name).with_extension("toml");
    fs::write(&path, &made.text).unwrap();
    let written = TrialFile::read(&path).unwrap();
    let shipped =
        TrialFile::read(&root().join("gait-data/trials").join(name).with_extension("toml")).unwrap();
    let beside = data.join(Path::new(recording).parent().unwrap());
    assert_eq!(made.data.as_deref(), Some(beside.as_path()));
    Some((written, shipped, beside, folder))
}

#[test]
fn the_template_of_a_shipped_recording_is_the_shipped_trial() {
    for (recording, name) in [
        ("dm/DM_ngait_og3_new.trc", "DM_ngait_og3"),
        ("dm/DM_ngait_og4_new.trc", "DM_ngait_og4"),
        ("jw/jw_ngait_og1.c3d", "jw_ngait_og1"),
        ("jw/jw_ngait_og3.c3d", "jw_ngait_og3"),
        ("jw/jw_ngait_og7.c3d", "jw_ngait_og7"),
    ] {
        let Some((written, shipped, beside, _folder)) = written_and_shipped(recording, name) else { return };
        assert_eq!(
            (written.axes, &written.subject, &written.range),
            (shipped.axes, &shipped.subject, &shipped.range),
            "{name}"
        );
        assert_eq!((&written.markers, written.filter), (&shipped.markers, shipped.filter), "{name}");
        assert_eq!(
            (&written.force.plates, written.force.next_plate),
            (&shipped.force.plates, shipped.force.next_plate)
        );
        let (a, b) = (written.load(Some(&beside)).unwrap(), shipped.load(shared("gait").as_deref()).unwrap());
        assert_eq!(a, b, "{name}");
        let (a, b) = (
            written.landmarks(Some(&beside)).unwrap(),
            shipped.landmarks(shared("gait").as_deref()).unwrap(),
        );
        assert_eq!(a, b, "{name}");
    }
}

/// With the `#` taken from what is of the recording, the template of a walk of both legs is a trial of both.
#[test]
fn a_template_offers_the_left_leg_too() {
    let Some(data) = shared("gait") else { return };
    let folder = tempfile::tempdir().unwrap();
    let template = |recording: &str| {
        let folder = folder.path().to_path_buf();
        guess(&Wishes { motion: data.join(recording), folder, ..Wishes::default() }).unwrap().text
    };
    let text = template("jw/jw_ngait_og3.c3d");
    let (right, left) = text.split_once("\n# [left]\n").unwrap();
    let wanted = ["[left.markers]", "[left.force]", "[left.range]", "[left.landmarks]"];
    let keys = [
        "thigh",
        "shank",
        "foot",
        "plates",
        "start_s",
        "end_s",
        "patella",
        "heel",
        "metatarsal_1",
        "metatarsal_5",
    ];
    let uncommented = |line: &str| {
        let bare = line.strip_prefix("# ").unwrap_or(line);
        let is_key = bare.split_once(" = ").is_some_and(|(key, _)| keys.contains(&key));
        if wanted.contains(&bare) || is_key { bare.to_string() } else { line.to_string() }
    };
    let left: Vec<String> = left.lines().map(uncommented).collect();
    let path = folder.path().join("jw_ngait_og3_both.toml");
    fs::write(&path, [right, &left.join("\n")].join("\n")).unwrap();
    let written = TrialFile::read(&path).unwrap().leg(Side::Left);
    let shipped =
        TrialFile::read(&root().join("gait-data/trials/jw_ngait_og3_both.toml")).unwrap().leg(Side::Left);
    assert_eq!((&written.markers, &written.force.plates), (&shipped.markers, &shipped.force.plates));
    assert_eq!(written.landmarks.metatarsal_5, shipped.landmarks.metatarsal_5);
    let trial = written.load(Some(&data.join("jw"))).unwrap();
    assert_eq!(trial.side, Side::Left);
    // Of subject DM the program has a table, of the right leg.
    assert!(!template("dm/DM_ngait_og3_new.trc").contains("The left leg has its markers, too."));
}

#[test]
fn a_template_turns_units_and_finds_the_left_leg() {
    // The walker as a left leg in a laboratory with z up, in metres that claim to be millimetres, names of a common set with a prefix.
    let mut walking = Walking::new();
    let name = |n: &str| match n {
        "RASI" => "LASI".into(),
        "LASI" => "RASI".into(),
        "RPSI" => "LPSI".into(),
        "LPSI" => "RPSI".into(),
        "heel" => "L_Heel".into(),
        "thigh_superior" => "L_Thigh_Superior".into(),
        "thigh_inferior" => "L_Thigh_Inferior".into(),
        "thigh_lateral" => "L_Thigh_Lateral".into(),
        "metatarsal_head_1" => "L_Midfoot_Medial".into(),
        "metatarsal_head_5" => "L_Midfoot_Lateral".into(),
        other => other.replace("R_", "L_"),
    };
    let asis = |n: String| n.replace("ASI", "_Asis").replace("PSI", "_Psis");
    walking.markers.iter_mut().for_each(|m| m.0 = format!("S7:{}", asis(name(&m.0))));
    walking.map(|p| Vector3::new(-p.x, -p.z, p.y) * 1e-3);
    walking.plates.iter_mut().flatten().for_each(|(f, p)| {
        (*f, *p) = (Vector3::new(-f.x, -f.z, f.y), Vector3::new(-p.x, -p.z, p.y));
    });
    let path = walking.write();
    let folder = path.parent().unwrap().to_path_buf();
    let made = guess(&Wishes { motion: folder.join("walk.trc"), folder, ..Wishes::default() }).unwrap();
    for words in [
        "x = \"-x\"",
        "y = \"z\"",
        "z = \"y\"",
        "units = \"m\"",
        "side = \"left\"",
        "thigh = [\"L_Thigh_Superior\"",
        "plates = [1]",
        "cycle = 1",
        "file = \"walk.sto\"",
        "# FILL IN: mass_kg",
        "# FILL IN: sex",
    ] {
        assert!(made.text.contains(words), "{words} is not in\n{}", made.text);
    }
    assert!(made.open.contains(&"mass_kg".to_string()), "{:?}", made.open);
}

#[test]
fn common_marker_sets_are_recognised() {
    let walk = Walking::new();
    let pose: Vec<_> = walk.markers[0].1.clone();
    for (set, names, landmarks) in [
        (
            "Plug-in Gait",
            "LASI RASI LPSI RPSI RTHI RKNE RKNM RTIB RANK RANM RHEE RTOE RMT1 RMT5",
            &[
                "lateral_epicondyle = \"RKNE\"",
                "medial_malleolus = \"RANM\"",
                "thigh = [\"RTHI\", \"RKNE\", \"RKNM\"]",
            ][..],
        ),
        (
            "CAST (Cappozzo)",
            "R_IAS L_IAS R_IPS L_IPS R_TH1 R_TH2 R_TH3 R_TH4 R_SK1 R_SK2 R_SK3 R_FLE R_FME R_FAL R_TAM R_FCC R_FM1 R_FM2 R_FM5",
            &["lateral_epicondyle = \"R_FLE\"", "medial_malleolus = \"R_TAM\"", "heel = \"R_FCC\""],
        ),
        (
            "Helen Hayes",
            "R.ASIS L.ASIS V.Sacral R.Thigh.Upper R.Thigh.Front R.Thigh.Rear R.Knee.Lat R.Knee.Med R.Shank.Upper R.Shank.Front R.Shank.Rear R.Ankle.Lat R.Ankle.Med R.Heel R.Toe.Lat R.Toe.Med R.Toe.Tip",
            &["right_psis = \"V.Sacral\"", "left_psis = \"V.Sacral\"", "metatarsal_5 = \"R.Toe.Lat\""],
        ),
    ] {
        let mut walking = Walking::new();
        walking.markers = names.split(' ').map(|n| (n.to_string(), pose.clone())).collect();
        let path = walking.write();
        let folder = path.parent().unwrap().to_path_buf();
        let made = guess(&Wishes {
            motion: folder.join("walk.trc"),
            folder,
            side: Some(Side::Right),
            ..Wishes::default()
        })
        .unwrap();
        assert!(made.text.contains(&format!("Names of the set {set}.")), "{}", made.text);
        for words in landmarks {
            assert!(made.text.contains(words), "{set}: {words} is not in\n{}", made.text);
        }
    }
}

#[test]
fn a_template_is_never_written_over_and_every_scene_has_one() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| sartorius(arguments, folder.path()).status.code();
    assert_eq!(run(&["template", "scene", "--out", "a.toml"]), Some(0));
    fs::write(folder.path().join("a.toml"), "muscles = \"none\"\n").unwrap();
    assert_eq!(run(&["template", "scene", "--out", "a.toml"]), Some(2));
    assert_eq!(fs::read_to_string(folder.path().join("a.toml")).unwrap(), "muscles = \"none\"\n");
    assert_eq!(run(&["template", "scene", "a.toml", "--out", "b.toml"]), Some(0));
    assert!(!Scene::read(&folder.path().join("b.toml"), None).unwrap().deformable);
    assert_eq!(run(&["template", "scene", "--out", "a.toml", "--force"]), Some(0));
    assert_eq!(run(&["template", "trial", "nowhere.c3d"]), Some(2));
    for entry in fs::read_dir(root().join("gait-data/scenes")).unwrap() {
        let file = entry.unwrap().path();
        let output = sartorius(&["template", "scene", file.to_str().unwrap()], folder.path());
        let text = String::from_utf8(output.stdout).unwrap();
        let own = fs::read_to_string(&file).unwrap();
        let same = |text: &str| {
            let scene =
                Scene::parse(&root().join("gait-data/scenes/x.toml"), text, shared("anatomy").as_deref());
            scene.map(|s| Scene { text: String::new(), ..s }).map_err(|e| e.to_string())
        };
        assert_eq!(same(&text), same(&own), "{}", file.display());
    }
}
