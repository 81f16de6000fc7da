//! A stream of targets. The stream has a reference to its board, and the board has one to its newest stream: so the end
//! of the stream releases the board, and closing the board ends the stream.

use std::mem;
use std::sync::{Arc, Mutex};

use ecmsk::ecm::{self, Ecm, EcmError};
use ecmsk::sk::AxisTarget;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use self_cell::self_cell;

use crate::board::{Board, Shared, lock};
use crate::errors::{exception, named};
use crate::names::Names;
use crate::snapshot::Snapshot;

type Running<'a> = Option<ecm::Stream<'a>>;

self_cell!(
    /// A stream together with the reference to the board from which it borrows.
    struct OwnedStream {
        owner: Arc<Ecm>,
        #[covariant]
        dependent: Running,
    }
);

/// Counters of a stream.
#[pyclass(frozen, get_all, skip_from_py_object, module = "ecmsk")]
#[derive(Clone, Copy)]
pub struct StreamStats {
    frames: u64,
    /// Cycles that found the FIFO empty; each is a gap in the motion.
    underruns: u64,
    losses: u64,
}

impl From<ecm::StreamStats> for StreamStats {
    fn from(ecm::StreamStats { frames, underruns, losses }: ecm::StreamStats) -> Self {
        Self { frames, underruns, losses }
    }
}

#[pymethods]
impl StreamStats {
    fn __repr__(&self) -> String {
        format!("<StreamStats frames={} underruns={} losses={}>", self.frames, self.underruns, self.losses)
    }
}

/// A running stream, or the counters of one that has ended.
enum Life {
    Open(OwnedStream),
    Ended(ecm::StreamStats),
}

/// A stream that several threads may use.
pub struct StreamCell(Mutex<Life>);

impl StreamCell {
    /// Ends the stream, if it has not ended yet. Returns its counters.
    pub fn finish(&self) -> Result<ecm::StreamStats, EcmError> {
        let mut life = lock(&self.0);
        match &mut *life {
            Life::Ended(stats) => Ok(*stats),
            Life::Open(open) => {
                let so_far = open.borrow_dependent().as_ref().and_then(|stream| stream.stats().ok());
                let finished = open.with_dependent_mut(|_, stream| stream.take().map(ecm::Stream::finish));
                let ended = finished.unwrap_or_else(|| Ok(so_far.unwrap_or_default()));
                // The stream has ended even if an axis could not be brought to a standstill: the reference to the board
                // is dropped.
                *life = Life::Ended(ended.as_ref().copied().unwrap_or(so_far.unwrap_or_default()));
                ended
            }
        }
    }
}

/// A stream of targets for all axes, one frame for each step.
///
/// Set targets, then call ``step``, which sends them and waits at the pace of the board. Leaving its ``with`` block ends
/// the stream as ``finish`` does: the axes come to a standstill and stay enabled.
#[pyclass(frozen, module = "ecmsk")]
pub struct Stream {
    cell: Arc<StreamCell>,
    shared: Arc<Shared>,
    names: Names,
}

impl Stream {
    /// Runs `call` on the open stream without Python's lock, so that other threads run meanwhile. An ended stream is an
    /// exception.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        call: impl FnOnce(&mut ecm::Stream<'_>) -> Result<T, EcmError> + Send,
    ) -> PyResult<T> {
        self.shared.check_process(py)?;
        let done = py.detach(|| match &mut *lock(&self.cell.0) {
            Life::Open(open) => open.with_dependent_mut(|_, stream| stream.as_mut().map(call)),
            Life::Ended(_) => None,
        });
        match done {
            Some(done) => done.map_err(|error| exception(py, &error)),
            None => {
                Err(named(py, "ClosedError", "the stream has ended; begin another one with Ecm.stream", None, None))
            }
        }
    }

    fn end(&self, py: Python<'_>) -> PyResult<StreamStats> {
        self.shared.check_process(py)?;
        let ended = py.detach(|| self.cell.finish());
        ended.map(StreamStats::from).map_err(|error| exception(py, &error))
    }
}

#[pymethods]
impl Board {
    /// Begins a stream that keeps up to ``depth`` frames waiting in the board's FIFO; with ``prefill`` nothing moves
    /// before that many wait.
    #[pyo3(signature = (depth, *, prefill = None))]
    fn stream(&self, py: Python<'_>, depth: u16, prefill: Option<u16>) -> PyResult<Stream> {
        let shared = &self.shared;
        let cell = self.wait(py, |_| {
            let mut owned = OwnedStream::try_new(shared.share()?, |ecm| ecm.stream(depth).map(Some))?;
            if let Some(frames) = prefill {
                owned
                    .with_dependent_mut(|_, stream| stream.as_mut().map_or(Ok(()), |stream| stream.prefill(frames)))?;
            }
            let cell = Arc::new(StreamCell(Mutex::new(Life::Open(owned))));
            *lock(&shared.stream) = Some(Arc::clone(&cell));
            Ok(cell)
        })?;
        Ok(Stream { cell, shared: Arc::clone(shared), names: self.names.clone() })
    }
}

