//! Reading recordings and captures: other writers' files, damaged files, arbitrary bytes.

use ecmsk::link::Dir;
use ecmsk::recording::{RecordError, Recorded, Recording};
use proptest::prelude::*;
use support::recording::{frame, frames, recording_of};

#[derive(Clone, Copy, Debug, PartialEq)]
enum Order {
    Little,
    Big,
}

impl Order {
    fn u16(self, n: u16) -> [u8; 2] {
        if self == Self::Little { n.to_le_bytes() } else { n.to_be_bytes() }
    }

    fn u32(self, n: u32) -> [u8; 4] {
        if self == Self::Little { n.to_le_bytes() } else { n.to_be_bytes() }
    }

    fn u64(self, n: u64) -> [u8; 8] {
        if self == Self::Little { n.to_le_bytes() } else { n.to_be_bytes() }
    }
}

/// A packet of usbmon as the kernel makes it (Documentation/usb/usbmon.rst).
#[derive(Clone)]
struct Usbmon {
    event: u8,
    transfer: u8,
    endpoint: u8,
    flag_data: u8,
    length: u32,
    data: Vec<u8>,
}

fn out(data: &[u8]) -> Usbmon {
    let length = data.len() as u32;
    Usbmon { event: b'S', transfer: 1, endpoint: 0x02, flag_data: 0, length, data: data.to_vec() }
}

fn to_host(data: &[u8]) -> Usbmon {
    Usbmon { event: b'C', endpoint: 0x81, ..out(data) }
}

impl Usbmon {
    fn bytes(&self, order: Order, header_len: usize) -> Vec<u8> {
        let mut bytes = Vec::new();
        bytes.extend(order.u64(0xFFFF_8880_1234_5678));
        bytes.extend([self.event, self.transfer, self.endpoint, 7]);
        bytes.extend(order.u16(3));
        bytes.extend([b'-', self.flag_data]);
        bytes.extend(order.u64(1_600_000_000));
        bytes.extend(order.u32(999_999));
        bytes.extend(order.u32(0));
        bytes.extend(order.u32(self.length));
        bytes.extend(order.u32(self.data.len() as u32));
        bytes.extend([0; 8]);
        bytes.resize(header_len, 0xEE);
        bytes.extend(&self.data);
        bytes
    }
}

fn block(order: Order, kind: u32, body: &[u8]) -> Vec<u8> {
    let length = 12 + body.len().next_multiple_of(4) as u32;
    let mut block = Vec::new();
    block.extend(order.u32(kind));
    block.extend(order.u32(length));
    block.extend(body);
    block.resize(length as usize - 4, 0);
    block.extend(order.u32(length));
    block
}

fn section(order: Order) -> Vec<u8> {
    let body = [&order.u32(0x1A2B_3C4D)[..], &order.u16(1), &order.u16(0), &order.u64(u64::MAX)].concat();
    block(order, 0x0A0D_0D0A, &body)
}

fn interface(order: Order, link_type: u16, options: &[u8]) -> Vec<u8> {
    block(order, 1, &[&order.u16(link_type)[..], &[0, 0], &order.u32(0), options].concat())
}

fn packet(order: Order, interface: u32, units: u64, data: &[u8]) -> Vec<u8> {
    let mut body = Vec::new();
    let length = data.len() as u32;
    for number in [interface, (units >> 32) as u32, units as u32, length, length] {
        body.extend(order.u32(number));
    }
    body.extend(data);
    block(order, 6, &body)
}

/// An option and the end of options.
fn option(order: Order, code: u16, value: &[u8]) -> Vec<u8> {
    let mut bytes = [&order.u16(code)[..], &order.u16(value.len() as u16), value].concat();
    bytes.resize(bytes.len().next_multiple_of(4) + 4, 0);
    bytes
}

fn pcap(order: Order, magic: u32, link_type: u32, packets: &[(u32, u32, Vec<u8>)]) -> Vec<u8> {
    let mut file = Vec::new();
    file.extend(order.u32(magic));
    file.extend([order.u16(2), order.u16(4)].concat());
    file.extend([0, 0, 262_144, link_type].map(|n| order.u32(n)).concat());
    for (seconds, fraction, data) in packets {
        let length = data.len() as u32;
        file.extend([*seconds, *fraction, length, length].map(|n| order.u32(n)).concat());
        file.extend(data);
    }
    file
}

