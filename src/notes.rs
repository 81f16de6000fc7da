//! A log that never blocks: a bounded queue of notes, and a thread that passes them on. Servers, the tool and the C
//! library log through it.
//!
//! Adding a note never waits, even if the reader of the log is slow or has stalled, because threads that move and stop
//! axes add notes. When the queue is full, the oldest note is dropped and counted.

use std::collections::VecDeque;
use std::io;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex};

use crate::threads;

/// The most notes that wait in the queue. \[OURS]
const KEPT_MAX: usize = 1024;
/// How long a server waits at its end for the remaining notes to be passed on. A reader that works takes them at once,
/// and a reader that has stalled never does. \[OURS]
pub const FLUSH_LIMIT: Duration = Duration::from_secs(1);
/// The longest part of a time limit that one wait uses up. If the machine is suspended during a wait, no reader can
/// take notes, and the time of the suspension must not count. \[OURS]
pub const WAIT_SLICE: Duration = Duration::from_millis(100);

/// What a reader takes from the queue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Note<T> {
    /// A note that a thread has added.
    Item(T),
    /// The number of notes dropped at this point, because earlier ones were not taken in time.
    Dropped(u64),
}

/// A queue of notes. Clones share the same queue.
pub struct Notes<T>(Arc<Queue<T>>);

struct Queue<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

struct State<T> {
    kept: VecDeque<T>,
    dropped: u64,
    /// Whether the thread is in a call of `pass_on`.
    is_passing: bool,
    is_over: bool,
}

impl<T> Clone for Notes<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T> Default for Notes<T> {
    fn default() -> Self {
        let state = State { kept: VecDeque::new(), dropped: 0, is_passing: false, is_over: false };
        Self(Arc::new(Queue { state: Mutex::new(state), changed: Condvar::new() }))
    }
}

impl<T> Notes<T> {
    /// Adds a note; never waits.
    pub fn push(&self, note: T) {
        let mut state = self.0.state.lock();
        if state.is_over {
            return;
        }
        if state.kept.len() >= KEPT_MAX {
            state.kept.pop_front();
            state.dropped += 1;
        }
        state.kept.push_back(note);
        drop(state);
        self.0.changed.notify_all();
    }

    /// Takes the oldest note, for callers that have no [`NoteThread`].
    pub fn take(&self) -> Option<Note<T>> {
        self.0.state.lock().next()
    }
}

impl<T> State<T> {
    fn next(&mut self) -> Option<Note<T>> {
        match std::mem::take(&mut self.dropped) {
            0 => self.kept.pop_front().map(Note::Item),
            count => Some(Note::Dropped(count)),
        }
    }

    fn is_passed_on(&self) -> bool {
        !self.is_passing && self.kept.is_empty() && self.dropped == 0
    }
}

/// The thread that takes notes from the queue and passes them on, until this value is dropped.
pub struct NoteThread<T> {
    notes: Notes<T>,
    /// The thread; `None` once it has ended.
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl<T: Send + 'static> NoteThread<T> {
    /// Starts the thread. It calls `pass_on` for each note, one after the other. Threads that add notes do not wait for
    /// these calls.
    ///
    /// # Errors
    /// The system provides no thread.
    pub fn start(notes: &Notes<T>, pass_on: impl FnMut(Note<T>) + Send + 'static) -> io::Result<Self> {
        let queue = Arc::clone(&notes.0);
        let thread = threads::spawn("ecmsk-notes", move || run(&queue, pass_on))?;
        Ok(Self { notes: notes.clone(), thread: Mutex::new(Some(thread)) })
    }
}

impl NoteThread<String> {
    /// Starts the thread for a log of text lines, which calls `pass_on` with each line. If lines were dropped, it also calls
    /// `pass_on` with a line that gives their number.
    ///
    /// # Errors
    /// The operating system cannot start a thread.
    pub fn of_lines(notes: &Notes<String>, pass_on: Arc<dyn Fn(&str) + Send + Sync>) -> io::Result<Self> {
        Self::start(notes, move |note| match note {
            Note::Item(line) => pass_on(&line),
            Note::Dropped(count) => {
                pass_on(&format!("{count} lines were dropped, those before were not taken in time"))
            }
        })
    }
}

impl<T> NoteThread<T> {
    /// Waits until the notes added so far have been passed on, at most [`FLUSH_LIMIT`].
    pub fn flush(&self) {
        self.flush_within(FLUSH_LIMIT);
    }

