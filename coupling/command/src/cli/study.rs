//! `sartorius study STUDY`: many runs, each with a folder and a status of its own, and one table of all.

use std::io::{IsTerminal, Write};
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};

use super::{OutArguments, Outcome, workers};
use crate::error::CommandError;
use crate::output::OutputError;
use crate::output::atomic::OutputFolder;
use crate::output::claim::Claim;
use crate::output::origin::{Again, InputFile};
use crate::output::run::{RunRecord, RunStatus, peak_memory_mib};
use crate::output::study::{write_csv, write_indices, write_parquet, write_seconds};
use crate::report::study::{StudyReport, study_page};
use coupling::study::Study;
use coupling::study::rows::Rows;
use coupling::study::run::forget;

#[derive(Args)]
pub struct StudyArguments {
    /// Study file (TOML): subjects, settings, samples, and what varies.
    study: PathBuf,
    /// Folder of the recordings and surfaces that trials and scene name.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    #[command(flatten)]
    out: OutArguments,
    /// Go on with a study that was broken off: runs that are done are taken over.
    #[arg(long)]
    resume: bool,
    /// Worker processes, each with one thread [default: one per core].
    #[arg(long, value_name = "N")]
    workers: Option<NonZero<u16>>,
    /// Carry out one part of so many, without table and page: a task of a job array. The study with --resume makes them when all parts are done.
    #[arg(long, value_name = "K/N", value_parser = part)]
    part: Option<(usize, usize)>,
    /// Make table and page of what is done, without any run.
    #[arg(long, conflicts_with = "part")]
    collect: bool,
    /// Print the verdict as JSON.
    #[arg(long)]
    json: bool,
    /// Carry out the runs that standard input names, for a study with this key.
    #[arg(long, hide = true, value_name = "KEY")]
    worker: Option<String>,
}

/// `K/N`, counted from 1.
fn part(text: &str) -> Result<(usize, usize), String> {
    let parsed =
        text.split_once('/').and_then(|(k, n)| Some((k.trim().parse().ok()?, n.trim().parse().ok()?)));
    let part: Option<(usize, usize)> = parsed.filter(|(k, n)| (1..=*n).contains(k));
    part.ok_or_else(|| format!("`{text}` is no part, such as 1/8 to 8/8"))
}

/// Runs the command.
pub fn run(arguments: &StudyArguments, quiet: bool) -> Result<Outcome, CommandError> {
    let study = Study::read(&arguments.study, arguments.data.as_deref())?;
    if let (Some(key), Some(out)) = (&arguments.worker, &arguments.out.out) {
        return workers::work(&study, key, out).map(|()| Outcome::Solved);
    }
    let clock = Instant::now();
    let key = study.key();
    let of_part = |run: &usize| arguments.part.is_none_or(|(k, n)| run % n == k - 1);
    let taken_over = arguments.resume || arguments.collect || arguments.part.is_some();
    let claim = claim(arguments, &study)?;
    let out = OutputFolder::begin(claim, true)?;
    let folder = out.path().to_path_buf();
    if !taken_over {
        forget(&folder).map_err(|e| OutputError::at("remove the old runs in", &folder, e))?;
    }
    // Parts fill the folder side by side.
    let out = arguments.part.is_none().then_some(out);
    let missing: Vec<usize> = match arguments.collect {
        true => Vec::new(),
        false => {
            (0..study.n_runs()).filter(of_part).filter(|r| Study::done(&folder, &key, *r).is_none()).collect()
        }
    };
    let progress = Progress::new(missing.len(), quiet);
    let given = workers::Given {
        file: &arguments.study,
        study: &study,
        key: &key,
        out: &folder,
        data: arguments.data.as_deref(),
    };
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let processes = arguments.workers.map_or_else(cores, |n| n.get().into());
    workers::carry_out(&given, &missing, processes, &|_| progress.step())?;
    let carried_out = clock.elapsed();
    drop(progress);
    let Some(out) = out else {
        if !quiet {
            coupling::say!("{} runs of this part are done in {}", missing.len(), folder.display());
        }
        return Ok(Outcome::Solved);
    };
    let collected = collect(&study, &key, out, &arguments.study, carried_out)?;
    say(arguments.json, &study, &collected, &folder);
    Ok(collected.outcome())
}

/// Reserves the folder. Parts that begin at the same moment wait for each other.
fn claim(arguments: &StudyArguments, study: &Study) -> Result<Claim, CommandError> {
    const PATIENCE: Duration = Duration::from_secs(60);
    let clock = Instant::now();
    loop {
        match arguments.out.claim("study", &study.name) {
            Err(CommandError::Output(OutputError::Busy { .. }))
                if arguments.part.is_some() && clock.elapsed() < PATIENCE =>
            {
                std::thread::sleep(Duration::from_millis(50));
            }
            claimed => return claimed,
        }
    }
}

