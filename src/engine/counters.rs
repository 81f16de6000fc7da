//! Counters and events: what happened to commands and slaves, since the wire does not show all of it.

use std::fmt;

use super::homing::HomingEnd;
use super::partial_frames::INCOMPLETE_CYCLES;
use super::state_failure::{SlaveFall, StateFailure};
use crate::cia402::{MODES_OF_OPERATION, SECOND_AXIS_OFFSET};
use crate::coe::{AbortCode, ObjectAddress};
use crate::fieldbus::Ns;
use crate::sk::{CommandId, Malformed};
use crate::span::Seconds;

/// Why a command was not executed (SK-4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Reason {
    /// The id is none of the 22 that the board knows.
    UnknownId,
    /// The command is not for that kind of slot, or not for that kind of slave.
    WrongSlot,
    /// The state of the network does not allow the command.
    WrongState,
    /// The guides do not allow an argument.
    BadArgument(Malformed),
    /// CSP, CSV or CST came in another mode than that of DRIVE_MODE or of 0x6060.
    WrongMode,
    /// The request was held while another SDO transfer was under way, and a newer one has replaced it.
    SdoBusy,
    /// GO_HOME came for a drive that is not in homing mode.
    NotInHomingMode,
    /// GO_HOME came while another slave was homing.
    HomingElsewhere,
    /// No slave has that number, or SET_AXIS has declared the slave as not used.
    NoSlave,
    /// GO_HOME came for a drive that SV_ON has not brought to Operation enabled.
    NotEnabled,
}

impl Reason {
    /// How many kinds of reason there are.
    pub const KINDS: usize = 10;

    /// The names of the kinds, in the order of [`Counters::rejected`].
    pub const NAMES: [&'static str; Self::KINDS] = [
        "unknown_id",
        "wrong_slot",
        "wrong_state",
        "bad_argument",
        "wrong_mode",
        "sdo_busy",
        "not_in_homing_mode",
        "homing_elsewhere",
        "no_slave",
        "not_enabled",
    ];

    /// The index into [`Counters::rejected`].
    pub const fn kind(self) -> usize {
        match self {
            Self::UnknownId => 0,
            Self::WrongSlot => 1,
            Self::WrongState => 2,
            Self::BadArgument(_) => 3,
            Self::WrongMode => 4,
            Self::SdoBusy => 5,
            Self::NotInHomingMode => 6,
            Self::HomingElsewhere => 7,
            Self::NoSlave => 8,
            Self::NotEnabled => 9,
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownId => f.write_str("no such command"),
            Self::WrongSlot => f.write_str("not a command for this slot or this kind of slave"),
            Self::WrongState => f.write_str("not allowed in this state"),
            Self::BadArgument(what) => what.fmt(f),
            Self::WrongMode => f.write_str("the drive is in another mode (see DRIVE_MODE and 0x6060)"),
            Self::SdoBusy => f.write_str("a newer SDO has taken its place (wait for each answer)"),
            Self::NotInHomingMode => f.write_str("the drive is not in homing mode (write 0x6060 = 6 first)"),
            Self::HomingElsewhere => f.write_str("another slave is homing"),
            Self::NoSlave => f.write_str("no slave at that place (see SET_AXIS and the slave count it answers)"),
            Self::NotEnabled => f.write_str("the drive is not on (send SV_ON and wait for Operation enabled first)"),
        }
    }
}

/// A rejected command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rejection {
    /// When it was rejected, in board time.
    pub at: Ns,
    /// The slot that held the command.
    pub slot: u8,
    /// The id of the command.
    pub id: CommandId,
    /// Why it was rejected.
    pub reason: Reason,
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} in slot {} rejected at {}: {}", self.id, self.slot, Seconds(self.at), self.reason)
    }
}

