//! A scene computed by a process of its own: its memory is its own, its end ends nothing else, and it does not outlive this one.

use std::io;
use std::path::Path;
use std::process::{Output, Stdio};

use crate::program;

/// Carries out `step` for a scene file, with the threads of this process. `resume`: goes on with what a killed run left in `out`.
pub(super) fn step(scene: &Path, out: &Path, data: Option<&Path>, resume: bool) -> io::Result<Output> {
    let mut command = program::command()?;
    let threads = rayon::current_num_threads().to_string();
    command.args(["--quiet", "--with-parent", "--threads", &threads, "step"]).arg(scene);
    command.arg("--out").arg(out).arg("--force");
    if let Some(data) = data {
        command.arg("--data").arg(data);
    }
    if resume {
        command.arg("--resume");
    }
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
    // The pipe stays open as long as this process lives and the child runs: what waits for it must not close it before.
    let open = child.stdin.take();
    let output = child.wait_with_output();
    drop(open);
    output
}
