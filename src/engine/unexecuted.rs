//! Why a command that was not rejected may have no effect, or a late one. Each cause has a counter.

use super::Counters;

/// A cause why commands were not executed, or late, or may fail soon, although the board did not reject them (for
/// rejections see [`Reason`](super::Reason)). Each cause has a counter in [`Counters`] (SK-4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Unexecuted {
    /// [`Counters::full`]: the command FIFO had no room for the frame.
    Full,
    /// [`Counters::crc`]: the CRC of the frame was wrong, and CRC checking is on.
    Crc,
    /// [`Counters::incomplete`]: the frame did not arrive completely.
    Incomplete,
    /// [`Counters::while_booting`]: the board was booting after SW_RESET.
    WhileBooting,
    /// [`Counters::ignored_homing`]: the slave was homing, or its mode was being restored.
    IgnoredHoming,
    /// [`Counters::discarded_before_enabled`]: the target of a CSP, CSV or CST came while the drive was not in
    /// Operation enabled, where a drive follows no target.
    BeforeEnabled,
    /// [`Counters::for_lost`]: the slave was lost, or had left OP.
    ForLost,
    /// [`Counters::cleared`]: the entry was in the FIFO when SET_FIFO 1 cleared it, or when the network left OP.
    Cleared,
    /// [`Counters::sdo_aborted`]: an SDO transfer was started, and the slave aborted it or did not answer.
    SdoAborted,
    /// [`Counters::outputs_lost`]: a bus that queues outputs has dropped some of them, or a slave has missed them.
    OutputsLost,
    /// [`Counters::cycles_left_out`]: the machine was late and skipped cycles. No command was lost, but commands are
    /// executed late.
    LeftOut,
    /// [`Counters::ring_broken`]: a cycle ran with a cut cable in the ring. No command was lost, but a second cut would
    /// disconnect slaves.
    RingBroken,
    /// [`Counters::inputs_held`]: no command was lost, but the working counter was wrong, so that reports showed the
    /// previous inputs of slaves.
    InputsHeld,
    /// [`Counters::inputs_stale`]: slaves count as lost because they have sent no valid inputs for too long.
    InputsStale,
}

impl Unexecuted {
    /// The number of causes.
    pub const KINDS: usize = 14;

    /// All causes, in the order of their variants.
    pub const ALL: [Self; Self::KINDS] = [
        Self::Full,
        Self::Crc,
        Self::Incomplete,
        Self::WhileBooting,
        Self::IgnoredHoming,
        Self::BeforeEnabled,
        Self::ForLost,
        Self::Cleared,
        Self::SdoAborted,
        Self::OutputsLost,
        Self::LeftOut,
        Self::RingBroken,
        Self::InputsHeld,
        Self::InputsStale,
    ];

    /// The counter of this cause in `counters`. [`Self::meaning`] says what it counts: frames, commands, cycles or
    /// slaves.
    pub const fn of(self, counters: &Counters) -> u64 {
        match self {
            Self::Full => counters.full,
            Self::Crc => counters.crc,
            Self::Incomplete => counters.incomplete,
            Self::WhileBooting => counters.while_booting,
            Self::IgnoredHoming => counters.ignored_homing,
            Self::BeforeEnabled => counters.discarded_before_enabled,
            Self::ForLost => counters.for_lost,
            Self::Cleared => counters.cleared,
            Self::SdoAborted => counters.sdo_aborted,
            Self::OutputsLost => counters.outputs_lost,
            Self::LeftOut => counters.cycles_left_out,
            Self::RingBroken => counters.ring_broken,
            Self::InputsHeld => counters.inputs_held,
            Self::InputsStale => counters.inputs_stale,
        }
    }

