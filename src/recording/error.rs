//! The errors of reading a recording.

use super::address::Address;

/// Why a recording cannot be read, or only in part.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RecordError {
    /// The operating system reports an error.
    #[error("{name}: {message}; check the path and who may read it")]
    Io {
        /// The name of the file, for the message.
        name: String,
        /// The message of the operating system.
        message: String,
    },
    /// The beginning of the file is not that of a recording or a capture.
    #[error(
        "{name} is no recording (.ecmrec, .pcapng) and no capture (pcapng, pcap); make one with the link key record= or with Wireshark"
    )]
    NotACapture {
        /// The name of the file, for the message.
        name: String,
    },
    /// The file ends inside a block.
    #[error(
        "{name} ends in the middle of the block at byte {offset}; the frames before it are whole; close the link, or stop the capture, before copying its file"
    )]
    Truncated {
        /// The name of the file, for the message.
        name: String,
        /// The offset of the block in the file, bytes.
        offset: u64,
    },
    /// A block is malformed.
    #[error("{name} is damaged at byte {offset}: {reason}; the frames before it are whole; record again")]
    Malformed {
        /// The name of the file, for the message.
        name: String,
        /// The offset of the block in the file, bytes.
        offset: u64,
        /// What is wrong with the block.
        reason: String,
    },
    /// The file begins like a recording in blocks (`.ecmrec`), and no block of it can be read.
    #[error("nothing of {name} can be read: it is {damage}")]
    Unreadable {
        /// The name of the file, for the message.
        name: String,
        /// What is damaged, whether a newer version wrote it, and what to do.
        damage: String,
    },
    /// The file has no USB traffic, so it cannot be a capture of a board.
    #[error(
        "{name} holds no USB traffic (link types 220 and 189 of Linux, 249 of Windows) but {found}; record with record= or capture usbmon or USBPcap"
    )]
    NoUsb {
        /// The name of the file, for the message.
        name: String,
        /// The link types in the file.
        found: String,
    },
    /// The file is a recording of an ECM-XF.
    #[error(
        "{name} is the recording of a chip ECM-XF (link type USER15) and not of a board; `ecmsk dump` shows its packets, and so \
         does Wireshark"
    )]
    OfChip {
        /// The name of the file, for the message.
        name: String,
    },
    /// The file is a recording of Ethernet frames.
    #[error(
        "{name} holds Ethernet frames, as `ecmsk serve ethercat` records them, and not the recording of a board; Wireshark and tshark \
         show them"
    )]
    OfNetwork {
        /// The name of the file, for the message.
        name: String,
    },
    /// The file has USB traffic, but none of a board.
    #[error(
        "{name} holds no frames of a board (interrupt transfers of 512 bytes) but {found}; capture the bus of the board (16c0:05df) while the program runs"
    )]
    NoBoard {
        /// The name of the file, for the message.
        name: String,
        /// The devices in the file.
        found: String,
    },
    /// Several devices may be the board.
    #[error("{name} holds {found}, each of which may be the board; choose one with --device {example}")]
    SeveralBoards {
        /// The name of the file, for the message.
        name: String,
        /// The devices that may be the board.
        found: String,
        /// The address of one of them.
        example: Address,
    },
    /// The selected device has no frames.
    #[error("{name} holds no frames of device {asked} but {found}; name one that has some with --device")]
    NoSuchDevice {
        /// The name of the file, for the message.
        name: String,
        /// The address of the selected device.
        asked: Address,
        /// The devices in the file.
        found: String,
    },
    /// A packet has fewer bytes than its transfer, because the capture cut it off.
    #[error(
        "{name}: the frame at byte {offset} was captured to {captured} of {length} bytes; capture whole packets (snap length 0)"
    )]
    Cut {
        /// The name of the file, for the message.
        name: String,
        /// The offset of the block in the file, bytes.
        offset: u64,
        /// The number of bytes in the packet.
        captured: usize,
        /// The number of bytes of the transfer.
        length: u32,
    },
}
