//! Faults between a program and its board, `fault.*`.

use std::sync::Arc;
use std::thread;
use std::time::Duration;

use ecmsk::link::fault::FaultCounts;
use ecmsk::link::{self, Dir, Link, LinkError, Share, Wait};
use ecmsk::sk::{Frame, MasterCommand, MasterResponse, SlotSize, StateByte};

const SIZE: SlotSize = SlotSize::Bytes12;
const MS: u64 = 1_000_000;

fn open(options: &str) -> Arc<dyn Link> {
    let uri = format!("sim:?slaves=drive&clock=virtual&{options}");
    link::open(&uri, Share::ByName).unwrap_or_else(|error| panic!("{uri}: {error}"))
}

fn real(options: &str) -> Arc<dyn Link> {
    let uri = format!("sim:?slaves=drive&{options}");
    link::open(&uri, Share::ByName).unwrap_or_else(|error| panic!("{uri}: {error}"))
}

fn frame(command: MasterCommand) -> Frame {
    let mut frame = Frame::new();
    frame.put_master(SIZE, &command);
    frame
}

/// A valid frame.
fn status() -> Frame {
    frame(MasterCommand::GetStatus)
}

fn board(link: &dyn Link) -> ecmsk::engine::Counters {
    link.stats().board.expect("a simulated board shows its counters")
}

fn write(link: &dyn Link, frames: usize) {
    for _ in 0..frames {
        link.write(&status(), Wait::Forever).expect("written");
    }
}

/// Sequence numbers of the next `n` reports.
fn sequences(link: &dyn Link, n: usize) -> Vec<u64> {
    let mut report = Frame::new();
    (0..n).map(|_| link.read(&mut report, Wait::Forever).expect("a report").sequence).collect()
}

#[test]
fn a_link_without_faults_has_none() {
    let link = open("fault.seed=5");
    assert_eq!(sequences(&*link, 100), (0..100).collect::<Vec<_>>());
    assert_eq!(link.stats().faults, Default::default());
}

#[test]
fn a_dropped_write_succeeds_and_the_board_gets_nothing() {
    let link = open("fault.drop.write=1");
    let before = link.write(&status(), Wait::Forever).expect("it looks as if it were written");
    let after = link.write(&status(), Wait::Forever).expect("so does the next");
    assert!(after > before, "time passes all the same: {before:?} {after:?}");
    let stats = link.stats();
    assert_eq!((stats.written, stats.faults.write.dropped, board(&*link).frames), (2, 2, 0));
    assert_eq!(sequences(&*link, 3), [0, 1, 2], "reports come as ever");
}

#[test]
fn a_share_of_writes_is_dropped_by_the_seed() {
    let run = |seed: u64| {
        let link = open(&format!("fault.drop.write=0.1&fault.seed={seed}"));
        let got = |link: &dyn Link| board(link).frames;
        (0..1000)
            .map(|_| {
                let before = got(&*link);
                link.write(&status(), Wait::Forever).expect("written");
                got(&*link) > before
            })
            .collect::<Vec<_>>()
    };
    let first = run(1);
    let dropped = first.iter().filter(|arrived| !**arrived).count();
    assert!((50..150).contains(&dropped), "{dropped} of 1000 at a tenth");
    assert_eq!(run(1), first);
    assert_ne!(run(2), first);
}

/// Dropped reports leave gaps, the same ones in each run.
#[test]
fn dropped_reports_leave_gaps_and_the_same_ones_every_time() {
    let run = |options: &str| sequences(&*open(options), 500);
    let first = run("fault.drop.read=0.2");
    assert!(first.windows(2).all(|pair| pair[0] < pair[1]), "in order, each once");
    let last = *first.last().expect("500");
    assert!((550..750).contains(&last), "a fifth is gone: the last is {last}");
    assert_eq!(run("fault.drop=0.2"), first, "one key for both directions");
    assert_eq!(run("fault.drop=0.9&fault.drop.read=0.2&fault.delay_ms=1"), first, "one direction has the last word");

    let link = open("fault.drop.read=0.2");
    sequences(&*link, 500);
    let stats = link.stats();
    assert_eq!((stats.read, stats.faults.read.dropped), (500, last + 1 - 500));
    assert_eq!(stats.faults.write, FaultCounts::default());
}

