//! The board of OpenECMUSB over a link that can be made to block, to fail and to be lost.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Condvar, mpsc};
use std::thread;
use std::time::Duration;

use ecmsk::link::{Dir, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp};

use ecmsk::sk::FRAME_LEN;

use super::*;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct State {
    reports: u32,
    readers: u32,
    lost: bool,
    closed: bool,
    /// The link's `close` does not return while this is set.
    stays_in_close: bool,
    /// Whether the link's `close` ends the calling thread, as if it was ended by force during the call.
    ends_closer: bool,
    read_waits: [Option<Wait>; 2],
    write_waits: [Option<Wait>; 2],
}

/// A link whose reads block until a report arrives, the link is lost, or the link is closed.
struct FakeLink {
    state: Mutex<State>,
    changed: Condvar,
    read_wait: Wait,
    write_wait: Wait,
}

impl FakeLink {
    fn with_limits(read_wait: Wait, write_wait: Wait) -> Arc<Self> {
        let state = Mutex::default();
        Arc::new(Self { state, changed: Condvar::new(), read_wait, write_wait })
    }

    fn new() -> Arc<Self> {
        Self::with_limits(Wait::Forever, Wait::For(Duration::from_secs(5)))
    }

    fn change(&self, change: impl FnOnce(&mut State)) {
        change(&mut lock(&self.state));
        self.changed.notify_all();
    }

    fn wait_until(&self, holds: impl Fn(&State) -> bool) -> State {
        *self.changed.wait_while(lock(&self.state), |state| !holds(state)).expect("no panic under the lock")
    }

    fn state(&self) -> State {
        *lock(&self.state)
    }
}

fn usable(state: &State) -> Result<(), LinkError> {
    match state {
        State { closed: true, .. } => Err(LinkError::Closed),
        State { lost: true, .. } => Err(LinkError::Lost { name: "fake:".to_owned(), reason: "unplugged".into() }),
        _ => Ok(()),
    }
}

impl Link for FakeLink {
    fn info(&self) -> LinkInfo {
        LinkInfo {
            name: "fake:".to_owned(),
            slot: None,
            virtual_time: false,
            opened_at: Stamp(0),
            read_wait: self.read_wait,
            write_wait: self.write_wait,
        }
    }

    fn write(&self, _: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let mut state = lock(&self.state);
        state.write_waits = [Some(wait), state.write_waits[0]];
        usable(&state).map(|()| Stamp(0))
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.change(|state| {
            state.readers += 1;
            state.read_waits = [Some(wait), state.read_waits[0]];
        });
        let mut state = self.wait_until(|state| usable(state).is_err() || state.reports > 0);
        let result = usable(&state);
        self.change(|now| {
            now.readers -= 1;
            now.reports = now.reports.saturating_sub(u32::from(result.is_ok()));
            state = *now;
        });
        result?;
        out.bytes_mut().fill(0xA5);
        Ok(ReadMeta::default())
    }

    fn cancel(&self, _: Dir) {}

    fn close(&self) {
        self.change(|state| state.closed = true);
        #[cfg(target_os = "linux")]
        if self.state().ends_closer {
            // SAFETY: the call ends this thread and nothing else.
            unsafe { libc::syscall(libc::SYS_exit, 0) };
        }
        self.wait_until(|state| !state.stays_in_close);
    }

    fn check(&self) -> Result<(), LinkError> {
        usable(&lock(&self.state))
    }

    fn stats(&self) -> LinkStats {
        LinkStats::default()
    }
}

fn opened(link: &Arc<FakeLink>) -> VendorBoard {
    let board = VendorBoard::new();
    board.open(|| Ok(link.clone())).expect("opens");
    board
}

fn no_second() -> Result<Arc<dyn Link>, Box<CallError>> {
    panic!("the board must not be opened a second time")
}

fn read(board: &VendorBoard) -> Result<Frame, Box<CallError>> {
    let mut report = Frame::new();
    board.read(&mut report).map(|()| report)
}

/// WIN-9 A thread that has read once and makes no more calls keeps nothing of a board that was closed: no handle of its device.
#[test]
fn an_idle_thread_keeps_no_closed_board() {
    let link = FakeLink::new();
    link.change(|state| state.reports = 1);
    let board = Arc::new(opened(&link));
    let ((told, reads), (ends, waits)) = (mpsc::channel(), mpsc::channel::<()>());
    let reader = board.clone();
    let reader = thread::spawn(move || {
        told.send(read(&reader).is_ok()).expect("the test waits for it");
        let _ = waits.recv();
    });
    assert_eq!(reads.recv(), Ok(true));
    board.close();
    assert_eq!(Arc::strong_count(&link), 1, "the thread has it");
    drop(ends);
    reader.join().expect("no panic");
}

