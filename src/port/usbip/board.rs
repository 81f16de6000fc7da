//! A board of the server: its link, which is opened again when it was lost, and the host that has attached it.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::{Condvar, Mutex};

use super::descriptors::{CONFIGURATION_VALUE, Descriptors, INTERFACE_CLASS, Identity, IdentityError};
use super::device::Counters;
use super::session::{Session, SessionEnd};
use super::stream::Stream;
use super::wire::{DeviceEntry, Refusal, device_id};
use crate::link::{Link, LinkError};
use crate::notes::Notes;

/// The number of the server's only virtual USB bus.
const BUS: u16 = 1;

/// How often the server checks that a board is still connected. \[OURS]
const CHECK_INTERVAL: Duration = Duration::from_millis(100);

/// Opens the board's link, at first and after every loss.
pub type Opener = Box<dyn Fn() -> Result<Arc<dyn Link>, LinkError> + Send + Sync>;

/// An event of the server, for its log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// A host has attached a board.
    Attached {
        /// The board's bus id, such as `1-1`.
        bus_id: String,
        /// The host that has attached it.
        host: String,
    },
    /// A host no longer has its board.
    Ended {
        /// The board's bus id, such as `1-1`.
        bus_id: String,
        /// Why the host no longer has the board.
        why: SessionEnd,
        /// The counters of this host's transfers, since it attached the board.
        counters: Counters,
    },
    /// A board is lost. The server tries to open it again.
    Lost {
        /// The board's bus id, such as `1-1`.
        bus_id: String,
        /// The error that has shown the loss.
        why: String,
    },
    /// A lost board is open again.
    Reopened {
        /// The board's bus id, such as `1-1`.
        bus_id: String,
    },
    /// A client was rejected before it had attached a board.
    ClientRejected {
        /// The address of the client.
        host: String,
        /// Why the client was rejected.
        why: String,
    },
    /// A board could not be attached to this machine.
    NotAttached {
        /// The board's bus id, such as `1-1`.
        bus_id: String,
        /// Why the board could not be attached.
        why: String,
    },
    /// A lost board still cannot be opened. Each reason is reported once.
    ReopenFailed {
        /// The board's bus id, such as `1-1`.
        bus_id: String,
        /// Why the board cannot be opened.
        why: String,
    },
    /// The operating system did not provide a connection or a thread.
    SystemError {
        /// The failed operation, with the error.
        what: String,
    },
    /// Events before this one were dropped because the listener was too slow.
    Dropped {
        /// The number of dropped events.
        count: u64,
    },
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Attached { bus_id, host } => write!(f, "{bus_id}: attached by {host}"),
            Self::Ended { bus_id, why, counters } => {
                write!(f, "{bus_id}: {why}; {} frames out, {} reports in", counters.frames, counters.reports)?;
                if counters.short_packets > 0 {
                    write!(f, "; it hung after an OUT packet of fewer than 512 bytes, as the board does")?;
                }
                Ok(())
            }
            Self::Lost { bus_id, why } => write!(f, "{bus_id}: lost, {why}; waiting for its return"),
            Self::Reopened { bus_id } => write!(f, "{bus_id}: back, to be attached again"),
            Self::ClientRejected { host, why } => write!(f, "{host} sent away: {why}"),
            Self::NotAttached { bus_id, why } => write!(f, "{bus_id}: not attached here: {why}"),
            Self::ReopenFailed { bus_id, why } => write!(f, "{bus_id}: cannot be opened yet: {why}"),
            Self::SystemError { what } => f.write_str(what),
            Self::Dropped { count } => {
                write!(f, "{count} lines were dropped, those before were not taken in time")
            }
        }
    }
}

/// Called with each event, in a thread of its own.
pub type Listener = Arc<dyn Fn(&Event) + Send + Sync>;

/// The bus id of board `index`, counted from 0.
pub(super) fn bus_id(index: u16) -> String {
    format!("{BUS}-{}", index + 1)
}

/// A board that the server shares.
pub(super) struct Board {
    bus_id: String,
    path: String,
    number: u16,
    identity: Identity,
    descriptors: Descriptors,
    opener: Opener,
    send_timeout: Duration,
    notes: Notes<Event>,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    link: Option<Arc<dyn Link>>,
    session: Option<Arc<Session>>,
    stopping: bool,
}

impl Board {
    /// A board whose link is open. Its bus id is made from `index`, counted from 0. Fails if the identity does not fit
    /// into USB descriptors.
    pub fn new(
        index: u16,
        identity: Identity,
        link: Arc<dyn Link>,
        opener: Opener,
        send_timeout: Duration,
        notes: Notes<Event>,
    ) -> Result<Self, IdentityError> {
        let (number, bus_id) = (index + 1, bus_id(index));
        let path = format!("/sys/devices/pci0000:00/0000:00:01.0/usb{BUS}/{bus_id}");
        let descriptors = Descriptors::new(&identity)?;
        let state = Mutex::new(State { link: Some(link), ..State::default() });
        Ok(Self {
            bus_id,
            path,
            number,
            identity,
            descriptors,
            opener,
            send_timeout,
            notes,
            state,
            changed: Condvar::new(),
        })
    }

    pub fn bus_id(&self) -> &str {
        &self.bus_id
    }

