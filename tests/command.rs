//! Does the command keep its promises: exit codes, files, same bytes on any number of threads, nothing written on bad input?

use std::fs;
use std::path::Path;

use coupling::optimize::{OptimizeOptions, optimize};
use multibody::trial::Status;
use support::walking::Walking;
use support::{sartorius, shared, text};

#[test]
fn the_walker_is_solved_and_every_file_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let output = sartorius(&["optimize"], folder.path());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("101 of 101 frames solved"), "{}", text(&output.stdout));
    let out = folder.path().join("out/optimize-walker");
    for (file, rows) in [
        ("kinematics.csv", 101),
        ("muscle_forces.csv", 101),
        ("activations.csv", 101),
        ("joint_forces.csv", 101),
        ("verdicts.csv", 101),
    ] {
        let lines = fs::read_to_string(out.join(file)).unwrap().lines().count();
        assert_eq!(lines, rows + 1, "{file}");
    }
    let run: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(out.join("run.json")).unwrap()).unwrap();
    assert_eq!(run["status"], "solved");
    let listed = run["files"].as_array().unwrap();
    for file in listed {
        assert!(out.join(file.as_str().unwrap()).exists(), "{file}");
    }
    let shown = |name: &str| !name.starts_with('.');
    let found =
        fs::read_dir(&out).unwrap().filter(|e| shown(&e.as_ref().unwrap().file_name().to_string_lossy()));
    assert_eq!(
        found.count(),
        listed.len() + usize::from(!listed.contains(&"run.json".into())),
        "stray files"
    );
    // The promise is 60 MiB for a whole run.
    assert!(run["peak_memory_mib"].as_f64().is_none_or(|m| m < 60.0), "{}", run["peak_memory_mib"]);
}

#[test]
fn threads_do_not_change_a_byte() {
    let folder = tempfile::tempdir().unwrap();
    for threads in ["1", "2"] {
        let output = sartorius(&["optimize", "--threads", threads, "--out", threads], folder.path());
        assert_eq!(output.status.code(), Some(0));
    }
    let mut compared = 0;
    for entry in fs::read_dir(folder.path().join("1")).unwrap() {
        let name = entry.unwrap().file_name();
        if name == "run.json" || name == ".sartorius" {
            continue; // hold times, and which process it was
        }
        let [one, two] = ["1", "2"].map(|t| fs::read(folder.path().join(t).join(&name)).unwrap());
        assert!(one == two, "{name:?} differs");
        compared += 1;
    }
    assert!(compared >= 10);
}

#[test]
fn bad_input_ends_with_2_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("broken.toml"), "motion = \"x.trc\"\nmotin = 3\n").unwrap();
    fs::write(folder.path().join("broken.c3d"), [2, 80, 0, 0]).unwrap();
    for (arguments, expected) in [
        (&["optimize", "nowhere.toml"][..], "nowhere.toml"),
        (&["optimize", "broken.toml"], "broken.toml, line"),
        (&["optimize", "--reserves", "-1"], "--reserves"),
        (&["optimize", "--raise-bounds", "0.5"], "--raise-bounds"),
        (&["optimize", "--hip-centre", "regression"], "--hip-centre"),
        (&["optimize", "--no-such-option"], "--no-such-option"),
        (&["optimize", "--measured", "nowhere.csv"], "nowhere.csv"),
        (&["optimize", "--threads", "0"], "--threads"),
        (&["check", "broken.c3d"], "broken.c3d"),
        (&["check", "nowhere.trc"], "nowhere.trc"),
        (&["check"], "FILE"),
        (&[], "Usage"),
    ] {
        let output = sartorius(arguments, folder.path());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", text(&output.stderr));
        assert!(text(&output.stderr).contains(expected), "{arguments:?}: {}", text(&output.stderr));
        assert!(!text(&output.stderr).contains("panicked"), "{arguments:?}");
    }
    assert!(!folder.path().join("out").exists(), "something was written");
}

#[test]
fn an_output_folder_that_is_a_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("occupied"), "here").unwrap();
    let output = sartorius(&["optimize", "--out", "occupied"], folder.path());
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(fs::read_to_string(folder.path().join("occupied")).unwrap(), "here");
}

