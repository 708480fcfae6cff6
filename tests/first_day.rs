//! The first day of a user: does `check` name every mistake at once, and does `template` write a trial file that runs?

use std::fs;
use std::path::{Path, PathBuf};

use coupling::scene::{KEYS as SCENE_KEYS, Scene, TomlKind};
use multibody::InputError;
use multibody::keys::page;
use multibody::trial::Side;
use multibody::trial_file::{KEYS, TrialFile, Wishes, guess};
use nalgebra::Vector3;
use support::walking::Walking;
use support::{sartorius, shared};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Every message that `check` has for this trial file and its recordings.
fn mistakes(walking: &Walking) -> Vec<String> {
    match multibody::read::check(&walking.write(), None) {
        Ok(good) => panic!("nothing was noticed: {good}"),
        Err(InputError::Several(all)) => all.iter().map(InputError::to_string).collect(),
        Err(one) => vec![one.to_string()],
    }
}

/// Each of `wanted` is in a message of its own, and there are no others.
fn assert_named(messages: &[String], wanted: &[&[&str]]) {
    for words in wanted {
        let hits = messages.iter().filter(|m| words.iter().all(|w| m.contains(w))).count();
        assert_eq!(hits, 1, "{words:?} in {messages:#?}");
    }
    assert_eq!(messages.len(), wanted.len(), "{messages:#?}");
}

// ------------------------------------------------------------------------------------------------ check

#[test]
fn every_mistake_of_a_trial_file_is_named_at_once() {
    let mut walking = Walking::new();
    walking
        .replace("mass_kg = 70", "mas_kg = 7000")
        .replace("height_m = 1.72", "height_m = 172")
        .replace("side = \"right\"", "side = \"rigth\"\nshoe = 44")
        .replace("cycle = 1", "cycle = 0")
        .replace("plates = [1]", "plates = []")
        .replace("source = \"table\"", "source = \"table\"\nhip_centre = [0.1, 77.0, 0.1]");
    // `side` must be there and cannot be used, so the file itself is all that is examined.
    assert_named(
        &mistakes(&walking),
        &[
            &["line 5", "unknown key `mas_kg`", "did you mean `mass_kg`", "name, mass_kg, height_m"],
            &["line 5", "`mass_kg` is 7000", "10 to 400"],
            &["line 6", "`height_m` is 172"],
            &["line 8", "`rigth`", "did you mean `right`"],
            &["line 9", "unknown key `shoe`", "in [subject]"],
            &["line 12", "`cycle` is 0", "1 to 1000"],
        ],
    );
    walking
        .replace("side = \"rigth\"\nshoe = 44", "side = \"right\"")
        .replace("foot = [", "foot = [\"hel\", ");
    walking.exchange("RASI", "LASI", 0);
    // With nothing but values wrong, the recordings are examined, too.
    assert_named(
        &mistakes(&walking),
        &[
            &["unknown key `mas_kg`"],
            &["`mass_kg` is 7000"],
            &["`height_m` is 172"],
            &["`cycle` is 0"],
            &["`plates` is empty"],
            &["`hip_centre`", "three numbers in m"],
            &["`hel`", "without a place"],
            &["`hel` is not in", "did you mean `heel`"],
            &["`LASI` and `RASI` seem exchanged"],
        ],
    );
}

#[test]
fn a_list_of_no_plates_is_told_once_beside_other_mistakes() {
    // An unknown key does not keep the recordings from being examined.
    let mut walking = Walking::new();
    walking.replace("plates = [1]", "plates = []");
    walking.toml += "\n[filter]\nzh = 5.0\n";
    assert_named(&mistakes(&walking), &[&["unknown key `zh`"], &["`plates` is empty"]]);
}

#[test]
fn mistakes_of_the_recordings_are_named_together() {
    let mut walking = Walking::new();
    walking
        .replace("plates = [1]", "plates = [1, 7]")
        .replace("\"f1_vy\"", "\"f1_vyy\"")
        .replace("\"thigh_superior\", ", "\"thigh_superor\", ")
        .replace("\"thigh superior\" = \"thigh_superior\"\n", "");
    walking.marker("heel").fill(None);
    let messages = mistakes(&walking);
    for words in
        [&["`thigh_superor` is not in"][..], &["`heel` is not seen"], &["`f1_vyy`"], &["`plates` is 7"]]
    {
        assert!(messages.iter().any(|m| words.iter().all(|w| m.contains(w))), "{words:?}: {messages:#?}");
    }
}

