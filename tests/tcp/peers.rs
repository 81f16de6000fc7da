//! A server and a client whose other end misbehaves: nonsense, half a frame, nothing, too many, too late. The
//! misbehaving end gets the reason and is disconnected; no other client is affected, and no call hangs.
#![cfg(unix)]

use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use ecmsk::link::{self, Link, LinkError, Share, Wait};
use ecmsk::port::tcp::{ServeError, ServeOptions, Server};
use ecmsk::sk::{FifoAction, Frame, MasterCommand};
use support::tcp::{
    GREETING, LIMIT, Puppet, Raw, SIZE, connect, connect_next, frame, hello, message, options, refused, serve,
    serve_link, until, write,
};

const WELCOME: u8 = 0x81;
const REFUSED: u8 = 0x82;
const WRITTEN: u8 = 0x84;
const FAILED: u8 = 0x88;
const BYE: u8 = 0x41;
const PING: u8 = 0x40;

/// A server of a puppet, with a writer that works.
fn served() -> (Arc<Puppet>, Server, support::tcp::Told, Arc<dyn Link>) {
    let puppet = Puppet::new();
    let (options, told) = options();
    let server = serve_link(puppet.clone(), options);
    let link = connect(&server, "");
    (puppet, server, told, link)
}

fn works(link: &Arc<dyn Link>) {
    link.write(&frame(9), Wait::For(LIMIT)).unwrap();
}

/// TCP-12 A first message other than hello is refused, with the reason, and the connection ends.
#[test]
fn a_first_message_other_than_hello_is_refused() {
    let (_puppet, server, told, link) = served();
    let long = [0xFF, 0xFF, 0x01, 0];
    let mut version = hello(true, 500);
    version.extend([0; 3]);
    version[0] += 3;
    for nonsense in [
        b"GET / HTTP/1.1\r\n\r\n".to_vec(),
        long.to_vec(),
        message(0x77, b""),
        message(PING, b""),
        write(1, 0, &frame(1)),
        hello(true, 0),
        hello(true, 3_600_001),
        version,
        message(0x01, &[2; 60]),
    ] {
        let mut raw = Raw::connect(&server);
        raw.send(&nonsense);
        let (kind, payload) = raw.answer().expect("a refusal");
        assert_eq!((kind, payload[0]), (REFUSED, 5), "{nonsense:?}");
        assert!(payload.len() > 3, "it says why");
        assert_eq!(raw.take::<1>(), None);
    }
    told.wait("is no hello");
    works(&link);
}

/// TCP-12 A message out of turn ends the connection, with the reason; nothing of it reaches the board.
#[test]
fn nonsense_from_a_client_ends_it() {
    let (puppet, server, _told, link) = served();
    for nonsense in [
        message(0x77, b""),
        hello(true, 500),
        write(1, 0, &frame(1)),
        message(0x03, &[0; 16]),
        message(0x04, &[0; 16]),
        message(0x83, &[0; 536]),
        message(0x02, &[0; 30]),
        [0xFF, 0xFF, 0x02, 0].to_vec(),
    ] {
        let mut raw = Raw::connect(&server);
        assert_eq!(raw.hello(true, 500).unwrap().0, WELCOME);
        raw.send(&nonsense);
        let (kind, payload) = raw.answer().expect("good-bye");
        assert_eq!((kind, payload[0]), (BYE, 4), "{nonsense:?}");
        assert_eq!(raw.take::<1>(), None);
    }
    works(&link);
    assert_eq!(puppet.taken(), [frame(9)]);
}

/// TCP-12 A second request before the first has ended is refused: the first may have been executed, the second is not.
#[test]
fn a_second_request_under_way_ends_it() {
    let (puppet, server, _told, link) = served();
    link.close();
    let mut raw = Raw::connect(&server);
    assert_eq!(raw.hello(false, 500).unwrap().0, WELCOME);
    puppet.take_none(true);
    raw.send(&[write(1, u64::MAX, &frame(1)), write(2, u64::MAX, &frame(2))].concat());
    assert_eq!(raw.answer().unwrap().0, BYE);
    puppet.take_none(false);
    works(&connect_next(&server, ""));
    assert_eq!(puppet.taken(), [frame(9)]);
}