#[test]
fn reserves_are_reported_and_never_silent() {
    let folder = tempfile::tempdir().unwrap();
    let output = sartorius(&["optimize", "--reserves", "1", "--out", "r", "--json"], folder.path());
    assert_eq!(output.status.code(), Some(0));
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let fraction = summary["largest_reserve_share"].as_f64().unwrap();
    assert!(fraction > 0.0);
    assert_eq!(summary["reserves"].as_array().unwrap().len(), 6);
    let output = sartorius(&["optimize", "--reserves", "1", "--out", "r"], folder.path());
    let said = text(&output.stdout);
    assert!(said.contains(&format!("reserves carry         up to {:.0} %", 100.0 * fraction)), "{said}");
    assert!(said.contains("hip_rotation"), "{said}");
    let table = fs::read_to_string(folder.path().join("r/reserves.csv")).unwrap();
    assert!(table.starts_with("time_s,hip_flexion_Nm"), "{}", &table[..60]);
}

#[test]
fn measured_knee_forces_are_compared() {
    let folder = tempfile::tempdir().unwrap();
    // As the competition distributes them: pounds-force of four load cells, trailing commas, bare carriage returns.
    let pounds = |newtons: f64| newtons / 4.4482216 / 2.0;
    let row = |k: i32| {
        let (t, m) = (0.01 * f64::from(k), pounds(700.0 + f64::from(k)));
        format!("{t},{m},{m},{l},{l},0,0,,\r", l = pounds(300.0))
    };
    let rows: String = (0..130).map(row).collect();
    fs::write(folder.path().join("knee.csv"), format!("Time(sec),PM,AM,AL,PL,GON,GRFz,,\r{rows}")).unwrap();
    let run = |more: &[&str]| {
        let output = sartorius(&[&["optimize", "--measured", "knee.csv"], more].concat(), folder.path());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        output
    };
    let words = text(&run(&[]).stdout);
    assert!(words.contains("1 - SSE/SST ") && words.contains("squared correlation "), "{words}");
    let page = fs::read_to_string(folder.path().join("out/optimize-walker/report.html")).unwrap();
    assert!(page.contains("1 − SSE/SST</th>") && page.contains("squared correlation</th>"));
    let output = run(&["--json"]);
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let total = &summary["measured"][2];
    assert_eq!(total[0], "total");
    let of_curves = |name: &str| {
        let table = fs::read_to_string(folder.path().join("out/optimize-walker/measured_knee.csv")).unwrap();
        let at = table.lines().next().unwrap().split(',').position(|c| c == name).unwrap();
        table.lines().skip(1).map(|l| l.split(',').nth(at).unwrap().parse().unwrap()).collect::<Vec<f64>>()
    };
    let (y, m) = (of_curves("total_measured_N"), of_curves("total_model_N"));
    assert!(
        (total[1]["peak_measured_N"].as_f64().unwrap() - y.iter().fold(0.0, |a: f64, b| a.max(*b))).abs()
            < 1e-9
    );
    assert!(y.windows(2).all(|w| w[1] > w[0]) && (y[0] - 1000.0).abs() < 1.0, "{y:?}");
    // Both numbers that are called R², by their definitions.
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let product = |a: &[f64], b: &[f64]| {
        let (p, q) = (mean(a), mean(b));
        a.iter().zip(b).map(|(a, b)| (a - p) * (b - q)).sum::<f64>()
    };
    let sse: f64 = y.iter().zip(&m).map(|(y, m)| (m - y).powi(2)).sum();
    let close = |key: &str, wanted: f64| {
        let found = total[1][key].as_f64().unwrap();
        assert!((found - wanted).abs() < 1e-6 * wanted.abs(), "{key}: {found} instead of {wanted}");
    };
    close("one_minus_sse_over_sst", 1.0 - sse / product(&y, &y));
    close("squared_correlation", product(&y, &m).powi(2) / (product(&y, &y) * product(&m, &m)));
    assert!(total[1]["rmse_N"].as_f64().unwrap() > 0.0);
}