#[test]
fn pounds_are_doubted_and_nothing_is_refused_for_it() {
    let good = multibody::read::check(&Walking::new().write(), None).unwrap();
    assert!(!good.contains("doubt"), "{good}");
    let mut walking = Walking::new();
    walking.replace("mass_kg = 70", "mass_kg = 154.3");
    let said = multibody::read::check(&walking.write(), None).unwrap();
    assert!(said.contains("doubt: ") && said.contains("line 5: `mass_kg` is 154.3"), "{said}");
    assert!(said.contains("body weights") && said.contains("if these are pounds, give 70.0"), "{said}");
    let output =
        sartorius(&["optimize", "trials/walk.toml", "--out", "o"], walking.folder().parent().unwrap());
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("if these are pounds"), "{said}");
    // The same of a scene with that trial: on the console, on the page and in run.json.
    let scene = "trial = \"trials/walk.toml\"\nmuscles = [\"gluteus_minimus\"]\nresolution_mm = 20.0\n[[step]]\nname = \"heel_strike\"\n";
    let folder = walking.folder();
    let folder = folder.parent().unwrap();
    std::fs::write(folder.join("glutei.toml"), scene).unwrap();
    let output = sartorius(&["compare", "glutei.toml", "--contact", "without", "--out", "c"], folder);
    let said = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("  note: ") && said.contains("if these are pounds"), "{said}{errors}");
    for file in ["report.html", "run.json"] {
        let text = std::fs::read_to_string(folder.join("c").join(file)).unwrap();
        assert!(text.contains("if these are pounds"), "{file}");
    }
}

/// A trial with markers on epicondyles, malleoli and the foot, in the trial itself.
fn with_landmarks() -> Walking {
    let mut walking = Walking::new();
    let table = walking.toml.find("[landmarks]").unwrap();
    walking.toml.truncate(table);
    walking.toml += "[landmarks]\nsource = \"markers\"\nright_asis = \"RASI\"\nleft_asis = \"LASI\"\nright_psis = \"RPSI\"\nleft_psis = \"LPSI\"\n\
        heel = \"heel\"\nmetatarsal_1 = \"metatarsal_head_1\"\nmetatarsal_5 = \"metatarsal_head_5\"\nlateral_epicondyle = \"KL\"\n\
        medial_epicondyle = \"KM\"\nlateral_malleolus = \"AL\"\nmedial_malleolus = \"AM\"\n";
    // 40 mm outwards and inwards of a marker that is on the segment.
    for (name, beside, z) in [
        ("KL", "thigh_inferior", 40.0),
        ("KM", "thigh_inferior", -40.0),
        ("AL", "R_Shank_Inferior", 35.0),
        ("AM", "R_Shank_Inferior", -35.0),
    ] {
        let path =
            walking.marker(beside).iter().map(|p| p.map(|p| p + Vector3::new(0.0, -30.0, z))).collect();
        walking.markers.push((name.to_string(), path));
    }
    walking
}

#[test]
fn a_marker_in_two_roles_and_exchanged_epicondyles_are_named() {
    assert!(multibody::read::check(&with_landmarks().write(), None).is_ok());
    let mut walking = with_landmarks();
    walking
        .replace("lateral_malleolus = \"AL\"", "lateral_malleolus = \"AM\"")
        .replace("lateral_epicondyle = \"KL\"", "lateral_epicondyle = \"KM\"")
        .replace("medial_epicondyle = \"KM\"", "medial_epicondyle = \"KL\"");
    assert_named(
        &mistakes(&walking),
        &[
            &["line", "`medial_malleolus` is `AM`", "stands for `lateral_malleolus` already"],
            &["walk.trc", "`KM` and `KL` seem exchanged", "inner side of the right leg"],
        ],
    );
    let mut elsewhere = with_landmarks();
    elsewhere.replace("foot = [", "foot = [\"KL\", ");
    assert_named(&mistakes(&elsewhere), &[&["`lateral_epicondyle` is `KL`", "on the thigh", "for the foot"]]);
}

#[test]
fn one_marker_on_the_sacrum_stands_for_both_posterior_spines() {
    let mut walking = with_landmarks();
    walking.replace("left_psis = \"LPSI\"", "left_psis = \"RPSI\"");
    let said = multibody::read::check(&walking.write(), None);
    assert!(said.is_ok(), "{said:?}");
}

