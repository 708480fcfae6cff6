//! Bodies of one's own from the command line: do the shipped examples balance, agree with mechanics, repeat, and are bad scenes refused
//! with all that is wrong?

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use support::sartorius;

fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fem/examples/scenes")
}

/// Copies an example into a folder.
fn copied(name: &str, folder: &Path) {
    for ending in ["toml", "inp", "csv"] {
        let file = format!("{name}.{ending}");
        fs::copy(examples().join(&file), folder.join(&file)).unwrap();
    }
}

/// The rows of a table: the cells by their column.
fn rows(file: &Path) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(file).unwrap();
    let header = reader.headers().unwrap().clone();
    let row = |r: Result<csv::StringRecord, csv::Error>| {
        header.iter().map(String::from).zip(r.unwrap().iter().map(String::from)).collect()
    };
    reader.records().map(row).collect()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap()
}

/// Solves an example in a folder of its own; returns the folder of its results.
fn solved(name: &str, folder: &Path) -> PathBuf {
    copied(name, folder);
    let output = sartorius(&["solve", &format!("{name}.toml"), "--out", "o", "--quiet"], folder);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(output.stderr.is_empty());
    let checked = sartorius(&["check", &format!("{name}.toml")], folder);
    assert!(String::from_utf8_lossy(&checked.stdout).contains("good. Scene of `solve`"), "{checked:?}");
    let out = folder.join("o");
    assert!(out.join("run.json").exists() && out.join("frames/scene.pvd").exists());
    // Whatever holds a body at rest holds it in balance.
    let mut sums = BTreeMap::<String, [f64; 6]>::new();
    for row in rows(&out.join("supports.csv")) {
        let sum = sums.entry(row["time_s"].clone()).or_default();
        for (s, column) in sum.iter_mut().zip(["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"]) {
            *s += number(&row, column);
        }
    }
    let frames = rows(&out.join("frames.csv"));
    assert_eq!(
        (sums.len(), frames.len()),
        (
            frames.len(),
            fs::read_to_string(folder.join(format!("{name}.csv")))
                .unwrap()
                .lines()
                .filter(|l| l.starts_with(char::is_numeric))
                .count()
        )
    );
    for (frame, (time, sum)) in frames.iter().zip(&sums) {
        let (residual, wanted) = (number(frame, "residual_N"), number(frame, "wanted_residual_N"));
        assert!(residual <= wanted, "{time} s: {residual} of {wanted} N");
        // The norm over all nodes is below `wanted`, so a sum over n nodes is below √n of it, and its moment less than that times 0.05 m.
        for (s, scale) in sum.iter().zip([1.0, 1.0, 1.0, 0.05, 0.05, 0.05]) {
            assert!(s.abs() <= 100.0 * wanted * scale + 1e-7, "{time} s: {sum:?}");
        }
    }
    out
}

#[test]
fn a_squashed_block_pushes_with_its_energy() {
    let folder = tempfile::tempdir().unwrap();
    let out = solved("squashed_block", folder.path());
    let (sections, energies) = (rows(&out.join("sections.csv")), rows(&out.join("energies.csv")));
    let supports = rows(&out.join("supports.csv"));
    let pushes: Vec<f64> =
        supports.iter().filter(|r| r["support"] == "top").map(|r| number(r, "fz_N")).collect();
    for (row, push) in sections.iter().zip(&pushes) {
        assert!(
            (number(row, "force_N") - push).abs() < 1e-5,
            "the cut passes on what the plate pushes: {row:?}, {push}"
        );
        assert!(*push < 0.0);
    }
    // Work of the plate by Simpson's rule over 0, 2 and 4 mm; the force is smooth and starts at zero.
    let work = 0.004 / 6.0 * (4.0 * -pushes[0] - pushes[1]);
    let energy = number(&energies[1], "energy_J");
    assert!((work - energy).abs() < 0.02 * energy, "{work} J of work, {energy} J stored");
    for row in rows(&out.join("volumes.csv")) {
        let ratio = number(&row, "volume_mm3") / number(&row, "volume_in_mesh_mm3");
        assert!((0.985..1.0).contains(&ratio), "{row:?}");
    }
}

