//! Studies: is a run what `optimize` computes, is the table the same whoever carried it out, does a killed worker lose or double anything, and is every mistake
//! named before anything runs?

use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use coupling::optimize::{OptimizeOptions, optimize};
use coupling::study::Study;
use coupling::study::run::curves;
use multibody::sharing::MuscleCost;
use multibody::trial::Table;
use nalgebra::Vector3;
use support::{program, sartorius};

/// The walker with uncertain landmarks and strengths and two ways to share forces.
const WALKER: &str = "samples = 6\nseed = 3\n\n[[setting]]\nname = \"force\"\nkeys = { \"optimize.cost\" = \"force\" }\n\n[[setting]]\nname = \"activation\"\nkeys = { \"optimize.cost\" = \"activation\" }\n\n\
    [[vary]]\nkey = \"landmarks\"\ndistribution = \"normal\"\nsd = 5.0\n\n[[vary]]\nkey = \"strengths\"\ndistribution = \"normal\"\nsd = 0.2\n";

/// A table as maps from column to cell, a map per run.
fn table(file: &Path) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(file).unwrap();
    let header = reader.headers().unwrap().clone();
    let row =
        |r: csv::StringRecord| header.iter().map(String::from).zip(r.iter().map(String::from)).collect();
    reader.records().map(|r| row(r.unwrap())).collect()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("`{column}` is `{}`", row[column]))
}

#[test]
fn a_run_is_what_optimize_computes_with_the_values_of_its_row() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("walker.toml"), WALKER).unwrap();
    let output = sartorius(&["study", "walker.toml", "--out", "out", "--quiet"], folder.path());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let rows = table(&folder.path().join("out/table.csv"));
    assert_eq!(rows.len(), 12);
    // Both settings have the same samples.
    let inputs: Vec<&String> =
        rows[0].keys().filter(|k| k.starts_with("landmarks") || k.starts_with("strengths")).collect();
    assert_eq!(inputs.len(), 36 + 43);
    for pair in rows.chunks(2) {
        assert!(
            inputs.iter().all(|k| pair[0][*k] == pair[1][*k]) && pair[0]["setting"] != pair[1]["setting"]
        );
    }
    for row in &rows[4..8] {
        let mut options = OptimizeOptions::revised();
        for column in &inputs {
            let value = number(row, column);
            match column.split('.').collect::<Vec<_>>()[..] {
                ["strengths", muscle] => drop(options.changes.strengths.insert(muscle.into(), value)),
                ["landmarks", name, axis] => {
                    let axis = ["x_mm", "y_mm", "z_mm"].iter().position(|a| *a == axis).unwrap();
                    let mut shift = Vector3::zeros();
                    shift[axis] = 1e-3 * value;
                    assert!(options.changes.landmarks.add(name, shift));
                }
                _ => panic!("{column}"),
            }
        }
        options.sharing.muscle_cost = match row["setting"].as_str() {
            "activation" => MuscleCost::Activation,
            _ => MuscleCost::Force,
        };
        let done = optimize(&options).unwrap();
        for (name, values) in curves(&done.effort) {
            let peak = values.iter().fold(f64::NEG_INFINITY, |m, v| m.max(*v));
            assert_eq!(
                peak.to_bits(),
                number(row, &format!("peak_{name}_N")).to_bits(),
                "{name} of run {}",
                row["run"]
            );
        }
        let knee = done.effort.reactions.column("knee_medial").unwrap();
        let knee = knee.iter().zip(done.effort.reactions.column("knee_lateral").unwrap()).map(|(m, l)| m + l);
        assert_eq!(knee.fold(0.0, f64::max).to_bits(), number(row, "peak_knee_N").to_bits());
    }
    let spread = |column: &str| {
        let values: Vec<f64> = rows.iter().map(|row| number(row, column)).collect();
        values.iter().fold(f64::NEG_INFINITY, |m, v| m.max(*v))
            - values.iter().fold(f64::INFINITY, |m, v| m.min(*v))
    };
    assert!(spread("peak_knee_N") > 10.0, "what varies changes the knee force");
}

