//! The terminal: drawing, keys, signals. However it ends, the terminal is as it was.
//!
//! Keys are read by a thread of their own. The crate that reads them never comes back from a terminal that has hung up,
//! and what ends the monitor must not wait for it.

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

/// How long a signal, or the end of the terminal, may wait to be seen. \[OURS]
const LOOK: Duration = Duration::from_millis(50);
/// Keys that may wait to be seen; while more are typed they wait in the terminal. \[OURS]
const KEYS: usize = 64;
/// How long the screen may take to end by itself after a signal. A terminal that takes no output may hold it up for
/// ever. \[OURS]
const GRACE: Duration = Duration::from_secs(1);
/// Rows that a page moves. \[OURS]
const PAGE: usize = 10;

/// What a key asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wish {
    End,
    Scroll(usize),
    Nothing,
}

/// Shows what the feed sees until it is told to end; gives the exit code.
pub fn run(feed: &Feed, interval: Duration, limit: Option<Duration>) -> Result<ExitCode, MonitorError> {
    let signal = Arc::new(AtomicUsize::new(0));
    signals::note(&signal).map_err(MonitorError::Terminal)?;
    // From here on a panic restores the terminal too.
    let mut terminal = ratatui::try_init().map_err(MonitorError::Terminal)?;
    end_in_any_case(Arc::clone(&signal)).map_err(MonitorError::Terminal)?;
    let shown = keys().and_then(|keys| show(&mut terminal, feed, interval, limit, &signal, &keys));
    let restored = ratatui::try_restore();
    if is_gone() {
        // Its drop would tell standard error that the cursor cannot be shown, and panic because that is gone too.
        std::mem::forget(terminal);
        // Whatever failed, it failed because nobody is there any more: not even to be told.
        let number = signal.load(Ordering::Relaxed);
        return Ok(ended_by(if number == 0 { signals::HANG_UP } else { number }));
    }
    restored.map_err(MonitorError::Terminal)?;
    shown
}

/// What is typed, from now on. The thread is left to itself: it ends with the process.
fn keys() -> Result<Receiver<io::Result<Event>>, MonitorError> {
    let (sender, keys) = sync_channel(KEYS);
    let read = move |sender: SyncSender<io::Result<Event>>| while sender.send(event::read()).is_ok() {};
    thread::Builder::new().name("keys".into()).spawn(move || read(sender)).map_err(MonitorError::Terminal)?;
    Ok(keys)
}

/// Whether the terminal was closed.
fn is_gone() -> bool {
    signals::has_hung_up(&io::stdout())
}

/// Ends the process some time after a signal, or after the terminal was closed, whatever it is doing then.
fn end_in_any_case(signal: Arc<AtomicUsize>) -> io::Result<()> {
    let watch = move || {
        let number = loop {
            match signal.load(Ordering::Relaxed) {
                0 if is_gone() => break signals::HANG_UP,
                0 => thread::sleep(LOOK),
                number => break number,
            }
        };
        thread::sleep(GRACE);
        // Without the sequences that restore the screen: the terminal takes none.
        let _ = disable_raw_mode();
        std::process::exit(i32::from(128_u8.saturating_add(number as u8)));
    };
    thread::Builder::new().name("end".into()).spawn(watch).map(drop)
}

/// The exit code after a signal.
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
                // Its reason is part of the view: a board that is gone leaves its last values on the screen.
                (view, _) = feed.view();
                next = (next + interval).max(now);
                break;
            }
            let typed = match keys.recv_timeout(LOOK.min(next - now)) {
                Ok(typed) => typed.map_err(MonitorError::Terminal)?,
                Err(RecvTimeoutError::Timeout) => continue,
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(MonitorError::Terminal(io::Error::other("its keys cannot be read any more")));
                }
            };
            match typed {
                Event::Key(key) if key.kind != KeyEventKind::Release => match wish(key, scroll, last) {
                    Wish::End => return Ok(ExitCode::SUCCESS),
                    Wish::Scroll(to) => {
                        scroll = to;
                        break;
                    }
                    Wish::Nothing => {}
                },
                Event::Resize(..) => break,
                _ => {}
            }
        }
    }
}

fn wish(key: KeyEvent, scroll: usize, last: usize) -> Wish {
    let scroll = scroll.min(last);
    match key.code {
        KeyCode::Char('q' | 'Q') | KeyCode::Esc => Wish::End,
        KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => Wish::End,
        KeyCode::Up | KeyCode::Char('k') => Wish::Scroll(scroll.saturating_sub(1)),
        KeyCode::Down | KeyCode::Char('j') => Wish::Scroll((scroll + 1).min(last)),
        KeyCode::PageUp => Wish::Scroll(scroll.saturating_sub(PAGE)),
        KeyCode::PageDown | KeyCode::Char(' ') => Wish::Scroll((scroll + PAGE).min(last)),
        KeyCode::Home => Wish::Scroll(0),
        KeyCode::End => Wish::Scroll(last),
        _ => Wish::Nothing,
    }
}
