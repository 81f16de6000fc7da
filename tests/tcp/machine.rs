//! The machine file of a server: for a client that asks for it, as the tool does for the names of axes, and its limits.

use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::path::Path;
use std::sync::Arc;

use ecmsk::ecm::{Axis, Close, Config, Ecm, EcmError, Options, Slave};
use ecmsk::link::tcp::machine;
use ecmsk::link::uri::LinkUri;
use ecmsk::link::{self, CarriedFile, LinkError, Share};
use ecmsk::port::tcp::{ServeOptions, Server};
use ecmsk::sk::MasterState;
use support::tcp::{LIMIT, Puppet, Raw, connect, connect_next, hello, options, own, serve, serve_link, uri};

/// The file comes whole, however long it is and whoever else is connected; a client that asks takes no place of others.
#[test]
fn a_server_tells_its_machine_file_beside_its_clients() {
    for text in ["", "format = 1\n", &"# a line of a long file: \u{FC}\n".repeat(3000)] {
        let file = (!text.is_empty()).then(|| CarriedFile::new(Path::new("/machines/portal.toml"), text));
        let (options, _told) = options();
        let options = ServeOptions { machine: file.clone().map(Arc::new), max_clients: 1, ..options };
        let server = serve_link(Puppet::new(), options);
        let link = LinkUri::parse(&uri(&server, "")).unwrap();
        assert_eq!(machine(&link), Ok(file.clone()));
        let _writer = connect(&server, "");
        for _ in 0..3 {
            assert_eq!(machine(&link), Ok(file.clone()));
        }
        let error = machine(&LinkUri::parse("sim:").unwrap()).unwrap_err();
        assert!(matches!(error, LinkError::Uri { .. }), "{error:?}");
    }
}

/// Clients that have joined to ask, and do not, keep nobody out.
#[test]
fn idle_clients_keep_no_machine_file_back() {
    let file = CarriedFile::new(Path::new("/machines/portal.toml"), "format = 1\n");
    let (options, _told) = options();
    let options = ServeOptions { machine: Some(Arc::new(file.clone())), ..options };
    let server = serve_link(Puppet::new(), options);
    let mut hello = hello(false, 3_600_000);
    hello[4] = 3;
    let _idle: Vec<Raw> = (0..20)
        .map(|_| {
            let mut raw = Raw::connect(&server);
            raw.send(&hello);
            assert_eq!(raw.answer().expect("an answer").0, 0x81, "a welcome");
            raw
        })
        .collect();
    assert_eq!(machine(&LinkUri::parse(&uri(&server, "")).unwrap()), Ok(Some(file)));
}

/// A server that does not know such clients yet refuses the role in their first message. That is an error, and no wait.
#[test]
fn a_server_from_before_refuses_who_asks() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let link = LinkUri::parse(&format!("tcp://{}", listener.local_addr().unwrap())).unwrap();
    let server = std::thread::spawn(move || {
        let (mut client, _) = listener.accept().unwrap();
        client.write_all(b"ecmsktcp\x04\x00\x00\x01\x00\x00\x00\x00").unwrap();
        let mut hello = [0; 5];
        client.read_exact(&mut hello).unwrap();
        let text = b"a message of kind 0x01 has 3 for a role";
        let length = (3 + text.len()) as u8;
        client.write_all(&[&[length, 0, 0x82, 0, 5, text.len() as u8, 0], &text[..]].concat()).unwrap();
        hello[4]
    });
    let error = machine(&link).unwrap_err();
    assert!(error.to_string().contains("its server did not understand"), "{error}");
    assert_eq!(server.join().unwrap(), 3, "the role");
}

const LIMITED: &str = "format = 1\n[axes]\nX = { slave = 1, max = 20000 }\n[limits]\nprogram = \"stop\"\n";

/// A server whose board's link has limits for programs (`axes=`), or that has a machine file with them: a writer's target
/// beyond one fails with the same error as in one process, and what is beside it in the frame is sent. The server knows it:
/// when the writer vanishes, it brakes that axis.
#[test]
fn a_server_with_limits_refuses_a_target_and_sends_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("machine.toml");
    std::fs::write(&path, LIMITED).unwrap();
    refuses_and_sends_the_rest(&serve(&format!("sim:?slaves=drive*2&clock=virtual&axes={}", path.display())).0);

    let (options, told) = options();
    let options = ServeOptions { machine: Some(Arc::new(CarriedFile::new(&path, LIMITED))), ..options };
    let board = link::open(&own("sim:?slaves=drive*2&clock=virtual"), Share::ByUri).unwrap();
    let server = serve_link(board, options);
    refuses_and_sends_the_rest(&server);
    server.flush();
    let said = told.lines().into_iter().filter(|line| line.contains("axis X: a target of 20001 counts")).count();
    assert_eq!(said, 1, "once for each excursion: {:?}", told.lines());
}

fn refuses_and_sends_the_rest(server: &Server) {
    let config = Config { slaves: vec![Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSV)], ..Config::default() };
    let link = connect(server, "");
    let ecm = Ecm::over(Arc::clone(&link), Options::default()).unwrap();
    ecm.configure(&config).unwrap();
    ecm.set_state(MasterState::Op).unwrap();
    ecm.servo_on(&[1, 2]).unwrap();
    let mut stream = ecm.stream(16).unwrap();
    for _ in 0..200 {
        stream.csp(1, 20_001).unwrap();
        stream.csv(2, 50_000).unwrap();
        match stream.step().unwrap_err() {
            EcmError::Link(LinkError::BeyondLimit { at_ns: 1.., why }) => {
                assert!(why.starts_with("axis X: a target of 20001 counts at "), "{why}");
            }
            error => panic!("{error}"),
        }
    }
    std::mem::forget(stream);
    assert!(ecm.snapshot().unwrap().position(2).unwrap() > 5000);
    link.vanish();
    drop(ecm);
    let next = Ecm::over(connect_next(server, ""), Options { close: Close::Leave, ..Options::default() }).unwrap();
    next.adopt(&config).unwrap();
    let positions = |ecm: &Ecm| [1, 2].map(|axis| ecm.snapshot().unwrap().position(axis).unwrap());
    let before = positions(&next);
    (0..100).for_each(|_| drop(next.next_cycle(LIMIT).unwrap()));
    let moved = [0, 1].map(|axis| positions(&next)[axis] - before[axis]);
    assert!(moved.iter().all(|counts| counts.abs() <= 2) && before[0] <= 5, "{moved:?} {before:?}");
}
