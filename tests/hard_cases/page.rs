//! The page of the hard cases: a row per case as it ended last, with the day and the commit.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What stands above the table.
const HEAD: &str = "# Hard cases

What must stay stable, and how it ended last: `cargo test --release -p sartorius-tests --test hard_cases -- --full --page [ID...]` enters what it ran.
*known*: fails for a reason that is known; everything else that does not pass is a surprise, and the command ends with 1.
Seconds are of one run, on whatever ran beside it.

| id | case | verdict | s | what decided it | run |
|---|---|---|---:|---|---|
";

/// A case as it ended.
pub struct Row {
    pub id: &'static str,
    pub title: &'static str,
    pub verdict: &'static str,
    pub seconds: f64,
    /// What decided it.
    pub text: String,
}

/// Today and the commit, as the system tells them.
fn run() -> String {
    let said = |program: &str, arguments: &[&str]| {
        let output = Command::new(program).args(arguments).output().ok()?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_string())
    };
    let date = said("date", &["-u", "+%Y-%m-%d"]).unwrap_or_default();
    let commit = said("git", &["describe", "--always", "--dirty"]).unwrap_or_default();
    format!("{date}, {commit}")
}

fn file() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/hard-cases.md")
}

/// Without what would break a table.
fn plain(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}

/// Enters rows in the page; those of other cases stay, those that are none of `cases` (id, title) any more go.
pub fn enter(rows: Vec<Row>, cases: &[(&str, &str)]) {
    let is_case = |id: &str, title: &str| cases.iter().any(|c| c.0 == id && plain(c.1) == title);
    let before = std::fs::read_to_string(file()).unwrap_or_default();
    let mut all = BTreeMap::new();
    for line in before.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| id |")) {
        let mut cells =
            line.trim_start_matches("| ").trim_end_matches(" |").splitn(3, " | ").map(String::from);
        if let (Some(id), Some(title), Some(rest)) = (cells.next(), cells.next(), cells.next())
            && is_case(&id, &title)
        {
            all.insert((id, title), rest);
        }
    }
    let run = run();
    for Row { id, title, verdict, seconds, text } in rows {
        all.insert((id.into(), plain(title)), format!("{verdict} | {seconds:.1} | {} | {run}", plain(&text)));
    }
    let lines = all.iter().map(|((id, title), cells)| format!("| {id} | {title} | {cells} |\n"));
    std::fs::write(file(), HEAD.to_string() + &lines.collect::<String>()).expect("docs/ can be written to");
}
