//! A client that has the axes of another one stopped (`ecmsk stop`).
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use ecmsk::coe::ObjectAddress;
use ecmsk::ecm::{Close, Ecm, EcmError, Homing, HomingPhase, Options};
use ecmsk::link::tcp::{Secret, StopError, Stopped, stop};
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{self, Link, LinkError, Share, Wait};
use ecmsk::port::tcp::in_memory::{ClientMessage, InMemoryServer, ServerMessage};
use ecmsk::port::tcp::{OnVanish, ServeOptions, Server};
use ecmsk::sk::{Frame, MasterState};
use support::tcp::{GREETING, LIMIT, Raw, connect, hello, message, options, own, serve_with, until, uri};

use crate::vanish::{Wired, after, config, drive, prepared, served};

fn stopped(server: &Server, off: bool) -> Result<Stopped, StopError> {
    stop(&LinkUri::parse(&uri(server, "")).unwrap(), off)
}

/// Axes 1 and 2 stand; whether they are on.
#[track_caller]
fn assert_stand(server: &Server, on: bool) {
    let (first, later) = after(server);
    for axis in 0..2 {
        assert!((later[axis].0 - first[axis].0).abs() < 20, "axis {axis}: {first:?} {later:?}");
    }
    assert!(later.iter().all(|axis| axis.1 == on), "{later:?}");
}

/// What the calls of a stopped writer say.
#[track_caller]
fn assert_says_who(link: &dyn Link) {
    let error = link.write(&Frame::new(), Wait::For(LIMIT)).unwrap_err();
    assert!(
        matches!(&error, LinkError::Lost { reason, .. } if reason.contains("stopped by another client, ")),
        "{error:?}"
    );
    assert!(error.to_string().contains(&format!("(PID {})", std::process::id())), "{error}");
}

/// docs/SAFETY.md: a stop brakes the axes of a writer, one of them in CSV, on either clock and whatever the server was
/// started with. The writer's calls fail with the name of the client that has stopped it, and its place is free.
#[test]
fn a_stop_brakes_the_axes_of_a_writer() {
    for (clock, on_vanish, off, on) in [
        ("virtual", OnVanish::Ramp, false, true),
        ("real", OnVanish::Ramp, false, true),
        ("virtual", OnVanish::Leave, false, true),
        ("virtual", OnVanish::Ramp, true, false),
        ("virtual", OnVanish::ServoOff, false, false),
    ] {
        let (server, told) = served(clock, on_vanish);
        let Wired { link, cable: _cable } = prepared(&server, &told);
        drive(link.as_ref(), 200);
        let done = stopped(&server, off).unwrap();
        assert!(done.in_op && done.writer.as_ref().is_some_and(|name| name.contains("(PID ")), "{done:?}");
        assert_says_who(link.as_ref());
        told.wait("was stopped by ");
        assert_stand(&server, on);
    }
}

/// docs/SAFETY.md: a stop aborts homing.
#[test]
fn a_stop_aborts_homing() {
    let (server, told) = served("virtual", OnVanish::Ramp);
    let Wired { link, cable: _cable } = prepared(&server, &told);
    let ecm = Ecm::over(link, Options::default()).unwrap();
    ecm.adopt(&config()).unwrap();
    let mut positions = Vec::new();
    let mut done = None;
    let ended = ecm.home(1, &Homing::method(17), |progress| {
        positions.push(progress.position);
        if done.is_none() && progress.phase == HomingPhase::Moving && positions[0].abs_diff(progress.position) > 2000 {
            done = Some(stopped(&server, false));
        }
    });
    assert!(matches!(ended, Err(EcmError::Link(LinkError::Lost { .. }))), "{ended:?}: {positions:?}");
    assert!(matches!(done, Some(Ok(Stopped { in_op: true, writer: Some(_), .. }))), "{done:?}");
    assert_stand(&server, true);
}

