//! A comparison that is killed leaves nothing that looks complete, and goes on to the same bytes.
//!
//! `SARTORIUS_KILLS=20 cargo test --release -p sartorius-tests --test resume` kills at 20 random moments instead of 3.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use fem::mesh::{LengthUnit, format::vtu};
use serde_json::Value;
use support::{Random, program, sartorius};

const SCENE: &str = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 18.0\nstress_free = \"heel_strike\"\n";

fn arguments(out: &str) -> Vec<&str> {
    vec!["compare", "scene.toml", "--contact", "both", "--out", out]
}

/// All files below a folder by their path in it.
fn files(folder: &Path) -> BTreeMap<String, PathBuf> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(at) = open.pop() {
        for entry in fs::read_dir(&at).into_iter().flatten() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => open.push(path),
                false => {
                    found.insert(path.strip_prefix(folder).unwrap().to_str().unwrap().to_string(), path);
                }
            }
        }
    }
    found
}

fn json(file: &Path) -> Value {
    serde_json::from_slice(&fs::read(file).unwrap())
        .unwrap_or_else(|e| panic!("{} is cut: {e}", file.display()))
}

/// What a file says but for the seconds that a run took.
fn timeless(name: &str, path: &Path) -> Vec<u8> {
    let bytes = fs::read(path).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    if name.ends_with("iterations.csv") {
        return text
            .lines()
            .map(|l| l.rsplit_once(',').unwrap().0)
            .collect::<Vec<_>>()
            .join("\n")
            .into_bytes();
    }
    if name == "report.html" {
        let (before, rest) = text.split_once("<section id=\"cost\">").unwrap();
        return [before, rest.split_once("</section>").unwrap().1].concat().into_bytes();
    }
    bytes
}

/// The same files with the same content, times apart.
fn assert_same(a: &Path, b: &Path) {
    let results = |folder| {
        let mut found = files(folder);
        found.remove(".sartorius"); // which process it was
        found
    };
    let (one, other) = (results(a), results(b));
    assert_eq!(one.keys().collect::<Vec<_>>(), other.keys().collect::<Vec<_>>());
    for (name, path) in one.iter().filter(|(name, _)| *name != "run.json") {
        assert!(timeless(name, path) == timeless(name, &other[name]), "{name} differs");
    }
}

/// Every file under its final name is whole, and nothing claims to be the end of a run that has not ended.
fn assert_honest(folder: &Path) {
    assert!(!folder.join("run.json").exists(), "looks complete");
    for (name, path) in files(folder) {
        if name.ends_with(".vtu") {
            vtu::read(&path, LengthUnit::Metre).unwrap_or_else(|e| panic!("{name}: {e}"));
        } else if name.ends_with(".pvd") {
            let text = fs::read_to_string(&path).unwrap();
            assert!(text.ends_with("</VTKFile>\n"), "{name} is cut");
            for frame in text.split("file=\"").skip(1) {
                assert!(
                    path.with_file_name(frame.split('"').next().unwrap()).exists(),
                    "{name} names {frame}"
                );
            }
        } else if name.ends_with("thigh.json") {
            assert_eq!(json(&path)["frames_solved"], 2, "{name}");
            assert!(path.with_file_name("iterations.csv").exists());
        } else if name.ends_with(".state") {
            json(&path);
        }
    }
}

fn states(folder: &Path) -> usize {
    files(folder).keys().filter(|name| name.ends_with(".state")).count()
}

/// Starts a run and kills it when `enough` says so; whether it was killed before its end.
fn killed(folder: &Path, resume: bool, enough: impl Fn() -> bool) -> bool {
    let mut all = arguments("killed");
    all.extend(resume.then_some("--resume"));
    let mut child = Command::new(program())
        .args(all)
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while !enough() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(5));
    }
    let before_its_end = child.try_wait().unwrap().is_none();
    child.kill().unwrap(); // SIGKILL: nothing is cleaned up
    child.wait().unwrap();
    before_its_end
}

