//! Handles console events on Windows: Ctrl-C, Ctrl-Break, and closing the console.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex};

use windows_sys::Win32::Foundation::TRUE;
use windows_sys::Win32::System::Console::{CTRL_BREAK_EVENT, CTRL_C_EVENT, SetConsoleCtrlHandler};

use crate::lock::lock;

/// The signal number for Ctrl-C, which is that of SIGINT.
const INTERRUPT: u8 = 2;
/// \[OURS] The signal number for all other events, which is that of SIGTERM: Ctrl-Break, closing the console window,
/// the end of the user's session, the shutdown of the machine. Ctrl-Break is among them because another program can
/// send it to a process group to end it.
const TERMINATE: u8 = 15;

/// The signal number for closing the console.
pub const HANG_UP: usize = TERMINATE as usize;

/// Whether the other end of a file was closed. Always false on Windows, where closing the console ends the process, see
/// `came`.
pub const fn has_hung_up<T>(_file: &T) -> bool {
    false
}

/// How an event is passed on to the code that waits for it.
enum Watcher {
    Note { signal: Arc<AtomicUsize>, armed: Option<Arc<AtomicBool>> },
    Wait(Sender<u8>),
}

static WATCHERS: Mutex<Vec<Watcher>> = Mutex::new(Vec::new());

/// Starts to catch events: the signal number of each event is stored in `signal`.
///
/// # Errors
/// Errors of the operating system.
pub fn note(signal: &Arc<AtomicUsize>) -> io::Result<()> {
    watch(Watcher::Note { signal: Arc::clone(signal), armed: None })
}

/// Like [`note`], but an event that occurs while `armed` is set ends the program at once. The first event sets `armed`.
///
/// # Errors
/// Errors of the operating system.
pub fn note_once(signal: &Arc<AtomicUsize>, armed: &Arc<AtomicBool>) -> io::Result<()> {
    watch(Watcher::Note { signal: Arc::clone(signal), armed: Some(Arc::clone(armed)) })
}

/// Ignores all events from now on, because the program that this tool runs shares the console and gets them too.
///
/// # Errors
/// Errors of the operating system.
pub fn leave_to_program() -> io::Result<()> {
    install()
}

/// Has the effect of Ctrl-C, for a console that reports Ctrl-C as a key.
pub fn raise_interrupt() {
    // SAFETY: the handler accepts any event number, and may run in any thread.
    unsafe { came(CTRL_C_EVENT) };
}

/// Waits for the event that ends a server, for verbs that have nothing else to do in this thread.
pub struct EndRequest(Receiver<u8>);

impl EndRequest {
    /// Starts to catch events.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn watch() -> io::Result<Self> {
        let (sender, receiver) = mpsc::channel();
        watch(Watcher::Wait(sender))?;
        Ok(Self(receiver))
    }

    /// Waits for the first event; returns its name. No event of Windows requests that the configuration is read again.
    pub fn wait(self, _: impl FnMut()) -> &'static str {
        // Receiving cannot fail, because the sender exists as long as the process.
        if self.0.recv() == Ok(INTERRUPT) { "Ctrl-C" } else { ENDS }
    }

    /// The name of an event that has occurred; `None` if there was none. Does not block.
    #[cfg(feature = "web")]
    pub fn asked(&mut self, _: impl FnMut()) -> Option<&'static str> {
        self.0.try_recv().ok().map(|event| if event == INTERRUPT { "Ctrl-C" } else { ENDS })
    }
}

const ENDS: &str = "Ctrl-Break or the end of its console";

/// The name of an event for users.
pub fn name(signal: u8) -> String {
    match signal {
        INTERRUPT => "Ctrl-C".into(),
        _ => ENDS.into(),
    }
}

fn watch(watcher: Watcher) -> io::Result<()> {
    lock(&WATCHERS).push(watcher);
    install()
}

fn install() -> io::Result<()> {
    // A program that was started in its own process group ignores Ctrl-C until it enables it. SAFETY: without a
    // function this call only sets whether this process ignores Ctrl-C.
    let hears = unsafe { SetConsoleCtrlHandler(None, 0) };
    // Installing the handler again does no harm: it returns TRUE, so Windows calls it only once per event. SAFETY: the
    // function has the required signature, and exists as long as the process.
    let installed = unsafe { SetConsoleCtrlHandler(Some(came), TRUE) };
    if hears == 0 || installed == 0 { Err(io::Error::last_os_error()) } else { Ok(()) }
}

/// The console event handler, which Windows calls in a separate thread.
unsafe extern "system" fn came(event: u32) -> i32 {
    let number = if event == CTRL_C_EVENT { INTERRUPT } else { TERMINATE };
    for watcher in lock(&WATCHERS).iter() {
        match watcher {
            Watcher::Note { signal, armed } => {
                if armed.as_ref().is_some_and(|armed| armed.swap(true, Ordering::SeqCst)) {
                    std::process::exit(128 + i32::from(number));
                }
                signal.store(number.into(), Ordering::SeqCst);
            }
            // Sending fails if nobody waits any more; this is ignored.
            Watcher::Wait(sender) => drop(sender.send(number)),
        }
    }
    if !matches!(event, CTRL_C_EVENT | CTRL_BREAK_EVENT) {
        // After a closing event Windows ends the process when this handler returns, or after 5 s at the latest. So the
        // handler never returns. In this time the axes are stopped, and the process ends by itself.
        loop {
            std::thread::park();
        }
    }
    TRUE
}
