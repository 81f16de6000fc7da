//! Axes by the number of their slave, or by their name in a machine file.

use std::sync::Arc;

use ecmsk::machine_file::{MachineAxis, MachineFile};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyInt, PyString};

use crate::errors::named;

/// The names of the axes of a board, if it was opened by a machine file.
#[derive(Clone, Default)]
pub struct Names(pub Option<Arc<MachineFile>>);

impl Names {
    /// The number of a slave that a program has given as a number or as a name.
    pub fn slave(&self, axis: &Bound<'_, PyAny>) -> PyResult<u8> {
        if let Ok(name) = axis.cast::<PyString>() {
            return Ok(self.axis(axis.py(), &name.to_cow()?)?.slave);
        }
        // True is a number in Python, and surely no slave.
        if !axis.is_instance_of::<PyInt>() || axis.is_instance_of::<PyBool>() {
            let given = axis.get_type().name()?;
            return Err(PyTypeError::new_err(format!(
                "an axis is the number of its slave or its name in the machine file, not of the type `{given}`"
            )));
        }
        axis.extract().map_err(|_| PyValueError::new_err(format!("{axis} is no slave; slaves are 1 to 40")))
    }

    /// The slave numbers of one axis (a number or a name), or of several axes, given as an iterable.
    pub fn slaves(&self, axes: &Bound<'_, PyAny>) -> PyResult<Vec<u8>> {
        if axes.is_instance_of::<PyString>() || axes.is_instance_of::<PyInt>() {
            return Ok(vec![self.slave(axes)?]);
        }
        axes.try_iter()?.map(|axis| self.slave(&axis?)).collect()
    }

    /// The axis with this name in the machine file; an exception that lists the names if there is none.
    pub fn axis(&self, py: Python<'_>, name: &str) -> PyResult<&MachineAxis> {
        let unknown = |message: String| named(py, "NoSuchAxisError", &message, None, None);
        let machine = self.0.as_ref().ok_or_else(|| {
            unknown(format!("axis `{name}` is no number, and there is no machine file; open the board by open_machine"))
        })?;
        machine.axis(name).ok_or_else(|| {
            let names: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
            let there = if names.is_empty() { "no axis".to_owned() } else { names.join(", ") };
            unknown(format!("{} has no axis `{name}`; it has {there}", machine.path.display()))
        })
    }
}
