use super::*;

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
pub(super) fn with_landmarks() -> Walking {
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
