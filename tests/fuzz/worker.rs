//! A process that runs one command line after the other: faster than a process each, and what kills it or keeps it is seen.

use super::kinds::Run;
use std::ffi::OsString;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

/// Makes this program a worker.
pub const FLAG: &str = "--worker";
/// Starts the line that ends a run on standard output.
const END: &str = "\u{1}END ";
/// Longest run that is no hang. Machines that do other things, too, are slow.
const HANG: Duration = Duration::from_secs(120);
/// Address space of a worker \[KiB\]: a count in a header must not become memory.
const MEMORY: u64 = 6 << 20;

/// How a run ended.
pub enum Ended {
    /// With an exit code.
    Code(u8),
    /// In a panic.
    Panic,
    /// The whole process is gone.
    Died,
    /// Not at all.
    Hang,
}

/// A worker in a folder.
pub struct Worker {
    folder: PathBuf,
    stderr: File,
    process: Option<Process>,
}

struct Process {
    child: Child,
    commands: ChildStdin,
    lines: Receiver<String>,
}

/// Runs command lines, each a line of JSON on standard input, until it ends.
pub fn serve() {
    for line in std::io::stdin().lock().lines() {
        let Ok(words) = serde_json::from_str::<Vec<String>>(&line.expect("text")) else { return };
        let how = match catch_unwind(|| command(words)) {
            Ok(code) => code.to_string(),
            Err(_) => "panic".to_string(),
        };
        let mut out = std::io::stdout().lock();
        let _ = write!(out, "\n{END}{how}\n");
        let _ = out.flush();
    }
}

/// A command line, or `read-mesh FILE` and `read-surface FILE`: readers without the work that commands do then.
fn command(words: Vec<String>) -> u8 {
    let (file, unit) = (Path::new(words.get(1).map_or("", String::as_str)), fem::mesh::LengthUnit::Metre);
    let refused = match words[0].as_str() {
        "read-mesh" => {
            let read = fem::mesh::Mesh::read(file, unit).map(|mesh| mesh.check());
            // What is wrong with a mesh that was read is said without its file.
            let of_mesh = |e: fem::mesh::MeshError| format!("{}: {e}", file.display());
            read.map_or_else(|e| Some(e.to_string()), |checked| checked.err().map(of_mesh))
        }
        "read-surface" => fem::geometry::Surface::read_checked(file, unit).err().map(|e| e.to_string()),
        _ => {
            let name = OsString::from("sartorius");
            return command::cli::run(std::iter::once(name).chain(words.into_iter().map(OsString::from)));
        }
    };
    refused.map_or(0, |error| {
        eprintln!("error: {error}");
        2
    })
}

impl Worker {
    /// A worker that finds its files in `folder`.
    pub fn new(folder: &Path) -> Worker {
        let errors = folder.join(".stderr");
        let stderr = File::options().create(true).append(true).read(true).open(errors).expect("a file");
        Worker { folder: folder.to_path_buf(), stderr, process: None }
    }

    fn start(&mut self) -> Process {
        let program = std::env::current_exe().expect("this program");
        let mut command = if cfg!(unix) {
            let mut shell = Command::new("sh");
            shell.arg("-c").arg(format!("ulimit -v {MEMORY}; exec \"$0\" {FLAG}")).arg(program);
            shell
        } else {
            let mut command = Command::new(program);
            command.arg(FLAG);
            command
        };
        let mut child = command
            .current_dir(&self.folder)
            .env("RAYON_NUM_THREADS", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(self.stderr.try_clone().expect("a handle"))
            .spawn()
            .expect("the worker starts");
        let (send, lines) = channel();
        let out = BufReader::new(child.stdout.take().expect("piped"));
        std::thread::spawn(move || {
            for line in out.split(b'\n').map_while(Result::ok) {
                if send.send(String::from_utf8_lossy(&line).into_owned()).is_err() {
                    return;
                }
            }
        });
        let commands = child.stdin.take().expect("piped");
        Process { child, commands, lines }
    }

    /// Runs a command line to its end.
    pub fn run(&mut self, words: &[String]) -> Run {
        self.stderr.set_len(0).expect("a file of ours");
        let mut process = self.process.take().unwrap_or_else(|| self.start());
        let line = serde_json::to_string(words).expect("plain words");
        let sent = writeln!(process.commands, "{line}").and_then(|()| process.commands.flush());
        let mut stdout = String::new();
        let how = loop {
            let Ok(()) = sent else { break Ended::Died };
            match process.lines.recv_timeout(HANG) {
                Ok(line) => match line.strip_prefix(END) {
                    Some("panic") => break Ended::Panic,
                    Some(code) => break Ended::Code(code.parse().expect("a number")),
                    None => stdout += &(line + "\n"),
                },
                Err(RecvTimeoutError::Timeout) => break Ended::Hang,
                Err(RecvTimeoutError::Disconnected) => break Ended::Died,
            }
        };
        match how {
            Ended::Died | Ended::Hang => {
                let _ = process.child.kill();
                let _ = process.child.wait();
            }
            _ => self.process = Some(process),
        }
        let mut bytes = Vec::new();
        let mut errors = File::open(self.folder.join(".stderr")).expect("a file of ours");
        errors.read_to_end(&mut bytes).expect("readable");
        Run { how, stdout, stderr: String::from_utf8_lossy(&bytes).into_owned() }
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        if let Some(mut process) = self.process.take() {
            drop(process.commands); // its input ends, and so does it
            let _ = process.child.wait();
        }
    }
}
