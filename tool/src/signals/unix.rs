//! Signals.

use std::io;
use std::os::fd::AsFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;
use signal_hook::iterator::Signals;

/// Those that ask for the end. SIGHUP does not where it is ignored: that is what `nohup` is for.
fn asking() -> impl Iterator<Item = i32> {
    [SIGINT, SIGTERM].into_iter().chain(not_ignored(&[SIGHUP]))
}

/// The number of what a terminal sends when it is closed.
pub const HANG_UP: usize = SIGHUP as usize;

/// Whether what that file leads to is gone: the terminal was closed, or the reader of the pipe.
pub fn has_hung_up(file: &impl AsFd) -> bool {
    let mut asked = [PollFd::new(file, PollFlags::empty())];
    let gone = PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL;
    poll(&mut asked, Some(&Timespec::default())).is_ok() && asked[0].revents().intersects(gone)
}

/// Those of `numbers` that this process was not started to ignore, as `nohup` does.
pub fn not_ignored(numbers: &[i32]) -> impl Iterator<Item = i32> {
    numbers.iter().copied().filter(|number| !is_ignored(*number))
}

fn is_ignored(signal: i32) -> bool {
    let mut action = std::mem::MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: without a new action this only asks, and `action` has room for the answer.
    let asked = unsafe { libc::sigaction(signal, std::ptr::null(), action.as_mut_ptr()) } == 0;
    // SAFETY: zeroed is a valid `sigaction`, and the call leaves a valid one.
    asked && unsafe { action.assume_init() }.sa_sigaction == libc::SIG_IGN
}

/// The number of what comes is in `signal` from now on.
///
/// # Errors
/// What the system says.
pub fn note(signal: &Arc<AtomicUsize>) -> io::Result<()> {
    for number in asking() {
        flag::register_usize(number, Arc::clone(signal), number as usize)?;
    }
    Ok(())
}

/// As [`note`], and what comes while `armed` is set ends the program at once. What comes sets it.
///
/// # Errors
/// What the system says.
pub fn note_once(signal: &Arc<AtomicUsize>, armed: &Arc<AtomicBool>) -> io::Result<()> {
    for number in asking() {
        // In this order: the flag that ends the program is not set yet when the first one comes.
        flag::register_conditional_shutdown(number, 128 + number, Arc::clone(armed))?;
        flag::register_usize(number, Arc::clone(signal), number as usize)?;
        flag::register(number, Arc::clone(armed))?;
    }
    Ok(())
}

/// What has asked for the end, for who has nothing to do but to wait for it.
pub struct Asked(Signals);

impl Asked {
    /// Looks out for SIGINT, SIGTERM and SIGHUP from now on.
    ///
    /// # Errors
    /// What the system says.
    pub fn watch() -> io::Result<Self> {
        Signals::new(asking()).map(Self)
    }

    /// Waits for the first one, and gives its name.
    pub fn wait(mut self) -> &'static str {
        match self.0.forever().next() {
            Some(SIGTERM) => "SIGTERM",
            Some(SIGHUP) => "SIGHUP",
            _ => "SIGINT",
        }
    }
}

/// What people call it.
pub fn name(signal: u8) -> String {
    match signal {
        1 => "SIGHUP".into(),
        2 => "Ctrl-C".into(),
        15 => "SIGTERM".into(),
        other => format!("signal {other}"),
    }
}
