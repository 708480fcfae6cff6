//! Whose an output folder is, and that one run at a time writes to it.
//!
//! The hidden file `.sartorius` marks a folder as one of ours. It says which run fills it and which files that run wrote, and it is
//! locked while the run goes on; the system takes the lock back when the process ends, however it ends.
//!
//! A folder that is new or empty is free; names that begin with a dot do not count. A run of the same command on a scene of the same
//! name replaces its earlier one; another run of ours is replaced where that is asked for, anything else never.

use std::ffi::OsStr;
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex};

use coupling::comparison::ONE_WAY_FOLDER;
use coupling::configuration::Configuration;
use coupling::knee::frames;

use super::OutputError;

/// Name of the file that is written last: a folder that holds it is complete.
pub const RUN_FILE: &str = "run.json";
/// Folders of the right and of the left leg, where a trial describes both.
pub const LEG_FOLDERS: [&str; 2] = ["right", "left"];
/// Folder of the frames of bodies of one's own, and the name of its files.
pub const OWN_FRAMES: [&str; 2] = ["frames", "scene"];
/// The same of a knee that was bent, and of its femur.
pub const KNEE_FRAMES: [[&str; 2]; 2] = [[OWN_FRAMES[0], frames::FRAMES], [OWN_FRAMES[0], frames::FEMUR]];
/// Name of the files in the other folders of frames.
const FRAMES: &str = "thigh";
/// Marks a folder as ours.
const MARKER: &str = ".sartorius";
const TITLE: &str = "output folder of sartorius; locked while a run writes to it";
/// Markers and `run.json` are never larger \[bytes\].
const LARGEST: u64 = 1 << 24;

/// Which run fills a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// The command, e.g. `compare`.
    pub command: String,
    /// Name of its scene or trial.
    pub name: String,
}

impl Identity {
    /// A run of `command` on the scene or trial `name`.
    pub fn new(command: &str, name: &str) -> Identity {
        // The marker has one line for each.
        Identity { command: command.into(), name: name.escape_debug().to_string() }
    }
}

/// An output folder that no other run writes to as long as this lives. Until `begin` nothing in it has changed, and a claim
/// that is dropped before leaves all as it was.
#[derive(Clone, Debug)]
pub struct Claim(Arc<Mutex<Held>>);

#[derive(Debug)]
struct Held {
    path: PathBuf,
    identity: Identity,
    /// Locked.
    marker: File,
    /// Folders that were made for it, the outermost first.
    made: Vec<PathBuf>,
    /// Length of the marker before; `None`: there was none.
    before: Option<u64>,
    /// Files of the earlier run.
    earlier: Vec<String>,
    begun: bool,
}

impl Claim {
    /// Reserves the folder for a run; `force`: where it holds another run of ours, too.
    pub fn new(path: &Path, identity: Identity, force: bool) -> Result<Claim, OutputError> {
        let missing: Vec<PathBuf> = path
            .ancestors()
            .take_while(|p| !p.as_os_str().is_empty() && !p.exists())
            .map(Path::to_path_buf)
            .collect();
        if missing.is_empty() && !path.join(MARKER).exists() && !path.join(RUN_FILE).exists() {
            only_hidden(path)?;
        }
        let made: Vec<PathBuf> = missing.into_iter().rev().collect();
        let created = fs::create_dir_all(path).map_err(|e| OutputError::at("create the folder", path, e));
        let (mut marker, before) =
            created.and_then(|()| locked(path)).inspect_err(|_| remove_folders(&made))?;
        let mut text = String::new();
        let _ = (&mut marker).take(LARGEST).read_to_string(&mut text); // damaged: of nobody known
        let (path, earlier, begun) = (path.to_path_buf(), Vec::new(), false);
        let held = Held { path, identity, marker, made, before, earlier, begun };
        let claim = Claim(Arc::new(Mutex::new(held)));
        claim.with(|held| held.take_over(&text, force))?; // what was made goes with the claim
        Ok(claim)
    }

    /// Where the files go.
    pub fn path(&self) -> PathBuf {
        self.with(|held| held.path.clone())
    }

    /// Takes back what an earlier run says and removes its files. `resume`: but for what a run goes on from.
    pub(super) fn begin(&self, resume: bool) -> Result<(), OutputError> {
        self.with(|held| held.begin(resume))
    }

    /// Notes that the run is about to write a file.
    pub(super) fn note(&self, file: &str) -> io::Result<()> {
        self.with(|held| writeln!(held.marker, "file {file}"))
    }

    /// Says what a run leaves that is stopped at this moment, and removes what it made for nothing; `None` where it is over.
    pub fn stopper(&self) -> impl Fn() -> Option<String> + Send + 'static {
        let held = Arc::downgrade(&self.0);
        move || held.upgrade().map(|held| Claim(held).with(Held::stop))
    }

    fn with<T>(&self, f: impl FnOnce(&mut Held) -> T) -> T {
        f(&mut self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner()))
    }
}

