//! A difference between two runs, in words.

use std::fmt::{self, Display, Formatter};

use super::Side;
use super::steps::Step;
use crate::cia402::Statusword;
use crate::sk::dump::{CommandDump, SlotLine};
use crate::sk::{SdoCommand, SdoResponse, StateByte};

/// What is not equal. Pairs are those of A and B.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum What {
    /// The program asked for something else: the first slot that differs.
    Command {
        /// Both slots.
        lines: Box<[SlotLine; 2]>,
    },
    /// A run has no more commands.
    Ends {
        /// The shorter run.
        side: Side,
    },
    /// Commands were lost, or refused for their CRC, in this run alone.
    Lost {
        /// In which.
        side: Side,
    },
    /// The network's state.
    State {
        /// Byte 2 of slot 0.
        states: [StateByte; 2],
    },
    /// The result of the board's own command.
    Result {
        /// Data1 of slot 0.
        results: [u32; 2],
    },
    /// A drive had a fault in this run alone, and may have lost it again.
    Fault {
        /// Slave.
        slave: u8,
        /// In which.
        side: Side,
        /// 0x603F, 0 if it was not told.
        error_code: u16,
    },
    /// A drive's statusword.
    Statusword {
        /// Slave.
        slave: u8,
        /// 0x6041.
        words: [Statusword; 2],
    },
    /// A drive's error code.
    ErrorCode {
        /// Slave.
        slave: u8,
        /// 0x603F.
        codes: [u16; 2],
    },
    /// Positions further apart than allowed.
    Position {
        /// Slave.
        slave: u8,
        /// 1, or 2 of a two-channel HSP.
        axis: u8,
        /// 0x6064.
        counts: [i32; 2],
    },
    /// Inputs of an IO slave or an HSP, or the outputs that an IO slave answers.
    Inputs {
        /// Slave.
        slave: u8,
        /// As they are.
        bits: [u16; 2],
    },
    /// A slave is not the same kind of slave, or is there in one run alone.
    Kind {
        /// Slave.
        slave: u8,
    },
    /// What an SDO transfer gave.
    Sdo {
        /// The answers.
        answers: [SdoResponse; 2],
    },
    /// An SDO transfer was answered in the other run alone.
    NoSdoAnswer {
        /// Where it was not.
        side: Side,
        /// What was asked for.
        request: SdoCommand,
    },
}

impl What {
    /// The slave it is about.
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

/// Where two runs differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Number of the command, from 1; frames of nothing but GET_STATUS do not count.
    pub command: u64,
    /// What the command asks for: the slot that matters, as [`crate::sk::dump`] writes it; of the longer run if one has
    /// ended.
    pub text: String,
    /// Number of its frame in A and B; `None` where the run has ended.
    pub frames: [Option<u64>; 2],
    /// When it was sent in A and B, nanoseconds.
    pub at_ns: [Option<i64>; 2],
    /// What is different, the most telling first. Not empty.
    pub what: Vec<What>,
}

impl Difference {
    pub(super) fn new(a: Option<&Step>, b: Option<&Step>, what: Vec<What>) -> Self {
        let slave = what.first().and_then(What::slave).map(usize::from);
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

/// What a slot of a command asks for, in the words of a dump.
pub(super) fn words(step: &Step, slot: usize) -> String {
    let line = CommandDump::new(&step.command, step.size).line(slot);
    line.map_or_else(String::new, |line| line_words(&line))
}

/// A line of a dump without its columns and its CRC.
fn line_words(line: &SlotLine) -> String {
    let text = SlotLine { crc: None, ..*line }.to_string();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Nanoseconds as seconds with three digits.
pub(super) fn seconds(at_ns: i64) -> String {
    let (sign, us) = (if at_ns < 0 { "-" } else { "" }, (at_ns.unsigned_abs() + 500) / 1000);
    format!("{sign}{}.{:03} s", us / 1_000_000, us % 1_000_000 / 1000)
}

impl Display for Difference {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "command {}", self.command)?;
        if !matches!(self.what.first(), Some(What::Command { .. })) {
            write!(f, " ({})", self.text)?;
        }
        match self.at_ns {
            [Some(a), Some(b)] => write!(f, " at {} in A, {} in B", seconds(a), seconds(b))?,
            [Some(a), None] => write!(f, " at {} in A", seconds(a))?,
            [None, Some(b)] => write!(f, " at {} in B", seconds(b))?,
            [None, None] => {}
        }
        for (i, what) in self.what.iter().take(TOLD).enumerate() {
            write!(f, "{}{what}", if i == 0 { ": " } else { "; " })?;
        }
        match self.what.len().saturating_sub(TOLD) {
            0 => Ok(()),
            more => write!(f, "; and {more} more"),
        }
    }
}

/// Differences of one command that are told. \[OURS]
const TOLD: usize = 3;

impl Display for What {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Command { lines } => {
                let [a, b] = [&lines[0], &lines[1]].map(line_words);
                // The role stands in front of both.
                let role = lines[0].role.to_string();
                let b = b.strip_prefix(&role).map_or(b.as_str(), str::trim);
                write!(f, "{a} in A, {b} in B")
            }
            Self::Ends { side } => write!(f, "{side} ends before it"),
            Self::Lost { side } => write!(f, "commands were lost in {side}, and not in {}", side.other()),
            Self::State { states: [a, b] } => write!(f, "state {a} in A, {b} in B"),
            Self::Result { results: [a, b] } => write!(f, "result {a} (0x{a:X}) in A, {b} (0x{b:X}) in B"),
            Self::Fault { slave, side, error_code: 0 } => write!(f, "slave {slave} had a fault in {side}"),
            Self::Fault { slave, side, error_code } => {
                write!(f, "slave {slave} had a fault in {side}, error code 0x{error_code:04X}")
            }
            Self::Statusword { slave, words: [a, b] } => {
                write!(f, "slave {slave} statusword {} in A, {} in B", Word(*a), Word(*b))
            }
            Self::ErrorCode { slave, codes: [a, b] } => {
                write!(f, "slave {slave} error code 0x{a:04X} in A, 0x{b:04X} in B")
            }
            Self::Position { slave, axis, counts: [a, b] } => {
                let apart = a.abs_diff(*b);
                let axis = if *axis == 1 { String::new() } else { format!("axis {axis} ") };
                write!(f, "slave {slave} {axis}position {a} in A, {b} in B ({apart} apart)")
            }
            Self::Inputs { slave, bits: [a, b] } => write!(f, "slave {slave} inputs 0x{a:04X} in A, 0x{b:04X} in B"),
            Self::Kind { slave } => write!(f, "slave {slave} is no slave of the same kind in A and B"),
            Self::Sdo { answers: [a, b] } => write!(f, "SDO {} in A, {} in B", SdoWords(a), SdoWords(b)),
            Self::NoSdoAnswer { side, request } => {
                let (SdoCommand::Read { slave, object } | SdoCommand::Write { slave, object, .. }) = request else {
                    return write!(f, "the SDO before it was not answered in {side}");
                };
                let id = request.id();
                write!(f, "the {id} of slave {slave} {object} before it was not answered in {side}")
            }
        }
    }
}

/// A statusword and its state.
struct Word(Statusword);

impl Display for Word {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.0.state() {
            Some(state) => write!(f, "0x{:04X} ({state})", self.0.0),
            None => write!(f, "0x{:04X}", self.0.0),
        }
    }
}

/// An SDO answer.
struct SdoWords<'a>(&'a SdoResponse);

impl Display for SdoWords<'_> {
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
