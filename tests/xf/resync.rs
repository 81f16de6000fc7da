//! Packets are found in a stream of bytes.

use ecmsk::xf::request::{Request, UnknownCommand};
use ecmsk::xf::{
    AnswerHeader, AnswerPacket, CheckRule, CheckType, CommandCode, CommandHeader, CrcCoverage, DataSize, MAX_PACKET,
    Received, Resync, write_answer, write_request,
};
use proptest::prelude::*;

/// A reader's result for a stream: the packets, the number of dropped bytes, n.
#[derive(Debug, Default, PartialEq)]
struct Found {
    packets: Vec<Vec<u8>>,
    dropped: u64,
    size: Option<usize>,
}

/// Reads the stream in pieces whose lengths repeat.
fn read_with(mut reader: Resync, stream: &[u8], pieces: &[usize]) -> Found {
    let mut found = Found::default();
    let (mut rest, mut turn) = (stream, pieces.iter().cycle());
    while !rest.is_empty() {
        let piece = (*turn.next().expect("a piece")).clamp(1, rest.len());
        let (mut now, later) = rest.split_at(piece);
        rest = later;
        while !now.is_empty() {
            let taken = reader.push(now);
            now = &now[taken..];
            let mut given = 0;
            while let Some(packet) = reader.next_packet() {
                found.packets.push(packet.to_vec());
                let len = packet.len();
                assert_eq!(reader.size().map(DataSize::packet_len), Some(len));
                given += 1;
            }
            assert!(taken > 0 || given > 0, "the reader stands still");
        }
    }
    found.dropped = reader.dropped();
    found.size = reader.size().map(DataSize::bytes);
    found
}

fn read(stream: &[u8], pieces: &[usize]) -> Found {
    read_with(Resync::new(), stream, pieces)
}

fn size(n: usize) -> DataSize {
    DataSize::new(n).expect("32 to 1408")
}

/// An answer with data that are different in each.
fn answer(size: DataSize, rule: CheckRule, index: u8) -> Vec<u8> {
    let data: Vec<u8> = (0..size.bytes()).map(|i| (i as u8).wrapping_mul(31).wrapping_add(index)).collect();
    let header = AnswerHeader { index, code: CommandCode::SdoGet, ..AnswerHeader::default() };
    let mut buffer = [0xA5; MAX_PACKET];
    write_answer(&mut buffer, size, rule, header, &&data[..]).expect("it fits").to_vec()
}

fn answers(size: DataSize, rule: CheckRule, n: u8) -> Vec<Vec<u8>> {
    (0..n).map(|index| answer(size, rule, index)).collect()
}

/// XF-3.1, XF-3.2 From every offset of a stream: the rest of the first packet is dropped, all others are found.
#[test]
fn from_every_offset() {
    let packets = answers(DataSize::MANUAL, CheckRule::CRC32, 5);
    let stream = packets.concat();
    for offset in 0..144 {
        let found = read(&stream[offset..], &[50]);
        let cut = if offset == 0 { 0 } else { 1 };
        assert_eq!(found.size, Some(112), "offset {offset}");
        assert_eq!(found.packets, packets[cut..], "offset {offset}");
        assert_eq!(found.dropped as usize, (144 - offset) % 144, "offset {offset}");
    }
}

/// XF-3.1, XF-3.2 Every size, with a CRC-32 over any coverage and with the fixed word, behind garbage.
#[test]
fn of_every_size_and_check_word() {
    for n in [32, 33, 63, 64, 111, 112, 113, 992, 1024, 1407, 1408] {
        for kind in [CheckType::Fixed, CheckType::Crc32] {
            for coverage in CrcCoverage::EVERY {
                let packets = answers(size(n), CheckRule { kind, coverage }, 5);
                let stream = [vec![0xEE; 4000], packets.concat()].concat();
                let found = read(&stream, &[1, 700, 3]);
                assert_eq!((found.size, found.dropped, found.packets), (Some(n), 4000, packets), "{n} {kind:?}");
            }
        }
    }
}

/// XF-3.1 Answers of a chip that is not ready show n as well.
#[test]
fn of_a_chip_that_is_not_ready() {
    let mut buffer = [0xA5; MAX_PACKET];
    let header = AnswerHeader::default();
    let packet = ecmsk::xf::packet::write_not_ready(&mut buffer, DataSize::XFU, header).expect("it fits").to_vec();
    let found = read(&packet.repeat(3), &[1024]);
    assert_eq!((found.size, found.packets.len(), found.dropped), (Some(992), 3, 0));
    let parsed = AnswerPacket::parse(&found.packets[2], DataSize::XFU, CrcCoverage::All);
    assert_eq!(parsed, Ok(Received::NotReady));
}

