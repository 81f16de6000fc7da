//! Identifies the thread that holds a lock or does work that other threads wait for. A program may end such a thread by
//! force: a watchdog may end a thread that waits in a read (`TerminateThread`), and a signal handler may end the thread
//! that it has interrupted. Another thread then takes over the work that the ended thread has begun in this crate.

/// The identity of a thread that is in a call of this crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CallingThread(imp::Thread);

impl CallingThread {
    /// The identity of the thread that calls this function.
    pub fn current() -> Self {
        Self(imp::Thread::current())
    }

    /// Whether the thread with this identity has ended.
    pub fn is_gone(&self) -> bool {
        self.0.is_gone()
    }
}

#[cfg(windows)]
impl CallingThread {
    /// The identity as one 64-bit word for an atomic. It is never 0, so that 0 can stand for no thread.
    pub const fn packed(self) -> u64 {
        (self.0.number as u64) << 32 | self.0.made as u64
    }

    /// Unpacks the result of [`packed`](Self::packed).
    pub const fn from_packed(packed: u64) -> Self {
        Self(imp::Thread { number: (packed >> 32) as u32, made: packed as u32 })
    }
}

#[cfg(target_os = "linux")]
mod imp {
    use rustix::io::Errno;
    use rustix::thread::Pid;

    /// A thread by its id. Linux gives an id to another thread only after all other ids were used, so an id that still exists
    /// is taken to be the same thread.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct Thread(Pid);

    impl Thread {
        // The id is not cached: in a child process of fork the cached id would be that of the parent's thread.
        pub fn current() -> Self {
            Self(rustix::thread::gettid())
        }

        pub fn is_gone(self) -> bool {
            let process = rustix::process::getpid().as_raw_nonzero().get();
            // SAFETY: signal 0 is not delivered; the call only checks whether the thread exists.
            let found = unsafe { libc::syscall(libc::SYS_tgkill, process, self.0.as_raw_nonzero().get(), 0) };
            found != 0 && std::io::Error::last_os_error().raw_os_error() == Some(Errno::SRCH.raw_os_error())
        }
    }
}

#[cfg(windows)]
mod imp {
    use std::cell::Cell;
    use std::ffi::c_void;
    use std::ptr;

    type Handle = *mut c_void;

    /// `SYNCHRONIZE | THREAD_QUERY_LIMITED_INFORMATION`: access for waiting for a thread and for reading its creation
    /// time.
    const ACCESS: u32 = 0x0010_0800;

    /// `ERROR_INVALID_PARAMETER`: no thread has the id.
    const NO_SUCH_THREAD: u32 = 87;

    /// A thread by its id and its creation time. Windows may soon give the id to a new thread, which then has another
    /// creation time.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct Thread {
        pub number: u32,
        /// The lower 32 bits of the creation time, in units of 100 ns, which repeat after seven minutes. Only a thread with the
        /// same id that was created a multiple of that time later would be mistaken for this one.
        pub made: u32,
    }

    impl Thread {
        pub fn current() -> Self {
            thread_local! {
                static OWN: Cell<Option<Thread>> = const { Cell::new(None) };
            }
            OWN.get().unwrap_or_else(|| {
                // SAFETY: the functions have no safety conditions; the handle stands for the calling thread and need not be
                // closed.
                let own = unsafe { Self { number: GetCurrentThreadId(), made: made(GetCurrentThread()) } };
                OWN.set(Some(own));
                own
            })
        }

        pub fn is_gone(self) -> bool {
            // SAFETY: the functions have no safety conditions; the handle is closed once.
            unsafe {
                let handle = OpenThread(ACCESS, 0, self.number);
                if handle.is_null() {
                    // After any other error, such as missing rights, memory or handles, the thread may still exist.
                    return GetLastError() == NO_SUCH_THREAD;
                }
                // The handle of a thread that has ended is signalled, so that the wait returns 0. A different creation
                // time means that another thread has the id now.
                let gone = WaitForSingleObject(handle, 0) == 0 || made(handle) != self.made;
                CloseHandle(handle);
                gone
            }
        }
    }

    /// The lower 32 bits of a thread's creation time.
    ///
    /// # Safety
    /// `thread` is the handle of a thread.
    unsafe fn made(thread: Handle) -> u32 {
        let mut times = [0_u64; 4];
        let [made, ended, kernel, user] = &mut times;
        // SAFETY: each element of `times` has room for one FILETIME of 8 bytes.
        unsafe {
            GetThreadTimes(
                thread,
                ptr::from_mut(made),
                ptr::from_mut(ended),
                ptr::from_mut(kernel),
                ptr::from_mut(user),
            )
        };
        times[0] as u32
    }

    #[link(name = "kernel32")]
    unsafe extern "system" {
        fn GetCurrentThreadId() -> u32;
        fn GetCurrentThread() -> Handle;
        fn OpenThread(access: u32, inherit: i32, number: u32) -> Handle;
        fn WaitForSingleObject(handle: Handle, limit_ms: u32) -> u32;
        fn GetThreadTimes(thread: Handle, made: *mut u64, ended: *mut u64, kernel: *mut u64, user: *mut u64) -> i32;
        fn CloseHandle(handle: Handle) -> i32;
        fn GetLastError() -> u32;
    }
}

/// On other systems nothing shows whether a thread has ended, so every thread counts as still there.
#[cfg(not(any(target_os = "linux", windows)))]
mod imp {
    use std::thread::{self, ThreadId};

    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct Thread(ThreadId);

    impl Thread {
        pub fn current() -> Self {
            Self(thread::current().id())
        }

        pub const fn is_gone(self) -> bool {
            false
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;
    use std::thread;

    use super::*;

    /// LIB-70 `is_gone` is false while a thread runs and true once it has ended.
    #[test]
    fn a_thread_that_has_ended_is_gone() {
        let (caller, told) = mpsc::channel();
        let (ends, wait) = mpsc::channel::<()>();
        let other = thread::spawn(move || {
            caller.send(CallingThread::current()).expect("the test waits for it");
            let _ = wait.recv();
        });
        let other_caller = told.recv().expect("it tells");
        assert!(!other_caller.is_gone() && !CallingThread::current().is_gone());
        assert_ne!(other_caller, CallingThread::current());
        drop(ends);
        other.join().expect("no panic");
        #[cfg(any(target_os = "linux", windows))]
        while !other_caller.is_gone() {
            thread::yield_now();
        }
        assert!(!CallingThread::current().is_gone());
    }
}
