//! The deformable thigh by itself, to be driven from Python.

use std::path::PathBuf;
use std::sync::Arc;

use coupling::comparison::Prepared;
use coupling::configuration::Configuration;
use coupling::fibres::WrittenCalibration;
use coupling::scene::Scene;
use coupling::session::{PoseNumbers, ThighSession, ThighSide};
use coupling::thigh::registration::BODIES;
use coupling::two_way::capacity::{BoneTwists, COORDINATES, MOVED};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::arrays::{array, column, rows};
use crate::errors::{bad, of_core, of_input};
use crate::patience::wait;

/// Name and kind of a block of cells, and the nodes of each.
type Cells<'py> = (String, String, Bound<'py, PyAny>);

/// What `sartorius.Session` documents.
#[pyclass(frozen, module = "sartorius._core")]
pub(crate) struct Thigh {
    session: std::sync::Mutex<ThighSession>,
    side: Arc<ThighSide>,
}

impl Thigh {
    fn session(&self) -> std::sync::MutexGuard<'_, ThighSession> {
        // A poisoned session is as it was before whatever failed in it.
        self.session.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    /// What rigid legs of the same scene need to know.
    pub(crate) fn written(&self) -> (Scene, WrittenCalibration) {
        (self.side.prepared().scene.clone(), self.side.calibration().written())
    }
}

#[pymethods]
impl Thigh {
    #[new]
    #[pyo3(signature = (scene, data, contact, folder, progress))]
    fn new(
        py: Python<'_>,
        scene: PathBuf,
        data: Option<PathBuf>,
        contact: Option<bool>,
        folder: PathBuf,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Thigh> {
        let scene = Scene::read(&scene, data.as_deref()).map_err(of_input)?;
        let configuration = match contact.unwrap_or(scene.contact.is_some()) {
            true => Configuration::WithContact,
            false => Configuration::WithoutContact,
        };
        let made = wait(py, progress, move |lap| {
            let prepared = Prepared::new(scene, data.as_deref(), lap)?;
            let side = ThighSide::new(prepared, configuration, None, &folder)?;
            lap("calibration");
            Ok(Arc::new(side))
        })?;
        let side = made.map_err(of_core)?;
        Ok(Thigh { session: ThighSession::new(side.clone()).into(), side })
    }

    #[getter]
    fn muscles(&self) -> Vec<String> {
        self.side.muscles().map(str::to_string).collect()
    }

    #[getter]
    fn bones(&self) -> [&'static str; BODIES.len()] {
        BODIES
    }

    #[getter]
    fn coordinates(&self) -> [&'static str; MOVED] {
        COORDINATES
    }

    #[getter]
    fn n_nodes(&self) -> usize {
        self.side.n_nodes()
    }

    #[getter]
    fn activation_range(&self) -> (f64, f64) {
        let [least, most] = self.side.activation_range();
        (least, most)
    }

    #[getter]
    fn time(&self) -> f64 {
        self.session().time()
    }

    fn set_time(&self, time: f64) -> PyResult<()> {
        self.session().set_time(time).map_err(of_core)
    }

    fn set_poses(&self, poses: Vec<Vec<f64>>) -> PyResult<()> {
        let wrong = |row: Vec<f64>| {
            bad(format!("poses: {} numbers per bone, must be 7 (x, y, z, then w, x, y, z)", row.len()))
        };
        let poses = poses.into_iter().map(|row| PoseNumbers::try_from(row).map_err(wrong));
        self.session().set_poses(&poses.collect::<PyResult<Vec<_>>>()?).map_err(of_core)
    }

    fn set_activations(&self, activations: Vec<f64>) -> PyResult<()> {
        self.session().set_activations(&activations).map_err(of_core)
    }

    fn set_twists(&self, twists: Vec<Vec<Vec<f64>>>) -> PyResult<()> {
        let wrong = || bad(format!("twists: the shape must be [{}, {MOVED}, 6]", BODIES.len()));
        let of_bone = |bone: Vec<Vec<f64>>| -> Option<[[f64; 6]; MOVED]> {
            let moved: Option<Vec<[f64; 6]>> = bone.into_iter().map(|twist| twist.try_into().ok()).collect();
            moved?.try_into().ok()
        };
        let all: Option<Vec<_>> = twists.into_iter().map(of_bone).collect();
        let all: Option<BoneTwists> = all.and_then(|all| all.try_into().ok());
        self.session().set_twists(&all.ok_or_else(wrong)?).map_err(of_core)
    }

    fn set_rigid_knee_arms(&self, arms: Vec<f64>) -> PyResult<()> {
        self.session().set_rigid_knee_arms(&arms).map_err(of_core)
    }

    fn solve(&self, py: Python<'_>) -> PyResult<()> {
        // On a copy: whatever ends it on the way, the session stays where it is.
        let (state, side) = (self.session().save(), self.side.clone());
        let solved = wait(py, None, move |_| {
            let mut copy = ThighSession::new(side);
            copy.restore(&state)?;
            copy.solve()?;
            copy.result();
            Ok(copy)
        })?;
        *self.session() = solved.map_err(of_core)?;
        Ok(())
    }

    fn forces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mut session = self.session();
        let muscles = &session.result().muscles;
        let table = PyDict::new(py);
        table.set_item("muscle", self.muscles())?;
        let column = |of: &dyn Fn(&coupling::session::MuscleResult) -> f64| {
            column(py, &muscles.iter().map(of).collect::<Vec<f64>>())
        };
        table.set_item("section_force_N", column(&|m| m.section.total)?)?;
        table.set_item("fibre_N", column(&|m| m.section.fibre)?)?;
        table.set_item("matrix_N", column(&|m| m.section.matrix)?)?;
        table.set_item("shell_N", column(&|m| m.section.shell)?)?;
        table.set_item("tissue_N", column(&|m| m.tissue)?)?;
        table.set_item("fibre_stretch", column(&|m| m.stretch)?)?;
        table.set_item("elongation_m", column(&|m| m.elongation)?)?;
        for (c, name) in COORDINATES.iter().enumerate() {
            table
                .set_item(format!("lever_arm_{name}_m"), column(&|m| m.lever_arms[c].unwrap_or(f64::NAN))?)?;
            table.set_item(format!("moment_{name}_Nm"), column(&|m| m.moments[c])?)?;
        }
        Ok(table)
    }

