//! A board: how it is opened, how it is closed while other threads call it, and how a wait is ended.
//!
//! A call holds its own reference to the open board ([`Shared::share`]) while it runs. Closing first makes the board
//! unavailable to new calls and ends the waits of other threads and the stream. Then it waits until no call has a
//! reference any more, which takes as long as a step of a stream at most.
//!
//! A child of fork has copies of the boards of its parent, and none of the threads that serve them. It uses none of them and
//! drops none: to drop a board is to close it, and the connection would still be its parent's.

use std::mem;
use std::path::PathBuf;
use std::process;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread;
use std::time::{Duration, Instant};

use ecmsk::ecm::{Ecm, EcmError, Options};
use ecmsk::link::LinkError;
use ecmsk::link::uri::LinkUri;
use ecmsk::machine_file::MachineFile;
use ecmsk::sk::SlotSize;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{exception, named};
use crate::names::Names;
use crate::stream::StreamCell;
use crate::values::{Close, seconds};
use crate::wait;

/// The interval at which closing checks whether the calls of other threads have ended.
const CALLS_END_PERIOD: Duration = Duration::from_millis(1);
/// How long [`open_when_there`] waits between two checks for signals, so that Ctrl-C ends it soon.
const OPEN_SLICE: Duration = Duration::from_millis(200);

/// The boards of this process, which are closed when it ends.
static BOARDS: Mutex<Vec<Weak<Shared>>> = Mutex::new(Vec::new());

/// Locks a mutex, even if another thread has panicked while it held the lock.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An opened board, and the flag that ends the waits of its threads. The handle of the board and its streams share this
/// value.
pub struct Shared {
    /// The board; `None` once it is closed.
    opened: Mutex<Option<Arc<Ecm>>>,
    /// Whether the waits of all threads are to end.
    is_closing: Arc<AtomicBool>,
    /// The stream that was begun last.
    pub stream: Mutex<Option<Arc<StreamCell>>>,
    /// What happens to the axes when a program closes the board without an argument, or leaves the ``with`` block: the option
    /// ``close`` with which the board was opened.
    close: ecmsk::ecm::Close,
    /// The process that opened the board.
    owner: u32,
}

impl Shared {
    /// Whether this process is a child of the one that opened the board.
    pub fn is_parents(&self) -> bool {
        process::id() != self.owner
    }

    /// The board is used only by the process that opened it.
    pub fn check_process(&self, py: Python<'_>) -> PyResult<()> {
        if !self.is_parents() {
            return Ok(());
        }
        let message = "this process was forked while the board was open; the board belongs to its parent: open the board \
                       after the fork";
        Err(named(py, "ClosedError", message, None, None))
    }

    /// Returns a reference to the open board, which the caller drops when its call ends.
    pub fn share(&self) -> Result<Arc<Ecm>, EcmError> {
        lock(&self.opened).clone().ok_or_else(|| LinkError::Closed.into())
    }

    /// Ends the stream that is open, if there is one: its axes come to a standstill.
    pub fn end_stream(&self) {
        if self.is_parents() {
            return;
        }
        let stream = lock(&self.stream).take();
        if let Some(stream) = stream {
            // An error of the stream is dropped: the caller reports why it ends the stream. If axes still move, closing
            // the board finds that.
            let _ = stream.finish();
        }
    }

    /// Takes the board away from all calls and passes it to `end`. `None` if it was closed before, or is the parent's.
    fn end<T>(&self, end: impl FnOnce(Ecm) -> T) -> Option<T> {
        if self.is_parents() {
            return None;
        }
        let mut opened = lock(&self.opened).take()?;
        self.is_closing.store(true, Ordering::Release);
        loop {
            // The stream is ended in each pass of this loop, since a call of another thread that is still running may
            // just have begun one.
            self.end_stream();
            match Arc::try_unwrap(opened) {
                Ok(ecm) => return Some(end(ecm)),
                Err(shared) => opened = shared,
            }
            thread::sleep(CALLS_END_PERIOD);
        }
    }
}

/// A handle of an open board, which threads may share.
///
/// Axes are numbers of slaves, or names if the board was opened by a machine file. Times are in seconds. Leaving its
/// ``with`` block closes the board, as the option ``close`` says.
#[pyclass(frozen, name = "Ecm", module = "ecmsk")]
pub struct Board {
    pub shared: Arc<Shared>,
    pub names: Names,
    link: String,
    is_virtual: bool,
}

