//! Marks: numbers in byte 1 (the index) of the slaves' slots, by which a host knows its own frames again. Firmware 1.7 repeats
//! the index of a command, GET_STATUS too, in the report of the cycle that executed it (SK-3).
//!
//! Every frame with a command has a mark of its own in all its slaves' slots. A report that shows the mark in any of them says
//! that the frame arrived and was executed. A slave that does not repeat it while others do is lost. Firmware 1.5 shows the
//! mode in that byte: then the count of FIFO entries has to do, which is out of step after a frame that was lost on the way.

/// The lowest mark: firmware 1.5 shows no mode that high. \[OURS]
const FIRST: u8 = 0x20;
/// \[OURS] Frames that were executed, by the count of entries, without their marks coming back, until the board is known to
/// repeat no index.
const MISSED_MAX: u8 = 2;

/// Whether the board repeats the index of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Echo {
    /// Nothing has shown it yet.
    Unknown,
    /// It does, as firmware 1.7.
    Yes,
    /// It does not, as firmware 1.5.
    No,
}

pub struct Marks {
    pub echo: Echo,
    /// The mark that was given last.
    last: u8,
    /// A bit for each mark that came back since it was given.
    returned: [u64; 4],
    /// For each mark Data1 of slot 0 in the report that showed it first.
    results: [u32; 256],
    /// Frames that were executed while their marks did not come back.
    missed: u8,
    /// Calls that wait for a mark: without any, marks in reports need not be read.
    pub awaited: u32,
}

impl Marks {
    pub const fn new() -> Self {
        Self { echo: Echo::Unknown, last: FIRST, returned: [0; 4], results: [0; 256], missed: 0, awaited: 0 }
    }

    /// A mark for the next frame; that it came back once before is forgotten.
    pub fn next(&mut self) -> u8 {
        self.last = self.last.checked_add(1).unwrap_or(FIRST);
        self.returned[usize::from(self.last / 64)] &= !(1 << (self.last % 64));
        self.last
    }

    /// Reads byte 1 of a slave's slot in a report, and the board's result beside it. Says whether it is a mark that comes back
    /// for the first time.
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

    /// The board's result in the cycle that executed the frame with that mark.
    pub const fn result(&self, mark: u8) -> u32 {
        self.results[mark as usize]
    }

    /// A frame was executed, by the count of entries, and its mark did not come back.
    pub fn note_missing(&mut self) {
        if self.echo == Echo::Unknown {
            self.missed += 1;
            if self.missed >= MISSED_MAX {
                self.echo = Echo::No;
            }
        }
    }

    /// Sets whether the board repeats indexes: outside OP the answers to commands with the index [`Marks::PROBE`] show it.
    pub const fn set_echo(&mut self, echoes: bool) {
        self.echo = if echoes { Echo::Yes } else { Echo::No };
    }

    /// An index for [`Marks::set_echo`].
    pub const PROBE: u8 = FIRST;
}
