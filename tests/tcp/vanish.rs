//! A server's handling of moving axes when their writer vanishes without closing its link.
#![cfg(unix)]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use ecmsk::cia402::Mode;
use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Homing, HomingPhase, Options, Slave, SlaveView};
use ecmsk::link::{self, Dir, Layer, Link, LinkError, ReadMeta, Share, Wait};
use ecmsk::port::tcp::{OnVanish, ServeOptions, Server};
use ecmsk::sk::{
    CommandId, DriveResponse, DriveSync, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, Motion,
    SlaveCommand, SlaveKind, SlotSize, StateByte,
};
use support::tcp::proxy::Cable;
use support::tcp::{LIMIT, SIZE, Told, connect, connect_next, options, own, serve_with, time_behind, until, uri};

/// The keep-alive time of a link that names none.
const KEEPALIVE: Duration = Duration::from_millis(500);

/// A writer's link, and its cable.
pub(super) struct Wired {
    pub(super) link: Arc<dyn Link>,
    pub(super) cable: Cable,
}

pub(super) fn served(clock: &str, on_vanish: OnVanish) -> (Server, Told) {
    let (options, told) = options();
    let server = serve_with(&format!("sim:?slaves=drive*3&clock={clock}"), ServeOptions { on_vanish, ..options });
    (server, told)
}

/// A writer with axes 1 in CSP, 2 in CSV, 3 in CST, switched on.
pub(super) fn config() -> Config {
    let slaves = vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSV), Slave::Drive(Axis::CST)];
    Config { slaves, ..Config::default() }
}

/// The lead over the board, in frames.
const AHEAD: i32 = 100;

/// Moves axes 1 and 2 through a link until `frames` were taken.
pub(super) fn drive(link: &dyn Link, frames: i32) {
    for n in 1..=frames {
        let mut frame = Frame::new();
        frame.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(n * 100)).into());
        frame.put_slave(SIZE, 2, &SlaveCommand::Csv(Motion::to(100_000)).into());
        frame.fill_crc(SIZE);
        link.write(&frame, Wait::For(LIMIT)).unwrap();
        // Some are ahead of the board, so that its FIFO does not run empty before the server takes over.
        if n > AHEAD {
            link.read(&mut Frame::new(), Wait::For(LIMIT)).unwrap();
        }
    }
}

/// Brings the network to OP with every axis on, leaves it in that state, and returns a link that has seen nothing of
/// it.
pub(super) fn prepared(server: &Server, told: &Told) -> Wired {
    let options = Options { close: Close::Leave, ..Options::default() };
    let ecm = Ecm::open_with(&uri(server, ""), options).unwrap();
    ecm.configure(&config()).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
    ecm.servo_on(&[1, 2, 3]).unwrap();
    drop(ecm);
    told.wait("has closed its link");
    let cable = Cable::to(server.address());
    Wired { link: link::open(&format!("tcp://{}", cable.address), Share::ByName).unwrap(), cable }
}

/// Positions of the axes, and whether they are on.
pub(super) type Axes = Vec<(i32, bool)>;

fn look(server: &Server) -> Axes {
    let ecm = until("place for a writer", || Ecm::open(&uri(server, "")).ok());
    ecm.adopt(&config()).unwrap();
    let seen = ecm.next_cycle(LIMIT).unwrap();
    let axes = (1..=3).map(|slave| match seen.slave(slave) {
        Some(SlaveView::Drive(drive)) => (drive.position, drive.statusword.is_enabled()),
        other => panic!("slave {slave} is {other:?}"),
    });
    let axes = axes.collect();
    ecm.close(Close::Leave).unwrap();
    axes
}

/// The axes now, and 100 cycles later.
pub(super) fn after(server: &Server) -> (Axes, Axes) {
    let first = look(server);
    let ecm = Ecm::open(&uri(server, "")).unwrap();
    for _ in 0..100 {
        ecm.next_cycle(LIMIT).unwrap();
    }
    ecm.close(Close::Leave).unwrap();
    (first, look(server))
}

