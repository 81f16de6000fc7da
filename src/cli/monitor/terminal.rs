//! The terminal: drawing, keys, signals. However it ends, the terminal is as it was.

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

use super::source::Feed;
use super::{MonitorError, screen};
use crate::cli::signals;

/// How long a signal may wait to be seen. \[OURS]
const LOOK: Duration = Duration::from_millis(50);
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
    let shown = show(&mut terminal, feed, interval, limit, &signal);
    ratatui::try_restore().map_err(MonitorError::Terminal)?;
    shown
}

fn show(
    terminal: &mut ratatui::DefaultTerminal,
    feed: &Feed,
    interval: Duration,
    limit: Option<Duration>,
    signal: &AtomicUsize,
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
                number => return Ok(ExitCode::from(128_u8.saturating_add(number as u8))),
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
            if !event::poll(LOOK.min(next - now)).map_err(MonitorError::Terminal)? {
                continue;
            }
            match event::read().map_err(MonitorError::Terminal)? {
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