/// Strength is what a muscle can pull: with half of it, force sharing by activations asks as much of it as of a muscle of half the size.
#[test]
fn strengths_bound_the_forces() {
    let peak = |mut options: OptimizeOptions, factor: f64| {
        options.changes.strengths.insert("soleus".into(), factor);
        let done = optimize(&options).unwrap();
        let soleus = done.model.muscles.iter().find(|m| m.name == "soleus").unwrap().f_max;
        let highest = |table: &Table| table.column("soleus").unwrap().iter().fold(0.0, |m: f64, v| m.max(*v));
        (soleus, highest(&done.effort.forces), highest(&done.effort.activations))
    };
    let (strong, free, _) = peak(OptimizeOptions::default(), 1.0);
    let (weak, bounded, active) = peak(OptimizeOptions::default(), 0.1);
    assert!((weak / strong - 0.1).abs() < 1e-12);
    assert!(
        free > weak && (bounded / weak - 1.0).abs() < 1e-6,
        "{free} N unbounded, {bounded} N of {weak} N"
    );
    assert!(active > 0.8, "a weak muscle works hard: {active}");
    // By its state: what it can do at most, lengthening and with what it has of passive force, is as much weaker.
    let (_, free, calm) = peak(OptimizeOptions::revised(), 1.0);
    let (weak, bounded, active) = peak(OptimizeOptions::revised(), 0.05);
    assert!(free > 2.0 * weak && bounded < 2.0 * weak, "{free} N unbounded, {bounded} N of {weak} N");
    assert!(active > 2.0 * calm, "a weak muscle works harder: {active} for {calm}");
}

#[test]
fn the_table_is_the_same_whoever_carried_it_out_and_in_whatever_pieces() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    fs::write(at.join("walker.toml"), WALKER).unwrap();
    let study = |arguments: &[&str]| {
        let all = [&["study", "walker.toml", "--quiet"], arguments].concat();
        sartorius(&all, at)
    };
    assert!(study(&["--out", "one", "--workers", "1"]).status.success());
    assert!(study(&["--out", "three", "--workers", "3"]).status.success());
    // Tasks of a job array, side by side, then table and page.
    let parts: Vec<_> = (1..=3)
        .map(|k| {
            let part = format!("{k}/3");
            let arguments =
                ["study", "walker.toml", "--quiet", "--out", "parts", "--workers", "1", "--part", &part];
            Command::new(program()).args(arguments).current_dir(at).spawn().unwrap()
        })
        .collect();
    for mut part in parts {
        assert!(part.wait().unwrap().success());
    }
    assert!(!at.join("parts/table.csv").exists());
    assert!(study(&["--out", "parts", "--collect"]).status.success());
    let files = ["table.csv", "table.parquet", "report.html"];
    for file in files {
        let one = fs::read(at.join("one").join(file)).unwrap();
        for other in ["three", "parts"] {
            assert!(one == fs::read(at.join(other).join(file)).unwrap(), "{file} of {other}");
        }
    }
    // What is done is taken over, and only that.
    let run = at.join("one").join(Study::folder(5)).join("run.json");
    let untouched = at.join("one").join(Study::folder(6)).join("run.json");
    let before = fs::metadata(&untouched).unwrap().modified().unwrap();
    let old = fs::read(&run).unwrap();
    fs::write(&run, &old[..old.len() / 2]).unwrap();
    assert!(study(&["--out", "one", "--resume"]).status.success());
    assert_eq!(fs::metadata(&untouched).unwrap().modified().unwrap(), before);
    assert!(fs::read(at.join("one/table.csv")).unwrap() == fs::read(at.join("three/table.csv")).unwrap());
    // Another study in the same folder takes over nothing.
    fs::write(at.join("walker.toml"), WALKER.replace("sd = 5.0", "sd = 4.0")).unwrap();
    assert!(study(&["--out", "one", "--resume"]).status.success());
    assert!(fs::read(at.join("one/table.csv")).unwrap() != fs::read(at.join("three/table.csv")).unwrap());
}