/// TCP-12 Half a frame is dropped: the board gets nothing of it.
#[test]
fn a_frame_received_in_part_does_not_reach_the_board() {
    let (puppet, server, _told, link) = served();
    link.close();
    let whole = write(7, 0, &frame(1));
    for cut in [1, 3, 4, 20, whole.len() - 1] {
        let mut raw = Raw::writer(&server);
        raw.send(&whole[..cut]);
    }
    let mut raw = Raw::writer(&server);
    for part in whole.chunks(100) {
        raw.send(part);
        thread::sleep(Duration::from_millis(5));
    }
    let (kind, payload) = raw.answer().unwrap();
    assert_eq!((kind, &payload[..8]), (WRITTEN, &7_u64.to_le_bytes()[..]), "one that comes in pieces is one");
    // The server's own frame after a writer that has vanished: it clears that writer's entries in the FIFO.
    let mut clear = Frame::new();
    clear.put_master(SIZE, &MasterCommand::SetFifo(FifoAction::Clear));
    clear.fill_crc(SIZE);
    let taken = puppet.taken().into_iter().filter(|taken| *taken != clear).collect::<Vec<_>>();
    assert_eq!(taken, [frame(1)]);
}

/// TCP-12 A silent client is disconnected: before its hello after the server's limit, later after four keep-alive
/// times.
#[test]
fn a_client_that_says_nothing_is_disconnected() {
    let puppet = Puppet::new();
    let (options, told) = options();
    let server = serve_link(puppet, ServeOptions { hello_limit: Duration::from_secs(1), ..options });
    let mut mute = Raw::connect(&server);
    assert_eq!(mute.take::<1>(), None);
    told.wait("said nothing for 1s");
    let mut raw = Raw::connect(&server);
    assert_eq!(raw.hello(true, 50).unwrap().0, WELCOME);
    // TCP-5 The server sends a ping, and waits for one.
    assert_eq!(raw.message().unwrap().0, PING);
    while raw.message().is_some() {}
    told.wait("no word for");
}

/// TCP-5 Clients that send pings stay connected without other traffic; a client whose server has become silent loses
/// its link after four keep-alive times.
#[test]
fn keep_alive_on_both_sides() {
    let (_puppet, server, told, link) = served();
    let idle = connect(&server, "role=reader");
    // Longer than it may be silent.
    thread::sleep(Duration::from_millis(2500));
    assert_eq!(idle.check(), Ok(()));
    assert!(matches!(idle.read(&mut Frame::new(), Wait::Now), Err(LinkError::Timeout { .. })));
    works(&link);
    assert!(!told.lines().iter().any(|line| line.contains("no word")));

    let (address, _silent) = fake_server(|mut socket| {
        socket.write_all(&welcome()).unwrap();
        Some(socket)
    });
    let link = link::open(&format!("tcp://{address}?keepalive_ms=50"), Share::ByName).unwrap();
    let lost = link.read(&mut Frame::new(), Wait::Forever).unwrap_err();
    assert!(matches!(&lost, LinkError::Lost { reason, .. } if reason.contains("no word")), "{lost:?}");
}

/// If a connection ends during a write, the error says that it is unknown whether the board has the frame; no frame is
/// sent twice. A server that sends a good-bye first has not taken it.
#[test]
fn a_connection_that_ends_during_a_write_is_unsure() {
    for says_bye in [false, true] {
        let (address, server) = fake_server(move |mut socket| {
            socket.write_all(&welcome()).unwrap();
            // The hello, then the write: header, number, limit, frame.
            let mut header = [0; 4];
            socket.read_exact(&mut header).unwrap();
            let hello = usize::from(header[0]) + 256 * usize::from(header[1]);
            let mut seen = vec![0; hello + 4 + 8 + 8 + 512];
            socket.read_exact(&mut seen).unwrap();
            if says_bye {
                socket.write_all(&message(BYE, &[3, 2, 0, b'o', b'h'])).unwrap();
            }
            drop(socket);
            None
        });
        let link = link::open(&format!("tcp://{address}?keepalive_ms=60000"), Share::ByName).unwrap();
        let ended = link.write(&frame(1), Wait::Forever).unwrap_err();
        let text = ended.to_string();
        if says_bye {
            assert!(matches!(&ended, LinkError::Lost { reason, .. } if reason == "oh"), "{ended:?}");
        } else {
            assert!(matches!(ended, LinkError::Unsure { .. }), "{ended:?}");
            assert!(text.contains("not known") && text.contains("open it again"), "{text}");
        }
        let again = link.write(&frame(1), Wait::Forever).unwrap_err();
        assert!(matches!(again, LinkError::Lost { .. }), "what was never sent is surely not taken: {again:?}");
        let connections = server.join().unwrap();
        assert_eq!(connections, 1, "it does not connect again by itself");
    }
}

