//! Runs the monitor on a terminal: drawing, keys, signals. The terminal is restored however the monitor ends.
//!
//! A separate thread reads the keys. The crate for terminals never returns from reading a closed terminal, and the
//! monitor must be able to end even then.

use std::io;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::crossterm::terminal::disable_raw_mode;

use super::source::Feed;
use super::{MonitorError, screen};
use crate::signals;

/// The interval at which signals and the closing of the terminal are checked. \[OURS]
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// The largest number of keys that this process buffers; further ones stay in the terminal's own buffer. \[OURS]
const KEYS_BUFFERED: usize = 64;
/// The longest time for restoring the screen after a signal. After it a watchdog thread ends the process, because a
/// terminal that accepts no output could block it forever. \[OURS]
const END_WAIT_MAX: Duration = Duration::from_secs(1);
/// The number of rows that a page key scrolls. \[OURS]
const PAGE_ROWS: usize = 10;

/// The action that a key requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum KeyAction {
    End,
    Scroll(usize),
    Nothing,
}

/// Shows the feed until a key, a signal or the time limit ends the monitor. Returns the exit code.
pub fn run(feed: &Feed, interval: Duration, limit: Option<Duration>) -> Result<ExitCode, MonitorError> {
    let signal = Arc::new(AtomicUsize::new(0));
    signals::note(&signal).map_err(MonitorError::Terminal)?;
    // From here on, a panic restores the terminal too.
    let mut terminal = ratatui::try_init().map_err(MonitorError::Terminal)?;
    start_watchdog(Arc::clone(&signal)).map_err(MonitorError::Terminal)?;
    let shown = keys().and_then(|keys| show(&mut terminal, feed, interval, limit, &signal, &keys));
    let restored = ratatui::try_restore();
    if is_gone() {
        // Dropping the terminal would print an error to standard error. That is closed too, so printing would panic.
        std::mem::forget(terminal);
        // The error would be that of a closed terminal, where it cannot be shown. So only the exit code reports it.
        let number = signal.load(Ordering::Relaxed);
        return Ok(ended_by(if number == 0 { signals::HANG_UP } else { number }));
    }
    restored.map_err(MonitorError::Terminal)?;
    shown
}

/// Starts the thread that reads keys. The thread may block in a read, so it is never joined: it ends with the process.
fn keys() -> Result<Receiver<io::Result<Event>>, MonitorError> {
    let (sender, keys) = sync_channel(KEYS_BUFFERED);
    let read = move |sender: SyncSender<io::Result<Event>>| while sender.send(event::read()).is_ok() {};
    thread::Builder::new().name("keys".into()).spawn(move || read(sender)).map_err(MonitorError::Terminal)?;
    Ok(keys)
}

/// Whether the terminal of standard output was closed.
fn is_gone() -> bool {
    signals::has_hung_up(&io::stdout())
}

/// Starts a watchdog thread. It ends the process [`END_WAIT_MAX`] after a signal, or after the terminal was closed,
/// even if the process is blocked.
fn start_watchdog(signal: Arc<AtomicUsize>) -> io::Result<()> {
    let watch = move || {
        let number = loop {
            match signal.load(Ordering::Relaxed) {
                0 if is_gone() => break signals::HANG_UP,
                0 => thread::sleep(POLL_INTERVAL),
                number => break number,
            }
        };
        thread::sleep(END_WAIT_MAX);
        // The escape sequences that restore the screen are not sent, because the terminal accepts no output.
        let _ = disable_raw_mode();
        std::process::exit(i32::from(128_u8.saturating_add(number as u8)));
    };
    thread::Builder::new().name("end".into()).spawn(watch).map(drop)
}

/// The exit code after a signal: 128 plus the number of the signal.
fn ended_by(signal: usize) -> ExitCode {
    ExitCode::from(128_u8.saturating_add(signal as u8))
}

fn show(
    terminal: &mut ratatui::DefaultTerminal,
    feed: &Feed,
    interval: Duration,
    limit: Option<Duration>,
    signal: &AtomicUsize,
    keys: &Receiver<io::Result<Event>>,
) -> Result<ExitCode, MonitorError> {
    let began = Instant::now();
    let mut scroll = 0;
    let mut last = 0;
    let (mut view, _) = feed.view();
    let mut next = began + interval;
    loop {
        terminal.draw(|frame| last = screen::draw(frame, &view, scroll)).map_err(MonitorError::Terminal)?;
        loop {
            match signal.load(Ordering::Relaxed) {
                0 => {}
                number => return Ok(ended_by(number)),
            }
            if is_gone() {
                return Ok(ended_by(signals::HANG_UP));
            }
            if limit.is_some_and(|limit| began.elapsed() >= limit) {
                return Ok(ExitCode::SUCCESS);
            }
            let now = Instant::now();
            if now >= next {
                // An error of the feed does not end the loop. The view shows the error, and the last values of the
                // board stay on the screen.
                (view, _) = feed.view();
                next = (next + interval).max(now);
                break;
            }
            let typed = match keys.recv_timeout(POLL_INTERVAL.min(next - now)) {
                Ok(typed) => typed.map_err(MonitorError::Terminal)?,
                Err(RecvTimeoutError::Timeout) => continue,
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(MonitorError::Terminal(io::Error::other("its keys cannot be read any more")));
                }
            };
            match typed {
                Event::Key(key) if key.kind != KeyEventKind::Release => match wish(key, scroll, last) {
                    KeyAction::End => return Ok(ExitCode::SUCCESS),
                    KeyAction::Scroll(to) => {
                        scroll = to;
                        break;
                    }
                    KeyAction::Nothing => {}
                },
                Event::Resize(..) => break,
                _ => {}
            }
        }
    }
}

fn wish(key: KeyEvent, scroll: usize, last: usize) -> KeyAction {
    let scroll = scroll.min(last);
    match key.code {
        KeyCode::Char('q' | 'Q') | KeyCode::Esc => KeyAction::End,
        KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => KeyAction::End,
        KeyCode::Up | KeyCode::Char('k') => KeyAction::Scroll(scroll.saturating_sub(1)),
        KeyCode::Down | KeyCode::Char('j') => KeyAction::Scroll((scroll + 1).min(last)),
        KeyCode::PageUp => KeyAction::Scroll(scroll.saturating_sub(PAGE_ROWS)),
        KeyCode::PageDown | KeyCode::Char(' ') => KeyAction::Scroll((scroll + PAGE_ROWS).min(last)),
        KeyCode::Home => KeyAction::Scroll(0),
        KeyCode::End => KeyAction::Scroll(last),
        _ => KeyAction::Nothing,
    }
}