/// XF-3.1 Borders in the data of packets are recognised by the check word, and are no borders between packets.
#[test]
fn borders_in_the_data_are_not_believed() {
    let border = [0x59, 0x58, 0x57, 0x56, 0xA4, 0xA3, 0xA2, 0xA1];
    let mut data = vec![7; 992];
    data[100..108].copy_from_slice(&border);
    data[164..172].copy_from_slice(&border);
    data[300..308].copy_from_slice(&border);
    let unknown = UnknownCommand { code: CommandCode::from_code(99), arguments: Default::default(), data: &data };
    let mut buffer = [0xA5; MAX_PACKET];
    let header = CommandHeader::with_index(1);
    let packet = write_request(&mut buffer, DataSize::XFU, CheckRule::CRC32, header, &Request::Unknown(unknown));
    let packet = packet.expect("it fits").to_vec();
    for offset in [0, 1, 50, 130, 200, 1000] {
        let found = read(&packet.repeat(5)[offset..], &[333]);
        assert_eq!(found.size, Some(992), "offset {offset}");
        assert!(found.packets.len() >= 3 && found.packets.iter().all(|found| *found == packet), "offset {offset}");
    }
}

/// XF-3.3 A packet with a wrong check word is returned once n is known, and does not show n.
#[test]
fn damaged_packets_are_given() {
    let mut packets = answers(DataSize::MANUAL, CheckRule::CRC32, 6);
    packets[0][60] ^= 1;
    packets[4][60] ^= 1;
    let found = read(&packets.concat(), &[1440]);
    assert_eq!((found.size, found.packets, found.dropped), (Some(112), packets.clone(), 0));
    assert!(AnswerPacket::parse(&packets[4], DataSize::MANUAL, CrcCoverage::All).is_err());
}

/// XF-3.6 With the fixed check word two packets between which the border was damaged look like one of twice the length,
/// but only for a short time.
#[test]
fn a_size_that_was_two_packets_is_found_again() {
    let mut packets = answers(DataSize::MANUAL, CheckRule::FIXED, 8);
    packets[2][0] ^= 1;
    // The first packet is cut, so that n is sought at the damaged border.
    for pieces in [&[1][..], &[288], &[1440]] {
        let found = read(&packets.concat()[50..], pieces);
        let joined = [&packets[1][..], &packets[2]].concat();
        let wanted: Vec<Vec<u8>> = [joined].into_iter().chain(packets[3..].iter().cloned()).collect();
        assert_eq!((found.size, found.dropped), (Some(112), 144 - 50));
        assert_eq!(found.packets, wanted);
    }
    // With a CRC they do not look like one.
    let mut packets = answers(DataSize::MANUAL, CheckRule::CRC32, 8);
    packets[2][0] ^= 1;
    let found = read(&packets.concat()[50..], &[100]);
    assert_eq!((found.size, &found.packets[..]), (Some(112), &packets[3..]));
}

/// XF-3.7 If a size that the reader has found does not fit any more, it is sought again. A size that was set stays.
#[test]
fn a_size_without_packets_is_found_again() {
    // Bytes that look like a packet of another size, as damaged ones may.
    let other = answer(size(1024), CheckRule::FIXED, 0);
    let packets = answers(DataSize::MANUAL, CheckRule::CRC32, 60);
    let stream = [&other[other.len() - 4..], &other[..], &packets.concat()[..]].concat();
    for pieces in [&[1][..], &[144], &[1056], &[1440]] {
        let found = read(&stream, pieces);
        assert_eq!(found.size, Some(112));
        assert_eq!(found.packets[0], other);
        let behind = &found.packets[1..];
        assert!(behind.len() > 30 && packets.ends_with(behind), "{} of {}", behind.len(), packets.len());
        let told = read_with(Resync::with_size(size(1024)), &stream, pieces);
        assert_eq!((told.size, told.packets.len()), (Some(1024), 1));
    }
}

/// XF-3.4, XF-3.5 A packet that lost its start word, its end word or other bytes is dropped, and so are bytes between
/// packets; the packets behind are found.
#[test]
fn after_bytes_were_lost_or_added() {
    let packets = answers(DataSize::MANUAL, CheckRule::CRC32, 6);
    for (from, to) in [(0, 1), (0, 143), (60, 61), (100, 144), (143, 144)] {
        let mut damaged = packets.clone();
        damaged[3].drain(from..to);
        let found = read(&damaged.concat(), &[144]);
        let whole: Vec<_> = packets.iter().filter(|packet| **packet != packets[3]).cloned().collect();
        assert_eq!(found.packets, whole, "{from}..{to}");
        assert_eq!(found.dropped as usize, 144 - (to - from), "{from}..{to}");

        let mut added = packets.clone();
        added[3].splice(0..0, vec![0xA4; to - from]);
        let found = read(&added.concat(), &[144]);
        assert_eq!((found.packets, found.dropped as usize), (packets.clone(), to - from));
    }
}

