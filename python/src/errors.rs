//! Errors of the library as exceptions. The classes are in `ecmsk/errors.py`, one for each kind of error; the messages are
//! the library's.

use ecmsk::ecm::EcmError;
use ecmsk::link::LinkError;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The class of an error.
fn class(error: &EcmError) -> &'static str {
    match error {
        EcmError::Link(error) => class_of_link(error),
        EcmError::Config(_) => "ConfigError",
        EcmError::Machine(_) => "MachineFileError",
        EcmError::SlotUnknown { .. } => "SlotUnknownError",
        EcmError::Setting { .. } => "SettingError",
        EcmError::NoReport { .. } => "NoReportError",
        EcmError::Timeout { .. } => "TimeoutError",
        EcmError::StateStuck { .. } => "StateStuckError",
        EcmError::WrongState { .. } => "WrongStateError",
        EcmError::SlaveCount { .. } => "SlaveCountError",
        EcmError::NoSuchSlave { .. } => "NoSuchSlaveError",
        EcmError::WrongKind { .. } => "WrongKindError",
        EcmError::WrongMode { .. } => "WrongModeError",
        EcmError::SdoAborted { .. } => "SdoAbortedError",
        EcmError::SdoTooWide { .. } => "SdoTooWideError",
        EcmError::NotEnabled { .. } => "NotEnabledError",
        EcmError::SecondOff { .. } => "SecondOffError",
        EcmError::SlaveLost { .. } => "SlaveLostError",
        EcmError::TooDeep { .. } => "TooDeepError",
        EcmError::Alarm { .. } => "AlarmError",
        EcmError::TooFar { .. } => "TooFarError",
        EcmError::SoftLimit { .. } => "SoftLimitError",
        EcmError::OutOfRange { .. } => "OutOfRangeError",
        EcmError::Cleared => "ClearedError",
        EcmError::IsHoming { .. } => "IsHomingError",
        EcmError::HomingFailed { .. } => "HomingFailedError",
        EcmError::Busy { .. } => "BusyError",
        _ => "EcmError",
    }
}

fn class_of_link(error: &LinkError) -> &'static str {
    match error {
        LinkError::Uri(_) => "UriError",
        LinkError::NoBoard { .. } => "NoBoardError",
        LinkError::InUse { .. } => "InUseError",
        LinkError::Lost { .. } => "LostError",
        LinkError::Closed => "ClosedError",
        _ => "LinkError",
    }
}

/// The number of the slave that an error is about, and the error code of the drive or the abort code of the SDO in it.
fn parts(error: &EcmError) -> (Option<u8>, Option<u32>) {
    match error {
        EcmError::Alarm { slave, code } => (Some(*slave), Some((*code).into())),
        EcmError::SdoAborted { slave, code, .. } => (Some(*slave), Some(code.0)),
        EcmError::SlaveLost { slave, .. } => (*slave, None),
        EcmError::NoSuchSlave { slave, .. }
        | EcmError::WrongKind { slave, .. }
        | EcmError::WrongMode { slave, .. }
        | EcmError::SdoTooWide { slave, .. }
        | EcmError::NotEnabled { slave, .. }
        | EcmError::SecondOff { slave }
        | EcmError::TooFar { slave, .. }
        | EcmError::SoftLimit { slave, .. }
        | EcmError::OutOfRange { slave, .. }
        | EcmError::IsHoming { slave }
        | EcmError::HomingFailed { slave, .. } => (Some(*slave), None),
        _ => (None, None),
    }
}

/// The exception for an error.
pub fn exception(py: Python<'_>, error: &EcmError) -> PyErr {
    let (slave, code) = parts(error);
    named(py, class(error), &error.to_string(), slave, code)
}

/// An exception of a class of `ecmsk/errors.py`.
pub fn named(py: Python<'_>, class: &str, message: &str, slave: Option<u8>, code: Option<u32>) -> PyErr {
    let made = || -> PyResult<PyErr> {
        let fields = PyDict::new(py);
        fields.set_item("slave", slave)?;
        fields.set_item("code", code)?;
        let exception = py.import("ecmsk.errors")?.getattr(class)?.call((message,), Some(&fields))?;
        Ok(PyErr::from_value(exception))
    };
    // If the package is damaged, so that `ecmsk/errors.py` cannot be imported, the message of the error must still be
    // shown.
    made().unwrap_or_else(|error| PyRuntimeError::new_err(format!("{message} ({class}: {error})")))
}
