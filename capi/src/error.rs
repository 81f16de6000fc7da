//! Why a call failed, and the error text that a program can get.

use std::cell::{Cell, RefCell};
use std::ffi::c_char;

use ecmsk::link::LinkError;
use ecmsk::link::config::Source;
use ecmsk::machine_file::MachineFileError;
use ecmsk::threads::sync::{Mutex, lock};

use crate::forked;

/// Why a call of the C ABI failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CallError {
    /// A pointer is NULL.
    #[error("`{argument}` is NULL; pass the address of {expected}")]
    Null {
        /// The name of the argument in the C function that was called.
        argument: &'static str,
        /// What the pointer should point to.
        expected: &'static str,
    },
    /// The length of a buffer is 0.
    #[error("the length is 0; pass that of a frame, 504 or 512")]
    NoBytes,
    /// A text is not UTF-8.
    #[error("`{argument}` is not UTF-8")]
    NotText {
        /// The name of the argument in the C function that was called.
        argument: &'static str,
    },
    /// The `size` of a structure was not set by the caller, or is too small.
    #[error("`size` of the structure is {found}, less than {least}; set it to sizeof of the structure before the call")]
    StructSize {
        /// The value of `size` that the caller has set, in bytes.
        found: u32,
        /// The smallest valid value of `size`, in bytes.
        least: usize,
    },
    /// A timeout is negative and none of the constants.
    #[error("a timeout of {found} ms; pass 0 or more, ECMSK_WAIT_FOREVER (-1) or ECMSK_WAIT_LINK (-2)")]
    Timeout {
        /// The invalid value that the caller has passed.
        found: i64,
    },
    /// The vendor's functions were called before OpenECMUSB or after CloseECMUSB.
    #[error("no board is open; call OpenECMUSB first and check that it returns true")]
    NotOpen,
    /// The process was forked while a board was open, or was being opened or closed.
    #[error(
        "this process was forked while a board was open, or was being opened or closed; the board belongs to its \
         parent: fork before OpenECMUSB, or let the child exec"
    )]
    Forked,
    /// No open board has this handle.
    #[error("no open board has the handle {handle:#x}; it was closed, or never came from ecmsk_open")]
    Handle {
        /// The invalid value that the caller has passed.
        handle: usize,
    },
    /// No open machine file has this handle.
    #[error("no open machine file has the handle {handle:#x}; it was closed, or never came from ecmsk_machine_open")]
    MachineHandle {
        /// The invalid value that the caller has passed.
        handle: usize,
    },
    /// The machine file cannot be used.
    #[error(transparent)]
    Machine(MachineFileError),
    /// The machine file has no axis, input or output of this name, or no axis of this index.
    #[error("{file} has no {what}; it has {there}")]
    NotInMachine {
        /// The path of the machine file.
        file: String,
        /// The axis, input or output that the caller has named.
        what: String,
        /// The names that the file has.
        there: String,
    },
    /// A number is NaN.
    #[error("`{argument}` is not a number (NaN); pass a number")]
    NotANumber {
        /// The name of the argument in the C function that was called.
        argument: &'static str,
    },
    /// The link cannot read the counters that a board keeps of frames and commands; only the modelled board has them.
    #[error("`{link}` does not show the board's counters; a simulated board does")]
    NoCounters {
        /// The URI of the link.
        link: String,
    },
    /// The link that the configuration names cannot be opened.
    #[error("link {from}: {error}")]
    Configured {
        /// Where the link is configured: a variable, a file, or the default.
        from: Source,
        /// Why the link cannot be opened.
        error: Box<LinkError>,
    },
    /// The link reports an error, such as a timeout or a lost board.
    #[error(transparent)]
    Link(LinkError),
    /// The system has no memory for the call.
    #[error("there is no memory for this call; end other programs, or raise the limit of this one (ulimit -v)")]
    Memory,
    /// A panic in this library, which is a defect; its message.
    #[error("internal error: {0}; please report it with the output of ECMSK_LOG=trace")]
    Panic(String),
}

/// Errors are boxed. Otherwise every `Result` would be as large as the largest error, and calls that succeed would move it from
/// function to function too.
impl From<LinkError> for Box<CallError> {
    fn from(error: LinkError) -> Self {
        Self::new(CallError::Link(error))
    }
}

/// The maximum length of an error text in bytes, with its terminating 0; a longer text is cut.
const TEXT_LEN: usize = 2048;

/// An error text as a C string, with its terminating 0.
type Text = [u8; TEXT_LEN];

thread_local! {
    /// The error text that [`last`] returns to this thread. Its address is the same until the thread ends.
    static TEXT_OF_THREAD: RefCell<Text> = const { RefCell::new([0; TEXT_LEN]) };
    /// Whether a call of this thread has failed. Then `TEXT_OF_THREAD` holds the text of that error, and not that of
    /// another thread's OpenECMUSB.
    static HAS_OWN_ERROR: Cell<bool> = const { Cell::new(false) };
}

/// The text of the last OpenECMUSB that failed in any thread, for threads in which no call has failed.
static LAST_OPEN: Mutex<Text> = Mutex::new([0; TEXT_LEN]);

/// Keeps the text of an error of this thread for [`last`].
pub fn remember(error: &CallError) {
    TEXT_OF_THREAD.with_borrow_mut(|text| write(text, error));
    HAS_OWN_ERROR.set(true);
}

/// Keeps the text of a failed OpenECMUSB for [`last`] in every thread.
pub fn remember_open(error: &CallError) {
    write(&mut lock(&LAST_OPEN), error);
}

/// The text of this thread's last error. If it had none it is that of the last OpenECMUSB that failed in any thread, or else
/// empty.
///
/// The address is always the same for a thread. The text there changes with the thread's next error and, before its first
/// error, with each call of this function.
pub fn last() -> *const c_char {
    TEXT_OF_THREAD.with(|text| {
        // In a child of fork the lock may be held by a thread that exists only in the parent. It would never be released,
        // so it is not taken.
        if !HAS_OWN_ERROR.get() && !forked::is_forked() {
            *text.borrow_mut() = *lock(&LAST_OPEN);
        }
        text.as_ptr().cast_const().cast()
    })
}

fn write(text: &mut Text, error: &CallError) {
    let message = error.to_string().replace('\0', "");
    let length = message.floor_char_boundary(TEXT_LEN - 1);
    text[..length].copy_from_slice(&message.as_bytes()[..length]);
    text[length..].fill(0);
}
