//! Damaged input files of every kind, given to the command line: exit codes 0, 2, 3 only, every message names the file and a remedy,
//! no panic, no hang, nothing written elsewhere.
//!
//! `cargo test --release -p sartorius-tests --test fuzz` runs some of each kind,
//! `cargo test --release -p sartorius-tests --test fuzz -- --runs 20000 --seed 1 [KIND...]` as many as asked for.
//! `--keep DIR` keeps the files that something was found with. What was damaged is made here or cut from `../shared` and `gait-data`.

mod kinds;
mod mutate;
mod worker;

use kinds::{Kind, Run};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use support::Random;
use worker::{Ended, Worker};

/// Runs of each kind where none are asked for.
const FEW: usize = 150;

struct Arguments {
    runs: usize,
    seed: u64,
    keep: Option<PathBuf>,
    kinds: Vec<String>,
}

fn main() -> ExitCode {
    let all: Vec<String> = std::env::args().skip(1).collect();
    if all.first().is_some_and(|a| a == worker::FLAG) {
        worker::serve();
        return ExitCode::SUCCESS;
    }
    let mut arguments = Arguments { runs: FEW, seed: 1, keep: None, kinds: Vec::new() };
    let mut rest = all.iter();
    while let Some(word) = rest.next() {
        let mut value = || rest.next().cloned().unwrap_or_default();
        match word.as_str() {
            "--runs" => arguments.runs = value().parse().expect("--runs takes a number"),
            "--seed" => arguments.seed = value().parse().expect("--seed takes a number"),
            "--keep" => arguments.keep = Some(value().into()),
            name if !name.starts_with('-') => arguments.kinds.push(name.to_string()),
            _ => {} // what libtest takes
        }
    }
    let mut found = 0;
    println!(
        "{:<14}{:>8}{:>9}{:>9}{:>9}{:>9}{:>10}",
        "kind", "files", "code 0", "code 2", "code 3", "findings", "seconds"
    );
    for kind in kinds::all() {
        if arguments.kinds.is_empty() || arguments.kinds.iter().any(|k| k == kind.name) {
            found += fuzz(&kind, &arguments);
        }
    }
    if found == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs one kind; returns the number of different findings.
fn fuzz(kind: &Kind, arguments: &Arguments) -> usize {
    let started = std::time::Instant::now();
    // Two levels down, so that what is written beside the folder is seen.
    // In memory where the system has such a folder: a disk is ten times slower.
    let memory = Path::new("/dev/shm");
    let place = if memory.is_dir() { memory.to_path_buf() } else { std::env::temp_dir() };
    let outside = tempfile::tempdir_in(place).expect("a temporary folder");
    let folder = outside.path().join("here");
    std::fs::create_dir(&folder).expect("a folder");
    let bases = (kind.bases)(&folder);
    if bases.is_empty() {
        println!("{:<14} skipped: nothing to damage without ../shared", kind.name);
        return 0;
    }
    let mut worker = Worker::new(&folder);
    let mut codes = BTreeMap::<u8, usize>::new();
    let mut findings = BTreeMap::<String, (usize, String)>::new();
    for run in 0..arguments.runs {
        let mut random = Random::new(arguments.seed.wrapping_mul(1_000_003).wrapping_add(run as u64));
        let base = &bases[random.below(bases.len())];
        let bytes = match run < bases.len() {
            true => bases[run].bytes.clone(), // each once as it is
            false => mutate::damaged(&base.bytes, base.text, &mut random),
        };
        let base = if run < bases.len() { &bases[run] } else { base };
        let file = folder.join(&base.file);
        std::fs::write(&file, &bytes).expect("written");
        let mut refused = false;
        for command in &base.commands {
            let wanted = run < bases.len() || random.chance(command.fraction);
            if !wanted || command.if_refused && !refused {
                continue;
            }
            let ended = worker.run(&command.words);
            refused = matches!(ended.how, Ended::Code(2));
            if let Ended::Code(code) = ended.how {
                *codes.entry(code).or_default() += 1;
            }
            let mut found = objections(&ended, command, base, run < bases.len());
            let stray = std::fs::read_dir(outside.path()).expect("readable").count() > 1;
            found.extend(stray.then(|| "something was written beside the folder".to_string()));
            for finding in found {
                let name = format!("{}-{}-{run}", kind.name, arguments.seed);
                let entry = findings.entry(shape(&finding)).or_insert_with(|| {
                    keep(arguments.keep.as_deref(), &name, &base.file, &bytes);
                    (0, format!("{name}: `{}`: {finding}", command.words.join(" ")))
                });
                entry.0 += 1;
            }
        }
        // Restored, as files beside it refer to it.
        std::fs::write(&file, &base.bytes).expect("written");
    }
    let code = |c: u8| codes.get(&c).copied().unwrap_or(0);
    println!(
        "{:<14}{:>8}{:>9}{:>9}{:>9}{:>9}{:>10.1}",
        kind.name,
        arguments.runs,
        code(0),
        code(2),
        code(3),
        findings.len(),
        started.elapsed().as_secs_f64()
    );
    for (count, first) in findings.values() {
        println!("  {count} x {first}");
    }
    findings.len()
}

/// What is wrong with how a run ended.
fn objections(ended: &Run, command: &kinds::Command, base: &kinds::Base, untouched: bool) -> Vec<String> {
    let mut found = Vec::new();
    let last = |text: &str| text.lines().rfind(|l| !l.trim().is_empty()).unwrap_or("").to_string();
    match ended.how {
        Ended::Panic => {
            let line = ended.stderr.lines().find(|l| l.contains("panicked at"));
            return vec![format!("panics: {}", line.unwrap_or("?"))];
        }
        Ended::Died => return vec![format!("the program dies: {}", last(&ended.stderr))],
        Ended::Hang => return vec!["hangs".to_string()],
        Ended::Code(0) => {
            let bad = |word: &&str| matches!(*word, "NaN" | "inf" | "-inf" | "nan");
            let words = |text: &str| {
                let separators = |c: char| c.is_whitespace() || ",;:()[]".contains(c);
                text.split(separators).map(str::to_string).collect::<Vec<_>>()
            };
            if let Some(word) = words(&ended.stdout).iter().map(String::as_str).find(bad) {
                let line = ended.stdout.lines().find(|l| l.contains(word)).unwrap_or("");
                found.push(format!("good, but says {word}: {}", line.chars().take(300).collect::<String>()));
            }
        }
        Ended::Code(2) => {
            let text = &ended.stderr;
            let stem = Path::new(&base.file).file_name().expect("a file").to_string_lossy();
            if !text.contains(&*stem) && !command.names.iter().any(|name| text.contains(name)) {
                found.push(format!("names no file: {}", last(text)));
            }
            let lower = text.to_lowercase();
            if !REMEDIES.iter().any(|word| lower.contains(word)) {
                found.push(format!("names no remedy: {}", last(text)));
            }
        }
        Ended::Code(3) => {
            if ended.stderr.trim().is_empty() && ended.stdout.trim().is_empty() {
                found.push("ends with 3 and says nothing".to_string());
            }
        }
        Ended::Code(code) => found.push(format!("ends with {code}: {}", last(&ended.stderr))),
    }
    if untouched && !matches!(ended.how, Ended::Code(0)) {
        found.push(format!("the undamaged file is refused: {}", last(&ended.stderr)));
    }
    found
}

/// By what a message says what to do, or what would have been right: a clause after the diagnosis, a question, a rule.
const REMEDIES: [&str; 7] = ["; ", "?", "must ", "needs ", "needed", "it has", "known "];

/// The message without what differs from file to file, to count the same once.
fn shape(text: &str) -> String {
    let letters: String = text.chars().map(|c| if c.is_ascii_digit() { '0' } else { c }).collect();
    let mut out = String::new();
    let mut quoted = false;
    for c in letters.chars() {
        if c == '`' {
            quoted = !quoted;
        } else if !(quoted || c == '0' && out.ends_with('0')) {
            out.push(c);
        }
    }
    out.chars().take(160).collect()
}

fn keep(folder: Option<&Path>, name: &str, file: &str, bytes: &[u8]) {
    let Some(folder) = folder else { return };
    let file = Path::new(file).file_name().expect("a file").to_string_lossy();
    let written = std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(folder.join(format!("{name}-{file}")), bytes));
    if let Err(error) = written {
        eprintln!("cannot keep {name}: {error}");
    }
}
