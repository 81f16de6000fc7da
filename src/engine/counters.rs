//! What happened to commands, counted, so that nothing is lost in silence.

use std::fmt;

use super::homing::HomingEnd;
use super::partial_frames::INCOMPLETE_CYCLES;
use super::state_failure::StateFailure;
use crate::cia402::{MODES_OF_OPERATION, SECOND_AXIS_OFFSET};
use crate::coe::{AbortCode, ObjectAddress};
use crate::fieldbus::Ns;
use crate::sk::{CommandId, Malformed};

/// Why a command was not executed (SK-4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Reason {
    /// The id is none of the 22.
    UnknownId,
    /// The command does not belong into that kind of slot, or does not suit that kind of slave.
    WrongSlot,
    /// The state does not allow it.
    WrongState,
    /// An argument no guide allows.
    BadArgument(Malformed),
    /// CSP, CSV or CST in another mode than DRIVE_MODE's or 0x6060's.
    WrongMode,
    /// An SDO transfer is under way.
    SdoBusy,
    /// GO_HOME for a drive that is not in mode 6.
    NotInHomingMode,
    /// GO_HOME while another slave is homing.
    HomingElsewhere,
    /// There is no slave at that place, or it is declared as none.
    NoSlave,
    /// GO_HOME for a drive that is not in Operation enabled by SV_ON.
    NotEnabled,
}

impl Reason {
    /// Kinds of reason.
    pub const KINDS: usize = 10;

    /// Names of the kinds, in the order of [`Counters::rejected`].
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

    /// Index into [`Counters::rejected`].
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
            Self::SdoBusy => f.write_str("an SDO transfer is under way"),
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
    /// When, in board time.
    pub at: Ns,
    /// Slot it stood in.
    pub slot: u8,
    /// Its id.
    pub id: CommandId,
    /// Why.
    pub reason: Reason,
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} in slot {} rejected at {} us: {}", self.id, self.slot, self.at / 1000, self.reason)
    }
}

/// Counters of a board since it booted, outside the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Command frames that arrived.
    pub frames: u64,
    /// Reports made.
    pub reports: u64,
    /// Commands rejected, by [`Reason::kind`].
    pub rejected: [u64; Reason::KINDS],
    /// Commands that came for a slave while it was homing, or while its mode was restored after that.
    pub ignored_homing: u64,
    /// Times the mode after homing could not be written back: the drive has stayed in mode 6.
    pub modes_not_restored: u64,
    /// Targets that came before Operation enabled.
    pub discarded_before_enabled: u64,
    /// Commands that did not reach their slave: it was lost already, was lost while they were on their way, or had left OP
    /// before the others.
    pub for_lost: u64,
    /// FIFO entries dropped by SET_FIFO 1 or by leaving OP.
    pub cleared: u64,
    /// Frames that found the FIFO full.
    pub full: u64,
    /// Frames with a wrong CRC.
    pub crc: u64,
    /// Frames that did not arrive completely.
    pub incomplete: u64,
    /// FIFO entries executed.
    pub executed: u64,
    /// Cycles in OP that took no entry: the FIFO was empty, or waited for its threshold.
    pub idle_cycles: u64,
    /// SDO requests that repeat the one under way, as programs send them that poll: they are one with it, and nothing is lost.
    pub sdo_repeated: u64,
    /// Cycles whose answers a bus that takes outputs ahead has lost: they made no report.
    pub answers_lost: u64,
    /// SDO transfers of the host that the slave has refused with an abort code, or that nobody answered in time.
    pub sdo_aborted: u64,
    /// Command frames that arrived while the board booted, after a SW_RESET that the host had not noticed yet. They are
    /// not among [`Counters::frames`].
    pub while_booting: u64,
}

impl Counters {
    /// All rejections.
    pub fn rejected_total(&self) -> u64 {
        self.rejected.iter().sum()
    }
}

/// Something that people may want to read, because the wire does not show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A command was not executed.
    Rejected(Rejection),
    /// SET_DC came with a Data2 that no guide prints; it was accepted (SK-4 \[OURS]).
    OddDcShift {
        /// When, in board time.
        at: Ns,
        /// Data2.
        data2: u32,
    },
    /// DRIVE_MODE came with a Data2 that no guide prints; it was taken for DC sync (SK-4 \[OURS]).
    OddDriveType {
        /// When, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
        /// Data2.
        data2: u32,
    },
    /// A command frame did not arrive completely and was dropped (CONFIG3, SK-5).
    Incomplete {
        /// When, in board time.
        at: Ns,
        /// Bytes that came.
        bytes: u16,
    },
    /// A slave in SafeOP or OP does not answer any more (SK-4).
    SlaveLost {
        /// When, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
    },
    /// Fewer slaves answered a cycle in OP than should, and the bus does not name those that did not. Told once, until a
    /// cycle is whole again.
    WorkingCounter {
        /// When, in board time.
        at: Ns,
        /// The working counter.
        counted: u16,
        /// What it is when every slave answers.
        expected: u16,
    },
    /// A bus that takes outputs ahead has lost answers, because they were not polled in time; the slots showed none of
    /// them.
    AnswersLost {
        /// When, in board time.
        at: Ns,
        /// Cycles in a row.
        cycles: u32,
    },
    /// A slave has left OP because the bus configured others; it comes back with them, with its motors and outputs off
    /// (SK-4 \[OURS]).
    SlaveDisturbed {
        /// When, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
    },
    /// A change of state that failed has left a slave below the state of the others (SK-4 \[OURS]).
    SlaveLeft {
        /// When, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
    },
    /// A change of state has failed (SK-4), and the state is 0x10 beside the last one that all slaves reached.
    StateFailed {
        /// When, in board time.
        at: Ns,
        /// Why.
        why: StateFailure,
    },
    /// Homing of an axis is over.
    HomingEnded {
        /// When, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
        /// Its axis, from 0.
        axis: u8,
        /// How.
        end: HomingEnd,
    },
    /// The board could not write DRIVE_MODE's mode back after homing; the drive has stayed in mode 6 (SK-7 \[OURS]).
    ModeNotRestored {
        /// When, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
        /// Its axis, from 0.
        axis: u8,
        /// What the newest try ended with.
        code: AbortCode,
    },
    /// An SDO transfer of the host ended in an abort code, which stands in the SDO slot (SK-6).
    SdoAborted {
        /// When, in board time.
        at: Ns,
        /// Slave, from 1.
        slave: u8,
        /// What was to be read or written.
        object: ObjectAddress,
        /// Whether it was to be written.
        write: bool,
        /// Why not.
        code: AbortCode,
    },
    /// A line of a script was carried out.
    Scripted {
        /// When, in board time.
        at: Ns,
        /// The line, from 1.
        line: u32,
        /// Its verb.
        verb: &'static str,
        /// Its time is over, and what it did was taken back.
        ended: bool,
    },
}

