//! Invalid packets, data that do not fit into a packet, and the check word.

use ecmsk::xf::packet::{AnswerError, PacketError, WriteError};
use ecmsk::xf::request::{InfoUpdate, PdoConfigGet, SdoGet, SpiPackSizeGet, UnknownCommand};
use ecmsk::xf::{
    Allowed, AnswerHeader, AnswerPacket, CheckRule, CheckType, CommandCode, CommandHeader, CommandPacket, CrcCoverage,
    DataSize, MAX_PACKET, Malformed, Received, Request, Status, write_answer, write_request,
};
use proptest::prelude::*;
use vectors::xf::packet_named;

use crate::crc32;

const SIZE: DataSize = DataSize::MANUAL;

fn command(rule: CheckRule) -> Vec<u8> {
    let mut buffer = [0xA5; MAX_PACKET];
    let header = CommandHeader::with_index(1);
    write_request(&mut buffer, SIZE, rule, header, &InfoUpdate).expect("it fits").to_vec()
}

fn answer(rule: CheckRule, status: Status, data: &[u8]) -> Vec<u8> {
    let mut buffer = [0xA5; MAX_PACKET];
    let header = AnswerHeader { status, code: CommandCode::SdoGet, index: 7, ..AnswerHeader::default() };
    write_answer(&mut buffer, SIZE, rule, header, &data).expect("it fits").to_vec()
}

fn parse(bytes: &[u8]) -> Result<CommandPacket<'_>, PacketError> {
    CommandPacket::parse(bytes, SIZE, CheckRule::CRC32)
}

/// Inserts the check word of the bytes.
fn with_crc(mut bytes: Vec<u8>) -> Vec<u8> {
    let at = bytes.len() - 8;
    let crc = crc32(&bytes[..at]);
    bytes[at..at + 4].copy_from_slice(&crc.to_le_bytes());
    bytes
}

/// XF-1.1 n is 32 to 1408 and a packet has 32 bytes more; XF-1.3 the sizes that chips start with.
#[test]
fn packets_have_32_bytes_beside_their_data() {
    for n in 0..2000 {
        let size = DataSize::new(n);
        assert_eq!(size.map(DataSize::bytes), (32..=1408).contains(&n).then_some(n));
        assert_eq!(size.map(DataSize::packet_len), size.map(|_| n + 32));
        assert_eq!(DataSize::of_packet(n + 32), size);
    }
    assert_eq!(DataSize::of_packet(31), None);
    let starts = [DataSize::MANUAL, DataSize::NEWER, DataSize::XFU];
    assert_eq!(starts.map(DataSize::bytes), [112, 1024, 992]);
    assert_eq!((DataSize::XFU.packet_len(), MAX_PACKET), (1024, 1440));
}

/// XF-1.2 The words around a packet as bytes.
#[test]
fn start_word_and_end_word() {
    let packet = command(CheckRule::FIXED);
    assert_eq!(packet[..4], [0xA4, 0xA3, 0xA2, 0xA1]);
    assert_eq!(packet[packet.len() - 4..], [0x59, 0x58, 0x57, 0x56]);
    // XF-2.1 The fixed check word.
    assert_eq!(packet[packet.len() - 8..packet.len() - 4], [0x78, 0x56, 0x34, 0x12]);
}

