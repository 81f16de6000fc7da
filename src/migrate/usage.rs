//! What a program uses: each thing once, with how often and where first.

use std::collections::BTreeMap;
use std::fmt;

use super::Place;
use crate::ethercat::cia402::Mode;
use crate::ethercat::coe::ObjectAddress;
use crate::sk::{CommandId, CycleTime, MasterState, SlaveKind};

/// How many different things are kept; a damaged recording may name any objects. \[OURS]
const SUBJECTS_MAX: usize = 2000;

/// Something that a program uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Subject {
    /// Slaves of a kind, by SET_AXIS; they are counted, in the largest network.
    Kind(SlaveKind),
    /// A mode of operation that a kind of slave is used in, by DRIVE_MODE.
    Mode(SlaveKind, Mode),
    /// An EtherCAT cycle, by SET_DC; the default counts once, at the first OP.
    Cycle(CycleTime),
    /// A command in slot 0 or in a slave's slot; of GET_STATUS the frames that hold nothing else.
    Command(CommandId),
    /// A request for a state of the network.
    State(MasterState),
    /// An object that is read by SDO.
    Read(ObjectAddress),
    /// An object that is written by SDO.
    Write(ObjectAddress),
    /// Slaves that were lost in OP: reports that began to say so.
    Lost,
    /// A request for OP with which lost slaves come back.
    Return,
    /// Command frames that the board lost because its FIFO was full.
    FifoFull,
}

impl Subject {
    /// What kind of thing it is, for programs: a word that stays.
    pub const fn group(self) -> &'static str {
        match self {
            Self::Kind(_) => "slave",
            Self::Mode(..) => "mode",
            Self::Cycle(_) => "cycle",
            Self::Command(_) => "command",
            Self::State(_) => "state",
            Self::Read(_) | Self::Write(_) => "object",
            Self::Lost | Self::Return | Self::FifoFull => "event",
        }
    }

    /// Its place in a list.
    const fn order(self) -> (u8, u64) {
        const fn object(address: ObjectAddress) -> u64 {
            (address.index as u64) << 8 | address.sub as u64
        }
        match self {
            Self::Kind(kind) => (0, kind.nibble() as u64),
            Self::Mode(kind, mode) => (1, (kind.nibble() as u64) << 8 | mode.code() as u64),
            Self::Cycle(cycle) => (2, cycle.us() as u64),
            Self::State(state) => (3, state.code() as u64),
            Self::Command(id) => (4, id.code() as u64),
            Self::Read(address) => (5, object(address) << 1),
            Self::Write(address) => (5, object(address) << 1 | 1),
            Self::Lost => (6, 0),
            Self::Return => (6, 1),
            Self::FifoFull => (6, 2),
        }
    }
}

/// The name, as `SET_STATE OP`, `SDO_WR 0x6098:0` or `DRIVE in CSP`.
impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Kind(kind) => write!(f, "slaves of kind {}", kind.name()),
            Self::Mode(kind, mode) => write!(f, "{} in {}", kind.name(), mode.name()),
            Self::Cycle(cycle) => write!(f, "cycle of {} us", cycle.us()),
            Self::Command(id) => id.fmt(f),
            Self::State(state) => write!(f, "SET_STATE {state}"),
            Self::Read(object) => write!(f, "SDO_RD {object}"),
            Self::Write(object) => write!(f, "SDO_WR {object}"),
            Self::Lost => f.write_str("slaves lost in OP"),
            Self::Return => f.write_str("SET_STATE OP brings slaves back"),
            Self::FifoFull => f.write_str("frames lost to a full FIFO"),
        }
    }
}

/// How often something is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Count {
    /// What.
    pub subject: Subject,
    /// How often.
    pub times: u64,
    /// Where first.
    pub first: Place,
    /// How often in circumstances in which an ECM-XF differs, and where first.
    pub exposed: u64,
    /// Where first in such circumstances.
    pub first_exposed: Option<Place>,
}

/// All that a program uses, in the order of a list.
#[derive(Clone, Debug, Default)]
pub(super) struct Usage(BTreeMap<(u8, u64), Count>);

impl Usage {
    /// Something is used there; `exposed`: in circumstances in which an ECM-XF differs.
    pub(super) fn add(&mut self, subject: Subject, times: u64, place: Place, exposed: bool) {
        let key = subject.order();
        if self.0.len() >= SUBJECTS_MAX && !self.0.contains_key(&key) {
            return;
        }
        let count =
            self.0.entry(key).or_insert(Count { subject, times: 0, first: place, exposed: 0, first_exposed: None });
        count.times = count.times.saturating_add(times);
        if exposed {
            count.exposed = count.exposed.saturating_add(times);
            count.first_exposed = count.first_exposed.or(Some(place));
        }
    }

    /// What was used before turns out to be so in circumstances in which an ECM-XF differs.
    pub(super) fn expose(&mut self, subject: Subject, place: Place) {
        if let Some(count) = self.0.get_mut(&subject.order()) {
            count.exposed = (count.exposed + 1).min(count.times);
            count.first_exposed = count.first_exposed.or(Some(place));
        }
    }

    /// So many of it there are at the most.
    pub(super) fn at_most(&mut self, subject: Subject, times: u64, place: Place) {
        let known = self.0.get(&subject.order()).map_or(0, |count| count.times);
        if times > known {
            self.add(subject, times - known, place, false);
        }
    }

    pub(super) fn counts(&self) -> impl Iterator<Item = &Count> {
        self.0.values()
    }

    pub(super) fn has(&self, subject: Subject) -> bool {
        self.0.contains_key(&subject.order())
    }
}