/// TCP-12 An invalid message of the server is an error of the client's calls, with the reason.
#[test]
fn an_invalid_message_of_the_server_is_an_error_of_the_calls() {
    for (nonsense, part) in [
        (message(0x77, b""), "unknown kind 0x77"),
        (message(WRITTEN, &[0; 24]), "out of turn"),
        (message(0x83, &[0; 5]), "short"),
        (message(FAILED, &[0xFF; 40]), "0x88"),
        ([0xFF, 0xFF, 0x83, 0].to_vec(), "65535 bytes"),
        (welcome()[16..].to_vec(), "out of turn"),
    ] {
        let (address, _server) = fake_server(move |mut socket| {
            socket.write_all(&[welcome(), nonsense.clone()].concat()).unwrap();
            Some(socket)
        });
        let link = link::open(&format!("tcp://{address}"), Share::ByName).unwrap();
        let error = link.read(&mut Frame::new(), Wait::Forever).unwrap_err().to_string();
        assert!(error.contains(part), "{error}: no {part}");
    }
}

/// TCP-12 If the other end is no server, or one of another version, connecting reports it.
#[test]
fn another_server_or_another_version_is_refused() {
    let mut version = *GREETING;
    version[8] = 9;
    for (first, part) in [
        (b"HTTP/1.1 400 Bad Request\r\n".to_vec(), "no `ecmsk serve tcp`"),
        (version.to_vec(), "version 9"),
        (b"ecmsktcp\x01\x00\x00\x01\x00\x00\x00\x00".to_vec(), "version 1 of the protocol, this one 4"),
        (Vec::new(), "closed the connection"),
        (GREETING[..7].to_vec(), "closed the connection"),
        ([&GREETING[..], &message(PING, b"")].concat(), "out of turn"),
        ([&GREETING[..], &message(REFUSED, &[3, 0, 0])].concat(), "--max-clients"),
    ] {
        let (address, _server) = fake_server(move |mut socket| {
            socket.write_all(&first).unwrap();
            None
        });
        let error = link::open(&format!("tcp://{address}"), Share::ByName).err().unwrap();
        assert!(matches!(error, LinkError::NoBoard { .. }), "{error:?}");
        assert!(error.to_string().contains(part), "{error}: no {part}");
    }
    let (address, _server) = fake_server(Some);
    let error = link::open(&format!("tcp://{address}?connect_timeout_ms=50"), Share::ByName).err().unwrap().to_string();
    assert!(error.contains("no answer within 50ms"), "{error}");
}

/// TCP-13 A thousand silent connections are all greeted, and the server keeps the newest 256 of them; meanwhile a
/// client that sends its hello is accepted, and existing clients go on.
#[test]
fn a_thousand_silent_connections_keep_nobody_out() {
    let (_puppet, server, told, link) = served();
    let mut silent = Vec::new();
    for _ in 0..1000 {
        silent.push(Raw::connect(&server));
    }
    let reader = connect(&server, "role=reader");
    assert_eq!(reader.check(), Ok(()));
    told.wait("made room for others");
    // The disconnected ones have ended, and the newest are still connected or have reached their time limit.
    for raw in &mut silent[..744] {
        assert_eq!(raw.take::<1>(), None, "it has ended");
    }
    works(&link);
}

/// TCP-13 The limit of clients.
#[test]
fn the_limit_of_clients_is_kept() {
    let (options, told) = options();
    let server = serve_link(Puppet::new(), ServeOptions { max_clients: 2, ..options });
    let links = [connect(&server, ""), connect(&server, "role=reader")];
    let full = refused(&server, "role=reader");
    assert!(matches!(full, LinkError::NoBoard { .. }) && full.to_string().contains("--max-clients"), "{full}");
    told.wait("as many clients as allowed");
    links[1].close();
    connect(&server, "role=reader");
    assert_eq!(links[0].check(), Ok(()));
}

