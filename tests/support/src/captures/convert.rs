//! Captures as files of every kind: packets of usbmon with its two headers and with that of USBPcap.
//!
//! There is no Windows among the machines of the tests: a USBPcap capture here is a capture of Linux' usbmon with other
//! headers, laid out as USBPcap's description of its format has them (desowin.org/usbpcap/captureformat.html). The
//! differences of Windows' own drivers (other transfers while the device is set up, other timing) are not in it.

/// A packet of usbmon: an event of a transfer (Documentation/usb/usbmon.rst of Linux).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    pub id: u64,
    /// `S` submitted, `C` completed, `E` refused.
    pub what: u8,
    /// 0 isochronous, 1 interrupt, 2 control, 3 bulk; USBPcap has the same numbers.
    pub transfer: u8,
    pub endpoint: u8,
    pub device: u8,
    pub bus: u16,
    pub setup: Option<[u8; 8]>,
    pub status: i32,
    pub length: u32,
    /// `None`: the packet has no data, as the submission of a read.
    pub data: Option<Vec<u8>>,
    pub at_us: u64,
}

/// Link types.
pub const USB_LINUX: u32 = 189;
pub const USB_LINUX_MMAPPED: u32 = 220;
pub const USBPCAP: u32 = 249;

const PCAP_HEADER: usize = 24;
const RECORD_HEADER: usize = 16;
const USBMON_HEADER: usize = 48;

/// The packets of a pcap file with link type 189, as `tests/rig/captured.rs` writes it.
pub fn events(file: &[u8]) -> Vec<Event> {
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().expect("four bytes"));
    assert_eq!((word(0), word(20)), (0xA1B2_C3D4, USB_LINUX), "a pcap file of link type 189");
    let mut events = Vec::new();
    let mut at = PCAP_HEADER;
    while at < file.len() {
        let (seconds, us, len) = (word(at), word(at + 4), word(at + 8) as usize);
        at += RECORD_HEADER;
        events.push(event(&file[at..at + len], u64::from(seconds) * 1_000_000 + u64::from(us)));
        at += len;
    }
    events
}

fn event(packet: &[u8], at_us: u64) -> Event {
    let number = |at: usize| u32::from_le_bytes(packet[at..at + 4].try_into().expect("four bytes"));
    Event {
        id: u64::from_le_bytes(packet[..8].try_into().expect("eight bytes")),
        what: packet[8],
        transfer: packet[9],
        endpoint: packet[10],
        device: packet[11],
        bus: u16::from_le_bytes([packet[12], packet[13]]),
        setup: (packet[14] == 0).then(|| packet[40..48].try_into().expect("eight bytes")),
        status: number(28) as i32,
        length: number(32),
        data: (packet[15] == 0).then(|| packet[USBMON_HEADER..].to_vec()),
        at_us,
    }
}

/// A packet with usbmon's header of 48 bytes, or of 64.
fn usbmon(event: &Event, header_len: usize) -> Vec<u8> {
    let data = event.data.as_deref().unwrap_or_default();
    let mut packet = event.id.to_le_bytes().to_vec();
    packet.extend([event.what, event.transfer, event.endpoint, event.device]);
    packet.extend(event.bus.to_le_bytes());
    packet.push(if event.setup.is_some() { 0 } else { b'-' });
    packet.push(if event.data.is_some() {
        0
    } else if event.what == b'S' {
        b'<'
    } else {
        b'>'
    });
    packet.extend((event.at_us / 1_000_000).to_le_bytes());
    packet.extend(((event.at_us % 1_000_000) as u32).to_le_bytes());
    packet.extend(event.status.to_le_bytes());
    packet.extend(event.length.to_le_bytes());
    packet.extend((data.len() as u32).to_le_bytes());
    packet.extend(event.setup.unwrap_or_default());
    packet.resize(header_len, 0);
    packet.extend(data);
    packet
}

/// How a file of USBPcap divides a control transfer into packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parts {
    /// Since 1.5: the setup packet with the bytes of an OUT transfer, then an answer with those of an IN transfer.
    Two,
    /// Before: the setup packet, the bytes, and an empty answer, in a packet each.
    Three,
}

