//! Calls in a signal handler that has interrupted a call of the same link, as a program makes them that stops its axes on Ctrl-C.
//! The interrupted call cannot go on before the handler returns.

use std::cell::Cell;
use std::os::unix::thread::JoinHandleExt as _;
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

use ecmsk::link::{Link, LinkError, Stamp, Wait};
use ecmsk::sk::Frame;
use support::tcp::{LIMIT, Puppet, connect, frame, options, serve_link, until};

type Handler = Box<dyn FnOnce() + Send>;

thread_local! {
    static HANDLER: Cell<Option<Handler>> = const { Cell::new(None) };
}

extern "C" fn handle(_signal: libc::c_int) {
    if let Some(handler) = HANDLER.take() {
        handler();
    }
}

/// Runs `work` in a thread. 50 ms later a signal handler writes `frame` there. Gives the result of that, and when `work` has
/// ended its result.
#[track_caller]
fn write_while<T: Send + 'static>(
    link: &Arc<dyn Link>,
    stop: Frame,
    work: impl FnOnce(&dyn Link) -> T + Send + 'static,
) -> (Result<Stamp, LinkError>, mpsc::Receiver<T>) {
    // SAFETY: the handler runs what its test has put there, and no other test uses this signal.
    unsafe { libc::signal(libc::SIGUSR1, handle as extern "C" fn(libc::c_int) as libc::sighandler_t) };
    let ((handled, handler_ends), (worked, work_ends)) = (mpsc::channel(), mpsc::channel());
    let (works, writes) = (Arc::clone(link), Arc::clone(link));
    let thread = thread::spawn(move || {
        HANDLER.set(Some(Box::new(move || _ = handled.send(writes.write(&stop, Wait::For(LIMIT))))));
        let _ = worked.send(work(&*works));
    });
    thread::sleep(Duration::from_millis(50));
    // SAFETY: the thread was not joined, so its handle is valid.
    unsafe { libc::pthread_kill(thread.as_pthread_t(), libc::SIGUSR1) };
    (handler_ends.recv_timeout(LIMIT).expect("the handler does not end"), work_ends)
}

/// LIB-70 A frame of a handler that has interrupted a read is answered at once, and the read goes on.
#[test]
fn a_frame_goes_out_in_a_read() {
    let puppet = Puppet::new();
    let server = serve_link(puppet.clone(), options().0);
    let link = connect(&server, "");
    let (written, read) = write_while(&link, frame(9), |link| link.read(&mut Frame::new(), Wait::Forever).map(drop));
    assert!(written.is_ok(), "{written:?}");
    puppet.report(&frame(5));
    assert_eq!(read.recv_timeout(LIMIT), Ok(Ok(())));
    assert_eq!(puppet.taken(), [frame(9)]);
}

/// LIB-70 A frame of a handler that has interrupted a write goes out when the board has taken the frame of that write.
#[test]
fn a_frame_goes_out_in_a_write() {
    let puppet = Puppet::new();
    let server = serve_link(puppet.clone(), options().0);
    let link = connect(&server, "");
    puppet.take_none(true);
    let takes = thread::spawn({
        let puppet = puppet.clone();
        move || {
            thread::sleep(Duration::from_millis(150));
            puppet.take_none(false);
        }
    });
    let (written, first) = write_while(&link, frame(9), |link| link.write(&frame(1), Wait::For(LIMIT)).map(drop));
    assert!(written.is_ok(), "{written:?}");
    assert_eq!(first.recv_timeout(LIMIT), Ok(Ok(())));
    takes.join().expect("no panic");
    link.write(&frame(2), Wait::For(LIMIT)).expect("nothing is left in progress");
    until("three frames", || (puppet.taken().len() == 3).then_some(()));
    assert_eq!(puppet.taken(), [frame(1), frame(9), frame(2)]);
}
