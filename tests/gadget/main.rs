//! The virtual board at a device port (`ecmsk serve gadget`), with the host in the hands of the tests instead of a controller:
//! frames and reports, hosts that go, boards that are lost. What only a kernel shows is in tests/rig.
#![cfg(target_os = "linux")]

mod at_rest;
mod refused;

use std::time::{Duration, Instant};

use ecmsk::ecm::{Axis, Close, Config, Ecm, Options, Slave, SlaveView};
use ecmsk::io::gadget::wire::Event;
use ecmsk::link::{self, Dir, Share, Wait};
use ecmsk::port::gadget::in_memory::{InMemory, Stalled};
use ecmsk::port::gadget::{self, OnVanish};
use ecmsk::sk::{Frame, MasterCommand, MasterState, Motion, SlaveCommand, SlotSize};
use support::served::recorded;

const SIZE: SlotSize = SlotSize::Bytes12;
/// Longer than anything takes.
const LIMIT: Duration = Duration::from_secs(20);

fn served(uri: &str, on_vanish: OnVanish) -> InMemory {
    let uri = uri.to_owned();
    let options = gadget::Options { on_vanish, retry: Duration::from_millis(5), ..gadget::Options::default() };
    InMemory::start(Box::new(move || link::open(&uri, Share::ByUri)), options).expect("it is served")
}