#[test]
fn a_read_of_which_every_report_is_dropped_ends_at_its_limit_or_says_why() {
    let link = open("fault.drop.read=1");
    let mut out = Frame::from_bytes([0xA5; 512]);
    let error = link.read(&mut out, Wait::For(Duration::from_millis(50))).expect_err("none");
    assert_eq!(error.to_string(), "read timed out after 50ms: no report came");
    let error = link.read(&mut out, Wait::Now).expect_err("none");
    assert_eq!(error.to_string(), "read did not wait: no report came");
    let error = link.read(&mut out, Wait::Forever).expect_err("none");
    assert!(error.to_string().ends_with(": every report is dropped (fault.drop is 1)"), "{error}");
    assert_eq!(out.bytes(), &[0xA5; 512], "a read that fails leaves its frame alone");
    assert_eq!(link.stats().read_errors, 3);
}

/// One bit of a corrupt report is flipped.
#[test]
fn one_bit_of_a_corrupt_report_is_flipped() {
    let (good, bad) = (open("fault.seed=1"), open("fault.corrupt.read=1"));
    let (mut one, mut other) = (Frame::new(), Frame::new());
    for _ in 0..200 {
        good.read(&mut one, Wait::Forever).expect("a report");
        bad.read(&mut other, Wait::Forever).expect("a report");
        let turned: u32 = one.bytes().iter().zip(other.bytes()).map(|(a, b)| (a ^ b).count_ones()).sum();
        assert_eq!(turned, 1);
        assert_eq!(one.bytes()[504..], other.bytes()[504..], "what is behind the slots is no part of a frame");
    }
    assert_eq!(bad.stats().faults.read.corrupted, 200);
}

#[test]
fn one_bit_of_a_corrupt_command_is_flipped() {
    let link = open("fault.corrupt.write=1");
    let frame = status();
    let kept = frame.clone();
    for _ in 0..100 {
        link.write(&frame, Wait::Forever).expect("written");
    }
    assert_eq!(frame.bytes(), kept.bytes(), "the caller's frame is not touched");
    let stats = link.stats();
    assert_eq!((stats.written, stats.faults.write.corrupted, board(&*link).frames), (100, 100, 100));
    assert!(board(&*link).rejected_total() > 0, "some bit met the id of a slot: {:?}", board(&*link));
}

/// Duplicates arrive twice.
#[test]
fn a_duplicated_frame_arrives_twice() {
    let link = open("fault.duplicate=1");
    for _ in 0..10 {
        link.write(&status(), Wait::Forever).expect("written");
    }
    assert_eq!((link.stats().written, board(&*link).frames), (10, 20));
    let twice = sequences(&*link, 10);
    let first = twice[0];
    assert_eq!(twice, (0..10).map(|n| first + n / 2).collect::<Vec<_>>());
    let faults = link.stats().faults;
    assert_eq!((faults.write.duplicated, faults.read.duplicated), (10, 5));
}

#[test]
fn a_delayed_write_takes_longer_or_reaches_its_limit() {
    let plain = open("queue=32");
    let link = open("fault.delay.write=1&fault.delay_ms=200");
    let none = plain.write(&status(), Wait::Forever).expect("written");
    let late = link.write(&status(), Wait::Forever).expect("written");
    assert_eq!(late.0 - none.0, 200 * MS);

    let error = link.write(&status(), Wait::For(Duration::from_millis(50))).expect_err("too late");
    assert_eq!(error.to_string(), "write timed out after 50ms: the frame is held up (fault.delay)");
    assert_eq!(board(&*link).frames, 1, "it was not taken");
    let next = link.write(&status(), Wait::Forever).expect("written");
    assert_eq!(next.0 - late.0, (50 + 200) * MS + 125_000);
    assert_eq!(link.stats().faults.write.delayed, 3);
}

/// A delayed report comes later, in order.
#[test]
fn a_delayed_report_comes_later_and_in_its_turn() {
    let link = open("fault.delay.read=1&fault.delay_ms=100");
    let mut report = Frame::from_bytes([0xA5; 512]);
    let limit = Wait::For(Duration::from_millis(60));
    let error = link.read(&mut report, limit).expect_err("held up");
    assert_eq!(error.to_string(), "read timed out after 60ms: the report is held up (fault.delay)");
    assert_eq!(report.bytes(), &[0xA5; 512]);
    let meta = link.read(&mut report, limit).expect("now it is there");
    assert_eq!(meta.sequence, 0, "the same report");
    let now = link.pass(Duration::ZERO).expect("open").expect("virtual time");
    assert_eq!(now.0 - meta.at.0, 100 * MS, "as late as it was held up");
    let rest = sequences(&*link, 5);
    assert!(rest[0] >= 1 && rest.windows(2).all(|pair| pair[0] < pair[1]), "{rest:?}");
}

/// A program that polls does not stop a virtual clock.
#[test]
fn a_delayed_report_comes_to_a_program_that_polls() {
    let link = open("fault.delay.read=1&fault.delay_ms=5");
    let mut report = Frame::new();
    let polls = (1..1000).find(|_| link.read(&mut report, Wait::Now).is_ok());
    assert!(polls.is_some_and(|polls| polls > 5), "{polls:?}");
}

