//! What the driver counts.

/// Counts since the driver was made. All of them only rise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Exchanges, those of the search not counted.
    pub exchanges: u64,
    /// Answers with right words around them and a right check word.
    pub answers: u64,
    /// Answers that were damaged or did not come.
    pub damaged: u64,
    /// Answers that say "not ready".
    pub not_ready: u64,
    /// Answers with the NOP flag.
    pub nops: u64,
    /// Answers to no command that waits for one: late, doubled, or to a command that was never sent.
    pub stray: u64,
    /// Packets that were sent once more, with the same index and code, so that the chip runs them once.
    pub repeated: u64,
    /// Packets of ours that the chip found damaged, as far as its count of CRC errors and its error bits show.
    pub rejected: u64,
    /// Commands that only read, asked again under a new index since their answer was lost.
    pub asked_again: u64,
    /// Commands that ran and whose answer was lost.
    pub answers_lost: u64,
    /// How often the beginning of packets was searched.
    pub searches: u64,
    /// How often the chip was reset while the driver ran.
    pub chip_resets: u64,
    /// Waits for INT0 in vain.
    pub int0_missed: u64,
    /// RxPDOs that are in the FIFO, or were put out past it.
    pub rx_written: u64,
    /// RxPDOs that the chip did not take since the FIFO was full.
    pub rx_full: u64,
    /// RxPDOs that were not written and are not repeated, since later ones have been.
    pub rx_dropped: u64,
    /// RxPDOs of which nobody knows whether they were written.
    pub rx_unknown: u64,
    /// Answers with TxPDOs that were lost.
    pub tx_lost: u64,
    /// Reports about process data that nobody took in time.
    pub reports_overwritten: u64,
}
