//! A comparison that is killed leaves nothing that looks complete, and goes on to the same bytes.
//!
//! `SARTORIUS_KILLS=20 cargo test --release -p sartorius-tests --test thigh_and_command resume` kills at 20 random moments instead of 3.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use fem::mesh::{LengthUnit, format::vtu};
use quick_xml::XmlVersion;
use quick_xml::events::Event;
use serde_json::Value;
use support::results::{files, files_without_times};
use support::{Random, program, sartorius};

const SCENE: &str = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 10.0\nstress_free = \"heel_strike\"\n[solver]\nnested_from_mm = 20.0\n";

fn arguments(out: &str) -> Vec<&str> {
    vec!["compare", "scene.toml", "--contact", "both", "--out", out]
}

fn json(file: &Path) -> Value {
    serde_json::from_slice(&fs::read(file).unwrap())
        .unwrap_or_else(|e| panic!("{} is cut: {e}", file.display()))
}

/// The same files with the same content, times apart.
fn assert_same(a: &Path, b: &Path) {
    let (one, other) = (files_without_times(a), files_without_times(b));
    assert_eq!(one.keys().collect::<Vec<_>>(), other.keys().collect::<Vec<_>>());
    for (name, said) in &one {
        assert!(said == &other[name], "{name} differs");
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
            assert!(fem::restart::is_whole(&path), "{name} is cut");
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

/// Parts of a frame of a collection: name and contents, by time.
fn collection(file: &Path) -> Vec<(f64, String, vtu::Vtu)> {
    let text = fs::read_to_string(file).unwrap();
    let mut xml = quick_xml::Reader::from_str(&text);
    let mut found = Vec::new();
    loop {
        match xml.read_event().unwrap() {
            Event::Empty(e) if e.name().as_ref() == "DataSet" => {
                let value = |name: &str| {
                    let attribute = e.try_get_attribute(name).unwrap().unwrap();
                    attribute.normalized_value(XmlVersion::Implicit1_0).unwrap().into_owned()
                };
                let file = file.with_file_name(value("file"));
                let part = vtu::read(&file, LengthUnit::Metre).unwrap_or_else(|e| panic!("{e}"));
                found.push((value("timestep").parse().unwrap(), value("name"), part));
            }
            Event::Eof => return found,
            _ => {}
        }
    }
}

/// ParaView finds what the steps are about in the frames, at the times of the gait, and nothing that is not a number.
#[test]
fn frames_hold_stress_fibres_contact_pressure_and_moving_bones() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    let output = sartorius(&arguments("out"), folder.path());
    assert!(output.status.code().is_some(), "{}", String::from_utf8_lossy(&output.stderr));
    let forces = fs::read_to_string(folder.path().join("out/rigid_forces.sto")).unwrap();
    let rows = forces.lines().skip_while(|l| !l.starts_with("time")).skip(1);
    let times: Vec<f64> = rows.map(|l| l.split('\t').next().unwrap().parse().unwrap()).collect();
    assert!(times.len() == 2 && times[1] > times[0] + 0.05, "{times:?}");
    for (configuration, touching) in [("no_contact", false), ("contact", true)] {
        let parts = collection(&folder.path().join("out").join(configuration).join("thigh.pvd"));
        let names: Vec<(f64, &str)> = parts.iter().map(|(t, name, _)| (*t, name.as_str())).collect();
        let all = ["solids", "fibres", "membranes", "bones"]; // the glutei have no tendons
        let wanted: Vec<(f64, &str)> = times.iter().flat_map(|t| all.map(|name| (*t, name))).collect();
        assert_eq!(names, wanted, "{configuration}");
        for (_, name, part) in &parts {
            for field in part.point_data.iter().chain(&part.cell_data) {
                assert!(
                    field.values.iter().all(|v| v.is_finite()),
                    "{configuration}, {name}: {}",
                    field.name
                );
            }
        }
        let field = |name: &str, field: &str| {
            let part = &parts.iter().rfind(|p| p.1 == name).unwrap().2;
            let found = part.point_data.iter().chain(&part.cell_data).find(|f| f.name == field);
            found.unwrap_or_else(|| panic!("{configuration}: {name} without {field}")).clone()
        };
        let most =
            |name: &str, what: &str| field(name, what).values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        for what in ["von_mises_Pa", "pressure_Pa", "volume_ratio", "cauchy_Pa"] {
            assert!(most("solids", what) > 0.0, "{configuration}: {what}");
        }
        // The tensor says what the scalars say.
        let (cauchy, pressure) = (field("solids", "cauchy_Pa"), field("solids", "pressure_Pa"));
        assert_eq!(cauchy.components, 9);
        for (s, p) in cauchy.values.chunks_exact(9).zip(pressure.values.iter()) {
            let size = s.iter().fold(1.0_f64, |m, v| m.max(v.abs()));
            assert!((s[0] + s[4] + s[8] + 3.0 * p).abs() < 1e-9 * size, "{s:?} and {p}");
        }
        assert!(most("fibres", "stretch") > 0.5 && most("fibres", "force_N") > 0.0, "{configuration}");
        for d in field("fibres", "fibre_direction").values.chunks_exact(3) {
            assert!((d.iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < 1e-12);
        }
        assert!(most("membranes", "area_ratio") > 0.5 && most("membranes", "tension_N_per_m") > 0.0);
        assert!(most("solids", "displacement_m") > 1e-3);
        // The thigh is bent from heel strike, where the mesh is, to loading response; the pelvis moves, too, and bones keep their shape.
        let bones: Vec<_> = parts.iter().filter(|p| p.1 == "bones").map(|p| &p.2.mesh).collect();
        assert!(bones[0].blocks.iter().any(|b| b.name == "femur"), "{:?}", bones[0].blocks.len());
        let moved = bones[0]
            .points
            .iter()
            .zip(&bones[1].points)
            .map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>().sqrt());
        assert!(moved.fold(0.0, f64::max) > 5e-3, "{configuration}: the bones stand still");
        let length = |mesh: &fem::mesh::Mesh, cell: &[u32]| {
            let (p, q) = (mesh.points[cell[0] as usize], mesh.points[cell[1] as usize]);
            (0..3).map(|c| (p[c] - q[c]).powi(2)).sum::<f64>().sqrt()
        };
        for cell in bones[0].blocks.iter().flat_map(|b| b.cells()) {
            assert!((length(bones[0], cell) - length(bones[1], cell)).abs() < 1e-12);
        }
        let pressed = ["solids", "bones"].map(|name| {
            let part = &parts.iter().rfind(|p| p.1 == name).unwrap().2;
            part.point_data.iter().any(|f| f.name == "contact_pressure_Pa")
        });
        assert_eq!(pressed, [touching; 2], "{configuration}");
        assert!(!touching || (100.0..1e6).contains(&most("solids", "contact_pressure_Pa")));
    }
    // Bones stand in the same places with and without contact, one time out of the plan, one time beside it.
    let femur = |configuration: &str| -> Vec<[f64; 3]> {
        let parts = collection(&folder.path().join("out").join(configuration).join("thigh.pvd"));
        let bones = parts.into_iter().rfind(|p| p.1 == "bones").unwrap().2.mesh;
        let block = bones.blocks.iter().find(|b| b.name == "femur").unwrap().clone();
        block.nodes.iter().map(|&n| bones.points[n as usize]).collect()
    };
    let (beside, planned) = (femur("no_contact"), femur("contact"));
    assert_eq!(beside.len(), planned.len());
    for (a, b) in beside.iter().zip(&planned) {
        assert!((0..3).all(|c| (a[c] - b[c]).abs() < 1e-12), "{a:?} and {b:?}");
    }
}