#[test]
fn a_killed_comparison_goes_on_to_the_same_bytes() {
    let kills: usize = std::env::var("SARTORIUS_KILLS").map_or(3, |n| n.parse().expect("a number of kills"));
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    let clock = Instant::now();
    let output = sartorius(&arguments("whole"), folder.path());
    let took = clock.elapsed().as_secs_f64();
    let code = output.status.code();
    assert!(code.is_some_and(|c| c == 0 || c == 3), "{}", String::from_utf8_lossy(&output.stderr));
    let (whole, out) = (folder.path().join("whole"), folder.path().join("killed"));
    assert_eq!(json(&whole.join("run.json"))["iterations"]["frames taken over"], 0);

    let mut random = Random::new(6);
    let (mut early, mut taken_over) = (0, 0);
    for k in 0..kills {
        let moment = 0.5 * (1.0 + random.uniform()) * took;
        let clock = Instant::now();
        // The first is killed when it has something to go on from; of the others every second had been killed before.
        let first = || states(&out) > 0;
        let later = || clock.elapsed().as_secs_f64() > moment;
        let before_its_end = killed(folder.path(), k % 2 == 1, || if k == 0 { first() } else { later() });
        if before_its_end && !out.join("run.json").exists() {
            early += 1;
            assert_honest(&out);
        }
        let stored = states(&out);
        let output = sartorius(&[arguments("killed"), vec!["--resume"]].concat(), folder.path());
        assert_eq!(output.status.code(), code, "{}", String::from_utf8_lossy(&output.stderr));
        assert_same(&whole, &out);
        let over = json(&out.join("run.json"))["iterations"]["frames taken over"].as_u64().unwrap() as usize;
        assert_eq!(over, stored, "every stored frame is taken over");
        taken_over += over;
        if k % 3 == 2 {
            fs::remove_dir_all(&out).unwrap();
        }
    }
    println!(
        "{early} of {kills} runs killed before their end, {taken_over} frames taken over; a whole run takes {took:.1} s"
    );
    assert!(early > 0 && taken_over > 0, "{early} early, {taken_over} taken over: the test saw nothing");
}

#[test]
fn states_that_are_stale_or_broken_are_not_taken_over() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    let out = folder.path().join("killed");
    assert!(killed(folder.path(), false, || states(&out) > 0));
    let state = out.join("no_contact/thigh_0000.state");
    let bytes = fs::read(&state).unwrap();
    let resumed = |scene: &str| {
        fs::write(folder.path().join("scene.toml"), scene).unwrap();
        let output = sartorius(&[arguments("killed"), vec!["--resume"]].concat(), folder.path());
        assert!(output.status.code().is_some(), "{}", String::from_utf8_lossy(&output.stderr));
        json(&out.join("run.json"))["iterations"]["frames taken over"].clone()
    };
    // Another scene.
    assert_eq!(resumed(&format!("{SCENE}[effects]\nshells = false\n")), 0);
    assert_eq!(states(&out), 0, "a complete run needs no states");
    // Half a file.
    fs::write(&state, &bytes[..bytes.len() / 2]).unwrap();
    assert_eq!(resumed(SCENE), 0);
    // The frame itself.
    fs::write(&state, &bytes).unwrap();
    assert_eq!(resumed(SCENE), 1);
    // Without --resume everything of the earlier run goes, and what is not of it stays.
    fs::write(out.join("contact/mine.txt"), "mine").unwrap();
    let output =
        sartorius(&["compare", "scene.toml", "--contact", "without", "--out", "killed"], folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let left: Vec<String> = files(&out.join("contact")).into_keys().collect();
    assert_eq!(left, ["mine.txt"]);
}

/// ParaView finds what the study is about in the frames.
#[test]
fn frames_hold_stress_pressure_stretch_and_contact_pressure() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    let output = sartorius(&arguments("out"), folder.path());
    assert!(output.status.code().is_some(), "{}", String::from_utf8_lossy(&output.stderr));
    for (configuration, touching) in [("no_contact", false), ("contact", true)] {
        let run = folder.path().join("out").join(configuration);
        let collection = fs::read_to_string(run.join("thigh.pvd")).unwrap();
        assert_eq!(collection.matches("<DataSet").count(), 2);
        let frame = vtu::read(&run.join("thigh_0001.vtu"), LengthUnit::Metre).unwrap();
        let most = |fields: &[vtu::Field], name: &str| {
            let field = fields.iter().find(|f| f.name == name)?;
            Some(field.values.iter().filter(|v| v.is_finite()).fold(0.0_f64, |m, v| m.max(v.abs())))
        };
        for name in ["von_mises_Pa", "pressure_Pa", "volume_ratio", "stretch", "force_N"] {
            assert!(most(&frame.cell_data, name).unwrap() > 0.0, "{configuration}: {name}");
        }
        assert!(most(&frame.point_data, "displacement_m").unwrap() > 1e-3);
        let pressure = most(&frame.point_data, "contact_pressure_Pa");
        assert_eq!(pressure.is_some(), touching);
        assert!(!touching || (100.0..1e6).contains(&pressure.unwrap()), "{pressure:?} Pa");
    }
}
