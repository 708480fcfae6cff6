//! Work on a thread of its own, so that Ctrl-C is heard and progress is told while it goes on.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// How long Ctrl-C waits to be heard.
const PATIENCE: Duration = Duration::from_millis(20);

enum Said<T> {
    Stage(String),
    Done(T),
}

/// The result of `work`, which is given a function to call as each of its stages ends; `progress(stage, seconds)` hears of each.
///
/// Ctrl-C raises `KeyboardInterrupt` at once. The thread goes on to the end of what it has begun, and its result is dropped: nothing that the
/// caller holds changes.
pub(crate) fn wait<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&mut dyn FnMut(&str)) -> T + Send + 'static,
) -> PyResult<T> {
    let (say, hear) = channel();
    std::thread::spawn(move || {
        let lap = say.clone();
        // Nobody hears it after Ctrl-C.
        let result = work(&mut |stage| drop(lap.send(Said::Stage(stage.to_string()))));
        let _ = say.send(Said::Done(result));
    });
    let mut hear = hear;
    let mut clock = Instant::now();
    loop {
        let (said, back) = py.detach(move || (hear.recv_timeout(PATIENCE), hear));
        hear = back;
        match said {
            Ok(Said::Done(result)) => return Ok(result),
            Ok(Said::Stage(stage)) => {
                let seconds = clock.elapsed().as_secs_f64();
                clock = Instant::now();
                if let Some(progress) = &progress {
                    progress.call1(py, (stage, seconds))?;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err(
                    "the computation ended without a result; please report this",
                ));
            }
        }
        py.check_signals()?;
    }
}
