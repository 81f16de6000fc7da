//! Cables and power.

use std::sync::{Arc, Mutex};

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::ethercat::registers::{self, DlControl};
use ecmsk::ethercat::{AlState, CableEnd, Command, DatagramHeader, Ns};
use ecmsk::slave::esc::{EscSettings, EscSlave, FrameFate};
use ecmsk::slave::{AlStatus, Slave};

use super::rig::{FIRST, MS, Rig, answers, drive, frame_of};

/// ECAT-9.1 DL status distinguishes an inner slave from the last one; a slave that is cut off is not counted any more,
/// and the one before it has closed its port.
#[test]
fn s11_a_cut_cable_closes_a_port() {
    let mut rig = Rig::drives(3);
    let status = |rig: &mut Rig, n| rig.read_u16(FIRST + n, registers::DL_STATUS);
    assert_eq!([0, 1, 2].map(|n| status(&mut rig, n)), [0x5A31, 0x5A31, 0x5611]);
    assert_eq!(rig.one(Command::Brd, 0, registers::TYPE, &[0]).wkc, 3);

    rig.chain.connect(2, false);
    assert_eq!(rig.one(Command::Brd, 0, registers::TYPE, &[0]).wkc, 2);
    assert_eq!([0, 1].map(|n| status(&mut rig, n)), [0x5A31, 0x5611]);
    assert_eq!(rig.read_u8(FIRST + 1, registers::LOST_LINKS + 1), 1);
    rig.write(FIRST + 1, registers::LOST_LINKS, &[0]);
    assert_eq!(rig.read_u8(FIRST + 1, registers::LOST_LINKS + 1), 0);

    rig.chain.connect(2, true);
    assert_eq!(rig.one(Command::Brd, 0, registers::TYPE, &[0]).wkc, 3);
    assert_eq!(status(&mut rig, 2), 0x5611);
    assert_eq!(rig.read_u16(FIRST + 2, registers::STATION_ADDRESS), FIRST + 2, "it kept its power");

    rig.chain.connect(0, false);
    assert_eq!(rig.raw(&mut [0; 60]), FrameFate::Lost);
}

/// ECAT-9.2 After power-on station address, sync managers and FMMUs are 0, the state is Init, the alias is that of the
/// EEPROM; AL Init alone keeps the station address.
#[test]
fn s12_power_on_begins_anew() {
    let mut rig = Rig::drives(2);
    rig.bring_to_op(FIRST + 1, 0);
    rig.reach(FIRST + 1, AlState::Init);
    assert_eq!(rig.read_u16(FIRST + 1, registers::STATION_ADDRESS), FIRST + 1);

    rig.bring_to_op(FIRST + 1, 0);
    rig.chain.power(1, false, rig.now);
    assert_eq!(rig.one(Command::Brd, 0, registers::TYPE, &[0]).wkc, 1);
    rig.now += 50 * MS;
    rig.chain.power(1, true, rig.now);
    let read = |rig: &mut Rig, ado, len| rig.one(Command::Aprd, 0xFFFF, ado, &vec![0xEE; len]);
    let address = read(&mut rig, registers::STATION_ADDRESS, 4);
    assert_eq!((address.wkc, address.data), (1, vec![0, 0, 0, 0]));
    assert_eq!(read(&mut rig, registers::AL_STATUS, 6).data, [1, 0, 0, 0, 0, 0]);
    assert_eq!(read(&mut rig, registers::FMMU, 128).data, [0; 128]);
    assert_eq!(read(&mut rig, registers::SYNC_MANAGER, 64).data, [0; 64]);
    assert_eq!(rig.chain.slave(1).device().state(), AlState::Init);
}

/// ECAT-9.2 Three frames that write R, E, S reset a slave as power-on does; other bytes do not.
#[test]
fn three_frames_reset_a_slave() {
    let mut rig = Rig::drives(1);
    for byte in b"RRERE" {
        rig.write(FIRST, registers::RESET_ECAT, &[*byte]);
    }
    assert_eq!(rig.read_u16(FIRST, registers::STATION_ADDRESS), FIRST);
    for byte in b"RES" {
        rig.write(FIRST, registers::RESET_ECAT, &[*byte]);
    }
    assert_eq!(rig.one(Command::Aprd, 0, registers::STATION_ADDRESS, &[0xEE; 2]).data, [0, 0]);
}

