//! How many PDOs the RxFIFO has room for, from counts that lag behind.

/// By how many exchanges the counts in the header lag behind (OBS).
const COUNT_LAG: u8 = 2;

/// A write that the counts may not show yet.
#[derive(Clone, Copy, Debug, Default)]
struct Write {
    sequence: u32,
    pdos: u8,
    /// The exchange of the last copy.
    exchange: u64,
    /// Answers that came in exchanges behind it.
    answers: u8,
}

/// The estimate. It never says more than there is, whenever the write reached the chip: only cycles that the counts do
/// not show yet make the room larger.
#[derive(Clone, Debug)]
pub(super) struct RxRoom {
    pub(super) entries: u8,
    count: u8,
    writes: [Option<Write>; 4],
}

impl RxRoom {
    pub(super) const fn new(entries: u8) -> Self {
        Self { entries, count: 0, writes: [None; 4] }
    }

    /// PDOs for which there is room for sure.
    pub(super) fn free(&self) -> u8 {
        let unseen = self.writes.iter().flatten().fold(0u8, |sum, write| sum.saturating_add(write.pdos));
        self.entries.saturating_sub(self.count).saturating_sub(unseen)
    }

    /// A copy of a write goes out. If there is no place to remember it, the oldest one makes room, and is counted as
    /// there.
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

    /// A write is known not to have been done.
    pub(super) fn not_written(&mut self, sequence: u32) {
        for write in &mut self.writes {
            *write = write.filter(|write| write.sequence != sequence);
        }
    }

    /// An answer of this exchange has this count.
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

    /// The FIFO was emptied, or the chip was reset.
    pub(super) fn cleared(&mut self) {
        self.writes = [None; 4];
    }
}