/// The walker under 3.2 times its ground reaction: too much for the hip in part of stance. What is no solution is in no table, curve or number.
#[test]
fn frames_without_a_solution_are_gaps_and_not_scored() {
    let mut walking = Walking::new();
    for (force, _) in walking.plates.iter_mut().flatten() {
        *force *= 3.2;
    }
    let trial = walking.write();
    let folder = tempfile::tempdir().unwrap();
    let rows: String = (0..130).map(|k| format!("{},{},{}\n", 0.01 * k as f64, 700 + k, 300)).collect();
    fs::write(folder.path().join("knee.csv"), format!("time_s,medial_N,lateral_N\n{rows}")).unwrap();
    let arguments = ["optimize", trial.to_str().unwrap(), "--measured", "knee.csv", "--out", "o"];
    let output = sartorius(&arguments, folder.path());
    assert_eq!(output.status.code(), Some(3), "{}", text(&output.stderr));
    let out = folder.path().join("o");
    let column = |file: &str, name: &str| {
        let table = fs::read_to_string(out.join(file)).unwrap();
        let j = table.lines().next().unwrap().split(',').position(|c| c == name).unwrap();
        table.lines().skip(1).map(|l| l.split(',').nth(j).unwrap().to_string()).collect::<Vec<_>>()
    };
    let solved: Vec<bool> = column("verdicts.csv", "status").iter().map(|s| s == "solved").collect();
    let n = solved.iter().filter(|s| **s).count();
    assert!((solved.len() / 2..solved.len() - 5).contains(&n), "{n} of {} frames solved", solved.len());
    for (file, name) in
        [("muscle_forces.csv", "soleus_N"), ("activations.csv", "gmed1"), ("joint_forces.csv", "acl_N")]
    {
        let full: Vec<bool> = column(file, name).iter().map(|cell| !cell.is_empty()).collect();
        assert_eq!(full, solved, "{file}");
    }
    assert_eq!(column("least_violation.csv", "soleus_N").len(), solved.len() - n);
    let (modelled, measured) =
        (column("measured_knee.csv", "total_model_N"), column("measured_knee.csv", "total_measured_N"));
    assert_eq!(modelled.len(), n);
    let number = |cell: &String| cell.parse::<f64>().unwrap();
    let squares = modelled.iter().zip(&measured).map(|(m, y)| (number(m) - number(y)).powi(2));
    let rmse = (squares.sum::<f64>() / n as f64).sqrt();
    let run: serde_json::Value = serde_json::from_slice(&fs::read(out.join("run.json")).unwrap()).unwrap();
    let total = &run["verdict"]["measured"][2][1];
    assert!((total["rmse_N"].as_f64().unwrap() - rmse).abs() < 1e-6 * rmse);
    assert_eq!(run["verdict"]["compared_frames"], n);
    let peak = modelled.iter().map(number).fold(0.0, f64::max);
    assert!((run["verdict"]["peak_knee_force_N"].as_f64().unwrap() - peak).abs() < 1e-9 * peak);
    let said = text(&output.stdout);
    assert!(said.contains(&format!("over {n} of {} frames", solved.len())), "{said}");
}

