//! The counters of a board, mainly of commands that did not reach their slaves, and the reasons for which commands are
//! rejected. Reports show only some of the counters.

use std::fmt;

use crate::sk::InvalidArgument;

/// Why a command was rejected (SK-4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Reason {
    /// The command id is none of the 22 ids that the board knows.
    UnknownId,
    /// The command is not allowed in this slot, or not for this kind of slave.
    WrongSlot,
    /// The state of the network does not allow the command.
    WrongState,
    /// An argument has a value that the board's manuals do not allow.
    BadArgument(InvalidArgument),
    /// CSP, CSV or CST is not the command for the mode that DRIVE_MODE has set, or 0x6060 has another value than that mode.
    WrongMode,
    /// An SDO request was waiting for the end of a running transfer, and a newer request has replaced it.
    SdoBusy,
    /// GO_HOME came for a drive whose mode of operation is not homing (6).
    NotInHomingMode,
    /// GO_HOME came while another slave was homing.
    HomingElsewhere,
    /// No slave has that number, or SET_AXIS has declared the slave as not used.
    NoSlave,
    /// GO_HOME came for a drive that SV_ON has not brought to Operation enabled.
    NotEnabled,
}

impl Reason {
    /// The number of counters in [`Counters::rejected`]: one for each variant.
    pub const KINDS: usize = 10;

    /// The names of the variants in the order of [`Counters::rejected`], for users.
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

    /// The index of the reason in [`Counters::rejected`].
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

/// The counters of a board since it was switched on. Reports do not carry most of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Command frames that the board has received.
    pub frames: u64,
    /// Reports that the board has made.
    pub reports: u64,
    /// Rejected commands, one counter for each reason, indexed by [`Reason::kind`].
    pub rejected: [u64; Reason::KINDS],
    /// Commands that were ignored because their slave was homing or its mode was being restored after homing. Also each
    /// GO_HOME that was ignored because of an ABORT_HOME in the same frame.
    pub ignored_homing: u64,
    /// How often the mode of operation could not be restored after homing, so that the drive stays in homing mode.
    pub modes_not_restored: u64,
    /// Commands whose targets were discarded because the axis was not in Operation enabled.
    pub discarded_before_enabled: u64,
    /// Commands that did not reach their slave. The slave was lost before the command was executed or before its outputs
    /// were sent, or it had left OP before the other slaves. It is an upper bound: a command counts unless it is known to
    /// have reached the slave.
    pub for_lost: u64,
    /// FIFO entries that were dropped by SET_FIFO 1, or because the network left OP.
    pub cleared: u64,
    /// Command frames that were lost because the FIFO was full.
    pub full: u64,
    /// Command frames with a wrong CRC.
    pub crc: u64,
    /// Command frames that did not arrive completely.
    pub incomplete: u64,
    /// FIFO entries that were executed.
    pub executed: u64,
    /// Cycles in OP that took no FIFO entry, because the FIFO was empty or had not reached its threshold.
    pub idle_cycles: u64,
    /// SDO requests that repeat the transfer under way, as polling programs send them. Each counts as part of that
    /// transfer; nothing is lost.
    pub sdo_repeated: u64,
    /// Cycles without a report, because a bus that queues outputs (a chip or a network card) has lost the slaves' answers of
    /// these cycles.
    pub answers_lost: u64,
    /// Sets of outputs, each for one cycle, that a bus (a chip or a network card) had queued and then gave up. Either
    /// they were not sent as far as is known, or a slave did not get them and the bus does not know which slave.
    pub outputs_lost: u64,
    /// Cycles that were skipped because the machine was late, on a bus that does not catch up on cycles. Motion stood
    /// still for as many cycles.
    pub cycles_left_out: u64,
    /// Cycles in OP in which the ring of cables was broken, on a bus with a network card at each end. No data are lost,
    /// but a second cut would disconnect slaves.
    pub ring_broken: u64,
    /// Cycles in OP in which a slave that was not lost kept its previous inputs, because the working counter of its new
    /// inputs was wrong or may have been wrong.
    pub inputs_held: u64,
    /// How often the inputs of a slave have become stale, so that it counted as lost
    /// ([`STALE_AFTER`](crate::fieldbus::STALE_AFTER)).
    pub inputs_stale: u64,
    /// SDO transfers of the host that the slave has aborted, or has not answered in time.
    pub sdo_aborted: u64,
    /// Command frames that arrived while the board booted, because the host had not noticed yet that the board was reset. They
    /// are not executed, and [`Counters::frames`] does not include them.
    pub while_booting: u64,
}

impl Counters {
    /// The number of rejected commands, of all reasons together.
    pub fn rejected_total(&self) -> u64 {
        self.rejected.iter().sum()
    }
}
