//! What all servers have in common for those who watch them from afar: metrics and health over HTTP, the format of the log,
//! and reports to the service manager.
//!
//! - `watch.rs`: the options, and the thread that looks at the boards
//! - `board.rs`: a link around the link of a board, and whether the board lives; `chip.rs`: the same for an ECM-XF
//! - `frames.rs`: what the frames of a board show
//! - `trouble.rs`: why a board is not as it has to be
//! - `metrics.rs`: the metrics as text
//! - `site.rs`: what a request gets
//!
//! A scrape reads what the thread of the watch and the threads of the server have left; it never uses the board.

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

/// How often the boards are looked at. \[OURS]
const LOOK_INTERVAL: Duration = Duration::from_millis(250);
/// How often the sizes of recordings are read from their disk. \[OURS]
const SIZE_INTERVAL: Duration = Duration::from_secs(5);
/// A look that takes longer than this shows that the board's counters hang. \[OURS]
const LOOK_MAX: Duration = Duration::from_secs(5);
/// A scrape gets the text of the one before it, if that is not older: many scrapes cost no more than a few. \[OURS]
const TEXT_AGE_MAX: Duration = Duration::from_millis(200);
/// The most connections for metrics at a time; each has a thread. \[OURS]
const CONNECTIONS_MAX: usize = 16;
/// The service manager gets a ping this many times in the time that it allows. \[OURS]
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

// No doc comment on `LogArgs`, as above.
#[derive(Clone, Copy, clap::Args)]
pub struct LogArgs {
    /// Lines of the log: text with the time (without it in systemd's journal, which has its own), or JSON objects
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t = LogFormat::Text)]
    log_format: LogFormat,
}

/// Why a server cannot be watched.
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
    /// The system gives no thread.
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
    /// From now on the lines on standard error have the format of the option.
    pub fn begin(self) {
        stderr::log_in(self.log_format);
    }
}

/// A server that is watched.
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

/// The threads of a watch.
struct Running {
    shared: Arc<Shared>,
    site: Option<HttpServer>,
    thread: JoinHandle<()>,
}

/// What the threads of a watch share.
struct Shared {
    server: &'static str,
    is_loopback: bool,
    boards: Vec<Arc<BoardWatch>>,
    chip: Option<Arc<ChipWatch>>,
    clients: Option<Box<dyn Fn() -> usize + Send + Sync>>,
    /// When the newest look began and has not ended.
    looking: Mutex<Option<Instant>>,
    /// The bytes of the recordings of each board.
    recorded: Mutex<Vec<BTreeMap<&'static str, u64>>>,
    /// The newest text of the metrics, and when it was made.
    text: Mutex<Option<(Instant, Arc<str>)>>,
    is_over: AtomicBool,
}

impl WatchArgs {
    /// Sets the format of the log, and listens at the address of the metrics, so that one that is taken ends the server
    /// before it has a board. `server`: the name of the verb.
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
    /// The watch of a server without metrics: it reports to the service manager.
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

    /// Watches the board of a link, which the server opens by [`BoardWatch::open`].
    pub fn board(&mut self, uri: &LinkUri) -> Arc<BoardWatch> {
        self.board_carrying(uri, None)
    }

    /// As [`Self::board`], with the machine file that recordings of the link carry.
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

    /// Watches the chip that the server opens by [`ChipWatch::open`].
    pub fn chip(&mut self) -> Arc<ChipWatch> {
        Arc::clone(self.chip.get_or_insert_default())
    }

    /// Shows how many clients the server has.
    pub fn count_clients(&mut self, count: impl Fn() -> usize + Send + Sync + 'static) {
        self.clients = Some(Box::new(count));
    }

    /// The server serves: prints `text`, reports it to the service manager, and begins to answer for the metrics. If nobody
    /// reads standard output, the server waits at most [`ecmsk::notes::FLUSH_LIMIT`]; the text stays in the queue of the
    /// stream.
    ///
    /// # Errors
    /// Standard output cannot be written to, or the system gives no thread.
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
        // The first looks come before the first request.
        shared.boards.iter().for_each(|board| drop(board.look()));
        let (looking, manager, status) = (Arc::clone(&shared), self.manager.clone(), status.to_owned());
        let thread = spawn("watch", move || look(&looking, &manager, &status))?;
        if shared.boards.iter().any(|board| !board.recordings.is_empty()) && address.is_some() {
            let sizing = Arc::clone(&shared);
            // A disk that hangs holds up this thread alone.
            spawn("sizes", move || size(&sizing))?;
        }
        let answering = Arc::clone(&shared);
        let stop = Arc::default();
        let start = |listener| {
            let serve = move |stream, request| site::serve(stream, &request, &answering);
            HttpServer::start(listener, "metrics", CONNECTIONS_MAX, stop, serve)
        };
        let site = self.listener.take().map(start).transpose()?;
        Ok(Running { shared, site, thread })
    }

    /// A signal has ended the server: reports that to the service manager, and does not wait.
    pub fn stopping(&mut self) {
        self.end_report = Some(self.manager.stopping());
    }

    /// Ends the watch. Its threads are not waited for: one of them may wait for a network or a disk. The report that the server
    /// ends is waited for, briefly.
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

/// The thread that looks at the boards, and tells the service manager that they live. A board whose cycle stands still, or
/// whose reports stay away, gets no ping: that is the life that matters.
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

/// The thread that looks how large the recordings are.
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
    /// The text of the metrics.
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

    /// The text of `/healthz` while the server is healthy. That frames are missing in a recording, because its disk is full, is
    /// said there and makes the server no unhealthy one: whoever starts such servers again would stop axes for it. \[OURS]
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

    /// Why the server is not healthy, in words; `None`: each board answers, and no slave is lost.
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
