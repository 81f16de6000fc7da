//! Reads the keys of a terminal, with their arrival times.
//!
//! A separate thread reads them, because a read blocks, and the motion must not wait. The thread is never joined: it
//! ends with the process.

use std::cell::Cell;
use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use ratatui::crossterm::event::KeyCode;
use ratatui::crossterm::terminal::{disable_raw_mode, enable_raw_mode};

use crate::{signals, stderr};

/// The largest number of keys that this process buffers; further ones stay in the terminal's own buffer. \[OURS]
const KEYS_BUFFERED: usize = 256;
/// Asks a terminal with the keyboard protocol of kitty to report releases of keys (flags 1 and 2). The next constant
/// ends this mode. Other terminals ignore both sequences. <https://sw.kovidgoyal.net/kitty/keyboard-protocol/>
const REPORT_RELEASES: &str = "\x1b[>3u";
const REPORT_NO_RELEASES: &str = "\x1b[<u";
/// Asks a terminal for its status (DSR, ECMA-48 8.3.35). The terminal answers `ESC [ 0 n` after the keys that it has
/// sent before.
pub const ASK: &str = "\x1b[5n";
/// Whether the delay of the line can be measured by status queries. The Windows console does not answer them.
pub const HAS_ANSWERS: bool = cfg!(unix);
/// \[OURS] How long dropping a [`Terminal`] waits for outstanding answers to [`ASK`]. The shell that reads next would
/// take such answers for keys.
const LAST_ANSWERS: Duration = Duration::from_millis(200);

/// A key or another message that a terminal has sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Token {
    Key {
        code: KeyCode,
        /// Whether the key was released; only some terminals report that.
        is_release: bool,
    },
    /// Ctrl-C, from a terminal that sends no signal for it.
    Interrupt,
    /// The answer to [`ASK`].
    #[cfg_attr(not(unix), allow(dead_code, reason = "the console of Windows has none"))]
    Answer,
}

/// A token with its arrival time.
type Arrived = (Instant, Token);

/// A terminal that reports each key when it arrives. Dropping it restores the terminal.
pub struct Terminal {
    arrived: Receiver<io::Result<Arrived>>,
    /// The number of unanswered status queries. The next field says whether the terminal has answered any query.
    unanswered: Cell<u32>,
    answers: Cell<bool>,
}

impl Terminal {
    /// Begins to read keys. Keys that were typed before are dropped.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn open() -> io::Result<Self> {
        let (sender, arrived) = sync_channel(KEYS_BUFFERED);
        enable_raw_mode()?;
        let terminal = Self { arrived, unanswered: Cell::new(0), answers: Cell::new(false) };
        keep_signals()?;
        drop_keys()?;
        stderr::raw(REPORT_RELEASES);
        thread::Builder::new().name("keys".into()).spawn(move || read(&sender))?;
        Ok(terminal)
    }

    /// Returns the next token that has arrived, without blocking; `None` if there is no new one.
    ///
    /// # Errors
    /// The keys can no longer be read, for example because the terminal was closed.
    pub fn next(&self) -> io::Result<Option<Arrived>> {
        match self.arrived.try_recv() {
            Ok(arrived) => arrived.inspect(|arrived| self.note(*arrived)).map(Some),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(io::ErrorKind::UnexpectedEof.into()),
        }
    }

    /// Sends a status query to the terminal.
    pub fn ask(&self) {
        self.unanswered.set(self.unanswered.get() + 1);
        stderr::raw(ASK);
    }

    fn note(&self, (_, token): Arrived) {
        if token == Token::Answer {
            self.unanswered.set(self.unanswered.get().saturating_sub(1));
            self.answers.set(true);
        }
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        let end = Instant::now() + LAST_ANSWERS;
        while self.answers.get() && self.unanswered.get() > 0 {
            match self.arrived.recv_timeout(end.saturating_duration_since(Instant::now())) {
                Ok(Ok(arrived)) => self.note(arrived),
                Ok(Err(_)) | Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => break,
            }
        }
        stderr::raw(REPORT_NO_RELEASES);
        // This fails only if the terminal was closed, so the error is ignored.
        let _ = disable_raw_mode();
    }
}

/// The width of the terminal in columns.
pub fn width() -> usize {
    /// The width that is assumed if the terminal does not report it.
    const DEFAULT: u16 = 80;
    #[cfg(unix)]
    let columns = rustix::termios::tcgetwinsize(io::stderr()).map_or(0, |size| size.ws_col);
    #[cfg(not(unix))]
    let columns = ratatui::crossterm::terminal::size().map_or(0, |(columns, _)| columns);
    usize::from(if columns == 0 { DEFAULT } else { columns })
}

/// Reads tokens and sends them, until the receiver is dropped or reading fails. The error is sent as the last item.
fn read(sender: &SyncSender<io::Result<Arrived>>) {
    let done = read_tokens(|at, token| {
        if token == Token::Interrupt {
            signals::raise_interrupt();
        }
        sender.send(Ok((at, token))).is_ok()
    });
    if let Err(error) = done {
        // Sending fails only if the receiver was dropped.
        let _ = sender.send(Err(error));
    }
}

/// Reads tokens until `take` returns false.
#[cfg(unix)]
fn read_tokens(mut take: impl FnMut(Instant, Token) -> bool) -> io::Result<()> {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    use rustix::io::Errno;

    /// \[OURS] The longest time between two bytes of one sequence.
    const SEQUENCE: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
    let stdin = io::stdin();
    let mut decoder = super::keys::Decoder::default();
    let mut bytes = [0; 256];
    loop {
        let limit = decoder.waits().then_some(&SEQUENCE);
        let has_bytes = poll(&mut [PollFd::new(&stdin, PollFlags::IN)], limit);
        let read = has_bytes
            .and_then(|count| if count == 0 { Ok(None) } else { rustix::io::read(&stdin, &mut bytes).map(Some) });
        let at = Instant::now();
        match read {
            Err(Errno::INTR | Errno::AGAIN) => continue,
            Err(error) => return Err(error.into()),
            Ok(Some(0)) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(Some(count)) => decoder.add(&bytes[..count]),
            Ok(None) => {
                if decoder.end().is_some_and(|token| !take(at, token)) {
                    return Ok(());
                }
            }
        }
        while let Some(token) = decoder.take() {
            if !take(at, token) {
                return Ok(());
            }
        }
    }
}

/// Reads tokens until `take` returns false.
#[cfg(not(unix))]
fn read_tokens(mut take: impl FnMut(Instant, Token) -> bool) -> io::Result<()> {
    use ratatui::crossterm::event::{self, Event, KeyEventKind, KeyModifiers};

    loop {
        let Event::Key(key) = event::read()? else { continue };
        let is_release = key.kind == KeyEventKind::Release;
        let is_ctrl_c = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
        let token = if is_ctrl_c && !is_release { Token::Interrupt } else { Token::Key { code: key.code, is_release } };
        if !take(Instant::now(), token) {
            return Ok(());
        }
    }
}

/// Restores two functions that raw mode has switched off: Ctrl-C sends its signal, and line ends are converted on
/// output. Ctrl-Z and Ctrl-\ stay keys, because a suspended or killed program could not brake.
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

/// Drops the keys that were typed before reading began.
#[cfg(unix)]
fn drop_keys() -> io::Result<()> {
    Ok(rustix::termios::tcflush(io::stdin(), rustix::termios::QueueSelector::IFlush)?)
}

#[cfg(not(unix))]
fn drop_keys() -> io::Result<()> {
    use ratatui::crossterm::event;

    while event::poll(Duration::ZERO)? {
        event::read()?;
    }
    Ok(())
}