fn brief(recorded: &[Recorded]) -> Vec<(u64, Dir, u16, u8)> {
    recorded.iter().map(|r| (r.at_ns, r.dir, r.bus, r.device)).collect()
}

/// Captures by usbmon of a real board, in every container, byte order, header and unit of time
#[test]
fn captures_of_a_real_board_are_read() {
    let expected = [(1_600_000_000_123_456_000, Dir::Write, 3, 7), (1_600_000_000_123_457_000, Dir::Read, 3, 7)];
    for order in [Order::Little, Order::Big] {
        for (link_type, header_len) in [(189_u16, 48), (220, 64)] {
            let packets = [out(frame(1).bytes()), to_host(frame(2).bytes())].map(|p| p.bytes(order, header_len));
            let mut files = Vec::new();
            // Microseconds by default or by name, nanoseconds, and units of 2^-20 s behind an offset of seconds.
            for (options, units) in [
                (Vec::new(), [1_600_000_000_123_456, 1_600_000_000_123_457]),
                (option(order, 9, &[6]), [1_600_000_000_123_456, 1_600_000_000_123_457]),
                (option(order, 9, &[9]), [1_600_000_000_123_456_000, 1_600_000_000_123_457_000]),
            ] {
                let mut file = [section(order), interface(order, link_type, &options)].concat();
                for (units, bytes) in units.into_iter().zip(&packets) {
                    file.extend(packet(order, 0, units, bytes));
                }
                files.push(file);
            }
            for (magic, fraction) in [(0xA1B2_C3D4, 123_456), (0xA1B2_3C4D, 123_456_000)] {
                let step = fraction / 123_456;
                let [first, second] = packets.clone();
                let packets = [(1_600_000_000, fraction, first), (1_600_000_000, fraction + step, second)];
                files.push(pcap(order, magic, link_type.into(), &packets));
            }
            for file in files {
                let recorded = frames(&file);
                assert_eq!(brief(&recorded), expected);
                assert_eq!((&*recorded[0].frame, &*recorded[1].frame), (&frame(1), &frame(2)));
                assert_eq!(Recording::new(&file[..], "capture").unwrap().meta(), None);
            }
        }
    }
}

#[test]
fn units_of_time_are_those_of_the_interface() {
    let order = Order::Little;
    let bytes = out(frame(1).bytes()).bytes(order, 64);
    let seconds = |n: i64| option(order, 14, &n.to_le_bytes());
    let without_end = |option: Vec<u8>| option[..option.len() - 4].to_vec();
    for (options, units, at_ns) in [
        (option(order, 9, &[0]), 5, 5_000_000_000),
        (option(order, 9, &[3]), 5, 5_000_000),
        (option(order, 9, &[12]), 5_999, 5),
        (option(order, 9, &[127]), u64::MAX, 0),
        (option(order, 9, &[0x80 | 20]), 1 << 21, 2_000_000_000),
        (option(order, 9, &[0xFF]), u64::MAX, 0),
        ([without_end(option(order, 9, &[9])), seconds(2)].concat(), 7, 2_000_000_007),
        ([without_end(option(order, 9, &[9])), seconds(-2)].concat(), 2_000_000_007, 7),
        (seconds(-2), 7, 0),
        (option(order, 9, &[0]), u64::MAX, u64::MAX),
    ] {
        let file = [section(order), interface(order, 220, &options), packet(order, 0, units, &bytes)].concat();
        assert_eq!(frames(&file)[0].at_ns, at_ns, "{options:?}");
    }
}

