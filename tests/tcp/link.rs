//! The link `tcp:`: frames and reports, the one writer, results of calls.
#![cfg(unix)]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use ecmsk::ecm::{Close, Config, Ecm, Options};
use ecmsk::engine::Counters;
use ecmsk::link::{self, Dir, Layer, Link, LinkError, LinkStats, ReadMeta, Share, Stamp, Wait};
use ecmsk::sk::{Frame, MasterCommand, MasterState};
use support::tcp::{LIMIT, Puppet, SIZE, connect, frame, options, own, refused, serve, serve_link, until, uri};

/// Frames are transferred complete and unchanged, a write ends when the board has the frame, reports are numbered from
/// the client's connection, and the link's data about the board are the board's.
#[test]
fn frames_move_untouched() {
    let puppet = Puppet::new();
    let server = serve_link(puppet.clone(), options().0);
    puppet.report(&frame(1));
    let mut report = Frame::new();
    {
        let first = connect(&server, "role=reader");
        assert_eq!(first.info().slot, Some(SIZE));
        assert!(!first.info().virtual_time);
        puppet.report(&frame(2));
        first.read(&mut report, Wait::For(LIMIT)).unwrap();
    }
    let link = connect(&server, "");
    let odd = Frame::from_bytes(std::array::from_fn(|i| (i * 7) as u8));
    link.write(&odd, Wait::For(LIMIT)).unwrap();
    assert_eq!(puppet.taken(), [odd], "it is there when the call is back");
    for (number, byte) in [3, 4].into_iter().enumerate() {
        puppet.report(&frame(byte));
        let meta = link.read(&mut report, Wait::For(LIMIT)).unwrap();
        assert_eq!((report.clone(), meta.sequence, meta.dropped), (frame(byte), number as u64, 0));
    }
    assert_eq!(link.stats().reports_dropped, 0, "what the server's link has dropped before is not this client's");
    puppet.drop_reports(2);
    assert_eq!(link.stats().reports_dropped, 2, "the server's link has dropped as many since");
    assert_eq!(connect(&server, "role=reader").stats().reports_dropped, 0);
    assert_eq!((link.stats().written, link.stats().read), (1, 2));
}

/// On virtual time a served board produces the same bytes at the same times as one in the process.
#[test]
fn virtual_time_is_the_same_over_the_network() {
    let board = "sim:?slaves=drive*2&clock=virtual";
    let run = |link: Arc<dyn Link>| {
        let mut seen = Vec::new();
        let mut report = Frame::new();
        let mut command = Frame::new();
        command.put_master(SIZE, &MasterCommand::SetState(MasterState::Init));
        for n in 0..50 {
            if n % 10 == 3 {
                seen.push((link.write(&command, Wait::Forever).unwrap().0, ReadMeta::default(), Frame::new()));
            }
            if n % 10 == 7 {
                let now = link.pass(Duration::from_micros(2500)).unwrap().unwrap();
                assert_eq!(link.pass(Duration::ZERO).unwrap(), Some(now));
                seen.push((now.0, ReadMeta::default(), Frame::new()));
            }
            let meta = link.read(&mut report, Wait::For(Duration::from_secs(1))).unwrap();
            seen.push((0, meta, report.clone()));
        }
        let none = link.read(&mut report, Wait::Now);
        seen.push((link.pass(Duration::ZERO).unwrap().unwrap().0, none.unwrap_or_default(), report));
        seen
    };
    let (server, _) = serve(board);
    let (here, there) = (link::open(&own(board), Share::ByName).unwrap(), connect(&server, ""));
    assert!(there.info().virtual_time);
    let before = here.stats().board.expect("the board's counters");
    for (there, here) in run(Arc::clone(&there)).into_iter().zip(run(Arc::clone(&here))) {
        assert_eq!(there, here);
    }
    // The board here has made a report before it was opened; the client's counters start at its connection.
    let mut expected = here.stats();
    let counted = expected.board.as_mut().expect("the board's counters");
    assert_eq!((before.frames, before.reports), (0, 1), "the report of the boot");
    counted.reports -= before.reports;
    assert_eq!(there.stats(), expected);
    // A later client's counters are 0, including the board's.
    let later = connect(&server, "role=reader");
    let counted = later.stats().board.expect("the board's counters");
    assert_eq!(counted, Counters::default(), "time stands still while nobody lets it pass");
    there.write(&Frame::new(), Wait::Forever).unwrap();
    let (mine, all) = (later.stats().board.unwrap(), there.stats().board.unwrap());
    assert!(mine.frames == 1 && all.frames > 1, "{mine:?} {all:?}");
}

