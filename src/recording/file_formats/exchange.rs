//! Packets of an ECM-XF, as the key `record=` of a link to a chip writes them: one byte for the direction, then the
//! bytes of the exchange.

use pcap_file::DataLink;

use crate::sk::Dir;

/// The link type of these packets: USER15. \[OURS] No standard type exists for them, and of the sixteen types for
/// private use the last one is the least likely to be in a user's own settings of Wireshark.
pub(crate) const LINK_TYPE: DataLink = DataLink::USER15;

/// The first byte of a packet to the chip.
const TO_CHIP: u8 = 0;
/// The first byte of a packet from the chip.
const FROM_CHIP: u8 = 1;

/// The first byte of a packet, which gives its direction.
pub(crate) const fn mark(dir: Dir) -> u8 {
    match dir {
        Dir::Write => TO_CHIP,
        Dir::Read => FROM_CHIP,
    }
}

/// The direction and the bytes of a packet; `None` if the first byte is unknown.
pub(in crate::recording) fn parse(data: &[u8]) -> Option<(Dir, &[u8])> {
    match data.split_first()? {
        (&TO_CHIP, bytes) => Some((Dir::Write, bytes)),
        (&FROM_CHIP, bytes) => Some((Dir::Read, bytes)),
        _ => None,
    }
}