/// Two stops at once both end when the axes stand. One that also switches the axes off is carried out, too.
#[test]
fn two_stops_at_once() {
    for offs in [[false, false], [false, true], [true, true]] {
        let (server, told) = served("virtual", OnVanish::Ramp);
        let Wired { link, cable: _cable } = prepared(&server, &told);
        drive(link.as_ref(), 200);
        thread::scope(|scope| {
            let server = &server;
            let stops = offs.map(|off| scope.spawn(move || stopped(server, off)));
            for done in stops {
                let done = done.join().unwrap();
                assert!(matches!(done, Ok(Stopped { in_op: true, .. })), "{offs:?}: {done:?}");
            }
        });
        assert_says_who(link.as_ref());
        assert_stand(&server, offs == [false; 2]);
    }
}

/// Without a writer a stop brakes what a program has left moving, and says that none was writing. It takes no place of
/// another client, and leaves none behind. Below OP there is nothing to stop.
#[test]
fn a_stop_without_a_writer() {
    let (options, told) = options();
    let options = ServeOptions { max_clients: 1, ..options };
    let server = serve_with("sim:?slaves=drive*3&clock=virtual", options);
    let done = stopped(&server, false).unwrap();
    assert_eq!((done.in_op, done.writer), (false, None));

    let Wired { link, cable: _cable } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    link.close();
    told.wait("has closed its link");
    let done = stopped(&server, false).unwrap();
    assert_eq!((done.in_op, done.writer), (true, None));
    assert_stand(&server, true);
    let writer = connect(&server, "");
    assert!(stopped(&server, true).unwrap().writer.is_some(), "the only place is the writer's");
    assert_says_who(writer.as_ref());
    assert_stand(&server, false);
}

/// A frame that the board has taken is answered before the connection ends, so that no write of a stopped writer is
/// unsure.
#[test]
fn a_stop_leaves_no_write_unsure() {
    let (server, told) = served("real", OnVanish::Ramp);
    let Wired { link, cable: _cable } = prepared(&server, &told);
    thread::scope(|scope| {
        let writes = scope.spawn(|| {
            loop {
                let mut frame = Frame::new();
                frame.fill_crc(support::tcp::SIZE);
                if let Err(error) = link.write(&frame, Wait::For(LIMIT)) {
                    return error;
                }
            }
        });
        thread::sleep(Duration::from_millis(20));
        stopped(&server, false).unwrap();
        let error = writes.join().unwrap();
        assert!(matches!(error, LinkError::Lost { .. }), "{error:?}");
    });
}

/// Of a network that the server has not seen configured it does not know the axes: the stop says so, and stops the
/// writer all the same, so that another program can stop the axes.
#[test]
fn a_stop_of_a_network_that_is_not_known() {
    let sim = own("sim:?slaves=drive*3&clock=virtual");
    let ecm = Ecm::open(&sim).unwrap();
    ecm.configure(&config()).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
    ecm.close(Close::Leave).unwrap();
    let (options, _told) = options();
    let server = Server::start(move || link::open(&sim, Share::ByUri), options).unwrap();
    let writer = connect(&server, "");
    writer.read(&mut Frame::new(), Wait::For(LIMIT)).unwrap();
    let error = stopped(&server, false).unwrap_err();
    assert!(matches!(&error, StopError::Unknown { writer: Some(_) }), "{error:?}");
    assert!(error.to_string().contains("emergency stop"), "{error}");
    assert_says_who(writer.as_ref());
    let next = Ecm::open(&uri(&server, "")).unwrap();
    assert!(next.stop(&config(), false).unwrap());
}

/// A stop needs the secret as any other client does.
#[test]
fn a_stop_needs_the_secret() {
    let folder = tempfile::tempdir().unwrap();
    let [good, bad] = ["0123456789abcdef0123456789abcdef", "0123456789abcdef0123456789abcdeX"].map(|text| {
        let path = folder.path().join(text);
        fs::write(&path, text).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        path
    });
    let (options, _told) = options();
    let options = ServeOptions { secret: Some(Secret::load(&good).unwrap()), ..options };
    let server = serve_with("sim:?slaves=drive&clock=virtual", options);
    let ask = |file: &std::path::Path| {
        stop(&LinkUri::parse(&uri(&server, &format!("secret_file={}", file.display()))).unwrap(), false)
    };
    assert!(matches!(ask(&good), Ok(Stopped { in_op: false, .. })));
    let error = ask(&bad).unwrap_err().to_string();
    assert!(error.contains("another secret"), "{error}");
    let error = stopped(&server, false).unwrap_err().to_string();
    assert!(error.contains("wants a secret"), "{error}");
}

