//! Every register that a master uses: its length, its value at power-on, and the effect of a write.

use ecmsk::ethercat::Command;
use ecmsk::slave::esc::EscSettings;

use super::rig::{Rig, drive};

/// The effect of writing 0xFF to a byte of a register.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Write {
    /// Nothing, and it does not count.
    No,
    /// The byte has that value then.
    Kept,
    /// It counts, and is read as 0.
    Zero,
    /// It counts, and another value is read.
    Taken,
}
use Write::{Kept, No, Taken, Zero};

/// Address, length, the bytes at power-on (missing ones are 0; `None`: they depend on time or cables), and the effect
/// of a write. DL control of two ports of four; words 0 to 3 of the EEPROM of a drive.
const TABLE: &[(u16, usize, Option<&[u8]>, Write)] = &[
    (0x0000, 1, Some(&[0x11]), No),
    (0x0001, 1, Some(&[0]), No),
    (0x0002, 2, Some(&[0]), No),
    (0x0004, 1, Some(&[8]), No),
    (0x0005, 1, Some(&[8]), No),
    (0x0006, 1, Some(&[8]), No),
    (0x0007, 1, Some(&[0x0F]), No),
    (0x0008, 2, Some(&[0xCC, 0x01]), No),
    (0x0010, 2, Some(&[0]), Kept),
    (0x0012, 2, Some(&[0]), No),
    (0x0020, 1, Some(&[0]), Kept),
    (0x0021, 1, Some(&[0]), Kept),
    (0x0030, 1, Some(&[0]), Kept),
    (0x0031, 1, Some(&[0]), Kept),
    (0x0040, 1, Some(&[0]), Kept),
    (0x0041, 1, Some(&[0]), No),
    (0x0100, 4, Some(&[0x01, 0xC0, 0x07]), Kept),
    (0x0108, 2, Some(&[0]), Kept),
    (0x0110, 2, Some(&[0x11, 0x56]), No),
    (0x0120, 2, Some(&[1]), Kept),
    (0x0130, 2, Some(&[1]), No),
    (0x0132, 2, Some(&[0]), No),
    (0x0134, 2, Some(&[0]), No),
    (0x0138, 2, Some(&[0]), No),
    (0x0140, 2, Some(&[0x05, 0x0C]), No),
    (0x0150, 4, Some(&[0]), No),
    (0x0200, 2, Some(&[0]), Kept),
    (0x0204, 4, Some(&[0x0F, 0xFF, 0xFF]), No),
    (0x0210, 2, Some(&[0x04]), No),
    (0x0220, 4, Some(&[0]), No),
    (0x0300, 8, Some(&[0]), Zero),
    (0x0308, 4, Some(&[0]), Zero),
    (0x030C, 1, Some(&[0]), Zero),
    (0x030D, 1, Some(&[0]), Zero),
    (0x030E, 1, Some(&[0]), No),
    (0x0310, 4, Some(&[0]), Zero),
    (0x0400, 2, Some(&[0xC2, 0x09]), Kept),
    (0x0410, 2, Some(&[0xE8, 0x03]), Kept),
    (0x0420, 2, Some(&[0xE8, 0x03]), Kept),
    (0x0440, 2, Some(&[0]), No),
    (0x0442, 1, Some(&[0]), Zero),
    (0x0443, 1, Some(&[0]), Zero),
    (0x0500, 1, Some(&[0]), Kept),
    (0x0501, 1, Some(&[0]), No),
    (0x0502, 2, Some(&[0x40]), Taken),
    (0x0504, 4, Some(&[0]), Kept),
    (0x0508, 8, Some(&[0]), Kept),
    (0x0510, 12, Some(&[0]), No),
    (0x0600, 128, Some(&[0]), Kept),
    (0x0800, 4, Some(&[0]), Kept),
    (0x0804, 1, Some(&[0]), Kept),
    (0x0805, 1, Some(&[0]), Taken),
    (0x0806, 1, Some(&[0]), Kept),
    (0x0807, 1, Some(&[0]), Taken),
    (0x0900, 16, Some(&[0]), Taken),
    (0x0910, 8, None, Taken),
    (0x0918, 8, Some(&[0]), No),
    (0x0920, 8, Some(&[0]), Kept),
    (0x0928, 4, Some(&[0]), Kept),
    (0x092C, 4, Some(&[0]), No),
    (0x0930, 2, Some(&[0x00, 0x10]), Kept),
    (0x0932, 2, Some(&[0]), No),
    (0x0934, 1, Some(&[0x04]), Kept),
    (0x0935, 1, Some(&[0x0C]), Kept),
    (0x0936, 1, Some(&[0]), Kept),
    (0x0980, 1, Some(&[0]), Kept),
    (0x0981, 1, Some(&[0]), Taken),
    (0x0982, 2, Some(&[0xE8, 0x03]), No),
    (0x0984, 1, Some(&[0]), No),
    (0x098E, 1, Some(&[0]), No),
    (0x098F, 1, Some(&[0]), No),
    (0x0990, 8, Some(&[0]), Kept),
    (0x0998, 8, Some(&[0]), No),
    (0x09A0, 4, Some(&[0]), Kept),
    (0x09A4, 4, Some(&[0]), Kept),
    (0x09A8, 2, Some(&[0]), Kept),
    (0x09AE, 2, Some(&[0]), No),
    (0x09B0, 32, Some(&[0]), No),
    (0x09F0, 16, Some(&[0]), No),
    (0x0F00, 4, Some(&[0]), Kept),
    (0x1000, 8, Some(&[0]), Kept),
];

