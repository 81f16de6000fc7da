//! Tests in which a thread of the program is ended by force.

use super::super::super::calls::end_thread_in;
use super::*;

/// Checks that the program can continue after the loss of a thread: reads and writes in other threads, closing, and
/// opening again.
fn goes_on(world: &'static FakeUsb, pipe: Arc<Pipe>) {
    world.set_reaction(ReportReaction::All);
    world.send(status::COMPLETED, &[5; 512]);
    let reads = pipe.clone();
    assert_eq!(in_time(move || read(&reads, None)).map(|(fill, _)| fill), Ok(5));
    let writes = pipe.clone();
    assert_eq!(in_time(move || writes.write(&[9; REPORT_LEN], None)), Ok(()));
    // These are more reports than transfers, so the transfers must be resubmitted.
    (0..10).for_each(|fill| world.send(status::COMPLETED, &[fill; 512]));
    world.until_pending(LIMITS.transfers);
    in_time(move || pipe.close());
    let [_, _, _, claims, _] = world.leaked();
    assert_eq!(claims, 0, "others may have the board");
}

/// LIB-70 After a thread was ended while it handled events in a read, the program can continue, whether or not another
/// thread reads then.
#[test]
fn in_a_read() {
    for others in [0, 1] {
        let world = FakeUsb::with_descriptor();
        let pipe = Arc::new(open(world));
        let reads = pipe.clone();
        let handles = pipe.clone();
        end_thread_in(
            move || _ = read(&reads, None),
            move || {
                // Cancelling writes interrupts the thread that handles events. This is repeated until the reader
                // handles events and the pipe's thread sleeps.
                handles.cancel_writes();
                thread::sleep(Duration::from_millis(5));
                handles.shared.state.lock().thread_asleep
            },
        );
        let waiting: Vec<_> = (0..others)
            .map(|_| {
                let reads = pipe.clone();
                thread::spawn(move || read(&reads, None))
            })
            .collect();
        (0..others).for_each(|_| world.send(status::COMPLETED, &[3; 512]));
        for reader in waiting {
            assert!(in_time(move || reader.join().expect("no panic")).is_ok());
        }
        goes_on(world, pipe);
    }
}

/// LIB-70 A thread was ended while it handled events. Closing ends even if the pipe's thread has not noticed this
/// before.
#[test]
fn in_a_read_just_before_it_is_closed() {
    let world = FakeUsb::with_descriptor();
    let pipe = Arc::new(open(world));
    let gone = thread::spawn(CallingThread::current).join().expect("no panic");
    while !gone.is_gone() {
        thread::yield_now();
    }
    loop {
        // While calls come, the pipe's thread does not handle events all the time. The cancellation ends its long wait.
        pipe.cancel_writes();
        let _ = read(&pipe, Some(Duration::from_millis(1)));
        let mut state = pipe.shared.state.lock();
        if state.event_handler.is_none() {
            (state.event_handler, state.closing) = (Some(gone), true);
            break;
        }
    }
    in_time(move || pipe.close());
    assert_eq!(world.leaked()[3], 0, "others may have the board");
}

/// LIB-70 A thread is ended in a write that the board does not accept. The next write cancels the transfer; without
/// a next write, closing does.
#[test]
fn in_a_write() {
    for closes in [false, true] {
        let world = FakeUsb::with_descriptor();
        let pipe = Arc::new(open(world));
        world.set_reaction(ReportReaction::None { moved: 0 });
        let writes = pipe.clone();
        end_thread_in(
            move || _ = writes.write(&[1; REPORT_LEN], None),
            || {
                world.until_pending(LIMITS.transfers + 1);
                true
            },
        );
        if closes {
            in_time(move || pipe.close());
            assert_eq!(world.leaked()[3], 0, "others may have the board");
        } else {
            goes_on(world, pipe);
            assert_eq!(world.taken(), [[9; REPORT_LEN]], "what was not taken is not sent later");
        }
    }
}

/// LIB-70 A thread is ended while it waits for its turn to write: the threads that wait after it still get their turn.
#[test]
fn before_its_turn_to_write() {
    let world = FakeUsb::with_descriptor();
    let pipe = Arc::new(open(world));
    world.set_reaction(ReportReaction::None { moved: 0 });
    let (first, second) = (pipe.clone(), pipe.clone());
    let writer = thread::spawn(move || first.write(&[1; REPORT_LEN], None));
    world.until_pending(LIMITS.transfers + 1);
    end_thread_in(move || _ = second.write(&[2; REPORT_LEN], None), {
        let pipe = pipe.clone();
        move || pipe.shared.state.lock().writers.len() == 2
    });
    world.set_reaction(ReportReaction::All);
    pipe.cancel_writes();
    assert_eq!(in_time(move || writer.join().expect("no panic")), Err(PipeError::Cancelled));
    goes_on(world, pipe);
}
