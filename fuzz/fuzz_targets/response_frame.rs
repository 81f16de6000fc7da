//! Any bytes as a response frame, in both slot sizes: every slot decodes as every kind of slave, what is encoded and
//! decoded again is the same, the readable lines come out.

#![no_main]

use ecmsk::sk::{
    CrcPolicy, DriveResponse, Frame, HspResponse, IoResponse, MasterResponse, RawSlot, ResponseDump, SdoResponse,
    SlaveKind, SlotSize,
};
use libfuzzer_sys::fuzz_target;

const KINDS: [SlaveKind; 5] = [SlaveKind::Drive, SlaveKind::Io, SlaveKind::Hsp, SlaveKind::Step, SlaveKind::None];

fuzz_target!(|bytes: &[u8]| {
    let frame = Frame::from_prefix(bytes);
    for size in SlotSize::ALL {
        for slot in frame.slots(size).iter() {
            again(&slot, size);
        }
        let crc = frame.crc(size);
        let passes = frame.crc_byte() == crc;
        assert_eq!(frame.check_crc(size, CrcPolicy::Strict).is_ok(), passes);
        assert_eq!(frame.check_crc(size, CrcPolicy::AbsentAllowed).is_ok(), passes || frame.crc_byte() == 0);

        // The last bytes choose what the slaves are.
        let mut kinds = [SlaveKind::None; 40];
        for (kind, byte) in kinds.iter_mut().zip(bytes.iter().rev()) {
            *kind = KINDS[usize::from(*byte) % KINDS.len()];
        }
        let plain = ResponseDump::new(&frame, size);
        for dump in [plain, plain.kinds(&kinds), plain.mode_in_byte_1()] {
            assert!(!dump.to_string().is_empty());
            assert_eq!(dump.all().lines().count(), size.slots());
        }
    }
});

/// Decodes a slot as everything it may be; what that encodes to decodes to the same.
fn again(slot: &RawSlot, size: SlotSize) {
    let master = MasterResponse::decode(slot);
    assert_eq!(MasterResponse::decode(&master.encode()), master);
    let drive = DriveResponse::decode(slot);
    assert_eq!(DriveResponse::decode(&drive.encode()), drive);
    let io = IoResponse::decode(slot);
    assert_eq!(IoResponse::decode(&io.encode()), io);
    let hsp = HspResponse::decode(slot, size);
    assert_eq!(HspResponse::decode(&hsp.encode(size), size), hsp);
    let sdo = SdoResponse::decode(slot);
    assert_eq!(SdoResponse::decode(&sdo.encode()), sdo);
}
