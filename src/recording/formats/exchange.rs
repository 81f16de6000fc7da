//! Packets of a chip ECM-XF, as `record=` of a link to a chip writes them: a byte for the direction, then the bytes.

use pcap_file::DataLink;

use crate::sk::Dir;

/// The link type of such packets: USER15. \[OURS] No standard type is meant for them, and of the sixteen for private use
/// the last one is the least likely to be taken by a user's own settings of Wireshark.
pub(crate) const LINK_TYPE: DataLink = DataLink::USER15;

/// The byte in front of bytes to the chip.
const TO_CHIP: u8 = 0;
/// The byte in front of bytes from the chip.
const FROM_CHIP: u8 = 1;

/// The byte in front of the bytes.
pub(crate) const fn mark(dir: Dir) -> u8 {
    match dir {
        Dir::Write => TO_CHIP,
        Dir::Read => FROM_CHIP,
    }
}

/// Direction and bytes of a packet; `None` if it is none of ours.
pub(in crate::recording) fn parse(data: &[u8]) -> Option<(Dir, &[u8])> {
    match data.split_first()? {
        (&TO_CHIP, bytes) => Some((Dir::Write, bytes)),
        (&FROM_CHIP, bytes) => Some((Dir::Read, bytes)),
        _ => None,
    }
}