/// LIB-41 No board is open before Open and after Close, and calls fail.
#[test]
fn calls_without_an_open_board_fail() {
    let link = FakeLink::new();
    let board = VendorBoard::new();
    assert_eq!(read(&board), Err(CallError::NotOpen.into()));
    assert_eq!(board.write(&Frame::new(), FRAME_LEN), Err(CallError::NotOpen.into()));
    board.open(|| Ok(link.clone())).expect("opens");
    board.close();
    assert_eq!(read(&board), Err(CallError::NotOpen.into()));
    assert_eq!(board.write(&Frame::new(), FRAME_LEN), Err(CallError::NotOpen.into()));
}

/// LIB-44 Open while open returns true, and the board goes on working.
#[test]
fn opening_twice_keeps_the_board() {
    let link = FakeLink::new();
    let board = opened(&link);
    board.open(no_second).expect("is open");
    assert_eq!(board.write(&Frame::new(), FRAME_LEN), Ok(()));
    assert!(!link.state().closed);
}

/// LIB-42 A failed Open returns false, leaves nothing open, and the next one may succeed.
#[test]
fn a_failed_open_can_be_repeated() {
    let board = VendorBoard::new();
    let none = LinkError::NoBoard { name: "fake:".to_owned(), reason: "not plugged in".to_owned() };
    let failed = board.open(|| Err(none.clone().into()));
    assert_eq!(failed, Err(none.into()));
    assert_eq!(read(&board), Err(CallError::NotOpen.into()));
    board.open(|| Ok(FakeLink::new())).expect("opens");
    assert_eq!(board.write(&Frame::new(), FRAME_LEN), Ok(()));
}

/// LIB-47 Close twice is harmless, and so is Close before any Open.
#[test]
fn closing_twice_is_harmless() {
    let link = FakeLink::new();
    VendorBoard::new().close();
    let board = opened(&link);
    board.close();
    board.close();
    assert!(link.state().closed);
}

/// LIB-35, LIB-38 A read waits without a limit and a write for 5 s, unless the link's URI sets other timeouts.
#[test]
fn waits_are_those_of_the_link() {
    let limits = (Wait::For(Duration::from_millis(7)), Wait::For(Duration::from_millis(9)));
    for (read_wait, write_wait) in [(Wait::Forever, Wait::For(Duration::from_secs(5))), limits] {
        let link = FakeLink::with_limits(read_wait, write_wait);
        link.change(|state| state.reports = 1);
        let board = opened(&link);
        read(&board).expect("a report");
        board.write(&Frame::new(), FRAME_LEN).expect("is taken");
        assert_eq!(link.state().read_waits[0], Some(read_wait));
        assert_eq!(link.state().write_waits[0], Some(write_wait));
    }
}

/// LIB-44 Open while a read waits returns true, and the waiting read is not ended: it returns true with the next report.
#[test]
fn a_read_goes_on_while_the_board_is_opened_again() {
    let link = FakeLink::new();
    let board = opened(&link);
    thread::scope(|scope| {
        let reader = scope.spawn(|| read(&board));
        link.wait_until(|state| state.readers == 1);
        board.open(no_second).expect("is open");
        link.change(|state| state.reports = 1);
        assert!(reader.join().expect("no panic").is_ok());
    });
}

/// LIB-48 Close ends a blocked read. LIB-26 A write does not wait for a blocked read.
#[test]
fn close_ends_a_blocked_read_and_a_write_passes_by() {
    let link = FakeLink::new();
    let board = opened(&link);
    thread::scope(|scope| {
        let reader = scope.spawn(|| read(&board));
        link.wait_until(|state| state.readers == 1);
        assert_eq!(board.write(&Frame::new(), FRAME_LEN), Ok(()));
        board.open(no_second).expect("is open");
        board.close();
        assert_eq!(reader.join().expect("no panic"), Err(LinkError::Closed.into()));
    });
}

/// LIB-49 A lost board stays unusable until Open is called; Close is not needed.
#[test]
fn a_lost_board_is_dead_until_it_is_opened_again() {
    let link = FakeLink::new();
    let board = opened(&link);
    thread::scope(|scope| {
        let reader = scope.spawn(|| read(&board));
        link.wait_until(|state| state.readers == 1);
        link.change(|state| state.lost = true);
        let ended = reader.join().expect("no panic").map_err(|error| *error);
        assert!(matches!(ended, Err(CallError::Link(LinkError::Lost { .. }))));
    });
    assert!(board.write(&Frame::new(), FRAME_LEN).is_err());
    assert!(read(&board).is_err());

    let again = FakeLink::new();
    board.open(|| Ok(again.clone())).expect("opens");
    assert!(link.state().closed, "the lost link is given back");
    assert_eq!(board.write(&Frame::new(), FRAME_LEN), Ok(()));
    assert!(again.state().write_waits[0].is_some(), "the write went to the new link");
}

/// LIB-49 Open detects a loss of the board that no read or write has noticed yet. SW_RESET restarts the board, so its link is
/// lost, and a program may write it and then call only Open.
#[test]
fn open_sees_a_loss_that_no_call_has_met() {
    let link = FakeLink::new();
    let board = opened(&link);
    link.change(|state| state.lost = true);
    let none = LinkError::NoBoard { name: "fake:".to_owned(), reason: "it is booting".to_owned() };
    assert_eq!(board.open(|| Err(none.clone().into())), Err(none.into()));
    board.open(|| Ok(FakeLink::new())).expect("opens");
    assert_eq!(board.write(&Frame::new(), FRAME_LEN), Ok(()));
}

