//! `sartorius check FILE...`

use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::Outcome;

#[derive(Args)]
pub struct CheckArguments {
    /// Files to check: C3D, TRC, STO, MOT, CSV, trial files (TOML).
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Folder of the recordings that a trial file names.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
}

/// Prints one paragraph per file.
pub fn run(arguments: &CheckArguments) -> Outcome {
    let mut bad = 0;
    for file in &arguments.files {
        match multibody::read::check(file, arguments.data.as_deref()) {
            Ok(summary) => {
                let _ = writeln!(std::io::stdout(), "{}: good. {summary}", file.display());
            }
            Err(error) => {
                bad += 1;
                eprintln!("error: {error}");
            }
        }
    }
    if bad > 0 { Outcome::BadInput } else { Outcome::Solved }
}