#[pymethods]
impl Stream {
    /// Sets the next target position in CSP, counts.
    fn csp(&self, axis: &Bound<'_, PyAny>, target: i32) -> PyResult<()> {
        let slave = self.names.slave(axis)?;
        self.with(axis.py(), |stream| stream.csp(slave, target))
    }

    /// Sets the next target position in CSP, in the units of the axis.
    fn csp_units(&self, axis: &Bound<'_, PyAny>, units: f64) -> PyResult<()> {
        let slave = self.names.slave(axis)?;
        self.with(axis.py(), |stream| stream.csp_units(slave, units))
    }

    /// Sets the next target velocity in CSV, in the drive's units.
    fn csv(&self, axis: &Bound<'_, PyAny>, velocity: i32) -> PyResult<()> {
        let slave = self.names.slave(axis)?;
        self.with(axis.py(), |stream| stream.csv(slave, velocity))
    }

    /// Sets the next target torque in CST, 0.1 % of the rated torque.
    fn cst(&self, axis: &Bound<'_, PyAny>, torque: i16) -> PyResult<()> {
        let slave = self.names.slave(axis)?;
        self.with(axis.py(), |stream| stream.cst(slave, torque))
    }

    /// Sets the next target and outputs of both channels of a pulse module in CSP.
    fn csp_hsp(&self, axis: &Bound<'_, PyAny>, first: (i32, u16), second: (i32, u16)) -> PyResult<()> {
        let slave = self.names.slave(axis)?;
        self.with(axis.py(), |stream| stream.csp_hsp(slave, channel(first), channel(second)))
    }

    /// Sets the next velocity and outputs of both channels of a pulse module in CSV.
    fn csv_hsp(&self, axis: &Bound<'_, PyAny>, first: (i32, u16), second: (i32, u16)) -> PyResult<()> {
        let slave = self.names.slave(axis)?;
        self.with(axis.py(), |stream| stream.csv_hsp(slave, channel(first), channel(second)))
    }

    /// Writes the next frame once fewer than ``depth`` frames wait in the board's FIFO.
    fn step(&self, py: Python<'_>) -> PyResult<StreamStats> {
        let stats = self.with(py, |stream| stream.step())?;
        if let Err(raised) = py.check_signals() {
            py.detach(|| self.shared.end_stream());
            return Err(raised);
        }
        Ok(stats.into())
    }

    /// The newest report.
    fn snapshot(&self, py: Python<'_>) -> PyResult<Snapshot> {
        let snapshot = self.with(py, |stream| stream.snapshot())?;
        Ok(Snapshot { snapshot, names: self.names.clone() })
    }

    /// The counters of the stream so far, also after its end.
    fn stats(&self, py: Python<'_>) -> PyResult<StreamStats> {
        self.shared.check_process(py)?;
        let ended = py.detach(|| match &*lock(&self.cell.0) {
            Life::Ended(stats) => Some(*stats),
            Life::Open(_) => None,
        });
        match ended {
            Some(stats) => Ok(stats.into()),
            None => self.with(py, |stream| stream.stats()).map(StreamStats::from),
        }
    }

    /// Ends the stream within 2 s. It may be called again, and then gives the same counters.
    fn finish(&self, py: Python<'_>) -> PyResult<StreamStats> {
        self.end(py)
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_raised))]
    fn __exit__(&self, py: Python<'_>, _raised: &Bound<'_, PyTuple>) -> PyResult<()> {
        // A child of fork leaves the block, too: the stream is its parent's.
        if self.shared.is_parents() { Ok(()) } else { self.end(py).map(drop) }
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        // As in Rust, where an error of dropping a stream is only logged, no exception is raised here.
        let cell = &self.cell;
        if self.shared.is_parents() {
            // One reference more than there are: what they refer to is not dropped.
            mem::forget((Arc::clone(cell), Arc::clone(&self.shared)));
            return;
        }
        Python::try_attach(|py| py.detach(|| cell.finish().map(drop)));
    }
}

const fn channel((target, outputs): (i32, u16)) -> AxisTarget {
    AxisTarget { target, outputs }
}