/// What a study came to.
pub struct Collected {
    /// Runs of the study, those that are done, and those that are solved.
    pub runs: [usize; 3],
    /// Why runs are not solved, and how many.
    pub failures: Vec<(String, usize)>,
    verdict: serde_json::Value,
}

impl Collected {
    fn outcome(&self) -> Outcome {
        if self.runs[2] == self.runs[0] { Outcome::Solved } else { Outcome::NotSolved }
    }
}

/// Writes tables and page of all runs that are done, and `run.json` last. `file`: the study file; `carried_out`: the wall time of the runs.
pub fn collect(
    study: &Study,
    key: &str,
    mut out: OutputFolder,
    file: &Path,
    carried_out: Duration,
) -> Result<Collected, CommandError> {
    let clock = Instant::now();
    let folder = out.path().to_path_buf();
    let rows = Rows::read(study, key, &folder);
    let indices = rows.indices(study);
    let report = StudyReport::new(study, &rows, &indices, &folder);
    out.write("table.csv", |w| write_csv(w, study, &rows))?;
    out.write("table.parquet", |w| write_parquet(w, study, &rows))?;
    if study.indices {
        out.write("indices.csv", |w| write_indices(w, study, &rows, &indices))?;
    }
    out.write("seconds.csv", |w| write_seconds(w, &rows))?;
    let page = study_page(&report);
    out.write("report.html", |w| w.write_all(page.as_bytes()))?;
    let failures: Vec<(String, usize)> = rows
        .failures()
        .into_iter()
        .map(|f| (format!("{}: {}", f.status.name(), f.reason), f.runs.len()))
        .collect();
    let (all, done, solved) = (study.n_runs(), rows.done().count(), rows.solved());
    let mut record = RunRecord::new("study");
    record.inputs.push(InputFile::of_text(&format!("{}.toml", study.name), &study.text));
    record.again = Again { arguments: vec!["study".into(), "study.toml".into()], ..Again::default() };
    record.again.files.insert("study.toml".into(), study.text.clone());
    if solved < all {
        record.status = RunStatus::NotConverged;
        record.reason = Some(format!("{solved} of {all} runs are solved, {done} are done; see table.csv"));
    }
    let verdict = serde_json::json!({
        "study": study.name, "runs": all, "done": done, "solved": solved, "key": key,
        "failures": failures.iter().map(|(why, n)| serde_json::json!({"reason": why, "runs": n})).collect::<Vec<_>>(),
    });
    record.verdict = Some(verdict.clone());
    record.settings = serde_json::json!({ "file": file.file_name().map(|f| f.to_string_lossy()) });
    record.stage("runs", carried_out);
    record.stage("table and page", clock.elapsed());
    record.peak_memory_mib = peak_memory_mib();
    record.files = out.files().to_vec();
    out.finish(&record)?;
    Ok(Collected { runs: [all, done, solved], failures, verdict })
}

fn say(json: bool, study: &Study, collected: &Collected, folder: &Path) {
    let mut out = std::io::stdout().lock();
    // A reader that closes the pipe early is no error.
    let _ = if json {
        writeln!(out, "{}", serde_json::to_string_pretty(&collected.verdict).expect("plain data"))
    } else {
        (|| {
            let [all, done, solved] = collected.runs;
            writeln!(out, "{}: {solved} of {all} runs solved, {done} done", study.name)?;
            for (why, n) in &collected.failures {
                writeln!(out, "  {n:>6}  {why}")?;
            }
            writeln!(out, "table.csv and table.parquet in {}, open report.html there", folder.display())
        })()
    };
}

/// How far the runs are: a bar on a terminal, a line per twentieth where that is piped.
struct Progress {
    bar: ProgressBar,
    lines: bool,
    all: usize,
    since: Instant,
    done: Mutex<usize>,
}

impl Progress {
    fn new(all: usize, quiet: bool) -> Progress {
        let terminal = std::io::stderr().is_terminal();
        let bar = if quiet || !terminal { ProgressBar::hidden() } else { ProgressBar::new(all as u64) };
        let style = ProgressStyle::with_template("{elapsed:>4} [{bar:24}] {pos} of {len} runs, {eta} left");
        bar.set_style(style.expect("a fixed template").progress_chars("=> "));
        bar.enable_steady_tick(Duration::from_millis(200));
        Progress { bar, lines: !quiet && !terminal, all, since: Instant::now(), done: Mutex::new(0) }
    }

    fn step(&self) {
        self.bar.inc(1);
        let mut done = self.done.lock().expect("no thread panics");
        *done += 1;
        if self.lines && (*done * 20 / self.all) > ((*done - 1) * 20 / self.all) {
            coupling::say!("{:>8} of {} runs{:>10.1} s", *done, self.all, self.since.elapsed().as_secs_f64());
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
