//! The datagrams of masters at their start, with the answers that they require.

use ecmsk::coe::{ObjectAddress, SdoRequest, SdoScope};
use ecmsk::ethercat::Command::{self, Aprd, Apwr, Armw, Brd, Bwr, Fprd, Fpwr, Frmw, Lrw, Nop};
use ecmsk::ethercat::DatagramHeader;
use ecmsk::ethercat::registers::{Fmmu, FmmuDirections, SmControl, SyncManager};
use ecmsk::slave::device::VENDOR_ID;
use ecmsk::slave::esc::{EscSettings, HOP_NS};

use super::rig::{FIRST, INPUTS, MAILBOX, MS, OUTPUTS, Rig, drive};

fn two_drives() -> Rig {
    Rig::new((0..2).map(|_| drive(EscSettings::default())))
}

impl Rig {
    /// Sends a datagram whose working counter has to be `wkc`; returns its data.
    #[track_caller]
    fn expect(&mut self, command: Command, adp: u16, ado: u16, data: &[u8], wkc: u16) -> Vec<u8> {
        let answer = self.one(command, adp, ado, data);
        assert_eq!(answer.wkc, wkc, "{} 0x{adp:04X}:0x{ado:04X}", command.name());
        answer.data
    }
}

/// ECAT-14.3 SOEM: scan, EEPROM, mailbox, mapping by SDO, clocks, OP with LRW and FRMW in each frame.
#[test]
fn soem() {
    let mut rig = two_drives();
    rig.expect(Bwr, 0, 0x0103, &[0], 2);
    rig.expect(Bwr, 0, 0x0120, &[0x11, 0], 2);
    rig.expect(Brd, 0, 0x0000, &[0, 0], 2);
    for (ado, data) in [
        (0x0101, &[0][..]),
        (0x0200, &[4, 0]),
        (0x0300, &[0; 8]),
        (0x0600, &[0; 48]),
        (0x0800, &[0; 32]),
        (0x0981, &[0]),
        (0x0910, &[0; 4]),
        (0x0930, &[0x00, 0x10]),
        (0x0934, &[0x00, 0x0C]),
        (0x0103, &[0]),
        (0x0120, &[0x11, 0]),
        (0x0500, &[2]),
        (0x0500, &[0]),
    ] {
        rig.expect(Bwr, 0, ado, data, 2);
    }
    for n in 0..2u16 {
        let adp = n.wrapping_neg();
        rig.expect(Aprd, adp, 0x0140, &[0, 0], 1);
        rig.expect(Apwr, adp, 0x0010, &(FIRST + n).to_le_bytes(), 1);
        rig.expect(Apwr, adp, 0x0100, &[u8::from(n == 0), 0], 1);
        assert_eq!(rig.expect(Aprd, adp, 0x0010, &[0, 0], 1), (FIRST + n).to_le_bytes());
        rig.expect(Fprd, FIRST + n, 0x0012, &[0, 0], 1);
        rig.expect(Fprd, FIRST + n, 0x0502, &[0, 0], 1);
    }
    for word in [0x08, 0x0E, 0x0A, 0x0C, 0x18, 0x1A, 0x1C] {
        for n in 0..2 {
            rig.expect(Fprd, FIRST + n, 0x0502, &[0, 0], 1);
            rig.expect(Fpwr, FIRST + n, 0x0502, &[0, 1, word, 0, 0, 0], 1);
            assert_eq!(rig.expect(Fprd, FIRST + n, 0x0502, &[0, 0], 1)[1] & 0x80, 0);
            let data = rig.expect(Fprd, FIRST + n, 0x0508, &[0; 4], 1);
            if word == 8 {
                assert_eq!(data, VENDOR_ID.to_le_bytes());
            }
        }
    }
    for (n, dl_status) in [(0, [0x31, 0x5A]), (1, [0x11, 0x56])] {
        assert_eq!(rig.expect(Fprd, FIRST + n, 0x0110, &[0, 0], 1), dl_status);
        assert_eq!(rig.expect(Fprd, FIRST + n, 0x0130, &[0; 6], 1), [1, 0, 0, 0, 0, 0]);
        let boxes = [
            SyncManager::enabled(0x1000, MAILBOX, SmControl::MAILBOX_OUT).encode(),
            SyncManager::enabled(0x1080, MAILBOX, SmControl::MAILBOX_IN).encode(),
        ];
        rig.expect(Fpwr, FIRST + n, 0x0800, &boxes.concat(), 1);
        rig.expect(Fpwr, FIRST + n, 0x0500, &[1], 1);
        rig.expect(Fpwr, FIRST + n, 0x0120, &[0x12, 0], 1);
        assert_eq!(rig.expect(Fprd, FIRST + n, 0x0130, &[0; 6], 1), [2, 0, 0, 0, 0, 0]);
        assert_eq!(rig.expect(Fprd, FIRST + n, 0x080D, &[0], 1), [0]);
        // The mapping, one by one and by complete access.
        let upload = |index, scope| SdoRequest::Upload { object: ObjectAddress::new(index, 0), scope };
        assert_eq!(rig.sdo(FIRST + n, upload(0x1C00, SdoScope::Entry))[6], 4);
        for index in [0x1C00, 0x1C12, 0x1C13, 0x1600, 0x1A00] {
            let answer = rig.sdo(FIRST + n, upload(index, SdoScope::Complete));
            assert_eq!((answer[1], answer[2] & 0xF0), (0x30, 0x50), "0x{index:04X}");
        }
    }
    let (outputs, inputs) = rig.lens(FIRST);
    for n in 0..2u16 {
        let out = u32::from(n) * u32::from(outputs);
        let back = 2 * u32::from(outputs) + u32::from(n) * u32::from(inputs);
        rig.set_manager(FIRST + n, 2, SyncManager::enabled(OUTPUTS, outputs, SmControl::OUTPUTS));
        rig.set_manager(FIRST + n, 3, SyncManager::enabled(INPUTS, inputs, SmControl::INPUTS));
        rig.set_fmmu(FIRST + n, 0, Fmmu::bytes(out, outputs, OUTPUTS, FmmuDirections::WRITE));
        rig.set_fmmu(FIRST + n, 1, Fmmu::bytes(back, inputs, INPUTS, FmmuDirections::READ));
        rig.expect(Fpwr, FIRST + n, 0x0120, &[4, 0], 1);
        assert_eq!(rig.expect(Fprd, FIRST + n, 0x0130, &[0; 6], 1), [4, 0, 0, 0, 0, 0]);
    }
    // Clocks.
    rig.expect(Bwr, 0, 0x0900, &[0; 4], 2);
    for n in 0..2u16 {
        let local = rig.read_u64(FIRST + n, 0x0918);
        assert_eq!(rig.read_u32(FIRST + n, 0x0900), local as u32);
        let offset = 700_000_000_000_000_000u64.wrapping_sub(local);
        rig.expect(Fpwr, FIRST + n, 0x0920, &offset.to_le_bytes(), 1);
        for ado in [0x0904, 0x0908, 0x090C] {
            rig.read_u32(FIRST + n, ado);
        }
    }
    let delay = rig.read_u32(FIRST, 0x0904).wrapping_sub(rig.read_u32(FIRST, 0x0900)) / 2;
    assert_eq!(u64::from(delay), HOP_NS);
    rig.expect(Fpwr, FIRST + 1, 0x0928, &delay.to_le_bytes(), 1);
    for n in 0..2 {
        rig.expect(Fpwr, FIRST + n, 0x0981, &[0], 1);
        rig.expect(Fpwr, FIRST + n, 0x0980, &[0], 1);
        let start = (rig.read_u64(FIRST + n, 0x0910) + 100 * MS) / MS * MS + MS;
        rig.expect(Fpwr, FIRST + n, 0x0990, &start.to_le_bytes(), 1);
        rig.expect(Fpwr, FIRST + n, 0x09A0, &1_000_000u32.to_le_bytes(), 1);
        rig.expect(Fpwr, FIRST + n, 0x0981, &[3], 1);
    }
    // Cyclic frames with OP in between.
    let len = 2 * usize::from(outputs + inputs);
    let image = vec![0; len];
    let time = DatagramHeader::register(Frmw, 9, FIRST, 0x0910);
    rig.pause = MS;
    for turn in 0..200 {
        let answers = rig.frame(&[(DatagramHeader::new(Lrw, 9, 0), &image), (time, &[0; 8])]);
        assert_eq!([answers[0].wkc, answers[1].wkc], [6, 2], "turn {turn}");
        if turn == 50 {
            rig.expect(Bwr, 0, 0x0120, &[8, 0], 2);
        }
    }
    assert_eq!(rig.expect(Brd, 0, 0x0130, &[0, 0], 2), [8, 0]);
}

