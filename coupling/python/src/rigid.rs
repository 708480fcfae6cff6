//! The rigid leg by itself, on its way through its trial.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use coupling::comparison::Sized;
use coupling::session::{RigidSession, RigidSide};
use coupling::thigh::registration::BODIES;
use coupling::two_way::capacity::MOVED;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::arrays::{array, column, rows};
use crate::errors::of_core;
use crate::patience::wait;
use crate::thigh::Thigh;

/// What `sartorius.RigidLeg` documents.
#[pyclass(frozen, module = "sartorius._core")]
pub(crate) struct RigidLeg {
    session: Mutex<RigidSession>,
    side: Arc<RigidSide>,
}

impl RigidLeg {
    fn session(&self) -> MutexGuard<'_, RigidSession> {
        self.session.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl RigidLeg {
    /// The rigid leg beside a thigh.
    #[new]
    #[pyo3(signature = (thigh, data))]
    fn new(py: Python<'_>, thigh: &Thigh, data: Option<std::path::PathBuf>) -> PyResult<RigidLeg> {
        let (scene, calibration) = thigh.written();
        let made = wait(py, None, move |_| RigidSide::new(Sized::new(scene, data.as_deref())?, calibration))?;
        let side = Arc::new(made.map_err(of_core)?);
        Ok(RigidLeg { session: RigidSession::new(side.clone()).into(), side })
    }

    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        column(py, self.side.times())
    }

    #[getter]
    fn time(&self) -> f64 {
        self.session().time()
    }

    #[getter]
    fn muscles(&self) -> Vec<String> {
        self.side.muscles().to_vec()
    }

    fn go_to(&self, time: f64) -> PyResult<()> {
        self.session().go_to(time).map_err(of_core)
    }

    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let poses = self.session().result().map_err(of_core)?.poses;
        rows(py, poses.as_flattened(), 7)
    }

    fn twists<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let twists = self.session().result().map_err(of_core)?.twists;
        array(py, twists.as_flattened().as_flattened(), [BODIES.len(), MOVED, 6])
    }

    fn drives<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        column(py, &self.session().result().map_err(of_core)?.drives)
    }

    fn is_feasible(&self) -> PyResult<bool> {
        Ok(self.session().result().map_err(of_core)?.is_feasible)
    }

    fn angles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mut session = self.session();
        let result = session.result().map_err(of_core)?;
        let table = PyDict::new(py);
        for (name, angle) in self.side.angles().iter().zip(&result.angles) {
            table.set_item(name, *angle)?;
        }
        Ok(table)
    }

    fn forces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mut session = self.session();
        let result = session.result().map_err(of_core)?;
        let table = PyDict::new(py);
        table.set_item("muscle", self.muscles())?;
        table.set_item("force_along_belly_N", column(py, &result.muscle_forces)?)?;
        table.set_item("force_N", column(py, &result.tensions)?)?;
        Ok(table)
    }

    fn lines<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mut session = self.session();
        let result = session.result().map_err(of_core)?;
        let table = PyDict::new(py);
        table.set_item("line", self.side.lines().collect::<Vec<_>>())?;
        table.set_item("force_N", column(py, &result.forces)?)?;
        table.set_item("activation", column(py, &result.activations)?)?;
        table.set_item("length_m", column(py, &result.lengths)?)?;
        let coordinates = self.side.coordinates();
        for (c, name) in coordinates.iter().enumerate() {
            let arms: Vec<f64> =
                result.lever_arms.iter().skip(c).step_by(coordinates.len()).copied().collect();
            table.set_item(format!("lever_arm_{name}_m"), column(py, &arms)?)?;
        }
        Ok(table)
    }

    fn save<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.session().save())
    }

    fn restore(&self, state: &[u8]) -> PyResult<()> {
        self.session().restore(state).map_err(of_core)
    }
}