/// Processes whose parent this is.
#[cfg(target_os = "linux")]
fn children(parent: u32) -> Vec<u32> {
    let processes = fs::read_dir("/proc").unwrap().flatten();
    let numbers = processes.filter_map(|e| e.file_name().to_str()?.parse::<u32>().ok());
    let is_child = |p: &u32| {
        let stat = fs::read_to_string(format!("/proc/{p}/stat")).unwrap_or_default();
        let after_name = stat.rsplit(')').next().unwrap_or("").split_whitespace().nth(1).map(str::to_string);
        after_name == Some(parent.to_string())
    };
    numbers.filter(is_child).collect()
}

/// Kills so many of the first workers of a study that runs. Those that take their places live: a run that ends two workers is given up.
#[cfg(target_os = "linux")]
fn kill_workers(study: u32, times: usize) {
    let begun = Instant::now();
    let workers = loop {
        let workers = children(study);
        if workers.len() >= times {
            break workers;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "no worker to kill");
        std::thread::sleep(Duration::from_millis(10));
    };
    for worker in &workers[..times] {
        std::thread::sleep(Duration::from_millis(150));
        assert!(Command::new("kill").args(["-9", &worker.to_string()]).status().unwrap().success());
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_worker_that_is_killed_loses_nothing_and_doubles_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    fs::write(at.join("walker.toml"), WALKER.replace("samples = 6", "samples = 12")).unwrap();
    let start = |out: &str| {
        let arguments = ["study", "walker.toml", "--workers", "2", "--out", out];
        Command::new(program())
            .args(arguments)
            .current_dir(at)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    };
    assert!(start("whole").wait().unwrap().success());
    let mut study = start("killed");
    kill_workers(study.id(), 2);
    let mut said = String::new();
    let status = study.wait().unwrap();
    study.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(status.success(), "{said}");
    assert!(fs::read(at.join("whole/table.csv")).unwrap() == fs::read(at.join("killed/table.csv")).unwrap());
}

#[test]
fn failures_are_rows_with_their_reason() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    // Strengths of a tenth carry no walker, and recordings that are not there are named.
    let text = "samples = 2\nsequence = \"random\"\n\n[[subject]]\nname = \"walker\"\ntrial = \"walker\"\n\n[[subject]]\nname = \"elsewhere\"\ntrial = \"DM_ngait_og3\"\n\n\
        [[vary]]\nkey = \"strengths\"\ndistribution = \"uniform\"\nlow = 0.01\nhigh = 0.02\n";
    fs::write(at.join("weak.toml"), text).unwrap();
    let output = sartorius(&["study", "weak.toml", "--out", "out", "--json"], at);
    assert_eq!(output.status.code(), Some(3), "{}", String::from_utf8_lossy(&output.stderr));
    let verdict: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&verdict["solved"], &verdict["done"]), (&0.into(), &4.into()));
    let rows = table(&at.join("out/table.csv"));
    for row in &rows {
        let wanted = match row["subject"].as_str() {
            "walker" => ["not_converged", "of 101 frames are not solved"],
            _ => ["refused", "DM_ngait_og3"],
        };
        assert!(row["status"] == wanted[0] && row["reason"].contains(wanted[1]), "{row:?}");
        assert!(!row.contains_key("peak_knee_N"), "no number of runs without results");
    }
    let page = fs::read_to_string(at.join("out/report.html")).unwrap();
    assert!(page.contains("Failures by reason") && page.contains("# of # frames are not solved"));
    let record: serde_json::Value =
        serde_json::from_slice(&fs::read(at.join("out/run.json")).unwrap()).unwrap();
    assert_eq!(record["status"], "not_converged");
}

