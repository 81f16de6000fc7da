//! The monitoring that all servers have in common: metrics and health over HTTP, the format of the log, and reports to
//! the service manager.
//!
//! - `watch.rs`: the options, and the thread that checks the boards
//! - `board.rs`: a wrapper around the link of a board, which also checks that the board is alive; `chip.rs`: the same
//!   for an ECM-XF
//! - `frames.rs`: values and events that are found in the frames of a board
//! - `trouble.rs`: texts for what is wrong with a board
//! - `metrics.rs`: the metrics as text
//! - `site.rs`: answers HTTP requests
//!
//! A scrape only reads values that the threads of the server and of this module have stored. It never accesses the
//! board.

mod board;
mod chip;
mod frames;
mod metrics;
mod site;
mod trouble;

use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use ecmsk::link::CarriedFile;
use ecmsk::link::uri::LinkUri;

pub use board::BoardWatch;
use board::Wanted;
pub use chip::ChipWatch;

use super::http_server::HttpServer;
use super::service_manager::{EndReport, Manager};
use crate::lock::lock;
use crate::stderr::{self, LogFormat, say};
use crate::{CliError, output, streams};
use metrics::{Scrape, Seen};

/// The interval between two checks of the boards. \[OURS]
const LOOK_INTERVAL: Duration = Duration::from_millis(250);
/// The interval at which the sizes of recordings are read from disk. \[OURS]
const SIZE_INTERVAL: Duration = Duration::from_secs(5);
/// If a check takes longer than this, reading the counters of the board hangs. \[OURS]
const LOOK_MAX: Duration = Duration::from_secs(5);
/// A scrape gets the text of the previous scrape if that text is not older than this, so that frequent scrapes cost
/// little. \[OURS]
const TEXT_AGE_MAX: Duration = Duration::from_millis(200);
/// The largest number of connections for metrics at the same time; each has a thread. \[OURS]
const CONNECTIONS_MAX: usize = 16;
/// The number of pings in the time within which the service manager expects one. \[OURS]
const PINGS: u32 = 3;

// No doc comment on `WatchArgs`: clap would show it as the help of every server.
#[derive(Clone, clap::Args)]
pub struct WatchArgs {
    /// Serve metrics for Prometheus at http://127.0.0.1:PORT/metrics, and /healthz. Read only, without a password; with an
    /// address of this machine other machines reach them, too
    #[arg(long, value_name = "[ADDR:]PORT", value_parser = metrics_at)]
    metrics: Option<SocketAddr>,

    #[command(flatten)]
    log: LogArgs,
}

// No doc comment on `LogArgs`, for the same reason.
#[derive(Clone, Copy, clap::Args)]
pub struct LogArgs {
    /// Lines of the log: text with the time (without it in systemd's journal, which has its own), or JSON objects
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t = LogFormat::Text)]
    log_format: LogFormat,
}