/// Packets with USBPcap's header: 27 bytes, and for control transfers the part of it.
fn usbpcap(event: &Event, parts: Parts) -> Vec<Vec<u8>> {
    const CANCELLED: u32 = 0xC001_0000;
    let answer = event.what != b'S';
    let data = event.data.clone().unwrap_or_default();
    let packet = |info: u8, part: Option<u8>, data: &[u8]| {
        let header_len = 27 + u16::from(part.is_some());
        let mut packet = header_len.to_le_bytes().to_vec();
        packet.extend(event.id.to_le_bytes());
        packet.extend(if event.status == 0 || !answer { 0 } else { CANCELLED }.to_le_bytes());
        // URB_FUNCTION_BULK_OR_INTERRUPT_TRANSFER, URB_FUNCTION_CONTROL_TRANSFER.
        packet.extend(if part.is_some() { 0x0008_u16 } else { 0x0009 }.to_le_bytes());
        packet.push(info);
        packet.extend(event.bus.to_le_bytes());
        packet.extend(u16::from(event.device).to_le_bytes());
        packet.extend([event.endpoint, event.transfer]);
        packet.extend((data.len() as u32).to_le_bytes());
        packet.extend(part);
        packet.extend(data);
        packet
    };
    let (setup, info) = (event.setup.unwrap_or_default(), u8::from(answer));
    match (event.transfer, parts, answer) {
        (2, Parts::Two, false) => vec![packet(info, Some(0), &[&setup[..], &data].concat())],
        (2, Parts::Two, true) => vec![packet(info, Some(3), &data)],
        (2, Parts::Three, false) if data.is_empty() => vec![packet(info, Some(0), &setup)],
        (2, Parts::Three, false) => vec![packet(info, Some(0), &setup), packet(info, Some(1), &data)],
        (2, Parts::Three, true) if data.is_empty() => vec![packet(info, Some(2), &[])],
        (2, Parts::Three, true) => vec![packet(info, Some(1), &data), packet(info, Some(2), &[])],
        _ => vec![packet(info, None, &data)],
    }
}

/// The packets of that link type, each with its time.
fn packets(events: &[Event], link_type: u32, parts: Parts) -> Vec<(u64, Vec<u8>)> {
    let all = events.iter().flat_map(|event| {
        let packets = match link_type {
            USB_LINUX => vec![usbmon(event, USBMON_HEADER)],
            USB_LINUX_MMAPPED => vec![usbmon(event, 64)],
            _ => usbpcap(event, parts),
        };
        packets.into_iter().map(|packet| (event.at_us, packet))
    });
    all.collect()
}

/// A pcap file, cut to `snap` bytes a packet.
pub fn pcap(events: &[Event], link_type: u32, parts: Parts, snap: usize) -> Vec<u8> {
    let header = [0xA1B2_C3D4, 2 | 4 << 16, 0, 0, snap as u32, link_type];
    let mut file: Vec<u8> = header.iter().flat_map(|word: &u32| word.to_le_bytes()).collect();
    for (at_us, packet) in packets(events, link_type, parts) {
        let captured = packet.len().min(snap);
        let words = [(at_us / 1_000_000) as u32, (at_us % 1_000_000) as u32, captured as u32, packet.len() as u32];
        file.extend(words.iter().flat_map(|word| word.to_le_bytes()));
        file.extend(&packet[..captured]);
    }
    file
}

/// A pcapng file in microseconds, as Wireshark writes it.
pub fn pcapng(events: &[Event], link_type: u32) -> Vec<u8> {
    let block = |kind: u32, body: Vec<u8>| {
        let length = 12 + body.len().next_multiple_of(4) as u32;
        let mut block = [kind.to_le_bytes(), length.to_le_bytes()].concat();
        block.extend(body);
        block.resize(length as usize - 4, 0);
        block.extend(length.to_le_bytes());
        block
    };
    let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<_>>();
    let mut file = block(0x0A0D_0D0A, words(&[0x1A2B_3C4D, 1, u32::MAX, u32::MAX]));
    file.extend(block(1, words(&[link_type, 0])));
    for (at_us, packet) in packets(events, link_type, Parts::Two) {
        let len = packet.len() as u32;
        let head = words(&[0, (at_us >> 32) as u32, at_us as u32, len, len]);
        file.extend(block(6, [head, packet].concat()));
    }
    file
}
