//! A link whose board is controlled by the test, and a server on it.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use ecmsk::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use ecmsk::port::usbip::{BoardSpec, Event, Identity, Options, Server};
use ecmsk::sk::Frame;

/// Longer than any call takes here.
const PATIENCE: Duration = Duration::from_secs(20);

#[derive(Default)]
struct State {
    reports: VecDeque<Frame>,
    written: Vec<Frame>,
    /// The number of the next report, if the board always has one.
    endless: Option<u64>,
    /// Whether the board takes no frame.
    busy: bool,
    /// How many frames the link refuses.
    refuses: usize,
    /// Pending calls of `write`.
    writing: usize,
    lost: bool,
    closed: bool,
    /// Counts calls of `cancel`: a wait that sees it change ends.
    cancelled: [u64; 2],
    opened: u64,
}

/// A board controlled by a test. Clones share the board.
#[derive(Clone, Default)]
pub struct Puppet(Arc<(Mutex<State>, Condvar)>);

impl Puppet {
    fn with<T>(&self, work: impl FnOnce(&mut State) -> T) -> T {
        let done = work(&mut self.0.0.lock().unwrap());
        self.0.1.notify_all();
        done
    }

    /// Waits until `done`.
    #[track_caller]
    fn until(&self, what: &str, mut done: impl FnMut(&State) -> bool) {
        let (lock, changed) = &*self.0;
        let (state, timeout) =
            changed.wait_timeout_while(lock.lock().unwrap(), PATIENCE, |state| !done(state)).unwrap();
        drop(state);
        assert!(!timeout.timed_out(), "{what}");
    }

    /// The board makes a report, all of whose bytes are `fill`; as with queue=1 the newest one stays.
    pub fn make_report(&self, fill: u8) {
        self.with(|state| state.reports = VecDeque::from([Frame::from_bytes([fill; 512])]));
    }

    /// From now on the board always has a report: number n of them is filled with n modulo 256.
    pub fn make_reports_without_end(&self) {
        self.with(|state| state.endless = Some(0));
    }

    pub fn set_busy(&self, busy: bool) {
        self.with(|state| state.busy = busy);
    }

    /// The link refuses that many frames from now on; the board stays.
    pub fn refuse(&self, frames: usize) {
        self.with(|state| state.refuses = frames);
    }

    pub fn lose(&self) {
        self.with(|state| state.lost = true);
    }

    pub fn come_back(&self) {
        self.with(|state| (state.lost, state.closed) = (false, false));
    }

    #[track_caller]
    pub fn until_writing(&self) {
        self.until("a frame is being given", |state| state.writing > 0);
    }

    /// Waits that long for a reader to take the report.
    pub fn let_report_be_taken(&self, limit: Duration) {
        let (lock, changed) = &*self.0;
        let there = |state: &mut State| !state.reports.is_empty();
        drop(changed.wait_timeout_while(lock.lock().unwrap(), limit, there));
    }

    #[track_caller]
    pub fn until_closed(&self) {
        self.until("the link is closed", |state| state.closed);
    }

    /// First bytes of the frames that were written.
    pub fn written(&self) -> Vec<u8> {
        self.with(|state| state.written.iter().map(|frame| frame.bytes()[0]).collect())
    }

    pub fn frames(&self) -> Vec<Frame> {
        self.with(|state| state.written.clone())
    }

    pub fn opened(&self) -> u64 {
        self.with(|state| state.opened)
    }

    /// How the server opens it.
    pub fn open(&self) -> Result<Arc<dyn Link>, LinkError> {
        self.with(|state| {
            if state.lost {
                return Err(LinkError::NoBoard { name: "puppet:".into(), reason: "it is gone; plug it in".into() });
            }
            state.opened += 1;
            state.closed = false;
            Ok(Arc::new(self.clone()) as Arc<dyn Link>)
        })
    }

    fn gone(&self, state: &State) -> Option<LinkError> {
        if state.closed {
            return Some(LinkError::Closed);
        }
        let gone = || LinkError::Io { what: "use the puppet".into(), message: "it was pulled".into() };
        state.lost.then(gone)
    }

