//! Any bytes as a command frame, in both slot sizes: every slot decodes to a command or to a reason, a command that is
//! encoded and decoded again is the same, the readable lines come out.

#![no_main]

use ecmsk::sk::{CommandDump, Frame, MasterCommand, SdoCommand, SlotCommand, SlotSize};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let frame = Frame::from_prefix(bytes);
    for size in SlotSize::ALL {
        again(&frame, size);
        assert!(!CommandDump::new(&frame, size).to_string().is_empty());
        assert_eq!(CommandDump::new(&frame, size).all().lines().count(), size.slots());
    }
});

/// Decodes all slots; what they mean, put into a new frame, means the same again.
fn again(frame: &Frame, size: SlotSize) {
    let mut copy = Frame::new();

    let master = MasterCommand::decode(&frame.slot(size, 0), size);
    if let Ok(command) = &master {
        copy.put_master(size, command);
        assert_eq!(MasterCommand::decode(&copy.slot(size, 0), size), master);
    }
    for slave in 1..=size.max_slaves() {
        let decoded = SlotCommand::decode(&frame.slot(size, slave), size);
        if let Ok(command) = &decoded {
            copy.put_slave(size, slave, command);
            assert_eq!(SlotCommand::decode(&copy.slot(size, slave), size), decoded);
        }
    }
    let sdo = SdoCommand::decode(&frame.slot(size, size.sdo_slot()), size);
    if let Ok(command) = &sdo {
        copy.put_sdo(size, command);
        assert_eq!(SdoCommand::decode(&copy.slot(size, size.sdo_slot()), size), sdo);
    }

    copy.fill_crc(size);
    assert_eq!(copy.check_crc(size, ecmsk::sk::CrcPolicy::Strict), Ok(()));
}
