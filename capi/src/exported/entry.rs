//! The wrapper in which every exported function runs.

use std::any::Any;
use std::fmt::{Arguments, Debug};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;

use ecmsk::summary::writer;

use crate::cancellation::CancellationDeferred;
use crate::error::{self, CallError};
use crate::floating_point::FloatingPoint;
use crate::forked::{self, MayHoldLock};
use crate::logger;
use crate::memory;
use crate::module::{Call, LastError};
use crate::program_clock::InLibrary;

/// Runs the body of an exported function: `entry!(ECMUSBRead(dwlength), { ... })`.
///
/// The body returns a `Result<T, Box<CallError>>`, and so does the macro. A panic in the body becomes [`CallError::Panic`]. An
/// error is kept for `ecmsk_last_error`. The call is traced with the named arguments, which must not be pointers.
macro_rules! entry {
    ($name:ident($($argument:ident),*), $body:block) => {
        $crate::exported::entry::enter(
            format_args!(concat!(stringify!($name), "(", $(stringify!($argument), "={:?} ",)* ")"), $($argument),*),
            || $body,
        )
    };
}
pub(crate) use entry;

/// The function behind [`entry!`]: `call` is the exported function's name with its arguments, for the trace, and `body` is the
/// block of the macro.
pub fn enter<T: Debug>(
    call: Arguments<'_>,
    body: impl FnOnce() -> Result<T, Box<CallError>>,
) -> Result<T, Box<CallError>> {
    let _call = Call::begin();
    guard(call, body)
}

/// Runs `body` as [`entry!`] does, but does not count the call as under way. [`module::close`](crate::module::close) counts the
/// calls that close a board, since it has to know whether another call is under way.
pub fn guard<T: Debug>(
    call: Arguments<'_>,
    body: impl FnOnce() -> Result<T, Box<CallError>>,
) -> Result<T, Box<CallError>> {
    if forked::is_forked() {
        // This process is a child of fork. No lock may be taken here, not even that of the log: a thread of the parent may have
        // held it at the fork, and no thread of the child would release it.
        let error = Box::new(CallError::Forked);
        error::remember(&error);
        return Err(error);
    }
    let _may_hold_lock = (!forked::any_open()).then(MayHoldLock::begin);
    // These guards are dropped in the reverse order, so cancellation is deferred until all others have ended.
    let _cancellation = CancellationDeferred::begin();
    let _in_library = InLibrary::begin();
    let _last_error = LastError::keep();
    let _floating_point = FloatingPoint::begin();
    let result = set_up().and_then(|()| {
        catch_unwind(AssertUnwindSafe(body))
            .unwrap_or_else(|payload| Err(CallError::Panic(panic_message(&*payload)).into()))
    });
    match &result {
        Ok(value) => log::trace!("{call} -> {value:?}"),
        Err(error) => {
            let _may_hold_lock = MayHoldLock::begin();
            error::remember(error);
            match **error {
                CallError::Panic(_) => log::error!("{call} -> {error}"),
                _ => log::warn!("{call} -> {error}"),
            }
            if !forked::any_open()
                && let Some(summary_writer) = writer::of_process()
            {
                // No board is open, so the thread that writes the summary for `ecmsk exec` is not running. This thread
                // writes the lines.
                summary_writer.write_all();
            }
        }
    }
    result
}

/// Sets up the log once per process. Panics are logged instead of printed, because they become errors of calls.
fn set_up() -> Result<(), Box<CallError>> {
    static ONCE: Once = Once::new();
    if ONCE.is_completed() {
        return Ok(());
    }
    memory::check(memory::FIRST_CALL_BYTES)?;
    ONCE.call_once(|| {
        logger::set_up();
        // Unit tests keep the default hook, which prints the panic of a test that fails.
        #[cfg(not(test))]
        std::panic::set_hook(Box::new(|panic| log::error!("{panic}")));
    });
    Ok(())
}

fn panic_message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic without a message".to_owned())
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;

    use super::*;

    fn last_error() -> String {
        // SAFETY: the text ends with 0. Only a failing call of this thread changes it, and there is none before the text
        // is copied.
        unsafe { CStr::from_ptr(error::last()) }.to_string_lossy().into_owned()
    }

    /// A panic in an exported function does not reach its caller in C. It becomes an error with the message of the panic.
    #[test]
    fn a_panic_is_an_error() {
        let length = 3;
        let result: Result<(), Box<CallError>> = entry!(Tried(length), { panic!("slot {length}") });
        assert_eq!(result, Err(CallError::Panic("slot 3".to_owned()).into()));
        assert!(last_error().contains("slot 3"), "{}", last_error());
    }

    /// An error is kept for the thread in which the call failed. A call that succeeds does not change it.
    #[test]
    fn the_last_error_is_the_threads_own() {
        let _ = entry!(Tried(), { Err::<(), _>(CallError::NoBytes.into()) });
        let _ = entry!(Tried(), { Ok(()) });
        assert_eq!(last_error(), CallError::NoBytes.to_string());
        std::thread::scope(|scope| {
            scope.spawn(|| assert_ne!(last_error(), CallError::NoBytes.to_string()));
        });
    }

    /// A thread without an error of its own gets the error of the last OpenECMUSB that failed in any thread.
    #[test]
    fn a_failed_open_is_known_to_other_threads() {
        let error = CallError::NotOpen;
        error::remember_open(&error);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                assert_eq!(last_error(), error.to_string());
                let _ = entry!(Tried(), { Err::<(), _>(CallError::NoBytes.into()) });
                assert_eq!(last_error(), CallError::NoBytes.to_string());
            });
        });
    }
    /// The text has one address for each thread: a program that keeps the address reads the newest error there. A text that is
    /// too long is cut between two characters.
    #[test]
    fn the_text_has_one_place_in_a_thread() {
        let _ = entry!(Tried(), { Err::<(), _>(CallError::NoBytes.into()) });
        let kept = error::last();
        let long = "\u{20AC}".repeat(5000);
        let _ = entry!(Tried(), { Err::<(), _>(CallError::Panic(long.clone()).into()) });
        assert_eq!(error::last(), kept);
        let text = last_error();
        assert!(text.len() <= 2047 && text.len() > 2043, "{}", text.len());
        assert!(CallError::Panic(long).to_string().starts_with(&text));
        let _ = entry!(Tried(), { Err::<(), _>(CallError::NotOpen.into()) });
        assert_eq!((error::last(), last_error()), (kept, CallError::NotOpen.to_string()));
    }
}