/// ECAT-9.8 The master closes and opens ports by DL control: closed, what is behind is not reached; opened without a link,
/// frames are lost; closed automatically, a port is opened by a write alone.
#[test]
fn loops_are_controlled() {
    let mut rig = Rig::drives(3);
    let set = |rig: &mut Rig, bits: u32| {
        let control = DlControl::POWER_ON.0 & 0xFFFF_00FF | bits << 10;
        rig.write(FIRST, registers::DL_CONTROL, &control.to_le_bytes());
    };
    let count = |rig: &mut Rig| rig.one(Command::Brd, 0, registers::TYPE, &[0]).wkc;
    set(&mut rig, 3);
    assert_eq!((count(&mut rig), rig.read_u16(FIRST, registers::DL_STATUS)), (1, 0x5631));
    set(&mut rig, 0);
    assert_eq!(count(&mut rig), 3);

    set(&mut rig, 1);
    assert_eq!(count(&mut rig), 3);
    rig.chain.connect(1, false);
    rig.chain.connect(1, true);
    assert_eq!(count(&mut rig), 1, "it stays closed");
    set(&mut rig, 1);
    assert_eq!(count(&mut rig), 3);

    set(&mut rig, 2);
    rig.chain.connect(1, false);
    assert_eq!(rig.raw(&mut [0; 60]), FrameFate::Lost);
}

/// ECAT-9.8 A frame that an open port without a link loses has passed the slaves before: a frame that sets the ports by
/// their links repairs that.
#[test]
fn slaves_before_a_hole_have_had_the_frame() {
    let mut rig = Rig::drives(3);
    let closed_behind = DlControl::POWER_ON.with_loop(1, registers::LoopControl::Open);
    rig.write(FIRST + 2, registers::DL_CONTROL, &closed_behind.0.to_le_bytes());
    let frame = |rig: &mut Rig, ado, data: &[u8]| {
        rig.raw(&mut frame_of(&[(DatagramHeader::register(Command::Bwr, 1, 0, ado), data)]))
    };
    assert_eq!(frame(&mut rig, registers::USER_RAM, &[0x5A]), FrameFate::Lost);
    assert_eq!([0, 1, 2].map(|n| rig.chain.slave(n).controller().peek(registers::USER_RAM, 1)), [[0x5A]; 3]);
    assert_eq!(frame(&mut rig, registers::DL_CONTROL, &[1, 0]), FrameFate::Lost, "its own way was open still");
    assert_eq!(rig.one(Command::Brd, 0, registers::TYPE, &[0]).wkc, 3);
}

/// ECAT-9.15 With bit 1 of DL control the ports are as written for a second, and then as before: one that is closed
/// opens, and a port that is open without a link, so that all frames are lost, closes.
#[test]
fn loops_for_a_second() {
    let mut rig = Rig::drives(3);
    let set = |rig: &mut Rig, bits: u32| {
        let control = DlControl::POWER_ON.0 & 0xFFFF_00FF | bits << 10 | DlControl::TEMPORARY;
        rig.write(FIRST, registers::DL_CONTROL, &control.to_le_bytes());
    };
    let count = |rig: &mut Rig| rig.one(Command::Brd, 0, registers::TYPE, &[0]).wkc;
    set(&mut rig, 3);
    rig.now += 900 * MS;
    assert_eq!((count(&mut rig), rig.read_u16(FIRST, registers::DL_STATUS)), (1, 0x5631));
    rig.now += 100 * MS;
    // The frame in which the time ends still takes the old way.
    count(&mut rig);
    assert_eq!((count(&mut rig), rig.read_u16(FIRST, registers::DL_STATUS)), (3, 0x5A31));
    let control = DlControl::POWER_ON.0 & 0xFFFF_F0FF;
    assert_eq!(rig.read_u32(FIRST, registers::DL_CONTROL) & 0xFFFF_0FFF, control & 0xFFFF_0FFF);

    rig.chain.connect(1, false);
    // Port 1 is open, whatever its link; the frame that opens it is back before.
    set(&mut rig, 2);
    assert_eq!(rig.raw(&mut [0; 60]), FrameFate::Lost);
    rig.now += 900 * MS;
    assert_eq!(rig.raw(&mut [0; 60]), FrameFate::Lost);
    rig.now += 100 * MS;
    assert_eq!(count(&mut rig), 1);
}

