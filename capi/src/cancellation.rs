//! Cancellation of threads (`pthread_cancel`). A cancelled thread ends by unwinding, at the first function of the system that
//! is a cancellation point. Rust code must not be unwound that way, and a lock that the thread holds would never be released.
//! So every call defers the cancellation, and the thread ends at the first cancellation point after the call.

/// Cancellation is deferred until this is dropped, which restores the caller's state.
pub use state::CancellationDeferred;

#[cfg(all(unix, not(target_os = "android")))]
mod state {
    use std::ffi::c_int;
    use std::ptr::null_mut;

    unsafe extern "C" {
        /// The POSIX function, as `pthread.h` declares it.
        fn pthread_setcancelstate(state: c_int, before: *mut c_int) -> c_int;
    }

    /// The value of `PTHREAD_CANCEL_DISABLE`, which POSIX leaves to the system.
    const DISABLE: c_int = if cfg!(target_vendor = "apple") { 0 } else { 1 };

    pub struct CancellationDeferred {
        before: c_int,
    }

    impl CancellationDeferred {
        /// Defers cancellation from now on.
        pub fn begin() -> Self {
            let mut before = DISABLE;
            // SAFETY: the state is a valid one; `before` receives the present one.
            unsafe { pthread_setcancelstate(DISABLE, &raw mut before) };
            Self { before }
        }
    }

    impl Drop for CancellationDeferred {
        fn drop(&mut self) {
            // SAFETY: the state came from this thread, since the guard does not leave the call that made it.
            unsafe { pthread_setcancelstate(self.before, null_mut()) };
        }
    }
}

/// Android and Windows have no cancellation of threads, so nothing is deferred there.
#[cfg(not(all(unix, not(target_os = "android"))))]
mod state {
    pub struct CancellationDeferred;

    impl CancellationDeferred {
        pub const fn begin() -> Self {
            Self
        }
    }
}