#[test]
fn recorded_trials_are_solved_in_every_frame() {
    let Some(data) = shared("gait") else { return };
    for trial in ["DM_ngait_og3", "DM_ngait_og4", "jw_ngait_og1", "jw_ngait_og3", "jw_ngait_og7"] {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../gait-data/trials/{trial}.toml"));
        let done = optimize(&OptimizeOptions {
            trial: Some(file),
            data: Some(data.clone()),
            ..OptimizeOptions::default()
        })
        .unwrap();
        assert!(done.effort.verdicts.iter().all(|v| v.status == Status::Solved), "{trial}");
        assert!(done.effort.verdicts.iter().all(|v| v.kkt_residual < 1e-8), "{trial}");
        for frame in &done.motion.fit {
            assert_eq!(frame.failure, None, "{trial}");
            assert!(frame.constraint < 1e-9, "{trial}: {:.1e} m", frame.constraint);
        }
        let fits = &done.motion.fit[done.motion.report.clone()];
        let rms = (fits.iter().map(|f| f.marker_rms.powi(2)).sum::<f64>() / fits.len() as f64).sqrt();
        assert!(rms < 10e-3, "{trial}: {:.1} mm", 1e3 * rms);
        let column = |n: &str| done.effort.reactions.columns.iter().position(|c| c == n).unwrap();
        let (m, l) = (column("knee_medial"), column("knee_lateral"));
        let values = &done.effort.reactions.values;
        let peak = (0..values.nrows()).map(|k| values[(k, m)] + values[(k, l)]).fold(0.0, f64::max);
        let body_weights = peak / (9.81 * done.case.trial.subject.mass);
        assert!((1.5..4.5).contains(&body_weights), "{trial}: {body_weights:.2}");
    }
}

#[test]
fn the_published_residuals_of_subject_dm_are_met() {
    // Published: 7.3 mm with the hip centre of DM.osim, 8.8 mm with the regression (trial not named; og3 is met to 0.2 mm).
    let Some(data) = shared("gait") else { return };
    for (rule, published) in [(None, 7.3), (Some(multibody::trial_file::HipRule::Regression), 8.8)] {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../gait-data/trials/DM_ngait_og3.toml");
        let options = OptimizeOptions {
            trial: Some(file),
            data: Some(data.clone()),
            hip_centre: rule,
            ..OptimizeOptions::default()
        };
        let done = optimize(&options).unwrap();
        let fits = &done.motion.fit[done.motion.report.clone()];
        let rms = 1e3 * (fits.iter().map(|f| f.marker_rms.powi(2)).sum::<f64>() / fits.len() as f64).sqrt();
        assert!((rms - published).abs() < 0.2, "{rms:.2} mm instead of {published}");
    }
}

#[test]
fn mesh_writes_its_files_and_refuses_what_is_no_thigh() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["mesh", "--resolution", "12", "--only", "gracilis,sartorius", "--threads"];
    let run = |threads: &str, out: &str| {
        let output = sartorius(&[&arguments[..], &[threads, "--out", out]].concat(), folder.path());
        assert_eq!(output.status.code(), Some(0), "{}{}", text(&output.stdout), text(&output.stderr));
        folder.path().join(out)
    };
    let (one, two) = (run("1", "one"), run("2", "two"));
    for file in ["thigh.vtu", "thigh.inp", "quality.csv", "muscles.csv", "bone_crossings.csv", "report.html"]
    {
        assert!(fs::read(one.join(file)).unwrap() == fs::read(two.join(file)).unwrap(), "{file} differs");
    }
    let table = fs::read_to_string(one.join("quality.csv")).unwrap();
    assert_eq!(table.lines().count(), 3);
    let mesh = fem::mesh::Mesh::read(&one.join("thigh.inp"), fem::mesh::LengthUnit::Metre).unwrap();
    mesh.check().unwrap();
    let vtu = fem::mesh::Mesh::read(&one.join("thigh.vtu"), fem::mesh::LengthUnit::Metre).unwrap();
    assert!(mesh.points == vtu.points && mesh.blocks == vtu.blocks && mesh.node_sets == vtu.node_sets);
    assert_eq!(mesh.surface("gracilis/surface").unwrap().len() % 2, 0);

    for (arguments, words) in [
        (vec!["mesh", "--resolution", "0"], "--resolution is 0 mm; give 1.5 to 20 mm"),
        (vec!["mesh", "--only", "soleus"], "`soleus`"),
        (vec!["mesh", "absent.csv"], "absent.csv"),
        (vec!["mesh", "--subject", "absent.toml"], "absent.toml"),
        (vec!["mesh", "absent.csv", "--subject", "walker"], "--subject scales the built-in thigh"),
    ] {
        let output = sartorius(&arguments, folder.path());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(text(&output.stderr).contains(words), "{}", text(&output.stderr));
    }
    assert!(!folder.path().join("out").exists(), "bad input left files");
}
