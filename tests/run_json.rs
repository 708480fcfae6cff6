//! Does `run.json` say enough to compute the same again, and who, what, when and where it was?

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;
use sha2::{Digest, Sha256};
use support::results::files_without_times;
use support::{program, sartorius, shared};

fn run_json(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("run.json")).unwrap()).unwrap()
}

/// Carries out what `again` in the `run.json` of `first` says, in a folder where nothing else is.
fn again(first: &Path, data: Option<&Path>) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let said = &run_json(first)["again"];
    for (name, text) in said["files"].as_object().unwrap() {
        let file = folder.path().join(name);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, text.as_str().unwrap()).unwrap();
    }
    let mut arguments: Vec<&str> =
        said["arguments"].as_array().unwrap().iter().map(|a| a.as_str().unwrap()).collect();
    arguments.extend(["--out", "again"]);
    if let Some(data) = data {
        arguments.extend(["--data", data.to_str().unwrap()]);
    }
    let output = sartorius(&arguments, folder.path());
    let code = output.status.code();
    assert!(code == Some(0), "{arguments:?}: {code:?} {}", String::from_utf8_lossy(&output.stderr));
    folder
}

/// The same files with the same bytes, and a record that differs in moments, costs and the command line only.
fn assert_same(first: &Path, second: &Path) {
    let (one, other) = (files_without_times(first), files_without_times(second));
    assert_eq!(one.keys().collect::<Vec<_>>(), other.keys().collect::<Vec<_>>());
    assert!(one.len() > 5);
    for (name, bytes) in &one {
        assert!(bytes == &other[name], "{name} differs");
    }
    let record = |folder: &Path| {
        let mut run = run_json(folder);
        for changing in ["date", "command_line", "seconds", "peak_memory_mib", "inputs"] {
            assert!(run.as_object_mut().unwrap().remove(changing).is_some(), "{changing}");
        }
        run
    };
    assert_eq!(record(first), record(second));
}