#[test]
fn mistakes_are_named_before_anything_runs() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    fs::write(
        at.join("wrong.toml"),
        WALKER.replace("optimize.cost", "optimize.costs").replace("\"landmarks\"", "\"landmark\""),
    )
    .unwrap();
    let output = sartorius(&["study", "wrong.toml", "--out", "out"], at);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    for words in
        ["line 6", "line 10", "did you mean `optimize.cost`?", "line 13", "did you mean `landmarks`?"]
    {
        assert!(said.contains(words), "{words} in {said}");
    }
    assert!(!at.join("out").exists());
    fs::write(at.join("scene.toml"), "resolution_mm = 20.0\n").unwrap();
    let output = sartorius(&["study", "scene.toml"], at);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && said.contains("this is a scene, not a study"), "{said}");
    let output = sartorius(&["study", "wrong.toml", "--part", "4/3"], at);
    assert_eq!(output.status.code(), Some(2));
    fs::write(at.join("right.toml"), WALKER).unwrap();
    let output = sartorius(&["check", "right.toml"], at);
    assert!(String::from_utf8_lossy(&output.stdout).contains("12 runs"), "{output:?}");
}

/// Scenes: what varies reaches the thigh, frames are dropped, numbers are those of `step`.
#[test]
fn runs_of_a_scene_are_those_of_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let text = "run = \"compare\"\nscene = \"scene.toml\"\ncontact = \"without\"\nsamples = 2\n\n\
        [[vary]]\nkey = \"scene.materials.matrix_a_kpa\"\ndistribution = \"choice\"\nvalues = [3.0, 6.0]\n";
    let scene = "muscles = [\"gluteus_minimus\"]\nresolution_mm = 20.0\n";
    fs::write(at.join("scene.toml"), scene).unwrap();
    fs::write(at.join("one.toml"), text).unwrap();
    let output = sartorius(&["study", "one.toml", "--out", "out", "--quiet"], at);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let rows = table(&at.join("out/table.csv"));
    let column = "heel_strike.no_contact.section_force_N.gluteus_minimus";
    let stiff: Vec<f64> = rows.iter().map(|row| number(row, "scene.materials.matrix_a_kpa")).collect();
    assert!(stiff.contains(&3.0) && stiff.contains(&6.0), "{stiff:?}");
    for (row, a) in rows.iter().zip(stiff) {
        fs::write(at.join("alone.toml"), format!("{scene}[materials]\nmatrix_a_kpa = {a:?}\n")).unwrap();
        let output =
            sartorius(&["compare", "alone.toml", "--contact", "without", "--out", "alone", "--quiet"], at);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let quantities = fs::read_to_string(at.join("alone/quantities.csv")).unwrap();
        let line = quantities
            .lines()
            .find(|l| l.starts_with("heel_strike,no_contact,section_force_N,gluteus_minimus,"))
            .unwrap();
        assert_eq!(line.rsplit(',').next().unwrap(), format!("{:.6e}", number(row, column)));
    }
    assert!(!at.join("out").join(Study::folder(0)).join("no_contact").exists());
}