/// Readers of a board on virtual time get the same reports as its writer, and cannot let time pass.
#[test]
fn readers_cannot_let_virtual_time_pass() {
    let (server, _) = serve("sim:?slaves=drive*2&clock=virtual");
    let writer = connect(&server, "");
    let reader = connect(&server, "role=reader");
    assert!(!reader.info().virtual_time, "for a reader time passes by itself");
    let (mut ours, mut theirs) = (Frame::new(), Frame::new());
    assert_eq!(reader.pass(Duration::from_secs(1)).unwrap(), None);
    assert!(matches!(reader.read(&mut theirs, Wait::Now), Err(LinkError::Timeout { .. })));
    for _ in 0..10 {
        let wrote = writer.read(&mut ours, Wait::Forever).unwrap();
        let read = reader.read(&mut theirs, Wait::For(LIMIT)).unwrap();
        assert_eq!((wrote, &ours), (read, &theirs));
    }
}

/// Several clients read, one writes; a second writer's error names the first one, and it can connect when that one has
/// ended.
#[test]
fn one_writer_and_several_readers() {
    let (server, told) = serve("sim:?slaves=drive*2");
    let writer = connect(&server, "");
    let readers: Vec<_> = (0..3).map(|_| connect(&server, "role=reader")).collect();
    let second = refused(&server, "");
    let text = second.to_string();
    assert!(matches!(second, LinkError::InUse { .. }), "{second:?}");
    for part in [
        format!("PID {}", std::process::id()),
        "at 127.0.0.1:".to_owned(),
        "in use by tcp-".to_owned(),
        "role=reader".to_owned(),
    ] {
        assert!(text.contains(&part), "{text}: no {part}");
    }
    told.wait("second writer");
    let mut report = Frame::new();
    for reader in &readers {
        reader.read(&mut report, Wait::For(LIMIT)).unwrap();
        let refused = reader.write(&report, Wait::For(LIMIT)).unwrap_err();
        assert!(refused.to_string().contains("role=writer"), "{refused}");
    }
    writer.close();
    let next = connect(&server, "");
    next.write(&Frame::new(), Wait::For(LIMIT)).unwrap();
}

/// The limit of a write, and its cancellation, apply to the server's link: the board does not get the frame then.
#[test]
fn a_write_that_is_not_taken_ends() {
    let puppet = Puppet::new();
    let server = serve_link(puppet.clone(), options().0);
    let link = connect(&server, "");
    puppet.take_none(true);
    for wait in [Wait::Now, Wait::For(Duration::from_millis(30))] {
        let late = link.write(&frame(1), wait);
        assert!(matches!(late, Err(LinkError::Timeout { dir: Dir::Write, .. })), "{late:?}");
    }
    let waiting = thread::spawn({
        let link = Arc::clone(&link);
        move || link.write(&frame(2), Wait::Forever)
    });
    until("end of the write", || {
        link.cancel(Dir::Write);
        waiting.is_finished().then_some(())
    });
    assert_eq!(waiting.join().unwrap(), Err(LinkError::Cancelled { dir: Dir::Write }));
    puppet.take_none(false);
    link.write(&frame(3), Wait::For(LIMIT)).unwrap();
    assert_eq!(puppet.taken(), [frame(3)]);
}

/// Reads and writes of several threads at once do not disturb each other, and closing ends them all.
#[test]
fn closing_ends_every_wait() {
    let puppet = Puppet::new();
    let server = serve_link(puppet.clone(), options().0);
    let link = connect(&server, "");
    puppet.take_none(true);
    let waiting: Vec<_> = (0..4)
        .map(|n| {
            let link = Arc::clone(&link);
            thread::spawn(move || {
                if n % 2 == 0 {
                    link.read(&mut Frame::new(), Wait::Forever).err()
                } else {
                    link.write(&frame(1), Wait::Forever).err()
                }
            })
        })
        .collect();
    thread::sleep(Duration::from_millis(50));
    link.cancel(Dir::Read);
    link.close();
    link.close();
    for waiting in waiting {
        let error = waiting.join().unwrap().expect("nothing was done");
        assert!(matches!(error, LinkError::Closed | LinkError::Cancelled { dir: Dir::Read }), "{error:?}");
    }
    assert_eq!(link.check(), Err(LinkError::Closed));
    assert_eq!(link.read(&mut Frame::new(), Wait::Forever), Err(LinkError::Closed));
    assert_eq!(puppet.taken(), []);
}

