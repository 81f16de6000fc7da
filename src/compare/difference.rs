//! A difference between two runs, and its text.

use std::fmt::{self, Display, Formatter};

use super::Side;
use super::counts::seconds;
use super::steps::Step;
use crate::ethercat::cia402::{Statusword, error_name};
use crate::sk::dump::{CommandDump, SlotLine};
use crate::sk::{SdoCommand, SdoResponse, StateByte};

/// One differing value of two runs. An array holds the value of run A and that of run B; slaves are numbered from 1.
#[derive(Clone, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the variants say what their fields are")]
pub enum Deviation {
    /// The programs sent different commands.
    Command {
        /// The first slot in which the two commands differ, as each run has it.
        lines: Box<[SlotLine; 2]>,
    },
    /// The run `side` ends, and the other run has more commands.
    Ends { side: Side },
    /// In the run `side` the board lost command frames because its FIFO was full, or refused them because of their CRC;
    /// in the other run it did not.
    Lost { side: Side },
    /// The run `side` answers this many cycles later than the other one, more than [`super::CompareOptions::latency_cycles`]
    /// allows.
    Late {
        side: Side,
        cycles: u64,
        /// The number of the first of the consecutive commands that are answered so late.
        from_command: u64,
    },
    /// The state of the network in the reports differs.
    State {
        /// The state of the network in each run, from byte 2 of slot 0.
        states: [StateByte; 2],
    },
    /// The result of a command for the board itself differs.
    Result {
        /// The result in each run, from Data1 of slot 0.
        results: [u32; 2],
    },
    /// In the run `side` a drive had a fault with this error code, even if the fault was reset before the answer; in
    /// the other run it had none with this code.
    Fault {
        slave: u8,
        side: Side,
        /// The error code, object 0x603F; 0 if the drive showed none.
        error_code: u16,
    },
    /// The compared bits of a drive's statusword differ.
    Statusword { slave: u8, words: [Statusword; 2] },
    /// A drive's error code, object 0x603F, differs.
    ErrorCode { slave: u8, codes: [u16; 2] },
    /// The actual positions of an axis differ by more than the tolerance.
    Position {
        slave: u8,
        /// The number of the axis: 1, or 2 for the second axis of a two-channel HSP.
        axis: u8,
        /// The actual positions in counts: object 0x6064, or 0x6864 for the second axis.
        counts: [i32; 2],
    },
    /// The inputs of an IO slave or an HSP differ, or the outputs that an IO slave reports back.
    Inputs { slave: u8, bits: [u16; 2] },
    /// In the two runs the slave is of different kinds, or it is present in one of them only.
    Kind { slave: u8 },
    /// The answers to an SDO transfer differ.
    Sdo { answers: [SdoResponse; 2] },
    /// In the run `side` an SDO transfer was not answered; in the other run it was.
    NoSdoAnswer { side: Side, request: SdoCommand },
}

impl Deviation {
    /// The slave that the difference is about; `None` if it is about the board or the program.
    pub const fn slave(&self) -> Option<u8> {
        match self {
            Self::Fault { slave, .. }
            | Self::Statusword { slave, .. }
            | Self::ErrorCode { slave, .. }
            | Self::Position { slave, .. }
            | Self::Inputs { slave, .. }
            | Self::Kind { slave } => Some(*slave),
            _ => None,
        }
    }
}

/// A command with its differences between two runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// The number of the command, from 1. Frames in which all slots are GET_STATUS are not counted.
    pub command: u64,
    /// The slot of the command for the slave that the first difference is about, as [`crate::sk::dump`] writes it. If
    /// that slot requests nothing, or the difference is about no slave, it is the first slot that requests something. If
    /// one run has ended, the text is that of the other run's command.
    pub text: String,
    /// The frame number of the command in run A and in run B; `None` if the run has ended.
    pub frames: [Option<u64>; 2],
    /// The time at which the command was sent in run A and in run B, in nanoseconds; `None` if the run has ended.
    pub at_ns: [Option<i64>; 2],
    /// The differences, the most important one first; at least one.
    pub what: Vec<Deviation>,
}

impl Difference {
    pub(super) fn new(a: Option<&Step>, b: Option<&Step>, what: Vec<Deviation>) -> Self {
        let slave = what.first().and_then(Deviation::slave).map(usize::from);
        let step = a.or(b);
        let slot = |step: &Step| slave.filter(|slave| !step.slot(*slave).is_zero()).unwrap_or(step.asking_slot());
        Self {
            command: step.map_or(0, |step| step.number),
            text: step.map_or_else(String::new, |step| words(step, slot(step))),
            frames: [a, b].map(|step| step.map(|step| step.frame_number)),
            at_ns: [a, b].map(|step| step.map(|step| step.at_ns)),
            what,
        }
    }
}

/// A slot of a step's command, as [`crate::sk::dump`] writes it.
pub(super) fn words(step: &Step, slot: usize) -> String {
    let line = CommandDump::new(&step.command, step.size).line(slot);
    line.map_or_else(String::new, |line| line_words(&line))
}