/// A client that never reads delays no other client: the board's reports go to the others, and its own unread answers
/// end its connection.
#[test]
fn a_client_that_never_reads_delays_nobody() {
    let (puppet, server, told, link) = served();
    let mut deaf = Raw::connect(&server);
    deaf.send(&hello(true, 3_600_000));
    let quick = connect(&server, "role=reader");
    let mut report = Frame::new();
    for n in 0..3000_u64 {
        puppet.report(&frame(n as u8));
        assert_eq!(quick.read(&mut report, Wait::For(LIMIT)).unwrap().sequence, n);
    }
    works(&link);
    // It requests counters, and never reads the answers.
    let mut number = 0_u64;
    let count = |number: u64| message(0x05, &number.to_le_bytes());
    deaf.0.set_write_timeout(Some(LIMIT)).unwrap();
    until("its end", || {
        number += 1;
        deaf.0.write_all(&count(number)).err()
    });
    told.wait("does not take what is sent to it");
    works(&link);
}

/// Without a secret no client from outside is served.
#[test]
fn a_place_others_can_reach_needs_a_secret() {
    for listen in ["0.0.0.0:0", "[::]:0"] {
        let options = ServeOptions { listen: listen.parse().unwrap(), ..ServeOptions::default() };
        let error = Server::start(|| unreachable!("the board is not touched"), options).err().unwrap();
        assert!(matches!(error, ServeError::NeedsSecret { .. }), "{error:?}");
        assert!(error.to_string().contains("--secret-file"), "{error}");
    }
    let (server, _) = serve("sim:?slaves=drive");
    let options = ServeOptions { listen: server.address(), ..ServeOptions::default() };
    let error = Server::start(|| unreachable!("the board is not touched"), options).err().unwrap();
    assert!(matches!(error, ServeError::Listen { .. }) && error.to_string().contains("--listen"), "{error}");
}

/// Invalid addresses.
#[test]
fn invalid_addresses_are_refused() {
    for place in ["", "host:1", "//host:", "//:1", "//host:0", "//host:65536", "//host:+1", "//::1:4711", "//[::1:5"] {
        let error = link::open(&format!("tcp:{place}"), Share::ByName).err().unwrap();
        assert!(
            matches!(error, LinkError::Uri(_)) && error.to_string().contains("tcp://HOST:PORT"),
            "{place}: {error}"
        );
    }
    for uri in ["tcp://127.0.0.1:1?role=both", "tcp://127.0.0.1:1?keepalive_ms=49", "tcp://127.0.0.1:1?clock=virtual"] {
        assert!(matches!(link::open(uri, Share::ByName), Err(LinkError::Uri(_))), "{uri}");
    }
}

/// A server's first message, and its acceptance of the client.
fn welcome() -> Vec<u8> {
    let mut payload = vec![0; 32];
    payload.extend([12, 0]);
    payload.extend([0; 16]);
    payload.extend(1_u16.to_le_bytes());
    payload.push(b'x');
    // No slaves and units are known.
    payload.extend([0; 4]);
    [&GREETING[..], &message(WELCOME, &payload)].concat()
}

/// A fake server: passes every connection to `serve` and keeps the returned ones open. Returns its address; its thread
/// ends with the first connection that is not kept, and returns their number.
fn fake_server(
    serve: impl Fn(TcpStream) -> Option<TcpStream> + Send + 'static,
) -> (std::net::SocketAddr, thread::JoinHandle<usize>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let thread = thread::spawn(move || {
        let mut kept = Vec::new();
        let mut came = 0;
        loop {
            let Ok((socket, _)) = listener.accept() else { return came };
            came += 1;
            socket.set_read_timeout(Some(LIMIT)).unwrap();
            match serve(socket) {
                Some(socket) => kept.push(socket),
                None => break,
            }
        }
        listener.set_nonblocking(true).unwrap();
        thread::sleep(Duration::from_millis(50));
        came + usize::from(listener.accept().is_ok())
    });
    (address, thread)
}
