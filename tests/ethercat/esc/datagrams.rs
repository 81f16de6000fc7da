//! Datagrams through slaves: addressing, working counters, and returned frames.

use ecmsk::ethercat::registers::{self, DlControl, Features};
use ecmsk::ethercat::{Command, DatagramHeader, Frame};
use ecmsk::slave::esc::{EscSettings, FrameFate};

use super::rig::{FIRST, Rig, answers, drive, frame_of};

/// A frame with these datagrams, without padding.
fn bare(datagrams: &[(DatagramHeader, &[u8])]) -> Vec<u8> {
    let mut bytes = frame_of(datagrams);
    let len = 16 + usize::from(Frame::decode(&bytes).expect("a frame").header.len);
    bytes.truncate(len);
    bytes
}

/// ECAT-8.1 BRD counts each slave once in working counter and position, and combines their bytes by OR; the source comes back
/// with bit 1 of its first byte set.
#[test]
fn s01_broadcast_reads_combine_all_slaves() {
    let types = [0x11, 0x04, 0x90];
    let slaves = types.map(|controller_type| drive(EscSettings { controller_type, ..EscSettings::default() }));
    let mut rig = Rig::new(slaves);
    let mut bytes = bare(&[(DatagramHeader::register(Command::Brd, 9, 0, registers::TYPE), &[0x20])]);
    assert!(matches!(rig.raw(&mut bytes), FrameFate::Returned(_)));
    let answer = &answers(&bytes)[0];
    assert_eq!((answer.wkc, answer.header.adp(), answer.data[0]), (3, 3, 0x20 | 0x11 | 0x04 | 0x90));
    assert_eq!(Frame::decode(&bytes).expect("a frame").header.source, [0x12, 0x10, 0x10, 0x10, 0x10, 0x10]);
}

/// ECAT-8.2 APRD reads the slave at which the position is 0; each slave adds 1 to it.
#[test]
fn s02_positions_count_from_the_master() {
    let slaves = [1, 2, 3].map(|revision| drive(EscSettings { revision, ..EscSettings::default() }));
    let mut rig = Rig::new(slaves);
    for (adp, revision) in [(0, 1), (0xFFFF, 2), (0xFFFE, 3)] {
        let answer = rig.one(Command::Aprd, adp, registers::REVISION, &[0]);
        assert_eq!((answer.wkc, answer.data[0], answer.header.adp()), (1, revision, adp.wrapping_add(3)));
    }
    for adp in [0xFFFD, 1] {
        let answer = rig.one(Command::Aprd, adp, registers::REVISION, &[0xEE]);
        assert_eq!((answer.wkc, answer.data[0], answer.header.adp()), (0, 0xEE, adp.wrapping_add(3)));
    }
}

/// ECAT-8.3 FPRD reads the slave with that station address, or with that alias if bit 24 of DL control is set.
#[test]
fn s03_stations_are_known_by_address_or_alias() {
    let mut rig = Rig::drives(2);
    let unknown = rig.one(Command::Fprd, 0x4711, registers::TYPE, &[0xEE]);
    assert_eq!((unknown.wkc, unknown.data[0], unknown.header.adp()), (0, 0xEE, 0x4711));
    assert_eq!(rig.read_u16(FIRST + 1, registers::STATION_ADDRESS), FIRST + 1);

    // The alias of the second slave is 0x0777 from its next power-on on.
    for data in [[1, 2, 4, 0, 0, 0, 0x77, 0x07], [1, 2, 7, 0, 0, 0, 0, 0]] {
        let mut data = data.to_vec();
        if data[2] == 7 {
            let mut first: [u8; 14] = rig.chain.slave(1).controller().eeprom()[..14].try_into().expect("14 bytes");
            first[8..10].copy_from_slice(&[0x77, 0x07]);
            data[6] = ecmsk::ethercat::sii::checksum(&first);
        }
        rig.write(FIRST + 1, registers::SII_CONTROL, &data);
    }
    rig.power_cycle(1);
    assert_eq!(rig.one(Command::Fprd, 0x0777, registers::STATION_ALIAS, &[0, 0]).wkc, 0);
    let control = DlControl::POWER_ON.0 | DlControl::ALIAS;
    assert_eq!(rig.one(Command::Apwr, 0xFFFF, registers::DL_CONTROL, &control.to_le_bytes()).wkc, 1);
    let answer = rig.one(Command::Fprd, 0x0777, registers::STATION_ALIAS, &[0, 0]);
    assert_eq!((answer.wkc, answer.data), (1, vec![0x77, 0x07]));
}