/// TCP-9 Axes of a writer that has vanished are ramped to a standstill and stay on, on either clock; with `servo-off`
/// they are switched off, and with `leave` a velocity goes on.
#[test]
fn axes_of_a_writer_that_is_gone_are_ramped_to_a_standstill() {
    for (clock, on_vanish, moves, on) in [
        ("virtual", OnVanish::Ramp, false, true),
        ("real", OnVanish::Ramp, false, true),
        ("virtual", OnVanish::ServoOff, false, false),
        ("virtual", OnVanish::Leave, true, true),
    ] {
        let (server, told) = served(clock, on_vanish);
        let Wired { link, cable } = prepared(&server, &told);
        drive(link.as_ref(), 200);
        cable.cut();
        told.wait("is gone");
        told.wait(if on_vanish == OnVanish::Leave { "left as they are" } else { "stand still" });
        let (first, later) = after(&server);
        // With `leave`, axis 1 moves to the last target in the FIFO; a velocity goes on.
        for axis in if moves { 1..2 } else { 0..2 } {
            let moved = later[axis].0 - first[axis].0;
            let holds = if moves { moved > 1000 } else { moved.abs() < 20 };
            assert!(holds, "{clock} {on_vanish:?} axis {axis}: {moved}");
        }
        assert!(later.iter().all(|axis| axis.1 == on), "{clock} {on_vanish:?}: {later:?}");
        if on_vanish == OnVanish::Ramp && clock == "virtual" {
            // 200 frames of 100 counts: the last target is the furthest one of the writer.
            let end = later[0].0;
            assert!((end - 20_000).abs() < 20, "it holds the last target: {end}");
        }
    }
}

/// TCP-9 TCP-24 A drive in CSP that follows a target which it would reach only minutes after the limit, without an
/// alarm, is ramped from its actual position, and does not go on.
#[test]
fn an_axis_on_its_way_to_a_far_target_is_ramped_from_where_it_is() {
    const FAR: i32 = 2_000_000_000;
    let (server, told) = served("virtual", OnVanish::Ramp);
    let ecm = Ecm::open_with(&uri(&server, ""), Options { close: Close::Leave, ..Options::default() }).unwrap();
    ecm.configure(&config()).unwrap();
    // No following error causes an alarm.
    ecm.sdo_write(1, ObjectAddress::new(0x6065, 0), u32::MAX).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
    ecm.servo_on(&[1]).unwrap();
    drop(ecm);
    told.wait("has closed its link");
    let link = link::open(&uri(&server, ""), Share::ByName).unwrap();
    let mut frame = Frame::new();
    frame.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(FAR)).into());
    link.write(&frame, Wait::For(LIMIT)).unwrap();
    let mut report = Frame::new();
    let mut positions = [0; 2];
    for _ in 0..200 {
        link.read(&mut report, Wait::For(LIMIT)).unwrap();
        positions = [positions[1], DriveResponse::decode(&report.slot(SIZE, 1)).position];
    }
    let speed = positions[1] - positions[0];
    assert!(speed > 100 && FAR / speed > 10_000, "{positions:?}");
    link.vanish();
    told.wait("stand still");
    let (first, later) = after(&server);
    assert!((later[0].0 - first[0].0).abs() < 20 && later[0].1, "{first:?} {later:?}");
    assert!((positions[1]..FAR / 10).contains(&later[0].0), "{positions:?}, then {later:?}");
    // It stands at the end of the ramp, which is no jam.
    assert!(
        !told.lines().iter().any(|line| line.contains("may still move") || line.contains("pushed")),
        "{:?}",
        told.lines()
    );
}

