//! The formats of recordings and captures.
//!
//! A file has two layers. [`container`] reads the outer one, the blocks of a pcapng file, of the older pcap, or of
//! [`ecmrec`], for recordings of weeks; [`input`] reads the bytes of the file. In each
//! packet a header precedes the bytes of a USB transfer. The header depends on the capturing program: [`usbmon`] on
//! Linux, which recordings of this crate use too, or [`usbpcap`] on Windows. Either header becomes a [`UsbEvent`].
//!
//! Recordings of a chip have packets of another kind: [`exchange`].
//!
//! To support the header of another program, add a file beside `usbmon.rs` and `usbpcap.rs`, and a line in [`is_usb`]
//! and in [`event`].

pub(super) mod container;
pub(crate) mod ecmrec;
pub(crate) mod exchange;
mod input;
pub mod transfer;
pub(crate) mod usbmon;
mod usbpcap;

use pcap_file::{DataLink, Endianness};

use container::Packet;
use transfer::UsbEvent;

/// Whether packets of this link type are USB transfers that can be read.
pub(super) fn is_usb(link_type: DataLink) -> bool {
    usbmon::is_usbmon(link_type) || usbpcap::is_usbpcap(link_type)
}

/// Decodes the header of a USB transfer; `None` if the packet is too short for it, or is at a stage of a transfer that
/// the reader does not need.
pub(super) fn event<'a>(packet: &Packet<'a>) -> Option<UsbEvent<'a>> {
    match packet.link_type {
        link_type if usbpcap::is_usbpcap(link_type) => usbpcap::event(packet.data),
        link_type => usbmon::event(link_type, packet.order, packet.data),
    }
}

/// Converts four bytes in the byte order of a file to a number.
const fn number(order: Endianness, bytes: [u8; 4]) -> u32 {
    match order {
        Endianness::Little => u32::from_le_bytes(bytes),
        Endianness::Big => u32::from_be_bytes(bytes),
    }
}
