//! Whether what `compare` writes is true.

use coupling::comparison::Prepared;
use coupling::comparison::explain::explain;
use coupling::configuration::PerConfiguration;
use coupling::scene::Scene;
use fem::measure::nodal_forces;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use support::{sartorius, text};

/// Files of a run that hold no times, by their path in its folder.
fn timeless(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for sub in ["", "no_contact"] {
        for entry in fs::read_dir(folder.join(sub)).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(folder).unwrap().to_str().unwrap().to_string();
            let timed = [
                ".sartorius",
                "run.json",
                "report.html",
                "no_contact/iterations.csv",
                "no_contact/thigh.json",
            ];
            if path.is_file() && !timed.contains(&name.as_str()) {
                found.insert(name, fs::read(&path).unwrap());
            }
        }
    }
    found
}

#[test]
fn passive_tissue_has_no_fibre_force_and_a_prescribed_knee_moves_it() {
    let folder = tempfile::tempdir().unwrap();
    let table = |flexion: &str| {
        let scene = format!(
            "muscles = [\"vastus_lateralis\"]\nresolution_mm = 16.0\n[effects]\nfibres = \"none\"\ncontact = \"none\"\n\
             [[step]]\nname = \"loading_response\"\nknee_flexion_deg = {flexion}\n"
        );
        fs::write(folder.path().join("passive.toml"), scene).unwrap();
        let output = sartorius(&["compare", "passive.toml", "--out", "p"], folder.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let table = fs::read_to_string(folder.path().join("p/comparison.csv")).unwrap();
        let cells: Vec<f64> =
            table.lines().nth(1).unwrap().split(',').skip(2).map(|c| c.parse().unwrap_or(f64::NAN)).collect();
        cells
    };
    let (straight, bent) = (table("0.0"), table("30.0"));
    for cells in [&straight, &bent] {
        assert_eq!(cells[6], 0.0, "fibres: {cells:?}");
    }
    // The mesh stands with straight knee, where it is free of stress; the solver stops at 0.01 N.
    assert!(straight[2].abs() < 0.02, "{straight:?}");
    assert!(bent[2] > 0.2, "flexion stretches the vasti: {bent:?}");
}

#[test]
fn one_pass_of_two_way_coupling_is_the_one_way_result() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 18.0\n[effects]\ncontact = \"none\"\n";
    fs::write(folder.path().join("two.toml"), scene).unwrap();
    let run = |out: &str, more: &[&str]| {
        let output = sartorius(&[&["compare", "two.toml", "--out", out], more].concat(), folder.path());
        let code = output.status.code();
        assert!(code == Some(0) || more.len() > 1 && code == Some(3), "{}", text(&output.stderr));
        timeless(&folder.path().join(out))
    };
    let one_way = run("one", &[]);
    let mut stopped = run("stopped", &["--two-way", "--passes", "1"]);
    let passes = text(&stopped.remove("passes.csv").unwrap());
    assert_eq!(passes.lines().count(), 2, "{passes}");
    // What muscles can do is asked for by the pass after; one has none.
    assert_eq!(text(&stopped.remove("capacities.csv").unwrap()).lines().count(), 1);
    // What single muscles keep missing adds up to what is missing.
    let missing = text(&stopped.remove("missing_moments.csv").unwrap());
    let number = |cell: &str| cell.parse::<f64>().unwrap();
    for (k, step) in ["heel_strike", "loading_response"].iter().enumerate() {
        let all: Vec<f64> =
            passes.lines().nth(1).unwrap().split(',').skip(5 + 4 * k).take(4).map(number).collect();
        assert!(all[1].abs() > 0.1, "{passes}");
        let rows: Vec<&str> = missing.lines().filter(|l| l.split(',').nth(1) == Some(step)).collect();
        assert_eq!(rows.len(), 2, "{missing}");
        for (c, all) in all.iter().enumerate() {
            let sum: f64 = rows.iter().map(|row| number(row.split(',').nth(5 + c).unwrap())).sum();
            assert!((sum - all).abs() < 2e-5, "{step} {c}: {sum} and {all}"); // five digits each
        }
    }
    assert!(one_way.len() > 6 && one_way.contains_key("no_contact/thigh_0001_solids.vtu"));
    assert_eq!(one_way.keys().collect::<Vec<_>>(), stopped.keys().collect::<Vec<_>>());
    for (name, bytes) in &one_way {
        assert!(bytes == &stopped[name], "{name} differs");
    }
    // A second pass sees what the first one says, and does not change it.
    let passes_of = |csv: &str| csv.lines().nth(1).unwrap().to_string();
    let coupled = run("two", &["--two-way", "--passes", "2"]);
    let two = text(&coupled["passes.csv"]);
    assert_eq!(two.lines().count(), 3, "{two}");
    assert_eq!(passes_of(&two), passes_of(&passes));
    // A row per step and muscle.
    let capacities = text(&coupled["capacities.csv"]);
    assert_eq!(capacities.lines().count(), 1 + 2 * 2, "{capacities}");
    // The last pass is the result, in every table, and the one-way result stands beside it. It has not settled, and that is said.
    let rows = |csv: &str| -> Vec<Vec<String>> {
        csv.lines().skip(1).map(|l| l.split(',').map(String::from).collect()).collect()
    };
    let (before, after) = (text(&one_way["comparison.csv"]), text(&coupled["comparison.csv"]));
    assert!(
        after.starts_with(before.lines().next().unwrap()),
        "the columns of a one-way result stay where they are"
    );
    let last: Vec<Vec<String>> =
        rows(&text(&coupled["missing_moments.csv"])).into_iter().filter(|r| r[0] == "2").collect();
    for ((one, two), seen) in rows(&before).iter().zip(rows(&after)).zip(&last) {
        assert_eq!([&two[12], &two[13]], [&one[3], &one[4]], "one-way beside it");
        assert_eq!(
            [&two[3], &two[4]],
            [&seen[3], &seen[4]],
            "the forces that were wanted and found in pass 2"
        );
        assert!((number(&two[6]) - (number(&two[4]) - number(&two[3]))).abs() < 2e-3, "{two:?}");
    }
    assert!(
        rows(&before)[3][3..5] != rows(&after)[3][3..5],
        "the second pass changed nothing: the test sees nothing"
    );
    let sto = text(&coupled["fe_forces_no_contact.sto"]);
    let said: f64 = number(sto.lines().last().unwrap().split('\t').next_back().unwrap());
    assert!((said - number(&rows(&after)[3][4])).abs() < 1e-3, "{sto}");
    assert_eq!(coupled["fe_forces_no_contact_one_way.sto"], {
        let sto = text(&one_way["fe_forces_no_contact.sto"]);
        sto.replace("fe_forces_no_contact", "fe_forces_no_contact_one_way").into_bytes()
    });
    let beside = fs::read(folder.path().join("two/one_way/thigh_0001_solids.vtu")).unwrap();
    assert!(beside == one_way["no_contact/thigh_0001_solids.vtu"], "frames of the one-way result");
    let frame = "no_contact/thigh_0001_solids.vtu";
    assert!(coupled[frame] != one_way[frame], "frames of the last pass");
    let run = fs::read_to_string(folder.path().join("two/run.json")).unwrap();
    assert!(run.contains("two-way coupling has not settled"), "{run}");
    let page = fs::read_to_string(folder.path().join("two/report.html")).unwrap();
    assert!(page.contains("one-way: FE, N") && page.contains("two-way coupling has not settled"));
    // One configuration is coupled, not two at once.
    fs::write(folder.path().join("both.toml"), scene.replace("\"none\"", "\"guarded\"")).unwrap();
    let output = sartorius(&["compare", "both.toml", "--two-way", "--contact", "both"], folder.path());
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("--contact with"), "{}", text(&output.stderr));
}