/// ECAT-9.9 A second branch is visited by ports 3, 1, 2 in this order.
#[test]
fn branches_are_visited_in_the_order_of_ports() {
    let settings = |revision| EscSettings { revision, ports: [3; 4], ..EscSettings::default() };
    let mut rig = Rig::new([drive(settings(0))]);
    for (revision, port) in [(1, 1), (2, 2), (3, 3)] {
        rig.chain.add(drive(settings(revision)), 0, port);
    }
    let order: Vec<u8> =
        (0..4).map(|n: u16| rig.one(Command::Aprd, n.wrapping_neg(), registers::REVISION, &[0]).data[0]).collect();
    assert_eq!(order, [0, 3, 1, 2]);
    rig.give_stations();
    assert_eq!(rig.read_u16(FIRST, registers::DL_STATUS), 0xAAF1);
}

/// ECAT-9.9, ECAT-10.3 Drives on branches take their outputs and move as those in a line do, also after a branch was cut off.
#[test]
fn drives_on_branches_move() {
    let settings = || EscSettings { ports: [3; 4], ..EscSettings::default() };
    let mut rig = Rig::new([drive(settings())]);
    for (parent, port) in [(0, 1), (0, 2), (0, 3), (1, 1), (4, 1)] {
        rig.chain.add(drive(settings()), parent, port);
    }
    rig.give_stations();
    let len: usize = (0..6).map(|n| rig.bring_to_op(FIRST + n, u32::from(n) * 16)).sum();
    let mut image = vec![0; len];
    let mut cycles = |rig: &mut Rig, n: i32, word: u8, target: i32| {
        for _ in 0..n {
            for outputs in image.chunks_mut(16) {
                outputs[..2].copy_from_slice(&[word, 0]);
                outputs[2..6].copy_from_slice(&target.to_le_bytes());
            }
            let answer = rig.logical(Command::Lrw, 0, &image);
            image.copy_from_slice(&answer.data);
        }
    };
    rig.pause = MS;
    [0x06, 0x07, 0x0F].into_iter().for_each(|word| cycles(&mut rig, 200, word, 0));
    cycles(&mut rig, 200, 0x0F, 1000);
    let shafts = |rig: &Rig| [0, 1, 2, 3, 4, 5].map(|n| rig.chain.slave(n).device().shaft(0));
    assert_eq!(shafts(&rig), [Some(1000); 6]);
    rig.chain.connect(4, false);
    cycles(&mut rig, 50, 0x0F, 1500);
    assert_eq!(shafts(&rig)[..4], [Some(1500); 4]);
    assert_eq!(shafts(&rig)[4..], [Some(1000); 2]);
}

/// ECAT-9.10 Error counters stop at 255 and are cleared by a write to any of their group.
#[test]
fn error_counters_stop_and_are_cleared() {
    let mut rig = Rig::drives(1);
    for _ in 0..300 {
        rig.chain.slave_mut(0).controller_mut().note_invalid_frame(1);
    }
    rig.chain.slave_mut(0).controller_mut().note_wrong_structure();
    assert_eq!(rig.read(FIRST, registers::RX_ERRORS, 13), [0, 0, 255, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1]);
    rig.write(FIRST, registers::FORWARDED_ERRORS, &[0x55]);
    assert_eq!(rig.read(FIRST, registers::RX_ERRORS, 13), [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1]);
    rig.write(FIRST, registers::PROCESSING_UNIT_ERRORS, &[0x55]);
    assert_eq!(rig.read(FIRST, registers::RX_ERRORS, 13), [0; 13]);
}

/// ECAT-9.13 From the last end a frame passes a whole ring untouched. Where a cable is cut it turns at the slave behind the gap, and the
/// slaves from there on work on it, in the order of the cable; a second time round it is destroyed.
#[test]
fn a_frame_from_the_last_end_turns_where_the_cable_is_cut() {
    let mut rig = Rig::drives(4);
    rig.chain.connect_second(Some((3, 1)));
    assert_eq!(
        rig.chain.slave(3).controller().peek(registers::DL_STATUS, 2),
        [0x31, 0x5A],
        "the last one is an inner one"
    );
    let send = |rig: &mut Rig, end, circulating| {
        rig.now += MS;
        let header = DatagramHeader { circulating, ..DatagramHeader::register(Command::Brd, 7, 0, registers::TYPE) };
        let mut bytes = frame_of(&[(header, &[0])]);
        let (fate, at) = rig.chain.process_from(end, &mut bytes, rig.now);
        let header = answers(&bytes)[0].header;
        let FrameFate::Returned(_) = fate else { return (None, at, 0, header.circulating) };
        let passed = header.address as u16;
        (Some(bytes[6] & 2 != 0), at, passed, header.circulating)
    };
    use CableEnd::{First, Last};
    assert_eq!(send(&mut rig, First, false), (Some(true), Last, 4, false));
    assert_eq!(send(&mut rig, Last, false), (Some(false), First, 0, false));

    rig.chain.connect(1, false);
    assert_eq!(send(&mut rig, First, false), (Some(true), First, 1, false));
    assert_eq!(send(&mut rig, Last, false), (Some(true), Last, 3, true));
    assert_eq!(send(&mut rig, Last, true).0, None, "it has turned before");
    assert_eq!(send(&mut rig, First, true), (Some(true), First, 1, true), "it turns nowhere");

    rig.chain.connect(1, true);
    rig.chain.connect(0, false);
    assert_eq!(send(&mut rig, First, false).0, None);
    assert_eq!(send(&mut rig, Last, false), (Some(true), Last, 4, true));

    rig.chain.connect(0, true);
    rig.chain.connect_second(None);
    assert_eq!(send(&mut rig, First, false), (Some(true), First, 4, false));
    assert_eq!(send(&mut rig, Last, false).0, None);
}

