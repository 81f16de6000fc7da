//! Why a call failed, and the text of it that a program can ask for.

use std::cell::{Cell, RefCell};
use std::ffi::c_char;
use std::sync::{Mutex, MutexGuard, PoisonError};

use ecmsk::link::LinkError;
use ecmsk::link::config::Source;

use crate::shutdown;

/// Why a call of the C ABI failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CallError {
    /// A pointer that must point somewhere.
    #[error("`{argument}` is NULL; pass the address of {expected}")]
    Null {
        /// Name of the argument.
        argument: &'static str,
        /// What it should point to.
        expected: &'static str,
    },
    /// A buffer of no bytes.
    #[error("the length is 0; pass that of a frame, 504 or 512")]
    NoBytes,
    /// Text that is not UTF-8.
    #[error("`{argument}` is not UTF-8")]
    NotText {
        /// Name of the argument.
        argument: &'static str,
    },
    /// A structure whose `size` is not set.
    #[error("`size` of the structure is {found}, less than {least}; set it to sizeof of the structure before the call")]
    StructSize {
        /// What the caller wrote there.
        found: u32,
        /// The least that makes sense.
        least: usize,
    },
    /// A timeout that is none.
    #[error("a timeout of {found} ms; pass 0 or more, ECMSK_WAIT_FOREVER (-1) or ECMSK_WAIT_LINK (-2)")]
    Timeout {
        /// What the caller passed.
        found: i64,
    },
    /// The vendor's functions, before OpenECMUSB or after CloseECMUSB.
    #[error("no board is open; call OpenECMUSB first and look whether it returns true")]
    NotOpen,
    /// The process was forked while a board was open, or was being opened or closed.
    #[error(
        "this process was forked while a board was open, or was being opened or closed; the board is its parent's: fork \
         before OpenECMUSB, or let the child exec"
    )]
    Forked,
    /// A handle that no board has, or no longer.
    #[error("no open board has the handle {handle:#x}; it was closed, or never came from ecmsk_open")]
    Handle {
        /// The value passed.
        handle: usize,
    },
    /// The link sees no counters of the board.
    #[error("`{link}` does not show the board's counters; a simulated board does")]
    NoCounters {
        /// Name of the link.
        link: String,
    },
    /// The link that the configuration names does not open.
    #[error("link {from}: {error}")]
    Configured {
        /// Who named it.
        from: Source,
        /// Why.
        error: Box<LinkError>,
    },
    /// The link failed.
    #[error(transparent)]
    Link(LinkError),
    /// A defect of this library.
    #[error("internal error: {0}; please report it with the output of ECMSK_LOG=trace")]
    Panic(String),
}

/// Boxed wherever it is handed on: a call that succeeds then moves a pointer from function to function.
impl From<LinkError> for Box<CallError> {
    fn from(error: LinkError) -> Self {
        Self::new(CallError::Link(error))
    }
}

/// Room for the text of an error, its 0 included; a longer one is cut.
const TEXT_LEN: usize = 2048;

/// A text as C has it.
type Text = [u8; TEXT_LEN];

thread_local! {
    /// What this thread is told. It stays where it is until the thread ends.
    static THIS_THREAD: RefCell<Text> = const { RefCell::new([0; TEXT_LEN]) };
    /// Whether that is an error of its own.
    static OWN: Cell<bool> = const { Cell::new(false) };
}

/// What the last OpenECMUSB that failed said, whichever thread it was.
static LAST_OPEN: Mutex<Text> = Mutex::new([0; TEXT_LEN]);

/// Keeps the error for [`last`].
pub fn remember(error: &CallError) {
    THIS_THREAD.with_borrow_mut(|text| write(text, error));
    OWN.set(true);
}

/// Keeps the error of an OpenECMUSB for every thread.
pub fn remember_open(error: &CallError) {
    write(&mut lock(&LAST_OPEN), error);
}

/// The text of this thread's last error; if it had none, of the last OpenECMUSB that failed; else empty.
///
/// Always at the same place for a thread, where its next error is written too and, before it has one, what the next
/// call of this tells.
pub fn last() -> *const c_char {
    THIS_THREAD.with(|text| {
        // In a child of fork nobody may be left to release the lock.
        if !OWN.get() && !shutdown::is_forked() {
            *text.borrow_mut() = *lock(&LAST_OPEN);
        }
        text.as_ptr().cast_const().cast()
    })
}

fn write(text: &mut Text, error: &CallError) {
    let said = error.to_string().replace('\0', "");
    let length = said.floor_char_boundary(TEXT_LEN - 1);
    text[..length].copy_from_slice(&said.as_bytes()[..length]);
    text[length..].fill(0);
}

/// Locks, also after a panic of another holder: what these locks guard is whole between any two statements.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
