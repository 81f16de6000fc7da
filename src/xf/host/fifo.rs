//! Estimates the free entries of the RxFIFO from level counts that lag behind.

/// The number of exchanges by which the RxFIFO level in an answer's header lags behind the FIFO (OBS).
const COUNT_LAG: u8 = 2;

/// A write of RxPDOs into the FIFO that the level in the newest answer may not include yet.
#[derive(Clone, Copy, Debug, Default)]
struct Write {
    sequence: u32,
    pdos: u8,
    /// The number of the exchange in which the last copy of the write was sent.
    exchange: u64,
    /// Number of answers received in exchanges after `exchange`. After [`COUNT_LAG`] such answers the reported level
    /// includes the write.
    answers: u8,
}

/// The estimate of the free entries of the RxFIFO: its capacity, less the level in the newest answer, less the writes
/// that this level may not include yet. The estimate is never too high, at whatever time a write reached the chip. It
/// may be too low: each cycle frees an entry, and the level shows this later.
#[derive(Clone, Debug)]
pub(super) struct RxFreeEstimate {
    pub(super) entries: u8,
    count: u8,
    writes: [Option<Write>; 4],
}

impl RxFreeEstimate {
    pub(super) const fn new(entries: u8) -> Self {
        Self { entries, count: 0, writes: [None; 4] }
    }

    /// Number of RxFIFO entries that are certainly free.
    pub(super) fn free(&self) -> u8 {
        let unseen = self.writes.iter().flatten().fold(0u8, |sum, write| sum.saturating_add(write.pdos));
        self.entries.saturating_sub(self.count).saturating_sub(unseen)
    }

    /// Records that a copy of a write is sent. If there is no room to record it, the oldest write is removed from the
    /// list and its PDOs are added to the level.
    pub(super) fn wrote(&mut self, sequence: u32, pdos: u8, exchange: u64) {
        if pdos == 0 {
            return;
        }
        let write = Write { sequence, pdos, exchange, answers: 0 };
        let known = self.writes.iter().position(|known| known.is_some_and(|known| known.sequence == sequence));
        let place = known.or_else(|| self.writes.iter().position(Option::is_none));
        let place = place.unwrap_or_else(|| {
            let oldest = (0..self.writes.len()).min_by_key(|i| self.writes[*i].map_or(0, |write| write.exchange));
            let oldest = oldest.unwrap_or(0);
            self.count = self.count.saturating_add(self.writes[oldest].map_or(0, |write| write.pdos));
            oldest
        });
        self.writes[place] = Some(write);
    }

    /// Records that a write was certainly not executed.
    pub(super) fn not_written(&mut self, sequence: u32) {
        for write in &mut self.writes {
            *write = write.filter(|write| write.sequence != sequence);
        }
    }

    /// Records the RxFIFO level `count` from the answer received in exchange number `exchange`.
    pub(super) fn answer(&mut self, exchange: u64, count: u8) {
        self.count = count;
        for place in &mut self.writes {
            if let Some(write) = place
                && write.exchange < exchange
            {
                write.answers += 1;
                if write.answers >= COUNT_LAG {
                    *place = None;
                }
            }
        }
    }

    /// Forgets all writes that the level may not include yet, because the FIFO was emptied.
    pub(super) fn cleared(&mut self) {
        self.writes = [None; 4];
    }
}