fn rig() -> Rig {
    Rig::new([drive(EscSettings::default())])
}

/// ECAT-2.8 Each register has its length and its value at power-on.
#[test]
fn values_at_power_on() {
    for (address, len, value, _) in TABLE {
        let mut rig = rig();
        let answer = rig.one(Command::Aprd, 0, *address, &vec![0xEE; *len]);
        assert_eq!(answer.wkc, 1, "0x{address:04X}");
        if let Some(value) = value {
            let mut expected = value.to_vec();
            expected.resize(*len, 0);
            assert_eq!(answer.data, expected, "0x{address:04X}");
        }
    }
}

/// ECAT-2.8 A write to any byte of a register has the effect of its access.
#[test]
fn what_a_write_does() {
    for (address, len, _, write) in TABLE {
        for byte in 0..*len as u16 {
            let mut rig = rig();
            let at = address + byte;
            let before = rig.one(Command::Aprd, 0, at, &[0]).data;
            let wkc = rig.one(Command::Apwr, 0, at, &[0xFF]).wkc;
            // A byte of DL control opens ports without a link: every later frame is lost.
            let after = rig.chain.slave(0).controller().peek(at, 1).to_vec();
            match write {
                No => assert_eq!((wkc, after), (0, before), "0x{at:04X}"),
                Kept => assert_eq!((wkc, after), (1, vec![0xFF]), "0x{at:04X}"),
                Zero => assert_eq!((wkc, after), (1, vec![0]), "0x{at:04X}"),
                Taken => assert!(wkc <= 1 && after != [0xFF], "0x{at:04X} {wkc} {after:?}"),
            }
        }
    }
}

/// ECAT-2.8 Between the registers there are gaps; a longer access over a gap counts, and the gap reads 0.
#[test]
fn gaps() {
    let is_there = |at: u16| TABLE.iter().any(|(address, len, ..)| (*address..*address + *len as u16).contains(&at));
    let known = |at: u16| is_there(at) || (0x0808..0x0840).contains(&at) || (0x0F80..0x1000).contains(&at);
    let mut rig = rig();
    for at in (0..0x1000).filter(|at| !known(*at)) {
        assert_eq!(rig.one(Command::Aprd, 0, at, &[0xEE]).wkc, 0, "0x{at:04X}");
        assert_eq!(rig.one(Command::Apwr, 0, at, &[0xEE]).wkc, 0, "0x{at:04X}");
    }
    let answer = rig.one(Command::Aprd, 0, 0x0012, &[0xEE; 0x14]);
    assert_eq!((answer.wkc, answer.data), (1, vec![0; 0x14]));
}

/// ECAT-9.10 A write to either expiry counter of the watchdogs clears both.
#[test]
fn expiry_counters_are_cleared_together() {
    for clears in [0x0442, 0x0443] {
        let mut rig = Rig::drives(1);
        rig.bring_to_op(super::rig::FIRST, 0);
        rig.now += 200 * super::rig::MS;
        assert_eq!(rig.one(Command::Aprd, 0, 0x0442, &[0; 2]).data, [1, 0]);
        rig.one(Command::Apwr, 0, clears, &[0x55]);
        assert_eq!(rig.one(Command::Aprd, 0, 0x0442, &[0; 2]).data, [0, 0]);
    }
}