#[test]
fn optimize_can_be_computed_again_with_all_its_options() {
    let folder = tempfile::tempdir().unwrap();
    let rows: String = (0..130).map(|k| format!("{},{},{}\n", 0.01 * k as f64, 700 + k, 300)).collect();
    let knee = folder.path().join("knee.csv");
    fs::write(&knee, format!("time_s,medial_N,lateral_N\n{rows}")).unwrap();
    let arguments = [
        "optimize",
        "--cost",
        "activation",
        "--curves",
        "degroote",
        "--tendon",
        "rigid",
        "--ankle",
        "parallel",
        "--reserves",
        "0.1",
        "--joint-weights",
        "none",
        "--raise-bounds",
        "1.5",
        "--threads",
        "1",
        "--out",
        "first",
        "--measured",
        knee.to_str().unwrap(),
    ];
    let output = sartorius(&arguments, folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let first = folder.path().join("first");
    let said = run_json(&first);
    assert_eq!(said["threads"], 1);
    assert_eq!(said["command_line"].as_array().unwrap()[1..], arguments.map(Value::from));
    let second = again(&first, None);
    // On as many threads as there are, which changes nothing else.
    let mut other = run_json(&second.path().join("again"));
    other["threads"] = 1.into();
    fs::write(second.path().join("again/run.json"), other.to_string()).unwrap();
    assert_same(&first, &second.path().join("again"));

    // Another option, other bytes: the comparison sees something.
    let plain = sartorius(&["optimize", "--out", "plain"], folder.path());
    assert_eq!(plain.status.code(), Some(0));
    let (one, other) = (files_without_times(&first), files_without_times(&folder.path().join("plain")));
    assert!(one["muscle_forces.csv"] != other["muscle_forces.csv"]);
}

#[test]
fn a_recorded_trial_can_be_computed_again_from_its_recordings() {
    let Some(data) = shared("gait") else { return };
    let trial = Path::new(env!("CARGO_MANIFEST_DIR")).join("../gait-data/trials/DM_ngait_og3.toml");
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["optimize", trial.to_str().unwrap(), "--data", data.to_str().unwrap(), "--out", "first"];
    let output = sartorius(&arguments, folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let first = folder.path().join("first");
    assert_same(&first, &again(&first, Some(&data)).path().join("again"));
    let said = run_json(&first);
    assert_eq!(
        (&said["trial"], &said["subject"]),
        (&"DM_ngait_og3".into(), &"DM, male, 70 kg, 1.72 m, right leg".into())
    );
    for (name, file) in
        [("DM_ngait_og3.toml", trial), ("DM_ngait_og3_new.trc", data.join("dm/DM_ngait_og3_new.trc"))]
    {
        let bytes = fs::read(&file).unwrap();
        let hash: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
        let found = said["inputs"].as_array().unwrap().iter().find(|i| i["name"] == name).expect(name);
        assert_eq!((&found["sha256"], &found["bytes"]), (&hash.into(), &bytes.len().into()));
    }
    let page = fs::read_to_string(first.join("report.html")).unwrap();
    assert!(page.contains("DM, male, 70 kg"));
    let storage = fs::read_to_string(first.join("muscle_forces.sto")).unwrap();
    assert!(storage.lines().next().unwrap().contains("DM, male, 70 kg"));
}

#[test]
fn compare_can_be_computed_again_with_what_the_command_line_put_in_place_of_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    // A length that no power of two divides, no steps named, contact named nowhere.
    fs::write(folder.path().join("mine.toml"), "muscles = \"all\"\n[accuracy]\nresidual_n = 0.3\n").unwrap();
    let arguments = [
        "compare",
        "mine.toml",
        "--only",
        "gluteus_minimus",
        "--resolution",
        "18.3",
        "--stress-free",
        "heel-strike",
        "--contact",
        "without",
        "--out",
        "first",
    ];
    let output = sartorius(&arguments, folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let first = folder.path().join("first");
    let second = again(&first, None);
    assert_same(&first, &second.path().join("again"));
    let scene = run_json(&first)["again"]["files"]["scene/mine.toml"].as_str().unwrap().to_string();
    for line in [
        "resolution_mm = 18.3",
        "residual_n = 0.3",
        "contact_residual_n = 10.0",
        "fibres = \"thermal\"",
        "name = \"loading_response\"",
    ] {
        assert!(scene.contains(line), "{scene}");
    }
    // Numbers for people.
    let words = String::from_utf8_lossy(&output.stdout).into_owned()
        + &fs::read_to_string(first.join("report.html")).unwrap();
    assert!(words.contains("18.3 mm"));
    for bad in ["-0.0 ", "18.30000", "1e−0", "1e-0", ">-0<", ">−0.0<"] {
        assert!(!words.contains(bad), "{bad} among the words");
    }
}

#[test]
fn a_mesh_can_be_computed_again() {
    let folder = tempfile::tempdir().unwrap();
    let arguments =
        ["mesh", "--out=first", "--resolution", "14.3", "--json", "--only", "gracilis", "--threads", "1"];
    let output = sartorius(&arguments, folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let first = folder.path().join("first");
    assert_eq!(run_json(&first)["again"]["arguments"].as_array().unwrap().len(), 7);
    assert_same(&first, &again(&first, None).path().join("again"));
}

#[test]
fn the_record_says_who_computed_what_when_and_where() {
    let folder = tempfile::tempdir().unwrap();
    let output = sartorius(&["optimize", "--out", "first"], folder.path());
    assert_eq!(output.status.code(), Some(0));
    let run = run_json(&folder.path().join("first"));
    let known: BTreeMap<&str, bool> = ["system", "architecture", "processor", "cores", "memory_mib"]
        .into_iter()
        .map(|key| (key, !run["machine"][key].is_null()))
        .collect();
    assert!(known["system"] && known["architecture"] && known["cores"], "{known:?}");
    if cfg!(target_os = "linux") {
        assert!(run["machine"]["memory_mib"].as_f64().unwrap() > 100.0);
    }
    let date = run["date"].as_str().unwrap();
    assert!(date.len() == 20 && date.ends_with('Z') && date.as_bytes()[10] == b'T', "{date}");
    assert_eq!(run["program"]["version"], env!("CARGO_PKG_VERSION"));
    // The commit is that of the repository, where there is one.
    let git =
        Command::new("git").args(["rev-parse", "HEAD"]).current_dir(env!("CARGO_MANIFEST_DIR")).output();
    let commit = git
        .ok()
        .filter(|g| g.status.success())
        .map(|g| String::from_utf8_lossy(&g.stdout).trim().to_string());
    let version = Command::new(program()).arg("--version").output().unwrap();
    let version = String::from_utf8_lossy(&version.stdout).into_owned();
    match commit {
        Some(commit) => {
            assert_eq!(run["program"]["commit"], commit.as_str());
            assert!(run["program"]["modified"].is_boolean());
            assert!(version.contains(&commit[..10]), "{version}");
        }
        None => assert!(version.contains("unknown") || !run["program"]["commit"].is_null(), "{version}"),
    }
    // Nothing of this is anywhere else: all other files hold the same bytes another day.
    for (name, bytes) in files_without_times(&folder.path().join("first")) {
        assert!(!String::from_utf8_lossy(&bytes).contains(&date[..10]), "{name} holds the date");
    }
}