/// ECAT-8.4 BWR counts each slave; APRW and FPRW give the old bytes, write the new ones and count 3; BRW combines.
#[test]
fn s04_writes_and_swaps() {
    let mut rig = Rig::drives(3);
    assert_eq!(rig.one(Command::Bwr, 0, registers::AL_CONTROL, &[1, 0]).wkc, 3);
    rig.write(FIRST, 0x1F00, &[0x12, 0x34]);
    let old = rig.one(Command::Aprw, 0, 0x1F00, &[0x56, 0x78]);
    assert_eq!((old.wkc, old.data), (3, vec![0x12, 0x34]));
    let old = rig.one(Command::Fprw, FIRST, 0x1F00, &[0x9A, 0xBC]);
    assert_eq!((old.wkc, old.data), (3, vec![0x56, 0x78]));
    assert_eq!(rig.read(FIRST, 0x1F00, 2), [0x9A, 0xBC]);

    let combined = rig.one(Command::Brw, 0, 0x1F00, &[0x01, 0x00]);
    assert_eq!((combined.wkc, combined.data, combined.header.adp()), (9, vec![0x9B, 0xBC], 3));
    // Each slave has its own bytes.
    assert_eq!([0, 1, 2].map(|n| rig.read(FIRST + n, 0x1F00, 1)[0]), [0x01, 0x9B, 0x9B]);

    // The physical offset moves what is written.
    rig.write(FIRST, registers::PHYSICAL_OFFSET, &[0x10, 0]);
    let old = rig.one(Command::Fprw, FIRST, 0x1F00, &[0x77, 0x77]);
    assert_eq!((old.wkc, old.data[0], rig.read(FIRST, 0x1F00, 1)[0], rig.read(FIRST, 0x1F10, 1)[0]), (3, 1, 1, 0x77));
}

/// ECAT-8.4 A register that can only be read counts no write, and memory that is not there counts nothing.
#[test]
fn s04_what_is_refused_is_not_counted() {
    let mut rig = Rig::drives(1);
    assert_eq!(rig.one(Command::Fpwr, FIRST, registers::TYPE, &[0x55]).wkc, 0);
    assert_eq!(rig.read(FIRST, registers::TYPE, 1), [0x11]);
    assert_eq!(rig.one(Command::Fprw, FIRST, registers::TYPE, &[0x55]).wkc, 1);
    for ado in [0x3000, 0xFFFF, 0x0014] {
        assert_eq!(rig.one(Command::Fprd, FIRST, ado, &[0]).wkc, 0, "0x{ado:04X}");
        assert_eq!(rig.one(Command::Fpwr, FIRST, ado, &[0]).wkc, 0, "0x{ado:04X}");
    }
    // A longer access over registers and gaps counts, and gaps read 0.
    let answer = rig.one(Command::Fprd, FIRST, registers::STATION_ADDRESS, &[0xEE; 8]);
    assert_eq!((answer.wkc, &answer.data[4..]), (1, &[0; 4][..]));
    // The end of the RAM.
    let answer = rig.one(Command::Fprd, FIRST, 0x2FFE, &[0xEE; 4]);
    assert_eq!((answer.wkc, answer.data), (1, vec![0, 0, 0xEE, 0xEE]));
}

/// ECAT-8.5 FRMW of the system time counts the slaves with distributed clocks alone.
#[test]
fn s05_one_is_read_and_the_others_are_written() {
    let without_clock = Features(EscSettings::default().features.0 & !(Features::CLOCK.0 | Features::CLOCK_64_BITS.0));
    let slaves = [true, false, true, true, false].map(|clock| {
        let settings = EscSettings::default();
        drive(if clock { settings } else { EscSettings { features: without_clock, ..settings } })
    });
    let mut rig = Rig::with_stations(slaves);
    let answer = rig.one(Command::Frmw, FIRST, registers::SYSTEM_TIME, &[0; 8]);
    assert_eq!(answer.wkc, 3);
    assert_eq!(answer.header.adp(), FIRST);
    assert_eq!(rig.one(Command::Fprd, FIRST + 1, registers::SYSTEM_TIME, &[0; 8]).wkc, 0, "no clock, no register");
}

