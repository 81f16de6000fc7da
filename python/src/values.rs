//! What a program passes to a board: the values of [`ecmsk::ecm`] as classes.

use std::path::PathBuf;
use std::time::Duration;

use ecmsk::cia402;
use ecmsk::ecm::{self, DEFAULT_GUARD_COUNTS, DEFAULT_STANDSTILL_COUNTS, EcmError, Guard, Scale};
use ecmsk::machine_file::MachineFile;
use ecmsk::sk;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::errors::exception;

/// A time limit that a program gives in seconds; `what` names it, for the error.
pub fn seconds(what: &str, value: f64) -> PyResult<Duration> {
    Duration::try_from_secs_f64(value)
        .map_err(|_| PyValueError::new_err(format!("{what} is {value} s; give a time of 0 s or more")))
}

/// A state of the network.
#[pyclass(eq, eq_int, frozen, hash, from_py_object, module = "ecmsk")]
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub enum MasterState {
    #[pyo3(name = "INIT")]
    Init = 1,
    #[pyo3(name = "PREOP")]
    PreOp = 2,
    #[pyo3(name = "SAFEOP")]
    SafeOp = 4,
    #[pyo3(name = "OP")]
    Op = 8,
}

impl From<MasterState> for sk::MasterState {
    fn from(state: MasterState) -> Self {
        match state {
            MasterState::Init => Self::Init,
            MasterState::PreOp => Self::PreOp,
            MasterState::SafeOp => Self::SafeOp,
            MasterState::Op => Self::Op,
        }
    }
}

impl From<sk::MasterState> for MasterState {
    fn from(state: sk::MasterState) -> Self {
        match state {
            sk::MasterState::Init => Self::Init,
            sk::MasterState::PreOp => Self::PreOp,
            sk::MasterState::SafeOp => Self::SafeOp,
            sk::MasterState::Op => Self::Op,
        }
    }
}

/// What happens to the axes when a board is closed.
#[pyclass(eq, eq_int, frozen, hash, from_py_object, module = "ecmsk")]
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub enum Close {
    #[pyo3(name = "HOLD")]
    Hold,
    #[pyo3(name = "SERVO_OFF")]
    ServoOff,
    #[pyo3(name = "LEAVE")]
    Leave,
}

impl From<Close> for ecm::Close {
    fn from(close: Close) -> Self {
        match close {
            Close::Hold => Self::Hold,
            Close::ServoOff => Self::ServoOff,
            Close::Leave => Self::Leave,
        }
    }
}

/// The mode of operation of an axis.
#[pyclass(eq, eq_int, frozen, hash, from_py_object, module = "ecmsk")]
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub enum Mode {
    #[pyo3(name = "CSP")]
    Csp = 8,
    #[pyo3(name = "CSV")]
    Csv = 9,
    #[pyo3(name = "CST")]
    Cst = 10,
}

/// How a drive is synchronized with the cycle: by distributed clocks, or on its own clock.
#[pyclass(eq, eq_int, frozen, hash, from_py_object, module = "ecmsk")]
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub enum DriveSync {
    #[pyo3(name = "FREE_RUN")]
    FreeRun = 0,
    #[pyo3(name = "DC_SYNC")]
    DcSync = 1,
}

/// The settings of an axis.
///
/// ``counts_per_unit`` is the scale of ``csp_units`` and ``position_units``. ``guard`` is the largest allowed distance of a
/// target from the actual position in counts; ``None`` switches it off. An axis that moves at most ``standstill`` counts
/// within 8 cycles counts as stationary.
#[pyclass(frozen, from_py_object, module = "ecmsk")]
#[derive(Clone, Copy)]
pub struct Axis(pub ecm::Axis);

#[pymethods]
impl Axis {
    #[new]
    #[pyo3(signature = (
        mode = Mode::Csp,
        *,
        counts_per_unit = 1.0,
        guard = Some(DEFAULT_GUARD_COUNTS),
        standstill = DEFAULT_STANDSTILL_COUNTS,
        sync = DriveSync::DcSync,
    ))]
    fn new(mode: Mode, counts_per_unit: f64, guard: Option<u32>, standstill: u32, sync: DriveSync) -> Self {
        let mode = match mode {
            Mode::Csp => cia402::Mode::Csp,
            Mode::Csv => cia402::Mode::Csv,
            Mode::Cst => cia402::Mode::Cst,
        };
        let sync = match sync {
            DriveSync::FreeRun => sk::DriveSync::FreeRun,
            DriveSync::DcSync => sk::DriveSync::DcSync,
        };
        let guard = guard.map_or(Guard::Off, Guard::Within);
        Self(ecm::Axis { mode, sync, guard, scale: Scale::per_unit(counts_per_unit), standstill, ..ecm::Axis::CSP })
    }
}

