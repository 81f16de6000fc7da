//! The keys of a terminal, with the times at which they arrive.
//!
//! A thread of its own reads them, because a read waits, and the motion must not. Nobody waits for the end of this
//! thread: it ends with the process.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread;
use std::time::Instant;

use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::crossterm::terminal::{disable_raw_mode, enable_raw_mode};

use crate::{signals, stderr};

/// Most keys that are buffered; further ones wait in the terminal. \[OURS]
const KEYS_BUFFERED: usize = 256;
/// Asks a terminal with the keyboard protocol of kitty to report releases of keys (flags 1 and 2), and takes that back.
/// Other terminals ignore these sequences. <https://sw.kovidgoyal.net/kitty/keyboard-protocol/>
const REPORT_RELEASES: &str = "\x1b[>3u";
const REPORT_NO_RELEASES: &str = "\x1b[<u";

/// A key that has arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key {
    pub at: Instant,
    pub code: KeyCode,
    /// Whether the key was released; only some terminals report that.
    pub is_release: bool,
}

/// A terminal that reports each key when it arrives. Dropping it restores the terminal.
pub struct Terminal {
    keys: Receiver<io::Result<Key>>,
}

impl Terminal {
    /// Begins to read keys. Those that were typed before are dropped.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn open() -> io::Result<Self> {
        let (sender, keys) = sync_channel(KEYS_BUFFERED);
        enable_raw_mode()?;
        let terminal = Self { keys };
        keep_signals()?;
        drop_keys()?;
        stderr::raw(REPORT_RELEASES);
        thread::Builder::new().name("keys".into()).spawn(move || read(&sender))?;
        Ok(terminal)
    }

    /// The next key that has arrived; never waits. `None`: there is none.
    ///
    /// # Errors
    /// The keys cannot be read any more, for example because the terminal was closed.
    pub fn key(&self) -> io::Result<Option<Key>> {
        match self.keys.try_recv() {
            Ok(key) => key.map(Some),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(io::ErrorKind::UnexpectedEof.into()),
        }
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        stderr::raw(REPORT_NO_RELEASES);
        // An error would be that of a terminal that was closed.
        let _ = disable_raw_mode();
    }
}

/// The width of the terminal in columns.
pub fn width() -> usize {
    /// The width of a terminal that does not say it.
    const DEFAULT: u16 = 80;
    #[cfg(unix)]
    let columns = rustix::termios::tcgetwinsize(io::stderr()).map_or(0, |size| size.ws_col);
    #[cfg(not(unix))]
    let columns = ratatui::crossterm::terminal::size().map_or(0, |(columns, _)| columns);
    usize::from(if columns == 0 { DEFAULT } else { columns })
}

fn read(sender: &SyncSender<io::Result<Key>>) {
    loop {
        let key = match event::read() {
            Ok(Event::Key(key)) => Ok(key),
            Ok(_) => continue,
            Err(error) => Err(error),
        };
        let at = Instant::now();
        let is_error = key.is_err();
        let key = key.map(|key| {
            if is_ctrl_c(key) && key.kind != KeyEventKind::Release {
                signals::raise_interrupt();
            }
            Key { at, code: key.code, is_release: key.kind == KeyEventKind::Release }
        });
        if sender.send(key).is_err() || is_error {
            return;
        }
    }
}

/// Whether the key is Ctrl-C, in a terminal that reports it as a key and sends no signal.
fn is_ctrl_c(key: KeyEvent) -> bool {
    key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL)
}

/// Lets Ctrl-C send its signal, and lines end as before, which raw mode has switched off. Ctrl-Z and Ctrl-\ stay keys: a
/// program that they suspend or end could not brake.
#[cfg(unix)]
fn keep_signals() -> io::Result<()> {
    use rustix::termios::{LocalModes, OptionalActions, OutputModes, SpecialCodeIndex, tcgetattr, tcsetattr};

    let mut modes = tcgetattr(io::stdin())?;
    modes.local_modes |= LocalModes::ISIG;
    modes.output_modes |= OutputModes::OPOST;
    modes.special_codes[SpecialCodeIndex::VSUSP] = 0;
    modes.special_codes[SpecialCodeIndex::VQUIT] = 0;
    Ok(tcsetattr(io::stdin(), OptionalActions::Now, &modes)?)
}

#[cfg(not(unix))]
const fn keep_signals() -> io::Result<()> {
    Ok(())
}

/// Drops the keys that were typed while nobody read them.
#[cfg(unix)]
fn drop_keys() -> io::Result<()> {
    Ok(rustix::termios::tcflush(io::stdin(), rustix::termios::QueueSelector::IFlush)?)
}

#[cfg(not(unix))]
fn drop_keys() -> io::Result<()> {
    while event::poll(std::time::Duration::ZERO)? {
        event::read()?;
    }
    Ok(())
}
