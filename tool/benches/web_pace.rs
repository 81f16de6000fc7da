//! `web_pace`: how late the cycles of a served board begin, 99 of 100, while `ecmsk serve web` shows it to three pages, against
//! the same board without pages. Four drives move in CSP at 1 kHz, and a program sends their targets over TCP.
//!
//! Also, as a fact: the bytes that a page gets a second for each axis.

#[path = "../../benches/common/board.rs"]
mod board;
#[path = "../../benches/common/mod.rs"]
mod common;
#[path = "../../benches/common/late.rs"]
mod late;

use std::io::{BufRead, BufReader};
use std::net::{SocketAddr, TcpStream};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use board::{Path, SIZE};
use common::Demand;
use ecmsk::link::engine::{EngineLink, RunOptions};
use ecmsk::link::{self, Link, Share, Wait};
use ecmsk::port::tcp::{ServeOptions, Server};
use ecmsk::sk::{Frame, Motion, SlaveCommand};
use late::{Begins, Watched, p99_lateness};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

const DRIVES: usize = 4;
const PAGES: usize = 3;
const BLOCKS: usize = 9;
const BLOCK: Duration = Duration::from_secs(2);
const ALLOWANCE: Duration = Duration::from_micros(20);
const LIMIT: Wait = Wait::For(Duration::from_secs(10));
/// More cycles than a block has.
const CYCLES_MAX: usize = 10_000;

fn main() {
    let begins = Begins::default();
    let noted = Arc::clone(&begins);
    let board = board::drives_in_op_over(DRIVES, |bus| Box::new(Watched { bus, begins: noted }));
    let options = RunOptions { virtual_time: false, ..RunOptions::default() };
    let board: Arc<dyn Link> = Arc::new(EngineLink::open("bench:", board, options, None).expect("it talks"));
    let served = Arc::clone(&board);
    let listen = ([127, 0, 0, 1], 0).into();
    let server = Server::start(move || Ok(Arc::clone(&served)), ServeOptions { listen, ..ServeOptions::default() })
        .expect("it listens");
    let program = Program::start(server.address());

    let lateness = || {
        *begins.lock().expect("nobody panics") = Vec::with_capacity(CYCLES_MAX);
        thread::sleep(BLOCK);
        let begins = std::mem::take(&mut *begins.lock().expect("nobody panics"));
        p99_lateness(begins.into_iter())
    };
    let mut bytes = Vec::new();
    let with_pages = || {
        let shown = Shown::start(server.address());
        let before = (shown.bytes(), Instant::now());
        let late = lateness();
        let per_second = (shown.bytes() - before.0) as f64 / before.1.elapsed().as_secs_f64();
        bytes.push(per_second / (PAGES * DRIVES) as f64);
        shown.end();
        late
    };
    let demand = Demand { name: "web_pace", target: Some(1.1), allowance: Some(ALLOWANCE), against: Some("no page") };
    common::pair_of_blocks(demand, BLOCKS, with_pages, lateness);
    common::fact("web_bytes_per_axis", common::median(bytes), "bytes/s");
    program.end();
    drop(server);
    board.close();
}

/// A program that sends each drive a target in each cycle.
struct Program {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Program {
    fn start(address: SocketAddr) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let stops = Arc::clone(&stop);
        let board = link::open(&format!("tcp://{address}"), Share::ByName).expect("a link");
        let thread = thread::spawn(move || {
            let (mut command, mut report, mut path) = (Frame::new(), Frame::new(), Path::default());
            while !stops.load(Ordering::Relaxed) {
                board.read(&mut report, LIMIT).expect("a report");
                path.advance();
                for slave in 1..=DRIVES {
                    command.put_slave(SIZE, slave, &SlaveCommand::Csp(Motion::to(path.target)).into());
                }
                command.fill_crc(SIZE);
                board.write(&command, LIMIT).expect("it is taken");
            }
            board.close();
        });
        Self { stop, thread }
    }

    fn end(self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().expect("the board was there");
    }
}

/// A server of the page, and the pages that it sends points to.
struct Shown {
    server: Child,
    bytes: Arc<AtomicU64>,
    pages: Vec<JoinHandle<()>>,
}

impl Shown {
    /// Returns when each page gets points.
    fn start(board: SocketAddr) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ecmsk"));
        command.args(["serve", "web", "--listen", "127.0.0.1:0", "--machine", "none", "--link"]);
        let mut server = command.arg(format!("tcp://{board}")).stdout(Stdio::piped()).spawn().expect("the tool starts");
        let mut line = String::new();
        BufReader::new(server.stdout.take().expect("a pipe")).read_line(&mut line).expect("text");
        let url = line.strip_prefix("listening on ").and_then(|rest| rest.split(';').next()).expect(&line);
        let bytes = Arc::new(AtomicU64::new(0));
        let page = |_| {
            let mut socket = connect(url);
            while !matches!(socket.read().expect("a message"), Message::Binary(_)) {}
            let bytes = Arc::clone(&bytes);
            thread::spawn(move || {
                while let Ok(message) = socket.read() {
                    bytes.fetch_add(message.len() as u64, Ordering::Relaxed);
                }
            })
        };
        let pages = (0..PAGES).map(page).collect();
        Self { server, bytes, pages }
    }

    fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    fn end(mut self) {
        self.server.kill().expect("it runs");
        self.server.wait().expect("it ends");
        for page in self.pages {
            page.join().expect("it has only read");
        }
    }
}

fn connect(url: &str) -> WebSocket<TcpStream> {
    let (host, token) =
        url.strip_prefix("http://").and_then(|rest| rest.split_once("/?")).expect("an address with a token");
    let mut request = format!("ws://{host}/live?{token}").into_client_request().expect("an address");
    request.headers_mut().insert("Origin", format!("http://{host}").parse().expect("a field"));
    tungstenite::client(request, TcpStream::connect(host).expect("it listens")).expect("there is room").0
}
