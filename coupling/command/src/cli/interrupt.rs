//! Ctrl-C, and being told to end: says what was kept, then ends as the signal does, so that a shell stops its loop, too.

#[cfg(unix)]
use std::sync::{Mutex, Once, PoisonError};

use crate::output::OutputError;
use crate::output::claim::Claim;

/// What the run that goes on leaves.
#[cfg(unix)]
type Left = Box<dyn Fn() -> Option<String> + Send>;

/// Makes the claim of a run, and from its first folder on a signal that ends the process says first what the run leaves: one that comes
/// while the claim is made waits for it. A signal that is ignored (`nohup`, a job in the background) stays so.
#[cfg(unix)]
pub(super) fn watched(claim: impl FnOnce() -> Result<Claim, OutputError>) -> Result<Claim, OutputError> {
    static LEFT: Mutex<Option<Left>> = Mutex::new(None);
    static WATCHING: Once = Once::new();
    let mut left = LEFT.lock().unwrap_or_else(PoisonError::into_inner);
    // One for the process, however many commands run in it.
    WATCHING.call_once(|| wait(&LEFT));
    let claim = claim()?;
    *left = Some(Box::new(claim.stopper()));
    Ok(claim)
}

/// Starts to wait for the signals.
#[cfg(unix)]
fn wait(left: &'static Mutex<Option<Left>>) {
    use signal_hook::consts::{SIGINT, SIGTERM};
    let ignored = ignored();
    let heard = [SIGINT, SIGTERM].into_iter().filter(|signal| ignored & (1 << (signal - 1)) == 0);
    let Ok(mut signals) = signal_hook::iterator::Signals::new(heard) else { return };
    std::thread::spawn(move || {
        if let Some(signal) = signals.forever().next() {
            let left = left.lock().unwrap_or_else(PoisonError::into_inner).take();
            if let Some(said) = left.and_then(|left| left()) {
                coupling::say!("\n{said}");
            }
            let _ = signal_hook::low_level::emulate_default_handler(signal);
        }
    });
}

/// A bit per signal that this process was started to ignore; none where the system does not tell.
#[cfg(unix)]
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

/// Ends this process when standard input closes: a process that was started by another, and holds a pipe from it, does not outlive it, however
/// that one ends. Nothing is left but what a kill leaves.
pub(super) fn end_with_parent() {
    std::thread::spawn(|| {
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        std::process::exit(KILLED);
    });
}

/// What a shell says of a process that SIGTERM ended.
const KILLED: i32 = 128 + 15;

/// Elsewhere the system ends the process; what is left is the same.
#[cfg(not(unix))]
pub(super) fn watched(claim: impl FnOnce() -> Result<Claim, OutputError>) -> Result<Claim, OutputError> {
    claim()
}