/// A board whose writes take frames at once, and end when the test wants it.
struct Late {
    puppet: Arc<Puppet>,
    is_held: AtomicBool,
}

impl Layer for Late {
    fn inner(&self) -> &dyn Link {
        self.puppet.as_ref()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let done = self.puppet.write(frame, wait);
        until("end of the hold", || (!self.is_held.load(Ordering::Acquire)).then_some(()));
        done
    }
}

/// A frame that the board has taken is answered before the connection ends, also if the server is stopped or loses the
/// board while it is being written: the write has succeeded, and no program sends the frame again.
#[test]
fn a_frame_that_was_taken_is_answered_before_the_end() {
    for is_stopped in [false, true] {
        let puppet = Puppet::new();
        let late = Arc::new(Late { puppet: puppet.clone(), is_held: AtomicBool::new(true) });
        let server = serve_link(late.clone(), options().0);
        let (writer, reader) = (connect(&server, "keepalive_ms=60000"), connect(&server, "role=reader"));
        let writing = thread::spawn({
            let writer = Arc::clone(&writer);
            move || writer.write(&frame(1), Wait::For(LIMIT))
        });
        until("frame", || (puppet.taken().len() == 1).then_some(()));
        let mut server = Some(server);
        let stopping = if is_stopped {
            server.take().map(|server| thread::spawn(move || server.stop()))
        } else {
            puppet.lose("its cable was pulled");
            None
        };
        until("end of the reader", || reader.check().err());
        late.is_held.store(false, Ordering::Release);
        let written = writing.join().unwrap();
        assert!(written.is_ok(), "{is_stopped}: {written:?}");
        until("end of the writer", || writer.check().err());
        stopping.into_iter().for_each(|thread| thread.join().unwrap());
    }
}

/// A server that is stopped tells its clients, and closes the board.
#[test]
fn a_stopped_server_says_so() {
    let puppet = Puppet::new();
    let server = serve_link(puppet.clone(), options().0);
    let links = [connect(&server, ""), connect(&server, "role=reader")];
    let address = server.address();
    server.stop();
    assert!(puppet.is_closed());
    for link in links {
        let end = link.read(&mut Frame::new(), Wait::Forever).unwrap_err();
        assert!(matches!(&end, LinkError::Lost { reason, .. } if reason.contains("stopped")), "{end:?}");
    }
    let gone = link::open(&format!("tcp://{address}"), Share::ByName).err().unwrap().to_string();
    assert!(gone.contains("nobody listens") && gone.contains("ecmsk serve tcp"), "{gone}");
}

/// When the board behind the server is lost every client gets the reason, and the server opens it again.
#[test]
fn a_reset_board_comes_back() {
    for clock in ["real", "virtual"] {
        let (server, told) = serve(&format!("sim:?slaves=drive*2&clock={clock}"));
        let writer = connect(&server, "");
        let reader = connect(&server, "role=reader");
        let mut reset = Frame::new();
        reset.put_master(SIZE, &MasterCommand::SoftReset);
        reset.fill_crc(SIZE);
        let says_reset = |lost: &LinkError| {
            assert!(matches!(lost, LinkError::Lost { reason, .. } if reason.contains("SW_RESET")), "{lost:?}")
        };
        // The board may be lost before the server has confirmed the frame.
        let _ = writer.write(&reset, Wait::For(LIMIT)).inspect_err(says_reset);
        for link in [writer, reader] {
            says_reset(&until("loss", || link.read(&mut Frame::new(), Wait::For(LIMIT)).err()));
            assert!(link.check().is_err());
        }
        told.wait("the board is gone");
        told.wait("the board is back");
        let again = connect(&server, "");
        again.read(&mut Frame::new(), Wait::For(LIMIT)).unwrap();
    }
}