/// A server of an older version of the protocol, and a port where no server listens, are errors that say what to do.
#[test]
fn a_stop_where_no_such_server_is() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let old = thread::spawn(move || {
        let (mut client, _) = listener.accept().unwrap();
        std::io::Write::write_all(&mut client, b"ecmsktcp\x03\0\0\x01\0\0\0\0").unwrap();
    });
    let uri = LinkUri::parse(&format!("tcp://{address}")).unwrap();
    let error = stop(&uri, false).unwrap_err().to_string();
    assert!(error.contains("speaks version 3 of the protocol") && error.contains("the same ecmsk on both"), "{error}");
    old.join().unwrap();
    let error = stop(&uri, false).unwrap_err().to_string();
    assert!(error.contains("nobody listens there"), "{error}");
    let error = stop(&LinkUri::parse("sim:").unwrap(), false).unwrap_err();
    assert!(matches!(error, StopError::Link(LinkError::Uri(_))), "{error:?}");
}

/// Only a client that has introduced itself for it may ask for a stop.
#[test]
fn a_reader_cannot_ask_for_a_stop() {
    let (server, told) = served("virtual", OnVanish::Ramp);
    let mut raw = Raw::connect(&server);
    raw.hello(true, 500).expect("a welcome");
    raw.send(&message(0x07, &[1, 0, 0, 0, 0, 0, 0, 0, 0]));
    told.wait("does not keep to the protocol");
    let link: Arc<dyn Link> = connect(&server, "");
    link.read(&mut Frame::new(), Wait::For(LIMIT)).unwrap();
}

/// Once the server has taken the request it carries it out, although the client that asked for it is gone: after the
/// standstill of a vanished writer, whose axes stay on, they are switched off.
#[test]
fn a_stop_outlives_its_client() {
    let (server, told) = served("real", OnVanish::Ramp);
    let Wired { link, cable } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    let mut raw = Raw::connect(&server);
    let mut hello = hello(false, 500);
    hello[4] = 2;
    raw.send(&hello);
    raw.answer().expect("a welcome");
    cable.cut();
    until("a server that stops the axes", || {
        let refused = link::open(&uri(&server, ""), Share::ByUri).err()?;
        refused.to_string().contains("the server itself").then_some(())
    });
    raw.send(&message(0x07, &[1, 0, 0, 0, 0, 0, 0, 0, 1]));
    drop(raw);
    told.wait("stand still after the stop of ");
    assert_stand(&server, false);
}

/// Clients that have joined for a stop and ask for none keep nobody out, however many they are: the oldest makes room.
/// One whose stop is carried out keeps its place.
#[test]
fn idle_clients_keep_no_stop_out() {
    let (server, told) = served("virtual", OnVanish::Ramp);
    let Wired { link, cable: _cable } = prepared(&server, &told);
    drive(link.as_ref(), 200);
    let mut hello = hello(false, 3_600_000);
    hello[4] = 2;
    let mut idle: Vec<Raw> = (0..20)
        .map(|_| {
            let mut raw = Raw::connect(&server);
            raw.send(&hello);
            assert_eq!(raw.answer().expect("an answer").0, 0x81, "a welcome");
            raw
        })
        .collect();
    assert!(stopped(&server, false).unwrap().in_op);
    assert_stand(&server, true);
    assert_eq!(idle[0].message().expect("a bye").0, 0x41);
    told.wait("asked for nothing, and made room");

    let sim = link::open(&own("sim:?slaves=drive&clock=virtual"), Share::ByUri).unwrap();
    let server = InMemoryServer::new(sim, ServeOptions::default());
    let _writer = server.join(true).expect("it is a writer");
    let mut busy: Vec<_> = (0..4).map(|_| server.join_stopper().expect("it may stop")).collect();
    for stopper in &mut busy {
        assert!(stopper.begin(ClientMessage::Stop { off: false }, usize::MAX));
    }
    assert!(server.join_stopper().is_none(), "each of them is served");
}

