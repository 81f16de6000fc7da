//! Handles signals on Unix.

use std::io;
use std::os::fd::AsFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use signal_hook::flag;
use signal_hook::iterator::Signals;

/// The signals that request the end of the tool. SIGHUP and SIGQUIT are left out if they are ignored, as after `nohup`
/// or `&`.
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

/// The signals of `numbers` that were not ignored when this process started; `nohup` for example ignores SIGHUP.
pub fn not_ignored(numbers: &[i32]) -> impl Iterator<Item = i32> {
    numbers.iter().copied().filter(|number| !is_ignored(*number))
}

fn is_ignored(signal: i32) -> bool {
    let mut action = std::mem::MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: without a new action the call only reads the present one, and `action` has room for it.
    let has_answer = unsafe { libc::sigaction(signal, std::ptr::null(), action.as_mut_ptr()) } == 0;
    // SAFETY: a zeroed `sigaction` is valid, and the call leaves a valid one.
    has_answer && unsafe { action.assume_init() }.sa_sigaction == libc::SIG_IGN
}

/// Starts to catch signals: the number of each arriving signal is stored in `signal`.
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
/// `armed`. SIGHUP neither ends the program nor sets `armed`, because a program gets it twice when its terminal is
/// closed: from its shell and from the system.
///
/// # Errors
/// Errors of the operating system.
pub fn note_once(signal: &Arc<AtomicUsize>, armed: &Arc<AtomicBool>) -> io::Result<()> {
    // The handlers run in the order of their registration: `armed` is tested first and set afterwards, so that the
    // first signal does not end the program.
    for number in asking().filter(|number| *number != SIGHUP) {
        flag::register_conditional_shutdown(number, 128 + number, Arc::clone(armed))?;
    }
    note(signal)?;
    for number in asking().filter(|number| *number != SIGHUP) {
        flag::register(number, Arc::clone(armed))?;
    }
    Ok(())
}

/// Has the effect of Ctrl-C, for a terminal that reports Ctrl-C as a key.
pub fn raise_interrupt() {
    // This fails only for invalid signals.
    let _ = signal_hook::low_level::raise(SIGINT);
}

/// The interval at which a server checks for signals that have not interrupted its wait. \[OURS]
const LOOK_INTERVAL: Timespec = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };

/// Waits for the signal that ends a server, for verbs that have nothing else to do in this thread.
pub struct EndRequest {
    signals: Signals,
    /// Whether SIGHUP requests that the configuration is read again, as is usual for services. A process with a
    /// terminal gets SIGHUP when the terminal is closed, and ends. \[OURS]
    hang_up_reloads: bool,
}

impl EndRequest {
    /// Starts to catch SIGINT, SIGTERM, SIGHUP and SIGQUIT.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn watch() -> io::Result<Self> {
        // Opening `/dev/tty` fails if the process has no terminal.
        let hang_up_reloads = std::fs::File::open("/dev/tty").is_err();
        Ok(Self { signals: Signals::new(asking())?, hang_up_reloads })
    }

    /// Waits for the first signal that ends the server; returns its name. `reload` is called for each SIGHUP that
    /// requests that the configuration is read again.
    pub fn wait(self, reload: impl FnMut()) -> &'static str {
        self.wait_unless_ended(reload).unwrap_or("SIGINT")
    }

    /// A function that another thread calls to end [`Self::wait_unless_ended`] without a signal.
    #[cfg(target_os = "linux")]
    pub fn ender(&self) -> impl Fn() + Send + Sync + 'static {
        let handle = self.signals.handle();
        move || handle.close()
    }

    /// The name of a signal that has arrived and ends the server; `None` if there was none. Does not block. `reload` is
    /// as for [`Self::wait`].
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

    /// As [`Self::wait`]. Returns `None` if [`Self::ender`] was called before a signal arrived.
    pub fn wait_unless_ended(mut self, mut reload: impl FnMut()) -> Option<&'static str> {
        let handle = self.signals.handle();
        loop {
            if let Some(signal) = self.asked(&mut reload) {
                return Some(signal);
            }
            if handle.is_closed() {
                return None;
            }
            // A signal interrupts this wait. A signal that another thread has received, or that arrived just before, is
            // noticed after the wait. The code does not wait for the byte that the handler sends: if the system has no
            // room for it, that wait would never end.
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
