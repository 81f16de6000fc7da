//! Counters of commands that did not reach their slaves, and the reasons, since the wire does not show all of it.

use std::fmt;

use crate::sk::InvalidArgument;

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
    BadArgument(InvalidArgument),
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