/// The native API works on a served board as on its own one, on either clock.
#[test]
fn a_program_moves_an_axis() {
    for clock in ["real", "virtual"] {
        let (server, told) = serve(&format!("sim:?slaves=drive*2&clock={clock}"));
        let ecm = Ecm::open(&uri(&server, "")).unwrap();
        ecm.configure(&Config::drives(2)).unwrap();
        ecm.set_state(MasterState::Op).unwrap();
        ecm.servo_on(&[1, 2]).unwrap();
        let mut stream = ecm.stream(32).unwrap();
        for n in 0..200 {
            stream.csp(1, n * 10).unwrap();
            stream.step().unwrap();
        }
        let end = stream.finish().unwrap();
        assert_eq!(end.losses, 0);
        let position = ecm.next_cycle(LIMIT).unwrap().position(1).unwrap();
        assert!((1990..3500).contains(&position), "{position}");
        ecm.close(Close::ServoOff).unwrap();
        told.wait("has closed its link");
        assert!(
            !told.lines().iter().any(|line| line.contains("stand still")),
            "TCP-10 a writer that closes is trusted"
        );
    }
}

/// A reader that does not read loses the oldest reports, which are counted, and slows no other client.
#[test]
fn a_slow_reader_loses_the_oldest_reports() {
    let puppet = Puppet::new();
    let server = serve_link(puppet.clone(), options().0);
    let quick = connect(&server, "role=reader");
    let slow = connect(&server, "role=reader&queue=4");
    let mut report = Frame::new();
    for n in 0..200_u64 {
        puppet.report(&frame(n as u8));
        let meta = quick.read(&mut report, Wait::For(LIMIT)).unwrap();
        assert_eq!((meta.sequence, meta.dropped), (n, 0));
    }
    let meta = until("reports of the slow reader", || {
        let meta = slow.read(&mut report, Wait::Now).ok()?;
        Some(meta)
    });
    assert_eq!(meta.sequence, meta.dropped, "what is missing is counted");
    let mut last = meta;
    while let Ok(meta) = slow.read(&mut report, Wait::For(Duration::from_millis(200))) {
        last = meta;
    }
    assert_eq!(last.sequence, 199, "the newest are kept");
}

/// A reader with `reconnect_ms` goes on when its server is available again, and its report numbers continue; a writer
/// has no such key.
#[test]
fn a_reader_connects_again() {
    let puppet = Puppet::new();
    let (options, _) = options();
    let server = serve_link(puppet.clone(), options.clone());
    let address = server.address();
    let reader = connect(&server, "role=reader&reconnect_ms=60000");
    let mut report = Frame::new();
    puppet.report(&frame(1));
    assert_eq!(reader.read(&mut report, Wait::For(LIMIT)).unwrap().sequence, 0);
    server.stop();
    let limited = reader.read(&mut report, Wait::For(Duration::from_millis(20)));
    assert!(matches!(limited, Err(LinkError::Timeout { .. })), "{limited:?}");
    // A link that is opened again counts from 0.
    let puppet = Puppet::new();
    let server = serve_link(puppet.clone(), ecmsk::port::tcp::ServeOptions { listen: address, ..options });
    let is_read = Arc::new(AtomicBool::new(false));
    let going = thread::spawn({
        let (puppet, is_read) = (puppet.clone(), Arc::clone(&is_read));
        move || {
            while !is_read.load(Ordering::Relaxed) {
                puppet.report(&frame(2));
                thread::sleep(Duration::from_millis(10));
            }
        }
    });
    let meta = reader.read(&mut report, Wait::For(LIMIT)).unwrap();
    is_read.store(true, Ordering::Relaxed);
    assert_eq!((meta.sequence, report), (1, frame(2)));
    reader.close();
    drop(server);
    going.join().unwrap();
    let writer = link::open(&format!("tcp://{address}?reconnect_ms=1"), Share::ByName).err().unwrap();
    assert!(matches!(&writer, LinkError::Uri(_)) && writer.to_string().contains("role=reader"), "{writer}");
}

