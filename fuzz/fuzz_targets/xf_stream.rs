//! Any bytes as a stream of the ECM-XF's packets, in pieces of any length: none is lost, and what are packets is parsed both
//! ways without a panic.

#![no_main]

use ecmsk::xf::{
    AnswerPacket, CheckRule, CommandPacket, CrcCoverage, DataSize, END_WORD, Received, Resync, START_WORD,
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((&kind, bytes)) = bytes.split_first() else { return };
    let sizes = [None, Some(DataSize::MIN), Some(DataSize::MANUAL), Some(DataSize::NEWER)];
    let size = sizes[usize::from(kind & 3)];
    let mut reader = size.map_or_else(Resync::new, Resync::with_size);
    let piece = 1 + usize::from(kind >> 2) * 8;
    let (mut pushed, mut given) = (0, 0);
    for mut rest in bytes.chunks(piece) {
        while !rest.is_empty() {
            let taken = reader.push(rest);
            pushed += taken as u64;
            rest = &rest[taken..];
            let mut any = false;
            while let Some(packet) = reader.next_packet() {
                any = true;
                given += packet.len() as u64;
                parse(packet);
            }
            assert!(taken > 0 || any, "the reader goes on");
            assert!(given + reader.dropped() <= pushed, "no byte comes twice");
        }
    }
    assert!(size.is_none() || reader.size() == size, "n that was given stays");
});

fn parse(packet: &[u8]) {
    assert_eq!(packet.first_chunk(), Some(&START_WORD.to_le_bytes()));
    assert_eq!(packet.last_chunk(), Some(&END_WORD.to_le_bytes()));
    let size = DataSize::of_packet(packet.len()).expect("32 to 1408 bytes of data");
    for coverage in CrcCoverage::EVERY {
        for rule in [CheckRule { coverage, ..CheckRule::FIXED }, CheckRule { coverage, ..CheckRule::CRC32 }] {
            if let Ok(command) = CommandPacket::parse(packet, size, rule) {
                let _ = command.request();
            }
        }
        if let Ok(Received::Answer(answer)) = AnswerPacket::parse(packet, size, coverage) {
            assert_eq!(answer.data.len(), size.bytes());
        }
    }
}
