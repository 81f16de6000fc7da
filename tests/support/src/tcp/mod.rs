//! Code that the tests of a board on the network share: servers, links to them, clients that speak bytes, and a board
//! whose writes and reports the test controls.

pub mod proxy;

use std::collections::VecDeque;
use std::io::{Read as _, Write as _};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use ecmsk::link::{self, Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Share, Stamp, Wait};
use ecmsk::port::tcp::{ServeOptions, Server};
use ecmsk::sk::{Frame, SlotSize};

pub const SIZE: SlotSize = SlotSize::Bytes12;
/// The longest wait for something that has to come.
pub const LIMIT: Duration = Duration::from_secs(60);

/// The messages of a server, line by line.
#[derive(Clone, Default)]
pub struct Told(Arc<Mutex<Vec<String>>>);

impl Told {
    pub fn lines(&self) -> Vec<String> {
        self.0.lock().unwrap().clone()
    }

    /// Waits for a line that contains `part`.
    pub fn wait(&self, part: &str) -> String {
        let what = || format!("line with `{part}`: {:?}", self.lines());
        until_told(what, || self.lines().into_iter().find(|line| line.contains(part)))
    }
}

/// Waits until `look` returns a value.
pub fn until<T>(what: &str, look: impl FnMut() -> Option<T>) -> T {
    until_told(|| what.to_owned(), look)
}

/// The same; `what` is called only if the value does not come.
fn until_told<T>(what: impl Fn() -> String, mut look: impl FnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        if let Some(done) = look() {
            return done;
        }
        assert!(began.elapsed() < LIMIT, "no {}", what());
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// The time that a message names behind these words, as `1.23s` or `500ms`.
///
/// # Panics
/// If there is none.
pub fn time_behind(message: &str, words: &str) -> Duration {
    let (_, rest) = message.split_once(words).expect(words);
    let rest = rest.trim_start();
    let digits = rest.find(|c: char| !c.is_ascii_digit() && c != '.').expect("a unit");
    let unit = if rest[digits..].starts_with("ms") { 0.001 } else { 1.0 };
    Duration::from_secs_f64(rest[..digits].parse::<f64>().expect("a number") * unit)
}

/// Options of a server on any free port, and its messages.
pub fn options() -> (ServeOptions, Told) {
    let told = Told::default();
    let lines = told.clone();
    let tell = Arc::new(move |line: &str| lines.0.lock().unwrap().push(line.to_owned()));
    (ServeOptions { listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 0)), tell, ..ServeOptions::default() }, told)
}

/// The URI with a name that no other board of this process has.
pub fn own(uri: &str) -> String {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    format!("{uri}&name=board-{}", NEXT.fetch_add(1, Ordering::Relaxed))
}

/// Serves a new board with this URI.
pub fn serve(uri: &str) -> (Server, Told) {
    let (options, told) = options();
    (serve_with(uri, options), told)
}

pub fn serve_with(uri: &str, options: ServeOptions) -> Server {
    let uri = own(uri);
    Server::start(move || link::open(&uri, Share::ByUri), options).unwrap()
}

/// Serves a link that is open.
pub fn serve_link(link: Arc<dyn Link>, options: ServeOptions) -> Server {
    Server::start(move || Ok(Arc::clone(&link)), options).unwrap()
}

pub fn uri(server: &Server, keys: &str) -> String {
    format!("tcp://{}?{keys}", server.address())
}

pub fn connect(server: &Server, keys: &str) -> Arc<dyn Link> {
    link::open(&uri(server, keys), Share::ByName).unwrap()
}

/// The writer's link, once the previous writer is gone.
pub fn connect_next(server: &Server, keys: &str) -> Arc<dyn Link> {
    until("place for a writer", || match link::open(&uri(server, keys), Share::ByName) {
        Err(LinkError::InUse { .. }) => None,
        other => Some(other.unwrap()),
    })
}

pub fn refused(server: &Server, keys: &str) -> LinkError {
    link::open(&uri(server, keys), Share::ByName).err().expect("the server refuses")
}

/// A board that a test plays: the test decides whether it takes frames, and which reports it makes.
pub struct Puppet {
    state: Mutex<Played>,
    changed: Condvar,
    info: LinkInfo,
}

#[derive(Default)]
struct Played {
    taken: Vec<Frame>,
    takes_none: bool,
    reports: VecDeque<Frame>,
    made: u64,
    lost: Option<&'static str>,
    cancels: u64,
    closed: bool,
    dropped: u64,
}

impl Puppet {
    pub fn new() -> Arc<Self> {
        let info = LinkInfo {
            name: "puppet:".to_owned(),
            slot: Some(SIZE),
            virtual_time: false,
            opened_at: Stamp(5),
            read_wait: Wait::Forever,
            write_wait: Wait::Forever,
        };
        Arc::new(Self { state: Mutex::default(), changed: Condvar::new(), info })
    }

    /// Whether writes wait.
    pub fn take_none(&self, takes_none: bool) {
        self.state.lock().unwrap().takes_none = takes_none;
        self.changed.notify_all();
    }

    pub fn report(&self, frame: &Frame) {
        self.state.lock().unwrap().reports.push_back(frame.clone());
        self.changed.notify_all();
    }

    /// The frames that it took.
    pub fn taken(&self) -> Vec<Frame> {
        self.state.lock().unwrap().taken.clone()
    }

    pub fn lose(&self, reason: &'static str) {
        self.state.lock().unwrap().lost = Some(reason);
        self.changed.notify_all();
    }

    /// The link behind it drops that many reports in addition to the 3 before.
    pub fn drop_reports(&self, count: u64) {
        self.state.lock().unwrap().dropped += count;
    }

