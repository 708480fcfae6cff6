//! Which commit the program is of, for `run.json` and `--version`: `SARTORIUS_COMMIT` and `SARTORIUS_MODIFIED`.
//!
//! Outside a repository, or without git, both are empty and the program says that it does not know.

use std::path::{Path, PathBuf};
use std::process::Command;

/// What the program is compiled from, seen from this folder.
const SOURCES: [&str; 6] = [
    "../../multibody",
    "../../fem",
    "../../coupling",
    "../../gait-data",
    "../../Cargo.toml",
    "../../Cargo.lock",
];

fn main() {
    for source in SOURCES.into_iter().filter(|s| Path::new(s).exists()) {
        println!("cargo:rerun-if-changed={source}");
    }
    // The folder of an unpacked archive may lie in another repository, which does not know this file.
    let known = git(&["ls-files", "--error-unmatch", "build.rs"]).is_some();
    let commit = git(&["rev-parse", "HEAD"]).filter(|_| known);
    let changes = git(&[&["status", "--porcelain", "--"], &SOURCES[..]].concat()).filter(|_| known);
    if known {
        // A commit writes the branch and its log, a change of branch HEAD. A path that is absent would be looked for at every build.
        let branch = git(&["symbolic-ref", "-q", "HEAD"]).unwrap_or_default();
        for name in ["HEAD", "logs/HEAD", "packed-refs", branch.trim()] {
            let path = git(&["rev-parse", "--git-path", name]).map(|p| PathBuf::from(p.trim()));
            if let Some(path) = path.filter(|p| !name.is_empty() && p.exists()) {
                println!("cargo:rerun-if-changed={}", path.display());
            }
        }
    }
    println!("cargo:rustc-env=SARTORIUS_COMMIT={}", commit.unwrap_or_default().trim());
    let modified = changes.map_or("", |c| if c.trim().is_empty() { "no" } else { "yes" });
    println!("cargo:rustc-env=SARTORIUS_MODIFIED={modified}");
}

/// What git answers in this folder; `None` where it refuses or is absent.
fn git(arguments: &[&str]) -> Option<String> {
    let mut git = Command::new("git");
    // Hooks set these for the repository that they run in. No lock: another git may be at work.
    git.env_remove("GIT_DIR").env_remove("GIT_WORK_TREE").env_remove("GIT_INDEX_FILE");
    let answer = git.arg("--no-optional-locks").args(arguments).output().ok()?;
    answer.status.success().then(|| String::from_utf8_lossy(&answer.stdout).into_owned())
}
