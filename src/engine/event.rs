//! Events of a board that reports do not show, for logs and tools.

use std::fmt;

use super::Reason;
use super::homing::HomingEnd;
use super::partial_frames::INCOMPLETE_CYCLES;
use super::state_failure::{SlaveFall, StateFailure};
use crate::ethercat::cia402::{MODES_OF_OPERATION, SECOND_AXIS_OFFSET};
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::fieldbus::Ns;
use crate::sk::CommandId;
use crate::span::Seconds;

/// An event of a board that reports do not show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// When the event happened or was detected, board time.
    pub at: Ns,
    /// What happened.
    pub kind: EventKind,
}

impl Event {
    /// The same event with its time counted from the board time `zero`, for example from the opening of the link.
    pub const fn since(self, zero: Ns) -> Self {
        Self { at: self.at.saturating_sub(zero), ..self }
    }
}

/// What happened in an [`Event`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// A command was rejected.
    Rejected(Rejection),
    /// SET_DC had a Data2 that no user guide mentions: neither 0xFFFF nor 0xFFFF0000. The board has accepted it (SK-4
    /// \[OURS]).
    OddDcShift {
        /// The value of Data2.
        data2: u32,
    },
    /// DRIVE_MODE had a Data2 that no user guide mentions. The board has treated it as DC sync (SK-4 \[OURS]).
    OddDriveType {
        /// The number of the slave, counted from 1.
        slave: u8,
        /// The value of Data2.
        data2: u32,
    },
    /// A command frame was dropped because it did not arrive completely (CONFIG3, SK-5).
    Incomplete {
        /// How many bytes of the frame were received.
        bytes: u16,
    },
    /// A slave no longer answers in SafeOP or OP (SK-4).
    SlaveLost {
        /// The number of the slave, counted from 1.
        slave: u8,
    },
    /// A slave has left SafeOP or OP by itself and shows an AL status code. It counts as lost.
    SlaveFell {
        /// The slave and its AL status code.
        fall: SlaveFall,
    },
    /// Another master sends frames on the network. This is logged only once.
    OtherMaster {
        /// The source MAC address of the other master's frames, as it arrived. The first slave that a frame passes sets
        /// bit 0x02 of its first byte, "locally administered".
        address: [u8; 6],
    },
    /// A slave answers, but with a wrong working counter for so long that its inputs are stale. It counts as lost.
    InputsStale {
        /// The number of the slave, counted from 1.
        slave: u8,
    },
    /// In a cycle in OP, the working counter was too low although the bus named no slave that did not answer, or it was
    /// too high. Logged once, and again only after the working counter was right.
    WorkingCounter {
        /// The working counter of that cycle.
        counted: u16,
        /// The working counter that would show that every slave answers.
        expected: u16,
    },
    /// A bus that queues outputs (a chip or a network card) has lost answers of slaves, because they were not polled in
    /// time. The cycles of these answers have no report.
    AnswersLost {
        /// The number of cycles in a row without a report.
        cycles: u32,
    },
    /// The hardware that runs the bus, such as a chip, no longer answers. This is logged once, until it answers again.
    BusDown,
    /// A bus that queues outputs (a chip or a network card) has given up some of these outputs, so their targets may
    /// not have reached the slaves.
    OutputsLost {
        /// The number of sets of outputs; each is for one cycle.
        sets: u32,
        /// Whether a chip (ECM-XF) runs the bus.
        has_chip: bool,
    },
    /// A slave that was not lost has left OP: a SET_STATE brings lost slaves back, and the bus could not configure the
    /// lost slaves without disturbing this one. It returns to OP with them, with its motors and digital outputs off
    /// (SK-4 \[OURS]).
    SlaveDisturbed {
        /// The number of the slave, counted from 1.
        slave: u8,
    },
    /// This slave was found in a lower state than the network after a failed change of state
    /// ([`EventKind::StateFailed`]). It counts as lost (SK-4 \[OURS]).
    SlaveLeft {
        /// The number of the slave, counted from 1.
        slave: u8,
    },
    /// A change of state has failed (SK-4). The state byte is 0x10 plus the last state that all slaves have reached.
    StateFailed {
        /// Why the change has failed.
        why: StateFailure,
    },
    /// The homing of an axis has ended.
    HomingEnded {
        /// The number of the slave, counted from 1.
        slave: u8,
        /// The axis of the slave, from 0.
        axis: u8,
        /// How the homing has ended.
        end: HomingEnd,
    },
    /// After homing, in mode 6, the board could not restore the mode that DRIVE_MODE has set. The drive stays in homing mode
    /// (SK-7 \[OURS]).
    ModeNotRestored {
        /// The number of the slave, counted from 1.
        slave: u8,
        /// The axis of the slave, from 0.
        axis: u8,
        /// The abort code of the last attempt.
        code: AbortCode,
    },
    /// An SDO transfer of the host was aborted; the abort code is in the SDO slot (SK-6).
    SdoAborted {
        /// The number of the slave, counted from 1.
        slave: u8,
        /// The object of the transfer.
        object: ObjectAddress,
        /// True: a download; false: an upload.
        write: bool,
        /// The abort code with which the transfer has ended.
        code: AbortCode,
    },
    /// The script of the simulated board, which causes faults at given times, has carried out an action, or the board's
    /// control socket has.
    Scripted {
        /// The number of the line in the script, from 1; `None`: the action came through the control socket (`control=`).
        line: Option<u32>,
        /// The verb of the script line, for example `cut`.
        verb: &'static str,
        /// The slave, from 1; `None`: the line acts on the cable or the board.
        slave: Option<u8>,
        /// The error code, AL status code or abort code that the slave shows as a result.
        code: Option<u32>,
        /// Whether this is the end of an action that lasts for a time, rather than its beginning.
        ended: bool,
    },
}

