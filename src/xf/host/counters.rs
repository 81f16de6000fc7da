//! The driver's counters of exchanges, errors and process data.

/// Counters since the driver was created. They never decrease.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HostCounters {
    /// Exchanges, except those of the search for packets.
    pub exchanges: u64,
    /// Answers with a valid start word, end word and check word.
    pub answers: u64,
    /// Answers that were damaged or did not come.
    pub damaged: u64,
    /// Answers that say "not ready".
    pub not_ready: u64,
    /// Answers with the NOP flag set, which carry no result: the chip took the packet for a repetition, or rejected it.
    pub nops: u64,
    /// Answers that no command in flight waits for: late, duplicate, or to a command that was never sent.
    pub stray: u64,
    /// Retries: packets sent again with the same index and code, so that the chip runs them only once.
    pub repeated: u64,
    /// Packets from this driver that the chip found damaged, as far as its CRC error count and error bits show it.
    pub rejected: u64,
    /// Read-only commands that were sent again under a new index because their answer was lost.
    pub asked_again: u64,
    /// Commands that ran and whose answer was lost.
    pub answers_lost: u64,
    /// Searches for the beginning of packets.
    pub searches: u64,
    /// Resets of the chip while the driver was running.
    pub chip_resets: u64,
    /// Timeouts of INT0.
    pub int0_missed: u64,
    /// RxPDOs that were written, into the FIFO or directly (PDO_DATA_OP).
    pub rx_written: u64,
    /// RxPDOs that the chip rejected because the FIFO was full.
    pub rx_full: u64,
    /// RxPDOs that were not written and are not retried, since later ones have been sent.
    pub rx_dropped: u64,
    /// RxPDOs for which it is unknown whether they were written.
    pub rx_unknown: u64,
    /// Exchanges whose TxPDOs are lost, because the answer that carried them was damaged.
    pub tx_lost: u64,
    /// Reports about process data that were overwritten before the program took them.
    pub reports_overwritten: u64,
}
