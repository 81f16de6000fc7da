//! The features that a program uses: each once, with its count and its first frame.

use std::collections::BTreeMap;
use std::fmt;

use super::Place;
use crate::ethercat::cia402::Mode;
use crate::ethercat::coe::ObjectAddress;
use crate::sk::{CommandId, CycleTime, MasterState, SlaveKind};

/// The maximum number of features that are kept, since a damaged recording may name any number of objects. \[OURS]
const SUBJECTS_MAX: usize = 2000;

/// A feature that a program uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Subject {
    /// Slaves of a kind, declared by SET_AXIS. Its count is the largest number of them in a network.
    Kind(SlaveKind),
    /// A mode of operation of a kind of slave, set by DRIVE_MODE.
    Mode(SlaveKind, Mode),
    /// An EtherCAT cycle time, set by SET_DC. The default counts once, when OP is first reached.
    Cycle(CycleTime),
    /// A command in slot 0 or in a slave's slot. GET_STATUS counts only for frames in which all slots are GET_STATUS.
    Command(CommandId),
    /// A request for a state of the network.
    State(MasterState),
    /// An object that the program reads by SDO.
    Read(ObjectAddress),
    /// An object that the program writes by SDO.
    Write(ObjectAddress),
    /// Slaves that were lost in OP. Its count is the number of reports that show a new loss.
    Lost,
    /// A request for OP after which lost slaves return.
    Return,
    /// Command frames that the board lost because its FIFO was full.
    FifoFull,
}

impl Subject {
    /// The group of the feature: a word for other programs, which does not change.
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

    /// The sort key of the feature: the position of its group in the list of features, then a number within the group,
    /// such as a command code or an object address.
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

/// The name of the feature, such as `SET_STATE OP`, `SDO_WR 0x6098:0` or `DRIVE in CSP`.
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

/// How often a program uses a feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Count {
    /// The feature that is counted.
    pub subject: Subject,
    /// The number of uses.
    pub times: u64,
    /// The frame of the first use.
    pub first: Place,
    /// The number of uses in circumstances in which an ECM-XF differs.
    pub exposed: u64,
    /// The frame of the first use that `exposed` counts; `None` if there is none.
    pub first_exposed: Option<Place>,
}

/// All features that a program uses, sorted by [`Subject::order`].
#[derive(Clone, Debug, Default)]
pub(super) struct Usage(BTreeMap<(u8, u64), Count>);

impl Usage {
    /// Adds uses of a feature at `place`. `exposed` says whether an ECM-XF differs from a board in their circumstances.
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

    /// Marks one earlier use as exposed: made in circumstances in which an ECM-XF differs from a board.
    pub(super) fn expose(&mut self, subject: Subject, place: Place) {
        if let Some(count) = self.0.get_mut(&subject.order()) {
            count.exposed = (count.exposed + 1).min(count.times);
            count.first_exposed = count.first_exposed.or(Some(place));
        }
    }

    /// Raises the count of a feature to `times`, if it is lower.
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
