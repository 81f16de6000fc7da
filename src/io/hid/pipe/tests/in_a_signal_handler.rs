//! Calls in a signal handler that has interrupted a call of the same pipe, for example `CloseECMUSB(); exit(0);` for
//! Ctrl-C, or a frame that stops the axes. The interrupted call cannot continue before the handler returns.

use std::cell::Cell;
use std::os::unix::thread::JoinHandleExt as _;

use super::*;

type Handler = Box<dyn FnOnce() + Send>;

thread_local! {
    static HANDLER: Cell<Option<Handler>> = const { Cell::new(None) };
}

extern "C" fn handle(_signal: libc::c_int) {
    if let Some(handler) = HANDLER.take() {
        handler();
    }
}

/// Runs `work` in a thread. Once `waits_in` returns true, `handler` runs in a signal handler of that thread. Returns
/// the results of `handler` and of `work`.
#[track_caller]
fn interrupted<T: Send + 'static, H: Send + 'static>(
    work: impl FnOnce() -> T + Send + 'static,
    mut waits_in: impl FnMut() -> bool,
    handler: impl FnOnce() -> H + Send + 'static,
) -> (H, T) {
    // SAFETY: the handler runs what its test has put there, and no other test uses this signal.
    unsafe { libc::signal(libc::SIGUSR1, handle as extern "C" fn(libc::c_int) as libc::sighandler_t) };
    let (handled, handler_ends) = mpsc::channel();
    let (worked, work_ends) = mpsc::channel();
    let thread = thread::spawn(move || {
        HANDLER.set(Some(Box::new(move || _ = handled.send(handler()))));
        let _ = worked.send(work());
    });
    while !waits_in() {
        thread::sleep(Duration::from_millis(1));
    }
    thread::sleep(Duration::from_millis(30));
    // SAFETY: the thread was not joined, so its handle is valid.
    unsafe { libc::pthread_kill(thread.as_pthread_t(), libc::SIGUSR1) };
    let handled = handler_ends.recv_timeout(PATIENCE).expect("the handler does not end");
    (handled, work_ends.recv_timeout(PATIENCE).expect("the call does not end"))
}

/// Returns a check whether a call of the program handles events, while the pipe's thread sleeps.
fn a_call_handles_events(pipe: &Arc<Pipe>) -> impl FnMut() -> bool + use<> {
    let pipe = pipe.clone();
    move || {
        // Ends the wait of the thread that handles events. This is repeated until the thread of the call handles
        // events.
        pipe.cancel_writes();
        thread::sleep(Duration::from_millis(5));
        pipe.shared.state.lock().thread_asleep
    }
}

/// LIB-70 A handler that has interrupted a read closes the pipe: the closing ends, then the read, and other programs
/// can open the board.
#[test]
fn closing_ends() {
    let world = FakeUsb::with_descriptor();
    let pipe = Arc::new(open(world));
    let (reads, closes) = (pipe.clone(), pipe.clone());
    let left = move || {
        closes.close();
        world.leaked()[3]
    };
    let ended = interrupted(move || read(&reads, None), a_call_handles_events(&pipe), left);
    assert_eq!(ended, (0, Err(PipeError::Closed)));
    drop(pipe);
    assert_eq!(world.leaked(), NOTHING_LEFT);
}

/// LIB-70 Another thread closes the pipe while a handler that has interrupted a read does not return.
#[test]
fn closing_does_not_wait_for_a_handler() {
    let world = FakeUsb::with_descriptor();
    let pipe = Arc::new(open(world));
    let (reads, closes) = (pipe.clone(), pipe.clone());
    let handler = move || {
        // The handler closes the pipe in another thread and returns a result, since a panic must not leave the handler.
        let (closed, closing_ends) = mpsc::channel();
        thread::spawn(move || {
            closes.close();
            let _ = closed.send(world.leaked()[3]);
        });
        closing_ends.recv_timeout(PATIENCE / 2)
    };
    let ended = interrupted(move || read(&reads, None), a_call_handles_events(&pipe), handler);
    assert_eq!(ended, (Ok(0), Err(PipeError::Closed)));
}

/// LIB-70 Frames that a handler writes after it has interrupted a read reach the board, and the read continues.
#[test]
fn frames_go_out_in_a_read() {
    let world = FakeUsb::with_descriptor();
    let pipe = Arc::new(open(world));
    let (reads, writes) = (pipe.clone(), pipe.clone());
    let handler = move || {
        let written = [7, 8].map(|fill| writes.write(&[fill; REPORT_LEN], Some(PATIENCE)));
        world.send(status::COMPLETED, &[5; 512]);
        written
    };
    let ended = interrupted(move || read(&reads, None), a_call_handles_events(&pipe), handler);
    assert_eq!(ended, ([Ok(()); 2], Ok((5, 0))));
    assert_eq!(world.taken(), [[7; REPORT_LEN], [8; REPORT_LEN]]);
}

/// LIB-70 A frame that a handler writes after it has interrupted a write follows the frame whose transfer is submitted:
/// the frame of the interrupted write, or the frame of another thread for which the interrupted write still waits.
#[test]
fn frames_go_out_in_a_write() {
    for has_other in [false, true] {
        let world = FakeUsb::with_descriptor();
        let pipe = Arc::new(open(world));
        world.set_reaction(ReportReaction::None { moved: 0 });
        let other = has_other.then(|| {
            let other = pipe.clone();
            let other = thread::spawn(move || other.write(&[1; REPORT_LEN], None));
            world.until_pending(LIMITS.transfers + 1);
            other
        });
        let (writes, stops, looks) = (pipe.clone(), pipe.clone(), pipe.clone());
        let writers = if has_other { 2 } else { 1 };
        let waits = move || {
            world.until_pending(LIMITS.transfers + 1);
            looks.shared.state.lock().writers.len() == writers
        };
        let handler = move || {
            let accepts = thread::spawn(move || {
                thread::sleep(Duration::from_millis(30));
                world.set_reaction(ReportReaction::All);
                world.accept_pending();
            });
            let written = stops.write(&[9; REPORT_LEN], Some(PATIENCE));
            accepts.join().expect("no panic");
            written
        };
        let ended = interrupted(move || writes.write(&[2; REPORT_LEN], None), waits, handler);
        assert_eq!(ended, (Ok(()), Ok(())), "{has_other}");
        if let Some(other) = other {
            assert_eq!(in_time(move || other.join().expect("no panic")), Ok(()));
        }
        // With another writer the interrupted write still waits for its turn and has submitted nothing, so the
        // handler's frame comes before the frame of the interrupted write.
        let order: &[u8] = if has_other { &[1, 9, 2] } else { &[2, 9] };
        assert_eq!(world.taken().iter().map(|frame| frame[0]).collect::<Vec<_>>(), order);
        assert_eq!(pipe.write(&[3; REPORT_LEN], Some(PATIENCE)), Ok(()), "nobody's turn is left");
    }
}