/// TCP-10 After a writer that closes its link the server sends nothing: a velocity that it leaves goes on.
#[test]
fn a_writer_that_closes() {
    let (server, told) = served("virtual", OnVanish::Ramp);
    let Wired { link, .. } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    link.close();
    let (first, later) = after(&server);
    assert!(later[1].0 - first[1].0 > 1000, "{first:?} {later:?}");
    assert!(!told.lines().iter().any(|line| line.contains("stand still")), "{:?}", told.lines());
}

/// A link that returns no report any more once it is deaf.
struct Deaf {
    inner: Arc<dyn Link>,
    is_deaf: AtomicBool,
}

impl Layer for Deaf {
    fn inner(&self) -> &dyn Link {
        self.inner.as_ref()
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        if self.is_deaf.load(Ordering::Relaxed) {
            thread::sleep(Duration::from_millis(5));
            return Err(LinkError::Timeout { dir: Dir::Read, waited: Duration::from_millis(5), what: "deaf" });
        }
        self.inner.read(out, wait)
    }
}

/// TCP-21 A native program that closes its board but could not bring its axes to rest sends no good-bye: the server
/// stops them.
#[test]
fn a_close_that_could_not_stop_its_axes() {
    let (server, told) = served("real", OnVanish::Ramp);
    let Wired { link, .. } = prepared(&server, &told);
    let deaf = Arc::new(Deaf { inner: link, is_deaf: AtomicBool::new(false) });
    let ecm = Ecm::over(Arc::clone(&deaf) as Arc<dyn Link>, Options::default()).unwrap();
    ecm.adopt(&config()).unwrap();
    drive(deaf.as_ref(), 200);
    // It sees that they move.
    for _ in 0..2 {
        ecm.next_cycle(LIMIT).unwrap();
    }
    deaf.is_deaf.store(true, Ordering::Relaxed);
    let ended = ecm.close(Close::Hold).unwrap_err();
    assert!(matches!(ended, EcmError::NoReport { .. }), "{ended:?}");
    told.wait("is gone: it has ended without closing its link");
    told.wait("stand still");
    let (first, later) = after(&server);
    assert!((later[1].0 - first[1].0).abs() < 20, "the velocity has ended: {first:?} {later:?}");
}

/// TCP-9 While the server brings axes to a standstill it is the writer, and readers see the ramp.
#[test]
fn readers_see_the_ramp() {
    let (server, told) = served("virtual", OnVanish::Ramp);
    let Wired { link, cable } = prepared(&server, &told);
    let reader = connect(&server, "role=reader&queue=4096");
    let is_over = AtomicBool::new(false);
    let steps = thread::scope(|scope| {
        let reading = scope.spawn(|| {
            let mut report = Frame::new();
            let (mut last, mut steps) = (None, Vec::new());
            loop {
                match reader.read(&mut report, Wait::For(Duration::from_millis(200))) {
                    Ok(meta) => {
                        let position = report.slot(SIZE, 2).data1 as i32;
                        if let Some((sequence, before)) = last.replace((meta.sequence, position))
                            && sequence + 1 == meta.sequence
                        {
                            steps.push(position - before);
                        }
                    }
                    Err(LinkError::Timeout { .. }) if is_over.load(Ordering::Acquire) => return steps,
                    Err(LinkError::Timeout { .. }) => {}
                    Err(error) => panic!("{error}"),
                }
            }
        });
        drive(link.as_ref(), 200);
        cable.cut();
        told.wait("stand still");
        is_over.store(true, Ordering::Release);
        reading.join().unwrap()
    });
    let fast = steps.iter().rposition(|step| *step > 80).expect("it moved");
    let slow = steps[fast..].iter().filter(|step| (10..80).contains(*step)).count();
    // 100 to 0 counts/ms, of which 80 to 10 are checked.
    assert!((150..=200).contains(&slow), "docs/SAFETY.md: 250 ms, {slow}: {:?}", &steps[fast..]);
}

/// TCP-9 TCP-5 The same for a writer whose cable is unplugged, once it has been silent for four keep-alive times; its
/// own link is lost then, and the result of a pending write is reported as unknown.
#[test]
fn a_pulled_cable() {
    // A machine may be late, but not in each of so many tries.
    assert!((0..5).any(|_| pulled() < 5 * KEEPALIVE), "docs/SAFETY.md: four keep-alive times");
}