#[test]
fn a_scene_is_told_from_a_trial_by_its_content() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("a.toml", "resolutoin_mm = 60\n[effects]\ncontact = \"gaurded\"\nmass_kg = 3\n");
    write("b.toml", "motion = \"x.c3d\"\n[subject]\nmass_kg = 1\n");
    write("c.toml", "muscles = [\"sartorius\"]\nresolution_mm = 8\n");
    let run = |arguments: &[&str]| {
        let output = sartorius(arguments, folder.path());
        (
            output.status.code(),
            String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr),
        )
    };
    let (code, said) = run(&["check", "a.toml"]);
    assert_eq!(code, Some(2), "{said}");
    for words in [
        "a.toml, line 1: unknown key `resolutoin_mm`",
        "line 1: `resolution_mm` is 60",
        "line 3: `contact`",
        "line 4: unknown key `mass_kg`",
    ] {
        assert!(said.contains(words), "{words}: {said}");
    }
    assert_eq!(said.matches("error: ").count(), 4, "{said}");
    let (code, said) = run(&["check", "b.toml"]);
    assert!(code == Some(2) && said.contains("`height_m` is missing in [subject]"), "{said}");
    assert!(said.contains("`landmarks` is missing; add [landmarks]"), "{said}");
    let (code, said) = run(&["check", "c.toml"]);
    assert!(code == Some(0) && said.contains("good. Scene.") && said.contains("Resolution: 8 mm"), "{said}");
    let (code, said) = run(&["optimize", "c.toml"]);
    assert!(code == Some(2) && said.contains("this is a scene"), "{said}");
    let (code, said) = run(&["plan", "b.toml"]);
    assert!(code == Some(2) && said.contains("this is a trial file"), "{said}");
    assert_eq!(TomlKind::of(""), TomlKind::Scene);
}

// ------------------------------------------------------------------------------------------------ recordings

#[test]
fn prefixes_of_marker_names_may_be_left_away_or_be_there() {
    let reference = Walking::new().load().unwrap();
    let mut prefixed = Walking::new();
    prefixed.markers.iter_mut().for_each(|m| m.0 = format!("JW:{}", m.0));
    assert_eq!(prefixed.load().unwrap().markers, reference.markers, "the recording has a prefix");
    let mut written = Walking::new();
    written.replace("\"RASI\", ", "\"JW:RASI\", ");
    written.replace("\"right ASIS\" = \"RASI\"", "\"right ASIS\" = \"JW:RASI\"");
    let paths =
        |t: &multibody::trial::Trial| t.markers.iter().map(|m| m.position.clone()).collect::<Vec<_>>();
    assert_eq!(paths(&written.load().unwrap()), paths(&reference), "the trial file has one");
    let mut two = Walking::new();
    let second: Vec<_> = two.markers.iter().map(|m| (format!("B:{}", m.0), m.1.clone())).collect();
    two.markers.iter_mut().for_each(|m| m.0 = format!("A:{}", m.0));
    two.markers.extend(second);
    let said = two.load().unwrap_err().to_string();
    assert!(said.contains("`A:RASI` and `B:RASI`; write the name with its prefix"), "{said}");
}

