//! The errors of the communication between a host and its chip.

use core::fmt;

use super::start::StartStep;
use crate::ethercat::Ns;
use crate::ethercat::coe::AbortCode;
use crate::xf::{CommandCode, DataSize, Malformed, PacketError};

/// Why a command has no result, or why the driver has stopped. `Display` says what happened and what to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HostError {
    /// The driver has stopped: it found no packets in the bytes from the chip.
    Silent {
        /// Duration of the search for packets.
        waited_ns: Ns,
        /// Number of bytes received during the search.
        bytes: u64,
    },
    /// The driver has stopped: the chip's start took longer than [`Timeouts::start_ns`](super::Timeouts::start_ns).
    StartTooLong {
        /// The step of the chip's start that did not finish.
        step: StartStep,
        /// Time since the driver began to start the chip.
        waited_ns: Ns,
        /// What was wrong with the last answer; `None` if it was not damaged.
        last: Option<PacketError>,
    },
    /// The driver has stopped: the chip reports a data segment size that differs from that of its packets.
    DataSizeMismatch {
        /// The data segment size of the packets.
        expected: DataSize,
        /// The data segment size that SPI_PACK_SIZE_GET reports.
        found: DataSize,
    },
    /// The driver has stopped: INT0 did not become active.
    Int0Missing {
        /// Duration of each wait for INT0.
        waited_ns: Ns,
        /// Number of consecutive waits in which INT0 did not become active.
        times: u32,
    },
    /// No answer came. It is unknown whether the command ran.
    NoAnswer {
        /// The command that got no answer.
        code: CommandCode,
        /// The index of the command's packets, byte 0x0B of the header.
        index: u8,
        /// How many times the packet was sent.
        copies: u32,
        /// Time since the packet was first sent.
        waited_ns: Ns,
        /// What was wrong with the last answer; `None` if it was not damaged.
        last: Option<PacketError>,
    },
    /// The command ran, but the only answer with its result was damaged.
    AnswerLost {
        /// The command whose answer was lost.
        code: CommandCode,
    },
    /// The chip refused the command, by error bit 7 of its answer: a wrong parameter, or the command is not possible
    /// now.
    Refused {
        /// The refused command.
        code: CommandCode,
    },
    /// A non-immediate command ran and failed: the answer that shows its end has error bit 3 set.
    Failed {
        /// The command that failed.
        code: CommandCode,
        /// The SDO abort code; `None` if the command is no SDO or the chip did not report a code.
        abort: Option<AbortCode>,
        /// How long the command ran.
        waited_ns: Ns,
    },
    /// A non-immediate command did not end within its time, [`Timeouts::busy_ns`](super::Timeouts::busy_ns) by default.
    /// It may still be running in the chip.
    StillBusy {
        /// The command that is still running.
        code: CommandCode,
        /// How long the command had been running when its timeout passed.
        waited_ns: Ns,
    },
    /// The command was queued for too long and was not sent.
    NotSent {
        /// The command that was not sent.
        code: CommandCode,
        /// How long the command was queued.
        waited_ns: Ns,
    },
    /// The chip was reset: all its pending commands are lost, and the driver starts it again.
    ChipReset,
    /// The queue of commands is full.
    QueueFull {
        /// The command for which the queue has no room.
        code: CommandCode,
        /// The number of commands that the queue can hold.
        slots: usize,
    },
    /// The command's data do not fit into a slot of the queue, or into a packet.
    TooLong {
        /// The command that is too long.
        code: CommandCode,
        /// Size of the data in bytes.
        found: usize,
        /// The number of bytes that the slot of the queue or the data segment of a packet holds.
        most: usize,
    },
    /// The command cannot be queued: process data are sent with `Host::process`, and the driver itself sets the data
    /// segment size and the check word.
    ReservedForDriver {
        /// The command that cannot be queued.
        code: CommandCode,
    },
    /// The second command of a pair does not read the result of the first one.
    NotARead {
        /// The second command of the pair, which is not a read.
        code: CommandCode,
    },
    /// No command belongs to this ticket: its result was already taken.
    UnknownTicket,
    /// The ticket belongs to another command than the one that the caller passed.
    OtherCommand {
        /// The command that the ticket belongs to.
        expected: CommandCode,
        /// The command that the caller passed.
        found: CommandCode,
    },
    /// Earlier process data are still waiting to be sent.
    ProcessBusy {
        /// The sequence number of the waiting process data.
        sequence: u32,
    },
    /// The RxFIFO may have no room for all RxPDOs of the write.
    FifoFull {
        /// Number of RxPDOs to write.
        needed: u8,
        /// Number of RxFIFO entries that are certainly free.
        free: u8,
    },
    /// A field of the command or of its answer has a value that the manuals do not allow.
    Malformed(Malformed),
}

