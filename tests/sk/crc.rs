//! The CRC-8 of a frame and its check.

use ecmsk::sk::crc::{ALGORITHM, frame_crc};
use ecmsk::sk::{CrcError, CrcPolicy, CrcStatus, Frame, SlotSize};
use vectors::{crc_parameters, rubbish, vector_named, vectors};

/// The definition, bit by bit, to verify the table in the crate.
fn crc8(bytes: impl IntoIterator<Item = u8>) -> u8 {
    bytes.into_iter().fold(0x5A, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc: u8, _| if crc & 0x80 == 0 { crc << 1 } else { crc << 1 ^ 0x07 })
    })
}

/// SK-1.12 Polynomial 0x07, initial value 0x5A, not reflected, no final xor; 0x58 over "123456789".
#[test]
fn the_crc_of_123456789_is_0x58() {
    assert_eq!(crc_parameters(), (0x07, 0x5A, 0x58));
    assert_eq!((ALGORITHM.poly, ALGORITHM.init, ALGORITHM.check), crc_parameters());
    assert_eq!(crc::Crc::<u8>::new(&ALGORITHM).checksum(b"123456789"), 0x58);
    assert_eq!(crc8(*b"123456789"), 0x58);
}

/// SK-1.14 An all-zero frame carries 0x59 at 504 bytes and 0x60 at 512.
#[test]
fn all_zero_frames_have_the_published_crcs() {
    assert_eq!(Frame::new().crc(SlotSize::Bytes12), 0x59);
    assert_eq!(Frame::new().crc(SlotSize::Bytes16), 0x60);
}

/// SK-1.13 The CRC runs over the whole frame with byte 3 taken as 0: every other byte counts, byte 3 and the filler
/// behind a 12-byte frame do not.
#[test]
fn every_byte_counts_but_byte_3_and_the_filler() {
    for size in SlotSize::ALL {
        let before = rubbish().crc(size);
        for at in 0..512 {
            let mut frame = rubbish();
            frame.bytes_mut()[at] ^= 0x01;
            let counts = at != 3 && at < size.frame_len();
            assert_eq!(frame.crc(size) != before, counts, "byte {at} of {}", size.frame_len());

            let wire = frame.wire(size).iter().enumerate().map(|(i, byte)| if i == 3 { 0 } else { *byte });
            assert_eq!(frame.crc(size), crc8(wire), "byte {at}");
        }
    }
}

/// SK-1.13 The result is in byte 3 of slot 0, and filling it changes nothing else.
#[test]
fn fill_writes_byte_3_alone() {
    for size in SlotSize::ALL {
        let mut frame = rubbish();
        frame.fill_crc(size);
        let mut expected = [0xA5; 512];
        expected[3] = frame_crc(&expected[..size.frame_len()]);
        assert_eq!(frame.bytes(), &expected);
        assert_eq!(frame.crc_byte(), expected[3]);
    }
}

/// SK-1.20 Anything but 0 must match, SK-1.21 under the strict option too; the error contains both values.
#[test]
fn wrong_crc_is_refused_under_either_policy() {
    let vector = vector_named("crc-wrong");
    let error = CrcError { expected: 0x7E, found: 0x81 };
    for policy in [CrcPolicy::AbsentAllowed, CrcPolicy::Strict] {
        assert_eq!(vector.frame().check_crc(vector.size, policy), Err(error));
    }
    assert_eq!(vector.frame().crc_status(vector.size), CrcStatus::Wrong(error));
    assert_eq!(error.to_string(), "CRC-8 in byte 3 is 0x81, the frame's bytes give 0x7E");
}

/// SK-1.20 Byte 3 = 0 is accepted as "no CRC"; SK-1.21 the strict option refuses it. The default accepts.
#[test]
fn a_crc_byte_of_0_is_accepted_unless_strict() {
    let vector = vector_named("resp-preop-nocrc");
    let (frame, size) = (vector.frame(), vector.size);
    let expected = frame.crc(size);
    assert_ne!(expected, 0);
    assert_eq!(CrcPolicy::default(), CrcPolicy::AbsentAllowed);
    assert_eq!(frame.check_crc(size, CrcPolicy::AbsentAllowed), Ok(()));
    assert_eq!(frame.check_crc(size, CrcPolicy::Strict), Err(CrcError { expected, found: 0 }));
    assert_eq!(frame.crc_status(size), CrcStatus::Absent { expected });
}

/// SK-1.20 A right CRC may be 0: SK-1.21 the strict option accepts it then.
#[test]
fn a_right_crc_may_be_zero() {
    let vector = vector_named("crc-is-zero");
    let (frame, size) = (vector.frame(), vector.size);
    assert_eq!(frame.crc_byte(), 0);
    assert_eq!(frame.check_crc(size, CrcPolicy::AbsentAllowed), Ok(()));
    assert_eq!(frame.check_crc(size, CrcPolicy::Strict), Ok(()));
    assert_eq!(frame.crc_status(size), CrcStatus::Right(0));
}

/// SK-1.20, SK-1.21 A right CRC passes, and no other value of byte 3 does but 0.
#[test]
fn of_all_values_of_byte_3_only_the_right_crc_and_0_pass() {
    for vector in vectors().iter().filter(|vector| vector.crc == "filled") {
        let (right, size) = (vector.crc8.expect("filled"), vector.size);
        for value in 0..=255 {
            let mut frame = vector.frame();
            frame.bytes_mut()[3] = value;
            let verdict = |policy| frame.check_crc(size, policy).is_ok();
            assert_eq!(verdict(CrcPolicy::Strict), value == right, "{} {value}", vector.name);
            assert_eq!(verdict(CrcPolicy::AbsentAllowed), value == right || value == 0, "{} {value}", vector.name);
        }
    }
}
