//! One board of the server: its link, opened again when it was lost, and the host that has it.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::{Condvar, Mutex};

use super::descriptors::{CONFIGURATION_VALUE, Descriptors, INTERFACE_CLASS, Identity, IdentityError};
use super::device::Counters;
use super::session::{End, Session};
use super::stream::Stream;
use super::wire::{Refusal, Shown, device_id};
use crate::link::{Link, LinkError};
use crate::port::notes::Notes;

/// The one bus of the server.
const BUS: u16 = 1;

/// How often is looked whether a board is still there that nobody has attached. \[OURS]
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Opens the board's link, as often as it is lost.
pub type Opener = Box<dyn Fn() -> Result<Arc<dyn Link>, LinkError> + Send + Sync>;

/// What the server tells of its boards.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// A host has attached a board.
    Attached {
        /// The board's bus id.
        bus_id: String,
        /// Which host.
        host: String,
    },
    /// A host's time with a board ended.
    Ended {
        /// The board's bus id.
        bus_id: String,
        /// Why.
        why: End,
        /// What was moved.
        counters: Counters,
    },
    /// A board is gone; it is looked for.
    Lost {
        /// The board's bus id.
        bus_id: String,
        /// How that showed.
        why: String,
    },
    /// A lost board is back.
    Back {
        /// The board's bus id.
        bus_id: String,
    },
    /// A client was sent away before it had a board.
    SentAway {
        /// Which.
        host: String,
        /// Why.
        why: String,
    },
    /// A board could not be attached to this machine.
    NotAttached {
        /// The board's bus id.
        bus_id: String,
        /// Why.
        why: String,
    },
    /// A lost board cannot be opened again yet; each reason once.
    StillAway {
        /// The board's bus id.
        bus_id: String,
        /// Why.
        why: String,
    },
    /// The system gives no connection or nothing to look after one.
    Trouble {
        /// What does not work.
        what: String,
    },
    /// The listener did not take events in time: so many before this one are missing.
    Dropped {
        /// How many.
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
            Self::Back { bus_id } => write!(f, "{bus_id}: back, to be attached again"),
            Self::SentAway { host, why } => write!(f, "{host} sent away: {why}"),
            Self::NotAttached { bus_id, why } => write!(f, "{bus_id}: not attached here: {why}"),
            Self::StillAway { bus_id, why } => write!(f, "{bus_id}: cannot be opened yet: {why}"),
            Self::Trouble { what } => f.write_str(what),
            Self::Dropped { count } => {
                write!(f, "{count} lines were dropped, those before were not taken in time")
            }
        }
    }
}

/// Who is told, by a thread of its own.
pub type Listener = Arc<dyn Fn(&Event) + Send + Sync>;

/// What hosts call board `index`, from 0.
pub(super) fn bus_id(index: u16) -> String {
    format!("{BUS}-{}", index + 1)
}

/// A board as the server has it.
pub(super) struct Board {
    bus_id: String,
    path: String,
    number: u16,
    identity: Identity,
    descriptors: Descriptors,
    opener: Opener,
    never_reads: Duration,
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
    /// Number `index`, from 0, with its link open.
    pub fn new(
        index: u16,
        identity: Identity,
        link: Arc<dyn Link>,
        opener: Opener,
        never_reads: Duration,
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
            never_reads,
            notes,
            state,
            changed: Condvar::new(),
        })
    }

    pub fn bus_id(&self) -> &str {
        &self.bus_id
    }

    /// What commands call it.
    pub fn device_id(&self) -> u32 {
        device_id(BUS, self.number)
    }

    /// How a list shows it.
    pub fn shown(&self) -> Shown<'_> {
        Shown {
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

    /// Whether it is there, free or not.
    pub fn is_there(&self) -> bool {
        self.state.lock().link.is_some()
    }

    /// Gives the board to a host, if it is there and free.
    pub fn take(&self, stream: Stream) -> Result<Arc<Session>, (Stream, Refusal)> {
        let mut state = self.state.lock();
        if state.stopping {
            return Err((stream, Refusal::Away));
        }
        // One that is lost is away, even while its host is being told.
        let Some(link) = state.link.clone() else { return Err((stream, Refusal::Away)) };
        if state.session.is_some() {
            return Err((stream, Refusal::Busy));
        }
        let descriptors = self.descriptors.clone();
        let session = Arc::new(Session::new(stream, link, descriptors, self.device_id(), self.never_reads));
        state.session = Some(session.clone());
        Ok(session)
    }

    /// Lets the host have the board until it is over, then takes it back.
    pub fn serve(&self, session: &Session, host: &str) {
        self.tell(Event::Attached { bus_id: self.bus_id.clone(), host: host.to_owned() });
        let why = session.run();
        let lost = matches!(why, End::LinkLost(_));
        let link = if lost { self.state.lock().link.take() } else { None };
        // The session stays until the link is closed: only then it can be opened again.
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

    /// Looks after the link until [`Self::stop`]; `back` is called each time that it was opened again.
    pub fn keep(&self, retry: Duration, back: &mut dyn FnMut()) {
        let mut told = String::new();
        loop {
            let mut state = self.state.lock();
            if state.stopping {
                return;
            }
            if let Some(link) = state.link.clone() {
                // No call into a link with the lock held: it may take as long as the link likes.
                drop(state);
                if let Err(why) = link.check() {
                    self.lose(&link, why);
                    continue;
                }
                state = self.state.lock();
                if !state.stopping && state.link.is_some() {
                    self.changed.wait_for(&mut state, LOOK_EVERY);
                }
            } else {
                self.changed.wait_for(&mut state, retry);
            }
            // One that was lost is opened when its host has let go of it, and not by the call that lost it.
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
            session.end(End::LinkLost(why.clone()));
        }
        link.close();
        self.tell(Event::Lost { bus_id: self.bus_id.clone(), why: why.to_string() });
    }

    /// Tries to open the link; `told` is the last reason why it could not be.
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
                self.tell(Event::Back { bus_id: self.bus_id.clone() });
                true
            }
            Err(error) => {
                let why = error.to_string();
                if why != *told {
                    told.clone_from(&why);
                    self.tell(Event::StillAway { bus_id: self.bus_id.clone(), why });
                }
                false
            }
        }
    }

    /// Takes the board from its host and closes the link.
    pub fn stop(&self) {
        let (link, session) = {
            let mut state = self.state.lock();
            state.stopping = true;
            self.changed.notify_all();
            (state.link.take(), state.session.clone())
        };
        if let Some(session) = session {
            session.end(End::Stopped);
        }
        if let Some(link) = link {
            link.close();
        }
    }

    pub fn tell(&self, event: Event) {
        self.notes.tell(event);
    }
}
