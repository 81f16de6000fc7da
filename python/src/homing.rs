//! Homing of axes, with progress for the program.

use ecmsk::ecm;
use ecmsk::machine_file::AxisHoming;
use pyo3::prelude::*;

use crate::board::Board;
use crate::errors::named;
use crate::values::seconds;
use crate::wait;

/// The objects of homing, which are written before it begins; one that is ``None`` keeps the value of the drive.
///
/// ``method`` is 0x6098, ``switch_speed`` and ``zero_speed`` 0x6099:1 and :2, ``acceleration`` 0x609A, ``offset`` 0x607C in
/// counts. After ``limit`` seconds homing is aborted.
#[pyclass(frozen, from_py_object, module = "ecmsk")]
#[derive(Clone, Copy)]
pub struct Homing(ecm::Homing);

#[pymethods]
impl Homing {
    #[new]
    #[pyo3(signature = (
        method,
        *,
        switch_speed = None,
        zero_speed = None,
        acceleration = None,
        offset = None,
        limit = 60.0,
    ))]
    fn new(
        method: i8,
        switch_speed: Option<u32>,
        zero_speed: Option<u32>,
        acceleration: Option<u32>,
        offset: Option<i32>,
        limit: f64,
    ) -> PyResult<Self> {
        let limit = seconds("limit", limit)?;
        Ok(Self(ecm::Homing { method, switch_speed, zero_speed, acceleration, offset, limit }))
    }
}

/// The phase of the homing of an axis.
#[pyclass(eq, eq_int, frozen, hash, skip_from_py_object, module = "ecmsk")]
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub enum HomingPhase {
    #[pyo3(name = "PREPARING")]
    Preparing,
    #[pyo3(name = "MOVING")]
    Moving,
    #[pyo3(name = "RESTORING")]
    Restoring,
}

/// The progress of an axis that is being homed.
#[pyclass(frozen, get_all, skip_from_py_object, module = "ecmsk")]
#[derive(Clone, Copy)]
pub struct HomingProgress {
    slave: u8,
    phase: HomingPhase,
    position: i32,
    statusword: u16,
    elapsed: f64,
}

impl From<&ecm::HomingProgress> for HomingProgress {
    fn from(progress: &ecm::HomingProgress) -> Self {
        let phase = match progress.phase {
            ecm::HomingPhase::Preparing => HomingPhase::Preparing,
            ecm::HomingPhase::Moving => HomingPhase::Moving,
            ecm::HomingPhase::Restoring => HomingPhase::Restoring,
        };
        let (slave, position, statusword) = (progress.slave, progress.position, progress.statusword.0);
        Self { slave, phase, position, statusword, elapsed: progress.elapsed.as_secs_f64() }
    }
}

/// The homing of an axis in the machine file.
fn of_machine(homing: &AxisHoming) -> Option<ecm::Homing> {
    Some(ecm::Homing {
        switch_speed: homing.speed_switch,
        zero_speed: homing.speed_zero,
        acceleration: homing.acceleration,
        offset: homing.offset_counts,
        ..ecm::Homing::method(homing.method?)
    })
}

#[pymethods]
impl Board {
    /// Homes an axis that is on; without ``homing`` as the machine file says. An exception in ``progress`` aborts it.
    #[pyo3(signature = (axis, homing = None, progress = None))]
    fn home(&self, axis: &Bound<'_, PyAny>, homing: Option<Homing>, progress: Option<Py<PyAny>>) -> PyResult<()> {
        let py = axis.py();
        let slave = self.names.slave(axis)?;
        let of_file = || self.names.0.as_ref()?.axis_of(slave).and_then(|axis| of_machine(&axis.homing));
        let homing = homing.map(|homing| homing.0).or_else(of_file).ok_or_else(|| {
            let message = format!(
                "homing of slave {slave}: no method was given, and no machine file has one; give ecmsk.Homing(METHOD)"
            );
            named(py, "SettingError", &message, None, None)
        })?;
        self.home_these(py, &[(slave, homing)], progress)
    }

    /// Homes several axes together. If one fails, the homing of the others is aborted.
    #[pyo3(signature = (axes, progress = None))]
    fn home_all(
        &self,
        py: Python<'_>,
        axes: Vec<(Bound<'_, PyAny>, Homing)>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        let axis = |(axis, homing): &(Bound<'_, PyAny>, Homing)| Ok((self.names.slave(axis)?, homing.0));
        let axes: Vec<(u8, ecm::Homing)> = axes.iter().map(axis).collect::<PyResult<_>>()?;
        self.home_these(py, &axes, progress)
    }
}

impl Board {
    fn home_these(&self, py: Python<'_>, axes: &[(u8, ecm::Homing)], progress: Option<Py<PyAny>>) -> PyResult<()> {
        let tell = |told: &ecm::HomingProgress| {
            let Some(progress) = &progress else { return };
            Python::attach(|py| {
                if let Err(error) = progress.call1(py, (HomingProgress::from(told),)) {
                    wait::raise(error);
                }
            });
        };
        self.wait(py, |ecm| ecm.home_all(axes, tell))
    }
}