    fn wrenches<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let wrenches = self.session().result().wrenches;
        rows(py, wrenches.as_flattened(), 6)
    }

    fn stiffness<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (state, side) = (self.session().save(), self.side.clone());
        let stiffness = wait(py, None, move |_| {
            let mut copy = ThighSession::new(side);
            copy.restore(&state)?;
            copy.stiffness()
        })?;
        let stiffness = stiffness.map_err(of_core)?;
        array(py, stiffness.as_flattened().as_flattened(), [BODIES.len(), 6, 6])
    }

    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        rows(py, self.session().positions(), 3)
    }

    fn displacements<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        rows(py, &self.session().displacements(), 3)
    }

    /// Per block of cells its name, kind and nodes.
    fn cells<'py>(&self, py: Python<'py>) -> PyResult<Vec<Cells<'py>>> {
        let cells = |block: &fem::mesh::CellBlock| {
            let per_cell = block.nodes.len() / block.n_cells().max(1);
            let nodes = array(py, &block.nodes, [block.n_cells(), per_cell])?;
            Ok((block.name.clone(), format!("{:?}", block.kind), nodes))
        };
        self.side.thigh().mesh.blocks.iter().map(cells).collect()
    }

    fn save<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.session().save())
    }

    fn restore(&self, state: &[u8]) -> PyResult<()> {
        self.session().restore(state).map_err(of_core)
    }
}