/// ECAT-14.3 ethercrab: it clears sixteen FMMUs and sync managers, reads port times in one, and polls states in each frame.
#[test]
fn ethercrab() {
    let mut rig = two_drives();
    rig.expect(Brd, 0, 0x0000, &[0], 2);
    rig.expect(Bwr, 0, 0x0120, &[0x11, 0], 2);
    for n in 0..16 {
        let counts = if n < 8 { 2 } else { 0 };
        rig.expect(Bwr, 0, 0x0600 + 16 * n, &[0; 16], counts);
        rig.expect(Bwr, 0, 0x0800 + 8 * n, &[0; 8], counts);
    }
    for (ado, len) in [(0x0910, 8), (0x0920, 8), (0x0928, 4), (0x0981, 1), (0x0990, 8), (0x09A0, 4), (0x09A4, 4)] {
        rig.expect(Bwr, 0, ado, &[0; 8][..len], 2);
    }
    rig.expect(Bwr, 0, 0x092C, &[0; 4], 0);
    rig.expect(Bwr, 0, 0x0934, &[0x00, 0x0C], 2);
    rig.expect(Bwr, 0, 0x0930, &[0x00, 0x10], 2);
    for n in 0..2u16 {
        rig.expect(Apwr, n.wrapping_neg(), 0x0010, &(FIRST + n).to_le_bytes(), 1);
    }
    for n in 0..2 {
        rig.expect(Fpwr, FIRST + n, 0x0500, &[2, 0], 1);
        rig.expect(Fpwr, FIRST + n, 0x0500, &[0], 1);
        for ado in [0x0008, 0x0012, 0x0110] {
            rig.expect(Fprd, FIRST + n, ado, &[0, 0], 1);
        }
    }
    rig.expect(Bwr, 0, 0x0900, &[0; 4], 2);
    for n in 0..2 {
        rig.expect(Fprd, FIRST + n, 0x0918, &[0; 8], 1);
        rig.expect(Fprd, FIRST + n, 0x0900, &[0; 16], 1);
        rig.expect(Fpwr, FIRST + n, 0x0920, &[0; 8], 1);
        rig.expect(Fpwr, FIRST + n, 0x0928, &[0; 4], 1);
    }
    for _ in 0..1000 {
        rig.expect(Frmw, FIRST, 0x0910, &[0; 8], 2);
    }
    let mut logical = 0;
    for n in 0..2 {
        rig.bring_to_preop(FIRST + n);
        logical += rig.set_process_data(FIRST + n, logical) as u32;
        // The delay of SYNC1 is written with 8 bytes, which reach into the control of the latches.
        rig.expect(Fpwr, FIRST + n, 0x0981, &[0], 1);
        let start = rig.read_u64(FIRST, 0x0910) / MS * MS + 100 * MS;
        rig.expect(Fpwr, FIRST + n, 0x0990, &start.to_le_bytes(), 1);
        rig.expect(Fpwr, FIRST + n, 0x09A0, &1_000_000u64.to_le_bytes(), 1);
        rig.expect(Fpwr, FIRST + n, 0x09A4, &[0; 8], 1);
        rig.expect(Fpwr, FIRST + n, 0x0981, &[3], 1);
        rig.expect(Fpwr, FIRST + n, 0x0120, &[4, 0], 1);
    }
    for n in 0..2 {
        rig.expect(Fpwr, FIRST + n, 0x0120, &[8, 0], 1);
    }
    rig.pause = MS;
    let image = vec![0; logical as usize];
    let states = [FIRST, FIRST + 1].map(|station| DatagramHeader::register(Fprd, 1, station, 0x0130));
    let mut last = Vec::new();
    for _ in 0..200 {
        let time = DatagramHeader::register(Frmw, 1, FIRST, 0x0910);
        let lrw = DatagramHeader::new(Lrw, 1, 0);
        let answers = rig.frame(&[(time, &[0; 8]), (lrw, &image), (states[0], &[0; 2]), (states[1], &[0; 2])]);
        assert_eq!([0, 1, 2, 3].map(|n| answers[n].wkc), [2, 6, 1, 1]);
        last = vec![answers[2].data.clone(), answers[3].data.clone()];
    }
    assert_eq!(last, [[8, 0], [8, 0]]);
}

