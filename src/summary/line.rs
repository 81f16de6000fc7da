//! The library reports what happens in a program to `ecmsk exec`, which has started the program: it writes lines to a file that
//! `ecmsk exec` has created. Each line is one event or one counter. A reader skips lines that it does not know, so that tool
//! and library may be of different versions.

use std::fmt;

use crate::sk::{MasterState, StateByte};

/// One line of the file that the library writes for `ecmsk exec`: an event, a message of the log, or the value of a
/// counter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Line {
    /// A message of the log that is the first of its kind. Messages of one kind differ only in their numbers.
    Message {
        /// The number of this kind of message, by which [`Line::Repeated`] refers to it.
        id: u32,
        /// The text of the message.
        text: String,
    },
    /// How many messages of one kind the log had so far. Messages of one kind differ only in their numbers.
    Repeated {
        /// The id of the first message of this kind in [`Line::Message`].
        id: u32,
        /// The number of messages of this kind, with the first one.
        times: u64,
    },
    /// A drive has an alarm.
    Alarm(Alarm),
    /// A drive holds its axis back.
    HeldBack(HeldBack),
    /// A change of the AL state of the network has failed.
    StateFailed(StateFailed),
    /// The present value of a counter of a board.
    Count {
        /// The number of the board among those that the process has opened, from 0.
        board: u32,
        /// The name of the counter.
        name: String,
        /// The present value of the counter.
        value: u64,
    },
    /// The number of lines that are missing so far: the queue of the library was full, or the log had too many different
    /// messages.
    Dropped(u64),
}

/// An alarm of a drive: a fault in its statusword.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Alarm {
    /// The slave, from 1.
    pub slave: u8,
    /// The error code, object 0x603F; 0 if the slave shows none.
    pub code: u16,
    /// When the alarm began, ns since the board was opened; for a recording see
    /// [`RecordMeta::zero_ns`](crate::recording::RecordMeta::zero_ns).
    /// `None` if a library of another version does not say so.
    pub at_ns: Option<i64>,
}

/// An axis that its drive holds back: it is enabled but does not move, and its statusword has shown internal limit
/// active (bit 11) for a while. Its torque limit, a limit switch or a software limit keeps it from its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeldBack {
    /// The slave, from 1.
    pub slave: u8,
    /// The position of the axis, counts.
    pub position: i32,
    /// When this was found, ns, counted from the same zero as [`Alarm::at_ns`].
    pub at_ns: Option<i64>,
}

/// A change of the AL state of the network that failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct StateFailed {
    /// The state byte, byte 2 of slot 0, of the report that shows the failure.
    pub state: u8,
    /// Whether SET_AXIS had declared a slave of another kind than IO before the change. If not, the missing declaration
    /// is the likely cause.
    pub declared: bool,
}

/// The maximum length of the text in a line, in bytes. \[OURS]
const TEXT_MAX: usize = 1000;

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Message { id, text } => {
                let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
                write!(f, "said {id} {}", &text[..text.floor_char_boundary(TEXT_MAX)])
            }
            Self::Repeated { id, times } => write!(f, "again {id} {times}"),
            Self::Alarm(Alarm { slave, code, at_ns }) => {
                write!(f, "alarm {slave} {code}")?;
                at_ns.map_or(Ok(()), |at_ns| write!(f, " {at_ns}"))
            }
            Self::HeldBack(HeldBack { slave, position, at_ns }) => {
                write!(f, "held {slave} {position}")?;
                at_ns.map_or(Ok(()), |at_ns| write!(f, " {at_ns}"))
            }
            Self::StateFailed(StateFailed { state, declared }) => write!(f, "state {state} {}", u8::from(*declared)),
            Self::Count { board, name, value } => write!(f, "count {board} {name} {value}"),
            Self::Dropped(lines) => write!(f, "dropped {lines}"),
        }
    }
}

impl Line {
    /// Parses a line without its line feed; `None` if the line is of no known form.
    pub fn parse(line: &str) -> Option<Self> {
        let (kind, rest) = line.split_once(' ')?;
        let mut words = rest.split(' ');
        Some(match kind {
            "said" => {
                let (id, text) = rest.split_once(' ')?;
                Self::Message { id: id.parse().ok()?, text: text.to_owned() }
            }
            "again" => Self::Repeated { id: words.next()?.parse().ok()?, times: words.next()?.parse().ok()? },
            "alarm" => Self::Alarm(Alarm {
                slave: words.next()?.parse().ok()?,
                code: words.next()?.parse().ok()?,
                at_ns: words.next().map(str::parse).transpose().ok()?,
            }),
            "held" => Self::HeldBack(HeldBack {
                slave: words.next()?.parse().ok()?,
                position: words.next()?.parse().ok()?,
                at_ns: words.next().map(str::parse).transpose().ok()?,
            }),
            "state" => {
                Self::StateFailed(StateFailed { state: words.next()?.parse().ok()?, declared: words.next()? == "1" })
            }
            "count" => Self::Count {
                board: words.next()?.parse().ok()?,
                name: words.next()?.to_owned(),
                value: words.next()?.parse().ok()?,
            },
            "dropped" => Self::Dropped(words.next()?.parse().ok()?),
            _ => return None,
        })
    }
}