    /// The number of this board in USB/IP commands: the bus in the upper 16 bits, the device on the bus in the lower 16
    /// bits.
    pub fn device_id(&self) -> u32 {
        device_id(BUS, self.number)
    }

    /// The entry of the board in the USB/IP list of devices.
    pub fn entry(&self) -> DeviceEntry<'_> {
        DeviceEntry {
            path: &self.path,
            bus_id: &self.bus_id,
            bus: BUS,
            number: self.number,
            vendor: self.identity.vendor,
            product: self.identity.product,
            release: self.identity.release,
            configuration: CONFIGURATION_VALUE,
            interface: INTERFACE_CLASS,
        }
    }

    /// Whether the board's link is open, whether or not a host has attached the board.
    pub fn is_there(&self) -> bool {
        self.state.lock().link.is_some()
    }

    /// Attaches the board to a host, if the board's link is open and no other host has attached the board. Otherwise
    /// returns the stream again, with the reason.
    pub fn take(&self, stream: Stream) -> Result<Arc<Session>, (Stream, Refusal)> {
        let mut state = self.state.lock();
        if state.stopping {
            return Err((stream, Refusal::Away));
        }
        // A lost board is refused as not connected, even while its previous host is still being disconnected.
        let Some(link) = state.link.clone() else { return Err((stream, Refusal::Away)) };
        if state.session.is_some() {
            return Err((stream, Refusal::Busy));
        }
        let descriptors = self.descriptors.clone();
        let session = Arc::new(Session::new(stream, link, descriptors, self.device_id(), self.send_timeout));
        state.session = Some(session.clone());
        Ok(session)
    }

    /// Serves a host. Blocks until the session has ended; afterwards another host can attach the board.
    pub fn serve(&self, session: &Session, host: &str) {
        self.tell(Event::Attached { bus_id: self.bus_id.clone(), host: host.to_owned() });
        let why = session.run();
        let lost = matches!(why, SessionEnd::LinkLost(_));
        let link = if lost { self.state.lock().link.take() } else { None };
        // [`Self::keep`] opens the link again as soon as there is no session. A board cannot be opened twice, so the
        // link is closed before the session is removed.
        if let Some(link) = &link {
            link.close();
        }
        self.state.lock().session = None;
        self.changed.notify_all();
        self.tell(Event::Ended { bus_id: self.bus_id.clone(), why: why.clone(), counters: session.counters() });
        if link.is_some() {
            self.tell(Event::Lost { bus_id: self.bus_id.clone(), why: why.to_string() });
        }
    }

    /// Watches the link until [`Self::stop`]. After a loss, tries to open the link every `retry`; after each success,
    /// calls `back`.
    pub fn keep(&self, retry: Duration, back: &mut dyn FnMut()) {
        let mut told = String::new();
        loop {
            let mut state = self.state.lock();
            if state.stopping {
                return;
            }
            if let Some(link) = state.link.clone() {
                // The lock is released, since a call of the link may take long.
                drop(state);
                if let Err(why) = link.check() {
                    self.lose(&link, why);
                    continue;
                }
                state = self.state.lock();
                if !state.stopping && state.link.is_some() {
                    self.changed.wait_for(&mut state, CHECK_INTERVAL);
                }
            } else {
                self.changed.wait_for(&mut state, retry);
            }
            // A lost link is opened again only when its session has ended, since the session closes the old link.
            let wanted = state.link.is_none() && state.session.is_none() && !state.stopping;
            drop(state);
            if wanted && self.open_again(&mut told) {
                back();
            }
        }
    }

    fn lose(&self, link: &Arc<dyn Link>, why: LinkError) {
        let session = {
            let mut state = self.state.lock();
            if !state.link.as_ref().is_some_and(|here| Arc::ptr_eq(here, link)) {
                return;
            }
            state.link = None;
            state.session.clone()
        };
        if let Some(session) = session {
            session.end(SessionEnd::LinkLost(why.clone()));
        }
        link.close();
        self.tell(Event::Lost { bus_id: self.bus_id.clone(), why: why.to_string() });
    }

    /// Tries to open the link; `told` is the reason for a failure that was reported last: the same reason is not
    /// reported again. Returns whether the link is open now.
    fn open_again(&self, told: &mut String) -> bool {
        match (self.opener)() {
            Ok(link) => {
                let stopping = {
                    let mut state = self.state.lock();
                    if !state.stopping {
                        state.link = Some(Arc::clone(&link));
                    }
                    state.stopping
                };
                if stopping {
                    link.close();
                    return false;
                }
                told.clear();
                self.tell(Event::Reopened { bus_id: self.bus_id.clone() });
                true
            }
            Err(error) => {
                let why = error.to_string();
                if why != *told {
                    told.clone_from(&why);
                    self.tell(Event::ReopenFailed { bus_id: self.bus_id.clone(), why });
                }
                false
            }
        }
    }

    /// Ends the session of the host, if there is one, and closes the link.
    pub fn stop(&self) {
        let (link, session) = {
            let mut state = self.state.lock();
            state.stopping = true;
            self.changed.notify_all();
            (state.link.take(), state.session.clone())
        };
        if let Some(session) = session {
            session.end(SessionEnd::Stopped);
        }
        if let Some(link) = link {
            link.close();
        }
    }

    pub fn tell(&self, event: Event) {
        self.notes.push(event);
    }
}
