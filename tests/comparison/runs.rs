//! How `step` and `compare` run, and what they keep and tell.

use super::shipped;
use coupling::fibres::cache::FOLDER;
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::fs;
use support::results::files_without_times;
use support::{sartorius, text};

#[test]
fn a_stage_is_a_line_where_standard_error_is_piped() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "muscles = [\"gluteus_minimus\"]\nresolution_mm = 18.0\n[effects]\nfibres = \"none\"\ncontact = \"none\"\n";
    fs::write(folder.path().join("one.toml"), scene).unwrap();
    let stages = |arguments: &[&str]| -> Vec<String> {
        let output = sartorius(arguments, folder.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let stage = |line: &str| -> String {
            let words: Vec<&str> = line.split_whitespace().collect();
            let [name @ .., seconds, "s"] = &words[..] else { panic!("{line}") };
            assert!(seconds.parse::<f64>().unwrap() >= 0.0);
            name.join(" ")
        };
        text(&output.stderr).lines().map(stage).collect()
    };
    assert_eq!(stages(&["compare", "one.toml"]), ["rigid leg", "mesh", "without contact", "write"]);
    assert_eq!(stages(&["mesh", "--only", "gracilis", "--resolution", "20"]), ["read", "mesh", "write"]);
    let rigid = ["read", "model", "marker fit", "loads", "sharing", "activations", "write"];
    assert_eq!(stages(&["optimize"]), rigid);
    for command in
        [&["compare", "one.toml"][..], &["mesh", "--only", "gracilis", "--resolution", "20"], &["optimize"]]
    {
        assert!(stages(&[command, &["--quiet"]].concat()).is_empty());
    }
}