/// XF-1.6 The error for bytes that are no packet has what was expected and what was found.
#[test]
fn no_packet_says_why() {
    let right = command(CheckRule::CRC32);
    let (expected, found) = (144, 143);
    let short = parse(&right[..143]);
    assert_eq!(short, Err(PacketError::Length { expected, found }));
    assert_eq!(short.unwrap_err().to_string(), "a packet has 144 bytes, these are 143");
    assert_eq!(parse(&[]), Err(PacketError::Length { expected, found: 0 }));

    let changed = |at: usize| {
        let mut bytes = right.clone();
        bytes[at] ^= 0xFF;
        parse(&bytes).expect_err("a damaged packet")
    };
    assert_eq!(changed(0), PacketError::StartWord { found: 0xA1A2_A35B });
    assert_eq!(changed(0).to_string(), "the start word is 0xA1A2A35B, not 0xA1A2A3A4");
    assert_eq!(changed(143), PacketError::EndWord { found: 0xA957_5859 });
    assert_eq!(changed(143).to_string(), "the end word is 0xA9575859, not 0x56575859");
    let crc = crc32(&right[..136]);
    let wrong = changed(136);
    assert_eq!(wrong, PacketError::CheckWord { kind: CheckType::Crc32, expected: crc, found: crc ^ 0xFF });
    assert!(wrong.to_string().ends_with(&format!("the CRC-32 of the packet is 0x{crc:08X}")), "{wrong}");

    let fixed = CommandPacket::parse(&right, SIZE, CheckRule::FIXED).expect_err("a CRC is not the fixed word");
    assert_eq!(fixed, PacketError::CheckWord { kind: CheckType::Fixed, expected: 0x1234_5678, found: crc });
}

/// XF-2.2 The published check value of the CRC-32, and the polynomial as the manual has it.
#[test]
fn the_crc_is_zlibs() {
    assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
    assert_eq!(crc32fast_of_a_packet(), crc32(&command(CheckRule::CRC32)[..136]));
}

/// The check word that the library made.
fn crc32fast_of_a_packet() -> u32 {
    let packet = command(CheckRule::CRC32);
    u32::from_le_bytes([packet[136], packet[137], packet[138], packet[139]])
}

/// XF-2.3 A CRC-32 over the valid bytes alone: the rest of the data segment may be anything. All is the default.
#[test]
fn a_crc_covers_all_bytes_or_the_valid_ones() {
    assert_eq!(CheckRule::default().coverage, CrcCoverage::All);
    let valid = CheckRule { kind: CheckType::Crc32, coverage: CrcCoverage::Valid };
    let mut packet = packet_named("crc-valid-only").bytes;
    assert!(CommandPacket::parse(&packet, SIZE, valid).is_ok());
    assert!(CommandPacket::parse(&packet, SIZE, CheckRule::CRC32).is_err());
    packet[24 + 12] = 0xEE;
    assert!(CommandPacket::parse(&packet, SIZE, valid).is_ok(), "byte 12 of the data is not covered");
    packet[24 + 11] ^= 1;
    assert!(CommandPacket::parse(&packet, SIZE, valid).is_err(), "byte 11 is");

    let mut bytes = answer(valid, Status::NONE, &[1, 2, 3]);
    assert!(AnswerPacket::parse(&bytes, SIZE, CrcCoverage::Valid).is_ok());
    assert!(AnswerPacket::parse(&bytes, SIZE, CrcCoverage::All).is_err());
    // A length beyond n covers all.
    bytes[0x0E..0x10].copy_from_slice(&[0xFF, 0xFF]);
    assert!(AnswerPacket::parse(&with_crc(bytes), SIZE, CrcCoverage::Valid).is_ok());
}

/// XF-2.4 An answer is judged by its own status, not by what the host has set; types 1 and 2 are an error.
#[test]
fn an_answer_names_its_check_type() {
    for kind in [CheckType::Fixed, CheckType::Crc32] {
        let bytes = answer(CheckRule { kind, coverage: CrcCoverage::All }, Status(0xFF), &[]);
        assert_eq!(bytes[0x0A] & 3, kind.code());
        match AnswerPacket::parse(&bytes, SIZE, CrcCoverage::All) {
            Ok(Received::Answer(packet)) => assert_eq!(packet.header.status.check_type(), Ok(kind)),
            other => panic!("{other:?}"),
        }
    }
    for bits in [1, 2] {
        let mut bytes = answer(CheckRule::CRC32, Status::NONE, &[]);
        bytes[0x0A] = bits;
        let error = AnswerPacket::parse(&with_crc(bytes), SIZE, CrcCoverage::All).expect_err("undefined");
        assert_eq!(error, PacketError::CheckType { bits });
        assert_eq!(error.to_string(), format!("the status names check type {bits}: none of 0 fixed, 3 CRC-32"));
    }
}

