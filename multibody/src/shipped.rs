//! Files that the program carries: scenes, trial files and tables of landmarks of `gait-data/`. Their recordings are not among them.
//!
//! A shipped file has a path that no file of a user has, `<shipped>/trials/NAME.toml`; the readers of this crate take it like any other.

use std::path::{Path, PathBuf};

use crate::error::{InputError, Place, unknown};

/// First part of their paths.
const ROOT: &str = "<shipped>";

/// What a shipped file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Scene of `compare`, `step` and `plan`.
    Scene,
    /// Trial file.
    Trial,
    /// Table of landmarks of a subject.
    Subject,
    /// Ladder of `cost`.
    Ladder,
    /// Curve of `compare --accuracy`.
    Curve,
}

/// Name with ending, and text.
type File = (&'static str, &'static str);

macro_rules! files {
    ($folder:literal: $($name:literal)*) => {
        &[$(($name, include_str!(concat!("../../gait-data/", $folder, "/", $name)))),*]
    };
}

const SCENES: &[File] = files!("scenes": "walker.toml" "walker_no_contact.toml" "walker_publication.toml" "three_muscles.toml"
    "no_fibres.toml" "rigid_only.toml" "DM_og3.toml" "JW_og3.toml" "real_surfaces.toml");
const TRIALS: &[File] = files!("trials": "DM_ngait_og3.toml" "DM_ngait_og4.toml" "jw_ngait_og1.toml" "jw_ngait_og3.toml"
    "jw_ngait_og3_both.toml" "jw_ngait_og7.toml");
const LADDERS: &[File] = files!("ladders": "walker.toml");
const CURVES: &[File] = files!("curves": "walker.toml");
const SUBJECTS: &[File] = files!("subjects": "DM.csv");

impl Kind {
    fn folder(self) -> &'static str {
        match self {
            Kind::Scene => "scenes",
            Kind::Trial => "trials",
            Kind::Subject => "subjects",
            Kind::Ladder => "ladders",
            Kind::Curve => "curves",
        }
    }

    fn files(self) -> &'static [File] {
        match self {
            Kind::Scene => SCENES,
            Kind::Trial => TRIALS,
            Kind::Subject => SUBJECTS,
            Kind::Ladder => LADDERS,
            Kind::Curve => CURVES,
        }
    }

    /// Path of a folder of shipped files.
    pub fn path(self) -> PathBuf {
        Path::new(ROOT).join(self.folder())
    }

    /// Names without ending, each with the text of its file.
    pub fn all(self) -> impl Iterator<Item = (&'static str, &'static str)> {
        let stem = |name: &'static str| name.rsplit_once('.').map_or(name, |(stem, _)| stem);
        self.files().iter().map(move |(name, text)| (stem(name), *text))
    }
}

/// Text of a shipped file; `None` for every other path.
pub fn text(path: &Path) -> Option<&'static str> {
    let rest = path.strip_prefix(ROOT).ok()?;
    let of = |kind: Kind| {
        let name = rest.strip_prefix(kind.folder()).ok()?;
        kind.files().iter().find(|(file, _)| Path::new(file) == name).map(|(_, text)| *text)
    };
    [Kind::Scene, Kind::Trial, Kind::Subject, Kind::Ladder, Kind::Curve].into_iter().find_map(of)
}

/// Whether this is the path of a shipped file.
pub fn is_shipped(path: &Path) -> bool {
    path.starts_with(ROOT)
}

/// What a person means: a word alone, without folder and ending, is the shipped file of that name; everything else is a file. A word
/// that no shipped file has may be a file, too.
pub fn find(given: &Path, kind: Kind) -> Result<PathBuf, InputError> {
    let word = given.to_string_lossy();
    let is_word =
        given.components().count() == 1 && given.extension().is_none() && !word.contains(['/', '\\']);
    let shipped = |name: &str| kind.all().any(|(n, _)| n == name);
    if is_word && shipped(&word) {
        return Ok(kind.path().join(format!("{word}.toml")));
    }
    if given.exists() || is_shipped(given) {
        return Ok(given.to_path_buf());
    }
    let stem = given.file_stem().map(|s| s.to_string_lossy()).unwrap_or_default();
    let remedy = if is_word {
        let names: Vec<&str> = kind.all().map(|(name, _)| name).collect();
        unknown(&word, "give a file, or a shipped one:", names.iter().copied())
    } else if shipped(&stem) {
        format!("the shipped one is named without folder and ending: {stem}")
    } else {
        return Ok(given.to_path_buf()); // who reads it tells what the system says
    };
    let problem = "there is no such file".to_string();
    Err(InputError::Malformed { file: given.to_path_buf(), at: Place::Whole, problem, remedy })
}

/// What to tell about a word that names a shipped file and something in this folder at once.
pub fn ambiguity(given: &Path, found: &Path) -> Option<String> {
    let word = given.display();
    let both = is_shipped(found) && !is_shipped(given) && given.is_file();
    both.then(|| format!("`{word}` is the shipped one; for the file here write ./{word}"))
}