#[test]
fn a_held_muscle_pulls_with_the_stress_of_its_fibres() {
    let folder = tempfile::tempdir().unwrap();
    let out = solved("contracting_muscle", folder.path());
    let sections = rows(&out.join("sections.csv"));
    // At rest length 25 fibres of 4 mm² at 300 kPa pull with 30 N times the activation.
    for (row, activation) in sections.iter().zip([0.25, 0.5]) {
        assert!((number(row, "force_N") - 30.0 * activation).abs() < 1e-5, "{row:?}");
    }
    assert!(number(&sections[3], "force_N") < 15.0, "shorter than its optimum it pulls less");
}

#[test]
fn a_strap_presses_on_the_rod_as_its_ends_pull() {
    let folder = tempfile::tempdir().unwrap();
    let out = solved("strap_over_rod", folder.path());
    let (contact, supports) = (rows(&out.join("contact.csv")), rows(&out.join("supports.csv")));
    let ends: Vec<f64> =
        supports.iter().filter(|r| r["support"] == "ends").map(|r| number(r, "fz_N")).collect();
    assert_eq!(contact.len(), 3);
    for (row, pull) in contact.iter().zip(&ends) {
        assert_eq!((row["surface"].as_str(), row["other"].as_str()), ("strap", "rod"));
        assert!((number(row, "fz_N") + pull).abs() < 1e-7, "{row:?}, {pull}");
        assert!(number(row, "fz_N") > 1e-3 && number(row, "least_distance_mm") > 0.0);
    }
    assert!(
        rows(&out.join("frames.csv")).iter().all(|r| r["tested_stable"] == "true"),
        "the scene asks for it"
    );
}

/// A body all of whose nodes are prescribed is there to be touched: it takes nothing from what is said of the others.
#[test]
fn what_nothing_can_move_changes_no_verdict() {
    let [without, with] = [0, 1].map(|_| tempfile::tempdir().unwrap());
    let frames = |folder: &Path| fs::read_to_string(folder.join("o/frames.csv")).unwrap();
    solved("strap_over_rod", without.path());
    copied("strap_over_rod", with.path());
    let scene = with.path().join("strap_over_rod.toml");
    let solid = "\n[[solids]]\nregion = \"rod\"\nlaw = { kind = \"neo_hookean\", young = 1e9, nu = 0.3 }\n";
    fs::write(&scene, fs::read_to_string(&scene).unwrap() + solid).unwrap();
    let checked = sartorius(&["check", "strap_over_rod.toml"], with.path());
    let said = String::from_utf8_lossy(&checked.stdout).into_owned();
    assert!(said.contains("islands that are solved apart: 1."), "{said}");
    let output = sartorius(&["solve", "strap_over_rod.toml", "--out", "o", "--quiet"], with.path());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let columns = |table: &str| -> Vec<String> {
        let said = |l: &str| l.split(',').skip(4).collect::<Vec<_>>().join(",");
        table.lines().map(said).collect()
    };
    assert_eq!(columns(&frames(with.path())), columns(&frames(without.path())));
}

#[test]
fn one_thread_and_two_give_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    copied("strap_over_rod", folder.path());
    for threads in ["1", "2"] {
        let output = sartorius(
            &["solve", "strap_over_rod.toml", "--out", threads, "--threads", threads],
            folder.path(),
        );
        assert_eq!(output.status.code(), Some(0));
    }
    for table in [
        "frames.csv",
        "supports.csv",
        "contact.csv",
        "energies.csv",
        "volumes.csv",
        "frames/scene_0002_solids.vtu",
    ] {
        let [one, two] = ["1", "2"].map(|t| fs::read(folder.path().join(t).join(table)).unwrap());
        assert!(one == two, "{table}");
    }
}