/// Unplugs a writer's cable. Returns for how long the server had no word of it, by its own clock.
fn pulled() -> Duration {
    let (server, told) = served("real", OnVanish::Ramp);
    let Wired { link, cable } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    cable.pull();
    let pulled = Instant::now();
    let ended = link.write(&Frame::new(), Wait::For(LIMIT)).unwrap_err();
    assert!(matches!(ended, LinkError::Unsure { .. }), "{ended:?}");
    assert!(matches!(link.check(), Err(LinkError::Lost { .. })));
    let silent = time_behind(&told.wait("no word for"), "no word for");
    // The newest word may have been a keep-alive time older. A late machine takes longer, but no server is hasty.
    assert!(pulled.elapsed() >= 3 * KEEPALIVE, "docs/SAFETY.md: four keep-alive times, {:?}", pulled.elapsed());
    told.wait("stand still");
    let (first, later) = after(&server);
    assert!((later[1].0 - first[1].0).abs() < 20, "the velocity has ended: {first:?} {later:?}");
    assert!(silent >= 4 * KEEPALIVE, "docs/SAFETY.md: four keep-alive times, {silent:?}");
    silent
}

/// TCP-9 A homing that its writer has begun is aborted.
#[test]
fn homing_is_aborted() {
    let (server, told) = served("virtual", OnVanish::Ramp);
    let Wired { link, cable } = prepared(&server, &told);
    let ecm = Ecm::over(link, Options::default()).unwrap();
    ecm.adopt(&config()).unwrap();
    let mut cable = Some(cable);
    let mut positions = Vec::new();
    let ended = ecm.home(1, &Homing::method(17), |progress| {
        positions.push(progress.position);
        if progress.phase == HomingPhase::Moving && positions[0].abs_diff(progress.position) > 2000 {
            cable.take().into_iter().for_each(Cable::cut);
        }
    });
    assert!(matches!(ended, Err(EcmError::Link(_))), "{ended:?}: {positions:?}");
    told.wait("stand still");
    let (first, later) = after(&server);
    assert!((later[0].0 - first[0].0).abs() < 20, "{first:?} {later:?}");
}

/// TCP-9 A server that is stopped while there is a writer does the same.
#[test]
fn a_server_that_is_stopped() {
    let uri = own("sim:?slaves=drive*3&clock=virtual");
    let (options, told) = options();
    let server = Server::start(
        {
            let uri = uri.clone();
            move || link::open(&uri, Share::ByUri)
        },
        options,
    )
    .unwrap();
    let Wired { link, .. } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    let began = link.read(&mut Frame::new(), Wait::For(LIMIT)).unwrap().at;
    server.stop();
    told.wait("stand still");
    let lost = link.write(&Frame::new(), Wait::Forever).unwrap_err();
    assert!(matches!(&lost, LinkError::Lost { reason, .. } if reason.contains("stopped")), "{lost:?}");
    let ecm = Ecm::open(&uri).unwrap();
    ecm.adopt(&config()).unwrap();
    let first = ecm.next_cycle(LIMIT).unwrap();
    let took = first.meta.at.0 - began.0;
    assert!(took <= 2_008_000_000, "docs/SAFETY.md: 2 s and 8 cycles, {took} ns");
    let later = (0..100).map(|_| ecm.next_cycle(LIMIT).unwrap()).last().unwrap();
    for slave in [1, 2] {
        assert!((later.position(slave).unwrap() - first.position(slave).unwrap()).abs() < 20);
        assert!(later.drive(slave).unwrap().statusword.is_enabled());
    }
}