/// Waits until the log has a line with that part; gives all lines up to then.
#[track_caller]
fn until_told(board: &InMemory, part: &str) -> Vec<String> {
    let (end, mut lines) = (Instant::now() + LIMIT, Vec::new());
    loop {
        lines.extend(board.lines());
        if lines.iter().any(|line| line.contains(part)) {
            return lines;
        }
        assert!(Instant::now() < end, "{part}: {lines:?}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[track_caller]
fn until(what: &str, mut done: impl FnMut() -> bool) {
    let end = Instant::now() + LIMIT;
    while !done() {
        assert!(Instant::now() < end, "{what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Axis 1 in CSP, 2 in CSV.
fn config() -> Config {
    Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSV)], ..Config::default() }
}

/// The board as a program at the host has it.
fn program(board: &InMemory) -> Ecm {
    let options = Options { slot: Some(SIZE), close: Close::Leave, ..Options::default() };
    Ecm::over(board.host(), options).expect("reports come")
}

/// A host that has switched both axes on.
fn prepared(board: &InMemory) {
    let ecm = program(board);
    ecm.configure(&config()).expect("it is set up");
    ecm.set_state(MasterState::Op).expect("it is in OP");
    ecm.servo_on(&[1, 2]).expect("both are on");
    ecm.close(Close::Leave).expect("nothing is sent");
}

/// A host that has both axes moving by frames of its own.
fn moving(board: &InMemory) {
    prepared(board);
    let link = board.host();
    for n in 1..=300 {
        let mut frame = Frame::new();
        frame.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(n * 100)).into());
        frame.put_slave(SIZE, 2, &SlaveCommand::Csv(Motion::to(100_000)).into());
        frame.fill_crc(SIZE);
        link.write(&frame, Wait::For(LIMIT)).expect("it is taken");
        // Some are ahead of the board, as those of programs are.
        if n > 50 {
            link.read(&mut Frame::new(), Wait::For(LIMIT)).expect("a report");
        }
    }
}

/// Positions of both axes, and whether they are on: now and 100 cycles later.
fn look(board: &InMemory) -> [[(i32, bool); 2]; 2] {
    let ecm = program(board);
    ecm.adopt(&config()).expect("it runs");
    let seen = |cycles: u32| {
        let mut newest = ecm.next_cycle(LIMIT).expect("a report");
        for _ in 1..cycles {
            newest = ecm.next_cycle(LIMIT).expect("a report");
        }
        [1, 2].map(|slave| match newest.slave(slave) {
            Some(SlaveView::Drive(drive)) => (drive.position, drive.statusword.is_enabled()),
            other => panic!("slave {slave} is {other:?}"),
        })
    };
    let looks = [seen(2), seen(100)];
    ecm.close(Close::Leave).expect("nothing is sent");
    looks
}

/// WIRE-126 A host that is unplugged, or that sleeps, has vanished as a writer may: its axes are brought to a standstill and stay
/// on; with `servo-off` they are switched off, and with `leave` a velocity goes on.
#[test]
fn axes_of_a_host_that_is_gone_stand() {
    for (name, on_vanish, moves, on, sleeps) in [
        ("a", OnVanish::Ramp, false, true, false),
        ("b", OnVanish::Ramp, false, true, true),
        ("c", OnVanish::ServoOff, false, false, false),
        ("d", OnVanish::Leave, true, true, false),
    ] {
        let board = served(&format!("sim:?name=gadget-{name}&slaves=drive*2&queue=1"), on_vanish);
        board.attach();
        moving(&board);
        if sleeps {
            board.event(Event::Suspended)
        } else {
            board.detach()
        }
        let why = if sleeps { "it sleeps, or was unplugged" } else { "it was unplugged, or has reset the board" };
        let told = if moves {
            "axes are left as they are".to_owned()
        } else {
            format!("axes stand still after the host is gone ({why})")
        };
        let lines = until_told(&board, &told);
        assert!(lines.iter().any(|line| line.starts_with(&format!("the host is gone, {why}; "))), "{lines:?}");
        board.event(if sleeps { Event::Resumed } else { Event::Enabled });
        let [first, later] = look(&board);
        // Left alone, axis 1 comes to the end of the FIFO; a velocity has no end.
        for axis in if moves { 1..2 } else { 0..2 } {
            let moved = later[axis].0 - first[axis].0;
            let holds = if moves { moved > 1000 } else { moved.abs() < 20 };
            assert!(holds, "{on_vanish:?} axis {axis}: {moved}");
        }
        assert!(later.iter().all(|axis| axis.1 == on), "{on_vanish:?}: {later:?}");
    }
}

/// WIRE-126 A controller may report a pulled cable as an idle bus at first, and that the host is gone later. The axes are stopped
/// once, and the next host has the board, even if it comes before they stand.
#[test]
fn a_pulled_cable_may_look_like_sleep() {
    for is_quick in [false, true] {
        let board = served(&format!("sim:?name=gadget-idle-{is_quick}&slaves=drive*2&queue=1"), OnVanish::Ramp);
        board.attach();
        moving(&board);
        board.event(Event::Suspended);
        const STAND: &str = "axes stand still after the host is gone (it sleeps, or was unplugged)";
        let mut lines = if is_quick { Vec::new() } else { until_told(&board, STAND) };
        board.detach();
        board.attach();
        if is_quick {
            lines = until_told(&board, STAND);
        }
        let [first, later] = look(&board);
        assert!((0..2).all(|axis| (later[axis].0 - first[axis].0).abs() < 20 && later[axis].1), "{first:?} {later:?}");
        lines.extend(board.stop());
        assert_eq!(lines.iter().filter(|line| line.starts_with("the host is gone, ")).count(), 1, "{lines:?}");
        assert_eq!(
            lines.iter().filter(|line| line.contains("axes stand still after the host")).count(),
            1,
            "{lines:?}"
        );
    }
}

/// WIRE-126 A server that is stopped while a host has the board stops its axes, too.
#[test]
fn a_server_that_is_stopped_stops_the_axes() {
    let board = served("sim:?name=gadget-stop&slaves=drive*2&queue=1", OnVanish::Ramp);
    board.attach();
    moving(&board);
    let lines = board.stop();
    assert!(lines.iter().any(|line| line.contains("axes stand still after the server was stopped")), "{lines:?}");
}

/// WIRE-126 A host that has sent nothing leaves nothing to be stopped: what another one has started goes on.
#[test]
fn a_host_that_only_reads_stops_nothing() {
    let board = served("sim:?name=gadget-reads&slaves=drive*2&queue=1", OnVanish::Leave);
    board.attach();
    moving(&board);
    board.detach();
    until_told(&board, "axes are left as they are");
    for _ in 0..3 {
        board.attach();
        assert!(board.get(LIMIT).is_some());
        board.detach();
        let lines = until_told(&board, "the host is gone");
        assert!(!lines.iter().any(|line| line.contains("axes")), "{lines:?}");
    }
}

/// WIRE-126 A packet that the controller has received before its host reset the board, or slept and woke, belongs to the session
/// before, however late the server notices it: it starts no axis that was stopped.
#[test]
fn a_frame_of_the_session_before_starts_nothing() {
    for (name, events) in [
        ("reset", &[Event::Disabled, Event::Enabled][..]),
        ("again", &[Event::Enabled]),
        ("woken", &[Event::Suspended, Event::Resumed]),
    ] {
        let board = served(&format!("sim:?name=gadget-late-{name}&slaves=drive*2&queue=1"), OnVanish::Ramp);
        board.attach();
        moving(&board);
        let mut frame = Frame::new();
        frame.put_slave(SIZE, 2, &SlaveCommand::Csv(Motion::to(100_000)).into());
        frame.fill_crc(SIZE);
        assert!(board.put_unnoticed(frame.bytes(), LIMIT), "{name}");
        events.iter().for_each(|event| board.event(*event));
        let mut lines = until_told(&board, "axes stand still after the host is gone");
        let [first, later] = look(&board);
        assert!((later[1].0 - first[1].0).abs() < 20, "{name}: {first:?} {later:?}");
        lines.extend(board.stop());
        assert!(lines.iter().any(|line| line.starts_with("the host is gone")), "{lines:?}");
    }
}

/// Frames arrive once, whole and in order, and every report is a new one.
#[test]
fn no_frame_is_lost_or_doubled() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("run.pcapng");
    let uri = format!("sim:?name=gadget-frames&slaves=io&queue=1&record={}", file.display());
    let board = served(&uri, OnVanish::Ramp);
    board.attach();
    let mut sent = Vec::new();
    for number in 0..1000_u32 {
        // Numbered in the data of a slave's slot that asks for nothing.
        let mut frame = Frame::new();
        frame.bytes_mut()[16..20].copy_from_slice(&number.to_le_bytes());
        frame.bytes_mut()[504..512].copy_from_slice(&[number as u8; 8]);
        assert!(board.put(frame.bytes(), LIMIT), "{number}");
        sent.push(frame);
        if number % 7 == 0 {
            assert!(board.get(LIMIT).is_some(), "{number}");
        }
    }
    until("the last one is handed on", || board.put(Frame::new().bytes(), Duration::ZERO));
    board.stop();
    let arrived = recorded(&file.to_string_lossy(), Dir::Write);
    assert!(arrived.starts_with(&sent), "{} of {}", arrived.len(), sent.len());
}