/// The counters of a board since it was switched on. The wire does not show them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Command frames that arrived.
    pub frames: u64,
    /// Reports that were made.
    pub reports: u64,
    /// Commands that were rejected, by [`Reason::kind`].
    pub rejected: [u64; Reason::KINDS],
    /// Commands that were ignored because their slave was homing, because its mode was being restored after homing, or, GO_HOME,
    /// because of an ABORT_HOME in the same frame.
    pub ignored_homing: u64,
    /// How often the mode of operation could not be restored after homing, so that the drive has stayed in homing mode.
    pub modes_not_restored: u64,
    /// Commands whose targets were discarded because the axis was not in Operation enabled.
    pub discarded_before_enabled: u64,
    /// Commands that did not reach their slave: it was lost before or after they were executed, or it had left OP before
    /// the others.
    pub for_lost: u64,
    /// FIFO entries that were dropped by SET_FIFO 1 or by leaving OP.
    pub cleared: u64,
    /// Frames that were lost because the FIFO was full.
    pub full: u64,
    /// Frames with a wrong CRC.
    pub crc: u64,
    /// Frames that did not arrive completely.
    pub incomplete: u64,
    /// FIFO entries that were executed.
    pub executed: u64,
    /// Cycles in OP that took no entry, because the FIFO was empty or below its threshold.
    pub idle_cycles: u64,
    /// SDO requests that repeat the one under way, as programs that poll send them. They are part of that transfer, and
    /// nothing is lost.
    pub sdo_repeated: u64,
    /// Cycles that made no report because a bus that takes outputs ahead has lost their answers.
    pub answers_lost: u64,
    /// Sets of outputs that a bus had taken and has given up: what they held was not sent for all that is known, or some slave has
    /// missed it and nobody knows which one.
    pub outputs_lost: u64,
    /// Cycles that were left out because the machine was too late for them, on a bus whose cycles are not caught up on: what moves
    /// has stood still for so long.
    pub cycles_left_out: u64,
    /// Cycles in OP in which the ring of cables was broken, on a bus with a card at each end. Nothing is lost by that; another cut
    /// would cost slaves.
    pub ring_broken: u64,
    /// Cycles in OP in which some slave that was not lost kept its inputs of before, since the working counter beside the new ones was
    /// wrong, or may have been.
    pub inputs_held: u64,
    /// How often the inputs of a slave have become stale: it is lost then ([`STALE_AFTER`](crate::fieldbus::STALE_AFTER)).
    pub inputs_stale: u64,
    /// SDO transfers of the host that the slave has aborted, or that were not answered in time.
    pub sdo_aborted: u64,
    /// Command frames that arrived while the board booted, after a SW_RESET that the host had not noticed yet. They are
    /// not among [`Counters::frames`].
    pub while_booting: u64,
}

impl Counters {
    /// How many commands were rejected, for whatever reason.
    pub fn rejected_total(&self) -> u64 {
        self.rejected.iter().sum()
    }
}

/// Something that people may want to know and that the wire does not show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A command was not executed.
    Rejected(Rejection),
    /// SET_DC had a Data2 that no guide mentions; it was accepted (SK-4 \[OURS]).
    OddDcShift {
        /// When it happened, in board time.
        at: Ns,
        /// The value of Data2.
        data2: u32,
    },
    /// DRIVE_MODE had a Data2 that no guide mentions; it was taken for DC sync (SK-4 \[OURS]).
    OddDriveType {
        /// When it happened, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
        /// The value of Data2.
        data2: u32,
    },
    /// A command frame did not arrive completely and was dropped (CONFIG3, SK-5).
    Incomplete {
        /// When it happened, in board time.
        at: Ns,
        /// How many bytes came.
        bytes: u16,
    },
    /// A slave in SafeOP or OP does not answer any more (SK-4).
    SlaveLost {
        /// When it happened, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
    },
    /// A slave has left SafeOP or OP by itself, and says why. It is lost.
    SlaveFell {
        /// When it happened, in board time.
        at: Ns,
        /// Which one, and why.
        fall: SlaveFall,
    },
    /// Another master sends frames on the network. Logged once.
    OtherMaster {
        /// When it was seen, in board time.
        at: Ns,
        /// The source address of its frames, as slaves have changed it.
        address: [u8; 6],
    },
    /// The inputs of a slave that answers have not come for too long, since the working counter beside them is wrong. It is lost.
    InputsStale {
        /// When it happened, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
    },
    /// The working counter of a cycle in OP was too low, and the bus does not name the slaves that did not answer, or it was too
    /// high. Logged once, until the working counter is right again.
    WorkingCounter {
        /// When it happened, in board time.
        at: Ns,
        /// The working counter.
        counted: u16,
        /// What it is when every slave answers.
        expected: u16,
    },
    /// A bus that takes outputs ahead has lost answers, because they were not polled in time. They made no report.
    AnswersLost {
        /// When it happened, in board time.
        at: Ns,
        /// How many cycles in a row.
        cycles: u32,
    },
    /// The hardware that runs the bus does not answer any more. Logged once, until it answers.
    BusDown {
        /// When it happened, in board time.
        at: Ns,
    },
    /// A bus that takes outputs ahead has given some up: targets in them may not have reached the slaves.
    OutputsLost {
        /// When it happened, in board time.
        at: Ns,
        /// How many sets of outputs, each of a cycle.
        sets: u32,
        /// A chip runs the bus.
        has_chip: bool,
    },
    /// A slave has left OP because the bus configured other slaves. It returns to OP with them, its motors and outputs
    /// off (SK-4 \[OURS]).
    SlaveDisturbed {
        /// When it happened, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
    },
    /// A change of state has failed and left a slave in a lower state than the others (SK-4 \[OURS]).
    SlaveLeft {
        /// When it happened, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
    },
    /// A change of state has failed (SK-4): the state byte is the last state that all slaves reached, plus 0x10.
    StateFailed {
        /// When it happened, in board time.
        at: Ns,
        /// Why.
        why: StateFailure,
    },
    /// The homing of an axis has ended.
    HomingEnded {
        /// When it happened, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
        /// The axis of the slave, from 0.
        axis: u8,
        /// How it ended.
        end: HomingEnd,
    },
    /// The board could not restore the mode of DRIVE_MODE after homing; the drive has stayed in homing mode (SK-7 \[OURS]).
    ModeNotRestored {
        /// When it happened, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
        /// The axis of the slave, from 0.
        axis: u8,
        /// The abort code of the last attempt.
        code: AbortCode,
    },
    /// An SDO transfer of the host was aborted; the abort code is in the SDO slot (SK-6).
    SdoAborted {
        /// When it happened, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
        /// The object of the transfer.
        object: ObjectAddress,
        /// True: a download; false: an upload.
        write: bool,
        /// The abort code.
        code: AbortCode,
    },
    /// A line of a script was carried out.
    Scripted {
        /// When it happened, in board time.
        at: Ns,
        /// The line, from 1.
        line: u32,
        /// The verb of the line.
        verb: &'static str,
        /// The slave, from 1; `None`: it happened to the cable or to the board.
        slave: Option<u8>,
        /// The error code, AL status code or abort code that the slave shows from now on.
        code: Option<u32>,
        /// The time of the line is over, and its effect has ended.
        ended: bool,
    },
}

