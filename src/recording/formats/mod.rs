//! The formats of recordings and captures.
//!
//! A file has two layers. [`container`] reads the outer one, the blocks of a pcapng file or of the older pcap. In each
//! packet there is a header in front of the bytes of a USB transfer, and which one depends on who captured: [`usbmon`] of
//! Linux, which our own recordings have too, or [`usbpcap`] on Windows. Either header becomes an [`Event`].
//!
//! Recordings of a chip hold no USB transfers: [`exchange`].
//!
//! A further header is a file beside these two, and a line in [`is_usb`] and in [`event`].

pub(super) mod container;
pub(crate) mod exchange;
pub mod transfer;
pub(crate) mod usbmon;
mod usbpcap;

use pcap_file::{DataLink, Endianness};

use container::Packet;
use transfer::Event;

/// Whether packets of that link type are USB transfers that can be read.
pub(super) fn is_usb(link_type: DataLink) -> bool {
    usbmon::is_usbmon(link_type) || usbpcap::is_usbpcap(link_type)
}

/// What a packet tells of a USB transfer; `None` if it tells nothing that matters.
pub(super) fn event<'a>(packet: &Packet<'a>) -> Option<Event<'a>> {
    match packet.link_type {
        link_type if usbpcap::is_usbpcap(link_type) => usbpcap::event(packet.data),
        link_type => usbmon::event(link_type, packet.order, packet.data),
    }
}

/// A number in the byte order of a file.
const fn number(order: Endianness, bytes: [u8; 4]) -> u32 {
    match order {
        Endianness::Little => u32::from_le_bytes(bytes),
        Endianness::Big => u32::from_be_bytes(bytes),
    }
}