/// One slave of the network.
#[pyclass(frozen, from_py_object, module = "ecmsk")]
#[derive(Clone, Copy)]
pub struct Slave(pub ecm::Slave);

fn settings(axis: Option<Axis>) -> ecm::Axis {
    axis.map_or(ecm::Axis::CSP, |axis| axis.0)
}

#[pymethods]
impl Slave {
    #[staticmethod]
    #[pyo3(signature = (axis = None))]
    fn drive(axis: Option<Axis>) -> Self {
        Self(ecm::Slave::Drive(settings(axis)))
    }

    #[staticmethod]
    #[pyo3(signature = (axis = None))]
    fn step(axis: Option<Axis>) -> Self {
        Self(ecm::Slave::Step(settings(axis)))
    }

    #[staticmethod]
    #[pyo3(signature = (axis = None))]
    fn hsp(axis: Option<Axis>) -> Self {
        Self(ecm::Slave::Hsp(settings(axis)))
    }

    #[staticmethod]
    const fn io() -> Self {
        Self(ecm::Slave::Io)
    }

    #[staticmethod]
    const fn unused() -> Self {
        Self(ecm::Slave::Unused)
    }

    fn __repr__(&self) -> String {
        format!("<Slave {}>", self.0)
    }
}

/// The configuration of the network: its slaves in their order, and the EtherCAT cycle in microseconds.
#[pyclass(frozen, from_py_object, module = "ecmsk")]
#[derive(Clone)]
pub struct Config(pub ecm::Config);

#[pymethods]
impl Config {
    #[new]
    #[pyo3(signature = (slaves, *, cycle_us = 1000))]
    fn new(slaves: Vec<Slave>, cycle_us: u32) -> Self {
        Self(ecm::Config { slaves: slaves.into_iter().map(|slave| slave.0).collect(), cycle_us })
    }

    /// That many drives in CSP.
    #[staticmethod]
    fn drives(count: usize) -> Self {
        // `configure` refuses more slaves than a board can drive. The limit here only keeps a huge number from taking
        // memory.
        Self(ecm::Config::drives(count.min(1000)))
    }

    /// The network of a machine file.
    #[staticmethod]
    fn of_machine(py: Python<'_>, file: PathBuf) -> PyResult<Self> {
        let machine = MachineFile::load(&file).map_err(|error| exception(py, &EcmError::from(error)))?;
        Ok(Self(ecm::Config::of_machine(&machine)))
    }

    #[getter]
    fn slaves(&self) -> Vec<Slave> {
        self.0.slaves.iter().copied().map(Slave).collect()
    }

    #[getter]
    const fn cycle_us(&self) -> u32 {
        self.0.cycle_us
    }

    fn __repr__(&self) -> String {
        let slaves: Vec<String> = self.0.slaves.iter().map(ToString::to_string).collect();
        format!("<Config {}, {} us>", slaves.join(","), self.0.cycle_us)
    }
}

/// Counters since a board was opened.
#[pyclass(frozen, get_all, skip_from_py_object, module = "ecmsk")]
#[derive(Clone, Copy)]
pub struct Stats {
    written: u64,
    reports: u64,
    bad_crc: u64,
    reports_lost: u64,
    stale: u64,
    error_byte_changes: u64,
    losses: u64,
    underruns: u64,
    slaves_failed: u64,
}

impl From<ecm::Stats> for Stats {
    fn from(stats: ecm::Stats) -> Self {
        let ecm::Stats {
            written,
            reports,
            bad_crc,
            reports_lost,
            stale,
            error_byte_changes,
            losses,
            underruns,
            slaves_failed,
        } = stats;
        Self { written, reports, bad_crc, reports_lost, stale, error_byte_changes, losses, underruns, slaves_failed }
    }
}

#[pymethods]
impl Stats {
    fn __repr__(&self) -> String {
        format!(
            "<Stats written={} reports={} bad_crc={} reports_lost={} losses={} underruns={} slaves_failed={}>",
            self.written,
            self.reports,
            self.bad_crc,
            self.reports_lost,
            self.losses,
            self.underruns,
            self.slaves_failed
        )
    }
}
