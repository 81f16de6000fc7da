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
//! Nothing of a frame is kept back: where a slot has bytes set that its meaning does not use, or no meaning at all,
//! the line ends with the raw fields and the reason. A line that says nothing of the raw fields is thus complete.

mod meaning;
mod text;

use super::{
    CrcStatus, Frame, MasterCommand, MasterResponse, RawSlot, SdoCommand, SdoResponse, SlaveKind, SlotCommand,
};
use super::{MasterState, SlotSize};

pub use meaning::{ByteOne, SlaveData, SlaveReading, SlotKind, SlotMeaning};

/// Slaves of the larger of the two frames: the length of a list of slave kinds.
pub const MAX_SLAVES: usize = SlotSize::Bytes12.max_slaves();

/// What a slot of a frame is for (SK-1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlotRole {
    /// Slot 0: the board itself.
    Master,
    /// Slots 1..=40 (30): this slave.
    Slave(u8),
    /// Slot 41 (31): SDO transfers.
    Sdo,
}

impl SlotRole {
    /// The role of slot `i`, `None` if a frame of this size has no such slot.
    pub const fn of(size: SlotSize, i: usize) -> Option<Self> {
        match i {
            0 => Some(Self::Master),
            i if i < size.sdo_slot() => Some(Self::Slave(i as u8)),
            i if i == size.sdo_slot() => Some(Self::Sdo),
            _ => None,
        }
    }
}

/// One slot of a frame: what it is for, what it holds and what that means. Its `Display` is one line without the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotLine {
    /// What the slot is for.
    pub role: SlotRole,
    /// Bytes of the slot.
    pub size: SlotSize,
    /// Its content as it stands in the frame; in slot 0 the high byte of `parm` is the frame's CRC.
    pub raw: RawSlot,
    /// What the content means.
    pub meaning: SlotMeaning,
    /// The frame's CRC; in slot 0 alone.
    pub crc: Option<CrcStatus>,
}

impl SlotLine {
    /// Whether the slot asks or tells nothing, all bytes 0. Slot 0 is never idle: it has the CRC and the state.
    pub const fn is_idle(&self) -> bool {
        !matches!(self.role, SlotRole::Master) && self.raw.is_zero()
    }

    /// The content with the CRC taken out of slot 0.
    const fn fields(&self) -> RawSlot {
        match self.role {
            SlotRole::Master => RawSlot { parm: self.raw.parm & 0xFF, ..self.raw },
            _ => self.raw,
        }
    }
}

/// A command frame, readable. `Display` prints the lines of [`Self::lines`].
#[derive(Clone, Copy, Debug)]
pub struct CommandDump<'a> {
    frame: &'a Frame,
    size: SlotSize,
    all: bool,
}

impl<'a> CommandDump<'a> {
    /// The slots of `frame` that ask for something, and slot 0.
    pub const fn new(frame: &'a Frame, size: SlotSize) -> Self {
        Self { frame, size, all: false }
    }

    /// All slots, those that ask for nothing too.
    pub const fn all(self) -> Self {
        Self { all: true, ..self }
    }

    /// Slot `i`, idle or not; `None` if the frame has no such slot.
    pub fn line(&self, i: usize) -> Option<SlotLine> {
        let role = SlotRole::of(self.size, i)?;
        let raw = self.frame.slot(self.size, i);
        let meaning = match role {
            SlotRole::Master => MasterCommand::decode(&raw, self.size).map(SlotMeaning::MasterCommand),
            SlotRole::Slave(_) => SlotCommand::decode(&raw, self.size).map(SlotMeaning::SlaveCommand),
            SlotRole::Sdo => SdoCommand::decode(&raw, self.size).map(SlotMeaning::SdoCommand),
        };
        let meaning = meaning.unwrap_or_else(SlotMeaning::Malformed);
        Some(SlotLine { role, size: self.size, raw, meaning, crc: crc_of(self.frame, self.size, role) })
    }

    /// The slots to show in order, each with its number.
    pub fn lines(&self) -> impl Iterator<Item = (usize, SlotLine)> + use<'a> {
        let dump = *self;
        shown(dump.size, dump.all, move |i| dump.line(i))
    }
}

