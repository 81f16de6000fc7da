//! For systems where this library is never unloaded, because it is linked with `nodelete`: the items of `unloadable.rs`,
//! which count calls and references to the module there and do nothing here.

/// Without effect here. On Windows it is a reference to this library's module.
pub struct ModuleReference;

impl ModuleReference {
    pub const fn begin() -> Self {
        Self
    }
}

/// Without effect here. On Windows it counts a call of this library that is under way, so that the library is not
/// unloaded during the call.
pub struct Call;

impl Call {
    pub const fn begin() -> Self {
        Self
    }
}

/// Without effect here. On Windows it keeps the caller's last error; elsewhere a caller looks at `errno` only after a call that
/// is documented to set it.
pub struct LastError;

impl LastError {
    pub const fn keep() -> Self {
        Self
    }
}

pub const fn set_last_error(_code: u32) {}

/// What an exported function that closes a board returns: a result code of the C ABI.
pub type CloseResult = i32;

pub fn close(close: impl FnOnce() -> i32) -> CloseResult {
    close()
}

/// The body of an exported function that closes a board: calls `$close` and nothing else. On Windows it also unloads the
/// library if the closed board held the last reference to it.
macro_rules! close_and_unload {
    ($close:path) => {{
        $close();
    }};
    ($close:path, $argument:ident) => {
        $close($argument)
    };
}
pub(crate) use close_and_unload;