/// Indices of a study once more from its table, by the formulas as they are printed.
#[test]
fn indices_are_those_of_the_table() {
    const SAMPLES: usize = 8;
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    // Curves change activations and no force: of the scatter of forces they have no part, to the last bit.
    let curves = "\n[[vary]]\nkey = \"optimize.curves\"\ndistribution = \"choice\"\nvalues = [\"thelen\", \"degroote\"]\n";
    // That is so of the published leg; the bounds of the revised one follow the curves.
    let published = WALKER.replace("keys = {", "keys = { \"optimize.form\" = \"published\",");
    let text = format!(
        "indices = true\n{}{curves}",
        published.replace("samples = 6", &format!("samples = {SAMPLES}"))
    );
    fs::write(at.join("walker.toml"), text).unwrap();
    let output = sartorius(&["study", "walker.toml", "--out", "out", "--quiet"], at);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let rows = table(&at.join("out/table.csv"));
    let sets = ["first", "second", "landmarks", "strengths", "optimize.curves"];
    assert_eq!(rows.len(), SAMPLES * sets.len() * 2);
    let of = |setting: &str, set: &str| -> Vec<&BTreeMap<String, String>> {
        let own: Vec<_> = rows.iter().filter(|r| r["setting"] == setting && r["set"] == set).collect();
        let samples: Vec<usize> = own.iter().map(|r| r["sample"].parse().unwrap()).collect();
        assert_eq!(samples, (0..SAMPLES).collect::<Vec<usize>>());
        own
    };
    // A set with a group exchanged has that group of the second set, and the rest of the first.
    for group in &sets[2..] {
        let [first, second, exchanged] = ["first", "second", group].map(|set| of("force", set));
        for sample in 0..SAMPLES {
            for (column, value) in exchanged[sample].iter() {
                if ["landmarks.", "strengths.", "optimize."].iter().any(|space| column.starts_with(space)) {
                    let from = if column.starts_with(group) { &second } else { &first };
                    assert_eq!(*value, from[sample][column], "{column} of {group}");
                }
            }
        }
        if group.starts_with("optimize") {
            continue;
        }
        let differs = |k: usize| first[k]["strengths.soleus"] != second[k]["strengths.soleus"];
        assert!((0..SAMPLES).all(differs), "the second set is another one");
    }
    let indices = table(&at.join("out/indices.csv"));
    for setting in ["force", "activation"] {
        for name in ["peak_knee_N", "peak_soleus_N", "peak_gmed1_N"] {
            let values = |set: &str| of(setting, set).iter().map(|r| number(r, name)).collect::<Vec<f64>>();
            let (first, second) = (values("first"), values("second"));
            let all = [first.as_slice(), &second].concat();
            let n = SAMPLES as f64;
            let mean = all.iter().sum::<f64>() / (2.0 * n);
            let variance = all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (2.0 * n);
            for group in &sets[2..] {
                let row = indices
                    .iter()
                    .find(|r| r["number"] == name && r["setting"] == setting && r["vary"] == *group)
                    .unwrap();
                let exchanged = values(group);
                let squares = first.iter().zip(&exchanged).map(|(a, b)| (a - b).powi(2));
                let total = squares.sum::<f64>() / 2.0 / n / variance;
                let products = (0..SAMPLES).map(|k| (second[k] - mean) * (exchanged[k] - first[k]));
                let alone = products.sum::<f64>() / n / variance;
                let [value, error] = ["first_order", "first_order_error"].map(|column| number(row, column));
                assert!(
                    (number(row, "total") - total).abs() < 1e-12 && (value - alone).abs() < 1e-12,
                    "{row:?}"
                );
                if group.starts_with("optimize") {
                    assert_eq!([value, error, number(row, "total")], [0.0; 3], "{row:?}");
                }
                assert_eq!(row["samples"], SAMPLES.to_string());
            }
        }
    }
    let page = fs::read_to_string(at.join("out/report.html")).unwrap();
    assert!(page.contains("Where the scatter comes from") && page.contains("strengths, with others"));
    // Too few samples, or nothing that varies: said before anything runs.
    fs::write(at.join("few.toml"), format!("indices = true\n{WALKER}")).unwrap();
    let output = sartorius(&["study", "few.toml", "--out", "few"], at);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && said.contains("8 samples at least"), "{said}");
    assert!(said.contains("line 2") && !at.join("few").exists(), "{said}");
}

/// The same of scenes: three muscles, two workers or one, one of them killed.
#[cfg(target_os = "linux")]
#[test]
fn runs_of_a_scene_are_the_same_with_any_workers_and_after_one_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let text = "run = \"compare\"\nscene = \"scene.toml\"\ncontact = \"without\"\nsamples = 3\n\n\
        [[vary]]\nkey = \"strengths\"\ndistribution = \"normal\"\nsd = 0.1\n";
    fs::write(at.join("scene.toml"), "muscles = [\"gluteus_minimus\"]\nresolution_mm = 20.0\n").unwrap();
    fs::write(at.join("one.toml"), text).unwrap();
    for workers in ["1", "2"] {
        let output = sartorius(&["study", "one.toml", "--out", workers, "--workers", workers, "--quiet"], at);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    let arguments = ["study", "one.toml", "--workers", "2", "--out", "killed"];
    let mut study = Command::new(program())
        .args(arguments)
        .current_dir(at)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    kill_workers(study.id(), 1);
    assert!(study.wait().unwrap().success());
    let one = fs::read(at.join("1/table.csv")).unwrap();
    assert!(one == fs::read(at.join("2/table.csv")).unwrap());
    assert!(one == fs::read(at.join("killed/table.csv")).unwrap());
}