impl HostError {
    /// The warning for a driver whose [`Host::gave_crc_up`](super::Host::gave_crc_up) is true. It is not an error.
    pub const CRC_GIVEN_UP: &str = "the chip's CRC-32 covers nothing that is known (all of a packet, its valid bytes, these up to a \
                                    multiple of 4): it was set to the fixed check word, with which bits that flip on the wires go \
                                    unnoticed; keep the wires short and speed= low, and send a recording (docs/HARDWARE.md)";
}

impl From<Malformed> for HostError {
    fn from(malformed: Malformed) -> Self {
        Self::Malformed(malformed)
    }
}

/// Formats nanoseconds as milliseconds with three decimals.
struct Millis(Ns);

impl fmt::Display for Millis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:03} ms", self.0 / 1_000_000, self.0 / 1_000 % 1_000)
    }
}

/// Formats what was wrong with the last answer, as an addition to an error text.
struct Last(Option<PacketError>);

impl fmt::Display for Last {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(error) => write!(f, " (the last answer: {error})"),
            None => Ok(()),
        }
    }
}

impl fmt::Display for HostError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Silent { waited_ns, bytes } => write!(
                f,
                "no packet in {bytes} bytes and {}: check power, reset and wires of the chip, SPI mode 0 and its \
                 clock, then restart the driver",
                Millis(waited_ns)
            ),
            Self::StartTooLong { step, waited_ns, last } => write!(
                f,
                "the chip was not started in {}: {step} did not end{}; check the wires and the clock, reset the chip \
                 and restart the driver",
                Millis(waited_ns),
                Last(last)
            ),
            Self::DataSizeMismatch { expected, found } => write!(
                f,
                "packets have {} bytes of data, but the chip says {}; reset the chip and restart the driver",
                expected.bytes(),
                found.bytes()
            ),
            Self::Int0Missing { waited_ns, times } => write!(
                f,
                "INT0 did not come {times} times in {} each: check its wire and polarity (ECAT_INT_SET_ENABLE bit 1), \
                 or pace by idle time",
                Millis(waited_ns)
            ),
            Self::NoAnswer { code, index, copies, waited_ns, last } => write!(
                f,
                "no answer to {code}, index {index}, in {} and {copies} packets{}; whether it ran is unknown: read \
                 back what it changes before it is sent again",
                Millis(waited_ns),
                Last(last)
            ),
            Self::AnswerLost { code } => {
                write!(f, "{code} ran, but its answer was damaged and is lost: read back what it changes")
            }
            Self::Refused { code } => write!(
                f,
                "the chip refused {code} (error bit 7): check its parameters, the state of the network and the firmware"
            ),
            Self::Failed { code, abort: Some(abort), waited_ns } => {
                write!(f, "{code} failed after {} (error bit 3) with abort code {abort}", Millis(waited_ns))
            }
            Self::Failed { code, abort: None, waited_ns } => write!(
                f,
                "{code} failed after {} (error bit 3): check cable, power and state of the slaves",
                Millis(waited_ns)
            ),
            Self::StillBusy { code, waited_ns } => write!(
                f,
                "{code} has not ended after {}: give it more time, or end it with ASYNCCMD_RESET 4",
                Millis(waited_ns)
            ),
            Self::NotSent { code, waited_ns } => write!(
                f,
                "{code} waited {} for its turn and was not sent: see what keeps the chip busy, and send it again",
                Millis(waited_ns)
            ),
            Self::ChipReset => {
                f.write_str("the chip was reset: initialise the network anew once the driver runs again")
            }
            Self::QueueFull { code, slots } => {
                write!(f, "the queue of {slots} commands is full: take results before {code} is submitted")
            }
            Self::TooLong { code, found, most } => {
                write!(f, "{code} has {found} bytes of data, {most} at most: send less, or set a larger n")
            }
            Self::ReservedForDriver { code } => write!(
                f,
                "{code} is not for the queue: process data go by `Host::process`, n and check word are set at the start"
            ),
            Self::NotARead { code } => write!(f, "{code} reads no result: submit it by itself"),
            Self::UnknownTicket => f.write_str("the ticket is of no command: its result was taken already"),
            Self::OtherCommand { expected, found } => {
                write!(f, "the ticket is of {expected}, not of {found}: take it with the command it was given for")
            }
            Self::ProcessBusy { sequence } => {
                write!(f, "process data {sequence} are not sent yet: go on with exchanges before the next ones")
            }
            Self::FifoFull { needed, free } => {
                write!(f, "the RxFIFO has room for {free} PDOs, not for {needed}: write after the next cycle")
            }
            Self::Malformed(malformed) => malformed.fmt(f),
        }
    }
}

impl core::error::Error for HostError {}