/// The contact resultant of a muscle is the sum of what contact does to its nodes, and what its bones have to hold.
#[test]
fn the_contact_resultant_of_a_muscle_is_held_by_its_bones() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 18.0\nstress_free = \"heel_strike\"\n\
                 [accuracy]\ncontact_residual_n = 0.1\n[[step]]\nname = \"heel_strike\"\n";
    let scene = Scene::parse(Path::new("mine.toml"), scene, None).unwrap();
    let prepared = Prepared::new(scene, None, &mut |_| ()).unwrap();
    let with = PerConfiguration { without: false, with: true };
    let comparison = prepared.solve(with, &folder.path().join("out"), false, &mut |_| ()).unwrap();
    let result = comparison.solutions.with.as_ref().unwrap();
    let plan = &result.plan;
    let frame = result.at_steps().next().expect("solved");
    let total = nodal_forces(plan, frame.snapshot());
    let mut pushes = vec![Vector3::zeros(); plan.mesh.points.len()];
    for island in &plan.islands {
        let x: Vec<f64> =
            island.nodes.iter().flat_map(|&n| frame.x[3 * n as usize..][..3].to_vec()).collect();
        let gradient = island.contact_gradient(&x).expect("an island in contact");
        for (&n, g) in island.nodes.iter().zip(gradient.chunks_exact(3)) {
            pushes[n as usize] -= Vector3::from_column_slice(g);
        }
    }
    let rows = explain(plan, &comparison.thigh, &comparison.calibration, &prepared.steps[0], frame);
    assert_eq!(rows.len(), 2);
    for (row, muscle) in rows.iter().zip(&comparison.thigh.muscles) {
        let nodes = muscle.first_node..muscle.first_node + muscle.s.len() as u32 * muscle.nodes_per_layer;
        let push: Vector3<f64> = nodes.map(|n| pushes[n as usize]).sum();
        let said = row.contact.unwrap();
        assert!(push.norm() > 5.0, "{}: {said} N, the test sees nothing", muscle.name);
        assert!((said - push.norm()).abs() < 1e-6 * push.norm(), "{}: {said} and {push}", muscle.name);
        // In equilibrium the bones, tendons included, hold what contact pushes; the solution ends at 0.1 N.
        let own = format!("{}/", muscle.name);
        let ties = comparison.thigh.scene.ties.iter().filter(|t| t.nodes.starts_with(&own));
        let tied = ties.flat_map(|t| &plan.mesh.node_sets[&t.nodes]);
        let held: Vector3<f64> =
            tied.map(|&n| Vector3::from_column_slice(&total[3 * n as usize..][..3])).sum();
        assert!((held + push).norm() < 1.0, "{}: held {held}, pushed {push}", muscle.name);
    }
}

/// Cheap contact penetrates: that is how it works and no reason to call a run not solved.
#[test]
fn what_cheap_contact_penetrates_is_no_failure() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "muscles = [\"gluteus_minimus\", \"gluteus_medius\"]\nresolution_mm = 18.0\n\
                 [effects]\ncontact = \"cheap\"\n[[step]]\nname = \"heel_strike\"\n";
    fs::write(folder.path().join("cheap.toml"), scene).unwrap();
    let done = sartorius(&["compare", "cheap.toml", "--contact", "with"], folder.path());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
}
