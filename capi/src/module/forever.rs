//! The module stays loaded: the linker is told so, and nothing is to be done while a board is open.

/// Keeps this library in memory.
pub struct Stay;

impl Stay {
    /// Nothing is to be done.
    pub const fn begin() -> Self {
        Self
    }
}

/// A call.
pub struct Call;

impl Call {
    /// It comes in.
    pub const fn begin() -> Self {
        Self
    }
}

/// What the system's calls leave behind is the caller's to look at after a failure alone.
pub struct LastError;

impl LastError {
    /// Nothing is to be done.
    pub const fn keep() -> Self {
        Self
    }
}

/// The code of an error that the caller may ask the system for: there is none here.
pub const fn set_last_error(_code: u32) {}

/// What an exported function that closes a board leaves with: a code of the C ABI.
pub type Leaving = i32;

/// Runs `close`.
pub fn close(close: impl FnOnce() -> i32) -> Leaving {
    close()
}

/// The body of an exported function that closes a board, given the function which does so.
macro_rules! leaving {
    ($close:path) => {{
        $close();
    }};
    ($close:path, $argument:ident) => {
        $close($argument)
    };
}
pub(crate) use leaving;
