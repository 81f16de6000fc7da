//! `tcp_rtt_p50`, `tcp_rtt_p99`: from a command frame that goes out to the report it causes, over loopback: a client's
//! write and read, a server, and a board that makes a report of each frame. The baseline is a bare TCP echo of as many
//! bytes both ways: one thread that reads and writes back.
//!
//! Also, as facts: the same with a secret (TLS), and a write alone.

mod common;
#[path = "common/places.rs"]
mod places;

use std::collections::VecDeque;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use common::Demand;
use ecmsk::link::tcp::Secret;
use ecmsk::link::{self, Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Share, Stamp, Wait};
use ecmsk::port::tcp::{ServeOptions, Server};
use ecmsk::sk::{Frame, SlotSize};
use places::Places;

/// Bytes of a write's message, and of a report's.
const OUT: usize = 4 + 8 + 8 + 512;
const IN: usize = 4 + 24 + 512;
const CALLS: usize = 2000;
const BLOCKS: usize = 15;
const ALLOWANCE: Duration = Duration::from_micros(20);
const LIMIT: Wait = Wait::For(Duration::from_secs(10));

fn main() {
    let places = Places::find();
    let server = places.server(|| serve(None));
    let board = link::open(&format!("tcp://{}", server.address()), Share::ByName).expect("a link");
    let mut echo = Echo::start(&places);
    let (frame, mut report) = (Frame::new(), Frame::new());
    for (name, share) in [("tcp_rtt_p50", 50), ("tcp_rtt_p99", 99)] {
        let demand = Demand { name, target: Some(1.2), allowance: Some(ALLOWANCE), against: None };
        let ours = || {
            common::percentile(CALLS, share, || {
                board.write(&frame, LIMIT).expect("it is taken");
                board.read(&mut report, LIMIT).expect("a report");
            })
        };
        common::pair_of_blocks(demand, BLOCKS, ours, || common::percentile(CALLS, share, || echo.exchange()));
    }
    // Its reports are dropped.
    let written = common::percentile(CALLS, 50, || {
        board.write(&frame, LIMIT).expect("it is taken");
    });
    common::fact("tcp_write_p50", written, "ns");
    drop((board, server));

    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("secret");
    std::fs::write(&file, "0123456789abcdef0123456789abcdef").expect("a file");
    restrict(&file);
    let secret = Secret::load(&file).expect("a secret");
    let server = places.server(|| serve(Some(secret)));
    let uri = format!("tcp://{}?secret_file={}", server.address(), file.display());
    let board = link::open(&uri, Share::ByName).expect("a link");
    let secured = common::percentile(CALLS, 50, || {
        board.write(&frame, LIMIT).expect("it is taken");
        board.read(&mut report, LIMIT).expect("a report");
    });
    common::fact("tcp_rtt_tls_p50", secured, "ns");
}

fn serve(secret: Option<Secret>) -> Server {
    let listen = ([127, 0, 0, 1], 0).into();
    let board: Arc<dyn Link> = Arc::new(Answering::default());
    Server::start(move || Ok(Arc::clone(&board)), ServeOptions { listen, secret, ..ServeOptions::default() })
        .expect("it listens")
}

#[cfg(unix)]
fn restrict(file: &std::path::Path) {
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::set_permissions(file, std::fs::Permissions::from_mode(0o600)).expect("a mode");
}

/// A board that makes a report of each frame.
#[derive(Default)]
struct Answering {
    reports: Mutex<(VecDeque<Frame>, u64)>,
    news: Condvar,
}

impl Link for Answering {
    fn info(&self) -> LinkInfo {
        LinkInfo {
            name: "answering:".into(),
            slot: Some(SlotSize::Bytes12),
            virtual_time: false,
            opened_at: Stamp(0),
            read_wait: Wait::Forever,
            write_wait: Wait::Forever,
        }
    }

    fn write(&self, frame: &Frame, _: Wait) -> Result<Stamp, LinkError> {
        self.reports.lock().expect("nobody panics").0.push_back(frame.clone());
        self.news.notify_one();
        Ok(Stamp(0))
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let Wait::For(limit) = wait else { return Err(LinkError::Closed) };
        let reports = self.reports.lock().expect("nobody panics");
        let (mut reports, _) =
            self.news.wait_timeout_while(reports, limit, |reports| reports.0.is_empty()).expect("nobody panics");
        let timeout = LinkError::Timeout { dir: Dir::Read, waited: limit, what: "nothing was written" };
        out.clone_from(&reports.0.pop_front().ok_or(timeout)?);
        reports.1 += 1;
        Ok(ReadMeta { at: Stamp(0), sequence: reports.1 - 1, dropped: 0 })
    }

    fn cancel(&self, _: Dir) {}

    fn close(&self) {}

    fn check(&self) -> Result<(), LinkError> {
        Ok(())
    }

    fn stats(&self) -> LinkStats {
        LinkStats::default()
    }
}

/// The bare echo.
struct Echo {
    socket: TcpStream,
    bytes: [u8; IN],
}

impl Echo {
    fn start(places: &Places) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a socket");
        let address = listener.local_addr().expect("an address");
        let serve = move || {
            let (mut socket, _) = listener.accept().expect("a connection");
            socket.set_nodelay(true).expect("an option");
            let (mut command, report) = ([0; OUT], [0; IN]);
            while socket.read_exact(&mut command).is_ok() && socket.write_all(&report).is_ok() {}
        };
        places.server(|| std::thread::spawn(serve));
        let socket = TcpStream::connect(address).expect("a connection");
        socket.set_nodelay(true).expect("an option");
        Self { socket, bytes: [0; IN] }
    }

    fn exchange(&mut self) {
        self.socket.write_all(&[0; OUT]).expect("it is there");
        self.socket.read_exact(&mut self.bytes).expect("it answers");
    }
}