/// XF-2.5 Not ready is neither an answer nor an error, whatever the type; a CRC-32 that is this word by chance is
/// right.
#[test]
fn a_chip_that_is_not_ready_is_no_error() {
    for status in 0..=3 {
        let mut bytes = answer(CheckRule::CRC32, Status::NONE, &[]);
        bytes[0x0A] = status;
        bytes[136..140].copy_from_slice(&0x8765_4321_u32.to_le_bytes());
        assert_eq!(AnswerPacket::parse(&bytes, SIZE, CrcCoverage::All), Ok(Received::NotReady));
    }

    // The last 4 bytes of the data that make the CRC what it shall be: 32 equations over the bits of the CRC.
    let mut bytes = answer(CheckRule::CRC32, Status::NONE, &[]);
    let crc_with = |bytes: &mut Vec<u8>, word: u32| {
        bytes[132..136].copy_from_slice(&word.to_le_bytes());
        crc32(&bytes[..136])
    };
    let zero = crc_with(&mut bytes, 0);
    let (mut wanted, mut word) = (zero ^ 0x8765_4321, 0);
    let mut rows: Vec<(u32, u32)> = (0..32).map(|bit| (crc_with(&mut bytes, 1 << bit) ^ zero, 1 << bit)).collect();
    for bit in 0..32 {
        let pivot = rows.iter().position(|row| row.0 >> bit & 1 == 1).expect("the CRC has full rank");
        let (crc, bits) = rows.swap_remove(pivot);
        for row in rows.iter_mut().filter(|row| row.0 >> bit & 1 == 1) {
            *row = (row.0 ^ crc, row.1 ^ bits);
        }
        if wanted >> bit & 1 == 1 {
            (wanted, word) = (wanted ^ crc, word ^ bits);
        }
    }
    assert_eq!(crc_with(&mut bytes, word), 0x8765_4321);
    bytes[136..140].copy_from_slice(&0x8765_4321_u32.to_le_bytes());
    assert!(matches!(AnswerPacket::parse(&bytes, SIZE, CrcCoverage::All), Ok(Received::Answer(_))));
}

/// XF-2.6 SPI_RECONFIG_OP is taken with the fixed check word alone.
#[test]
fn spi_reconfig_is_checked_by_the_fixed_word() {
    let packet = packet_named("spi-reconfig-1024");
    assert!(CommandPacket::parse(&packet.bytes, SIZE, CheckRule::CRC32).is_ok());
    let error = CommandPacket::parse(&with_crc(packet.bytes), SIZE, CheckRule::CRC32).expect_err("a CRC");
    assert!(matches!(error, PacketError::CheckWord { kind: CheckType::Fixed, expected: 0x1234_5678, .. }));
}