    /// Waits for `done` as a link does.
    fn wait<T>(&self, dir: Dir, wait: Wait, mut done: impl FnMut(&mut State) -> Option<T>) -> Result<T, LinkError> {
        let (lock, changed) = &*self.0;
        let mut state = lock.lock().unwrap();
        let which = dir as usize;
        let cancelled = state.cancelled[which];
        let limit = match wait {
            Wait::Now => Duration::ZERO,
            Wait::For(limit) => limit,
            Wait::Forever => PATIENCE,
        };
        let until = Instant::now() + limit;
        loop {
            if let Some(error) = self.gone(&state) {
                return Err(error);
            }
            if let Some(result) = done(&mut state) {
                return Ok(result);
            }
            if state.cancelled[which] != cancelled {
                return Err(LinkError::Cancelled { dir });
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(LinkError::Timeout { dir, waited: limit, what: "the puppet does nothing" });
            }
            state = changed.wait_timeout(state, left).unwrap().0;
        }
    }
}

impl Link for Puppet {
    fn info(&self) -> LinkInfo {
        LinkInfo {
            name: "puppet:".into(),
            slot: None,
            virtual_time: false,
            opened_at: Stamp(0),
            read_wait: Wait::Forever,
            write_wait: Wait::Forever,
        }
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let refuses = self.with(|state| {
            let refuses = state.refuses > 0;
            state.refuses = state.refuses.saturating_sub(1);
            refuses
        });
        if refuses {
            return Err(LinkError::Io { what: "the frame was not sent".into(), message: "correct the program".into() });
        }
        self.with(|state| state.writing += 1);
        let result = self.wait(Dir::Write, wait, |state| (!state.busy).then(|| state.written.push(frame.clone())));
        self.with(|state| state.writing -= 1);
        result.map(|()| Stamp(0))
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let report = self.wait(Dir::Read, wait, |state| match &mut state.endless {
            None => state.reports.pop_front(),
            Some(number) => {
                *number += 1;
                Some(Frame::from_bytes([(*number - 1) as u8; 512]))
            }
        })?;
        self.with(|_| out.clone_from(&report));
        Ok(ReadMeta::default())
    }

    fn cancel(&self, dir: Dir) {
        self.with(|state| state.cancelled[dir as usize] += 1);
    }

    fn close(&self) {
        self.with(|state| state.closed = true);
    }

    fn check(&self) -> Result<(), LinkError> {
        self.with(|state| self.gone(state).map_or(Ok(()), Err))
    }

    fn stats(&self) -> LinkStats {
        LinkStats::default()
    }
}

/// The events of a server.
#[derive(Clone, Default)]
pub struct Heard(Arc<(Mutex<Vec<Event>>, Condvar)>);

impl Heard {
    pub fn listener(&self) -> Arc<dyn Fn(&Event) + Send + Sync> {
        let heard = self.clone();
        Arc::new(move |event| {
            heard.0.0.lock().unwrap().push(event.clone());
            heard.0.1.notify_all();
        })
    }

    /// Waits for the first event of that kind.
    #[track_caller]
    pub fn until(&self, what: &str, is_it: impl Fn(&Event) -> bool) -> Event {
        self.until_times(1, what, is_it)
    }

    /// Waits for that many events of that kind; returns the last of them.
    #[track_caller]
    pub fn until_times(&self, times: usize, what: &str, is_it: impl Fn(&Event) -> bool) -> Event {
        let (lock, changed) = &*self.0;
        let few = |events: &mut Vec<Event>| events.iter().filter(|event| is_it(event)).count() < times;
        let (events, _) = changed.wait_timeout_while(lock.lock().unwrap(), PATIENCE, few).unwrap();
        let found = events.iter().filter(|event| is_it(event)).nth(times - 1);
        found.unwrap_or_else(|| panic!("{what}: {events:?}")).clone()
    }

    /// Waits until a host's use of the board has ended; returns the reason.
    #[track_caller]
    pub fn end(&self) -> String {
        self.until("the end", |event| matches!(event, Event::Ended { .. })).to_string()
    }
}

/// Options for a test: a free port, and a short `request_timeout` for a lost board.
pub fn options() -> Options {
    Options { listen: SocketAddr::from(([127, 0, 0, 1], 0)), retry: Duration::from_millis(5), ..Options::default() }
}

pub fn spec(puppet: &Puppet) -> BoardSpec {
    let puppet = puppet.clone();
    BoardSpec { identity: Identity::default(), opener: Box::new(move || puppet.open()) }
}

/// A server of one puppet.
pub fn serve(options: Options) -> (Puppet, Server, Heard) {
    let (puppet, heard) = (Puppet::default(), Heard::default());
    let server = Server::start(options, vec![spec(&puppet)], heard.listener()).expect("the server starts");
    (puppet, server, heard)
}
