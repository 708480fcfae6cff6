use super::*;

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