impl Held {
    /// Finds out whose the folder is, and says in the marker who writes now.
    fn take_over(&mut self, text: &str, force: bool) -> Result<(), OutputError> {
        let record = read_record(&self.path);
        let known = |key: &str| text.lines().find_map(|line| line.strip_prefix(key)).map(str::to_string);
        if let Err(foreign) = only_hidden(&self.path) {
            if self.before.is_none() && record.is_none() {
                return Err(foreign);
            }
            let of_record = record.as_ref().and_then(|r| Some(r["command"].as_str()?.to_string()));
            let found = (known("command ").or(of_record), known("name "));
            let same = (Some(&self.identity.command), Some(&self.identity.name));
            if (found.0.as_ref(), found.1.as_ref()) != same && !force {
                let words = [found.0.unwrap_or("?".into()), found.1.unwrap_or_default()].join(" ");
                return Err(OutputError::OtherRun {
                    path: self.path.clone(),
                    found: words.trim_end().to_string(),
                    wanted: format!("{} {}", self.identity.command, self.identity.name),
                });
            }
        }
        let listed = record.iter().filter_map(|r| r["files"].as_array()).flatten();
        let listed = listed.filter_map(|file| file.as_str().map(str::to_string));
        let noted = text.lines().filter_map(|line| line.strip_prefix("file ").map(str::to_string));
        self.earlier = listed.chain(noted).filter(|file| is_plain(file)).collect();
        let header = if self.before.is_none() { self.header() } else { format!("process {}\n", process()) };
        let written =
            self.marker.seek(io::SeekFrom::End(0)).and_then(|_| self.marker.write_all(header.as_bytes()));
        written.map_err(|e| OutputError::at("write", &self.path.join(MARKER), e))
    }

    fn header(&self) -> String {
        let Identity { command, name } = &self.identity;
        format!("{TITLE}\ncommand {command}\nname {name}\nprocess {}\n", process())
    }

    fn begin(&mut self, resume: bool) -> Result<(), OutputError> {
        let path = &self.path;
        remove(&path.join(RUN_FILE))?;
        if !resume {
            self.earlier.iter().try_for_each(|file| remove(&path.join(file)))?;
            let of_thighs = Configuration::ALL
                .map(Configuration::folder)
                .into_iter()
                .chain([ONE_WAY_FOLDER])
                .map(|folder| [folder, FRAMES]);
            for [folder, name] in of_thighs.chain([OWN_FRAMES]).chain(KNEE_FRAMES) {
                let folder = path.join(folder);
                fem::output::remove_run(&folder, name)
                    .map_err(|e| OutputError::at("remove the old frames in", &folder, io::Error::other(e)))?;
            }
        }
        if self.before.is_some() {
            let legs = LEG_FOLDERS.map(|leg| path.join(leg));
            for folder in std::iter::once(path).chain(legs.iter().filter(|leg| leg.is_dir())) {
                remove_partial(folder)?;
            }
        }
        for leg in LEG_FOLDERS {
            if self.earlier.iter().any(|file| Path::new(file).starts_with(leg)) {
                let _ = fs::remove_dir(path.join(leg)); // what is not empty stays
            }
        }
        let text = self.header();
        let mut write = || -> io::Result<()> {
            // Written over and then cut, so that a folder is ours at any moment.
            self.marker.rewind()?;
            self.marker.write_all(text.as_bytes())?;
            self.marker.set_len(text.len() as u64)
        };
        write().map_err(|e| OutputError::at("write", &path.join(MARKER), e))?;
        self.begun = true;
        Ok(())
    }

    fn stop(&mut self) -> String {
        let folder = self.path.display();
        if !self.begun {
            self.undo();
            return "stopped: nothing was written".into();
        }
        if self.path.join(RUN_FILE).exists() {
            return format!("stopped after the end of the run: {folder} is complete");
        }
        let kept: Vec<String> = Configuration::ALL
            .map(Configuration::folder)
            .iter()
            .map(|run| (states(&self.path.join(run)), run))
            .filter(|(n, _)| *n > 0)
            .map(|(n, run)| format!("{n} of {run}"))
            .collect();
        if kept.is_empty() {
            return format!(
                "stopped: {folder} is not complete (no {RUN_FILE}) and holds no solved frame; run again"
            );
        }
        format!(
            "stopped: {folder} is not complete (no {RUN_FILE}); kept are the solved frames, {}: the same command with --resume goes on from them",
            kept.join(" and ")
        )
    }