/// After that many frames the board is lost until it is opened again.
#[test]
fn after_disconnect_after_frames_the_board_is_lost_until_it_is_opened_again() {
    let uri = "name=lost-after&fault.disconnect_after=5";
    let link = open(uri);
    link.write(&status(), Wait::Forever).expect("1");
    sequences(&*link, 3);
    link.check().expect("still there");
    link.write(&status(), Wait::Forever).expect("5");
    let lost = LinkError::Lost { name: link.info().name, reason: "fault.disconnect_after".into() };
    let mut report = Frame::from_bytes([0xA5; 512]);
    assert_eq!(link.read(&mut report, Wait::Forever), Err(lost.clone()));
    assert_eq!(report.bytes(), &[0xA5; 512]);
    assert_eq!(link.write(&status(), Wait::Now), Err(lost.clone()));
    assert_eq!(link.check(), Err(lost.clone()));
    assert_eq!(link.pass(Duration::ZERO), Err(lost));
    assert!(link.stats().faults.disconnected);
    assert_eq!((link.stats().written, link.stats().read), (2, 3));
    link.close();
    assert_eq!(link.read(&mut report, Wait::Forever), Err(LinkError::Closed));

    let again = open(uri);
    assert!(again.info().opened_at > link.info().opened_at, "it is the same board");
    assert_eq!(sequences(&*again, 5).len(), 5);
    assert!(matches!(again.read(&mut report, Wait::Forever), Err(LinkError::Lost { .. })));
}

#[test]
fn after_disconnect_ms_the_board_is_lost() {
    let link = open("fault.disconnect_ms=100");
    let mut report = Frame::new();
    let zero = link.info().opened_at.0;
    let (mut reads, mut last) = (0, zero);
    let lost = loop {
        match link.read(&mut report, Wait::Forever) {
            Ok(meta) => (reads, last) = (reads + 1, meta.at.0),
            Err(error) => break error,
        }
    };
    assert_eq!(lost, LinkError::Lost { name: link.info().name, reason: "fault.disconnect_ms".into() });
    assert!(last < zero + 100 * MS && last > zero + 98 * MS, "{last}");
    assert!(reads > 90, "one a cycle: {reads}");
}

/// On the real clock another thread's wait ends with the board's loss, with a report or without.
#[test]
fn a_wait_ends_when_the_board_is_taken_away() {
    let link = real("fault.disconnect_ms=100&fault.drop.read=1");
    let error = link.read(&mut Frame::new(), Wait::Forever).expect_err("no report and then no board");
    assert!(matches!(error, LinkError::Lost { .. }), "{error}");

    let link = real("fault.disconnect_after=1&fault.drop.read=1");
    let reader = thread::spawn({
        let link = Arc::clone(&link);
        move || link.read(&mut Frame::new(), Wait::Forever)
    });
    while link.stats().faults.read.dropped == 0 {
        thread::yield_now();
    }
    link.write(&status(), Wait::Forever).expect("the one frame");
    let error = reader.join().expect("no panic").expect_err("its board is gone");
    assert!(matches!(error, LinkError::Lost { .. }), "{error}");
}

/// A delay ends with the board's loss.
#[test]
fn a_delay_ends_when_the_board_is_taken_away() {
    let hour = "fault.delay=1&fault.delay_ms=3600000";
    for dir in [Dir::Write, Dir::Read] {
        let call = move |link: &dyn Link| match dir {
            Dir::Write => link.write(&status(), Wait::Forever).err(),
            Dir::Read => link.read(&mut Frame::new(), Wait::Forever).err(),
        };
        let error = call(&*real(&format!("{hour}&fault.disconnect_ms=50")));
        assert!(matches!(error, Some(LinkError::Lost { .. })), "{error:?}");
    }
    let link = real("fault.delay.write=1&fault.delay_ms=3600000&fault.disconnect_after=1");
    let writer = thread::spawn({
        let link = Arc::clone(&link);
        move || link.write(&status(), Wait::Forever)
    });
    while link.stats().faults.write.delayed == 0 {
        thread::yield_now();
    }
    link.read(&mut Frame::new(), Wait::Forever).expect("the one frame");
    let error = writer.join().expect("no panic").expect_err("its board is gone");
    assert!(matches!(error, LinkError::Lost { .. }), "{error}");
}

