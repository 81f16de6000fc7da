//! Marks in byte 1 of slave slots, by which a host knows its own entry in the FIFO: firmware 1.7 repeats the index of a
//! command, GET_STATUS too, in the report of the cycle that executed it (SK-3).
//!
//! Every frame that carries a command has a mark of its own in all of its slave slots. A mark that comes back in any of them
//! says: this frame arrived and was executed. A slave that does not repeat it while others do has been lost. Firmware 1.5
//! shows the mode there: then the count of entries has to do, which a frame that is lost on the way brings out of step.

/// The marks: none that firmware 1.5 would show as a mode. \[OURS]
const FIRST: u8 = 0x20;
/// \[OURS] Frames that ran without coming back, until the board is known to repeat no index.
const MISSED: u8 = 2;

/// Whether the board repeats indexes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Echo {
    Unknown,
    Yes,
    No,
}

pub(super) struct Marks {
    pub(super) echo: Echo,
    last: u8,
    /// A bit of each mark that came back since it was given.
    seen: [u64; 4],
    /// Data1 of slot 0 in the report that showed it first.
    results: [u32; 256],
    missed: u8,
    /// Calls that wait for one.
    pub(super) awaited: u32,
}

impl Marks {
    pub(super) const fn new() -> Self {
        Self { echo: Echo::Unknown, last: FIRST, seen: [0; 4], results: [0; 256], missed: 0, awaited: 0 }
    }

    /// The next frame's mark; that it came back once before is forgotten.
    pub(super) fn give(&mut self) -> u8 {
        self.last = self.last.checked_add(1).unwrap_or(FIRST);
        self.seen[usize::from(self.last / 64)] &= !(1 << (self.last % 64));
        self.last
    }

    /// A slot of a report shows that byte; whether it is a mark that is seen for the first time.
    pub(super) fn see(&mut self, index: u8, result: u32) -> bool {
        if index < FIRST || self.saw(index) {
            return false;
        }
        self.seen[usize::from(index / 64)] |= 1 << (index % 64);
        self.results[usize::from(index)] = result;
        if index == self.last {
            (self.echo, self.missed) = (Echo::Yes, 0);
        }
        true
    }

    /// Whether the frame of that mark was executed.
    pub(super) const fn saw(&self, mark: u8) -> bool {
        self.seen[(mark / 64) as usize] & 1 << (mark % 64) != 0
    }

    /// The board's result when it was executed.
    pub(super) const fn result(&self, mark: u8) -> u32 {
        self.results[mark as usize]
    }

    /// A frame ran, by the count of entries, and its mark did not come back.
    pub(super) fn miss(&mut self) {
        if self.echo == Echo::Unknown {
            self.missed += 1;
            if self.missed >= MISSED {
                self.echo = Echo::No;
            }
        }
    }

    /// Whether the answers to commands with the index [`Marks::PROBE`] show it, outside OP.
    pub(super) const fn learn(&mut self, echoes: bool) {
        self.echo = if echoes { Echo::Yes } else { Echo::No };
    }

    /// An index for [`Marks::learn`].
    pub(super) const PROBE: u8 = FIRST;
}
