//! What the program carries works from any folder, without the repository.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use multibody::shipped::{self, Kind};
use support::{program, sartorius, shared, text};

#[test]
fn every_scene_trial_and_subject_of_the_repository_is_in_the_program() {
    for (kind, folder, ending) in
        [(Kind::Scene, "scenes", "toml"), (Kind::Trial, "trials", "toml"), (Kind::Subject, "subjects", "csv")]
    {
        let carried: BTreeMap<String, &str> =
            kind.all().map(|(name, text)| (format!("{name}.{ending}"), text)).collect();
        let at = Path::new(env!("CARGO_MANIFEST_DIR")).join("../gait-data").join(folder);
        let mut files = BTreeMap::new();
        for entry in fs::read_dir(at).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|e| e == ending) {
                let name = path.file_name().unwrap().to_str().unwrap().to_string();
                files.insert(name, fs::read_to_string(&path).unwrap());
            }
        }
        assert!(!files.is_empty());
        assert_eq!(carried.keys().collect::<Vec<_>>(), files.keys().collect::<Vec<_>>());
        assert!(files.iter().all(|(name, text)| carried[name] == text), "{folder}");
    }
}

/// The program, copied away from the repository, and an empty folder to run it in.
fn elsewhere() -> (tempfile::TempDir, PathBuf) {
    let at = tempfile::tempdir().unwrap();
    fs::create_dir(at.path().join("bin")).unwrap();
    fs::create_dir(at.path().join("empty")).unwrap();
    // By another process: a file that this one has open for writing while another test starts a program stays open there for a moment,
    // and cannot be run until then.
    let copied = Command::new("cp").arg(program()).arg(at.path().join("bin/sartorius")).status().unwrap();
    assert!(copied.success());
    let empty = at.path().join("empty");
    (at, empty)
}

#[test]
fn names_work_from_any_folder() {
    let (at, empty) = elsewhere();
    let run = |arguments: &[&str]| {
        let output = Command::new(at.path().join("bin/sartorius"))
            .args(arguments)
            .current_dir(&empty)
            .env_clear()
            .env("HOME", at.path())
            .output()
            .unwrap();
        (output.status.code(), text(&output.stdout), text(&output.stderr))
    };
    let (code, said, errors) = run(&["compare", "rigid_only"]);
    assert_eq!(code, Some(0), "{errors}");
    assert!(said.contains("rigid_only") && empty.join("out/compare-rigid_only/run.json").exists());
    let (code, listed, _) = run(&["scenes"]);
    let (_, help, _) = run(&["compare", "--help"]);
    assert_eq!(code, Some(0));
    for (name, _) in Kind::Scene.all() {
        assert!(listed.contains(name) && help.contains(name), "{name}");
    }
    let whole = shipped::text(&Kind::Scene.path().join("three_muscles.toml")).unwrap();
    assert_eq!(run(&["scenes", "three_muscles"]), (Some(0), whole.to_string(), String::new()));
    for (arguments, wanted) in [
        (&["compare", "three_muscels"][..], "did you mean `three_muscles`?"),
        (&["plan", "wallker"], "did you mean `walker`?"),
        (&["step", "three_muscles.toml"], "without folder and ending: three_muscles"),
        (&["optimize", "jw_ngait_og33"], "did you mean `jw_ngait_og3`?"),
        (&["optimize", "quite_unlike"], "DM_ngait_og4"),
        (&["mesh", "--subject", "DM_ngait_og33"], "did you mean `DM_ngait_og3`?"),
        (&["scenes", "rigid_onyl"], "did you mean `rigid_only`?"),
        // The file is there, its recordings are not.
        (&["optimize", "jw_ngait_og3"], "--data"),
    ] {
        let (code, _, errors) = run(arguments);
        assert_eq!(code, Some(2), "{arguments:?}: {errors}");
        assert!(errors.contains(wanted), "{arguments:?}: {errors}");
    }
    // A word is a name, a path is a file; that both are there is told.
    fs::write(empty.join("rigid_only"), "muscles = 7\n").unwrap();
    let (code, _, errors) = run(&["compare", "rigid_only"]);
    assert_eq!(code, Some(0), "{errors}");
    assert!(errors.contains("./rigid_only"), "{errors}");
    let (code, _, errors) = run(&["compare", "./rigid_only"]);
    assert!(code == Some(2) && errors.contains("line 1"), "{errors}");
}

#[test]
fn shipped_trials_are_the_files_of_the_repository() {
    let Some(data) = shared("gait") else { return };
    let data = data.canonicalize().unwrap();
    let (_at, empty) = elsewhere();
    for trial in ["DM_ngait_og3", "jw_ngait_og3"] {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../gait-data/trials/{trial}.toml"));
        for (given, out) in [(trial, "name"), (file.to_str().unwrap(), "file")] {
            let arguments = ["optimize", given, "--data", data.to_str().unwrap(), "--out", out];
            let output = sartorius(&[&arguments[..], &["--force"]].concat(), &empty);
            assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        }
        let read = |out: &str, file: &str| fs::read(empty.join(out).join(file)).unwrap();
        assert!(read("name", "muscle_forces.csv") == read("file", "muscle_forces.csv"), "{trial}");
        let inputs = |out: &str| {
            let run: serde_json::Value = serde_json::from_slice(&read(out, "run.json")).unwrap();
            run["inputs"].clone()
        };
        assert_eq!(inputs("name"), inputs("file"), "the same files with the same hashes");
        assert!(inputs("name").as_array().unwrap().len() >= 2);
    }
}
