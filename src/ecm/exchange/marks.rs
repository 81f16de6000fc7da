//! Marks: numbers in byte 1 (the index) of the slaves' slots, by which the host recognises its frames. Firmware 1.7
//! repeats the index of a command, also that of GET_STATUS, in the report of the cycle that executed it (SK-3).
//!
//! Every frame with a command has its own mark in the slots of all slaves. A report with the mark in any slot shows
//! that the frame arrived and was executed. A slave that does not repeat the mark while others do is lost. Firmware 1.5
//! has the mode in that byte: then only the count of FIFO entries is left, which is wrong after a frame was lost on the
//! way.

/// The lowest mark, above every mode that firmware 1.5 shows there. \[OURS]
const FIRST: u8 = 0x20;
/// \[OURS] How many frames may be executed, by the count of entries, without returning their marks, until the board
/// counts as one that repeats no index.
const MISSED_MAX: u8 = 2;

/// Whether the board repeats the index of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Echo {
    /// Not known yet.
    Unknown,
    /// The board repeats the index, as firmware 1.7 does.
    Yes,
    /// The board does not repeat the index, as firmware 1.5.
    No,
}

pub struct Marks {
    pub echo: Echo,
    /// The newest mark.
    last: u8,
    /// A bit for each mark, set when a report has returned the mark.
    returned: [u64; 4],
    /// For each mark Data1 of slot 0 in the first report that returned it.
    results: [u32; 256],
    /// The number of frames that were executed without returning their marks.
    missed: u8,
    /// The number of calls that wait for a mark. Without any, reports need not be searched for marks.
    pub awaited: u32,
}

impl Marks {
    pub const fn new() -> Self {
        Self { echo: Echo::Unknown, last: FIRST, returned: [0; 4], results: [0; 256], missed: 0, awaited: 0 }
    }

    /// Returns a mark for the next frame, and clears the record of its previous use.
    pub fn next(&mut self) -> u8 {
        self.last = self.last.checked_add(1).unwrap_or(FIRST);
        self.returned[usize::from(self.last / 64)] &= !(1 << (self.last % 64));
        self.last
    }

    /// Reads byte 1 of a slave's slot in a report, with the board's result in that report. Returns whether the byte is
    /// a mark that has not returned before.
    pub fn read(&mut self, index: u8, result: u32) -> bool {
        if index < FIRST || self.has_returned(index) {
            return false;
        }
        self.returned[usize::from(index / 64)] |= 1 << (index % 64);
        self.results[usize::from(index)] = result;
        if index == self.last {
            (self.echo, self.missed) = (Echo::Yes, 0);
        }
        true
    }

    /// Whether the frame with that mark was executed.
    pub const fn has_returned(&self, mark: u8) -> bool {
        self.returned[(mark / 64) as usize] & 1 << (mark % 64) != 0
    }

    /// The result of the board (Data1 of slot 0) in the cycle that executed the frame with that mark.
    pub const fn result(&self, mark: u8) -> u32 {
        self.results[mark as usize]
    }

    /// Counts a frame that was executed, by the count of entries, without returning its mark.
    pub fn note_missing(&mut self) {
        if self.echo == Echo::Unknown {
            self.missed += 1;
            if self.missed >= MISSED_MAX {
                self.echo = Echo::No;
            }
        }
    }

    /// Sets whether the board repeats indices. Outside OP the answers to commands with the index [`Marks::PROBE`] show
    /// it.
    pub const fn set_echo(&mut self, echoes: bool) {
        self.echo = if echoes { Echo::Yes } else { Echo::No };
    }

    /// The index of the commands that probe for [`Marks::set_echo`].
    pub const PROBE: u8 = FIRST;
}