impl fmt::Display for Alarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(at_ns) = self.at_ns {
            write!(f, "at {:.3} s: ", at_ns as f64 / 1e9)?;
        }
        write!(f, "slave {} has an alarm", self.slave)?;
        match self.code {
            0 => f.write_str(", and shows no error code"),
            code => write!(f, ", 0x{code:04X}: {}", crate::ethercat::cia402::error_name(code)),
        }
    }
}

impl fmt::Display for HeldBack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(at_ns) = self.at_ns {
            write!(f, "at {:.3} s: ", at_ns as f64 / 1e9)?;
        }
        write!(
            f,
            "the drive of slave {} holds its axis back at {} counts (internal limit active, statusword bit 11); see its load, its \
             limit switches (0x60FD) and its limits",
            self.slave, self.position
        )
    }
}

impl fmt::Display for StateFailed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = StateByte(self.state);
        // A change of state that fails ends in a lower state than OP. A failure shown in OP means that a slave has left OP, so
        // the text says that instead.
        if state.state() == Some(MasterState::Op) {
            return write!(
                f,
                "a slave has left OP while the program ran, byte 2 of slot 0 is 0x{:02X}: {state}; see above which one and why: a \
                 watchdog, if this machine was late, or a cable, or its power. SET_STATE brings it back",
                self.state
            );
        }
        write!(f, "a change of state failed, byte 2 of slot 0 is 0x{:02X}: {state}", self.state)?;
        f.write_str(match (self.declared, state.state()) {
            _ if self.state == StateByte::FAILED => "; look at the cable to the first slave and at its power",
            (false, _) => {
                "; the program has declared no drive by SET_AXIS: the board takes what is not declared for IO slaves, and a \
                 drive refuses to be one. Send SET_AXIS in PreOP first"
            }
            (true, _) => {
                "; see whether SET_AXIS declares each slave as what it is, and look at the slaves' error LEDs and cables"
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SK-4.80 A slave that left OP during the run is reported as such: not as a failed change of state, and without
    /// advice about SET_AXIS.
    #[test]
    fn a_slave_that_has_left_op_is_no_failed_change() {
        for declared in [false, true] {
            let said = StateFailed { state: 0x18, declared }.to_string();
            assert!(said.starts_with("a slave has left OP while the program ran, byte 2 of slot 0 is 0x18"), "{said}");
            assert!(
                said.contains("watchdog") && !said.contains("SET_AXIS") && !said.contains("change of state"),
                "{said}"
            );
        }
    }

    /// Every line that is written parses to the same value. In a text, line breaks are removed, and it is cut to its
    /// maximum length.
    #[test]
    fn lines_are_read_back() {
        for line in [
            Line::Message { id: 7, text: "a text: of 3 words".to_owned() },
            Line::Repeated { id: 7, times: 3000 },
            Line::Alarm(Alarm { slave: 40, code: 0x7500, at_ns: Some(1_501_000_000) }),
            Line::Alarm(Alarm { slave: 40, code: 0x7500, at_ns: None }),
            Line::HeldBack(HeldBack { slave: 1, position: -14_585, at_ns: Some(2) }),
            Line::StateFailed(StateFailed { state: 0x12, declared: true }),
            Line::Count { board: 1, name: "rejected.wrong_state".to_owned(), value: u64::MAX },
            Line::Dropped(5),
        ] {
            assert_eq!(Line::parse(&line.to_string()), Some(line));
        }
        let long = Line::Message { id: 0, text: "\u{20AC}\n\x1b[2J".repeat(1000) }.to_string();
        assert!(long.len() <= TEXT_MAX + 10 && !long.chars().any(char::is_control), "{long}");
        for none in ["", "said", "said x y", "alarm 300 0", "alarm 3 0 soon", "count 0 full", "new 1 2"] {
            assert_eq!(Line::parse(none), None, "{none}");
        }
    }
}