    /// Leaves all as it was before the claim.
    fn undo(&mut self) {
        let marker = self.path.join(MARKER);
        let _ = match self.before {
            Some(length) => self.marker.set_len(length),
            None => fs::remove_file(marker),
        };
        remove_folders(&std::mem::take(&mut self.made));
        self.begun = true; // nothing more to undo
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        if !self.begun {
            self.undo();
        }
        // A process that another thread is just starting holds the file open, too, until it becomes its program.
        let _ = self.marker.unlock();
    }
}

/// The marker of a folder, locked, and its length where it is not new.
fn locked(path: &Path) -> Result<(File, Option<u64>), OutputError> {
    let file = path.join(MARKER);
    let at = |e| OutputError::at("write", &file, e);
    loop {
        let is_new = !file.exists();
        let mut marker =
            File::options().read(true).write(true).create(true).truncate(false).open(&file).map_err(at)?;
        match marker.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut text = String::new();
                let _ = (&mut marker).take(LARGEST).read_to_string(&mut text);
                let holder = text.lines().rev().find_map(|line| line.strip_prefix("process "));
                return Err(OutputError::Busy {
                    path: path.to_path_buf(),
                    holder: holder.map_or(String::new(), |h| format!(" (process {h})")),
                });
            }
            Err(TryLockError::Error(e)) => coupling::say!(
                "note: {}: this file system has no locks ({e}); start no second run with this folder",
                path.display()
            ),
        }
        // A run that gave the folder up may have removed the file between the two.
        if is_same_file(&marker, &file) {
            let length = marker.metadata().map_err(at)?.len();
            return Ok((marker, (!is_new).then_some(length)));
        }
    }
}

#[cfg(unix)]
fn is_same_file(open: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let id = |m: &fs::Metadata| (m.dev(), m.ino());
    matches!((open.metadata(), fs::metadata(path)), (Ok(a), Ok(b)) if id(&a) == id(&b))
}

/// Elsewhere an open file is not removed.
#[cfg(not(unix))]
fn is_same_file(_: &File, path: &Path) -> bool {
    path.exists()
}

/// Refuses a folder with anything in it whose name does not begin with a dot.
fn only_hidden(path: &Path) -> Result<(), OutputError> {
    for entry in fs::read_dir(path).map_err(|e| OutputError::at("list the folder", path, e))? {
        let name = entry.map_err(|e| OutputError::at("list the folder", path, e))?.file_name();
        let name = name.to_string_lossy();
        if !name.starts_with('.') {
            return Err(OutputError::Foreign { path: path.to_path_buf(), entry: name.into_owned() });
        }
    }
    Ok(())
}

/// The `run.json` of a run of ours.
fn read_record(path: &Path) -> Option<serde_json::Value> {
    let mut text = String::new();
    File::open(path.join(RUN_FILE)).ok()?.take(LARGEST).read_to_string(&mut text).ok()?;
    let record: serde_json::Value = serde_json::from_str(&text).ok()?;
    let ours = record["versions"]["sartorius"].is_string() || record["program"]["name"] == "sartorius";
    (ours && record["command"].is_string()).then_some(record)
}

/// Whether this names a file in the folder itself, or in that of a leg.
fn is_plain(name: &str) -> bool {
    let mut parts = Path::new(name).components();
    let is_leg = |folder: &OsStr| LEG_FOLDERS.iter().any(|leg| *leg == folder);
    match (parts.next(), parts.next(), parts.next()) {
        (Some(Component::Normal(_)), None, None) => true,
        (Some(Component::Normal(folder)), Some(Component::Normal(_)), None) => is_leg(folder),
        _ => false,
    }
}

/// States that a run can go on from.
fn states(folder: &Path) -> usize {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter(|entry| entry.path().extension().is_some_and(|e| e == "state")).count()
}

/// Number of this process, and the machine where its name is told.
fn process() -> String {
    let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    match host.trim() {
        "" => std::process::id().to_string(),
        host => format!("{} on {host}", std::process::id()),
    }
}

/// Removes folders that were made for nothing, the innermost first; one that is not empty stays.
fn remove_folders(made: &[PathBuf]) {
    for folder in made.iter().rev() {
        let _ = fs::remove_dir(folder);
    }
}

/// Removes what a run left behind that was killed.
fn remove_partial(folder: &Path) -> Result<(), OutputError> {
    let at = |e| OutputError::at("list the folder", folder, e);
    for entry in fs::read_dir(folder).map_err(at)? {
        let name = entry.map_err(at)?.file_name();
        let name = name.to_string_lossy();
        if name.starts_with('.') && name.ends_with(".partial") {
            remove(&folder.join(&*name))?;
        }
    }
    Ok(())
}

/// Makes sure that a file is not there.
pub(super) fn remove(path: &Path) -> Result<(), OutputError> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(OutputError::at("remove the old", path, e)),
        _ => Ok(()),
    }
}