/// TCP-9 A server that has not seen the configuration of the network reports that it cannot stop the axes.
#[test]
fn a_network_that_is_not_known() {
    let uri = own("sim:?slaves=drive*3&clock=virtual");
    let ecm = Ecm::open(&uri).unwrap();
    ecm.configure(&config()).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
    ecm.close(Close::Leave).unwrap();
    let (options, told) = options();
    let server = Server::start(move || link::open(&uri, Share::ByUri), options).unwrap();
    let cable = Cable::to(server.address());
    let link = link::open(&format!("tcp://{}", cable.address), Share::ByName).unwrap();
    link.read(&mut Frame::new(), Wait::For(LIMIT)).unwrap();
    cable.cut();
    let line = told.wait("was configured before");
    assert!(line.contains("emergency stop"), "{line}");
    connect_next(&server, "");
}

/// TCP-9 SK-4.8 SK-4.42 A program may declare all 40 slaves on a board of 16-byte slots, which has room for 30, and may
/// set the modes of its axes before it declares them: they are stopped like any others.
#[test]
fn axes_are_stopped_however_the_program_declared_them() {
    declared(false);
    declared(true);
}

fn declared(mode_first: bool) {
    const WIDE: SlotSize = SlotSize::Bytes16;
    let (options, told) = options();
    let server = serve_with("sim:?slaves=drive&slot=16&clock=virtual", options);
    let cable = Cable::to(server.address());
    let link = link::open(&format!("tcp://{}", cable.address), Share::ByName).unwrap();
    let mut report = Frame::new();
    let mut say = |build: &dyn Fn(&mut Frame), reports: u32| {
        let mut frame = Frame::new();
        build(&mut frame);
        link.write(&frame, Wait::For(LIMIT)).unwrap();
        for _ in 0..reports {
            link.read(&mut report, Wait::For(LIMIT)).unwrap();
        }
    };
    let mode = SlaveCommand::DriveMode { mode: Mode::Csv, sync: DriveSync::DcSync };
    if mode_first {
        say(&|frame| frame.put_slave(WIDE, 1, &mode.into()), 2);
    }
    for group in 0..5 {
        let kinds = [SlaveKind::Drive; 8];
        say(&|frame| frame.put_master(WIDE, &MasterCommand::SetAxis { group, kinds }), 2);
    }
    if !mode_first {
        say(&|frame| frame.put_slave(WIDE, 1, &mode.into()), 2);
    }
    say(&|frame| frame.put_master(WIDE, &MasterCommand::SetState(MasterState::Op)), 2000);
    say(&|frame| frame.put_slave(WIDE, 1, &SlaveCommand::ServoOn.into()), 500);
    say(&|frame| frame.put_slave(WIDE, 1, &SlaveCommand::Csv(Motion::to(100_000)).into()), 500);
    assert_eq!(MasterResponse::decode(&report.slot(WIDE, 0)).state, StateByte::reached(MasterState::Op));
    assert_eq!(report.slot(WIDE, 1).id, CommandId::Csv.code(), "it turns");
    cable.cut();
    let line = told.wait("after");
    assert!(line.contains("stand still"), "{line}");
    let next = connect_next(&server, "");
    let mut positions = [0; 2].map(|_| {
        for _ in 0..100 {
            next.read(&mut report, Wait::For(LIMIT)).unwrap();
        }
        DriveResponse::decode(&report.slot(WIDE, 1)).position
    });
    positions.sort_unstable();
    assert!(positions[1] - positions[0] < 20, "{positions:?}");
}

/// A frame of SET_FIFO with a threshold.
fn threshold(free: u32) -> Frame {
    let mut frame = Frame::new();
    frame.put_master(SIZE, &MasterCommand::SetFifo(FifoAction::Threshold(free)));
    frame.fill_crc(SIZE);
    frame
}

