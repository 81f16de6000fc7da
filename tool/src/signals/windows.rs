//! What a console sends: Ctrl-C, Ctrl-Break, and that it ends.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, PoisonError};

use windows_sys::Win32::Foundation::TRUE;
use windows_sys::Win32::System::Console::{CTRL_BREAK_EVENT, CTRL_C_EVENT, SetConsoleCtrlHandler};

/// The number of Ctrl-C, as SIGINT's.
const INTERRUPT: u8 = 2;
/// \[OURS] The number of everything else, as SIGTERM's: Ctrl-Break, the console's window closed, the user logs off, the
/// machine goes down. Ctrl-Break is what another program can send to a group of processes.
const TERMINATE: u8 = 15;

/// The number that stands for the end of the console.
pub const HANG_UP: usize = TERMINATE as usize;

/// Whether what that file leads to is gone: Windows says so by ending the process, see `came`.
pub const fn has_hung_up<T>(_file: &T) -> bool {
    false
}

/// Who wants to know.
enum Watcher {
    Note { signal: Arc<AtomicUsize>, armed: Option<Arc<AtomicBool>> },
    Wait(Sender<u8>),
}

static WATCHERS: Mutex<Vec<Watcher>> = Mutex::new(Vec::new());

/// The number of what comes is in `signal` from now on.
///
/// # Errors
/// What the system says.
pub fn note(signal: &Arc<AtomicUsize>) -> io::Result<()> {
    watch(Watcher::Note { signal: Arc::clone(signal), armed: None })
}

/// As [`note`], and what comes while `armed` is set ends the program at once. What comes sets it.
///
/// # Errors
/// What the system says.
pub fn note_once(signal: &Arc<AtomicUsize>, armed: &Arc<AtomicBool>) -> io::Result<()> {
    watch(Watcher::Note { signal: Arc::clone(signal), armed: Some(Arc::clone(armed)) })
}

/// What comes is for the program that this one runs, in the same console, which gets it too.
///
/// # Errors
/// What the system says.
pub fn leave_to_program() -> io::Result<()> {
    install()
}

/// What has asked for the end, for who has nothing to do but to wait for it.
pub struct Asked(Receiver<u8>);

impl Asked {
    /// Looks out from now on.
    ///
    /// # Errors
    /// What the system says.
    pub fn watch() -> io::Result<Self> {
        let (sender, receiver) = mpsc::channel();
        watch(Watcher::Wait(sender))?;
        Ok(Self(receiver))
    }

    /// Waits for the first one, and gives its name.
    pub fn wait(self) -> &'static str {
        // Its sender stays as long as the process.
        if self.0.recv() == Ok(INTERRUPT) { "Ctrl-C" } else { ENDS }
    }
}

const ENDS: &str = "Ctrl-Break or the end of its console";

/// What people call it.
pub fn name(signal: u8) -> String {
    match signal {
        INTERRUPT => "Ctrl-C".into(),
        _ => ENDS.into(),
    }
}

fn watch(watcher: Watcher) -> io::Result<()> {
    WATCHERS.lock().unwrap_or_else(PoisonError::into_inner).push(watcher);
    install()
}

fn install() -> io::Result<()> {
    // A program that was started as a group of its own ignores Ctrl-C until it says otherwise.
    // SAFETY: without a function this sets whether this process ignores Ctrl-C, and nothing else.
    let hears = unsafe { SetConsoleCtrlHandler(None, 0) };
    // Once more does no harm: what is first called has done it all.
    // SAFETY: the function has the signature that is asked for, and stays as long as the process.
    let installed = unsafe { SetConsoleCtrlHandler(Some(came), TRUE) };
    if hears == 0 || installed == 0 { Err(io::Error::last_os_error()) } else { Ok(()) }
}

/// The system calls this in a thread of its own.
unsafe extern "system" fn came(event: u32) -> i32 {
    let number = if event == CTRL_C_EVENT { INTERRUPT } else { TERMINATE };
    for watcher in WATCHERS.lock().unwrap_or_else(PoisonError::into_inner).iter() {
        match watcher {
            Watcher::Note { signal, armed } => {
                if armed.as_ref().is_some_and(|armed| armed.swap(true, Ordering::SeqCst)) {
                    std::process::exit(128 + i32::from(number));
                }
                signal.store(number.into(), Ordering::SeqCst);
            }
            // Who does not wait any more needs no word.
            Watcher::Wait(sender) => drop(sender.send(number)),
        }
    }
    if !matches!(event, CTRL_C_EVENT | CTRL_BREAK_EVENT) {
        // Windows ends the process when this returns, and 5 s after the window was closed in any case: axes come to a
        // standstill meanwhile, and the process ends by itself.
        loop {
            std::thread::park();
        }
    }
    TRUE
}
