//! The calls of a board: configuration, states, axes, objects, inputs and outputs. Each waits without Python's lock.

use std::time::Duration;

use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{self, CrcSwitches, Ecm, EcmError, SdoValue};
use pyo3::exceptions::{PyOverflowError, PyValueError};
use pyo3::prelude::*;

use crate::board::Board;
use crate::errors::named;
use crate::snapshot::{Snapshot, State};
use crate::values::{Config, MasterState, Stats, seconds};

impl Board {
    /// The configuration that a program gives, or that of the machine file.
    fn config(&self, py: Python<'_>, given: Option<Config>) -> PyResult<ecm::Config> {
        if let Some(given) = given {
            return Ok(given.0);
        }
        let machine = self.names.0.as_ref().ok_or_else(|| {
            let message =
                "no configuration was given, and there is no machine file; give one, or open the board by open_machine";
            named(py, "ConfigError", message, None, None)
        })?;
        Ok(ecm::Config::of_machine(machine))
    }

    /// Runs a call with the slave numbers of `axes`, which are given as numbers or names. Other threads run while it
    /// waits.
    fn with_axes(
        &self,
        axes: &Bound<'_, PyAny>,
        call: impl FnOnce(&Ecm, &[u8]) -> Result<(), EcmError> + Send,
    ) -> PyResult<()> {
        let slaves = self.names.slaves(axes)?;
        self.wait(axes.py(), |ecm| call(ecm, &slaves))
    }
}

/// Calls a generic function for an SDO, such as `read` or `write` below, with the integer type whose name the program gives
/// ("u8" to "i32"). A tuple of arguments follows the function's name.
macro_rules! sdo {
    ($name:expr, $call:ident $arguments:tt) => {
        match $name {
            "u8" => $call::<u8> $arguments,
            "i8" => $call::<i8> $arguments,
            "u16" => $call::<u16> $arguments,
            "i16" => $call::<i16> $arguments,
            "u32" => $call::<u32> $arguments,
            "i32" => $call::<i32> $arguments,
            other => Err(PyValueError::new_err(format!("`{other}` is no type of an object; set u8, i8, u16, i16, u32 or i32"))),
        }
    };
}

fn read<T: SdoValue + Into<i64>>(board: &Board, py: Python<'_>, slave: u8, object: ObjectAddress) -> PyResult<i64> {
    board.wait(py, |ecm| ecm.sdo_read::<T>(slave, object)).map(Into::into)
}

fn write<T: SdoValue + TryFrom<i64>>(
    board: &Board,
    py: Python<'_>,
    slave: u8,
    object: ObjectAddress,
    value: i64,
) -> PyResult<()> {
    let bits = T::SIZE.bytes() * 8;
    let value = T::try_from(value).map_err(|_| {
        PyOverflowError::new_err(format!("{value} does not fit the {bits} bits of the type; check both"))
    })?;
    board.wait(py, move |ecm| ecm.sdo_write(slave, object, value))
}

#[pymethods]
impl Board {
    /// The slot size of the board, 12 or 16 bytes.
    fn slot_size(&self, py: Python<'_>) -> PyResult<usize> {
        self.wait(py, Ecm::slot_size).map(|size| size.bytes())
    }

    /// The newest report, without waiting for another one.
    fn snapshot(&self, py: Python<'_>) -> PyResult<Snapshot> {
        let snapshot = self.wait(py, Ecm::snapshot)?;
        Ok(Snapshot { snapshot, names: self.names.clone() })
    }

    /// Waits for the next report.
    #[pyo3(signature = (limit = 1.0))]
    fn next_cycle(&self, py: Python<'_>, limit: f64) -> PyResult<Snapshot> {
        let limit = seconds("limit", limit)?;
        let snapshot = self.wait(py, |ecm| ecm.next_cycle(limit))?;
        Ok(Snapshot { snapshot, names: self.names.clone() })
    }

    /// The state of the network in the newest report.
    fn state(&self, py: Python<'_>) -> PyResult<State> {
        self.wait(py, Ecm::state).map(State)
    }

    /// Counters since the board was opened.
    fn stats(&self, py: Python<'_>) -> PyResult<Stats> {
        self.wait(py, Ecm::stats).map(Stats::from)
    }

    /// Events for a log since the last call.
    fn take_news(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let news = self.wait(py, Ecm::take_news)?;
        Ok(news.iter().map(|news| format!("{news:?}")).collect())
    }

