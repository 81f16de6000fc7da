//! Carries out a script. Each step is carried out in the first cycle at or after its time, through the handles to the
//! network and to the board that tests use too.

use crate::engine::{self, BoardHandle, Event, EventKind};
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::fieldbus::{AlState, MAX_AXES, MAX_SLAVES, Ns};
use crate::slave::cable::{Cable, Noise};
use crate::slave::{AlStatus, Fault};

/// The effect of a line of a script on the board or on a slave. Slaves are numbered from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ScriptAction {
    /// A fault inside a slave, such as an alarm or a stuck limit switch.
    Fault { slave: u8, fault: Fault },
    /// Where the cable is cut: the number of slaves before the cut; `None`: the cable is whole.
    Cut(Option<u8>),
    /// The section of the cable that damages frames, and how often; `None`: no section damages frames.
    Noise(Option<Noise>),
    /// Whether the slave ignores every datagram while frames still pass through it.
    Mute { slave: u8, mute: bool },
    /// The AL state that the slave refuses to enter, with the AL status code of the refusal; `None`: it refuses no state.
    Refuse { slave: u8, state: Option<(AlState, AlStatus)> },
    /// The delay of SDO transfers with the slave, ns.
    SdoDelay { slave: u8, ns: Ns },
    /// The abort code for SDO transfers with the slave, for one object or for every object (`None`). Without `abort` no
    /// transfer is aborted.
    SdoAbort { slave: u8, abort: Option<(Option<ObjectAddress>, AbortCode)> },
    /// Whether the slave has lost its power.
    Lose { slave: u8, lost: bool },
    /// Whether the board sends no reports.
    Silent(bool),
    /// Whether the board stops executing the entries of its FIFO, so that the FIFO fills up.
    Full(bool),
    /// The levels of the board's six digital inputs: bit k is input k.
    Inputs(u8),
}

impl ScriptAction {
    /// The action that ends this one. [`ScriptAction::Inputs`] never ends by itself and is returned unchanged.
    pub(super) const fn undo(self) -> Self {
        match self {
            Self::Inputs(_) => self,
            Self::Fault { slave, fault } => Self::Fault { slave, fault: fault.end() },
            Self::Cut(_) => Self::Cut(None),
            Self::Noise(_) => Self::Noise(None),
            Self::Mute { slave, .. } => Self::Mute { slave, mute: false },
            Self::Refuse { slave, .. } => Self::Refuse { slave, state: None },
            Self::SdoDelay { slave, .. } => Self::SdoDelay { slave, ns: 0 },
            Self::SdoAbort { slave, .. } => Self::SdoAbort { slave, abort: None },
            Self::Lose { slave, .. } => Self::Lose { slave, lost: false },
            Self::Silent(_) => Self::Silent(false),
            Self::Full(_) => Self::Full(false),
        }
    }

    /// Whether the action affects the board itself rather than its network.
    pub(super) const fn is_of_board(self) -> bool {
        matches!(self, Self::Silent(_) | Self::Full(_) | Self::Inputs(_))
    }

    /// Whether the action affects frames. Simulated slaves that are called directly have no frames.
    pub(super) const fn is_of_frames(self) -> bool {
        matches!(self, Self::Noise(_))
    }

    /// The slave that the action affects, from 1; for a cut of the cable, the first slave after the cut. `None` if the
    /// action affects the whole cable or the board.
    const fn slave(self) -> Option<u8> {
        match self {
            Self::Fault { slave, .. }
            | Self::Mute { slave, .. }
            | Self::Refuse { slave, .. }
            | Self::SdoDelay { slave, .. }
            | Self::SdoAbort { slave, .. }
            | Self::Lose { slave, .. } => Some(slave),
            Self::Cut(Some(before)) => Some(before + 1),
            Self::Noise(_) | Self::Cut(None) | Self::Silent(_) | Self::Full(_) | Self::Inputs(_) => None,
        }
    }

    /// The code that the action makes the slave show or answer: error code, AL status code or abort code. `None` for an action
    /// without a code.
    fn code(self) -> Option<u32> {
        match self {
            Self::Fault { fault: Fault::Alarm { fault, .. }, .. } => Some(fault.code.into()),
            Self::Refuse { state: Some((_, status)), .. } => Some(status.0.into()),
            Self::SdoAbort { abort: Some((_, code)), .. } => Some(code.0),
            _ => None,
        }
    }

    fn apply(self, network: &Cable, board: &BoardHandle) {
        match self {
            Self::Fault { slave, fault } => network.apply_fault(slave, fault),
            Self::Cut(Some(slaves)) => network.cut_after(slaves),
            Self::Cut(None) => network.heal(),
            Self::Noise(noise) => network.damage_frames(noise),
            Self::Mute { slave, mute } => network.silence(slave, mute),
            Self::Refuse { slave, state } => network.refuse(slave, state),
            Self::SdoDelay { slave, ns } => network.delay_sdo(slave, ns),
            Self::SdoAbort { slave, abort: None } => {
                network.abort_sdo(slave, None);
                network.abort_object(slave, None);
            }
            Self::SdoAbort { slave, abort: Some((None, code)) } => network.abort_sdo(slave, Some(code)),
            Self::SdoAbort { slave, abort: Some((Some(object), code)) } => {
                network.abort_object(slave, Some((object, code)));
            }
            Self::Lose { slave, lost: true } => network.lose(slave),
            Self::Lose { slave, lost: false } => network.find(slave),
            Self::Silent(silent) => board.suppress_reports(silent),
            Self::Full(full) => board.hold_fifo(full),
            Self::Inputs(bits) => board.set_local_inputs(bits),
        }
    }
}

