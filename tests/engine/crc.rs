//! The CRC of frames as the board uses it: the switches of SET_EX, checking, filling, the error count.

use ecmsk::cia402::Mode;
use ecmsk::coe::ObjectAddress;
use ecmsk::engine::{EngineConfig, Firmware};
use ecmsk::fieldbus::Role;
use ecmsk::sk::{
    CycleTime, DcShift, DriveSync, FIFO_ENTRIES, Frame, MasterCommand, MasterState, RawSlot, SdoCommand, SdoResponse,
    SlaveCommand, SlotSize,
};

use crate::host::Host;
use crate::probe::{Bench, drives};

/// The CRC as the guide describes it: x^8+x^2+x+1 from 0x5A over the whole frame, its byte 3 taken as 0.
pub fn crc8(wire: &[u8]) -> u8 {
    const STEPS: [u8; 256] = {
        let mut steps = [0; 256];
        let mut byte = 0;
        while byte < 256 {
            let (mut crc, mut bit) = (byte as u8, 0);
            while bit < 8 {
                crc = if crc & 0x80 != 0 { crc << 1 ^ 0x07 } else { crc << 1 };
                bit += 1;
            }
            steps[byte] = crc;
            byte += 1;
        }
        steps
    };
    let over = |crc: u8, bytes: &[u8]| bytes.iter().fold(crc, |crc, byte| STEPS[usize::from(crc ^ byte)]);
    over(over(over(0x5A, &wire[..3]), &[0]), &wire[4..])
}

fn board(slot: SlotSize, firmware: Firmware) -> Bench {
    Bench::new(EngineConfig { slot, firmware, ..EngineConfig::default() }, drives(2))
}

/// A board that checks commands.
fn checking(slot: SlotSize, firmware: Firmware) -> Bench {
    let mut bench = board(slot, firmware);
    bench.host.master(MasterCommand::SetEx { check_commands: true, fill_responses: true }).soft_reset();
    bench
}

/// Sends a frame with a byte 3 that is not its CRC.
fn send_wrong(host: &mut Host, build: impl FnOnce(&mut Frame, SlotSize)) {
    let mut frame = Frame::new();
    build(&mut frame, host.size);
    frame.bytes_mut()[3] = !crc8(frame.wire(host.size));
    host.send(&frame);
}

/// A command for the board whose answer shows that it was executed: byte 0 becomes 0x21.
fn local_read(frame: &mut Frame, size: SlotSize) {
    frame.put_master(size, &MasterCommand::LocalRead);
}

fn executes_wrong_frames(host: &mut Host) -> bool {
    host.idle().cycle();
    assert_eq!(host.answer().id, 0x00);
    send_wrong(host, local_read);
    host.cycle();
    host.answer().id == 0x21
}

fn fills_responses(host: &mut Host) -> bool {
    let mut crcs = Vec::new();
    for group in 0..5 {
        host.master(MasterCommand::SetAxis { group, kinds: Default::default() }).cycle();
        crcs.push((host.report.crc_byte(), crc8(host.report.wire(host.size))));
        host.idle().cycle();
        crcs.push((host.report.crc_byte(), crc8(host.report.wire(host.size))));
    }
    let filled = crcs.iter().all(|(found, right)| found == right);
    // SK-1.17: switched off, the CRC is 0. A right CRC may be 0, but not in all of these reports.
    assert_ne!(filled, crcs.iter().all(|(found, _)| *found == 0), "{crcs:02X?}");
    filled
}

/// SK-1.18 A board with factory settings does not check commands and fills responses. SK-2.10 Byte 3 of slot 0 is the
/// CRC-8 of the response.
#[test]
fn factory_setting() {
    for size in SlotSize::ALL {
        let Bench { mut host, .. } = board(size, Firmware::V17);
        assert!(executes_wrong_frames(&mut host), "{size:?}");
        assert_eq!((host.answer().error, host.counters().crc), (0, 0), "{size:?}");
        for _ in 0..50 {
            host.master(MasterCommand::LocalRead).cycle();
            assert_eq!(host.report.crc_byte(), crc8(host.report.wire(size)), "{size:?}");
        }
    }
}

