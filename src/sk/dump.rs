//! A readable dump of a frame: one line per slot, as text ([`core::fmt::Display`]) and as typed data ([`SlotMeaning`]).
//!
//! ```
//! use ecmsk::sk::{CommandDump, Frame, Motion, SlaveCommand, SlotSize};
//!
//! let mut frame = Frame::new();
//! frame.put_slave(SlotSize::Bytes12, 1, &SlaveCommand::Csp(Motion::to(-1_234_567)).with_index(7));
//! frame.fill_crc(SlotSize::Bytes12);
//! assert_eq!(
//!     CommandDump::new(&frame, SlotSize::Bytes12).to_string(),
//!     "ECM      GET_STATUS, CRC 0xFA ok\n\
//!      slave 1  CSP #7 target -1234567",
//! );
//! ```
//!
//! A dump omits nothing: if a slot has bytes set that its meaning does not use, or has no meaning at all, its line ends
//! with the raw fields and the reason. A line without raw fields is therefore complete.

mod meaning;
mod text;

use super::{
    CrcStatus, Frame, MasterCommand, MasterResponse, RawSlot, SdoCommand, SdoResponse, SlaveKind, SlotCommand,
};
use super::{MasterState, SlotSize};

pub use meaning::{ByteOne, KindEvidence, SlaveData, SlaveReading, SlotMeaning};

/// The most slaves that a frame has slots for, 40 with slots of 12 bytes: the length of a list of slave kinds.
pub const MAX_SLAVES: usize = SlotSize::Bytes12.max_slaves();

/// The purpose of a slot in a frame, with the slave's number (SK-1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlotRole {
    /// Slot 0, for the board itself.
    Master,
    /// One of the slots 1..=40 (1..=30 in 16-byte mode), for the slave with this number.
    Slave(u8),
    /// Slot 41 (31 in 16-byte mode), for SDO transfers.
    Sdo,
}

impl SlotRole {
    /// The purpose of slot number `i`; `None` if a frame of this size has no such slot.
    pub const fn of(size: SlotSize, i: usize) -> Option<Self> {
        match i {
            0 => Some(Self::Master),
            i if i < size.sdo_slot() => Some(Self::Slave(i as u8)),
            i if i == size.sdo_slot() => Some(Self::Sdo),
            _ => None,
        }
    }
}

/// One slot of a frame: its purpose, its raw fields and their meaning. Its `Display` is one line without the newline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotLine {
    /// The purpose of the slot.
    pub role: SlotRole,
    /// The size of the slot in bytes.
    pub size: SlotSize,
    /// The slot's fields as in the frame. In slot 0 the high byte of `parm` is the frame's CRC.
    pub raw: RawSlot,
    /// What the fields mean.
    pub meaning: SlotMeaning,
    /// The result of the CRC check of the frame; `None` in all slots but slot 0.
    pub crc: Option<CrcStatus>,
}

impl SlotLine {
    /// Builds the line of slot `i`, whose fields `meaning` decodes; `None` if a frame of this size has no such slot.
    fn of(
        frame: &Frame,
        size: SlotSize,
        i: usize,
        meaning: impl FnOnce(SlotRole, &RawSlot) -> SlotMeaning,
    ) -> Option<Self> {
        let (role, raw) = (SlotRole::of(size, i)?, frame.slot(size, i));
        let crc = (role == SlotRole::Master).then(|| frame.crc_status(size));
        Some(Self { role, size, raw, meaning: meaning(role, &raw), crc })
    }

    /// Whether all bytes are 0, so that the slot has no request in a command frame, and no data in a report. Slot 0 is
    /// never idle: it has the CRC and the state.
    pub const fn is_idle(&self) -> bool {
        !matches!(self.role, SlotRole::Master) && self.raw.is_zero()
    }

    /// The slot's fields without the frame's CRC.
    const fn fields_without_crc(&self) -> RawSlot {
        match self.role {
            SlotRole::Master => RawSlot { parm: self.raw.parm & 0xFF, ..self.raw },
            _ => self.raw,
        }
    }
}

/// A command frame as readable lines. Its `Display` prints the lines of [`Self::lines`].
#[derive(Clone, Copy, Debug)]
pub struct CommandDump<'a> {
    frame: &'a Frame,
    size: SlotSize,
    with_idle_slots: bool,
}

impl<'a> CommandDump<'a> {
    /// A dump of slot 0 and of those slots of `frame` that have a request.
    pub const fn new(frame: &'a Frame, size: SlotSize) -> Self {
        Self { frame, size, with_idle_slots: false }
    }

    /// A dump of all slots, idle ones included.
    pub const fn all(self) -> Self {
        Self { with_idle_slots: true, ..self }
    }

    /// The line of slot `i`, idle or not; `None` if the frame has no such slot.
    pub fn line(&self, i: usize) -> Option<SlotLine> {
        SlotLine::of(self.frame, self.size, i, |role, raw| {
            let meaning = match role {
                SlotRole::Master => MasterCommand::decode(raw, self.size).map(SlotMeaning::MasterCommand),
                SlotRole::Slave(_) => SlotCommand::decode(raw, self.size).map(SlotMeaning::SlaveCommand),
                SlotRole::Sdo => SdoCommand::decode(raw, self.size).map(SlotMeaning::SdoCommand),
            };
            meaning.unwrap_or_else(SlotMeaning::Malformed)
        })
    }

