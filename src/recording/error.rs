//! Why a recording cannot be read.

use super::address::Address;

/// Why a recording cannot be read, or not further.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RecordError {
    /// The operating system said no.
    #[error("{name}: {message}; check the path and who may read it")]
    Io {
        /// The file.
        name: String,
        /// The system's words.
        message: String,
    },
    /// It begins like no capture.
    #[error("{name} is neither a pcapng nor a pcap file; make one with the link key record= or with Wireshark")]
    NotACapture {
        /// The file.
        name: String,
    },
    /// It ends inside a block.
    #[error(
        "{name} ends in the middle of the block at byte {offset}; the frames before it are whole; close the link, or stop the capture, before copying its file"
    )]
    Truncated {
        /// The file.
        name: String,
        /// Where the block begins.
        offset: u64,
    },
    /// A block that cannot be.
    #[error("{name} is damaged at byte {offset}: {reason}; the frames before it are whole; record again")]
    Malformed {
        /// The file.
        name: String,
        /// Where the block begins.
        offset: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// No packet in it can be one of a board.
    #[error(
        "{name} holds no USB traffic (link types 220 and 189 of Linux, 249 of Windows) but {found}; record with record= or capture usbmon or USBPcap"
    )]
    NoUsb {
        /// The file.
        name: String,
        /// The link types it has.
        found: String,
    },
    /// It is a recording of a chip.
    #[error(
        "{name} is the recording of a chip ECM-XF (link type USER15) and not of a board; `ecmsk dump` shows its packets, and so \
         does Wireshark"
    )]
    OfChip {
        /// The file.
        name: String,
    },
    /// It is a recording of Ethernet frames.
    #[error(
        "{name} holds Ethernet frames, as `ecmsk serve ethercat` records them, and not the recording of a board; Wireshark and tshark \
         show them"
    )]
    OfNetwork {
        /// The file.
        name: String,
    },
    /// There is USB traffic, and none of a board.
    #[error(
        "{name} holds no frames of a board (interrupt transfers of 512 bytes) but {found}; capture the bus of the board (16c0:05df) while the program runs"
    )]
    NoBoard {
        /// The file.
        name: String,
        /// The devices it has.
        found: String,
    },
    /// More than one device may be the board.
    #[error("{name} holds {found}, each of which may be the board; choose one with --device {example}")]
    SeveralBoards {
        /// The file.
        name: String,
        /// Those devices.
        found: String,
        /// One of them.
        example: Address,
    },
    /// The device asked for moved no frame.
    #[error("{name} holds no frames of device {asked} but {found}; name one that has some with --device")]
    NoSuchDevice {
        /// The file.
        name: String,
        /// What was asked for.
        asked: Address,
        /// The devices it has.
        found: String,
    },
    /// A packet holds less than the frame that passed.
    #[error(
        "{name}: the frame at byte {offset} was captured to {captured} of {length} bytes; capture whole packets (snap length 0)"
    )]
    Cut {
        /// The file.
        name: String,
        /// Where the block begins.
        offset: u64,
        /// Bytes there are.
        captured: usize,
        /// Bytes that passed.
        length: u32,
    },
}
