//! Waits without Python's lock, so that other threads run, and what ends them: a signal (Ctrl-C), an exception in the
//! program's own function, and another thread that closes the board.
//!
//! While a call waits, the library asks [`is_due`] between two reports, without any lock. That runs Python's handlers of
//! signals. If one raises an exception, usually KeyboardInterrupt, the library first undoes what the call has begun: it
//! aborts a homing, and switches off axes that it was switching on. Then the exception ends the call.

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ecmsk::ecm::EcmError;
use ecmsk::link::LinkError;
use pyo3::prelude::*;

use crate::errors::exception;

/// The minimum time between two runs of the handlers of signals during a wait. In virtual time there are a hundred
/// thousand reports a second: checking for signals after each of them would slow the wait down.
const SIGNAL_CHECK_PERIOD: Duration = Duration::from_millis(20);

/// A call that waits in a thread.
struct Waiting {
    /// When handlers of signals ran last.
    checked: Instant,
    /// The exception that a handler of signals, or a function of the program that the call runs, has raised.
    raised: Option<PyErr>,
    /// Whether the wait was told to end. Then what the library does to undo the call is not interrupted any more.
    is_over: bool,
}

thread_local! {
    /// The calls of this thread: more than one if a handler of signals, or a function of the program that a call runs,
    /// has made a call itself.
    static CALLS: RefCell<Vec<Waiting>> = const { RefCell::new(Vec::new()) };
}

/// An entry in the list of calls of this thread. Dropping it removes the entry, also if the call panics.
struct Call;

impl Call {
    fn begin() -> Self {
        let waiting = Waiting { checked: Instant::now(), raised: None, is_over: false };
        CALLS.with_borrow_mut(|calls| calls.push(waiting));
        Self
    }

    fn raised() -> Option<PyErr> {
        CALLS.with_borrow_mut(|calls| calls.last_mut().and_then(|call| call.raised.take()))
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        CALLS.with_borrow_mut(|calls| calls.pop());
    }
}

/// Whether this thread is inside a call of a board: then this code runs in a handler of signals, or in a function of the
/// program that the call runs.
pub fn is_in_a_call() -> bool {
    CALLS.with_borrow(|calls| !calls.is_empty())
}

/// Runs a call of a board that waits. If a handler of signals, or a function of the program that the call runs, has raised an
/// exception meanwhile, the exception is raised instead of returning the call's result. Before that, `stop` is called: it has
/// to stop axes that the call itself does not stop, which are those of an open stream.
pub fn during<T: Send>(
    py: Python<'_>,
    stop: impl FnOnce() + Send,
    call: impl FnOnce() -> Result<T, EcmError> + Send,
) -> PyResult<T> {
    let (result, raised) = py.detach(|| {
        let running = Call::begin();
        let result = call();
        let raised = Call::raised();
        drop(running);
        if raised.is_some() {
            stop();
        }
        (result, raised)
    });
    if let Some(raised) = raised {
        return Err(raised);
    }
    result.map_err(|error| match error {
        // No exception was raised, so the wait was interrupted because another thread closes the board.
        EcmError::Interrupted => exception(py, &LinkError::Closed.into()),
        error => exception(py, &error),
    })
}

/// Whether the wait of this thread is to end: asked by the library.
pub fn is_due(is_closing: &AtomicBool) -> bool {
    let now = Instant::now();
    let may_check = CALLS.with_borrow_mut(|calls| {
        let call = calls.last_mut().filter(|call| !call.is_over)?;
        if call.raised.is_some() || is_closing.load(Ordering::Acquire) {
            call.is_over = true;
            return Some(false);
        }
        let is_time = now.duration_since(call.checked) >= SIGNAL_CHECK_PERIOD;
        if is_time {
            call.checked = now;
        }
        is_time.then_some(true)
    });
    match may_check {
        None => false,
        Some(false) => true,
        // A handler may call the board itself, so the list of calls is free meanwhile.
        Some(true) => match Python::attach(|py| py.check_signals()) {
            Ok(()) => false,
            Err(error) => {
                raise(error);
                CALLS.with_borrow_mut(|calls| calls.last_mut().map(|call| call.is_over = true));
                true
            }
        },
    }
}

/// Ends the wait of this thread with an exception, the first one if there are several.
pub fn raise(error: PyErr) {
    CALLS.with_borrow_mut(|calls| {
        if let Some(call) = calls.last_mut() {
            call.raised.get_or_insert(error);
        }
    });
}