#[test]
fn the_rigid_leg_alone_is_a_scene() {
    let folder = tempfile::tempdir().unwrap();
    let output = sartorius(&["compare", &shipped("rigid_only"), "--out", "r"], folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let table = fs::read_to_string(folder.path().join("r/comparison.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + 2 * 17);
    let row = table.lines().find(|l| l.starts_with("heel_strike,gluteus_minimus")).unwrap();
    let cells: Vec<&str> = row.split(',').collect();
    assert!(cells[3].parse::<f64>().unwrap() > 50.0 && cells[4..].iter().all(|c| c.is_empty()), "{row}");
    assert!(fs::read_to_string(folder.path().join("r/report.html")).unwrap().contains("gluteus minimus"));
    assert!(!folder.path().join("r/no_contact").exists());
}

#[test]
fn a_step_is_one_configuration_and_json_is_its_verdict() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "muscles = [\"gluteus_minimus\"]\nresolution_mm = 16.0\nstress_free = \"heel_strike\"\n\
                 [effects]\nshells = false\ncontact = \"none\"\n[[step]]\nname = \"heel_strike\"\n";
    fs::write(folder.path().join("one.toml"), scene).unwrap();
    let output = sartorius(&["step", "one.toml", "--json", "--threads", "1", "--quiet"], folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(output.stderr.is_empty(), "quiet: {}", text(&output.stderr));
    let verdict: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&verdict["status"], &verdict["scene"]), (&"solved".into(), &"one".into()));
    let differences = verdict["differences"].as_array().unwrap();
    assert_eq!(differences.len(), 1);
    assert_eq!(differences[0]["configuration"], "without contact");
    assert!(differences[0]["largest_N"].as_f64().unwrap() < 5.0);
    let out = folder.path().join("out/step-one");
    assert!(out.join("run.json").exists() && !out.join("contact").exists());
    let shells = fs::read_to_string(out.join("comparison.csv")).unwrap();
    assert!(shells.lines().nth(1).unwrap().ends_with(",0.000"), "no shell, no force in it: {shells}");
    // Stability is tested where the scene asks for it, in every frame.
    let tested = || {
        let summary = fs::read_to_string(out.join("no_contact/thigh.json")).unwrap();
        let summary: Value = serde_json::from_str(&summary).unwrap();
        [&summary["frames_tested_for_stability"], &summary["frames_solved"]]
            .map(|n| n.as_u64().expect("a count"))
    };
    let [without, _] = tested();
    let scene = format!("{scene}[accuracy]\ncheck_stability = true\n");
    fs::write(folder.path().join("one.toml"), scene).unwrap();
    let output = sartorius(&["step", "one.toml", "--threads", "1", "--quiet"], folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let [with, frames] = tested();
    assert!(without == 0 && with == frames && frames > 0, "{without}, {with} of {frames} frames");
}

#[test]
fn calibrations_are_kept_and_change_no_byte() {
    let folder = tempfile::tempdir().unwrap();
    for (fibres, reading) in [("hill", "standing"), ("thermal", "heel_strike")] {
        let at = folder.path().join(fibres);
        fs::create_dir(&at).unwrap();
        let scene = format!(
            "muscles = [\"gluteus_minimus\"]\nresolution_mm = 16.0\nstress_free = \"{reading}\"\n\
             [effects]\nfibres = \"{fibres}\"\ncontact = \"none\"\n[[step]]\nname = \"heel_strike\"\n"
        );
        fs::write(at.join("one.toml"), scene).unwrap();
        let run = |out: &str| {
            let output = sartorius(&["compare", "one.toml", "--quiet", "--out", out], &at);
            assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
            let table = |name: &str| fs::read(at.join(out).join(name)).unwrap();
            ((table("comparison.csv"), table("calibration.csv")), text(&output.stderr))
        };
        let (first, said) = run("runs/first");
        assert!(said.is_empty(), "{said}");
        let entry = match fs::read_dir(at.join("runs").join(FOLDER)).unwrap().collect::<Vec<_>>().as_slice() {
            [Ok(entry)] => entry.path(),
            other => panic!("one muscle, one entry: {other:?}"),
        };
        assert_eq!(run("runs/kept"), (first.clone(), String::new()));
        // The entry is what the second run took: a whole one that says something else is believed.
        let whole = fs::read_to_string(&entry).unwrap();
        let rest = whole.split_once('\n').unwrap().1;
        let (key, number) = if fibres == "hill" { ("gain = ", 1.0) } else { ("contraction = [0.0, ", 0.01) };
        let (before, after) = rest.split_once(key).unwrap();
        let end = after.find([',', '\n', ']']).unwrap();
        let value: f64 = after[..end].parse().unwrap();
        let other = format!("{before}{key}{}{}", value + number, &after[end..]);
        let sum: String = Sha256::digest(&other).iter().map(|b| format!("{b:02x}")).collect();
        fs::write(&entry, format!("# {sum}\n{other}")).unwrap();
        assert_ne!(run("runs/other").0, first);
        // Damaged ones are not.
        fs::write(&entry, &whole[..whole.len() / 2]).unwrap();
        let (again, said) = run("runs/damaged");
        assert!(again == first, "a damaged entry is computed anew");
        assert!(said.contains("damaged") && said.contains("gluteus_minimus"), "{said}");
        assert_eq!(fs::read_to_string(&entry).unwrap(), whole);
        if fibres == "hill" {
            // Another material is calibrated anew, under a name of its own, and shown.
            let stiffer = fs::read_to_string(at.join("one.toml")).unwrap()
                + "[materials]\naponeurosis_shear_modulus_kpa = 30.0\n";
            fs::write(at.join("one.toml"), stiffer).unwrap();
            assert_ne!(run("runs/stiffer").0, first);
            assert_eq!(fs::read_dir(at.join("runs").join(FOLDER)).unwrap().count(), 2);
            for file in ["report.html", "run.json"] {
                let shown = fs::read_to_string(at.join("runs/stiffer").join(file)).unwrap();
                assert!(shown.contains("shells of 0.5 mm, shear modulus 30 kPa"), "{file}");
            }
        }
    }
}

#[test]
fn a_coarser_mesh_shows_the_way_and_the_forces_stay() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 9.0\n";
    fs::write(folder.path().join("plain.toml"), scene).unwrap();
    fs::write(folder.path().join("nested.toml"), format!("{scene}[solver]\nnested_from_mm = 18.0\n"))
        .unwrap();
    let run = |scene: &str, threads: &str, out: &str| {
        let output = sartorius(&["compare", scene, "--out", out, "--threads", threads], folder.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    run("plain.toml", "2", "plain");
    let said = run("nested.toml", "2", "nested");
    let is_said = |stage: &str| said.lines().any(|line| line.starts_with(stage));
    for stage in [
        "calibration, 18 mm, without",
        "without contact, 18 mm",
        "calibration, 18 mm, with ",
        "with contact, 18 mm",
    ] {
        assert!(is_said(stage), "{stage}: {said}");
    }
    run("nested.toml", "1", "single");
    let (two, one) = (
        files_without_times(&folder.path().join("nested")),
        files_without_times(&folder.path().join("single")),
    );
    assert!(two == one, "threads change the run");
    let iterations = |of: &str| {
        let table = fs::read_to_string(folder.path().join(of).join("iterations.csv")).unwrap();
        table.lines().count() - 1
    };
    for configuration in ["no_contact", "contact"] {
        let [at_once, led] = ["plain", "nested"].map(|out| iterations(&format!("{out}/{configuration}")));
        println!("{configuration}: {led} iterations led, {at_once} at once");
        assert!(5 * led < 4 * at_once, "{configuration}: {led} iterations led, {at_once} at once");
    }
    let forces = |out: &str| -> Vec<(String, f64)> {
        let table = fs::read_to_string(folder.path().join(out).join("quantities.csv")).unwrap();
        let rows = table.lines().filter(|row| row.contains(",section_force_N,"));
        rows.map(|row| row.rsplit_once(',').unwrap()).map(|(of, f)| (of.into(), f.parse().unwrap())).collect()
    };
    let (plain, nested) = (forces("plain"), forces("nested"));
    assert!(!plain.is_empty() && plain.len() == nested.len());
    for ((of, a), (_, b)) in plain.iter().zip(&nested) {
        // What a residual of 10 N leaves open, with contact.
        assert!((a - b).abs() < 0.02 * a.abs() + 1.0, "{of}: {a} N, {b} N led");
    }
}

#[test]
fn coarser_meshes_that_were_wanted_and_led_nothing_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let told = |from: f64| {
        let scene = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 9.0\n[effects]\ncontact = \"cheap\"\n";
        fs::write(folder.path().join("scene.toml"), format!("{scene}[solver]\nnested_from_mm = {from:.1}\n"))
            .unwrap();
        let arguments = ["compare", "scene.toml", "--contact", "with", "--out", "out", "--force"];
        let output = sartorius(&arguments, folder.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        fs::read_to_string(folder.path().join("out/run.json")).unwrap().contains("led nothing here")
    };
    assert!(told(18.0), "wanted, and cheap contact is not led");
    assert!(!told(9.0), "less than twice the edges: at once is what was asked for");
}
