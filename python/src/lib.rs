//! The Python package `ecmsk`, as far as it is written in Rust: the module `ecmsk._ecmsk`. The rest is in `ecmsk/` beside
//! `src/`: names, exceptions, types for checkers, the plugin for pytest.
//!
//! - `values.rs`, `snapshot.rs`: the values that a program passes and gets, those of [`ecmsk::ecm`] as classes
//! - `board.rs`: opening and closing a board, also while other threads call it
//! - `calls.rs`: the calls of a board; `homing.rs`, `stream.rs`: homing and streams of targets
//! - `recording.rs`, `recorded_axes.rs`: recordings, and what each axis did
//! - `names.rs`: axes by number, or by name of a machine file
//! - `wait.rs`: waits without Python's lock, and what ends them
//! - `errors.rs`: errors as exceptions of `ecmsk/errors.py`

// `cargo test --workspace --lib` builds a program of unit tests although there are none: with this code it would have to be
// linked with Python.
#![cfg(not(test))]

mod board;
mod calls;
mod errors;
mod homing;
mod names;
mod recorded_axes;
mod recording;
mod snapshot;
mod stream;
mod values;
mod wait;

/// The module that `import ecmsk` takes its classes and functions from.
#[pyo3::pymodule]
mod _ecmsk {
    #[pymodule_export]
    use crate::board::{Board, close_all, forked, open, open_machine, open_when_there};
    #[pymodule_export]
    use crate::homing::{Homing, HomingPhase, HomingProgress};
    #[pymodule_export]
    use crate::recording::{RecordedFrames, RecordedRun};
    #[pymodule_export]
    use crate::snapshot::{Drive, Snapshot, State};
    #[pymodule_export]
    use crate::stream::{Stream, StreamStats};
    #[pymodule_export]
    use crate::values::{Axis, Close, Config, DriveSync, MasterState, Mode, Slave, Stats};
}
