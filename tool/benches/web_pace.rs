//! `web_pace`: how late the cycles of a served board begin, 99 of 100, while `ecmsk serve web` shows it to three pages, against
//! the same board without pages. Four drives move in CSP at 1 kHz, and a program sends their targets over TCP. As a fact: the
//! bytes that a page gets a second for each axis.
//!
//! `web_frame_40`: the time from a frame of the browser to the next one while the page shows 40 such drives. It needs Chromium.
//! As a fact: how often the page draws new points.

#[path = "../../benches/common/board.rs"]
mod board;
#[path = "../../benches/common/mod.rs"]
mod common;
#[path = "../../benches/common/late.rs"]
mod late;
#[path = "../tests/tool/common/mod.rs"]
#[allow(dead_code, unused_imports, reason = "this bench takes the page's server and the browser")]
mod tool;

use std::net::SocketAddr;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use board::{Path, SIZE};
use common::Demand;
use ecmsk::fieldbus::Fieldbus;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::link::engine::{EngineLink, RunOptions};
use ecmsk::link::{self, Link, Share, Wait};
use ecmsk::port::tcp::{ServeOptions, Server};
use ecmsk::sk::{Frame, Motion, SlaveCommand};
use late::{Begins, Watched, p99_lateness};
use tool::page::{Browser, Serving};
use tungstenite::Message;

const DRIVES: usize = 4;
const PAGES: usize = 3;
const BLOCKS: usize = 9;
const BLOCK: Duration = Duration::from_secs(2);
const ALLOWANCE: Duration = Duration::from_micros(20);
const LIMIT: Wait = Wait::For(Duration::from_secs(10));
/// More cycles than a block has.
const CYCLES_MAX: usize = 10_000;
/// As many drives as a board has.
const ALL_DRIVES: usize = 40;
const FRAMES_PER_SECOND_MIN: f64 = 30.0;
/// Counts for a few seconds the frames of the browser and those for which the page draws new points; both per second.
const COUNT_FRAMES: &str = "new Promise((done) => {
    let [frames, draws] = [0, 0];
    const draw = page.draw;
    page.draw = function () {
        draws += this.dirty;
        draw.call(this);
    };
    const begin = performance.now();
    const count = () => {
        frames++;
        const seconds = (performance.now() - begin) / 1000;
        if (seconds < 3) return requestAnimationFrame(count);
        page.draw = draw;
        done([frames / seconds, draws / seconds]);
    };
    requestAnimationFrame(count);
})";

fn main() {
    pace();
    if Command::new("chromium").arg("--version").output().is_ok_and(|said| said.status.success()) {
        frames();
    } else {
        eprintln!("web_frame_40: left out: there is no chromium");
    }
}

fn pace() {
    let begins = Begins::default();
    let noted = Arc::clone(&begins);
    let served = Served::start(DRIVES, |bus| Box::new(Watched { bus, begins: noted }));
    let lateness = || {
        *begins.lock().expect("nobody panics") = Vec::with_capacity(CYCLES_MAX);
        thread::sleep(BLOCK);
        let begins = std::mem::take(&mut *begins.lock().expect("nobody panics"));
        p99_lateness(begins.into_iter())
    };
    let mut bytes = Vec::new();
    let with_pages = || {
        let shown = Shown::start(&served);
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
    served.end();
}

fn frames() {
    let served = Served::start(ALL_DRIVES, |bus| Box::new(bus));
    let web = served.show();
    let mut browser = Browser::start();
    browser.open(web.address());
    browser.wait_for("page.scope.panels.length > 0 && page.store.to - page.store.from > page.span");
    let mut per_second = || {
        let seen = browser.value(COUNT_FRAMES);
        [0, 1].map(|place| seen[place].as_f64().expect("a number"))
    };
    let (frames, draws) = (0..BLOCKS).map(|_| per_second()).map(|[frames, draws]| (frames, draws)).unzip();
    let frame_ms = 1000.0 / common::median(frames);
    common::limited("web_frame_40", frame_ms, "ms", 1000.0 / FRAMES_PER_SECOND_MIN);
    common::fact("web_draws_40", common::median(draws), "/s");
    served.end();
}

/// A board in OP that is served over TCP, and a program that moves its drives.
struct Served {
    board: Arc<dyn Link>,
    server: Server,
    program: Program,
}

impl Served {
    fn start(drives: usize, over: impl FnOnce(SimBus) -> Box<dyn Fieldbus>) -> Self {
        let board = board::drives_in_op_over(drives, over);
        let options = RunOptions { virtual_time: false, ..RunOptions::default() };
        let board: Arc<dyn Link> = Arc::new(EngineLink::open("bench:", board, options, None).expect("it talks"));
        let served = Arc::clone(&board);
        let listen = ([127, 0, 0, 1], 0).into();
        let server = Server::start(move || Ok(Arc::clone(&served)), ServeOptions { listen, ..ServeOptions::default() })
            .expect("it listens");
        let program = Program::start(server.address(), drives);
        Self { board, server, program }
    }

    /// A server of its page.
    fn show(&self) -> Serving {
        Serving::start("web", &["--machine", "none", "--link", &format!("tcp://{}", self.server.address())])
    }

    fn end(self) {
        self.program.end();
        drop(self.server);
        self.board.close();
    }
}

/// A program that sends each drive a target in each cycle.
struct Program {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Program {
    fn start(address: SocketAddr, drives: usize) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let stops = Arc::clone(&stop);
        let board = link::open(&format!("tcp://{address}"), Share::ByName).expect("a link");
        let thread = thread::spawn(move || {
            let (mut command, mut report, mut path) = (Frame::new(), Frame::new(), Path::default());
            while !stops.load(Ordering::Relaxed) {
                board.read(&mut report, LIMIT).expect("a report");
                path.advance();
                for slave in 1..=drives {
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
    server: Serving,
    bytes: Arc<AtomicU64>,
    pages: Vec<JoinHandle<()>>,
}

impl Shown {
    /// Returns when each page gets points.
    fn start(served: &Served) -> Self {
        let server = served.show();
        let bytes = Arc::new(AtomicU64::new(0));
        let page = |_| {
            let mut socket = server.socket().expect("there is room");
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

    fn end(self) {
        drop(self.server);
        for page in self.pages {
            page.join().expect("it has only read");
        }
    }
}
