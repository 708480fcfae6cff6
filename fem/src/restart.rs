//! Solved frames of a run as files from which it goes on, to the last bit where it would have been.
//!
//! `NAME_0000.state` holds where all nodes are after a frame, in double precision, and what the solver reported on the way. It begins with
//! the caller's key of everything that led there: a state with another key is not taken. Numbers are stored as their bits (postcard).

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::mesh::MeshError;
use crate::mesh::format::write_whole;
use crate::run::{Advanced, DriveFrame, Frame};
use crate::solve::{Advance, Iteration};

/// A frame as stored, after key and number.
#[derive(Deserialize, Serialize)]
struct State {
    /// Positions of all nodes \[m\].
    x: Vec<f64>,
    /// Velocities \[m/s\]; empty without inertia.
    v: Vec<f64>,
    islands: Vec<Advance>,
    iterations: Vec<Iteration>,
    prescribed_overlaps: Vec<([String; 2], usize)>,
}

/// File of a frame.
pub fn state_file(folder: &Path, name: &str, frame: usize) -> PathBuf {
    folder.join(format!("{name}_{frame:04}.state"))
}

/// Removes all states of a run, which nothing else needs once it is complete.
pub fn remove_states(folder: &Path, name: &str) -> std::io::Result<()> {
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(e),
    };
    for entry in entries {
        let entry = entry?;
        let file_name = entry.file_name();
        let rest = file_name.to_str().and_then(|f| f.strip_prefix(name)?.strip_prefix('_'));
        let digits = rest.and_then(|r| r.strip_suffix(".part").unwrap_or(r).strip_suffix(".state"));
        if digits.is_some_and(|d| d.len() >= 4 && d.bytes().all(|b| b.is_ascii_digit())) {
            std::fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Stores a solved frame.
pub(crate) fn save(
    folder: &Path,
    name: &str,
    key: &str,
    frame: usize,
    done: &Advanced,
) -> Result<(), MeshError> {
    let state = State {
        x: done.frame.x.clone(),
        v: done.frame.v.clone(),
        islands: done.frame.islands.clone(),
        iterations: done.iterations.clone(),
        prescribed_overlaps: done.frame.prescribed_overlaps.clone(),
    };
    let bytes = postcard::to_stdvec(&(key, frame, state)).expect("a state is plain data");
    write_whole(&state_file(folder, name, frame), &bytes)
}

/// The frame that was stored with this key; `None` where there is none, or not a whole one.
pub(crate) fn load(
    folder: &Path,
    name: &str,
    key: &str,
    frame: usize,
    n: usize,
    to: &DriveFrame,
) -> Option<Advanced> {
    let (found, number, state) = read(&state_file(folder, name, frame))?;
    if found != key || number != frame {
        return None;
    }
    let whole = state.x.len() == n && [0, n].contains(&state.v.len());
    whole.then(|| Advanced {
        frame: Frame {
            time: to.time,
            load: to.load.clone(),
            x: state.x,
            v: state.v,
            islands: state.islands,
            prescribed_overlaps: state.prescribed_overlaps,
        },
        errors: Vec::new(),
        iterations: state.iterations,
    })
}

/// Whether a file is a whole state.
pub fn is_whole(file: &Path) -> bool {
    read(file).is_some()
}

/// Key, number of the frame, and state of a file that is whole.
fn read(file: &Path) -> Option<(String, usize, State)> {
    let bytes = std::fs::read(file).ok()?;
    let (read, rest) = postcard::take_from_bytes(&bytes).ok()?;
    rest.is_empty().then_some(read)
}
