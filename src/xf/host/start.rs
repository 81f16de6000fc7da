//! The steps from a chip of which nothing is known to one that takes commands: the usual start of an application (OBS).

use core::fmt;

use crate::xf::request::{
    CrcTypeSet, FifoClear, FifoEnable, Fifos, FirmwareVersionGet, InfoUpdate, Request, SpiPackSizeGet, SpiReconfig,
};
use crate::xf::{CheckType, Control, DataSize};

/// A step of the start. Each may be done twice without harm, so that one whose answer is lost is done again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StartStep {
    /// Packets are found in the stream of bytes, and with them n.
    Search,
    /// CRC_TYPE_SET 3: CRC-32; again behind [`Self::Resize`], since nobody says whether the type outlives that.
    CheckType,
    /// CRC_TYPE_SET 0: the fixed word, since the CRC-32 of the chip covers nothing that is known.
    FixedWord,
    /// SPI_PACK_SIZE_GET: the chip is asked for n.
    PackSize,
    /// SPI_PACK_SIZE_GET once more, with another length: it shows whether a CRC-32 covers whole words of 4 bytes.
    Coverage,
    /// SPI_RECONFIG_OP: the chip is set to the n that is wanted.
    Resize,
    /// FW_VERSION_GET.
    Version,
    /// INFO_UPDATE until the chip is not busy; errors of before are cleared.
    NotBusy,
    /// FIFO_ENABLE 0: the RxFIFO is not put out.
    FifoOff,
    /// FIFO_CLR_OP: both FIFOs are emptied.
    FifoClear,
}

impl StartStep {
    /// What is sent in this step; `wanted` is the n that [`Self::Resize`] sets.
    pub(super) fn request(self, wanted: DataSize) -> Request<'static> {
        match self {
            Self::PackSize | Self::Coverage => SpiPackSizeGet.into(),
            Self::FixedWord => CrcTypeSet { kind: CheckType::Fixed }.into(),
            Self::Resize => SpiReconfig { size: wanted }.into(),
            Self::CheckType => CrcTypeSet { kind: CheckType::Crc32 }.into(),
            Self::Version => FirmwareVersionGet.into(),
            // While packets are searched none is sent.
            Self::Search | Self::NotBusy => InfoUpdate.into(),
            Self::FifoOff => FifoEnable { on: false }.into(),
            Self::FifoClear => FifoClear { fifos: Fifos::Both }.into(),
        }
    }

    /// The length field of this step's packet, where it is not that of its data. \[OURS] No source says that a command may have
    /// one without data.
    pub(super) const fn len(self) -> u16 {
        match self {
            Self::Coverage => 1,
            _ => 0,
        }
    }

    /// The errors that the packet of this step clears.
    pub(super) const fn control(self) -> Control {
        match self {
            Self::NotBusy => Control::CLEAR_ALL,
            _ => Control::NONE,
        }
    }

    /// The step behind this one; `None` after the last one. [`Self::Resize`], [`Self::FixedWord`] and [`Self::Coverage`] stand
    /// beside the order.
    ///
    /// `[OURS]` Applications ask for n first (OBS). Here the check word is set first, so that one packet alone has the
    /// fixed word, with which a bit that flips goes unnoticed.
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
