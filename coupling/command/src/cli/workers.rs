//! Worker processes of a study: each carries out one run at a time with one thread, and is told the next when it is done. A worker that dies takes
//! one run with it, which another repeats; a run that ends two workers is left.

use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Stdio};
use std::sync::Mutex;

use crate::error::CommandError;
use crate::program;
use coupling::study::Study;

/// What a worker is given to know.
pub(super) struct Given<'a> {
    /// The study file.
    pub file: &'a Path,
    /// The study.
    pub study: &'a Study,
    /// Its key.
    pub key: &'a str,
    /// Folder of the study.
    pub out: &'a Path,
    /// Folder of recordings.
    pub data: Option<&'a Path>,
}

struct Worker {
    child: Child,
    tell: ChildStdin,
    hear: BufReader<ChildStdout>,
}

impl Worker {
    fn start(given: &Given) -> io::Result<Worker> {
        let mut command = program::command()?;
        command.args(["--quiet", "--threads", "1", "study"]).arg(given.file).arg("--out").arg(given.out);
        if let Some(data) = given.data {
            command.arg("--data").arg(data);
        }
        command.arg("--worker").arg(given.key);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let (tell, hear) = (child.stdin.take().expect("piped"), child.stdout.take().expect("piped"));
        Ok(Worker { child, tell, hear: BufReader::new(hear) })
    }

    /// Has a run carried out; `false`: the process has ended.
    fn carry_out(&mut self, run: usize) -> bool {
        let told = writeln!(self.tell, "{run}").and_then(|()| self.tell.flush());
        let mut said = String::new();
        told.is_ok() && self.hear.read_line(&mut said).is_ok_and(|n| n > 0) && said.trim() == run.to_string()
    }

    /// How a process ended that has.
    fn end(mut self) -> io::Result<std::process::ExitStatus> {
        drop(self.tell);
        self.child.wait()
    }
}

/// Carries out `runs` with so many processes; `done` hears of each.
pub(super) fn carry_out(
    given: &Given,
    runs: &[usize],
    processes: usize,
    done: &(dyn Fn(usize) + Sync),
) -> Result<(), CommandError> {
    let waiting: Mutex<VecDeque<usize>> = Mutex::new(runs.iter().copied().collect());
    let next = || waiting.lock().expect("no thread panics").pop_front();
    let work = || -> Result<(), CommandError> {
        let failed = |e: io::Error| CommandError::Option(format!("a worker of the study: {e}"));
        let mut worker: Option<Worker> = None;
        while let Some(run) = next() {
            for attempt in 1.. {
                let mut busy = match worker.take() {
                    Some(worker) => worker,
                    None => Worker::start(given).map_err(failed)?,
                };
                if busy.carry_out(run) {
                    worker = Some(busy);
                    break;
                }
                let ended = busy.end().map_err(failed)?;
                if ended.code().is_some_and(|code| code == 2) {
                    // It has said why on standard error, and no other would fare better: the disk, or the study file.
                    waiting.lock().expect("no thread panics").clear();
                    return Err(CommandError::Option(format!("run {run} cannot be carried out")));
                }
                if attempt == 2 {
                    let reason = format!(
                        "two workers ended on it, the last with {ended}; systems that run out of memory end processes"
                    );
                    given.study.note_killed(given.key, run, given.out, reason).map_err(failed)?;
                    break;
                }
            }
            done(run);
        }
        worker.map_or(Ok(()), |worker| worker.end().map(|_| ()).map_err(failed))
    };
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..processes.min(runs.len())).map(|_| scope.spawn(work)).collect();
        threads.into_iter().try_for_each(|thread| thread.join().expect("no thread panics"))
    })
}

/// The other side: carries out the runs that standard input names, a line each, and says each on standard output. Ends at once when nobody is left to
/// tell it what to do.
pub(super) fn work(study: &Study, key: &str, out: &Path) -> Result<(), CommandError> {
    let (tell, hear) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        for line in io::stdin().lock().lines().map_while(Result::ok) {
            if let Ok(run) = line.trim().parse::<usize>() {
                let _ = tell.send(run);
            }
        }
        std::process::exit(0);
    });
    let mut said = io::stdout();
    for run in hear {
        study
            .carry_out(key, run, out)
            .map_err(|e| CommandError::Option(format!("run {run} in {}: {e}", out.display())))?;
        let _ = writeln!(said, "{run}").and_then(|()| said.flush());
    }
    Ok(())
}