/// LIB-44 Threads that open at the same time open the board once.
#[test]
fn threads_that_open_at_once_open_one_board() {
    let board = VendorBoard::new();
    let connects = AtomicUsize::new(0);
    thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| {
                board.open(|| {
                    connects.fetch_add(1, Ordering::Relaxed);
                    Ok(FakeLink::new())
                })
            });
        }
    });
    assert_eq!(connects.into_inner(), 1);
}

/// LIB-41 While another thread is still opening, calls fail at once and do not wait for it.
#[test]
fn calls_do_not_wait_for_an_open_under_way() {
    let board = VendorBoard::new();
    let (started, wait_started) = mpsc::channel();
    let (go_on, wait_go_on) = mpsc::channel::<()>();
    thread::scope(|scope| {
        let board = &board;
        let opener = scope.spawn(move || {
            board.open(|| {
                started.send(()).expect("the test waits for it");
                wait_go_on.recv().expect("the test sends it");
                Ok(FakeLink::new())
            })
        });
        wait_started.recv().expect("the opener sends it");
        assert_eq!(read(board), Err(CallError::NotOpen.into()));
        assert_eq!(board.write(&Frame::new(), FRAME_LEN), Err(CallError::NotOpen.into()));
        go_on.send(()).expect("the opener waits for it");
        opener.join().expect("no panic").expect("opens");
    });
    assert_eq!(board.write(&Frame::new(), FRAME_LEN), Ok(()));
}

/// LIB-71, LIB-47 While an Open is pending, Close does not wait for it, however often it is called; the board is open
/// afterwards.
#[test]
fn close_does_not_wait_for_an_open_under_way() {
    let (board, link) = (VendorBoard::new(), FakeLink::new());
    let (started, wait_started) = mpsc::channel();
    let (go_on, wait_go_on) = mpsc::channel::<()>();
    thread::scope(|scope| {
        let (board, link) = (&board, &link);
        let opener = scope.spawn(move || {
            board.open(|| {
                started.send(()).expect("the test waits for it");
                wait_go_on.recv().expect("the test sends it");
                Ok(link.clone())
            })
        });
        wait_started.recv().expect("the opener sends it");
        (0..100).for_each(|_| board.close());
        go_on.send(()).expect("the opener waits for it");
        opener.join().expect("no panic").expect("opens");
    });
    assert_eq!(board.write(&Frame::new(), FRAME_LEN), Ok(()));
}

/// LIB-71 An Open waits for a Close that is pending in another thread, so that the old link is free when Open opens a new one.
#[test]
fn open_waits_for_a_close_under_way() {
    let link = FakeLink::new();
    let board = opened(&link);
    link.change(|state| state.stays_in_close = true);
    thread::scope(|scope| {
        let (board, link) = (&board, &link);
        let closer = scope.spawn(|| board.close());
        link.wait_until(|state| state.closed);
        let opener = scope.spawn(move || {
            board.open(|| {
                assert!(!link.state().stays_in_close, "the one before is still being closed");
                Ok(FakeLink::new())
            })
        });
        // Usually 20 ms are enough for the other thread to begin its wait in Open. If it calls Open later, it has not
        // finished either.
        thread::sleep(Duration::from_millis(20));
        assert!(!opener.is_finished());
        link.change(|state| state.stays_in_close = false);
        closer.join().expect("no panic");
        opener.join().expect("no panic").expect("opens");
    });
}

/// Threads that are ended by force during a call.
#[cfg(target_os = "linux")]
mod gone {
    use super::*;

    /// Ends the calling thread as if by force: nothing that the thread holds is released.
    fn end_this_thread() -> ! {
        // SAFETY: the call ends this thread and nothing else.
        unsafe { libc::syscall(libc::SYS_exit, 0) };
        unreachable!("the thread has ended");
    }

    /// LIB-70 If a thread is ended while it opens or closes the board, the next call of Open opens the board.
    #[test]
    fn in_open_and_in_close() {
        let board: &'static VendorBoard = Box::leak(Box::new(VendorBoard::new()));
        for _ in 0..3 {
            let (started, wait_started) = mpsc::channel::<()>();
            thread::spawn(move || {
                board.open(move || {
                    std::mem::forget(started);
                    end_this_thread();
                })
            });
            assert!(wait_started.recv_timeout(Duration::from_millis(20)).is_err());
            let link = FakeLink::new();
            board.open(|| Ok(link.clone())).expect("opens");
            assert_eq!(board.write(&Frame::new(), FRAME_LEN), Ok(()));
            link.change(|state| state.ends_closer = true);
            thread::spawn(move || board.close());
            link.wait_until(|state| state.closed);
            let next = FakeLink::new();
            board.open(|| Ok(next.clone())).expect("opens");
            assert_eq!(board.write(&Frame::new(), FRAME_LEN), Ok(()));
            board.close();
        }
    }
}
