//! What a server does with moving axes when their writer is gone without having closed its link.
#![cfg(all(feature = "serve", unix))]

mod tcp_support;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Homing, HomingPhase, Options, Slave, SlaveView};
use ecmsk::link::{self, Link, LinkError, Share, Wait};
use ecmsk::port::tcp::{OnVanish, ServeOptions, Server};
use ecmsk::sk::{Frame, MasterState, Motion, SlaveCommand};
use tcp_support::proxy::Cable;
use tcp_support::{LIMIT, SIZE, Told, connect, connect_next, options, own, serve_with, until, uri};

/// A writer's link, and its cable.
struct Wired {
    link: Arc<dyn Link>,
    cable: Cable,
}

fn served(clock: &str, on_vanish: OnVanish) -> (Server, Told) {
    let (options, told) = options();
    let server = serve_with(&format!("sim:?slaves=drive*3&clock={clock}"), ServeOptions { on_vanish, ..options });
    (server, told)
}

/// A writer with axes 1 in CSP, 2 in CSV, 3 in CST, that are on.
fn config() -> Config {
    let slaves = vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSV), Slave::Drive(Axis::CST)];
    Config { slaves, ..Config::default() }
}

/// Frames that are ahead of the board.
const AHEAD: i32 = 100;

/// Moves axes 1 and 2 through a link, by frames of its own, until `frames` were taken.
fn drive(link: &dyn Link, frames: i32) {
    for n in 1..=frames {
        let mut frame = Frame::new();
        frame.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(n * 100)).into());
        frame.put_slave(SIZE, 2, &SlaveCommand::Csv(Motion::to(100_000)).into());
        frame.fill_crc(SIZE);
        link.write(&frame, Wait::For(LIMIT)).unwrap();
        // Some are ahead of the board: it does not run dry before the server takes over.
        if n > AHEAD {
            link.read(&mut Frame::new(), Wait::For(LIMIT)).unwrap();
        }
    }
}

/// Brings the network to OP with every axis on, leaves it so, and gives a link that has seen nothing of it.
fn prepared(server: &Server, told: &Told) -> Wired {
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
type Axes = Vec<(i32, bool)>;

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
fn after(server: &Server) -> (Axes, Axes) {
    let first = look(server);
    let ecm = Ecm::open(&uri(server, "")).unwrap();
    for _ in 0..100 {
        ecm.next_cycle(LIMIT).unwrap();
    }
    ecm.close(Close::Leave).unwrap();
    (first, look(server))
}

/// TCP-9 Axes of a writer that is gone are ramped to a standstill and stay on, on either clock; with `servo-off` they are
/// switched off, and with `leave` a velocity goes on.
#[test]
fn axes_of_a_writer_that_is_gone() {
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
        // Left alone, axis 1 comes to the end of the FIFO; a velocity has no end.
        for axis in if moves { 1..2 } else { 0..2 } {
            let moved = later[axis].0 - first[axis].0;
            let holds = if moves { moved > 1000 } else { moved.abs() < 20 };
            assert!(holds, "{clock} {on_vanish:?} axis {axis}: {moved}");
        }
        assert!(later.iter().all(|axis| axis.1 == on), "{clock} {on_vanish:?}: {later:?}");
        if on_vanish == OnVanish::Ramp && clock == "virtual" {
            // 200 frames of 100 counts, then a ramp of 250 ms, which goes half as far as the speed would: 12500 counts.
            let end = later[0].0;
            assert!((32_000..33_000).contains(&end), "the last speed falls to 0: {end}");
        }
    }
}

/// TCP-10 A writer that closes its link is trusted: a velocity that it leaves goes on, and the server sends nothing.
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

/// TCP-9 While the server brings axes to a standstill it is the writer, and readers see how.
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
                        let position = report.slot(SIZE, 1).data1 as i32;
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
    assert!(slow > 50, "a ramp and no stop at once: {:?}", &steps[fast..]);
}

/// TCP-9 TCP-5 So do those of a writer whose cable is pulled, once it has said nothing for four keep-alive times; its own
/// link is lost then, and it is known of a write under way that nobody knows.
#[test]
fn a_pulled_cable() {
    let (server, told) = served("real", OnVanish::Ramp);
    let Wired { link, cable } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    cable.pull();
    let ended = link.write(&Frame::new(), Wait::For(LIMIT)).unwrap_err();
    assert!(matches!(ended, LinkError::Unsure { .. }), "{ended:?}");
    assert!(matches!(link.check(), Err(LinkError::Lost { .. })));
    told.wait("no word for");
    told.wait("stand still");
    let (first, later) = after(&server);
    assert!((later[1].0 - first[1].0).abs() < 20, "the velocity has ended: {first:?} {later:?}");
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
    server.stop();
    told.wait("stand still");
    let lost = link.write(&Frame::new(), Wait::Forever).unwrap_err();
    assert!(matches!(&lost, LinkError::Lost { reason, .. } if reason.contains("stopped")), "{lost:?}");
    let ecm = Ecm::open(&uri).unwrap();
    ecm.adopt(&config()).unwrap();
    let first = ecm.next_cycle(LIMIT).unwrap();
    let later = (0..100).map(|_| ecm.next_cycle(LIMIT).unwrap()).last().unwrap();
    for slave in [1, 2] {
        assert!((later.position(slave).unwrap() - first.position(slave).unwrap()).abs() < 20);
        assert!(later.drive(slave).unwrap().statusword.is_enabled());
    }
}

/// TCP-9 A server that has not seen how the network was configured says that it cannot help.
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