/// A device that records which ports have a link.
struct Linked(Arc<Mutex<[bool; 4]>>);

impl Slave for Linked {
    fn name(&self) -> &str {
        "linked"
    }

    fn state(&self) -> AlState {
        AlState::Init
    }

    fn enter(&mut self, _: AlState) -> Result<(), AlStatus> {
        Ok(())
    }

    fn read(&mut self, _: ObjectAddress, _: SdoScope, _: &mut [u8]) -> Result<usize, AbortCode> {
        Err(AbortCode::NO_OBJECT)
    }

    fn write(&mut self, _: ObjectAddress, _: SdoScope, _: &[u8]) -> Result<(), AbortCode> {
        Err(AbortCode::NO_OBJECT)
    }

    fn note_links(&mut self, links: [bool; 4]) {
        *self.0.lock().expect("no panic") = links;
    }

    fn exchange(&mut self, _: Option<&[u8]>, _: &mut [u8]) {}

    fn step(&mut self, _: Ns) {}
}

/// ECAT-9.1 A device learns which ports of its controller have a link, and each change.
#[test]
fn a_device_knows_its_links() {
    let links: [Arc<Mutex<[bool; 4]>>; 2] = [Arc::default(), Arc::default()];
    let slave = |links: &Arc<Mutex<[bool; 4]>>| {
        EscSlave::new(Box::new(Linked(links.clone())), EscSettings::default(), Vec::new(), 0)
    };
    let mut rig = Rig::new(links.each_ref().map(slave));
    let seen = || links.each_ref().map(|links| *links.lock().expect("no panic"));
    assert_eq!(seen(), [[true, true, false, false], [true, false, false, false]]);
    rig.chain.connect(1, false);
    assert_eq!(seen(), [[true, false, false, false], [false; 4]]);
    rig.chain.connect(1, true);
    rig.chain.power(1, false, rig.now);
    assert_eq!(seen()[0], [true, false, false, false]);
}

/// ECAT-8.13 Every frame comes back once: within 1 ms in the time of the network, however long the cable is, or it is lost for good.
#[test]
fn s40_each_frame_comes_back_once_and_in_time() {
    let mut rig = Rig::drives(40);
    let mut returned = 0;
    for n in 0..40 {
        rig.bring_to_op(FIRST + n, u32::from(n) * 16);
    }
    let frame = frame_of(&[(DatagramHeader::new(Command::Lrw, 1, 0), &[0; 640])]);
    for turn in 0..300 {
        // The cable to the master is cut, and later one in the middle.
        match turn {
            100 => rig.chain.connect(0, false),
            120 => rig.chain.connect(0, true),
            200 => rig.chain.connect(20, false),
            220 => rig.chain.connect(20, true),
            _ => {}
        }
        let mut bytes = frame.clone();
        let sent = rig.now + rig.pause;
        match rig.raw(&mut bytes) {
            FrameFate::Returned(back) => {
                returned += 1;
                assert!(back >= sent && back - sent < MS, "turn {turn}: {} ns", back - sent);
                assert_eq!(bytes[6] & 2, 2, "it has passed the slaves");
            }
            fate => {
                assert_eq!((fate, (100..120).contains(&turn)), (FrameFate::Lost, true), "turn {turn}");
                assert_eq!(bytes, frame, "a lost frame is not touched, and nothing of it comes later");
            }
        }
    }
    assert_eq!(returned, 280);
}