#[test]
fn a_standing_trial_may_have_axes_units_and_gaps_of_its_own() {
    let spec = |walking: &Walking| {
        let file = TrialFile::read(&walking.write()).unwrap();
        (file.load(None).unwrap(), file.landmarks(None))
    };
    let mut walking = with_landmarks();
    walking.replace("source = \"markers\"", "source = \"markers\"\nstatic = \"still.trc\"");
    walking.write();
    fs::write(walking.folder().join("still.trc"), with_landmarks().trc()).unwrap();
    let (_, reference) = spec(&walking);
    // The same in a laboratory with z up, walking towards -x, in metres that claim to be millimetres.
    let mut other = with_landmarks();
    other.map(|p| Vector3::new(-p.x, p.z, p.y) * 1e-3);
    fs::write(walking.folder().join("still.trc"), other.trc()).unwrap();
    let refused = TrialFile::read(&walking.write()).unwrap().landmarks(None).unwrap_err().to_string();
    assert!(
        refused.contains("still.trc") && refused.contains("metres were read as millimetres"),
        "{refused}"
    );
    walking.toml +=
        "[[recording]]\nfile = \"still.trc\"\nunits = \"m\"\naxes = { x = \"-x\", y = \"z\", z = \"y\" }\n";
    let (_, turned) = spec(&walking);
    let tracks = |spec: multibody::trial_file::LandmarkSpec| match spec.source {
        multibody::trial_file::Landmarks::Markers { tracks, .. } => tracks,
        other => panic!("{other:?}"),
    };
    for (a, b) in tracks(reference.unwrap()).iter().zip(tracks(turned.unwrap())) {
        for (p, q) in a.position.iter().zip(&b.position) {
            assert!((p.unwrap() - q.unwrap()).norm() < 1e-9, "{}", a.name);
        }
    }
    walking.replace("[[recording]]\nfile = \"still.trc\"", "[[recording]]\nfile = \"stil.trc\"");
    let said = TrialFile::read(&walking.write()).unwrap_err().to_string();
    assert!(said.contains("of `stil.trc`"), "{said}");
}

// ------------------------------------------------------------------------------------------------ template

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

// ------------------------------------------------------------------------------------------------ pages

/// A page of `docs` is what the source says; `SARTORIUS_WRITE_PAGES=1` writes it.
fn assert_page(name: &str, wanted: &str) {
    let file = root().join("docs").join(name);
    if std::env::var_os("SARTORIUS_WRITE_PAGES").is_some() {
        fs::write(&file, wanted).unwrap();
    }
    let written = fs::read_to_string(&file).unwrap_or_default();
    assert!(
        written == wanted,
        "docs/{name} is not what the source says; write it with SARTORIUS_WRITE_PAGES=1 cargo test -p sartorius-tests --test first_day page"
    );
}

#[test]
fn the_page_of_keys_is_what_the_source_says() {
    let trial = page(
        "Trial file",
        "Which recordings make a trial, whose, which part of it, and where the landmarks come from.\n\
         `sartorius template trial RECORDING` writes one; `sartorius check FILE` names every mistake.\n\
         Paths are looked for in the folder of the trial file, then in `--data`.\n\
         They must not lead out by `..` or start with `/`; a symbolic link that lies there is followed.",
        KEYS,
    );
    let scene = page(
        "Scene",
        "What `compare`, `step` and `plan` simulate.\n\
         `sartorius template scene` writes one with every key; an empty file is a scene, too.\n\
         Paths are looked for beside the scene, then in `--data`.",
        SCENE_KEYS,
    );
    let ladder = page(
        "Ladder",
        "What `cost` measures: a scene, and keys of it that go from coarse to fine.\n\
         `sartorius cost` without a file does the shipped one, `gait-data/ladders/walker.toml`.",
        coupling::cost::ladder::KEYS,
    );
    let study = page(
        "Study",
        "What `study` carries out: subjects by settings by samples, and what varies from sample to sample.\n\
         [study.md](study.md) shows how.\n\
         Trials and scene are looked for beside the study, or are shipped ones.",
        coupling::study::keys::KEYS,
    );
    let options = page(
        "Options of `optimize` in a study",
        "Keys `optimize.…` of settings and of what varies: the options of the command line, with underscores.",
        coupling::options::OPTIONS,
    );
    let text = format!(
        "# Keys\n\nEvery key of the four kinds of files that you write (TOML).\nThis page is made from the source and tested against it.\n\n{trial}\n{scene}\n{ladder}\n{study}\n{options}"
    );
    assert_page("keys.md", &text);
}

/// File → names of its columns, as the page of columns has them.
fn page_of_columns() -> std::collections::BTreeMap<String, Vec<String>> {
    let text = fs::read_to_string(root().join("docs/columns.md")).unwrap();
    let mut files = std::collections::BTreeMap::new();
    let mut file = String::new();
    for line in text.lines() {
        if let Some(heading) = line.strip_prefix("### ") {
            file = heading.replace('`', "");
            files.insert(file.clone(), Vec::new());
        } else if let Some(row) = line.strip_prefix("| `") {
            let cells: Vec<&str> = line.split('|').map(str::trim).collect();
            assert!(cells.len() == 5 && !cells[3].is_empty(), "{line}");
            files.get_mut(&file).unwrap().push(row.split('`').next().unwrap().to_string());
        }
    }
    files
}

