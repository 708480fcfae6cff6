//! Where the files of a trial may lie: below the folder of the trial file or below the data folder, nowhere else.
//!
//! What a trial file says must not lead out by `..` or an absolute path. A symbolic link inside these folders is followed: whoever laid it there
//! has allowed it, which no text of a trial file can.

use std::path::{Component, Path, PathBuf};

use super::TrialFile;
use crate::error::InputError;
use crate::shipped::{self, Kind};

impl TrialFile {
    /// Every file that the trial is made from, the trial file first.
    pub fn inputs(&self, data: Option<&Path>) -> Result<Vec<PathBuf>, InputError> {
        let mut files = vec![self.path.clone(), self.find(&self.motion, data)?];
        for given in self.force.file.iter().chain(&self.landmarks.static_trial).chain(&self.landmarks.motions)
        {
            files.push(self.find(given, data)?);
        }
        if let Some(file) = self.emg.as_ref().and_then(|emg| emg.file.as_ref()) {
            files.push(self.find(file, data)?);
        }
        if let Some(table) = &self.landmarks.table {
            files.push(self.find_table(table, data)?);
        }
        let mut seen = std::collections::HashSet::new();
        files.retain(|f| seen.insert(f.clone()));
        Ok(files)
    }

    /// Finds a file named in the trial file.
    pub(super) fn find(&self, given: &Path, data: Option<&Path>) -> Result<PathBuf, InputError> {
        self.find_below(given, &self.folders(data))
    }

    /// Finds a table of landmarks; it may also lie in a folder `subjects` beside the folder of the trial file, or be a shipped one.
    pub(super) fn find_table(&self, given: &Path, data: Option<&Path>) -> Result<PathBuf, InputError> {
        let own = self.folders(None).into_iter().map(|folder| folder.join("../subjects"));
        let mut folders = self.folders(data);
        folders.splice(1..1, own);
        self.find_below(given, &folders).or_else(|absent| {
            let shipped = Kind::Subject.path().join(given);
            shipped::text(&shipped).map(|_| shipped).ok_or(absent)
        })
    }

    fn folders(&self, data: Option<&Path>) -> Vec<PathBuf> {
        let own = match self.path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
            _ => PathBuf::from("."),
        };
        std::iter::once(own).chain(data.map(Path::to_path_buf)).collect()
    }

    fn find_below(&self, given: &Path, folders: &[PathBuf]) -> Result<PathBuf, InputError> {
        let outright = given.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
        let inside = |folder: &Path, path: &Path| match (folder.canonicalize(), path.canonicalize()) {
            (Ok(folder), Ok(path)) => path.starts_with(&folder),
            _ => false,
        };
        for folder in folders {
            let path = folder.join(given);
            if path.exists() && (outright || inside(folder, &path)) {
                return Ok(path);
            }
        }
        if !outright {
            return Err(InputError::PathEscapes { file: self.path.clone(), path: given.to_path_buf() });
        }
        let searched = folders.iter().map(|f| f.display().to_string()).collect::<Vec<_>>().join(", ");
        Err(InputError::NotFound { file: self.path.clone(), path: given.to_path_buf(), searched })
    }
}