    /// Switches the CRCs of both directions; the board applies it at its next start.
    #[pyo3(signature = (*, check_commands, fill_responses))]
    fn set_crc(&self, py: Python<'_>, check_commands: bool, fill_responses: bool) -> PyResult<()> {
        self.wait(py, |ecm| ecm.set_crc(CrcSwitches { check_commands, fill_responses }))
    }

    /// Discards what waits in the board's FIFO: axes in CSP stop at once and without a ramp.
    fn clear_fifo(&self, py: Python<'_>) -> PyResult<()> {
        self.wait(py, Ecm::clear_fifo)
    }

    /// Sends the configuration of the network, in PreOP; without one that of the machine file.
    #[pyo3(signature = (config = None))]
    fn configure(&self, py: Python<'_>, config: Option<Config>) -> PyResult<()> {
        let config = self.config(py, config)?;
        self.wait(py, |ecm| ecm.configure(&config))
    }

    /// Takes over a board that is configured already. Nothing is sent.
    #[pyo3(signature = (config = None))]
    fn adopt(&self, py: Python<'_>, config: Option<Config>) -> PyResult<()> {
        let config = self.config(py, config)?;
        self.wait(py, |ecm| ecm.adopt(&config))
    }

    /// Changes the state of the network and waits until it is reached.
    #[pyo3(signature = (state, limit = None))]
    fn set_state(&self, py: Python<'_>, state: MasterState, limit: Option<f64>) -> PyResult<()> {
        let limit: Option<Duration> = limit.map(|limit| seconds("limit", limit)).transpose()?;
        self.wait(py, |ecm| match limit {
            Some(limit) => ecm.set_state_within(state.into(), limit),
            None => ecm.set_state(state.into()),
        })
    }

    /// Switches axes on and waits until all are in Operation enabled.
    fn servo_on(&self, axes: &Bound<'_, PyAny>) -> PyResult<()> {
        self.with_axes(axes, Ecm::servo_on)
    }

    /// Switches axes off. A vertical axis without a brake drops.
    fn servo_off(&self, axes: &Bound<'_, PyAny>) -> PyResult<()> {
        self.with_axes(axes, Ecm::servo_off)
    }

    /// Resets the alarms of axes. They are off after it.
    fn clear_alarm(&self, axes: &Bound<'_, PyAny>) -> PyResult<()> {
        self.with_axes(axes, Ecm::clear_alarm)
    }

    /// Reads an object of a slave.
    #[pyo3(signature = (slave, index, sub = 0, *, r#type))]
    fn sdo_read(&self, slave: &Bound<'_, PyAny>, index: u16, sub: u8, r#type: &str) -> PyResult<i64> {
        let (number, object) = (self.names.slave(slave)?, ObjectAddress::new(index, sub));
        sdo!(r#type, read(self, slave.py(), number, object))
    }

    /// Writes an object of a slave, with the size of the type.
    #[pyo3(signature = (slave, index, sub = 0, *, value, r#type))]
    fn sdo_write(&self, slave: &Bound<'_, PyAny>, index: u16, sub: u8, value: i64, r#type: &str) -> PyResult<()> {
        let (number, object) = (self.names.slave(slave)?, ObjectAddress::new(index, sub));
        sdo!(r#type, write(self, slave.py(), number, object, value))
    }

    /// The 16 inputs of an IO slave, in OP.
    fn inputs(&self, slave: &Bound<'_, PyAny>) -> PyResult<u16> {
        let number = self.names.slave(slave)?;
        self.wait(slave.py(), |ecm| ecm.inputs(number))
    }

    /// Sets the 16 outputs of an IO slave, in OP.
    fn set_outputs(&self, slave: &Bound<'_, PyAny>, bits: u16) -> PyResult<()> {
        let number = self.names.slave(slave)?;
        self.wait(slave.py(), |ecm| ecm.set_outputs(number, bits))
    }

    /// The six inputs of the board itself.
    fn local_inputs(&self, py: Python<'_>) -> PyResult<u8> {
        self.wait(py, Ecm::local_inputs)
    }

    /// Sets the six outputs of the board itself.
    fn set_local_outputs(&self, py: Python<'_>, bits: u8) -> PyResult<()> {
        self.wait(py, |ecm| ecm.set_local_outputs(bits))
    }

    /// Aborts the homing of all slaves, from another thread or from ``progress``.
    fn abort_homing(&self, py: Python<'_>) -> PyResult<()> {
        self.wait(py, Ecm::abort_homing)
    }
}