/// The moment from which the times of a script's lines count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScriptOrigin {
    /// The start of the script: the opening of the link, or the start of the server.
    Start,
    /// The first frame of a master.
    Frame,
    /// The moment the first slave reaches OP.
    Op,
}

impl ScriptOrigin {
    const ALL: [Self; 3] = [Self::Start, Self::Frame, Self::Op];
}

/// One action of a script with its time. A line with `for` has two steps: its action, and the action that undoes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Step {
    pub(super) from: ScriptOrigin,
    /// Time after the origin `from`, ns.
    pub(super) at: Ns,
    /// The number of the line in the file, from 1.
    pub(super) line: u32,
    pub(super) verb: &'static str,
    pub(super) action: ScriptAction,
    /// Whether the step ends an event, by `for` or by `end`.
    pub(super) ended: bool,
}

impl Step {
    /// Carries out the step at `now`. `line` is the line number in the event that is passed to `done`; `None` for a
    /// step that does not come from a script file.
    pub(super) fn carry_out(
        &self,
        line: Option<u32>,
        (network, board): (&Cable, &BoardHandle),
        now: Ns,
        done: &mut dyn FnMut(Event),
    ) {
        self.action.apply(network, board);
        let Self { verb, ended, .. } = *self;
        let (slave, code) = (self.action.slave(), self.action.code());
        done(Event { at: now, kind: EventKind::Scripted { line, verb, slave, code, ended } });
    }
}

/// The steps of a script whose times count from the same origin. Each origin is reached at its own time, so each has its own
/// list.
struct Part {
    steps: Vec<Step>,
    /// The index of the first step that has not been carried out.
    next: usize,
    /// The time of the origin, ns; `None` until the origin is reached.
    zero: Option<Ns>,
}

/// A script that is running on a board and its network.
pub struct RunningScript {
    /// One part per origin, in the order of [`ScriptOrigin`].
    parts: [Part; 3],
    network: Cable,
    board: BoardHandle,
}

impl RunningScript {
    /// Starts the steps, which are sorted by time. The times of [`ScriptOrigin::Start`] count from `zero`, the present time.
    pub(super) fn new(steps: &[Step], network: Cable, board: BoardHandle, zero: Ns) -> Self {
        let parts = ScriptOrigin::ALL.map(|origin| Part {
            steps: steps.iter().filter(|step| step.from == origin).copied().collect(),
            next: 0,
            zero: (origin == ScriptOrigin::Start).then_some(zero),
        });
        Self { parts, network, board }
    }

    /// Reports that `origin` is reached at `now`: the times of the lines that wait for it count from then on. Only the
    /// first call for an origin has an effect.
    pub fn begin(&mut self, origin: ScriptOrigin, now: Ns) {
        self.parts[origin as usize].zero.get_or_insert(now);
    }
}

impl engine::Script for RunningScript {
    fn run(&mut self, now: Ns, done: &mut dyn FnMut(Event)) {
        for Part { steps, next, zero } in &mut self.parts {
            let Some(zero) = *zero else { continue };
            while let Some(step) = steps.get(*next).filter(|step| zero.saturating_add(step.at) <= now) {
                step.carry_out(Some(step.line), (&self.network, &self.board), now, done);
                *next += 1;
            }
        }
    }

    fn is_over(&self) -> bool {
        self.parts.iter().all(|part| part.next == part.steps.len())
    }
}

/// Ends every effect that any script can have on the network and on the board.
pub(crate) fn undo_all(network: &Cable, board: &BoardHandle) {
    let everywhere =
        [ScriptAction::Cut(None), ScriptAction::Silent(false), ScriptAction::Full(false), ScriptAction::Inputs(0)];
    let of_slave = |slave| {
        [
            // This also restores the power of a slave that has lost it: such a slave is silent in the same way.
            ScriptAction::Mute { slave, mute: false },
            ScriptAction::Refuse { slave, state: None },
            ScriptAction::SdoDelay { slave, ns: 0 },
            ScriptAction::SdoAbort { slave, abort: None },
        ]
    };
    let of_axis = |(slave, axis)| Fault::all_ends(axis).map(|fault| ScriptAction::Fault { slave, fault });
    let slaves = 1..=MAX_SLAVES as u8;
    let axes = slaves.clone().flat_map(|slave| (0..MAX_AXES).map(move |axis| (slave, axis)));
    for action in everywhere.into_iter().chain(slaves.flat_map(of_slave)).chain(axes.flat_map(of_axis)) {
        action.apply(network, board);
    }
}