    /// The lines of the dump in order, each with the number of its slot.
    pub fn lines(&self) -> impl Iterator<Item = (usize, SlotLine)> + use<'a> {
        let dump = *self;
        lines_of_slots(dump.size, dump.with_idle_slots, move |i| dump.line(i))
    }
}

/// A response frame as readable lines. Its `Display` prints the lines of [`Self::lines`].
///
/// ```
/// use ecmsk::sk::dump::{SlaveData, SlotMeaning};
/// use ecmsk::sk::{Frame, ResponseDump, SlotSize};
///
/// let mut report = Frame::new();
/// report.bytes_mut()[..3].copy_from_slice(&[0xBF, 0, 0x08]);
/// report.bytes_mut()[24..30].copy_from_slice(&[0x13, 0, 0, 0, 0xEF, 0xBE]);
/// let dump = ResponseDump::new(&report, SlotSize::Bytes12);
/// let (slot, line) = dump.lines().last().unwrap();
/// assert_eq!((slot, line.to_string().as_str()), (2, "slave 2  IO_RD IO inputs 0xBEEF"));
/// if let SlotMeaning::SlaveResponse(reading) = line.meaning
///     && let SlaveData::Io(io) = reading.data
/// {
///     assert_eq!(io.bits, 0xBEEF);
/// }
/// ```
///
/// The kind of slave that a slot belongs to is not on the wire. The caller may set it with [`Self::kinds`]. Otherwise
/// the kind is derived from the slot's fields as follows, and [`KindEvidence`] says how certain it is `[OURS]`:
/// - id IO_RD or IO_WR: an IO slave, since only IO slaves take these commands; id CST: a drive, for the same reason;
/// - bytes 12..15 not 0: a guess at a two-channel HSP;
/// - the id of another drive command, or Parm (a drive's statusword) not 0: a guess at a drive. A stepper's slot has
///   the same layout. If the slave is an HSP, statusword and position are right and its inputs are shown as torque;
/// - otherwise, if Data1 fits into 16 bits and Data2 is 0: a guess at an IO slave;
/// - any other slot is not decoded: its raw fields are shown.
#[derive(Clone, Copy, Debug)]
pub struct ResponseDump<'a> {
    frame: &'a Frame,
    size: SlotSize,
    with_idle_slots: bool,
    kinds: Option<&'a [SlaveKind; MAX_SLAVES]>,
    mode_in_byte_1: bool,
}

impl<'a> ResponseDump<'a> {
    /// A dump of slot 0 and of those slots of `frame` that have data. The kinds of the slaves are derived from the
    /// slots, and byte 1 is read as the command index.
    pub const fn new(frame: &'a Frame, size: SlotSize) -> Self {
        Self { frame, size, with_idle_slots: false, kinds: None, mode_in_byte_1: false }
    }

    /// A dump of all slots, idle ones included.
    pub const fn all(self) -> Self {
        Self { with_idle_slots: true, ..self }
    }

    /// Sets the kinds of the slaves as the application declared them with SET_AXIS: `kinds[n - 1]` is that of slave n.
    pub const fn kinds(self, kinds: &'a [SlaveKind; MAX_SLAVES]) -> Self {
        Self { kinds: Some(kinds), ..self }
    }

    /// Reads byte 1 of a slave's slot as the mode of operation, which firmware 1.5 sends there, and not as the command
    /// index (SK-3).
    pub const fn mode_in_byte_1(self) -> Self {
        Self { mode_in_byte_1: true, ..self }
    }

    /// The line of slot `i`, idle or not; `None` if the frame has no such slot.
    pub fn line(&self, i: usize) -> Option<SlotLine> {
        SlotLine::of(self.frame, self.size, i, |role, raw| match role {
            SlotRole::Master => SlotMeaning::MasterResponse(MasterResponse::decode(raw)),
            SlotRole::Slave(n) => SlotMeaning::SlaveResponse(SlaveReading {
                byte_one: if self.mode_in_byte_1 { ByteOne::Mode(raw.index) } else { ByteOne::Index(raw.index) },
                ..SlaveReading::of(raw, self.size, self.kinds.map(|kinds| kinds[n as usize - 1]), self.is_op())
            }),
            SlotRole::Sdo => SlotMeaning::SdoResponse(SdoResponse::decode(raw)),
        })
    }

    /// The lines of the dump in order, each with the number of its slot.
    pub fn lines(&self) -> impl Iterator<Item = (usize, SlotLine)> + use<'a> {
        let dump = *self;
        lines_of_slots(dump.size, dump.with_idle_slots, move |i| dump.line(i))
    }

    /// Whether the network is in OP. There the slaves' slots hold process data, in which zeros are values. Before OP
    /// they may hold only an id.
    fn is_op(&self) -> bool {
        MasterResponse::decode(&self.frame.slot(self.size, 0)).state.state() == Some(MasterState::Op)
    }
}

fn lines_of_slots(
    size: SlotSize,
    with_idle_slots: bool,
    line: impl Fn(usize) -> Option<SlotLine>,
) -> impl Iterator<Item = (usize, SlotLine)> {
    let lines = (0..size.slots()).filter_map(move |i| Some((i, line(i)?)));
    lines.filter(move |(_, line)| with_idle_slots || !line.is_idle())
}