/// XF-3.2 With a known size the first packet is found without a border; XF-3.5 another size is used when it is set.
#[test]
fn of_a_size_that_is_known() {
    let packet = answer(DataSize::MANUAL, CheckRule::CRC32, 1);
    let found = read_with(Resync::with_size(DataSize::MANUAL), &[&[1, 2, 3][..], &packet].concat(), &[7]);
    assert_eq!((found.packets, found.dropped), (vec![packet.clone()], 3));

    let longer = answers(DataSize::XFU, CheckRule::CRC32, 3);
    let mut reader = Resync::with_size(DataSize::MANUAL);
    assert_eq!(reader.push(&packet), 144);
    assert_eq!(reader.next_packet(), Some(&packet[..]));
    reader.set_size(Some(DataSize::XFU));
    let found = read_with(reader, &longer.concat(), &[100]);
    assert_eq!((found.packets, found.dropped), (longer.clone(), 0));

    // A reader that forgets the size finds another one.
    let mut reader = Resync::with_size(DataSize::MANUAL);
    reader.set_size(None);
    let found = read_with(reader, &longer.concat(), &[100]);
    assert_eq!((found.packets, found.size), (longer, Some(992)));
}

/// XF-3.4 A stream of borders alone, and one of start words, do not keep the reader busy or full.
#[test]
fn streams_of_borders() {
    for words in [
        vec![0x59, 0x58, 0x57, 0x56, 0xA4, 0xA3, 0xA2, 0xA1],
        vec![0xA4, 0xA3, 0xA2, 0xA1],
        vec![0x59, 0x58, 0x57, 0x56],
        vec![0xA4],
    ] {
        let found = read(&words.repeat(20_000 / words.len()), &[999]);
        assert!(found.packets.is_empty() && found.size.is_none());
        assert!(found.dropped >= 20_000 - 2 * MAX_PACKET as u64 - 8, "{}", found.dropped);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// XF-3.4 Any bytes in any pieces: nothing panics, each byte is in a packet, dropped, or still held; the pieces
    /// change nothing.
    #[test]
    fn any_stream(
        words in proptest::collection::vec(prop_oneof![
            4 => Just(vec![0xA4, 0xA3, 0xA2, 0xA1]),
            4 => Just(vec![0x59, 0x58, 0x57, 0x56]),
            2 => Just(vec![0x78, 0x56, 0x34, 0x12]),
            4 => proptest::collection::vec(any::<u8>(), 0..40),
        ], 0..300),
        pieces in proptest::collection::vec(1usize..3000, 1..10),
    ) {
        let stream = words.concat();
        let found = read(&stream, &pieces);
        let given: usize = found.packets.iter().map(Vec::len).sum();
        let held = stream.len() - given - found.dropped as usize;
        prop_assert!(held <= 2 * MAX_PACKET + 8);
        for packet in &found.packets {
            prop_assert_eq!(&packet[..4], &[0xA4, 0xA3, 0xA2, 0xA1]);
            prop_assert_eq!(&packet[packet.len() - 4..], &[0x59, 0x58, 0x57, 0x56]);
        }
    }

    /// XF-3.2 Packets behind any garbage, split in any way: all are found, from the second border on at the latest.
    #[test]
    fn packets_behind_garbage(
        garbage in proptest::collection::vec(any::<u8>(), 0..3000),
        n in 32usize..=1408,
        pieces in proptest::collection::vec(1usize..2000, 1..10),
        offset in any::<prop::sample::Index>(),
        joined: bool,
    ) {
        let packets = answers(size(n), CheckRule::CRC32, 5);
        let cut = offset.index(n + 32);
        let stream = [&garbage[..], &packets.concat()[cut..]].concat();
        let found = read(&stream, if joined { &[usize::MAX] } else { &pieces });
        prop_assert_eq!(found.size, Some(n));
        prop_assert_eq!(found.packets, &packets[usize::from(cut > 0)..]);
        let lost = garbage.len() + if cut > 0 { n + 32 - cut } else { 0 };
        prop_assert_eq!(found.dropped, lost as u64);
    }
}