/// A command that was rejected, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rejection {
    /// The number of the slot with the command.
    pub slot: u8,
    /// The id of the command.
    pub id: CommandId,
    /// The reason of the rejection.
    pub reason: Reason,
}

/// Advice for users if an SDO was aborted because the simulated slave has no such object.
const MAKERS_OBJECTS: &str = "; if the real drive has it, give the simulated one its maker's objects: \
                              slaves=drive:objects@FILE, or drive:objects@any, which stores what it is told";

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let at = Seconds(self.at);
        match self.kind {
            EventKind::Rejected(Rejection { slot, id, reason }) => {
                write!(f, "{id} in slot {slot} rejected at {at}: {reason}")
            }
            EventKind::OddDcShift { data2 } => write!(
                f,
                "SET_DC at {at} has Data2 = 0x{data2:08X}: accepted, though the guides print 0xFFFF and 0xFFFF0000 only"
            ),
            EventKind::OddDriveType { slave, data2 } => write!(
                f,
                "DRIVE_MODE of slave {slave} at {at} has Data2 = 0x{data2:08X}: taken for 1, DC sync, though the guides print 0 \
                 and 1 only"
            ),
            EventKind::StateFailed { why } => write!(f, "a change of state has failed at {at}: {why}"),
            EventKind::HomingEnded { slave, axis, end } => {
                write!(f, "homing of slave {slave}, axis {}, at {at}: {end}", axis + 1)
            }
            EventKind::ModeNotRestored { slave, axis, code } => write!(
                f,
                "the mode of slave {slave}, axis {}, could not be restored after homing at {at} ({code}): write 0x{:04X}",
                axis + 1,
                MODES_OF_OPERATION + SECOND_AXIS_OFFSET * u16::from(axis)
            ),
            EventKind::SdoAborted { slave, object, write, code } => {
                let id = if write { CommandId::SdoWrite } else { CommandId::SdoRead };
                write!(f, "{id} of slave {slave}, {object}, aborted at {at}: {code}")?;
                match code {
                    AbortCode::NO_OBJECT | AbortCode::NO_SUB_INDEX => f.write_str(MAKERS_OBJECTS),
                    _ => Ok(()),
                }
            }
            EventKind::Scripted { line, verb, slave, code, ended } => {
                let end = if ended { "the end of " } else { "" };
                match line {
                    Some(line) => write!(f, "script, line {line}: {end}`{verb}")?,
                    None => write!(f, "injected: {end}`{verb}")?,
                }
                if let Some(slave) = slave {
                    write!(f, " {slave}")?;
                }
                if let Some(code) = code {
                    write!(f, " 0x{code:04X}")?;
                }
                write!(f, "` at {at}")
            }
            EventKind::Incomplete { bytes } => write!(
                f,
                "command frame dropped at {at}: only {bytes} bytes came within {INCOMPLETE_CYCLES} cycles; send whole \
                 frames, or pull CONFIG3 low"
            ),
            EventKind::SlaveLeft { slave } => write!(
                f,
                "slave {slave} is in a lower state than the others since a change that failed, seen at {at}: send SET_STATE \
                 to bring it back"
            ),
            EventKind::InputsStale { slave } => write!(
                f,
                "the inputs of slave {slave} are stale at {at}: they do not come, or with a wrong working counter; its axes are stopped; \
                 look at its cables (`ecmsk bus errors`), then send SET_STATE to bring it back"
            ),
            EventKind::WorkingCounter { counted, expected } if counted > expected => write!(
                f,
                "working counter {counted} instead of {expected} at {at}, which slaves cannot add: something changes frames on their way; \
                 what they bring is not believed"
            ),
            EventKind::WorkingCounter { counted, expected } => write!(
                f,
                "working counter {counted} instead of {expected} at {at}: not every slave answers; look at the cable and at \
                 the slaves' power"
            ),
            EventKind::AnswersLost { cycles } => write!(
                f,
                "the answers of {cycles} cycles before {at} were not there in time: this machine was late, or frames are lost on \
                 the cable; no outputs are lost with them"
            ),
            EventKind::BusDown => write!(
                f,
                "the network does not answer at {at}: look at its wires and its power; when it answers \
                 again, send SET_STATE to bring the slaves back"
            ),
            EventKind::OutputsLost { sets, has_chip: true } => write!(
                f,
                "the outputs of {sets} cycles before {at} may not have reached the slaves: exchanges with the chip fail, or \
                 frames on the cable are lost; look at its wires and at the cable"
            ),
            EventKind::OutputsLost { sets, has_chip: false } => write!(
                f,
                "the outputs of {sets} cycles before {at} may not have reached the slaves: frames on the cable are lost; look at \
                 the cables (`ecmsk bus errors`)"
            ),
            EventKind::SlaveFell { fall } => write!(f, "at {at}: {fall}"),
            EventKind::OtherMaster { address: [a, b, c, d, e, g] } => write!(
                f,
                "another master sends frames on this network (from {a:02X}:{b:02X}:{c:02X}:{d:02X}:{e:02X}:{g:02X}), seen at {at}: \
                 each of the two disturbs the slaves of the other; stop it, or this program"
            ),
            EventKind::SlaveDisturbed { slave } => write!(
                f,
                "slave {slave} left OP at {at} because the bus configured others: its motors and outputs are off until they \
                 are switched on again"
            ),
            EventKind::SlaveLost { slave } => write!(
                f,
                "slave {slave} lost at {at}: look at its power and its cable, then send SET_STATE to bring it back"
            ),
        }
    }
}

/// A ring buffer that keeps the newest events.
#[derive(Clone, Debug)]
pub(super) struct EventLog {
    ring: [Option<Event>; Self::KEPT],
    total: u64,
}

impl EventLog {
    /// The number of newest events that the log keeps.
    const KEPT: usize = 32;

    pub(super) const fn new() -> Self {
        Self { ring: [None; Self::KEPT], total: 0 }
    }

    pub(super) fn push(&mut self, event: Event) {
        self.ring[(self.total % Self::KEPT as u64) as usize] = Some(event);
        self.total += 1;
    }

    /// The number of events so far, including those that were dropped.
    pub(super) const fn total(&self) -> u64 {
        self.total
    }

    /// The events that are still kept, from event number `from` on (counted from 0), oldest first.
    pub(super) fn since(&self, from: u64) -> impl Iterator<Item = Event> {
        let oldest = self.total.saturating_sub(Self::KEPT as u64).max(from);
        (oldest..self.total).filter_map(|n| self.ring[(n % Self::KEPT as u64) as usize])
    }
}
