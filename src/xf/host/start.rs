//! The steps that start a chip of unknown state, until it accepts commands: the usual start of an application (OBS).

use core::fmt;

use crate::xf::request::{
    CrcTypeSet, FifoClear, FifoEnable, Fifos, FirmwareVersionGet, InfoUpdate, Request, SpiPackSizeGet, SpiReconfig,
};
use crate::xf::{CheckType, Control, DataSize};

/// A step of the chip's start. Each step may be repeated without harm, and is repeated if its answer is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StartStep {
    /// Packets and their data segment size n are searched in the stream of bytes.
    Search,
    /// CRC_TYPE_SET 3: CRC-32. This is repeated after [`Self::Resize`], since no source says whether the check type
    /// survives it.
    CheckType,
    /// CRC_TYPE_SET 0: the fixed check word, if the chip's CRC-32 fits no known coverage.
    FixedWord,
    /// SPI_PACK_SIZE_GET: reads the chip's data segment size n.
    PackSize,
    /// SPI_PACK_SIZE_GET again, with another length, which shows whether a CRC-32 covers whole words of 4 bytes.
    Coverage,
    /// SPI_RECONFIG_OP: sets the chip to the wanted data segment size n.
    Resize,
    /// FW_VERSION_GET: reads the firmware's version.
    Version,
    /// INFO_UPDATE until the chip is not busy; clears earlier errors.
    NotBusy,
    /// FIFO_ENABLE 0: the chip stops taking RxPDOs out of the RxFIFO.
    FifoOff,
    /// FIFO_CLR_OP: empties both FIFOs.
    FifoClear,
}

impl StartStep {
    /// The request to send in this step; `wanted` is the data segment size that [`Self::Resize`] sets.
    pub(super) fn request(self, wanted: DataSize) -> Request<'static> {
        match self {
            Self::PackSize | Self::Coverage => SpiPackSizeGet.into(),
            Self::FixedWord => CrcTypeSet { kind: CheckType::Fixed }.into(),
            Self::Resize => SpiReconfig { size: wanted }.into(),
            Self::CheckType => CrcTypeSet { kind: CheckType::Crc32 }.into(),
            Self::Version => FirmwareVersionGet.into(),
            // During the search no request is sent.
            Self::Search | Self::NotBusy => InfoUpdate.into(),
            Self::FifoOff => FifoEnable { on: false }.into(),
            Self::FifoClear => FifoClear { fifos: Fifos::Both }.into(),
        }
    }

    /// The length field of this step's packet, if it differs from the length of its data. \[OURS] The step
    /// [`Self::Coverage`] sets a length although its command has no data; no source says that a command may do so.
    pub(super) const fn len(self) -> u16 {
        match self {
            Self::Coverage => 1,
            _ => 0,
        }
    }

    /// The control byte of this step's packet: which errors it clears.
    pub(super) const fn control(self) -> Control {
        match self {
            Self::NotBusy => Control::CLEAR_ALL,
            _ => Control::NONE,
        }
    }

    /// The next step; `None` after the last one. Some steps are inserted when they are needed: [`Self::Resize`] and
    /// [`Self::Coverage`] after [`Self::PackSize`], and [`Self::FixedWord`] when CRC-32 is given up.
    ///
    /// `[OURS]` Applications read the data segment size first (OBS). This driver sets the check word first, so that
    /// only one packet has the fixed word, with which bit errors go unnoticed.
    pub(super) const fn next(self) -> Option<Self> {
        match self {
            Self::Search | Self::Resize => Some(Self::CheckType),
            Self::CheckType | Self::FixedWord => Some(Self::PackSize),
            Self::PackSize | Self::Coverage => Some(Self::Version),
            Self::Version => Some(Self::NotBusy),
            Self::NotBusy => Some(Self::FifoOff),
            Self::FifoOff => Some(Self::FifoClear),
            Self::FifoClear => None,
        }
    }
}

impl fmt::Display for StartStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Search => "the search for packets",
            Self::PackSize | Self::Coverage => "SPI_PACK_SIZE_GET",
            Self::Resize => "SPI_RECONFIG_OP",
            Self::CheckType | Self::FixedWord => "CRC_TYPE_SET",
            Self::Version => "FW_VERSION_GET",
            Self::NotBusy => "INFO_UPDATE until the chip is not busy",
            Self::FifoOff => "FIFO_ENABLE",
            Self::FifoClear => "FIFO_CLR_OP",
        })
    }
}
