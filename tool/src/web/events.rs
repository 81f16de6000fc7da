//! Finds the events in the frames of a board: state changes, alarms and lost commands. A page lists them with their
//! times.

use ecmsk::link::Dir;
use ecmsk::machine_file::MachineFile;
use ecmsk::recording::Kinds;
use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{DriveResponse, Frame, MasterResponse, SlaveKind, SlotSize, StateByte};
use ecmsk::summary::{FrameEvent, FrameWatch, HeldBack};
use serde::Serialize;

use crate::machine_option::{alarm_words, in_unit};

/// The largest number of events that are kept, since nobody reads more of them on a page. The oldest ones are dropped.
/// \[OURS]
const EVENTS_MAX: usize = 5000;
/// If the full count rises several times within this time, ns, it is a single event. \[OURS]
const FULL_APART_NS: i64 = 1_000_000_000;

/// The kind of an event, which decides how the page marks it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// The AL state of the network changes.
    Network,
    /// The CiA 402 state of a drive changes, homing begins, or a drive holds its axis back.
    Drive,
    /// An alarm of a drive.
    Alarm,
    /// The FIFO became empty during a motion.
    Gap,
    /// Command frames found the board's FIFO full and were lost.
    Fifo,
    /// A slave is lost.
    Lost,
    /// The condition of `--find` became true.
    Found,
    /// The first difference from the recording of `--beside`.
    Difference,
}

/// An event, as the page shows it in its list.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Event {
    /// Nanoseconds since the first frame.
    pub at_ns: i64,
    /// The number of the slave; 0 for the board.
    pub slave: u8,
    /// The kind of the event.
    pub kind: EventKind,
    /// The text for the event.
    pub text: String,
    /// The error code of an alarm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub code: Option<u16>,
}

impl Event {
    /// The condition of `--find`, which is `expression`, became true.
    pub fn found(at_ns: i64, expression: &str) -> Self {
        Self { at_ns, slave: 0, kind: EventKind::Found, text: expression.to_owned(), code: None }
    }
}

/// A time span of a state of an axis or of the board, which the page shades behind the curves.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Span {
    /// The number of the slave; 0 for the board.
    pub slave: u8,
    /// `not_enabled`, `homing`, `fault`, `gap`, `lost` or `failed`.
    pub state: &'static str,
    /// The beginning in seconds since the first frame.
    pub from: f64,
    /// The end in seconds since the first frame.
    pub to: f64,
    /// The text for the state.
    pub text: String,
}

/// Finds events in the frames of a run, which must be sorted by time.
pub struct Events {
    size: SlotSize,
    watch: FrameWatch,
    kinds: Kinds,
    state: Option<StateByte>,
    drives: [Option<&'static str>; MAX_SLAVES],
    full: Option<u16>,
    full_ns: Option<i64>,
    found: Vec<Event>,
    left_out: u64,
}

impl Events {
    /// Starts without frames. `kinds`: the kinds of the slaves, if they are known.
    pub fn new(size: SlotSize, kinds: Kinds) -> Self {
        Self {
            size,
            watch: FrameWatch::new(size),
            kinds,
            state: None,
            drives: [None; MAX_SLAVES],
            full: None,
            full_ns: None,
            found: Vec::new(),
            left_out: 0,
        }
    }

    /// Processes the next frame.
    pub fn frame(&mut self, at_ns: i64, direction: Dir, frame: &Frame, machine: Option<&MachineFile>) {
        match direction {
            Dir::Write => {
                self.kinds.command(frame, self.size);
                self.watch.command(at_ns, frame);
            }
            Dir::Read => self.report(at_ns, frame, machine),
        }
    }

    /// Replaces the kinds of the slaves, after the server has reported other slaves.
    pub fn set_kinds(&mut self, kinds: Kinds) {
        self.kinds = kinds;
    }

    /// The kinds of the slaves, as far as they are known.
    pub const fn kinds(&self) -> &Kinds {
        &self.kinds
    }

    /// The events so far.
    pub fn found(&self) -> &[Event] {
        &self.found
    }

    /// The number of events that were dropped, because there were more than [`EVENTS_MAX`]. They are the oldest ones.
    pub const fn left_out(&self) -> u64 {
        self.left_out
    }

    /// Adds events that were not found in the frames, such as the beginnings of shaded time spans, and sorts all events
    /// by time.
    pub fn with(&mut self, others: impl IntoIterator<Item = Event>) {
        self.found.extend(others);
        self.found.sort_by_key(|event| event.at_ns);
        let excess = self.found.len().saturating_sub(EVENTS_MAX);
        self.found.drain(..excess);
        self.left_out += excess as u64;
    }

    /// Adds an event that was not found in the frames, later than all others so far.
    pub fn add(&mut self, event: Event) {
        if self.found.len() == EVENTS_MAX {
            self.found.remove(0);
            self.left_out += 1;
        }
        self.found.push(event);
    }

    fn report(&mut self, at_ns: i64, frame: &Frame, machine: Option<&MachineFile>) {
        let mut seen = Vec::new();
        self.watch.report(at_ns, frame, &mut |event| seen.push(event));
        self.kinds.response(frame, self.size);
        let board = MasterResponse::decode(&frame.slot(self.size, 0));
        let event = |slave, kind, text| Event { at_ns, slave, kind, text, code: None };
        if self.state.replace(board.state) != Some(board.state) {
            let kind = if board.state.is_failed() { EventKind::Lost } else { EventKind::Network };
            self.add(event(0, kind, board.state.to_string()));
        }
        for found in seen {
            match found {
                FrameEvent::Alarm(alarm) => {
                    let meaning = alarm_words(machine, alarm.slave, alarm.code);
                    let text = format!("alarm 0x{:04X}: {meaning}", alarm.code);
                    self.add(Event { code: Some(alarm.code), ..event(alarm.slave, EventKind::Alarm, text) });
                }
                FrameEvent::HeldBack(HeldBack { slave, position, .. }) => {
                    let axis = machine.and_then(|machine| machine.axis_of(slave));
                    let place =
                        axis.map_or_else(|| format!("{position} counts"), |axis| in_unit(axis, position.into()));
                    let text = format!("held back at {place}: internal limit active");
                    self.add(event(slave, EventKind::Drive, text));
                }
                FrameEvent::StateFailed(_) => {}
            }
        }
        let rises = self.full.replace(board.full_count).is_some_and(|before| before != board.full_count);
        if rises {
            let is_new = self.full_ns.replace(at_ns).is_none_or(|then_ns| at_ns - then_ns > FULL_APART_NS);
            if is_new {
                self.add(event(0, EventKind::Fifo, "FIFO full: command frames are lost".to_owned()));
            }
        }
        self.drives(at_ns, frame);
    }

    fn drives(&mut self, at_ns: i64, frame: &Frame) {
        for slave in 1..=self.size.max_slaves() {
            if !matches!(self.kinds.of(slave), Some(SlaveKind::Drive | SlaveKind::Step | SlaveKind::Hsp)) {
                continue;
            }
            let drive = DriveResponse::decode(&frame.slot(self.size, slave));
            // Before a drive has process data, its slot is empty. The statusword 0 is then no state.
            let state = drive.statusword.state().filter(|_| drive.statusword.0 != 0).map(|state| state.name());
            let before = std::mem::replace(&mut self.drives[slave - 1], state);
            if let Some(name) = state.filter(|_| before != state) {
                let text = name.to_owned();
                self.add(Event { at_ns, slave: slave as u8, kind: EventKind::Drive, text, code: None });
            }
        }
    }
}