impl Event {
    /// The same with its time counted from `zero`, on the board's clock.
    pub fn since(mut self, zero: Ns) -> Self {
        let at = match &mut self {
            Self::Rejected(Rejection { at, .. })
            | Self::OddDcShift { at, .. }
            | Self::OddDriveType { at, .. }
            | Self::Incomplete { at, .. }
            | Self::SlaveLost { at, .. }
            | Self::SlaveFell { at, .. }
            | Self::OtherMaster { at, .. }
            | Self::InputsStale { at, .. }
            | Self::WorkingCounter { at, .. }
            | Self::AnswersLost { at, .. }
            | Self::BusDown { at }
            | Self::OutputsLost { at, .. }
            | Self::SlaveDisturbed { at, .. }
            | Self::SlaveLeft { at, .. }
            | Self::StateFailed { at, .. }
            | Self::HomingEnded { at, .. }
            | Self::ModeNotRestored { at, .. }
            | Self::SdoAborted { at, .. }
            | Self::Scripted { at, .. } => at,
        };
        *at = at.saturating_sub(zero);
        self
    }
}

/// The advice for an object that a slave does not have.
const MAKERS_OBJECTS: &str = "; if the real drive has it, give the simulated one its maker's objects: \
                              slaves=drive:objects@FILE, or drive:objects@any, which stores what it is told";

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rejected(rejection) => rejection.fmt(f),
            Self::OddDcShift { at, data2 } => write!(
                f,
                "SET_DC at {} has Data2 = 0x{data2:08X}: accepted, though the guides print 0xFFFF and 0xFFFF0000 only",
                Seconds(*at)
            ),
            Self::OddDriveType { at, slave, data2 } => write!(
                f,
                "DRIVE_MODE of slave {slave} at {} has Data2 = 0x{data2:08X}: taken for 1, DC sync, though the guides print 0 \
                 and 1 only",
                Seconds(*at)
            ),
            Self::StateFailed { at, why } => write!(f, "a change of state has failed at {}: {why}", Seconds(*at)),
            Self::HomingEnded { at, slave, axis, end } => {
                write!(f, "homing of slave {slave}, axis {}, at {}: {end}", axis + 1, Seconds(*at))
            }
            Self::ModeNotRestored { at, slave, axis, code } => write!(
                f,
                "the mode of slave {slave}, axis {}, could not be restored after homing at {} ({code}): write 0x{:04X}",
                axis + 1,
                Seconds(*at),
                MODES_OF_OPERATION + SECOND_AXIS_OFFSET * u16::from(*axis)
            ),
            Self::SdoAborted { at, slave, object, write, code } => {
                let id = if *write { CommandId::SdoWrite } else { CommandId::SdoRead };
                write!(f, "{id} of slave {slave}, {object}, aborted at {}: {code}", Seconds(*at))?;
                match *code {
                    AbortCode::NO_OBJECT | AbortCode::NO_SUB_INDEX => f.write_str(MAKERS_OBJECTS),
                    _ => Ok(()),
                }
            }
            Self::Scripted { at, line, verb, slave, code, ended } => {
                let end = if *ended { "the end of " } else { "" };
                write!(f, "script, line {line}: {end}`{verb}")?;
                if let Some(slave) = slave {
                    write!(f, " {slave}")?;
                }
                if let Some(code) = code {
                    write!(f, " 0x{code:04X}")?;
                }
                write!(f, "` at {}", Seconds(*at))
            }
            Self::Incomplete { at, bytes } => write!(
                f,
                "command frame dropped at {}: only {bytes} bytes came within {INCOMPLETE_CYCLES} cycles; send whole \
                 frames, or pull CONFIG3 low",
                Seconds(*at)
            ),
            Self::SlaveLeft { at, slave } => write!(
                f,
                "slave {slave} is in a lower state than the others since a change that failed, seen at {}: send SET_STATE \
                 to bring it back",
                Seconds(*at)
            ),
            Self::InputsStale { at, slave } => write!(
                f,
                "the inputs of slave {slave} are stale at {}: they do not come, or with a wrong working counter; its axes are stopped; \
                 look at its cables (`ecmsk bus errors`), then send SET_STATE to bring it back",
                Seconds(*at)
            ),
            Self::WorkingCounter { at, counted, expected } if counted > expected => write!(
                f,
                "working counter {counted} instead of {expected} at {}, which slaves cannot add: something changes frames on their way; \
                 what they bring is not believed",
                Seconds(*at)
            ),
            Self::WorkingCounter { at, counted, expected } => write!(
                f,
                "working counter {counted} instead of {expected} at {}: not every slave answers; look at the cable and at \
                 the slaves' power",
                Seconds(*at)
            ),
            Self::AnswersLost { at, cycles } => write!(
                f,
                "the answers of {cycles} cycles before {} were not there in time: this machine was late, or frames are lost on \
                 the cable; no outputs are lost with them",
                Seconds(*at)
            ),
            Self::BusDown { at } => write!(
                f,
                "the network does not answer at {}: look at its wires and its power; when it answers \
                 again, send SET_STATE to bring the slaves back",
                Seconds(*at)
            ),
            Self::OutputsLost { at, sets, has_chip: true } => write!(
                f,
                "the outputs of {sets} cycles before {} may not have reached the slaves: exchanges with the chip fail, or \
                 frames on the cable are lost; look at its wires and at the cable",
                Seconds(*at)
            ),
            Self::OutputsLost { at, sets, has_chip: false } => write!(
                f,
                "the outputs of {sets} cycles before {} may not have reached the slaves: frames on the cable are lost; look at \
                 the cables (`ecmsk bus errors`)",
                Seconds(*at)
            ),
            Self::SlaveFell { at, fall } => write!(f, "at {}: {fall}", Seconds(*at)),
            Self::OtherMaster { at, address: [a, b, c, d, e, g] } => write!(
                f,
                "another master sends frames on this network (from {a:02X}:{b:02X}:{c:02X}:{d:02X}:{e:02X}:{g:02X}), seen at {}: \
                 each of the two disturbs the slaves of the other; stop it, or this program",
                Seconds(*at)
            ),
            Self::SlaveDisturbed { at, slave } => write!(
                f,
                "slave {slave} left OP at {} because the bus configured others: its motors and outputs are off until they \
                 are switched on again",
                Seconds(*at)
            ),
            Self::SlaveLost { at, slave } => write!(
                f,
                "slave {slave} lost at {}: look at its power and its cable, then send SET_STATE to bring it back",
                Seconds(*at)
            ),
        }
    }
}

/// The newest events.
#[derive(Clone, Debug)]
pub(super) struct EventLog {
    ring: [Option<Event>; Self::KEPT],
    total: u64,
}

impl EventLog {
    /// How many events are kept.
    const KEPT: usize = 32;

    pub(super) const fn new() -> Self {
        Self { ring: [None; Self::KEPT], total: 0 }
    }

    pub(super) fn push(&mut self, event: Event) {
        self.ring[(self.total % Self::KEPT as u64) as usize] = Some(event);
        self.total += 1;
    }

    /// How many events there were so far.
    pub(super) const fn total(&self) -> u64 {
        self.total
    }

    /// The events from number `from` on that are still kept, oldest first.
    pub(super) fn since(&self, from: u64) -> impl Iterator<Item = Event> {
        let oldest = self.total.saturating_sub(Self::KEPT as u64).max(from);
        (oldest..self.total).filter_map(|n| self.ring[(n % Self::KEPT as u64) as usize])
    }
}
