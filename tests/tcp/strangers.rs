//! Connections that do not send a hello: they are closed in favour of those that do, even if they are reopened
//! repeatedly, and do not fill the log.
#![cfg(unix)]

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::fs::PermissionsExt as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use ecmsk::link::tcp::Secret;
use ecmsk::link::{self, Share, Wait};
use ecmsk::port::tcp::{ServeOptions, Server};
use support::tcp::{LIMIT, Puppet, Raw, connect, frame, options, serve_link, until};

/// More connections than a server keeps.
const CROWD: usize = 300;

/// Keeps a crowd of connections that send `words` and no more, and reopens each as soon as the server has closed it.
struct Attacker {
    stop: Arc<AtomicBool>,
    renewed: Arc<AtomicUsize>,
    thread: Option<JoinHandle<()>>,
}

impl Attacker {
    fn start(server: SocketAddr, words: &'static [u8]) -> Self {
        let (stop, renewed) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicUsize::new(0)));
        let thread = thread::spawn({
            let (stop, renewed) = (Arc::clone(&stop), Arc::clone(&renewed));
            move || {
                let open = || {
                    let mut socket = TcpStream::connect(server).ok()?;
                    socket.write_all(words).ok()?;
                    socket.set_nonblocking(true).ok()?;
                    Some(socket)
                };
                let mut crowd: Vec<Option<TcpStream>> = (0..CROWD).map(|_| open()).collect();
                while !stop.load(Ordering::Acquire) {
                    for place in &mut crowd {
                        if place.as_mut().is_none_or(is_closed) {
                            *place = open();
                            renewed.fetch_add(1, Ordering::Relaxed);
                        }
                    }
                    thread::sleep(Duration::from_millis(1));
                }
            }
        });
        Self { stop, renewed, thread: Some(thread) }
    }
}

impl Drop for Attacker {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        let _ = self.thread.take().unwrap().join();
    }
}

fn is_closed(socket: &mut TcpStream) -> bool {
    loop {
        match socket.read(&mut [0; 1024]) {
            Ok(0) => return true,
            Ok(_) => {}
            Err(error) => return error.kind() != ErrorKind::WouldBlock,
        }
    }
}

/// Opens `count` times, as a writer, and writes a frame each time.
fn all_get_in(server: &Server, keys: &str, count: u8) {
    for n in 0..count {
        // A busy machine may be slow.
        let uri = format!("tcp://{}?{keys}&connect_timeout_ms={}", server.address(), LIMIT.as_millis());
        let link = link::open(&uri, Share::ByName).unwrap_or_else(|error| panic!("number {n}: {error}"));
        link.write(&frame(n), Wait::For(LIMIT)).unwrap();
        link.close();
    }
}

/// A server with a limit for strangers longer than any client waits: it closes strangers only to make room.
fn patient() -> ServeOptions {
    ServeOptions { hello_limit: 10 * LIMIT, ..options().0 }
}

/// TCP-13 While an attacker holds more half-open connections than the server keeps, and renews each that is closed, all
/// clients that send a hello are accepted, plain and with the secret; whether the crowd is silent or sends the begin of
/// a message.
#[test]
fn a_crowd_locks_nobody_out() {
    for words in [b"" as &[u8], b"\x2c"] {
        let puppet = Puppet::new();
        let server = serve_link(puppet.clone(), patient());
        let attacker = Attacker::start(server.address(), words);
        until("the crowd is renewed", || (attacker.renewed.load(Ordering::Relaxed) > 50).then_some(()));
        all_get_in(&server, "role=writer", 79);
        assert_eq!(puppet.taken().len(), 79);
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("secret");
    std::fs::write(&file, "0123456789abcdef0123456789abcdef").unwrap();
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).unwrap();
    for words in [b"" as &[u8], b"\x16\x03\x01\x02\x00"] {
        let puppet = Puppet::new();
        let secret = Some(Secret::load(&file).unwrap());
        let server = serve_link(puppet.clone(), ServeOptions { secret, ..patient() });
        let attacker = Attacker::start(server.address(), words);
        until("the crowd is renewed", || (attacker.renewed.load(Ordering::Relaxed) > 50).then_some(()));
        all_get_in(&server, &format!("secret_file={}", file.display()), 20);
        assert_eq!(puppet.taken().len(), 20);
    }
}

/// TCP-13 Readers leave a place for the writer.
#[test]
fn readers_leave_a_place_to_a_writer() {
    let server = serve_link(Puppet::new(), ServeOptions { max_clients: 3, ..options().0 });
    let readers = [connect(&server, "role=reader"), connect(&server, "role=reader")];
    let full = support::tcp::refused(&server, "role=reader").to_string();
    assert!(full.contains("--max-clients"), "{full}");
    let writer = connect(&server, "");
    writer.write(&frame(1), Wait::For(LIMIT)).unwrap();
    readers[0].close();
    connect(&server, "role=reader");
}

/// TCP-13 Two thousand refused strangers are summed up in a few lines with a count in the log: none is missing, and the
/// number of lines is limited.
#[test]
fn refused_connections_are_summed_up_in_the_log() {
    const COUNT: usize = 2000;
    let (options, told) = options();
    let server = serve_link(Puppet::new(), options);
    for _ in 0..COUNT {
        let mut raw = Raw::connect(&server);
        raw.send(b"GET / HTTP/1.1\r\n\r\n");
        assert!(raw.answer().is_some(), "it is told why");
    }
    server.stop();
    let lines: Vec<String> = told.lines().into_iter().filter(|line| line.contains("is no hello")).collect();
    let counted: usize = lines
        .iter()
        .filter_map(|line| line.split(" more times").next()?.rsplit('(').next()?.parse::<usize>().ok())
        .sum();
    let plain = lines.iter().filter(|line| !line.contains("more times")).count();
    assert_eq!(plain + counted, COUNT, "{lines:?}");
    assert!(lines.len() < 60, "{lines:?}");
}