#[test]
fn cancel_and_close_end_a_delay_at_once() {
    // An hour, which does not pass.
    let link = real("fault.delay=1&fault.delay_ms=3600000");
    for (dir, end) in [(Dir::Write, false), (Dir::Read, false), (Dir::Write, true)] {
        let waiting = thread::spawn({
            let link = Arc::clone(&link);
            move || match dir {
                Dir::Write => link.write(&status(), Wait::Forever).err(),
                Dir::Read => link.read(&mut Frame::new(), Wait::Forever).err(),
            }
        });
        let held = |link: &dyn Link| match dir {
            Dir::Write => link.stats().faults.write.delayed,
            Dir::Read => link.stats().faults.read.delayed,
        };
        let before = if end { 1 } else { 0 };
        while held(&*link) == before {
            thread::yield_now();
        }
        if end {
            link.close()
        } else {
            link.cancel(dir)
        }
        let wanted = if end { LinkError::Closed } else { LinkError::Cancelled { dir } };
        assert_eq!(waiting.join().expect("no panic"), Some(wanted));
    }
}

/// Reader and writer are two threads: each direction has its own sequence of faults.
#[test]
fn each_direction_has_its_own_sequence_of_faults() {
    let link = real("fault.drop=0.3&queue=1024");
    let writer = thread::spawn({
        let link = Arc::clone(&link);
        move || write(&*link, 300)
    });
    sequences(&*link, 100);
    writer.join().expect("no panic");
    let two = link.stats().faults;
    let alone = open("fault.drop=0.3&queue=1024");
    write(&*alone, 300);
    sequences(&*alone, 100);
    assert_eq!(alone.stats().faults, two);
}

/// A recording holds what the program has seen.
#[test]
fn a_recording_holds_what_the_program_has_seen_of_the_faults() {
    let file = support::out_dir().join("faults.pcapng");
    let link = open(&format!("fault.drop.write=1&fault.duplicate.read=1&record={}", file.display()));
    link.write(&status(), Wait::Forever).expect("written");
    let seen = sequences(&*link, 4);
    assert_eq!(seen[0], seen[1]);
    link.close();
    let recording = ecmsk::recording::Recording::open(&file).expect("a recording");
    let dirs: Vec<Dir> = recording.map(|frame| frame.expect("readable").dir).collect();
    assert_eq!(dirs, [Dir::Write, Dir::Read, Dir::Read, Dir::Read, Dir::Read]);
}

#[test]
fn a_call_allocates_nothing() {
    let link = open("fault.drop=0.2&fault.corrupt=0.2&fault.duplicate=0.2&fault.delay=0.1&fault.delay_ms=1");
    let (command, mut report) = (status(), Frame::new());
    let counted = allocation_counter::measure(|| {
        for _ in 0..500 {
            link.write(&command, Wait::Forever).expect("written");
            link.read(&mut report, Wait::Forever).expect("a report");
        }
    });
    assert_eq!(counted.count_total, 0, "{counted:?}");
    let faults = link.stats().faults;
    for side in [faults.write, faults.read] {
        assert!(side.dropped > 0 && side.corrupted > 0 && side.duplicated > 0 && side.delayed > 0, "{faults:?}");
    }
}

/// A program that does not handle faults: its read fails, and the board is available again.
mod needs_cxx {
    use support::{Language, compile, root};

    #[test]
    fn an_unmodified_program_meets_a_lost_board() {
        let program = compile(&root().join("examples/cpp/two_axes_12b.cpp"), Language::Cpp("c++17"));
        let ended = program.run("sim:?slaves=drive*2&clock=virtual&fault.disconnect_after=500", [""; 0]);
        assert_eq!(ended.status.code(), Some(1), "{ended:?}");
        assert!(ended.stderr.starts_with("failed: ECMUSB"), "{ended:?}");

        let steady = program.run("sim:?slaves=drive*2&clock=virtual", [""; 0]).success();
        let shaken = "sim:?slaves=drive*2&clock=virtual&fault.drop.read=0.2&fault.delay.read=0.01&fault.delay_ms=5";
        let said = program.run(shaken, [""; 0]).success();
        assert_eq!(said.lines().last(), steady.lines().last(), "it arrives although reports are lost");
        assert_eq!(program.run(shaken, [""; 0]).success(), said, "and the same every time");
    }
}

/// Faults of the link do not affect the model.
#[test]
fn faults_of_the_link_do_not_change_the_board() {
    let link = open("fault.drop.read=0.5");
    let mut report = Frame::new();
    link.read(&mut report, Wait::Forever).expect("a report");
    let answer = MasterResponse::decode(&report.slot(SIZE, 0));
    assert_eq!(answer.state, StateByte::reached(ecmsk::sk::MasterState::PreOp));
    assert_eq!(answer.result, 0);
}