/// ECAT-8.6 ARMW reads one slave; those before it write the master's data, those behind it the data read.
#[test]
fn s06_slaves_before_the_reader_write_the_masters_data() {
    let mut rig = Rig::drives(3);
    for n in 0..3 {
        rig.write(FIRST + n, 0x1F00, &[n as u8 + 1]);
    }
    let answer = rig.one(Command::Armw, 0xFFFF, 0x1F00, &[0x99]);
    assert_eq!((answer.wkc, answer.data[0], answer.header.adp()), (3, 2, 2));
    assert_eq!([0, 1, 2].map(|n| rig.read(FIRST + n, 0x1F00, 1)[0]), [0x99, 2, 2]);
}

/// ECAT-8.7 NOP and commands that are not known pass unchanged.
#[test]
fn s07_nothing_happens_to_what_is_unknown() {
    let mut rig = Rig::drives(2);
    for command in [Command::Nop, Command::Unknown(15), Command::Unknown(0xFF)] {
        let answer = rig.one(command, 0, registers::SYSTEM_TIME, &[1, 2, 3, 4]);
        assert_eq!((answer.wkc, answer.data, answer.header.adp()), (0, vec![1, 2, 3, 4], 0));
    }
}

/// ECAT-8.8 A short frame and the same one with padding of any content come back equal; index, length and "more" stay.
#[test]
fn s08_padding_makes_no_difference() {
    let header = DatagramHeader::register(Command::Brd, 0x5A, 0, registers::TYPE);
    let mut short = bare(&[(header, &[0])]);
    assert_eq!(short.len(), 29);
    let mut padded = short.clone();
    padded.resize(60, 0xEE);
    let mut rig = Rig::drives(2);
    rig.raw(&mut short);
    rig.raw(&mut padded);
    assert_eq!(answers(&short), answers(&padded));
    assert!(padded[29..].iter().all(|byte| *byte == 0xEE));
    let DatagramHeader { index, len, more, .. } = answers(&short)[0].header;
    assert_eq!((index, len, more), (0x5A, 1, false));
}

/// ECAT-8.9 All datagrams of a frame are answered; the longest one is, too.
#[test]
fn s09_many_datagrams_and_a_long_one() {
    let mut rig = Rig::drives(2);
    let headers: Vec<DatagramHeader> =
        (0..15).map(|n| DatagramHeader::register(Command::Aprd, n, 0xFFFF, registers::STATION_ADDRESS)).collect();
    let datagrams: Vec<(DatagramHeader, &[u8])> = headers.iter().map(|header| (*header, &[0, 0][..])).collect();
    let all = rig.frame(&datagrams);
    assert_eq!(all.len(), 15);
    for (n, answer) in all.iter().enumerate() {
        assert_eq!((answer.wkc, &answer.data[..], answer.header.index), (1, &[0x02, 0x10][..], n as u8));
    }
    let len = rig.bring_to_op(FIRST, 0x0100_0000 + 1400);
    let answer = rig.logical(Command::Lrw, 0x0100_0000, &[0xEE; 1486]);
    assert_eq!(answer.wkc, 3);
    assert!(answer.data[..1400].iter().chain(&answer.data[1400 + len..]).all(|byte| *byte == 0xEE));
}

/// ECAT-8.10 The field `irq` has the events of all slaves that their masks let through; a change of AL status is one, until AL
/// status is read.
#[test]
fn s10_events_come_with_every_datagram() {
    let mut rig = Rig::drives(2);
    let irq = |rig: &mut Rig| rig.one(Command::Nop, 0, 0, &[]).header.irq;
    rig.read(FIRST, registers::DL_STATUS, 2);
    rig.read(FIRST + 1, registers::DL_STATUS, 2);
    rig.write(FIRST, registers::ECAT_EVENT_MASK, &[0xFF, 0x0F]);
    rig.write(FIRST + 1, registers::ECAT_EVENT_MASK, &[0x04, 0]);
    assert_eq!(irq(&mut rig), 0);
    rig.write(FIRST, registers::AL_CONTROL, &[2, 0]);
    assert_eq!(irq(&mut rig), 0x0008, "PreOP was refused");
    assert_eq!(rig.read_u16(FIRST, registers::ECAT_EVENT), 0x0008);
    rig.al_status(FIRST);
    assert_eq!(irq(&mut rig), 0);
    rig.chain.connect(1, false);
    assert_eq!(irq(&mut rig), 0x0004, "the first slave has lost a link");
    rig.write(FIRST, registers::AL_CONTROL, &[0x12, 0]);
    assert_eq!(irq(&mut rig), 0x000C);
    rig.al_status(FIRST);
    rig.read(FIRST, registers::DL_STATUS, 2);
    assert_eq!(irq(&mut rig), 0);
    // Two slaves at once, each with its own.
    rig.chain.connect(1, true);
    rig.read(FIRST, registers::DL_STATUS, 2);
    rig.write(FIRST, registers::AL_CONTROL, &[0x12, 0]);
    assert_eq!(irq(&mut rig), 0x000C, "AL status of the first slave, DL status of the second one");
}