/// A line of a dump without its padding and its CRC.
fn line_words(line: &SlotLine) -> String {
    let text = SlotLine { crc: None, ..*line }.to_string();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

impl Display for Difference {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "command {}", self.command)?;
        if !matches!(self.what.first(), Some(Deviation::Command { .. })) {
            write!(f, " ({})", self.text)?;
        }
        match self.at_ns {
            [Some(a), Some(b)] => write!(f, " at {} in A, {} in B", seconds(a), seconds(b))?,
            [Some(a), None] => write!(f, " at {} in A", seconds(a))?,
            [None, Some(b)] => write!(f, " at {} in B", seconds(b))?,
            [None, None] => {}
        }
        for (i, what) in self.what.iter().take(SHOWN_MAX).enumerate() {
            write!(f, "{}{what}", if i == 0 { ": " } else { "; " })?;
        }
        match self.what.len().saturating_sub(SHOWN_MAX) {
            0 => Ok(()),
            more => write!(f, "; and {more} more"),
        }
    }
}

/// The maximum number of differences of one command that its text lists. \[OURS]
const SHOWN_MAX: usize = 3;

impl Display for Deviation {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Command { lines } => {
                let [a, b] = [&lines[0], &lines[1]].map(line_words);
                // Both lines begin with the role of the slot, such as the slave's number. The text writes it once, so it
                // is removed from the second line.
                let role = lines[0].role.to_string();
                let b = b.strip_prefix(&role).map_or(b.as_str(), str::trim);
                write!(f, "{a} in A, {b} in B")
            }
            Self::Ends { side } => write!(f, "{side} ends before it"),
            Self::Lost { side } => write!(f, "commands were lost in {side}, and not in {}", side.other()),
            Self::Late { side, cycles, from_command } => {
                write!(
                    f,
                    "{side} answers {cycles} cycles later from command {from_command} on, which is more than allowed"
                )
            }
            Self::State { states: [a, b] } => write!(f, "state {a} in A, {b} in B"),
            Self::Result { results: [a, b] } => write!(f, "result {a} (0x{a:X}) in A, {b} (0x{b:X}) in B"),
            Self::Fault { slave, side, error_code: 0 } => write!(f, "slave {slave} had a fault in {side}"),
            Self::Fault { slave, side, error_code } => {
                write!(f, "slave {slave} had a fault in {side}, error code {}", ErrorCodeText(*error_code))
            }
            Self::Statusword { slave, words: [a, b] } => {
                write!(f, "slave {slave} statusword {} in A, {} in B", StatuswordText(*a), StatuswordText(*b))
            }
            Self::ErrorCode { slave, codes: [a, b] } => {
                write!(f, "slave {slave} error code {} in A, {} in B", ErrorCodeText(*a), ErrorCodeText(*b))
            }
            Self::Position { slave, axis, counts: [a, b] } => {
                let apart = a.abs_diff(*b);
                let axis = if *axis == 1 { String::new() } else { format!("axis {axis} ") };
                write!(f, "slave {slave} {axis}position {a} in A, {b} in B ({apart} apart)")
            }
            Self::Inputs { slave, bits: [a, b] } => write!(f, "slave {slave} inputs 0x{a:04X} in A, 0x{b:04X} in B"),
            Self::Kind { slave } => write!(f, "slave {slave} is no slave of the same kind in A and B"),
            Self::Sdo { answers: [a, b] } => write!(f, "SDO {} in A, {} in B", SdoText(a), SdoText(b)),
            Self::NoSdoAnswer { side, request } => {
                let Some((slave, object)) = request.target() else {
                    return write!(f, "the SDO before it was not answered in {side}");
                };
                let id = request.id();
                write!(f, "the {id} of slave {slave} {object} before it was not answered in {side}")
            }
        }
    }
}

/// A statusword with the name of its state.
struct StatuswordText(Statusword);

impl Display for StatuswordText {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.0.state() {
            Some(state) => write!(f, "0x{:04X} ({state})", self.0.0),
            None => write!(f, "0x{:04X}", self.0.0),
        }
    }
}

/// The error code of a drive, object 0x603F, with its meaning; 0 is none.
struct ErrorCodeText(u16);

impl Display for ErrorCodeText {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}", self.0)?;
        if self.0 == 0 { Ok(()) } else { write!(f, " ({})", error_name(self.0)) }
    }
}

struct SdoText<'a>(&'a SdoResponse);

impl Display for SdoText<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self.0 {
            SdoResponse::Done { slave, object, value, .. } => {
                write!(f, "slave {slave} {object} = {value} (0x{value:X})")
            }
            SdoResponse::Aborted { slave, object, code, .. } => write!(f, "slave {slave} {object} aborted: {code}"),
            SdoResponse::Empty | SdoResponse::Other(_) => f.write_str("without an answer"),
        }
    }
}