/// SK-1.15 SET_EX switches checking and filling independently. SK-1.16 The switches act after the next SW_RESET and not
/// before, and further ones keep them. SK-1.17 With response CRC off, byte 3 of a response is 0. SK-4.14 Data1 bit 0 is
/// the check, bit 4 the filling; other bits are without effect. SK-4.33 SW_RESET resets all but the switches.
#[test]
fn switches_act_after_the_next_boot() {
    for size in SlotSize::ALL {
        for (data1, check, fill) in [
            (0x00, false, false),
            (0x01, true, false),
            (0x10, false, true),
            (0x11, true, true),
            (0xFFFF_FFEE, false, false),
        ] {
            let Bench { mut host, .. } = board(size, Firmware::V17);
            host.raw(0, RawSlot { id: 0x04, data1, ..RawSlot::ZERO }).cycle();
            assert_eq!((host.answer().id, host.answer().result), (0x04, 0), "{size:?} {data1:X}");
            assert!(executes_wrong_frames(&mut host), "{size:?} {data1:X}: checks before the boot");
            assert!(fills_responses(&mut host), "{size:?} {data1:X}: no CRC before the boot");
            for boot in 1..=3 {
                host.soft_reset();
                assert_eq!(executes_wrong_frames(&mut host), !check, "{size:?} {data1:X} boot {boot}");
                assert_eq!(fills_responses(&mut host), fill, "{size:?} {data1:X} boot {boot}");
            }
        }
    }
}

/// SK-1.16 The last setting before a boot counts.
#[test]
fn the_last_switch_before_a_boot_counts() {
    let Bench { mut host, .. } = board(SlotSize::Bytes12, Firmware::V17);
    host.master(MasterCommand::SetEx { check_commands: true, fill_responses: false });
    host.master(MasterCommand::SetEx { check_commands: false, fill_responses: true }).soft_reset();
    assert!(executes_wrong_frames(&mut host) && fills_responses(&mut host));
}

/// SK-1.19 With checking on a frame of SET_EX is checked too.
#[test]
fn set_ex_is_checked_too() {
    for size in SlotSize::ALL {
        let Bench { mut host, .. } = checking(size, Firmware::V17);
        let off = MasterCommand::SetEx { check_commands: false, fill_responses: false };
        send_wrong(&mut host, |frame, size| frame.put_master(size, &off));
        host.soft_reset();
        assert!(!executes_wrong_frames(&mut host) && fills_responses(&mut host), "{size:?}");
        host.master(off).soft_reset();
        assert!(executes_wrong_frames(&mut host) && !fills_responses(&mut host), "{size:?}");
    }
}

/// SK-1.24 No slot of a frame with a wrong CRC is executed. SK-1.25 SK-2.5 It raises the error count in byte 1 of slot
/// 0 by one. SK-4.44 Such frames are counted outside the wire too.
#[test]
fn a_wrong_frame_acts_in_no_slot() {
    for size in SlotSize::ALL {
        let Bench { mut host, jobs, .. } = checking(size, Firmware::V17);
        let everything = |frame: &mut Frame, size: SlotSize| {
            let cycle = CycleTime::from_us(2000).unwrap();
            frame.put_master(size, &MasterCommand::SetDc { cycle, shift: DcShift::Auto });
            let mode = SlaveCommand::DriveMode { mode: Mode::Csv, sync: DriveSync::FreeRun };
            (1..=size.max_slaves()).for_each(|slave| frame.put_slave(size, slave, &mode.with_index(7)));
            frame.put_sdo(size, &SdoCommand::Read { slave: 1, object: ObjectAddress::new(0x1000, 0) });
        };
        host.declare_drives(2).idle().cycle();
        let (slots, mark) = (host.report.clone(), host.mark());
        send_wrong(&mut host, everything);
        host.cycles(50);
        assert_eq!((host.answer().error, host.counters().crc, host.mark()), (1, 1, mark), "{size:?}");
        assert_eq!(host.answer().id, 0, "{size:?}");
        (1..size.slots()).for_each(|n| assert_eq!(host.slot(n), slots.slot(size, n), "{size:?} slot {n}"));
        host.go(MasterState::SafeOp);
        let config = jobs.configured();
        assert_eq!((config.cycle.us(), config.slaves[0].role, config.slaves[0].sync), {
            (1000, Role::Drive(Mode::Csp), DriveSync::DcSync)
        });

        // The same frame with the right CRC acts in all slots.
        host.go(MasterState::PreOp).build(everything);
        host.until("the SDO", |host| host.sdo_answer() != SdoResponse::Empty);
        assert_eq!((host.answer().error, host.answer().id), (1, 0x03), "{size:?}");
        (1..=size.max_slaves()).for_each(|n| assert_eq!((host.slot(n).id, host.slot(n).index), (0x06, 7)));
    }
}

