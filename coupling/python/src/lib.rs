//! What Python calls of Sartorius. Names, units and words are those of the Rust side; `python/sartorius` puts tables and documentation around it.

mod arrays;
mod errors;
mod optimize;
mod patience;
mod rigid;
mod study;
mod tables;
mod thigh;

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::prelude::*;

/// Runs a command line of `sartorius`, the name of the program first; returns its exit code.
#[pyfunction]
fn run_command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| command::cli::run(arguments))
}

/// Says how a process of this program is started, and which file holds its code.
#[pyfunction]
fn is_started_by(words: Vec<OsString>, code: PathBuf) {
    command::program::is_started_by(words, code);
}

/// Threads to use from now on; `False` where they were set or used already. Results do not depend on it.
#[pyfunction]
fn set_threads(n: usize) -> bool {
    rayon::ThreadPoolBuilder::new().num_threads(n).build_global().is_ok()
}

/// The compiled part of `sartorius`.
#[pymodule]
fn _core(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add("InputError", m.py().get_type::<errors::InputError>())?;
    m.add("NotConverged", m.py().get_type::<errors::NotConverged>())?;
    m.add_function(wrap_pyfunction!(run_command, m)?)?;
    m.add_function(wrap_pyfunction!(is_started_by, m)?)?;
    m.add_function(wrap_pyfunction!(set_threads, m)?)?;
    m.add_function(wrap_pyfunction!(optimize::optimize, m)?)?;
    m.add_class::<thigh::Thigh>()?;
    m.add_class::<rigid::RigidLeg>()?;
    m.add_class::<study::Study>()?;
    Ok(())
}