impl Board {
    fn new(ecm: Ecm, names: Names, options: &Options) -> Self {
        let is_closing = Arc::new(AtomicBool::new(false));
        let closing = Arc::clone(&is_closing);
        let info = ecm.link_info();
        let (link, is_virtual) = (info.name.clone(), info.virtual_time);
        let ecm = ecm.with_interrupt(move || wait::is_due(&closing));
        let opened = Mutex::new(Some(Arc::new(ecm)));
        let (stream, close, owner) = (Mutex::new(None), options.close, process::id());
        let shared = Arc::new(Shared { opened, is_closing, stream, close, owner });
        let mut boards = lock(&BOARDS);
        boards.retain(|board| board.strong_count() > 0);
        boards.push(Arc::downgrade(&shared));
        Self { shared, names, link, is_virtual }
    }

    /// Runs a call that waits. If a signal, or a function of the program that the call runs, ends the call with an
    /// exception, the stream of the board is ended first.
    pub fn wait<T: Send>(&self, py: Python<'_>, call: impl FnOnce(&Ecm) -> Result<T, EcmError> + Send) -> PyResult<T> {
        let shared = &self.shared;
        shared.check_process(py)?;
        wait::during(py, || shared.end_stream(), || call(&*shared.share()?))
    }

    /// Ends the board. Inside a call of the board, that is in a handler of signals or in a function of the program that
    /// the call runs, this is an error: it would wait for the call in which it runs.
    fn end(&self, py: Python<'_>, end: impl FnOnce(Ecm) -> Result<(), EcmError> + Send) -> PyResult<()> {
        if wait::is_in_a_call() {
            let message =
                "the board is in use by a call of this thread; raise an exception here, and close the board after it";
            return Err(named(py, "BusyError", message, None, None));
        }
        let ended = py.detach(|| self.shared.end(end));
        ended.unwrap_or(Ok(())).map_err(|error| exception(py, &error))
    }
}

#[pymethods]
impl Board {
    /// The URI of the link in its normal form.
    #[getter]
    fn link(&self) -> &str {
        &self.link
    }

    /// Whether time passes only inside calls.
    #[getter]
    const fn is_virtual(&self) -> bool {
        self.is_virtual
    }

    #[getter]
    fn is_closed(&self) -> bool {
        self.shared.is_parents() || lock(&self.shared.opened).is_none()
    }

    /// Closes the board within 2 s. Calls of other threads end with ``errors.ClosedError``.
    #[pyo3(signature = (how = None))]
    fn close(&self, py: Python<'_>, how: Option<Close>) -> PyResult<()> {
        let how = how.map_or(self.shared.close, Into::into);
        self.end(py, move |ecm| ecm.close(how))
    }

    /// Restarts the board, which closes it. ``open_when_there`` opens it again.
    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        self.shared.check_process(py)?;
        self.shared.share().map_err(|error| exception(py, &error))?;
        self.end(py, Ecm::reset)
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_raised))]
    fn __exit__(&self, py: Python<'_>, _raised: &Bound<'_, pyo3::types::PyTuple>) -> PyResult<()> {
        self.close(py, None)
    }

    fn __repr__(&self) -> String {
        let closed = if self.is_closed() { ", closed" } else { "" };
        format!("<Ecm {}{closed}>", self.link)
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let (shared, close) = (&self.shared, self.shared.close);
        if shared.is_parents() {
            // One reference more than there are: what it refers to is not dropped.
            mem::forget(Arc::clone(shared));
            return;
        }
        // As in Rust, where an error of dropping an `Ecm` is only logged, no exception is raised here. At the end of the
        // interpreter `close_all` has closed the board already.
        Python::try_attach(|py| py.detach(|| shared.end(|ecm| ecm.close(close)).map(drop)));
    }
}

/// Closes all boards of this process that are open: at the end of the program.
#[pyfunction]
pub fn close_all(py: Python<'_>) {
    let boards: Vec<Arc<Shared>> = lock(&BOARDS).iter().filter_map(Weak::upgrade).collect();
    py.detach(|| {
        for shared in boards {
            let close = shared.close;
            shared.end(|ecm| ecm.close(close).ok());
        }
    });
}

/// In a child of fork: closes its copies of the connections and USB devices of its parent's boards.
#[pyfunction]
pub fn forked() {
    // So a server notices the end of the parent. In a child that was forked inside of a call, by a function of the program that the call runs, the call goes on.
    #[cfg(unix)]
    if !wait::is_in_a_call() {
        // SAFETY: this child was just forked, and no call of it reaches a board of its parent from here on.
        unsafe { ecmsk::threads::close_in_child() };
    }
}