/// A server that is busy with other stops does not have its `--max-clients` blamed.
#[test]
fn a_stop_beside_many_others() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let uri = LinkUri::parse(&format!("tcp://{}", listener.local_addr().unwrap())).unwrap();
    let server = thread::spawn(move || {
        let (mut client, _) = listener.accept().unwrap();
        let refused = message(0x82, &[3, 0, 0]);
        std::io::Write::write_all(&mut client, &[&GREETING[..], &refused].concat()).unwrap();
        let _ = std::io::Read::read(&mut client, &mut [0; 512]);
    });
    let error = stop(&uri, false).unwrap_err().to_string();
    assert!(error.contains("try again") && !error.contains("--max-clients"), "{error}");
    server.join().unwrap();
}

/// Until a stop is answered nobody becomes the writer: not the stopped program either, which tries again and again.
#[test]
fn nobody_writes_before_a_stop_is_answered() {
    let sim = link::open(&own("sim:?slaves=drive&clock=virtual"), Share::ByUri).unwrap();
    let server = InMemoryServer::new(sim, ServeOptions::default());
    let mut writer = server.join(true).expect("it is a writer");
    let mut stopper = server.join_stopper().expect("it may stop");
    assert!(stopper.begin(ClientMessage::Stop { off: false }, usize::MAX) && stopper.work());
    assert!(!writer.hear(&[]), "it was stopped");
    writer.end(false);
    assert!(server.join(true).is_none(), "the stop has no answer yet");
    while stopper.work() {}
    let said = stopper.take_messages().unwrap();
    assert!(said.iter().any(|message| matches!(message, ServerMessage::Stopped { .. })), "{said:?}");
    assert!(server.join(true).is_some());
}

/// docs/SAFETY.md: an axis that is jammed when it is stopped holds where it is, and does not jump when it comes free. The
/// stop says that it pushed.
#[test]
fn a_stop_holds_a_jammed_axis_where_it_is() {
    const FREE_NS: u64 = 9_000_000_000;
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("jam.ecmscript");
    fs::write(&script, "at 5s jam 1 for 4s\n").unwrap();
    let (options, told) = options();
    let server = serve_with(&format!("sim:?slaves=drive*3&clock=virtual&script={}", script.display()), options);
    let leave = Options { close: Close::Leave, ..Options::default() };
    let link = connect(&server, "");
    let ecm = Ecm::over(link.clone(), leave).unwrap();
    ecm.configure(&config()).unwrap();
    ecm.sdo_write(1, ObjectAddress::new(0x6065, 0), u32::MAX).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
    ecm.servo_on(&[1]).unwrap();
    let mut stream = ecm.stream(16).unwrap();
    for n in 1.. {
        stream.csp(1, n * 10).unwrap();
        stream.step().unwrap();
        if (n * 10).abs_diff(stream.snapshot().unwrap().position(1).unwrap()) > 20_000 {
            break;
        }
    }
    std::mem::forget(stream);
    let done = stopped(&server, false).unwrap();
    assert!(
        done.text.starts_with("axis 1 pushed, 2") && done.text.contains("its target is now its actual position"),
        "{done:?}"
    );
    told.wait("axis 1 pushed, 2");
    drop(ecm);
    let ecm = until("place for a writer", || Ecm::open_with(&uri(&server, ""), leave).ok());
    ecm.adopt(&config()).unwrap();
    let first = ecm.next_cycle(LIMIT).unwrap();
    assert!(first.meta.at.0 < FREE_NS, "it is jammed still");
    let mut last = first.clone();
    while last.meta.at.0 < FREE_NS + 1_000_000_000 {
        last = ecm.next_cycle(LIMIT).unwrap();
    }
    let [first, last] = [first, last].map(|seen| seen.drive(1).unwrap());
    assert!((last.position - first.position).abs() < 64 && last.statusword.is_enabled(), "{first:?} {last:?}");
    assert_eq!(stopped(&server, false).unwrap().text, "", "it does not push any more");
}