/// SK-1.19 With checking on, a frame of zeros needs its CRC too: 0x59 in 504 bytes, 0x60 in 512.
#[test]
fn zeros_need_their_crc() {
    for (size, crc) in [(SlotSize::Bytes12, 0x59), (SlotSize::Bytes16, 0x60)] {
        let Bench { mut host, .. } = checking(size, Firmware::V17);
        let mut zeros = Frame::new();
        host.send(&zeros).cycle();
        assert_eq!(host.answer().error, 1, "{size:?}");
        zeros.bytes_mut()[3] = crc;
        host.send(&zeros).cycle();
        assert_eq!(host.answer().error, 1, "{size:?}");
    }
}

/// SK-1.26 The error count wraps from 255 to 0.
/// SK-2.5 SK-2.6 It stands in byte 1 in profile 1.7; in profile 1.5 that byte stays 0.
#[test]
fn error_count_wraps() {
    for firmware in [Firmware::V17, Firmware::V15] {
        let Bench { mut host, .. } = checking(SlotSize::Bytes12, firmware);
        for n in 1..=600u32 {
            send_wrong(&mut host, local_read);
            host.cycle();
            let shown = if firmware == Firmware::V17 { n as u8 } else { 0 };
            assert_eq!((host.answer().error, host.counters().crc), (shown, n.into()), "{firmware:?}");
        }
    }
}

/// SK-1.27 In OP a frame with a wrong CRC takes no entry and does not raise the full count, not even when the FIFO is
/// full; responses go on with current data.
#[test]
fn in_op_a_wrong_frame_takes_no_entry() {
    for size in SlotSize::ALL {
        let Bench { mut host, .. } = checking(size, Firmware::V17);
        // The cycle is so slow that the FIFO fills within it.
        let cycle = CycleTime::from_us(512_000).unwrap();
        host.master(MasterCommand::SetDc { cycle, shift: DcShift::Auto }).op(2);
        for taken in 0..3 {
            send_wrong(&mut host, |_, _| {});
            assert_eq!(host.board.engine().fifo_free(), FIFO_ENTRIES - taken);
            host.idle();
        }
        while host.board.engine().fifo_free() > 0 {
            host.idle();
        }
        let reports = host.reports;
        send_wrong(&mut host, |frame, size| frame.put_slave(size, 1, &SlaveCommand::ServoOn.into()));
        assert_eq!(host.reports, reports, "{size:?}: the cycle was too short for this test");
        assert_eq!((host.counters().crc, host.counters().full), (4, 0), "{size:?}");
        assert!(host.cycle());
        let answer = host.answer();
        assert_eq!((answer.error, answer.full_count, answer.fifo_free), (4, 0, 1), "{size:?}");
        assert_eq!((answer.id, host.report.crc_byte()), (0xBF, crc8(host.report.wire(size))), "{size:?}");
        host.drained();
        assert!(!host.drive(1).statusword.is_enabled(), "{size:?}");
        assert_eq!((host.counters().executed, host.counters().crc), (160, 4), "{size:?}");
    }
}