    /// The name of the counter of this cause, for JSON and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Crc => "crc",
            Self::Incomplete => "incomplete",
            Self::WhileBooting => "while_booting",
            Self::IgnoredHoming => "ignored_homing",
            Self::BeforeEnabled => "discarded_before_enabled",
            Self::ForLost => "for_lost",
            Self::Cleared => "cleared",
            Self::SdoAborted => "sdo_aborted",
            Self::OutputsLost => "outputs_lost",
            Self::LeftOut => "cycles_left_out",
            Self::RingBroken => "ring_broken",
            Self::InputsHeld => "inputs_held",
            Self::InputsStale => "inputs_stale",
        }
    }

    /// The meaning of the count, as text to follow the number: `3 command frame(s) found the FIFO full and were lost`.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::Full => "command frame(s) found the FIFO full and were lost",
            Self::Crc => "command frame(s) with a wrong CRC were not executed",
            Self::Incomplete => "command frame(s) did not arrive completely and were dropped",
            Self::WhileBooting => "command frame(s) came while the board was booting and were lost",
            Self::IgnoredHoming => "command(s) for a slave that was homing were ignored",
            Self::BeforeEnabled => "target(s) for a drive that was not on were discarded",
            Self::ForLost => "command(s) may not have reached their slave, which was lost or had left OP",
            Self::Cleared => "queued command frame(s) were cleared unexecuted",
            Self::SdoAborted => "SDO transfer(s) were aborted by the slave",
            Self::OutputsLost => "set(s) of outputs may not have reached the slaves",
            Self::LeftOut => "cycle(s) were left out because this machine was late: what was moving has paused",
            Self::RingBroken => {
                "cycle(s) ran with a broken ring of cables: nothing is lost, but another cut would cost slaves"
            }
            Self::InputsHeld => {
                "cycle(s) had a wrong working counter: what slaves sent in them was not believed, and their values of before stayed"
            }
            Self::InputsStale => "slave(s) were lost because their inputs did not come, though they answer",
        }
    }

    /// Advice for users about this cause.
    pub const fn advice(self) -> &'static str {
        match self {
            Self::Full => {
                "send one command frame for each report, or pause while bytes 8..9 of slot 0 show few free entries"
            }
            Self::Crc => "fill byte 3 of slot 0 with the CRC, last, or switch the check off (SET_EX, then SW_RESET)",
            Self::Incomplete => "send whole frames, or pull CONFIG3 low",
            Self::WhileBooting => "open the board again after SW_RESET",
            Self::IgnoredHoming => {
                "wait for statusword bits 10 and 12, and until the drive's mode is back, before the next command"
            }
            Self::BeforeEnabled => "send SV_ON and wait until the statusword shows Operation enabled (...37h)",
            Self::ForLost => {
                "before leaving OP wait until the FIFO is empty (all entries free); if a slave was lost, look at its power and its cable, \
                 then send SET_STATE to bring it back"
            }
            Self::Cleared => "wait until the FIFO is empty (all entries free) before SET_FIFO 1 and before leaving OP",
            Self::SdoAborted => "look at bit 15 of the answer's Parm: Data2 is then the abort code",
            Self::OutputsLost => {
                "frames on the cable are lost, or what goes to the board that sends them; look at the cables and the wires"
            }
            Self::LeftOut => {
                "give the cycle a priority and a processor of its own (priority=, cpu=), and see `ecmsk doctor`"
            }
            Self::RingBroken => "look at the cables between the slaves, and at those to both network cards",
            Self::InputsHeld => "look for a bad cable or a slave without power (`ecmsk bus errors`)",
            Self::InputsStale => {
                "look at their cables (`ecmsk bus errors`), and whether another program uses the network; then SET_STATE brings them back"
            }
        }
    }

    /// Whether the program has caused the loss on purpose: by SET_FIFO 1, or by leaving OP.
    pub const fn is_asked_for(self) -> bool {
        matches!(self, Self::Cleared)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SK-4.78 The text for a command that missed a slave because the slave had left OP does not name lost slaves
    /// alone, and begins with the advice.
    #[test]
    fn leaving_op_is_no_loss_of_a_slave() {
        let (meaning, advice) = (Unexecuted::ForLost.meaning(), Unexecuted::ForLost.advice());
        assert!(meaning.contains("lost or had left OP"), "{meaning}");
        assert!(advice.starts_with("before leaving OP wait") && advice.contains("if a slave was lost"), "{advice}");
    }
}