/// What to do about an object that a slave does not have.
const MAKERS_OBJECTS: &str = "; if the real drive has it, give the simulated one its maker's objects: \
                              slaves=drive:objects@FILE, or drive:objects@any, which stores what it is told";

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rejected(rejection) => rejection.fmt(f),
            Self::OddDcShift { at, data2 } => write!(
                f,
                "SET_DC at {} us has Data2 = 0x{data2:08X}: accepted, though the guides print 0xFFFF and 0xFFFF0000 only",
                at / 1000
            ),
            Self::OddDriveType { at, slave, data2 } => write!(
                f,
                "DRIVE_MODE of slave {slave} at {} us has Data2 = 0x{data2:08X}: taken for 1, DC sync, though the guides print 0 \
                 and 1 only",
                at / 1000
            ),
            Self::StateFailed { at, why } => write!(f, "a change of state has failed at {} us: {why}", at / 1000),
            Self::HomingEnded { at, slave, axis, end } => {
                write!(f, "homing of slave {slave}, axis {}, at {} us: {end}", axis + 1, at / 1000)
            }
            Self::ModeNotRestored { at, slave, axis, code } => write!(
                f,
                "the mode of slave {slave}, axis {}, could not be restored after homing at {} us ({code}): write 0x{:04X}",
                axis + 1,
                at / 1000,
                MODES_OF_OPERATION + SECOND_AXIS_OFFSET * u16::from(*axis)
            ),
            Self::SdoAborted { at, slave, object, write, code } => {
                let id = if *write { CommandId::SdoWrite } else { CommandId::SdoRead };
                write!(f, "{id} of slave {slave}, {object}, aborted at {} us: {code}", at / 1000)?;
                match *code {
                    AbortCode::NO_OBJECT | AbortCode::NO_SUB_INDEX => f.write_str(MAKERS_OBJECTS),
                    _ => Ok(()),
                }
            }
            Self::Scripted { at, line, verb, ended } => {
                let end = if *ended { "the end of " } else { "" };
                write!(f, "script, line {line}: {end}`{verb}` at {} us", at / 1000)
            }
            Self::Incomplete { at, bytes } => write!(
                f,
                "command frame dropped at {} us: only {bytes} bytes came within {INCOMPLETE_CYCLES} cycles; send whole \
                 frames, or pull CONFIG3 low",
                at / 1000
            ),
            Self::SlaveLeft { at, slave } => write!(
                f,
                "slave {slave} is in a lower state than the others since a change that failed, seen at {} us: send SET_STATE \
                 to bring it back",
                at / 1000
            ),
            Self::WorkingCounter { at, counted, expected } => write!(
                f,
                "working counter {counted} instead of {expected} at {} us: not every slave answers; look at the cable and at \
                 the slaves' power",
                at / 1000
            ),
            Self::AnswersLost { at, cycles } => write!(
                f,
                "the answers of {cycles} cycles before {} us are lost: this machine did not look in time; outputs were sent \
                 all the same",
                at / 1000
            ),
            Self::SlaveDisturbed { at, slave } => write!(
                f,
                "slave {slave} left OP at {} us because the bus configured others: its motors and outputs are off until they \
                 are switched on again",
                at / 1000
            ),
            Self::SlaveLost { at, slave } => write!(
                f,
                "slave {slave} lost at {} us: look at its power and its cable, then send SET_STATE to bring it back",
                at / 1000
            ),
        }
    }
}

/// The last events.
#[derive(Clone, Debug)]
pub(super) struct EventLog {
    ring: [Option<Event>; Self::KEPT],
    total: u64,
}

impl EventLog {
    /// Events kept.
    const KEPT: usize = 32;

    pub(super) const fn new() -> Self {
        Self { ring: [None; Self::KEPT], total: 0 }
    }

    pub(super) fn push(&mut self, event: Event) {
        self.ring[(self.total % Self::KEPT as u64) as usize] = Some(event);
        self.total += 1;
    }

    /// Events so far.
    pub(super) const fn total(&self) -> u64 {
        self.total
    }

    /// Events from number `from` on that are still kept, oldest first.
    pub(super) fn since(&self, from: u64) -> impl Iterator<Item = Event> {
        let oldest = self.total.saturating_sub(Self::KEPT as u64).max(from);
        (oldest..self.total).filter_map(|n| self.ring[(n % Self::KEPT as u64) as usize])
    }
}
