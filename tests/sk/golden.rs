//! The golden frames, both ways: bytes from types and types from bytes.

use ecmsk::sk::{Frame, MasterCommand, RawSlot, SdoCommand, SlaveCommand, SlotSize};
use vectors::golden::{Content, contents};
use vectors::{Vector, rubbish, vectors};

/// SK-1.14 Every golden frame encodes to the same bytes; SK-1.9 with a command for every slot at once, SK-1.11 all zero
/// in a slot without a command.
#[test]
fn golden_frames_encode_to_their_bytes() {
    for vector in vectors() {
        let size = vector.size;
        let mut frame = rubbish();
        ask_or_tell_nothing(&mut frame, &vector);
        for (i, content) in contents(&vector.name) {
            put(&mut frame, size, i, &content);
        }
        match vector.crc.as_str() {
            "filled" => frame.fill_crc(size),
            "wrong" => {
                frame.fill_crc(size);
                frame.bytes_mut()[3] ^= 0xFF;
            }
            other => assert_eq!(other, "absent", "{}", vector.name),
        }
        assert_eq!(frame.wire(size), vector.bytes, "{}", vector.name);
        assert!(frame.bytes()[size.frame_len()..].iter().all(|filler| *filler == 0xA5), "{}", vector.name);
    }
}

/// SK-1.14 Every golden frame decodes to the fields and the meaning it was made from, and back to the same bytes.
#[test]
fn golden_frames_decode_to_their_fields_and_back() {
    for vector in vectors() {
        let (frame, size) = (vector.frame(), vector.size);
        let mut again = frame.clone();
        let slots: Vec<RawSlot> = frame.slots(size).iter().collect();
        assert_eq!(slots.len(), size.slots());
        for (i, (slot, wanted)) in slots.iter().zip(&vector.slots).enumerate() {
            assert_eq!(without_crc(i, slot), *wanted, "{} slot {i}", vector.name);
            again.put(size, i, slot);
        }
        assert_eq!(again, frame, "{}", vector.name);

        for (i, content) in contents(&vector.name) {
            let read = content.read_alike(&slots[i], size);
            assert_eq!(read, content, "{} slot {i}", vector.name);
            assert_eq!(read.encode(size), vector.slots[i], "{} slot {i}", vector.name);
        }
    }
}

/// SK-1.14 Every golden frame carries the CRC its file names.
#[test]
fn golden_frames_carry_their_crc() {
    for vector in vectors() {
        let found = vector.frame().crc_byte();
        match (vector.crc.as_str(), vector.crc8) {
            ("filled", Some(crc)) => {
                assert_eq!((found, vector.frame().crc(vector.size)), (crc, crc), "{}", vector.name)
            }
            ("wrong", Some(crc)) => assert_eq!((found, vector.frame().crc(vector.size)), (crc ^ 0xFF, crc)),
            ("absent", None) => assert_eq!(found, 0),
            other => panic!("{}: {other:?}", vector.name),
        }
    }
}

fn ask_or_tell_nothing(frame: &mut Frame, vector: &Vector) {
    let size = vector.size;
    if vector.is_response() {
        (0..size.slots()).for_each(|i| frame.put(size, i, &RawSlot::ZERO));
        return;
    }
    frame.put_master(size, &MasterCommand::GetStatus);
    (1..=size.max_slaves()).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::GetStatus.into()));
    frame.put_sdo(size, &SdoCommand::GetStatus);
}

fn put(frame: &mut Frame, size: SlotSize, i: usize, content: &Content) {
    match content {
        Content::Master(command) => frame.put_master(size, command),
        Content::Slave(command) => frame.put_slave(size, i, command),
        Content::Sdo(command) => frame.put_sdo(size, command),
        response => frame.put(size, i, &response.encode(size)),
    }
}

fn without_crc(i: usize, slot: &RawSlot) -> RawSlot {
    RawSlot { parm: if i == 0 { slot.parm & 0xFF } else { slot.parm }, ..*slot }
}
