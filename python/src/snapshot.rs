//! A decoded report.

use ecmsk::ecm;
use ecmsk::sk::{DriveResponse, StateByte};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::names::Names;
use crate::values::MasterState;

/// The state byte of the network; ``str()`` gives it in words.
#[pyclass(eq, frozen, hash, skip_from_py_object, module = "ecmsk")]
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct State(pub StateByte);

#[pymethods]
impl State {
    #[getter]
    fn state(&self) -> Option<MasterState> {
        self.0.state().map(MasterState::from)
    }

    #[getter]
    const fn is_failed(&self) -> bool {
        self.0.is_failed()
    }

    #[getter]
    const fn explanation(&self) -> Option<&'static str> {
        self.0.explanation()
    }

    fn __str__(&self) -> String {
        self.0.to_string()
    }

    fn __repr__(&self) -> String {
        format!("<State {}>", self.0)
    }
}

/// What a drive or a stepper reports.
#[pyclass(frozen, skip_from_py_object, module = "ecmsk")]
#[derive(Clone, Copy)]
pub struct Drive(DriveResponse);

#[pymethods]
impl Drive {
    #[getter]
    const fn statusword(&self) -> u16 {
        self.0.statusword.0
    }

    #[getter]
    fn is_enabled(&self) -> bool {
        self.0.statusword.is_enabled()
    }

    /// Actual position, counts.
    #[getter]
    const fn position(&self) -> i32 {
        self.0.position
    }

    /// Actual torque, 0.1 % of the rated torque.
    #[getter]
    const fn torque(&self) -> i16 {
        self.0.torque
    }

    #[getter]
    const fn error_code(&self) -> u16 {
        self.0.error_code
    }

    fn __repr__(&self) -> String {
        format!("<Drive statusword=0x{:04X} position={}>", self.0.statusword.0, self.0.position)
    }
}

/// A decoded report: the board and all slaves in the same cycle.
#[pyclass(frozen, skip_from_py_object, module = "ecmsk")]
pub struct Snapshot {
    pub snapshot: ecm::Snapshot,
    pub names: Names,
}

#[pymethods]
impl Snapshot {
    #[getter]
    const fn state(&self) -> State {
        State(self.snapshot.state())
    }

    /// When the report was made, on the link's clock.
    #[getter]
    const fn at_ns(&self) -> u64 {
        self.snapshot.meta.at.0
    }

    /// The number of the report; a gap means that reports were dropped.
    #[getter]
    const fn sequence(&self) -> u64 {
        self.snapshot.meta.sequence
    }

    #[getter]
    const fn fifo_free(&self) -> u16 {
        self.snapshot.board.fifo_free
    }

    #[getter]
    const fn full_count(&self) -> u16 {
        self.snapshot.board.full_count
    }

    /// The number of configured slaves.
    #[getter]
    fn slaves(&self) -> usize {
        self.snapshot.slaves()
    }

    /// The actual position of a slave's first axis, counts; ``None`` if it has no axis.
    fn position(&self, axis: &Bound<'_, PyAny>) -> PyResult<Option<i32>> {
        Ok(self.snapshot.position(self.names.slave(axis)?))
    }

    /// The actual position of a slave's first axis, in its units.
    fn position_units(&self, axis: &Bound<'_, PyAny>) -> PyResult<Option<f64>> {
        Ok(self.snapshot.position_units(self.names.slave(axis)?))
    }

    /// The slot of a drive or a stepper; ``None`` if the slave is neither.
    fn drive(&self, axis: &Bound<'_, PyAny>) -> PyResult<Option<Drive>> {
        Ok(self.snapshot.drive(self.names.slave(axis)?).map(Drive))
    }

    /// The raw bytes of the report.
    #[getter]
    fn frame<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, self.snapshot.frame().bytes())
    }

    fn __repr__(&self) -> String {
        format!("<Snapshot {} of report {}>", self.snapshot.state(), self.snapshot.meta.sequence)
    }
}