#[test]
fn frames_are_transfers_of_504_512_or_513_bytes() {
    let order = Order::Little;
    let whole = frame(3);
    let with_id = [&[0][..], whole.bytes()].concat();
    let others = [
        Usbmon { transfer: 3, ..out(whole.bytes()) },
        Usbmon { transfer: 2, ..out(whole.bytes()) },
        Usbmon { event: b'C', flag_data: b'>', data: Vec::new(), ..out(whole.bytes()) },
        Usbmon { event: b'S', flag_data: b'<', data: Vec::new(), ..to_host(whole.bytes()) },
        Usbmon { event: b'E', ..out(whole.bytes()) },
        out(&whole.bytes()[..8]),
        to_host(&whole.bytes()[..511]),
    ];
    let mut file = [section(order), interface(order, 1, &[]), interface(order, 220, &[])].concat();
    for other in &others {
        file.extend(packet(order, 1, 0, &other.bytes(order, 64)));
    }
    // A packet of another interface that looks like a board's, one too short for a header, and other blocks.
    file.extend(packet(order, 0, 0, &out(whole.bytes()).bytes(order, 64)));
    file.extend(packet(order, 1, 0, &[b'S'; 63]));
    file.extend(block(order, 4, &[1, 0, 1, 0]));
    file.extend(block(order, 9, b"journal"));
    file.extend(block(order, 0x0BAD, b"of somebody else"));
    let nothing = error_of(&file);
    assert!(matches!(&nothing, RecordError::NoBoard { .. }), "{nothing}");

    for wanted in [to_host(whole.bytes()), to_host(&with_id)] {
        let file = [&file[..], &packet(order, 1, 0, &wanted.bytes(order, 64))].concat();
        assert_eq!(*frames(&file)[0].frame, whole);
    }
    let narrow = [&file[..], &packet(order, 1, 0, &to_host(&whole.bytes()[..504]).bytes(order, 64))].concat();
    let recorded = &*frames(&narrow)[0].frame;
    assert_eq!(recorded.bytes()[..504], whole.bytes()[..504]);
    assert_eq!(recorded.bytes()[504..], [0; 8]);
}

fn error_of(file: &[u8]) -> RecordError {
    match Recording::new(file, "x.pcapng") {
        Err(error) => error,
        Ok(recording) => recording.filter_map(Result::err).next().expect("an error"),
    }
}

#[test]
fn an_error_says_where_and_what_to_do() {
    let order = Order::Little;
    let cut = Usbmon { length: 512, ..out(&frame(1).bytes()[..32]) };
    let start = [section(order), interface(order, 220, &[])].concat();
    let offset = start.len() as u64;
    let name = "x.pcapng".to_owned();
    assert_eq!(
        error_of(&[&start[..], &packet(order, 0, 0, &cut.bytes(order, 64))].concat()),
        RecordError::Cut { name: name.clone(), offset, captured: 32, length: 512 }
    );
    let whole = packet(order, 1, 0, &out(frame(1).bytes()).bytes(order, 64));
    let unknown = error_of(&[&start[..], &whole].concat());
    assert!(matches!(&unknown, RecordError::Malformed { offset: at, .. } if *at == offset), "{unknown}");
    let mut lengths_differ = whole.clone();
    *lengths_differ.last_mut().unwrap() ^= 1;
    let differ = error_of(&[&start[..], &lengths_differ].concat());
    assert!(matches!(&differ, RecordError::Malformed { offset: at, .. } if *at == offset), "{differ}");

    assert_eq!(error_of(b""), RecordError::NotACapture { name: name.clone() });
    assert_eq!(error_of(b"\x7fELF and more"), RecordError::NotACapture { name: name.clone() });
    let no_interface = error_of(&section(order));
    assert_eq!(no_interface, RecordError::NoUsb { name: name.clone(), found: "no interface".to_owned() });
    let network = error_of(&[section(order), interface(order, 105, &[]), interface(order, 1, &[])].concat());
    assert_eq!(network, RecordError::NoUsb { name, found: "IEEE802_11, ETHERNET".to_owned() });
    let of_network = error_of(&[section(order), interface(order, 1, &[])].concat());
    assert_eq!(of_network, RecordError::OfNetwork { name: "x.pcapng".to_owned() });
    assert!(of_network.to_string().contains("`ecmsk serve ethercat`"), "{of_network}");
    for error in [unknown, differ, no_interface, network, of_network] {
        assert!(error.to_string().starts_with("x.pcapng ") && error.to_string().contains("record"), "{error}");
    }

    let missing = Recording::open("no such folder/x.pcapng".as_ref()).err().unwrap();
    assert!(matches!(missing, RecordError::Io { .. }) && missing.to_string().contains("no such folder"), "{missing}");
}

