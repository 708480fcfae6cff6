//! A folder whose files appear complete or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::OutputError;
use super::claim::{Claim, Identity, RUN_FILE, remove};

/// An output folder that is being filled.
///
/// Every file is written under a temporary name (`.NAME.partial`) in the same folder and renamed when its last
/// byte is written. `run.json` comes last, when the others have reached the disk, and the one of an earlier run is removed first, so a run that is
/// killed at any moment leaves a folder without `run.json` and never half a table under its final name.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    files: Vec<String>,
    /// No other run writes here.
    claim: Claim,
}

impl OutputFolder {
    /// Begins to fill a folder: takes back the claim of the earlier run to be complete and removes its files. `resume`: but for what a
    /// run goes on from.
    pub fn begin(claim: Claim, resume: bool) -> Result<OutputFolder, OutputError> {
        claim.begin(resume)?;
        Ok(OutputFolder { path: claim.path(), files: Vec::new(), claim })
    }

    /// [`OutputFolder::begin`] of a folder that holds what it may: the run of `command` on the scene or trial `name`.
    pub fn open(path: &Path, command: &str, name: &str) -> Result<OutputFolder, OutputError> {
        OutputFolder::begin(Claim::new(path, Identity::new(command, name), false)?, false)
    }

    /// Where the files go.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Names of the files written so far, in order.
    pub fn files(&self) -> &[String] {
        &self.files
    }

    /// Writes one file through `fill`; the name may have a folder before it. When `fill` or the disk fails nothing appears under `name`.
    pub fn write(
        &mut self,
        name: &str,
        fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<(), OutputError> {
        let path = self.path.join(name);
        let last = path.file_name().unwrap_or_default().to_string_lossy();
        let temporary = path.with_file_name(format!(".{last}.partial"));
        let written = self
            .claim
            .note(name)
            .and_then(|()| self.make_folder_of(&path))
            .and_then(|()| write_file(&temporary, fill))
            .and_then(|()| fs::rename(&temporary, &path))
            .map_err(|e| OutputError::at("write", &path, e));
        if written.is_err() {
            let _ = fs::remove_file(&temporary); // the first error is the one to report
        } else {
            self.files.push(name.to_string());
        }
        written
    }

    /// Makes the folder before the name of a file, where it has one.
    fn make_folder_of(&self, path: &Path) -> io::Result<()> {
        match path.parent() {
            Some(folder) if folder != self.path => fs::create_dir_all(folder),
            _ => Ok(()),
        }
    }

    /// Lets `write` make the file `name`, which it must do under another name first, so that nothing half appears.
    pub fn place<E: From<OutputError>>(
        &mut self,
        name: &str,
        write: impl FnOnce(&Path) -> Result<(), E>,
    ) -> Result<(), E> {
        self.claim.note(name).map_err(|e| OutputError::at("write", &self.path.join(name), e))?;
        write(&self.path.join(name))?;
        self.files.push(name.to_string());
        Ok(())
    }

    /// Makes sure that no file of this name is left from an earlier run.
    pub fn remove(&self, name: &str) -> Result<(), OutputError> {
        remove(&self.path.join(name))
    }

    /// Writes `run.json`, which declares the folder complete.
    ///
    /// All other files are forced to the disk before: a power cut cannot leave `run.json` beside tables that are
    /// missing, and a disk that reports late that it is full is heard.
    pub fn finish(mut self, record: &super::run::RunRecord) -> Result<Vec<String>, OutputError> {
        // The disk serves many waiting threads in little more than the time of one.
        std::thread::scope(|scope| {
            let parts = self.files.chunks(self.files.len().div_ceil(16).max(1));
            let waiting: Vec<_> = parts.map(|part| scope.spawn(|| self.sync(part))).collect();
            waiting
                .into_iter()
                .try_for_each(|thread| thread.join().expect("waiting for the disk does not panic"))
        })?;
        self.write(RUN_FILE, |w| {
            serde_json::to_writer_pretty(&mut *w, record)?;
            w.write_all(b"\n")
        })?;
        Ok(self.files)
    }

    fn sync(&self, names: &[String]) -> Result<(), OutputError> {
        names.iter().try_for_each(|name| {
            let path = self.path.join(name);
            // Opened for writing, without which some systems refuse to sync.
            let file = File::options().write(true).open(&path);
            file.and_then(|file| file.sync_data()).map_err(|e| OutputError::at("write", &path, e))
        })
    }
}

fn write_file(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut writer = BufWriter::new(File::create(path)?);
    fill(&mut writer)?;
    writer.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::run::RunRecord;

    fn names(path: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(path).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.retain(|name| name != ".sartorius");
        names.sort();
        names
    }

    #[test]
    fn a_failed_write_leaves_the_older_file_and_no_temporary() {
        let dir = tempfile::tempdir().unwrap();
        let mut folder = OutputFolder::open(dir.path(), "optimize", "walker").unwrap();
        folder.write("a.csv", |w| w.write_all(b"old")).unwrap();
        let error = folder
            .write("a.csv", |w| {
                w.write_all(&[b'x'; 100_000])?; // more than the buffer, so that bytes do reach the file
                Err(io::Error::from(io::ErrorKind::StorageFull))
            })
            .unwrap_err();
        assert!(error.to_string().contains("a.csv") && error.to_string().contains("full"), "{error}");
        assert_eq!(fs::read(dir.path().join("a.csv")).unwrap(), b"old");
        assert_eq!(names(dir.path()), ["a.csv"]);
    }

    #[test]
    fn the_final_name_appears_only_after_the_last_byte() {
        let dir = tempfile::tempdir().unwrap();
        let mut folder = OutputFolder::open(dir.path(), "optimize", "walker").unwrap();
        folder
            .write("a.csv", |w| {
                w.write_all(b"1\n")?;
                w.flush()?;
                assert_eq!(names(dir.path()), [".a.csv.partial"]);
                Ok(())
            })
            .unwrap();
        assert_eq!(names(dir.path()), ["a.csv"]);
    }

    #[test]
    fn opening_takes_back_run_json_and_clears_what_a_killed_run_left() {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::open(dir.path(), "optimize", "walker").unwrap();
        folder.finish(&RunRecord::new("optimize")).unwrap();
        fs::write(dir.path().join(".b.csv.partial"), "half").unwrap();
        fs::write(dir.path().join("notes.txt"), "mine").unwrap();
        assert_eq!(names(dir.path()), [".b.csv.partial", "notes.txt", "run.json"]);
        OutputFolder::open(dir.path(), "optimize", "walker").unwrap();
        assert_eq!(names(dir.path()), ["notes.txt"]);
    }

    #[test]
    fn a_file_in_the_place_of_the_folder_is_an_error_with_its_name() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("taken");
        fs::write(&file, "x").unwrap();
        let error = OutputFolder::open(&file.join("out"), "optimize", "walker").unwrap_err();
        assert!(error.to_string().contains("taken"), "{error}");
    }
}
