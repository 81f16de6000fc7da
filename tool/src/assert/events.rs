//! Finds the events of a recorded run: states that the network reaches, new alarms, and homings that are attained.

use ecmsk::cia402::Statusword;
use ecmsk::link::Dir;
use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{CommandId, DriveResponse, MasterResponse, MasterState, StateByte};
use ecmsk::summary::FrameEvent;

use super::rules::What;
use crate::recording::Framed;

/// \[OURS] For this long after the first answer to GO_HOME, nanoseconds, bits 10 and 12 of the statusword may still be
/// of an earlier homing, or have the meaning of CSP. In this time they count only after a report has shown them clear.
const OLD_RESULT_MAX_NS: i64 = 100_000_000;

/// An event of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Occurrence {
    /// Time of the recording in nanoseconds.
    pub at_ns: i64,
    pub what: Seen,
}

/// The kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    State(MasterState),
    Alarm { slave: u8, code: u16 },
    Homed(u8),
}

impl Seen {
    /// Whether this is the event that a rule describes.
    pub fn is(self, what: What) -> bool {
        match (self, what) {
            (Self::State(state), What::State(wanted)) => state == wanted,
            (Self::Alarm { slave, code }, What::Alarm { slave: wanted, code: wanted_code }) => {
                wanted.is_none_or(|wanted| wanted == slave) && wanted_code.is_none_or(|wanted| wanted == code)
            }
            (Self::Homed(slave), What::Homed(wanted)) => slave == wanted,
            _ => false,
        }
    }
}

/// The state of the homing of an axis, from its slot.
#[derive(Clone, Copy, Debug, Default)]
struct Homing {
    /// The time of the first report that answered GO_HOME; `None` if the last report answered another command.
    since_ns: Option<i64>,
    /// Whether a report since then has shown bits 12 and 13 clear: neither a result nor an error.
    seen_clear: bool,
    is_attained: bool,
}

impl Homing {
    /// Processes a report. Returns true for the first report that shows the axis at home.
    fn report(&mut self, at_ns: i64, id: CommandId, Statusword(word): Statusword) -> bool {
        const HOME: u16 = Statusword::TARGET_REACHED | Statusword::BIT12;
        if id != CommandId::GoHome {
            *self = Self::default();
            return false;
        }
        let since_ns = *self.since_ns.get_or_insert(at_ns);
        self.seen_clear |= word & (Statusword::BIT12 | Statusword::BIT13) == 0;
        let counts = self.seen_clear || at_ns.saturating_sub(since_ns) >= OLD_RESULT_MAX_NS;
        let is_home = counts && word & HOME == HOME && word & Statusword::BIT13 == 0;
        is_home && !std::mem::replace(&mut self.is_attained, true)
    }
}

/// Finds events in the frames of a run, which must be sorted by time.
pub struct Finder {
    state: StateByte,
    homing: Box<[Homing]>,
    pub found: Vec<Occurrence>,
}

impl Finder {
    pub fn new() -> Self {
        Self { state: StateByte::default(), homing: vec![Homing::default(); MAX_SLAVES].into(), found: Vec::new() }
    }

    /// Adds an event that a [`FrameWatch`](ecmsk::summary::FrameWatch) has found in the report at that time.
    pub fn event(&mut self, at_ns: i64, event: FrameEvent) {
        if let FrameEvent::Alarm(alarm) = event {
            self.found.push(Occurrence { at_ns, what: Seen::Alarm { slave: alarm.slave, code: alarm.code } });
        }
    }

    /// Processes the next frame.
    pub fn frame(&mut self, framed: &Framed) {
        if framed.recorded.dir == Dir::Write {
            return;
        }
        let (frame, size, at_ns) = (&framed.recorded.frame, framed.size, framed.time_ns);
        let state = MasterResponse::decode(&frame.slot(size, 0)).state;
        if std::mem::replace(&mut self.state, state) != state
            && let Some(reached) = state.state().filter(|_| !state.is_failed())
        {
            self.found.push(Occurrence { at_ns, what: Seen::State(reached) });
        }
        if state.state() != Some(MasterState::Op) {
            self.homing.fill(Homing::default());
            return;
        }
        for (slave, homing) in (1..=size.max_slaves()).zip(&mut self.homing) {
            let drive = DriveResponse::decode(&frame.slot(size, slave));
            if homing.report(at_ns, CommandId::from_code(drive.head.id), drive.statusword) {
                self.found.push(Occurrence { at_ns, what: Seen::Homed(slave as u8) });
            }
        }
    }
}