    pub fn is_closed(&self) -> bool {
        self.state.lock().unwrap().closed
    }

    fn wait<T>(&self, dir: Dir, wait: Wait, mut look: impl FnMut(&mut Played) -> Option<T>) -> Result<T, LinkError> {
        let waited = match wait {
            Wait::Forever => LIMIT,
            Wait::For(limit) => limit,
            Wait::Now => Duration::ZERO,
        };
        let end = Instant::now() + waited;
        let mut state = self.state.lock().unwrap();
        let cancels = state.cancels;
        loop {
            if let Some(reason) = state.lost {
                return Err(LinkError::Lost { name: self.info.name.clone(), reason: reason.into() });
            }
            if dir == Dir::Read && state.cancels != cancels {
                return Err(LinkError::Cancelled { dir });
            }
            if let Some(done) = look(&mut state) {
                return Ok(done);
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(LinkError::Timeout { dir, waited, what: "the puppet does nothing" });
            }
            state = self.changed.wait_timeout(state, left).unwrap().0;
        }
    }
}

impl Link for Puppet {
    fn info(&self) -> LinkInfo {
        self.info.clone()
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        self.wait(Dir::Write, wait, |state| {
            if state.takes_none {
                return None;
            }
            state.taken.push(frame.clone());
            Some(Stamp(state.taken.len() as u64))
        })
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        self.wait(Dir::Read, wait, |state| {
            out.clone_from(&state.reports.pop_front()?);
            state.made += 1;
            Some(ReadMeta { at: Stamp(state.made * 1000), sequence: state.made - 1, dropped: 0 })
        })
    }

    fn cancel(&self, dir: Dir) {
        if dir == Dir::Read {
            self.state.lock().unwrap().cancels += 1;
            self.changed.notify_all();
        }
    }

    fn close(&self) {
        self.state.lock().unwrap().closed = true;
    }

    fn check(&self) -> Result<(), LinkError> {
        Ok(())
    }

    fn stats(&self) -> LinkStats {
        let dropped = self.state.lock().unwrap().dropped;
        LinkStats { reports_dropped: 3 + dropped, ..LinkStats::default() }
    }
}

/// A frame of that byte.
pub fn frame(byte: u8) -> Frame {
    Frame::from_bytes([byte; 512])
}

/// A client that speaks bytes.
pub struct Raw(pub TcpStream);

/// A server's greeting: nine bytes with its name and version, whether TLS follows, whether there is room.
pub const GREETING: &[u8; 16] = b"ecmsktcp\x04\x00\x00\x01\x00\x00\x00\x00";

impl Raw {
    /// Connects, and takes the greeting.
    pub fn connect(server: &Server) -> Self {
        let mut raw = Self::dial(server);
        assert_eq!(&raw.take::<16>().expect("a greeting"), GREETING);
        raw
    }

    pub fn dial(server: &Server) -> Self {
        Self::dial_to(server.address())
    }

    pub fn dial_to(server: SocketAddr) -> Self {
        let socket = TcpStream::connect(server).unwrap();
        socket.set_read_timeout(Some(LIMIT)).unwrap();
        Self(socket)
    }

    pub fn send(&mut self, bytes: &[u8]) {
        self.0.write_all(bytes).unwrap();
    }

    pub fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let mut bytes = [0; N];
        self.0.read_exact(&mut bytes).ok().map(|()| bytes)
    }

    /// The next message: its kind and payload; `None` once the server has ended.
    pub fn message(&mut self) -> Option<(u8, Vec<u8>)> {
        let [low, high, kind, _] = self.take::<4>()?;
        let mut payload = vec![0; u16::from_le_bytes([low, high]).into()];
        self.0.read_exact(&mut payload).ok()?;
        Some((kind, payload))
    }

    /// The next message that is no report and no ping.
    pub fn answer(&mut self) -> Option<(u8, Vec<u8>)> {
        loop {
            match self.message()? {
                (0x83 | 0x40, _) => {}
                other => return Some(other),
            }
        }
    }

    /// A client that is the writer, once the previous one is gone.
    pub fn writer(server: &Server) -> Self {
        until("place for a writer", || {
            let mut raw = Self::connect(server);
            (raw.hello(false, 500)?.0 == 0x81).then_some(raw)
        })
    }

    /// ClientMessage hello as a writer or a reader.
    pub fn hello(&mut self, is_reader: bool, keepalive_ms: u32) -> Option<(u8, Vec<u8>)> {
        self.send(&hello(is_reader, keepalive_ms));
        self.answer()
    }
}

/// Header and payload of a message.
pub fn message(kind: u8, payload: &[u8]) -> Vec<u8> {
    let mut bytes = (payload.len() as u16).to_le_bytes().to_vec();
    bytes.extend([kind, 0]);
    bytes.extend(payload);
    bytes
}

pub fn hello(is_reader: bool, keepalive_ms: u32) -> Vec<u8> {
    let mut payload = vec![u8::from(is_reader)];
    payload.extend(keepalive_ms.to_le_bytes());
    payload.extend(4711_u32.to_le_bytes());
    payload.extend([0; 32]);
    payload.extend(3_u16.to_le_bytes());
    payload.extend(b"raw");
    message(0x01, &payload)
}

/// A write of that number and limit.
pub fn write(request: u64, limit_ns: u64, frame: &Frame) -> Vec<u8> {
    let mut payload = request.to_le_bytes().to_vec();
    payload.extend(limit_ns.to_le_bytes());
    payload.extend(frame.bytes());
    message(0x02, &payload)
}