/// ECAT-8.12 The bit "circulating" of a datagram comes back as it was, and such a datagram is processed as any other:
/// the port by which a frame comes to a slave has a link.
#[test]
fn a_circulating_datagram_passes() {
    let mut rig = Rig::drives(2);
    for circulating in [false, true] {
        let header = DatagramHeader { circulating, ..DatagramHeader::register(Command::Brd, 3, 0, registers::TYPE) };
        let answer = rig.frame(&[(header, &[0])]).remove(0);
        assert_eq!((answer.wkc, answer.header.circulating), (2, circulating));
    }
}

/// ECAT-8.11 A frame whose datagrams do not fit into it has no effect, and each slave counts it; one that is not of EtherCAT is
/// destroyed if DL control says so, or passes.
#[test]
fn frames_that_are_wrong() {
    let mut rig = Rig::drives(2);
    let write = DatagramHeader::register(Command::Bwr, 1, 0, 0x1F00);
    let mut torn = bare(&[(write, &[7]), (write, &[8])]);
    // The second datagram claims a byte too much.
    torn[16 + 13 + 6] = 2;
    let before = torn.clone();
    assert!(matches!(rig.raw(&mut torn), FrameFate::Returned(_)));
    assert_eq!((torn[16..].to_vec(), torn[6]), (before[16..].to_vec(), 0x12));
    for n in 0..2 {
        assert_eq!(rig.read(FIRST + n, 0x1F00, 1), [0]);
        assert_eq!(rig.read_u8(FIRST + n, registers::PROCESSING_UNIT_ERRORS), 1);
    }

    let mut arp = [0xFF; 60];
    (arp[12], arp[13]) = (0x08, 0x06);
    assert_eq!(rig.raw(&mut arp), FrameFate::Destroyed);
    for n in 0..2 {
        rig.write(FIRST + n, registers::DL_CONTROL, &[0]);
    }
    let before = arp;
    assert!(matches!(rig.raw(&mut arp), FrameFate::Returned(_)));
    assert_eq!(arp, before);
}

/// ECAT-8.14 With bit 0 of 0x0021 no register is written, and with bit 0 of 0x0031 nothing at all, including process
/// data and RAM, except in a frame that has written 0x0020, or 0x0030, before. A refused write does not count.
#[test]
fn what_is_protected_is_written_with_leave_alone() {
    const RAM: u16 = 0x1F00;
    let register = registers::USER_RAM;
    let bwr = |ado| DatagramHeader::register(Command::Bwr, 7, 0, ado);
    for (enable, protects_ram) in [(registers::WRITE_REGISTER_ENABLE, false), (registers::ESC_WRITE_ENABLE, true)] {
        let mut rig = Rig::drives(1);
        let counts = |rig: &mut Rig, ado| rig.frame(&[(bwr(ado), &[0xA5])])[0].wkc;
        assert_eq!([counts(&mut rig, register), counts(&mut rig, RAM)], [1, 1]);
        assert_eq!(counts(&mut rig, enable + 1), 1, "it is on");
        assert_eq!([counts(&mut rig, register), counts(&mut rig, RAM)], [0, u16::from(!protects_ram)]);
        assert_eq!(counts(&mut rig, enable + 1), 0, "and is no more taken back than anything else");
        // For every written value.
        let allowed = rig.frame(&[(bwr(register), &[1]), (bwr(enable), &[0]), (bwr(register), &[2]), (bwr(RAM), &[3])]);
        assert_eq!(allowed.iter().map(|answer| answer.wkc).collect::<Vec<_>>(), [0, 1, 1, 1]);
        assert_eq!((rig.read_u8(FIRST, register), rig.read_u8(FIRST, RAM)), (2, 3));
        assert_eq!(counts(&mut rig, register), 0, "for one frame");
        assert_eq!(rig.frame(&[(bwr(enable), &[0, 0])])[0].wkc, 1, "both bytes: it is off");
        assert_eq!([counts(&mut rig, register), counts(&mut rig, RAM)], [1, 1]);
    }
}