/// XF-4.6 An answer with the NOP flag is never a result, even if index and code are those of the command; nor is an
/// answer to another command.
#[test]
fn what_is_no_result_is_not_taken_for_one() {
    let of = |status, take: fn(&AnswerPacket<'_>) -> Option<AnswerError>| {
        let bytes = answer(CheckRule::CRC32, status, &[1, 2]);
        match AnswerPacket::parse(&bytes, SIZE, CrcCoverage::All) {
            Ok(Received::Answer(packet)) => take(&packet),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(of(Status::NONE, |packet| packet.answer_to(&SdoGet).err()), None);
    assert_eq!(of(Status::NOP, |packet| packet.answer_to(&SdoGet).err()), Some(AnswerError::Nop { index: 7 }));
    let other = of(Status::NONE, |packet| packet.answer_to(&SpiPackSizeGet).err()).expect("another command");
    let (expected, found) = (CommandCode::SpiPackSizeGet, CommandCode::SdoGet);
    assert_eq!(other, AnswerError::OtherCommand { expected, found });
    assert_eq!(other.to_string(), "the packet answers ECM_CMD_ECAT_SDO_GET (11), not ECM_CMD_SPI_PACK_SIZE_GET (20)");
}

/// XF-4.8 A buffer that is too short and data that do not fit are errors that say how much.
#[test]
fn what_does_not_fit_is_an_error() {
    let mut buffer = [0; 143];
    let header = CommandHeader::with_index(1);
    let error = write_request(&mut buffer, SIZE, CheckRule::CRC32, header, &InfoUpdate).expect_err("143 of 144 bytes");
    assert_eq!(error, WriteError::Buffer { needed: 144, found: 143 });
    assert_eq!(error.to_string(), "a packet has 144 bytes, the buffer has 143");

    let mut buffer = [0; MAX_PACKET];
    let data = [0; 113];
    let too_long = write_answer(&mut buffer, SIZE, CheckRule::CRC32, AnswerHeader::default(), &&data[..]);
    let allowed = Allowed::AtLeast(113);
    let malformed = Malformed { field: "bytes of the data segment", found: 112, allowed };
    assert_eq!(too_long, Err(WriteError::Malformed(malformed)));
    let shown = WriteError::Malformed(malformed).to_string();
    assert_eq!(shown, "bytes of the data segment is 112 (0x70), allowed is at least 113");

    // A length that is greater than the data.
    let mut bytes = answer(CheckRule::FIXED, Status::NONE, &[]);
    bytes[0x0E..0x10].copy_from_slice(&113_u16.to_le_bytes());
    match AnswerPacket::parse(&bytes, SIZE, CrcCoverage::All) {
        Ok(Received::Answer(packet)) => {
            let malformed = Malformed { field: "valid data length", found: 113, allowed: Allowed::AtMost(112) };
            assert_eq!(packet.answer_to(&SdoGet), Err(AnswerError::Malformed(malformed)));
        }
        other => panic!("{other:?}"),
    }
}

proptest! {
    /// XF-1.6 Bytes of any length are a packet or an error; XF-4.5 nothing panics.
    #[test]
    fn any_bytes_parse(bytes in proptest::collection::vec(any::<u8>(), 0..400), n in 32usize..=1408) {
        let size = DataSize::new(n).expect("in range");
        prop_assert!(CommandPacket::parse(&bytes, size, CheckRule::CRC32).is_err());
        prop_assert!(AnswerPacket::parse(&bytes, size, CrcCoverage::Valid).is_err());
    }

    /// XF-1.6, XF-2.2 One bit that was flipped anywhere is an error, as is a packet that is cut off; XF-2.3 whatever
    /// the CRC covers, if it is covered.
    #[test]
    fn a_damaged_packet_is_an_error(
        data in proptest::collection::vec(any::<u8>(), 112),
        bit in 0usize..144 * 8,
        cut in 0usize..144,
    ) {
        let unknown = UnknownCommand { code: CommandCode::from_code(99), arguments: Default::default(), data: &data };
        let mut buffer = [0xA5; MAX_PACKET];
        let header = CommandHeader::with_index(1);
        let request = Request::Unknown(unknown);
        let packet = write_request(&mut buffer, SIZE, CheckRule::CRC32, header, &request).expect("it fits");
        prop_assert!(parse(packet).is_ok());
        prop_assert_eq!(parse(&packet[..cut]), Err(PacketError::Length { expected: 144, found: cut }));
        let mut damaged = packet.to_vec();
        damaged[bit / 8] ^= 1 << (bit % 8);
        prop_assert!(parse(&damaged).is_err());
    }

    /// XF-4.5 Whatever the check word covers and whatever the answer says, its results are read or are an error.
    #[test]
    fn any_answer_gives_a_result_or_an_error(data in proptest::collection::vec(any::<u8>(), 112), len: u16, ret: u8) {
        let header = AnswerHeader { len, ret, code: CommandCode::PdoConfigGet, ..AnswerHeader::default() };
        let packet = AnswerPacket { header, data: &data };
        prop_assert!(packet.answer_to(&PdoConfigGet).is_err() || len == 112);
    }
}
