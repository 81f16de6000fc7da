//! Marks: numbers in byte 1 (the index) of the slaves' slots, by which the host recognises its frames. Firmware 1.7
//! repeats the index of a command, also that of GET_STATUS, in the report of the cycle that executed it (SK-3).
//!
//! Every frame with a command has its own mark in the slots of all slaves. A report with the mark in any slot shows
//! that the frame arrived and was executed. A slave that does not repeat the mark while others do is lost. Reports of
//! firmware 1.5 have the mode of operation in that byte. The host then has to count FIFO entries instead, and its count
//! is wrong after a frame was lost on the way.

/// The lowest mark. Firmware 1.5 has the mode of operation in byte 1 of a slave's slot instead of a mark, and every mode is
/// below this number. \[OURS]
const FIRST: u8 = 0x20;
/// \[OURS] After this many frames whose marks no report returned, the board counts as one that does not repeat the
/// index. The number of FIFO entries shows that the board has executed these frames.
const MISSED_MAX: u8 = 2;

/// Whether the board repeats the index of a command in its reports.
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
    /// The mark that a frame got last; the next frame with a command gets the next mark.
    last: u8,
    /// One bit for each mark. It is set when a report has returned the mark, so that the frame with it was executed.
    returned: [u64; 4],
    /// For each mark the value of Data1 in slot 0 of the first report that returned it: the board's result.
    results: [u32; 256],
    /// The number of frames whose marks no report has returned, although the number of FIFO entries shows that the
    /// board has executed them.
    missed: u8,
    /// The number of calls that wait until a report returns the mark of their frame. While it is 0, reports are not searched
    /// for marks.
    pub awaited: u32,
}

impl Marks {
    pub const fn new() -> Self {
        Self { echo: Echo::Unknown, last: FIRST, returned: [0; 4], results: [0; 256], missed: 0, awaited: 0 }
    }

    /// Returns the mark for the next frame. The 224 marks are used in turn. A mark that is used again counts as not
    /// returned until a report shows it again.
    pub fn next(&mut self) -> u8 {
        self.last = self.last.checked_add(1).unwrap_or(FIRST);
        self.returned[usize::from(self.last / 64)] &= !(1 << (self.last % 64));
        self.last
    }

    /// Reads byte 1 of a slave's slot in a report; `result` is Data1 of slot 0 in the same report. Returns whether
    /// the byte is a mark that no earlier report has returned.
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

    /// Whether a report has returned the mark, so that the board has executed the frame with it.
    pub const fn has_returned(&self, mark: u8) -> bool {
        self.returned[(mark / 64) as usize] & 1 << (mark % 64) != 0
    }

    /// The result of the board (Data1 of slot 0) in the cycle that executed the frame with this mark.
    pub const fn result(&self, mark: u8) -> u32 {
        self.results[mark as usize]
    }

    /// Counts a frame whose mark no report has returned, although the number of FIFO entries shows that the board has
    /// executed it.
    pub fn note_missing(&mut self) {
        if self.echo == Echo::Unknown {
            self.missed += 1;
            if self.missed >= MISSED_MAX {
                self.echo = Echo::No;
            }
        }
    }

    /// Sets whether the board repeats the index of a command in its reports. The caller knows it from the answer to a
    /// command with the index [`Marks::PROBE`] outside OP.
    pub const fn set_echo(&mut self, echoes: bool) {
        self.echo = if echoes { Echo::Yes } else { Echo::No };
    }

    /// The index in commands outside OP, which shows whether the board repeats it ([`Marks::set_echo`]).
    pub const PROBE: u8 = FIRST;
}