#[test]
fn what_cannot_be_is_refused_with_its_place_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    copied("squashed_block", folder.path());
    let good = fs::read_to_string(folder.path().join("squashed_block.toml")).unwrap();
    let refused = |change: [&str; 2], words: &[&str]| {
        assert!(good.contains(change[0]), "{}", change[0]);
        fs::write(folder.path().join("bad.toml"), good.replace(change[0], change[1])).unwrap();
        let output = sartorius(&["solve", "bad.toml"], folder.path());
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(words.iter().all(|w| text.contains(w)), "{words:?} in: {text}");
        assert!(!folder.path().join("out").exists(), "nothing is written");
    };
    refused(["region = \"block\"", "region = \"blok\""], &["bad.toml", "blok", "block"]);
    refused(["[[cuts]]", "[[cutz]]"], &["bad.toml", "line 21", "cutz"]);
    refused(
        ["drive = \"squashed_block.csv\"\n", "[solver]\ntolerance = 2.0\n"],
        &["drive", "is missing", "tolerance is 2e0"],
    );
    refused(["\"squashed_block.csv\"", "\"none.csv\""], &["none.csv"]);
    refused(["\"squashed_block.inp\"", "\"none.inp\""], &["none.inp"]);
    refused(
        ["normal = [0.0, 0.0, 1.0]", "normal = [0.0, 0.0, 0.0]\neffects = [\"bloc\"]"],
        &["no plane", "bloc", "did you mean `block`"],
    );
    refused(
        ["control = \"squash\"", "control = \"press\""],
        &["squashed_block.csv", "line 1", "squash", "press"],
    );
}

#[test]
fn what_has_no_solution_says_so_and_keeps_what_was_solved() {
    let folder = tempfile::tempdir().unwrap();
    copied("squashed_block", folder.path());
    // Plates that meet: 20 mm of 20.
    fs::write(folder.path().join("squashed_block.csv"), "time_s,squash\n1,0.002\n2,0.02\n").unwrap();
    let output = sartorius(&["solve", "squashed_block.toml", "--out", "o"], folder.path());
    assert_eq!(output.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&output.stdout).contains("1 of 2 frames solved"));
    let record: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("o/run.json")).unwrap()).unwrap();
    assert_eq!(record["status"], "not_converged");
    assert!(record["reason"].as_str().is_some_and(|r| r.contains("block")), "{record}");
    assert_eq!(rows(&folder.path().join("o/frames.csv")).len(), 1);
}

#[test]
fn a_contact_distance_beyond_the_bodies_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    copied("strap_over_rod", folder.path());
    let scene = folder.path().join("strap_over_rod.toml");
    let text = fs::read_to_string(&scene).unwrap();
    assert!(text.contains("distance = 0.3e-3"));
    for distance in ["1e308", "100.0"] {
        let changed = text.replace("distance = 0.3e-3", &format!("distance = {distance}"));
        fs::write(&scene, changed).unwrap();
        let output = sartorius(&["check", "strap_over_rod.toml"], folder.path());
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(
            said.contains("contact") && said.contains("a thousand times what the surfaces measure"),
            "{said}"
        );
    }
}

#[test]
fn a_contact_surface_with_a_face_without_area_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    copied("strap_over_rod", folder.path());
    let mesh = folder.path().join("strap_over_rod.inp");
    // The cell at the corner is missing, and node 1 lies on its neighbour across the strap.
    let text = fs::read_to_string(&mesh).unwrap();
    let (node, cell) = ("\n1, -20, -4, 3.5\n", "\n155, 291, 296, 321, 316, 292, 297, 322, 317\n");
    assert!(text.contains(node) && text.contains(cell));
    fs::write(&mesh, text.replace(node, "\n1, -20, 1e-320, 3.5\n").replace(cell, "\n")).unwrap();
    let output = sartorius(&["check", "strap_over_rod.toml"], folder.path());
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("contact surface `strap`") && said.contains("without area"), "{said}");
}