/// While one thread of a reader connects again for as long as it takes, the limit of another one's read counts, and a
/// cancellation ends both.
#[test]
fn a_second_read_does_not_wait_for_the_one_that_connects_again() {
    let server = serve_link(Puppet::new(), options().0);
    let reader = connect(&server, "role=reader&reconnect_ms=3600000");
    server.stop();
    let read = |wait| {
        let reader = Arc::clone(&reader);
        thread::spawn(move || reader.read(&mut Frame::new(), wait))
    };
    let mut waiting = vec![read(Wait::Forever)];
    thread::sleep(Duration::from_millis(300));
    let limited = read(Wait::For(Duration::from_millis(20)));
    until("end of a limited read", || limited.is_finished().then_some(()));
    let limited = limited.join().unwrap();
    assert!(matches!(limited, Err(LinkError::Timeout { .. })), "{limited:?}");
    waiting.push(read(Wait::Forever));
    thread::sleep(Duration::from_millis(50));
    until("end of the cancelled reads", || {
        reader.cancel(Dir::Read);
        waiting.iter().all(thread::JoinHandle::is_finished).then_some(())
    });
    for thread in waiting {
        assert_eq!(thread.join().unwrap(), Err(LinkError::Cancelled { dir: Dir::Read }));
    }
}

/// Alarms, and failed changes of state, are in the server's log as texts with their times.
#[test]
fn alarms_are_in_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("script");
    std::fs::write(&script, "at 1500ms alarm 1 0x7500\n").unwrap();
    let (server, told) = serve(&format!("sim:?slaves=drive&clock=virtual&script={}", script.display()));
    let options = Options { close: Close::Leave, ..Options::default() };
    let ecm = Ecm::open_with(&uri(&server, ""), options).unwrap();
    assert!(ecm.set_state(MasterState::SafeOp).is_err(), "nothing is declared");
    told.wait(": a change of state failed, byte 2 of slot 0 is 0x12");
    ecm.configure(&Config::drives(1)).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
    while !told.lines().iter().any(|line| line == "at 1.501 s: slave 1 has an alarm, 0x7500: communication") {
        let now = ecm.next_cycle(LIMIT).unwrap().meta.at.0;
        assert!(now < 10_000_000_000, "{:?}", told.lines());
    }
}

/// A client's reads and writes allocate nothing once the link is open, on either clock.
#[test]
fn a_clients_calls_allocate_nothing() {
    for clock in ["real", "virtual"] {
        let (server, _told) = serve(&format!("sim:?slaves=drive*2&clock={clock}"));
        let link = connect(&server, "");
        let mut report = Frame::new();
        let mut exchange = || {
            link.write(&Frame::new(), Wait::For(LIMIT)).unwrap();
            link.read(&mut report, Wait::For(LIMIT)).unwrap();
            let _ = link.read(&mut report, Wait::Now);
            link.pass(Duration::ZERO).unwrap();
        };
        (0..10).for_each(|_| exchange());
        let counted = allocation_counter::measure(|| (0..200).for_each(|_| exchange()));
        assert_eq!(counted.count_total, 0, "{clock}: {counted:?}");
    }
}

/// A board that counts so many slaves with stale inputs.
struct Stale {
    inner: Arc<dyn Link>,
    slaves: AtomicU64,
}

impl Layer for Stale {
    fn inner(&self) -> &dyn Link {
        self.inner.as_ref()
    }

    fn stats(&self) -> LinkStats {
        let mut stats = self.inner.stats();
        if let Some(board) = &mut stats.board {
            board.inputs_stale = self.slaves.load(Ordering::Relaxed);
            board.inputs_held = 10 * board.inputs_stale;
        }
        stats
    }
}

/// Cycles with held inputs and slaves with stale inputs are counted for each client, from its connection on.
#[test]
fn stale_inputs_are_counted() {
    let inner = link::open(&own("sim:?slaves=drive&clock=virtual"), Share::ByName).unwrap();
    let board = Arc::new(Stale { inner, slaves: AtomicU64::new(2) });
    let server = serve_link(Arc::clone(&board) as Arc<dyn Link>, options().0);
    let client = connect(&server, "");
    // The answer shows that the server has noted the counters with which the connection began.
    client.stats();
    board.slaves.store(5, Ordering::Relaxed);
    let counted = client.stats().board.expect("the board's counters");
    assert_eq!((counted.inputs_held, counted.inputs_stale), (30, 3));
}
