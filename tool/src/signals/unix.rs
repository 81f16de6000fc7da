//! Signals on Unix.

use std::io;
use std::os::fd::AsFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use signal_hook::flag;
use signal_hook::iterator::Signals;

/// The signals that request the end of the tool. SIGHUP and SIGQUIT are left out if they are ignored, as `nohup` and `&` set
/// them.
fn asking() -> impl Iterator<Item = i32> {
    [SIGINT, SIGTERM].into_iter().chain(not_ignored(&[SIGHUP, SIGQUIT]))
}

/// The signal that a terminal sends when it is closed.
pub const HANG_UP: usize = SIGHUP as usize;

/// Whether the other end of a file was closed: the terminal, or the reader of a pipe.
pub fn has_hung_up(file: &impl AsFd) -> bool {
    let mut end_request = [PollFd::new(file, PollFlags::empty())];
    let gone = PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL;
    poll(&mut end_request, Some(&Timespec::default())).is_ok() && end_request[0].revents().intersects(gone)
}

/// The signals of `numbers` that were not already ignored when this process started, as `nohup` sets SIGHUP.
pub fn not_ignored(numbers: &[i32]) -> impl Iterator<Item = i32> {
    numbers.iter().copied().filter(|number| !is_ignored(*number))
}

fn is_ignored(signal: i32) -> bool {
    let mut action = std::mem::MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: without a new action this only asks, and `action` has room for the answer.
    let has_answer = unsafe { libc::sigaction(signal, std::ptr::null(), action.as_mut_ptr()) } == 0;
    // SAFETY: zeroed is a valid `sigaction`, and the call leaves a valid one.
    has_answer && unsafe { action.assume_init() }.sa_sigaction == libc::SIG_IGN
}

/// Watches for signals from now on: stores the number of each one that arrives in `signal`.
///
/// # Errors
/// Errors of the operating system.
pub fn note(signal: &Arc<AtomicUsize>) -> io::Result<()> {
    for number in asking() {
        flag::register_usize(number, Arc::clone(signal), number as usize)?;
    }
    Ok(())
}

/// Like [`note`], but a signal that arrives while `armed` is set ends the program at once. The first signal sets
/// `armed`. SIGHUP does neither: for one terminal that is closed a program gets it twice, from its shell and from the system.
///
/// # Errors
/// Errors of the operating system.
pub fn note_once(signal: &Arc<AtomicUsize>, armed: &Arc<AtomicBool>) -> io::Result<()> {
    // The handlers run in this order: `armed` is tested first and set afterwards, so that the first signal does not end the
    // program.
    for number in asking().filter(|number| *number != SIGHUP) {
        flag::register_conditional_shutdown(number, 128 + number, Arc::clone(armed))?;
    }
    note(signal)?;
    for number in asking().filter(|number| *number != SIGHUP) {
        flag::register(number, Arc::clone(armed))?;
    }
    Ok(())
}

/// Has the effect of Ctrl-C, for a terminal that reports it as a key.
pub fn raise_interrupt() {
    // It fails for invalid signals only.
    let _ = signal_hook::low_level::raise(SIGINT);
}

/// How often a server looks for signals that have not interrupted its wait. \[OURS]
const LOOK_INTERVAL: Timespec = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };

/// Waits for the signal that ends a server, for verbs that do nothing else meanwhile.
pub struct EndRequest {
    signals: Signals,
    /// Whether SIGHUP means to read the configuration again, as for services. A process with a terminal gets it when the
    /// terminal is closed, and ends. \[OURS]
    hang_up_reloads: bool,
}

impl EndRequest {
    /// Watches for SIGINT, SIGTERM, SIGHUP and SIGQUIT from now on.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn watch() -> io::Result<Self> {
        // Opening it fails if the process has no terminal.
        let hang_up_reloads = std::fs::File::open("/dev/tty").is_err();
        Ok(Self { signals: Signals::new(asking())?, hang_up_reloads })
    }

    /// Waits for the first signal that ends the server; returns its name. `reload` is called for each SIGHUP that asks for
    /// the configuration to be read again.
    pub fn wait(self, reload: impl FnMut()) -> &'static str {
        self.wait_unless_ended(reload).unwrap_or("SIGINT")
    }

    /// A function that another thread calls to end [`Self::wait_unless_ended`] without a signal.
    #[cfg(target_os = "linux")]
    pub fn ender(&self) -> impl Fn() + Send + Sync + 'static {
        let handle = self.signals.handle();
        move || handle.close()
    }

    /// The name of a signal that has arrived and ends the server; `None`: none has. Does not wait. `reload` is as for
    /// [`Self::wait`].
    pub fn asked(&mut self, mut reload: impl FnMut()) -> Option<&'static str> {
        for signal in self.signals.pending() {
            match signal {
                SIGHUP if self.hang_up_reloads => reload(),
                SIGTERM => return Some("SIGTERM"),
                SIGHUP => return Some("SIGHUP"),
                SIGQUIT => return Some("SIGQUIT"),
                _ => return Some("SIGINT"),
            }
        }
        None
    }

    /// As [`Self::wait`]. `None` if [`Self::ender`] was called before a signal arrived.
    pub fn wait_unless_ended(mut self, mut reload: impl FnMut()) -> Option<&'static str> {
        let handle = self.signals.handle();
        loop {
            if let Some(signal) = self.asked(&mut reload) {
                return Some(signal);
            }
            if handle.is_closed() {
                return None;
            }
            // A signal interrupts this wait. One that another thread has got, or that came just before, is seen after it.
            // To wait for the byte that the handler sends would be to wait for ever if the system has no room for it.
            let _ = poll(&mut [], Some(&LOOK_INTERVAL));
        }
    }
}

/// The name of a signal for users.
pub fn name(signal: u8) -> String {
    match signal {
        1 => "SIGHUP".into(),
        2 => "Ctrl-C".into(),
        3 => "SIGQUIT".into(),
        15 => "SIGTERM".into(),
        other => format!("signal {other}"),
    }
}