/// SK-9.7 A short packet hangs the board until another host has it, and the log says so.
#[test]
fn a_short_packet_hangs_the_board() {
    let board = served("sim:?name=gadget-short&slaves=io&queue=1", OnVanish::Ramp);
    board.attach();
    assert!(board.get(LIMIT).is_some() && board.put(&[0; 504], LIMIT));
    // What the controller had is taken back. A busy machine needs some time until the board has seen the short packet.
    while board.get(Duration::from_millis(50)).is_some() {}
    until("the board takes no more", || !board.put(&[0; 512], Duration::from_millis(50)));
    assert_eq!(board.request([0xA1, 2, 0, 0, 0, 0, 1, 0], &[]), Ok(vec![0]), "endpoint 0 goes on");
    board.detach();
    let lines = until_told(&board, "the host is gone");
    assert!(lines.iter().any(|line| line.contains("it hung after an OUT packet of fewer than 512 bytes")), "{lines:?}");
    board.attach();
    assert!(board.get(LIMIT).is_some() && board.put(&[0; 512], LIMIT));
}

/// Requests reach the board whether or not it has a host that reads; a report by SET_REPORT is a frame.
#[test]
fn requests_on_endpoint_0() {
    let board = served("sim:?name=gadget-requests&slaves=io&queue=1", OnVanish::Ramp);
    board.attach();
    let mut frame = Frame::new();
    frame.put_master(SIZE, &MasterCommand::SetState(MasterState::Op));
    assert_eq!(board.request([0x21, 9, 0, 2, 0, 0, 0, 2], frame.bytes()), Ok(Vec::new()));
    let op = |report: &[u8]| {
        let slot = Frame::from_prefix(report).slot(SIZE, 0);
        ecmsk::sk::MasterResponse::decode(&slot).state.state() == Some(MasterState::Op)
    };
    until("the board is in OP", || {
        let report = board.request([0xA1, 1, 0, 1, 0, 0, 0, 2], &[]).expect("GET_REPORT");
        op(&report)
    });
    assert_eq!(board.request([0x21, 9, 0, 2, 0, 0, 0xF8, 1], &[0; 504]), Err(Stalled), "504 bytes");
}

/// A board that is reset is pulled for its host, and plugged in again when it is back.
#[test]
fn a_board_that_is_lost_is_pulled_and_comes_back() {
    let board = served("sim:?name=gadget-lost&slaves=io&queue=1", OnVanish::Ramp);
    for _ in 0..3 {
        board.attach();
        assert!(board.is_plugged_in() && board.get(LIMIT).is_some());
        let mut reset = Frame::new();
        reset.put_master(SIZE, &MasterCommand::SoftReset);
        assert!(board.put(reset.bytes(), LIMIT));
        let mut lines = until_told(&board, "the board is lost");
        // For the host the cable is pulled.
        board.detach();
        if !lines.iter().any(|line| line == "the board is back") {
            lines.extend(until_told(&board, "the board is back"));
        }
        assert!(board.is_plugged_in());
        assert!(!lines.iter().any(|line| line.contains("axes")), "{lines:?}");
    }
}
