//! Carrying a script out: each step when its time has come, through the handles that tests use.

use crate::coe::{AbortCode, ObjectAddress};
use crate::engine::{self, BoardHandle, Event};
use crate::fieldbus::cable::Cable;
use crate::fieldbus::{AlState, MAX_AXES, MAX_SLAVES, Ns};
use crate::slave::{AlStatus, Fault};

/// Something that happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Deed {
    /// In a slave.
    Fault {
        slave: u8,
        fault: Fault,
    },
    /// The cable reaches that many slaves; `None`: it is whole.
    Cut(Option<u8>),
    Mute {
        slave: u8,
        mute: bool,
    },
    Refuse {
        slave: u8,
        state: Option<(AlState, AlStatus)>,
    },
    SdoDelay {
        slave: u8,
        ns: Ns,
    },
    /// Of one object or of all; `None`: of none.
    SdoAbort {
        slave: u8,
        abort: Option<(Option<ObjectAddress>, AbortCode)>,
    },
    Lose {
        slave: u8,
        lost: bool,
    },
    Silent(bool),
    Full(bool),
    Inputs(u8),
}

impl Deed {
    /// What takes it back; itself where nothing does.
    pub(super) const fn end(self) -> Self {
        match self {
            Self::Inputs(_) => self,
            Self::Fault { slave, fault } => Self::Fault { slave, fault: fault.end() },
            Self::Cut(_) => Self::Cut(None),
            Self::Mute { slave, .. } => Self::Mute { slave, mute: false },
            Self::Refuse { slave, .. } => Self::Refuse { slave, state: None },
            Self::SdoDelay { slave, .. } => Self::SdoDelay { slave, ns: 0 },
            Self::SdoAbort { slave, .. } => Self::SdoAbort { slave, abort: None },
            Self::Lose { slave, .. } => Self::Lose { slave, lost: false },
            Self::Silent(_) => Self::Silent(false),
            Self::Full(_) => Self::Full(false),
        }
    }

    fn happen(self, network: &Cable, board: &BoardHandle) {
        match self {
            Self::Fault { slave, fault } => network.inflict(slave, fault),
            Self::Cut(Some(slaves)) => network.cut_after(slaves),
            Self::Cut(None) => network.heal(),
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
            Self::Silent(silent) => board.mute(silent),
            Self::Full(full) => board.hold_fifo(full),
            Self::Inputs(bits) => board.set_local_inputs(bits),
        }
    }
}

/// A line's begin or end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Step {
    /// When, from the opening of the link.
    pub(super) at: Ns,
    pub(super) line: u32,
    pub(super) verb: &'static str,
    pub(super) deed: Deed,
    /// It is the end of a line with `for`.
    pub(super) ended: bool,
}

/// A script under way.
pub struct Run {
    steps: Vec<Step>,
    next: usize,
    zero: Ns,
    network: Cable,
    board: BoardHandle,
}

impl Run {
    pub(super) const fn new(steps: Vec<Step>, network: Cable, board: BoardHandle, zero: Ns) -> Self {
        Self { steps, next: 0, zero, network, board }
    }
}

impl engine::Script for Run {
    fn run(&mut self, now: Ns, done: &mut dyn FnMut(Event)) {
        while let Some(step) = self.steps.get(self.next).filter(|step| self.zero.saturating_add(step.at) <= now) {
            step.deed.happen(&self.network, &self.board);
            done(Event::Scripted { at: now, line: step.line, verb: step.verb, ended: step.ended });
            self.next += 1;
        }
    }

    fn is_over(&self) -> bool {
        self.next == self.steps.len()
    }
}

/// Makes network and board whole again, whatever a script did to them.
pub(crate) fn take_back(network: &Cable, board: &BoardHandle) {
    let everywhere = [Deed::Cut(None), Deed::Silent(false), Deed::Full(false), Deed::Inputs(0)];
    let of_slave = |slave| {
        [
            // It is found by that, too.
            Deed::Mute { slave, mute: false },
            Deed::Refuse { slave, state: None },
            Deed::SdoDelay { slave, ns: 0 },
            Deed::SdoAbort { slave, abort: None },
        ]
    };
    let of_axis = |(slave, axis)| Fault::all_ends(axis).map(|fault| Deed::Fault { slave, fault });
    let slaves = 1..=MAX_SLAVES as u8;
    let axes = slaves.clone().flat_map(|slave| (0..MAX_AXES).map(move |axis| (slave, axis)));
    for deed in everywhere.into_iter().chain(slaves.flat_map(of_slave)).chain(axes.flat_map(of_axis)) {
        deed.happen(network, board);
    }
}