/// The motion of the axes while the next writer writes only frames of GET_STATUS for that many cycles.
fn moved_by_status_frames(server: &Server, frames: u32) -> Vec<i32> {
    let before = look(server);
    let link = connect_next(server, "");
    for _ in 0..frames {
        link.write(&Frame::new(), Wait::For(LIMIT)).unwrap();
        link.read(&mut Frame::new(), Wait::For(LIMIT)).unwrap();
    }
    link.close();
    let after = look(server);
    before.iter().zip(after).map(|(before, after)| after.0 - before.0).collect()
}

/// TCP-23 SK-5.12 A threshold left by the writer, above the depth of the ramp or below it, does not delay the ramp: the
/// FIFO is empty and the axis turns by its last velocity.
#[test]
fn a_threshold_does_not_hold_the_ramp() {
    for free in [1, 10, 100, 159, 160] {
        let (server, told) = served("virtual", OnVanish::Ramp);
        let Wired { link, cable } = prepared(&server, &told);
        drive(link.as_ref(), 150);
        for _ in 0..200 {
            link.read(&mut Frame::new(), Wait::For(LIMIT)).unwrap();
        }
        link.write(&threshold(free), Wait::For(LIMIT)).unwrap();
        cable.cut();
        told.wait("stand still");
        let moved = moved_by_status_frames(&server, 300);
        assert!(moved[..2].iter().all(|moved| moved.abs() < 20), "threshold {free}: {moved:?} {:?}", told.lines());
    }
}

/// TCP-23 Targets that wait behind a threshold while the axes are at rest begin no motion: they are dropped, which is
/// logged, and the next writer's frames do not execute them. The same applies to a native stream and its prefill.
#[test]
fn what_waits_behind_a_threshold_is_dropped() {
    for is_stream in [false, true] {
        let (server, told) = served("virtual", OnVanish::Ramp);
        let Wired { link, cable } = prepared(&server, &told);
        if is_stream {
            let ecm = Ecm::over(link, Options::default()).unwrap();
            ecm.adopt(&config()).unwrap();
            let mut stream = ecm.stream(150).unwrap();
            stream.prefill(140).unwrap();
            let start = stream.snapshot().unwrap().position(1).unwrap();
            for n in 1..=100 {
                stream.csp(1, start + n * 100).unwrap();
                stream.csv(2, 100_000).unwrap();
                stream.step().unwrap();
            }
            cable.cut();
            told.wait("100 commands that waited in the FIFO were dropped");
            std::mem::forget(stream);
        } else {
            link.write(&threshold(10), Wait::For(LIMIT)).unwrap();
            drive(link.as_ref(), AHEAD);
            cable.cut();
            // The frame of the threshold waits, too.
            told.wait("101 commands that waited in the FIFO were dropped");
        }
        let moved = moved_by_status_frames(&server, 300);
        assert!(moved.iter().all(|moved| moved.abs() < 20), "{is_stream}: {moved:?}");
    }
}

/// TCP-23 A writer that never reads and writes faster than the board executes: most of its frames have found the FIFO
/// full. The ramp does not jump to their targets.
#[test]
fn the_ramp_begins_at_what_was_executed() {
    let (server, told) = served("virtual&host_us=1", OnVanish::Ramp);
    let Wired { link, cable } = prepared(&server, &told);
    // A cycle has just passed.
    for _ in 0..100 {
        link.read(&mut Frame::new(), Wait::For(LIMIT)).unwrap();
    }
    for n in 1..=900 {
        let mut frame = Frame::new();
        frame.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(n * 100)).into());
        frame.put_slave(SIZE, 2, &SlaveCommand::Csv(Motion::to(n * 100)).into());
        frame.fill_crc(SIZE);
        link.write(&frame, Wait::For(LIMIT)).unwrap();
    }
    cable.cut();
    told.wait("stand still");
    let (first, later) = after(&server);
    // 900 frames between two cycles: 160 were taken. The ramp adds less than 4000 counts.
    assert!((16_000..20_000).contains(&first[0].0), "{first:?}");
    for axis in 0..2 {
        assert!((later[axis].0 - first[axis].0).abs() < 20, "axis {axis}: {first:?} {later:?}");
    }
}