/// The options among the keyword arguments of a call.
fn options(given: Option<&Bound<'_, PyDict>>) -> PyResult<Options> {
    let mut options = Options::default();
    for (key, value) in given.into_iter().flatten() {
        let key: String = key.extract()?;
        let limit = || seconds(&key, value.extract()?);
        match key.as_str() {
            "slot" => options.slot = value.extract::<Option<usize>>()?.map(slot_size).transpose()?,
            "strict_crc" => options.strict_crc = value.extract()?,
            "guard" => options.guard = value.extract()?,
            "read_limit" => options.read_limit = limit()?,
            "write_limit" => options.write_limit = limit()?,
            "state_limit" => options.state_limit = limit()?,
            "sdo_limit" => options.sdo_limit = limit()?,
            "servo_limit" => options.servo_limit = limit()?,
            "ramp" => options.ramp = limit()?,
            "close" => options.close = value.extract::<Close>()?.into(),
            _ => return Err(PyTypeError::new_err(format!("there is no option `{key}`; see help(ecmsk.open)"))),
        }
    }
    Ok(options)
}

fn slot_size(bytes: usize) -> PyResult<SlotSize> {
    let size = [SlotSize::Bytes12, SlotSize::Bytes16].into_iter().find(|size| size.bytes() == bytes);
    size.ok_or_else(|| PyValueError::new_err(format!("slot is {bytes}; set 12 or 16")))
}

/// Opens the board at a link URI and leaves it in its present state. Nothing is sent.
#[pyfunction(signature = (uri, **given))]
pub fn open(py: Python<'_>, uri: &str, given: Option<&Bound<'_, PyDict>>) -> PyResult<Board> {
    let options = options(given)?;
    let ecm = py.detach(|| Ecm::open_with(uri, options)).map_err(|error| exception(py, &error))?;
    Ok(Board::new(ecm, Names::default(), &options))
}

/// Opens the board of a machine file, or the one at ``link`` or ``ECMSK_LINK``. Its axes then have names and units.
#[pyfunction(signature = (file, link = None, **given))]
pub fn open_machine(
    py: Python<'_>,
    file: PathBuf,
    link: Option<&str>,
    given: Option<&Bound<'_, PyDict>>,
) -> PyResult<Board> {
    let options = options(given)?;
    let opened = || -> Result<(Ecm, MachineFile), EcmError> {
        let machine = MachineFile::load(&file)?;
        let link = link.map(LinkUri::parse).transpose().map_err(LinkError::from)?;
        let link = Ecm::machine_link(&machine, link.as_ref())?.ok_or_else(|| machine.names_no_link())?;
        Ok((Ecm::open_with(&link.to_string(), options)?, machine))
    };
    let (ecm, machine) = py.detach(opened).map_err(|error| exception(py, &error))?;
    Ok(Board::new(ecm, Names(Some(Arc::new(machine))), &options))
}

/// Opens a board as soon as it is available, and says how many seconds that took.
#[pyfunction(signature = (uri, limit, **given))]
pub fn open_when_there(
    py: Python<'_>,
    uri: &str,
    limit: f64,
    given: Option<&Bound<'_, PyDict>>,
) -> PyResult<(Board, f64)> {
    let (options, limit) = (options(given)?, seconds("limit", limit)?);
    let is_virtual = LinkUri::parse(uri).is_ok_and(|uri| uri.value("clock") == Some("virtual"));
    let began = Instant::now();
    loop {
        let waited = if is_virtual { Duration::ZERO } else { began.elapsed() };
        let left = limit.saturating_sub(waited);
        let slice = if is_virtual { left } else { left.min(OPEN_SLICE) };
        match py.detach(|| Ecm::open_when_there(uri, options, slice)) {
            Ok((ecm, took)) => {
                return Ok((Board::new(ecm, Names::default(), &options), (waited + took).as_secs_f64()));
            }
            Err(EcmError::Timeout { .. }) if slice < left => py.check_signals()?,
            Err(EcmError::Timeout { what, waited: last, seen, hint }) => {
                return Err(exception(py, &EcmError::Timeout { what, waited: waited + last, seen, hint }));
            }
            Err(error) => return Err(exception(py, &error)),
        }
    }
}
