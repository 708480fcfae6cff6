//! Helpers shared by the tests of the workspace.

use std::path::PathBuf;

/// A file or folder under `../shared`, the read-only reference material beside the repository.
///
/// `None`, with a printed notice, where the folder is absent: the calling test then returns
/// without a verdict.
pub fn shared(relative: &str) -> Option<PathBuf> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared").join(relative);
    if path.exists() {
        return Some(path);
    }
    eprintln!("notice: {} is absent; this check is skipped", path.display());
    None
}

/// Order at which `|f(h) - f(0) - h * slope|` falls: 2 when `slope` is f'(0), clearly less when it is not.
///
/// `h`: first step, small against the length over which `f` bends.
pub fn taylor_order(f: impl Fn(f64) -> f64, slope: f64, h: f64) -> f64 {
    let [r0, r1, r2] = [h, h / 2.0, h / 4.0].map(|h| (f(h) - f(0.0) - h * slope).abs());
    if r0 <= 1e-12 * (f(0.0).abs() + slope.abs()) {
        return f64::INFINITY; // exactly linear
    }
    (r0 / r1).log2().min((r1 / r2).log2()) // twice: no pass by cancellation
}