/// The frames before a cut are returned, then the error names the block of the cut.
#[test]
fn a_truncated_file_gives_what_is_whole() {
    let whole = recording_of(3);
    let block_starts: Vec<usize> = std::iter::successors(Some(0), |at| {
        let length = u32::from_le_bytes(whole.get(at + 4..at + 8)?.try_into().ok()?);
        Some(at + length as usize)
    })
    .collect();
    assert_eq!(block_starts.last(), Some(&whole.len()));
    for end in 4..=whole.len() {
        // Section header, interface, six frames, statistics.
        let blocks_before = block_starts.iter().filter(|start| **start <= end).count() - 1;
        let mut recorded = Vec::new();
        let mut error = None;
        match Recording::new(&whole[..end], "cut") {
            Err(e) => error = Some(e),
            Ok(recording) => {
                for step in recording {
                    match step {
                        Ok(frame) => recorded.push(frame),
                        Err(e) => assert_eq!(error.replace(e), None, "one error at most"),
                    }
                }
            }
        }
        assert_eq!(recorded.len(), blocks_before.saturating_sub(2).min(6), "cut at {end}");
        let at_block = block_starts.contains(&end);
        if !at_block {
            let offset = block_starts[blocks_before] as u64;
            assert_eq!(error, Some(RecordError::Truncated { name: "cut".to_owned(), offset }), "cut at {end}");
        } else if blocks_before > 1 {
            assert_eq!(error, None, "cut at {end}");
        } else {
            assert!(matches!(error, Some(RecordError::NoUsb { .. })), "cut at {end}: {error:?}");
        }
    }
}

/// A source that returns a few bytes at a time, as a pipe does.
struct Trickle<'a>(&'a [u8]);

impl std::io::Read for Trickle<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.0.len().min(buffer.len()).min(7);
        buffer[..n].copy_from_slice(&self.0[..n]);
        self.0 = &self.0[n..];
        Ok(n)
    }
}

#[test]
fn a_pipe_is_read_as_a_file() {
    let whole = recording_of(5);
    let recorded: Vec<_> = Recording::new(Trickle(&whole), "pipe").unwrap().map(Result::unwrap).collect();
    assert_eq!(recorded, frames(&whole));
}

/// Reads to the end, whatever the content.
fn exhaust(bytes: &[u8]) {
    if let Ok(recording) = Recording::new(bytes, "any") {
        let errors = recording.filter(Result::is_err).count();
        assert!(errors <= 1);
    }
}

/// Beginnings of files that a reader accepts.
fn any_start() -> impl Strategy<Value = Vec<u8>> {
    let order = prop_oneof![Just(Order::Little), Just(Order::Big)];
    (order, 0..6_u8).prop_map(|(order, kind)| match kind {
        0 => Vec::new(),
        1 => section(order),
        2 => [section(order), interface(order, 220, &[])].concat(),
        3 => [section(order), interface(order, 189, &option(order, 9, &[9]))].concat(),
        4 => pcap(order, 0xA1B2_C3D4, 220, &[]),
        _ => pcap(order, 0xA1B2_3C4D, 189, &[]),
    })
}

/// Blocks of every known kind, with any content.
fn any_block() -> impl Strategy<Value = Vec<u8>> {
    let kind = prop_oneof![0..12_u32, Just(0x0A0D_0D0A), any::<u32>()];
    (any::<bool>(), kind, proptest::collection::vec(prop_oneof![0..8_u8, any::<u8>()], 0..96))
        .prop_map(|(little, kind, body)| block(if little { Order::Little } else { Order::Big }, kind, &body))
}

proptest! {
    #[test]
    fn no_bytes_make_the_reader_panic(start in any_start(), bytes in proptest::collection::vec(any::<u8>(), 0..512)) {
        exhaust(&[start, bytes].concat());
    }

    #[test]
    fn no_blocks_make_the_reader_panic(start in any_start(), blocks in proptest::collection::vec(any_block(), 0..8)) {
        exhaust(&[start, blocks.concat()].concat());
    }

    #[test]
    fn no_damage_makes_the_reader_panic(
        damage in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 1..8),
        end in any::<proptest::sample::Index>(),
    ) {
        let mut bytes = recording_of(2);
        for (at, byte) in damage {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        bytes.truncate(end.index(bytes.len() + 1));
        exhaust(&bytes);
    }
}