/// ECAT-14.3 IgH and TwinCAT: all FMMUs and sync managers in one datagram each, EEPROM commands of their own form, a
/// mapped mailbox state, ARMW in the cyclic frame.
#[test]
fn igh_and_twincat() {
    let mut rig = two_drives();
    rig.expect(Bwr, 0, 0x0010, &[0, 0], 2);
    rig.expect(Bwr, 0, 0x0900, &[0], 2);
    for n in 0..2u16 {
        rig.expect(Apwr, n.wrapping_neg(), 0x0010, &(FIRST + n).to_le_bytes(), 1);
        rig.expect(Fprd, FIRST + n, 0x0000, &[0; 12], 1);
        rig.expect(Fprd, FIRST + n, 0x0910, &[0; 8], 1);
        rig.expect(Fprd, FIRST + n, 0x0900, &[0; 16], 1);
        rig.expect(Fpwr, FIRST + n, 0x0500, &[0], 1);
        // A read of the EEPROM with 16 bits of address, and 10 bytes of its registers.
        rig.expect(Fpwr, FIRST + n, 0x0502, &[0x80, 0x01, 8, 0], 1);
        let registers = rig.expect(Fprd, FIRST + n, 0x0502, &[0; 10], 1);
        assert_eq!((registers[1] & 0xE1, &registers[6..]), (0, &VENDOR_ID.to_le_bytes()[..]));
        rig.expect(Fpwr, FIRST + n, 0x0600, &[0; 128], 1);
        rig.expect(Fpwr, FIRST + n, 0x0800, &[0; 64], 1);
        rig.expect(Fpwr, FIRST + n, 0x0980, &[0, 0], 1);
        rig.bring_to_preop(FIRST + n);
        // The mailbox state as a bit of the image.
        let bit =
            Fmmu { first_bit: n as u8, last_bit: n as u8, ..Fmmu::bytes(0x0900_0000, 1, 0x080D, FmmuDirections::READ) };
        rig.set_fmmu(FIRST + n, 2, Fmmu { physical_bit: 3, ..bit });
        rig.set_process_data(FIRST + n, 0x0100_0000 + u32::from(n) * 100);
        rig.expect(Fpwr, FIRST + n, 0x0400, &[0xC2, 0x09], 1);
        rig.expect(Fpwr, FIRST + n, 0x0420, &[0xE8, 0x03], 1);
        rig.expect(Fpwr, FIRST + n, 0x09A0, &1_000_000u64.to_le_bytes(), 1);
        let start = rig.read_u64(FIRST + n, 0x0910) / MS * MS + 100 * MS;
        rig.expect(Fpwr, FIRST + n, 0x0990, &start.to_le_bytes(), 1);
        rig.expect(Fpwr, FIRST + n, 0x0980, &[0x00, 0x03], 1);
        rig.expect(Fpwr, FIRST + n, 0x09A8, &[0], 1);
        rig.expect(Fpwr, FIRST + n, 0x0120, &[4, 0], 1);
        assert_eq!(rig.expect(Fprd, FIRST + n, 0x0130, &[0; 6], 1)[0] & 0x1F, 4);
        rig.expect(Fpwr, FIRST + n, 0x0120, &[8, 0], 1);
    }
    rig.pause = MS;
    for _ in 0..200 {
        let answers = rig.frame(&[
            (DatagramHeader::register(Nop, 0, 0, 0x0900), &[0; 4]),
            (DatagramHeader::register(Armw, 0, 0, 0x0910), &[0; 4]),
            (DatagramHeader::new(Lrw, 0, 0x0100_0000), &[0; 200]),
            (DatagramHeader::new(Command::Lrd, 0, 0x0900_0000), &[0]),
            (DatagramHeader::register(Brd, 0, 0, 0x0130), &[0; 2]),
        ]);
        assert_eq!([0, 1, 2, 3, 4].map(|n| answers[n].wkc), [0, 2, 6, 2, 2]);
    }
    assert_eq!(rig.expect(Brd, 0, 0x0130, &[0, 0], 2), [8, 0]);
    assert!(rig.read_u32(FIRST + 1, 0x092C) & 0x7FFF_FFFF < 1_000);
}
