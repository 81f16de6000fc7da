//! The header that USBPcap puts before the bytes of a USB transfer, in captures that Wireshark makes on Windows.
//!
//! The link type is LINKTYPE_USBPCAP (249). Numbers are little endian, in files of any byte order. Source:
//! `USBPCAP_BUFFER_PACKET_HEADER` in USBPcap's description of its format (desowin.org/usbpcap/captureformat.html).

use bytemuck::{Pod, Zeroable};
use pcap_file::DataLink;

use super::transfer::{Stage, TransferKind, UsbEvent};
use crate::recording::address::Address;

/// The length of the header with which the packets of all transfers begin, bytes. Packets of some kinds of transfer
/// have further fields after it.
const HEADER_LEN: usize = size_of::<RawHeader>();
/// The bit of `info` that means "from the device's driver to the caller": the packet is the end of a transfer.
const IS_ANSWER: u8 = 1;
/// The bit of an endpoint's address that means "to the host".
const TO_HOST: u8 = 0x80;
/// The endpoint number of a transfer whose pipe was opened before the capture began.
const UNKNOWN_ENDPOINT: u8 = 0xFF;

/// Codes of transfer types. Other codes are bulk and isochronous transfers.
const INTERRUPT: u8 = 1;
const CONTROL: u8 = 2;

/// The stages of a control transfer. The byte after the header has one of them.
const STAGE_SETUP: u8 = 0;
const STAGE_DATA: u8 = 1;
const STAGE_COMPLETE: u8 = 3;
/// The length of a setup packet, bytes.
const SETUP_LEN: usize = 8;

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct RawHeader {
    header_len: [u8; 2],
    irp: [u8; 8],
    status: [u8; 4],
    function: [u8; 2],
    info: u8,
    bus: [u8; 2],
    device: [u8; 2],
    endpoint: u8,
    transfer: u8,
    data_length: [u8; 4],
}

const _: () = assert!(HEADER_LEN == 27 && align_of::<RawHeader>() == 1);

/// Whether packets of this link type begin with this header.
pub(super) fn is_usbpcap(link_type: DataLink) -> bool {
    link_type == DataLink::USBPCAP
}

/// Decodes a packet; `None` if it is too short for its header, or is at a stage of a control transfer that the reader
/// does not need.
pub(super) fn event(packet: &[u8]) -> Option<UsbEvent<'_>> {
    let start = packet.first_chunk::<HEADER_LEN>()?;
    let header: RawHeader = bytemuck::cast(*start);
    let header_len = usize::from(u16::from_le_bytes(header.header_len));
    let data = packet.get(header_len.max(HEADER_LEN)..)?;
    let length = u32::from_le_bytes(header.data_length);
    let data = &data[..data.len().min(length as usize)];
    let ended = header.info & IS_ANSWER != 0;
    let done = header.status == [0; 4];
    let at = Address {
        bus: u16::from_le_bytes(header.bus),
        // USBPcap writes 0xFFFF for a device that it does not know. Such packets get the device number 255, which no
        // real device has: a bus has 127 devices at most.
        device: u8::try_from(u16::from_le_bytes(header.device)).unwrap_or(u8::MAX),
    };
    let id = u64::from_le_bytes(header.irp);
    let stage = if ended { Stage::Ended { done } } else { Stage::Submitted };
    let unknown = header.endpoint == UNKNOWN_ENDPOINT;
    let event = UsbEvent {
        at,
        kind: TransferKind::Other,
        stage,
        to_host: header.endpoint & TO_HOST != 0,
        id,
        setup: None,
        length,
        data,
    };
    match header.transfer {
        CONTROL => control(event, *packet.get(HEADER_LEN)?),
        // The endpoint is unknown, so the direction follows from the packet that has the bytes: the request (OUT) or
        // the answer (IN).
        _ if unknown => Some(UsbEvent { kind: TransferKind::Interrupt, to_host: ended && length > 0, ..event }),
        INTERRUPT => Some(UsbEvent { kind: TransferKind::Interrupt, ..event }),
        _ => Some(event),
    }
}

/// Decodes a packet of a control transfer. Since USBPcap 1.5 the bytes of an OUT transfer follow the setup packet, and
/// those of an IN transfer are in the last packet. Older versions have the bytes in a packet of their own. `None`: the
/// stage is another one, or the packet has no whole setup packet.
fn control(event: UsbEvent<'_>, stage: u8) -> Option<UsbEvent<'_>> {
    let event = UsbEvent { kind: TransferKind::Control, ..event };
    match stage {
        STAGE_SETUP => {
            let setup = *event.data.first_chunk::<SETUP_LEN>()?;
            let length = event.length.saturating_sub(SETUP_LEN as u32);
            let (to_host, data) = (setup[0] & TO_HOST != 0, &event.data[SETUP_LEN..]);
            Some(UsbEvent { stage: Stage::Submitted, setup: Some(setup), to_host, length, data, ..event })
        }
        STAGE_DATA | STAGE_COMPLETE => Some(event),
        _ => None,
    }
}