/// A response frame, readable. `Display` prints the lines of [`Self::lines`].
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
/// What kind of slave a slot belongs to is not on the wire. With [`Self::kinds`] every slot is read as what it is.
/// Without, a slot is read as follows, and its [`SlotKind`] says how sure that is `[OURS]`:
/// - id IO_RD or IO_WR: an IO slave, no other has these; id CST: a drive, no other has it;
/// - bytes 12..15 not 0: a two-channel HSP, guessed;
/// - the id of another drive command, or Parm (the statusword, if it is one) not 0: a drive, guessed. A stepper's slot
///   has the same layout; of an HSP's slot statusword and position are right, but its inputs are shown as torque;
/// - otherwise, Data1 within 16 bits and Data2 zero: an IO slave, guessed;
/// - anything else is not read: its raw fields are shown.
#[derive(Clone, Copy, Debug)]
pub struct ResponseDump<'a> {
    frame: &'a Frame,
    size: SlotSize,
    all: bool,
    kinds: Option<&'a [SlaveKind; MAX_SLAVES]>,
    mode_in_byte_1: bool,
}

impl<'a> ResponseDump<'a> {
    /// The slots of `frame` that tell something, and slot 0; kinds of slaves unknown, byte 1 a command index.
    pub const fn new(frame: &'a Frame, size: SlotSize) -> Self {
        Self { frame, size, all: false, kinds: None, mode_in_byte_1: false }
    }

    /// All slots, those that tell nothing too.
    pub const fn all(self) -> Self {
        Self { all: true, ..self }
    }

    /// What the slaves are: slave n is `kinds[n - 1]`, as the application said with SET_AXIS.
    pub const fn kinds(self, kinds: &'a [SlaveKind; MAX_SLAVES]) -> Self {
        Self { kinds: Some(kinds), ..self }
    }

    /// Byte 1 of a slave's slot is its mode of operation, as firmware 1.5 sends it, and not the command index (SK-3).
    pub const fn mode_in_byte_1(self) -> Self {
        Self { mode_in_byte_1: true, ..self }
    }

    /// Slot `i`, idle or not; `None` if the frame has no such slot.
    pub fn line(&self, i: usize) -> Option<SlotLine> {
        let role = SlotRole::of(self.size, i)?;
        let raw = self.frame.slot(self.size, i);
        let meaning = match role {
            SlotRole::Master => SlotMeaning::MasterResponse(MasterResponse::decode(&raw)),
            SlotRole::Slave(n) => SlotMeaning::SlaveResponse(SlaveReading {
                byte_one: if self.mode_in_byte_1 { ByteOne::Mode(raw.index) } else { ByteOne::Index(raw.index) },
                ..SlaveReading::of(&raw, self.size, self.kinds.map(|kinds| kinds[n as usize - 1]), self.is_op())
            }),
            SlotRole::Sdo => SlotMeaning::SdoResponse(SdoResponse::decode(&raw)),
        };
        Some(SlotLine { role, size: self.size, raw, meaning, crc: crc_of(self.frame, self.size, role) })
    }

    /// The slots to show in order, each with its number.
    pub fn lines(&self) -> impl Iterator<Item = (usize, SlotLine)> + use<'a> {
        let dump = *self;
        shown(dump.size, dump.all, move |i| dump.line(i))
    }

    /// In OP slaves' slots hold fresh data; before it they may hold nothing but an id.
    fn is_op(&self) -> bool {
        MasterResponse::decode(&self.frame.slot(self.size, 0)).state.state() == Some(MasterState::Op)
    }
}

fn crc_of(frame: &Frame, size: SlotSize, role: SlotRole) -> Option<CrcStatus> {
    (role == SlotRole::Master).then(|| frame.crc_status(size))
}

fn shown(
    size: SlotSize,
    all: bool,
    line: impl Fn(usize) -> Option<SlotLine>,
) -> impl Iterator<Item = (usize, SlotLine)> {
    (0..size.slots()).filter_map(move |i| Some((i, line(i)?))).filter(move |(_, line)| all || !line.is_idle())
}
