//! The table of a run of `compare` as Markdown, from its `comparison.csv` and `run.json`:
//!
//! `cargo run --release -p sartorius-command --example tables -- out/compare-walker [--into README.md]`
//!
//! `--into` puts it in place of the table that follows the line `<!-- table of NAME -->` in a file, NAME being that of the scene.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};

use command::report::compare::published;
use coupling::configuration::Configuration;
use coupling::scene::StepName;
use serde_json::Value;

type Anything<T> = Result<T, Box<dyn Error>>;

/// A row of `comparison.csv`, by its columns.
type Row = BTreeMap<String, String>;

fn main() -> Anything<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (folder, into) = match &arguments[..] {
        [folder] => (PathBuf::from(folder), None),
        [folder, option, file] if option == "--into" => (PathBuf::from(folder), Some(PathBuf::from(file))),
        _ => {
            return Err("give the folder of a run of compare, and --into FILE where the table belongs".into());
        }
    };
    let record: Value = serde_json::from_slice(&std::fs::read(folder.join("run.json"))?)?;
    let table = table(&folder.join("comparison.csv"), &record)?;
    match into {
        None => print!("{table}"),
        Some(file) => {
            put(&file, &scene_of(&record).ok_or("run.json does not say which scene it is of")?, &table)?
        }
    }
    Ok(())
}

/// Name of the scene, from what computes the run again.
fn scene_of(record: &Value) -> Option<String> {
    let arguments = record["again"]["arguments"].as_array()?;
    let scene = Path::new(arguments.get(1)?.as_str()?);
    Some(scene.file_stem()?.to_string_lossy().into_owned())
}

/// Puts a table in place of the one after its marker.
fn put(file: &Path, name: &str, table: &str) -> Anything<()> {
    let marker = format!("<!-- table of {name} -->\n");
    let text = std::fs::read_to_string(file)?;
    let (before, after) =
        text.split_once(&marker).ok_or_else(|| format!("{} has no line {marker}", file.display()))?;
    let rest: Vec<&str> = after.trim_start_matches('\n').split_inclusive('\n').collect();
    let n_rows = rest.iter().take_while(|line| line.starts_with('|')).count();
    std::fs::write(file, [before, &marker, "\n", table, &rest[n_rows..].concat()].concat())?;
    Ok(())
}

/// Column of the forces of a configuration.
fn column(configuration: Configuration) -> String {
    format!("fe_{}_N", configuration.folder())
}

fn table(file: &Path, record: &Value) -> Anything<String> {
    let rows: Vec<Row> = csv::Reader::from_path(file)?.deserialize().collect::<Result<_, _>>()?;
    let steps: Vec<StepName> = StepName::DEFAULT
        .into_iter()
        .filter(|step| rows.iter().any(|row| row["step"] == step.name()))
        .collect();
    let mut computed = Configuration::ALL.to_vec();
    computed.retain(|c| rows.iter().any(|row| !row[&column(*c)].is_empty()));
    let mut lines = vec![vec!["muscle, N".to_string()]];
    for step in &steps {
        lines[0].push(format!("{}: rigid", step.name().replace('_', " ")));
        lines[0].extend(computed.iter().map(|c| format!("FE {}", c.name())));
    }
    lines
        .push(lines[0].iter().enumerate().map(|(i, _)| if i == 0 { "---" } else { "---:" }.into()).collect());
    for row in rows.iter().filter(|row| row["step"] == steps[0].name()) {
        let mut line = vec![row["muscle"].replace('_', " ")];
        for step in &steps {
            let at = rows.iter().find(|r| r["step"] == step.name() && r["muscle"] == row["muscle"]);
            let at = at.ok_or_else(|| format!("{} is missing at {}", row["muscle"], step.name()))?;
            let columns = ["rigid_N".to_string()].into_iter().chain(computed.iter().copied().map(column));
            line.extend(columns.map(|column| number(at[&column].parse().ok())));
        }
        lines.push(line);
    }
    let verdict = |step: &StepName, c: Configuration, key: &str| {
        let of = record["verdict"].as_array().into_iter().flatten();
        of.clone().find(|d| d["step"] == step.name() && d["configuration"] == c.name())?[key].as_f64()
    };
    let summary = |title: &str, of: &dyn Fn(&StepName, Configuration) -> String| {
        let mut line = vec![title.to_string()];
        for step in &steps {
            line.push(String::new());
            line.extend(computed.iter().map(|c| of(step, *c)));
        }
        line
    };
    let mean = |step: &StepName, c| {
        format!("{} [{}]", number(verdict(step, c, "mean_N")), number(verdict(step, c, "largest_N")))
    };
    lines.push(summary("mean difference of muscles that pull [largest of all]", &mean));
    let theirs = |step: &StepName, c| {
        published(*step, c).map_or("–".into(), |[mean, largest]| format!("{mean:.1} [{largest:.1}]"))
    };
    lines.push(summary("published, another subject", &theirs));
    let shared = |step: &StepName, c| {
        verdict(step, c, "shared_volume_cm3").map_or("–".into(), |v| format!("{v:.0}"))
    };
    lines.push(summary("volume that muscles share, cm³", &shared));
    let line = |cells: &Vec<String>| match cells[0].as_str() {
        "---" => format!("|{}|\n", cells.join("|")),
        _ => format!("| {} |\n", cells.join(" | ")).replace("|  |", "| |"),
    };
    Ok(lines.iter().map(line).collect())
}

/// One digit after the point, as the table of the command has it.
fn number(value: Option<f64>) -> String {
    value.map_or("–".into(), |v| coupling::number::plain(v, 1))
}
