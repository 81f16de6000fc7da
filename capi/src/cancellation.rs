//! Threads that the program cancels (`pthread_cancel`): what a call does meanwhile is done whole. A thread is ended at the
//! first function of the system that may wait, by unwinding, which Rust code does not survive; a lock that it held, or a
//! board that it was about to open or close, would stay as it was then. So every call puts the cancellation off, and the
//! thread ends at the first such function of the program's own after the call.

/// The caller's state; it is put back when this is dropped.
pub use state::Uncancelled;

#[cfg(all(unix, not(target_os = "android")))]
mod state {
    use std::ffi::c_int;
    use std::ptr::null_mut;

    unsafe extern "C" {
        /// POSIX, `pthread.h`.
        fn pthread_setcancelstate(state: c_int, before: *mut c_int) -> c_int;
    }

    /// `PTHREAD_CANCEL_DISABLE`
    const DISABLE: c_int = if cfg!(target_vendor = "apple") { 0 } else { 1 };

    pub struct Uncancelled {
        before: c_int,
    }

    impl Uncancelled {
        /// Puts cancellations off.
        pub fn begin() -> Self {
            let mut before = DISABLE;
            // SAFETY: the state is one of the two that there are; `before` takes the other one, or the same.
            unsafe { pthread_setcancelstate(DISABLE, &raw mut before) };
            Self { before }
        }
    }

    impl Drop for Uncancelled {
        fn drop(&mut self) {
            // SAFETY: it is the state of this thread before: the guard stays in the call that made it.
            unsafe { pthread_setcancelstate(self.before, null_mut()) };
        }
    }
}

/// Android's and Windows' threads are not cancelled.
#[cfg(not(all(unix, not(target_os = "android"))))]
mod state {
    /// Nothing is to be done.
    pub struct Uncancelled;

    impl Uncancelled {
        /// Nothing is to be done.
        pub const fn begin() -> Self {
            Self
        }
    }
}