    /// Waits until the notes added so far have been passed on, at most `limit`. Returns whether they have.
    pub fn flush_within(&self, limit: Duration) -> bool {
        // Other threads hold the lock only for a few instructions. It may be held for longer if a signal handler has
        // interrupted such a thread and ends the process from there.
        let Some(mut state) = self.notes.0.state.try_lock_for(limit) else { return false };
        let mut left = limit;
        while !state.is_over && !state.is_passed_on() {
            if left.is_zero() {
                return false;
            }
            let (slice, began) = (left.min(WAIT_SLICE), Instant::now());
            self.notes.0.changed.wait_for(&mut state, slice);
            left = left.saturating_sub(began.elapsed().min(WAIT_SLICE));
        }
        true
    }

    /// Flushes the queue and ends the thread; later notes are discarded. If the thread is stuck in `pass_on`, it ends when
    /// `pass_on` returns.
    pub fn end(&self) {
        self.end_within(FLUSH_LIMIT);
    }

    /// Like [`Self::end`], but waits at most `limit` for the flush, and after it at most `limit` for the end of the
    /// thread.
    pub fn end_within(&self, limit: Duration) {
        let Some(thread) = self.thread.lock().take() else { return };
        let is_passed_on = self.flush_within(limit);
        {
            let mut state = self.notes.0.state.lock();
            state.is_over = true;
            state.kept = VecDeque::new();
            state.dropped = 0;
        }
        self.notes.0.changed.notify_all();
        // If the thread hangs in `pass_on`, the library stays loaded until the thread ends.
        threads::end_within(thread, if is_passed_on { limit } else { Duration::ZERO });
    }
}

impl<T> Drop for NoteThread<T> {
    fn drop(&mut self) {
        self.end();
    }
}

fn run<T>(queue: &Queue<T>, mut pass_on: impl FnMut(Note<T>)) {
    loop {
        let note = {
            let mut state = queue.state.lock();
            loop {
                if let Some(note) = state.next() {
                    state.is_passing = true;
                    break note;
                }
                if state.is_over {
                    return;
                }
                queue.changed.wait(&mut state);
            }
        };
        pass_on(note);
        queue.state.lock().is_passing = false;
        queue.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    /// TCP-25 Adding a note never waits. While the reader is stuck, the newest notes are kept and the others are
    /// counted. The reader then gets the count in place of the missing notes.
    #[test]
    fn a_stuck_reader_costs_notes_and_nothing_else() {
        let notes = Notes::default();
        let (goes_on, stuck) = mpsc::channel::<()>();
        let (told, heard) = mpsc::channel();
        let note_thread = NoteThread::start(&notes, move |note| {
            told.send(note).unwrap();
            let _ = stuck.recv();
        });
        let note_thread = note_thread.unwrap();
        notes.push(0);
        assert_eq!(heard.recv(), Ok(Note::Item(0)));
        // The thread that takes notes is blocked in the callback for the first note, so the next ones are queued.
        let all = 3 * KEPT_MAX as u64;
        (1..=all).for_each(|number| notes.push(number));
        drop(goes_on);
        let dropped = all - KEPT_MAX as u64;
        assert_eq!(heard.recv(), Ok(Note::Dropped(dropped)));
        for number in dropped + 1..=all {
            assert_eq!(heard.recv(), Ok(Note::Item(number)));
        }
        drop(note_thread);
        assert!(heard.recv().is_err(), "the thread has ended");
    }

    /// TCP-25 Ending passes the remaining notes on, and does not wait for a reader that never takes them.
    #[test]
    fn ending_is_bounded() {
        let (told, heard) = mpsc::channel();
        let notes = Notes::default();
        let note_thread = NoteThread::start(&notes, move |note| told.send(note).unwrap()).unwrap();
        (0..100).for_each(|number| notes.push(number));
        drop(note_thread);
        assert_eq!(heard.iter().collect::<Vec<_>>(), (0..100).map(Note::Item).collect::<Vec<_>>());
        notes.push(100);
        assert_eq!(notes.take(), None, "nobody is told any more");

        let (goes_on, stuck) = mpsc::channel::<()>();
        let notes = Notes::default();
        let note_thread = NoteThread::start(&notes, move |_| assert!(stuck.recv().is_err())).unwrap();
        notes.push(0);
        notes.push(1);
        // Dropping returns although the reader takes no note.
        drop(note_thread);
        drop(goes_on);
    }
}