/// Why the monitoring of a server cannot start.
#[derive(Debug, thiserror::Error)]
pub enum WatchError {
    /// The address of the metrics cannot be listened on.
    #[error("cannot serve metrics on {address}: {source}; choose another port with --metrics, 0 for any")]
    Listen {
        /// The address of `--metrics`.
        address: SocketAddr,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The system cannot start a thread.
    #[error("cannot start a thread for metrics: {0}; free some of the system's memory or threads, then run it again")]
    Thread(io::Error),
}

/// Parses the address of `--metrics`: a port of the loopback address, or an address with a port.
fn metrics_at(text: &str) -> Result<SocketAddr, String> {
    if let Ok(port) = text.parse() {
        return Ok(SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
    }
    text.parse().map_err(|_| match text.parse::<IpAddr>() {
        Ok(address) => format!("the port is missing: write {}", SocketAddr::new(address, 9464)),
        Err(_) => {
            "a port of this machine is needed, e.g. 9464, or an address with a port, e.g. 0.0.0.0:9464 for all its \
                   networks"
                .to_owned()
        }
    })
}

impl LogArgs {
    /// Sets the format of the lines on standard error, as the option requests.
    pub fn begin(self) {
        stderr::log_in(self.log_format);
    }
}

/// The monitoring of a server.
pub struct Watch {
    server: &'static str,
    manager: Manager,
    listener: Option<TcpListener>,
    boards: Vec<Arc<BoardWatch>>,
    chip: Option<Arc<ChipWatch>>,
    clients: Option<Box<dyn Fn() -> usize + Send + Sync>>,
    running: Option<Running>,
    end_report: Option<EndReport>,
}

/// The threads of the monitoring.
struct Running {
    shared: Arc<Shared>,
    site: Option<HttpServer>,
    thread: JoinHandle<()>,
}

/// The data that the threads of the monitoring share.
struct Shared {
    server: &'static str,
    is_loopback: bool,
    boards: Vec<Arc<BoardWatch>>,
    chip: Option<Arc<ChipWatch>>,
    clients: Option<Box<dyn Fn() -> usize + Send + Sync>>,
    /// When the present check of the boards began; `None` between two checks.
    looking: Mutex<Option<Instant>>,
    /// For each board, the sizes of its recordings in bytes, by the kind of the recording.
    recorded: Mutex<Vec<BTreeMap<&'static str, u64>>>,
    /// The latest text of the metrics, and when it was made.
    text: Mutex<Option<(Instant, Arc<str>)>>,
    is_over: AtomicBool,
}

impl WatchArgs {
    /// Sets the format of the log, and listens at the address of the metrics. So if that address is in use, the server
    /// ends before it opens a board. `server`: the name of the verb.
    ///
    /// # Errors
    /// [`WatchError::Listen`].
    pub fn begin(&self, server: &'static str) -> Result<Watch, WatchError> {
        self.log.begin();
        let listen = |address| TcpListener::bind(address).map_err(|source| WatchError::Listen { address, source });
        let listener = self.metrics.map(listen).transpose()?;
        if let Some(address) = self.metrics.filter(|address| !address.ip().is_loopback()) {
            say("note", &format_args!("anybody who reaches {address} can read the metrics: there is no password"));
        }
        Ok(Watch { listener, ..Watch::without_metrics(server) })
    }
}

impl Watch {
    /// The monitoring of a server without metrics: it only reports to the service manager.
    pub fn without_metrics(server: &'static str) -> Self {
        Self {
            server,
            manager: Manager::find(),
            listener: None,
            boards: Vec::new(),
            chip: None,
            clients: None,
            running: None,
            end_report: None,
        }
    }

    /// Monitors the board of a link. The server must open it with [`BoardWatch::open`].
    pub fn board(&mut self, uri: &LinkUri) -> Arc<BoardWatch> {
        self.board_carrying(uri, None)
    }

    /// As [`Self::board`]; recordings of the link will contain the machine file `machine`.
    pub fn board_carrying(&mut self, uri: &LinkUri, machine: Option<Arc<CarriedFile>>) -> Arc<BoardWatch> {
        let wanted = match (&self.listener, self.manager.watchdog()) {
            (Some(_), _) => Wanted::Metrics,
            (None, Some(_)) => Wanted::Life,
            (None, None) => Wanted::Nothing,
        };
        let board = BoardWatch::new(uri, machine, wanted);
        self.boards.push(Arc::clone(&board));
        board
    }

    /// Monitors the chip of the server. The server must open it with [`ChipWatch::open`].
    pub fn chip(&mut self) -> Arc<ChipWatch> {
        Arc::clone(self.chip.get_or_insert_default())
    }

    /// Sets the function that returns the number of connected clients, for the metrics.
    pub fn count_clients(&mut self, count: impl Fn() -> usize + Send + Sync + 'static) {
        self.clients = Some(Box::new(count));
    }

    /// Must be called when the server is ready: prints `text`, reports it to the service manager, and starts to answer
    /// requests for metrics. If nobody reads standard output, the call waits at most [`ecmsk::notes::FLUSH_LIMIT`]; the
    /// text then stays in the queue of the stream.
    ///
    /// # Errors
    /// Standard output cannot be written to, or the system cannot start a thread.
    pub fn ready(&mut self, mut text: String) -> Result<(), CliError> {
        let status = text.clone();
        if self.listener.is_some() || self.manager.watchdog().is_some() {
            let running = self.run(&status).map_err(WatchError::Thread)?;
            if let Some(site) = &running.site {
                text.push_str(&format!("metrics at http://{}/metrics\n", site.address()));
            }
            self.running = Some(running);
        }
        output::tell(text)?;
        self.manager.ready(&status);
        if !streams::flush_output(ecmsk::notes::FLUSH_LIMIT)? {
            say("note", &"standard output takes nothing, what is served stands there when it is read");
        }
        Ok(())
    }

    fn run(&mut self, status: &str) -> io::Result<Running> {
        let address = self.listener.as_ref().map(TcpListener::local_addr).transpose()?;
        let shared = Arc::new(Shared {
            server: self.server,
            is_loopback: address.is_none_or(|address| address.ip().is_loopback()),
            boards: self.boards.clone(),
            chip: self.chip.clone(),
            clients: self.clients.take(),
            looking: Mutex::default(),
            recorded: Mutex::new(vec![BTreeMap::new(); self.boards.len()]),
            text: Mutex::default(),
            is_over: AtomicBool::new(false),
        });
        // Each board is checked once before the first request.
        shared.boards.iter().for_each(|board| drop(board.look()));
        let (looking, manager, status) = (Arc::clone(&shared), self.manager.clone(), status.to_owned());
        let thread = spawn("watch", move || look(&looking, &manager, &status))?;
        if shared.boards.iter().any(|board| !board.recordings.is_empty()) && address.is_some() {
            let sizing = Arc::clone(&shared);
            // The sizes are read in a separate thread, so that a hanging disk blocks nothing else.
            spawn("sizes", move || size(&sizing))?;
        }
        let answering = Arc::clone(&shared);
        let stop = Arc::default();
        let start = |listener| {
            let serve = move |stream, request| site::serve(stream, &request, &answering);
            HttpServer::start(listener, "metrics", CONNECTIONS_MAX, None, stop, serve)
        };
        let site = self.listener.take().map(start).transpose()?;
        Ok(Running { shared, site, thread })
    }

    /// Reports to the service manager that a signal has ended the server. It does not wait until the report is sent.
    pub fn stopping(&mut self) {
        self.end_report = Some(self.manager.stopping());
    }

    /// Ends the monitoring. It does not wait for the threads, because they may be blocked by a network or a disk. It
    /// waits only briefly until the report of the server's end is sent.
    pub fn end(self) {
        if let Some(report) = self.end_report {
            report.wait();
        }
        let Some(Running { shared, site, thread }) = self.running else { return };
        shared.is_over.store(true, Ordering::Relaxed);
        thread.thread().unpark();
        if let Some(site) = site {
            site.stop();
        }
    }
}

fn spawn(name: &str, run: impl FnOnce() + Send + 'static) -> io::Result<JoinHandle<()>> {
    thread::Builder::new().name(name.to_owned()).spawn(run)
}

/// Runs in a thread of its own: checks the boards, and sends pings to the service manager while they are alive. If the
/// cycle of a board has stopped, or no reports arrive, no ping is sent, so that the watchdog of systemd acts.
fn look(shared: &Shared, manager: &Manager, status: &str) {
    let watchdog = manager.watchdog();
    let interval = watchdog.map_or(LOOK_INTERVAL, |limit| LOOK_INTERVAL.min(limit / (2 * PINGS)));
    let mut pinged: Option<Instant> = None;
    let mut told: Option<String> = None;
    while !shared.is_over.load(Ordering::Relaxed) {
        let now = Instant::now();
        *lock(&shared.looking) = Some(now);
        let looks: Vec<_> = shared.boards.iter().map(|board| board.look()).collect();
        *lock(&shared.looking) = None;
        if let Some(limit) = watchdog {
            let lives = looks.iter().all(|look| look.stands < limit / 2);
            if lives && pinged.is_none_or(|pinged| pinged.elapsed() >= limit / PINGS) {
                manager.ping();
                pinged = Some(Instant::now());
            }
        }
        let trouble = looks.into_iter().find_map(|look| look.trouble);
        if trouble != told {
            manager.status(trouble.as_deref().unwrap_or(status));
            told = trouble;
        }
        thread::park_timeout(interval.saturating_sub(now.elapsed()));
    }
}

/// Runs in a thread of its own: reads the sizes of the recordings.
fn size(shared: &Shared) {
    while !shared.is_over.load(Ordering::Relaxed) {
        for (place, board) in shared.boards.iter().enumerate() {
            let of = |(word, path): &(&'static str, PathBuf)| Some((*word, metrics::bytes_of(path)?));
            let sizes = board.recordings.iter().filter_map(of).collect();
            lock(&shared.recorded)[place] = sizes;
        }
        thread::park_timeout(SIZE_INTERVAL);
    }
}

impl Shared {
    /// The text of the metrics, for a scrape.
    fn metrics(&self) -> Arc<str> {
        let mut text = lock(&self.text);
        if let Some((at, text)) = &*text
            && at.elapsed() < TEXT_AGE_MAX
        {
            return Arc::clone(text);
        }
        let recorded = lock(&self.recorded).clone();
        let seen = |(place, board): (usize, &Arc<BoardWatch>)| Seen {
            number: place + 1,
            scheme: board.scheme,
            look: board.looked(),
            shown: board.shown(),
            counts: board.counts(),
            recorded: recorded.get(place).cloned().unwrap_or_default(),
        };
        let scrape = Scrape {
            server: self.server,
            clients: self.clients.as_ref().map(|count| count()),
            boards: self.boards.iter().enumerate().map(seen).collect(),
            chip: self.chip.as_ref().map(|chip| (chip.counts(), chip.trouble().is_none())),
        };
        let new: Arc<str> = scrape.text().into();
        *text = Some((Instant::now(), Arc::clone(&new)));
        new
    }

    /// The text of `/healthz` while the server is healthy. It reports frames that are missing in a recording, for
    /// example because the disk is full. The server still counts as healthy, because a restart for this reason would
    /// stop axes. \[OURS]
    fn health(&self) -> String {
        let of_board = |(place, board): (usize, &Arc<BoardWatch>)| {
            let missing = board.looked().stats.filter(|_| !board.recordings.is_empty())?.record_dropped;
            let of = if self.boards.len() > 1 { format!("board {}: ", place + 1) } else { String::new() };
            let words: Vec<&str> = board.recordings.iter().map(|(word, _)| *word).collect();
            let what = if words == ["flight"] { "flight recorder" } else { "recording" };
            let why =
                format!("{of}{missing} frames are missing in its {what}: look at the room on the disk, and at the log");
            (missing > 0).then_some(why)
        };
        let missing: Vec<String> = self.boards.iter().enumerate().filter_map(of_board).collect();
        if missing.is_empty() { "ok\n".to_owned() } else { format!("ok, but {}\n", missing.join("\n")) }
    }

    /// Why the server is not healthy, in words; `None` if each board answers and no slave is lost.
    fn trouble(&self) -> Option<String> {
        let hangs = lock(&self.looking).map(|since| since.elapsed()).filter(|elapsed| *elapsed > LOOK_MAX);
        if let Some(hangs) = hangs {
            return Some(format!(
                "the board does not give its counters for {:.1} s: its link hangs",
                hangs.as_secs_f64()
            ));
        }
        let of_board = |(place, board): (usize, &Arc<BoardWatch>)| {
            let trouble = board.looked().trouble?;
            Some(if self.boards.len() > 1 { format!("board {}: {trouble}", place + 1) } else { trouble })
        };
        let of_chip = self.chip.as_ref().and_then(|chip| chip.trouble());
        let troubles: Vec<String> = self.boards.iter().enumerate().filter_map(of_board).chain(of_chip).collect();
        (!troubles.is_empty()).then(|| troubles.join("\n"))
    }
}
