use super::*;

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
