//! How this program is started once more: rungs, and workers of a study, are processes of their own.

use std::ffi::OsString;
use std::io;
use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

static STARTED_BY: OnceLock<Vec<OsString>> = OnceLock::new();

/// Says that the program is started by these words (`python -m sartorius`), and which file holds its code; without this both are the executable.
pub fn is_started_by(words: Vec<OsString>, code: PathBuf) {
    let _ = STARTED_BY.set(words); // said already: the same
    coupling::fibres::cache::program_is(code);
}

/// The program, without arguments.
pub fn command() -> io::Result<Command> {
    let Some((program, arguments)) = STARTED_BY.get().and_then(|words| words.split_first()) else {
        return Ok(Command::new(std::env::current_exe()?));
    };
    let mut command = Command::new(program);
    command.args(arguments);
    Ok(command)
}