/// Whether a column is the one of the page; `{…}` stands for letters, digits and underscores.
fn is_column(name: &str, pattern: &str) -> bool {
    let parts: Vec<&str> = pattern.split(['{', '}']).step_by(2).collect();
    let (first, last) = (parts[0], parts[parts.len() - 1]);
    match parts.len() {
        1 => name == pattern,
        _ => name.len() > first.len() + last.len() && name.starts_with(first) && name.ends_with(last),
    }
}

/// Tables below a folder with the names of their columns.
fn tables(folder: &Path) -> Vec<(String, Vec<String>)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            found.extend(tables(&path));
        } else if name.ends_with(".csv") {
            let text = fs::read_to_string(&path).unwrap();
            found.push((name, text.lines().next().unwrap().split(',').map(str::to_string).collect()));
        } else if name.ends_with(".sto") || name.ends_with(".mot") {
            let text = fs::read_to_string(&path).unwrap();
            let head = text.lines().skip_while(|l| *l != "endheader").nth(1).unwrap();
            found.push((name, head.split('\t').map(str::to_string).collect()));
        }
    }
    found
}

#[test]
fn the_page_of_columns_has_every_column_that_is_written_and_no_other() {
    // A man who carries four of his kind: no muscle forces make his moments.
    let mut walking = Walking::new();
    walking.plates.iter_mut().flatten().for_each(|(f, _)| *f *= 4.0);
    let samples: String =
        (0..3000).map(|k| format!("{},{}\n", 0.001 * k as f64 - 0.8, (k % 7) as f64)).collect();
    let walking = walking.replace("mass_kg = 70", "mass_kg = 280");
    walking.toml += "\n[emg]\nfile = \"emg.csv\"\n[emg.channels]\nc1 = \"soleus\"\n";
    walking.write();
    fs::write(walking.folder().join("emg.csv"), format!("time_s,c1\n{samples}")).unwrap();
    let trials = walking.folder();
    let folder = trials.parent().unwrap();
    let measured = "time_s,medial_N,lateral_N\n0.0,500,300\n0.3,900,500\n0.6,900,500\n1.2,500,300\n";
    fs::write(folder.join("knee.csv"), measured).unwrap();
    fs::write(folder.join("thermal.toml"), "muscles = [\"gracilis\"]\nstress_free = \"heel_strike\"\nresolution_mm = 20\n[effects]\ncontact = \"none\"\n").unwrap();
    let example = |name: &str| format!("{}/../fem/examples/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    fs::write(folder.join("hill.toml"), "muscles = [\"gluteus_minimus\"]\nresolution_mm = 20\n").unwrap();
    fs::write(folder.join("ladder.toml"), "scene = \"hill.toml\"\n[[axis]]\nname = \"mesh\"\nkey = \"resolution_mm\"\nvalues = [20.0, 14.0]\nerror = \"discretisation\"\n").unwrap();
    let vary = |key: &str, values: &str| {
        format!("[[vary]]\nkey = \"{key}\"\ndistribution = \"choice\"\nvalues = [{values}]\n")
    };
    let leg = [
        vary("landmarks.heel", "1.0, 2.0"),
        vary("strengths.soleus", "0.9, 1.1"),
        vary("optimize.cost", "\"force\""),
    ];
    fs::write(folder.join("leg.toml"), leg.concat()).unwrap();
    let sure = vary("strengths.soleus", "0.9, 1.1");
    fs::write(folder.join("sure.toml"), format!("samples = 8\nindices = true\n{sure}")).unwrap();
    let thigh = vary("scene.materials.matrix_a_kpa", "3.0, 4.0");
    fs::write(
        folder.join("thigh.toml"),
        format!("run = \"compare\"\nscene = \"hill.toml\"\ncontact = \"without\"\n{thigh}"),
    )
    .unwrap();
    let recorded = vary("trial.filter.motion_hz", "5.0, 6.0");
    fs::write(
        folder.join("recorded.toml"),
        format!("[[subject]]\nname = \"walk\"\ntrial = \"trials/walk.toml\"\n{recorded}"),
    )
    .unwrap();
    for arguments in [
        &["optimize", "--out", "o", "--reserves", "1e-3", "--measured", "knee.csv", "--bands"][..],
        &["optimize", "--out", "n", "--knee", "implant", "--samples", "70"],
        &["compare", "hill.toml", "--out", "c"],
        &["compare", "hill.toml", "--out", "w", "--two-way", "--passes", "2"],
        &["compare", "hill.toml", "--out", "b", "--two-way", "--passes", "2", "--contact", "with"],
        &["optimize", "trials/walk.toml", "--out", "v"],
        &["compare", "thermal.toml", "--out", "t"],
        &["mesh", "--resolution", "20", "--only", "gracilis", "--out", "m"],
        &["solve", &example("squashed_block"), "--out", "s"],
        &["solve", &example("strap_over_rod"), "--out", "r"],
        &["cost", "ladder.toml", "--out", "l"],
        &["study", "leg.toml", "--out", "y"],
        &["study", "thigh.toml", "--out", "z"],
        &["study", "recorded.toml", "--out", "q"],
        &["study", "sure.toml", "--out", "i"],
    ] {
        let output = sartorius(arguments, folder);
        // A single pass of two-way coupling or a single muscle may miss its verdict; its tables are written all the same.
        assert_ne!(
            output.status.code(),
            Some(2),
            "{arguments:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
    }
    let page = page_of_columns();
    let mut seen = std::collections::BTreeSet::new();
    for part in ["o", "n", "v", "c", "w", "b", "t", "m", "s", "r", "l", "y", "z", "q", "i"] {
        for (file, columns) in tables(&folder.join(part)) {
            let file = if part == "t" && file == "calibration.csv" {
                "calibration.csv (thermal fibres)".into()
            } else {
                file
            };
            let rows = page.get(&file).unwrap_or_else(|| panic!("docs/columns.md lacks the file {file}"));
            for column in &columns {
                let row = rows.iter().find(|r| is_column(column, r));
                let row = row.unwrap_or_else(|| panic!("docs/columns.md lacks `{column}` of {file}"));
                seen.insert((file.clone(), row.clone()));
            }
        }
    }
    for (file, rows) in &page {
        for row in rows {
            assert!(
                seen.contains(&(file.clone(), row.clone())),
                "docs/columns.md has `{row}` of {file}, which nothing writes"
            );
        }
    }
}

// ------------------------------------------------------------------------------------------------ tutorial

/// Commands of the tutorial with the lines that it promises, in their order.
fn commands_of_the_tutorial() -> Vec<(Vec<String>, Vec<String>)> {
    let text = fs::read_to_string(root().join("docs/tutorial.md")).unwrap();
    let mut commands: Vec<(Vec<String>, Vec<String>)> = Vec::new();
    let mut inside = false;
    for line in text.lines() {
        match (line.starts_with("```"), line.strip_prefix("$ sartorius ")) {
            (true, _) => inside = line == "```console",
            (_, Some(command)) if inside => {
                commands.push((command.split(' ').map(str::to_string).collect(), Vec::new()));
            }
            _ if inside => commands.last_mut().unwrap().1.push(line.to_string()),
            _ => {}
        }
    }
    commands
}

#[test]
fn the_tutorial_does_what_it_says() {
    let Some(data) = shared("gait") else { return };
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    for file in [
        "dm/DM_ngait_og3_new.trc",
        "dm/DM_ngait_og3_grf.sto",
        "jw/jw_ngait_og1.c3d",
        "jw/jw_ngait_og3.c3d",
        "jw/jw_ngait_og7.c3d",
    ] {
        fs::copy(data.join(file), folder.join(Path::new(file).file_name().unwrap())).unwrap();
    }
    let text = fs::read_to_string(root().join("docs/tutorial.md")).unwrap();
    let scene = text.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    // One muscle without contact shows that the road is open; the tutorial's three are timed by hand.
    let small =
        scene.replace("\"gluteus_maximus\", \"gluteus_medius\", ", "") + "[effects]\ncontact = \"none\"\n";
    fs::write(folder.join("scene.toml"), small).unwrap();
    let commands = commands_of_the_tutorial();
    assert_eq!(commands.len(), 8, "{commands:?}");
    for (arguments, promised) in commands {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let output = sartorius(&arguments, folder);
        let said =
            String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {said}");
        for line in promised {
            assert!(said.contains(&line), "{arguments:?} does not say `{line}` but\n{said}");
        }
    }
    for page in ["dm/report.html", "thigh/report.html", "jw/report.html"] {
        assert!(folder.join(page).exists(), "{page}");
    }
}
