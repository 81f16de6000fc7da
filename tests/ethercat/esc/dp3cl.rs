//! A DP3CL as the network sees it: its controller, its mailbox, and the alarms that only a controller can cause.

use ecmsk::ethercat::mailbox::{MailboxFault, MailboxMessage, MailboxProtocol};
use ecmsk::ethercat::registers::{self, LatchEdge, SmControl, SyncManager, latch_time};
use ecmsk::ethercat::sii::{CategoryKind, FmmuUsage, MailboxProtocols, Sii};
use ecmsk::ethercat::{AlState, AlStatus, Command};
use ecmsk::slave::esc::esi_of;
use ecmsk::slave::{Dp3cl, Dp3clConfig, Drive, DriveConfig, Fault, HomeSwitch, Input, InputPattern, Slave, Travel};

use super::rig::{FIRST, INPUTS, MS, OUTPUTS, Rig, slave};

/// A DP3CL behind its own controller, in Init.
fn rig() -> Rig {
    rig_of(Dp3clConfig::default())
}

fn rig_of(config: Dp3clConfig) -> Rig {
    let device = Box::new(Dp3cl::new(config));
    let settings = device.controller_settings();
    Rig::with_stations([slave(device, settings)])
}

/// A drive in PreOP, with its process data and SYNC0 of 1 ms that begins that much later.
fn with_sync0(begins_ms: i64, activation: u8) -> Rig {
    let mut rig = rig();
    rig.bring_to_preop(FIRST);
    rig.set_process_data(FIRST, 0);
    let start = rig.read_u64(FIRST, registers::SYSTEM_TIME).wrapping_add_signed(begins_ms * MS as i64);
    rig.write(FIRST, registers::SYNC0_START, &start.to_le_bytes());
    rig.write(FIRST, registers::SYNC0_CYCLE, &1_000_000_u32.to_le_bytes());
    rig.write(FIRST, registers::SYNC_ACTIVATION, &[activation]);
    rig
}

/// DP3CL-1.11 Its controller reads as the manual prints.
#[test]
fn registers_of_the_manual() {
    let mut rig = rig();
    for (address, value) in [
        (0x0000, &[0x04, 0x02, 0x40, 0x00, 0x03, 0x04, 0x08, 0x0F, 0x84, 0x01][..]),
        (0x0140, &[0x08, 0x0C]),
        (0x0151, &[0x66]),
    ] {
        assert_eq!(rig.read(FIRST, address, value.len()), value, "0x{address:04X}");
    }
    // [STD] values of the watchdogs, which the manual does not print.
    for (address, value) in [(0x0400, 0x09C2), (0x0410, 0x03E8), (0x0420, 0x03E8)] {
        assert_eq!(rig.read_u16(FIRST, address), value, "0x{address:04X}");
    }
    for (address, len) in [(0x0440, 1), (0x0442, 1), (0x0443, 1), (0x0981, 1), (0x0984, 1), (0x098E, 1), (0x09A0, 4)] {
        assert_eq!(rig.read(FIRST, address, len), vec![0; len], "0x{address:04X}");
    }
    // 3 FMMUs and 4 sync managers, and no more.
    assert_eq!(rig.one(Command::Fprd, FIRST, registers::fmmu(3), &[0]).wkc, 0);
    assert_eq!(rig.one(Command::Fprd, FIRST, registers::sync_manager(4), &[0]).wkc, 0);
}

/// DP3CL-5.9 The shortest mailboxes that the manual allows, 32 and 40 bytes, work; shorter ones are E-811.
#[test]
fn the_shortest_mailboxes() {
    for (out, back, answer) in [
        (32, 40, (0x02, AlStatus::NONE)),
        (31, 40, (0x11, AlStatus::INVALID_MAILBOX)),
        (32, 39, (0x11, AlStatus::INVALID_MAILBOX)),
    ] {
        let mut rig = rig();
        rig.set_manager(FIRST, 0, SyncManager::enabled(0x1000, out, SmControl::MAILBOX_OUT));
        rig.set_manager(FIRST, 1, SyncManager::enabled(0x1080, back, SmControl::MAILBOX_IN));
        assert_eq!(rig.request(FIRST, 0x02), answer, "{out} and {back}");
        if answer.1 == AlStatus::NONE {
            let mut mailbox = vec![0; 32];
            mailbox[..12].copy_from_slice(&[10, 0, 0, 0, 0, 0x03, 0, 0x20, 0x40, 0x18, 0x10, 1]);
            assert_eq!(rig.one(Command::Fpwr, FIRST, 0x1000, &mailbox).wkc, 1);
            let read = rig.one(Command::Fprd, FIRST, 0x1080, &[0; 40]);
            assert_eq!((read.wkc, &read.data[8..16]), (1, &[0x43, 0x18, 0x10, 1, 0x56, 0x05, 0, 0][..]));
        }
    }
}

/// DP3CL-5.5 E-803: SYNC0 that has not come 1 s after SafeOP, and is not due later, leads to PreOP with 0x002D; the
/// drive waits for a pulse that is still due.
#[test]
fn sync0_that_does_not_come() {
    let mut rig = with_sync0(-5, 0x03);
    rig.reach(FIRST, AlState::SafeOp);
    rig.now += 990 * MS;
    assert_eq!(rig.al_status(FIRST), (0x04, AlStatus::NONE));
    rig.now += 20 * MS;
    assert_eq!(rig.al_status(FIRST), (0x12, AlStatus::NO_SYNC));

    let mut rig = with_sync0(1_500, 0x03);
    rig.reach(FIRST, AlState::SafeOp);
    rig.now += 5_000 * MS;
    assert_eq!(rig.al_status(FIRST), (0x04, AlStatus::NONE));
}

/// DP3CL-5.21 Inputs come once SYNC0 has come: until then they read 0.
#[test]
fn inputs_wait_for_sync0() {
    let mut rig = with_sync0(100, 0x03);
    rig.reach(FIRST, AlState::SafeOp);
    let inputs = |rig: &mut Rig| rig.logical(Command::Lrd, 8, &[0xEE; 19]);
    rig.now += 50 * MS;
    let before = inputs(&mut rig);
    assert_eq!((before.wkc, before.data), (1, vec![0; 19]));
    rig.now += 100 * MS;
    let after = inputs(&mut rig);
    assert_eq!((after.wkc, after.data[2] & 0x4F), (1, 0x40), "the statusword of Switch on disabled");
}

/// DP3CL-5.6 E-804: outputs that stop lead to SafeOP with 0x001B, in SafeOP too, where the watchdog runs from the first outputs on.
#[test]
fn outputs_that_stop() {
    for state in [AlState::SafeOp, AlState::Op] {
        let mut rig = rig();
        rig.bring_to_preop(FIRST);
        rig.set_process_data(FIRST, 0);
        rig.reach(FIRST, AlState::SafeOp);
        rig.now += 5_000 * MS;
        assert_eq!(rig.al_status(FIRST), (0x04, AlStatus::NONE), "none have come yet");
        assert_eq!(rig.logical(Command::Lrw, 0, &[0; 27]).wkc, 3);
        if state == AlState::Op {
            rig.reach(FIRST, AlState::Op);
        }
        rig.now += 101 * MS;
        assert_eq!(rig.al_status(FIRST), (0x14, AlStatus::WATCHDOG), "{state:?}");
        assert_eq!(rig.request(FIRST, 0x14), (0x04, AlStatus::NONE));
    }
}

/// DP3CL-5.7 E-806: SYNC0 that is switched off leads from SafeOP and from OP to SafeOP with 0x0032.
#[test]
fn sync0_that_is_switched_off() {
    for state in [AlState::SafeOp, AlState::Op] {
        let mut rig = with_sync0(2, 0x03);
        rig.reach(FIRST, AlState::SafeOp);
        rig.now += 20 * MS;
        if state == AlState::Op {
            rig.logical(Command::Lrw, 0, &[0; 27]);
            rig.reach(FIRST, AlState::Op);
        }
        rig.write(FIRST, registers::SYNC_ACTIVATION, &[0]);
        assert_eq!(rig.al_status(FIRST), (0x14, AlStatus::PLL), "{state:?}");
    }
}

/// DP3CL-5.8, DP3CL-5.10, DP3CL-5.11, DP3CL-5.12, DP3CL-5.13 E-810, E-814 to E-817 on the way to SafeOP, by the registers of the
/// controller.
#[test]
fn mistakes_on_the_way_to_safeop() {
    type Mistake = fn(&mut Rig);
    let mistakes: [(Mistake, AlStatus); 8] = [
        (|rig| rig.write(FIRST, registers::SYNC0_CYCLE, &3_000_000_u32.to_le_bytes()), AlStatus::INVALID_DC_CYCLE),
        (|rig| rig.write(FIRST, registers::WATCHDOG_PROCESS_DATA, &[19, 0]), AlStatus::INVALID_WATCHDOG),
        (|rig| rig.write(FIRST, registers::SYNC_ACTIVATION, &[0x07]), AlStatus::INVALID_DC_SYNC),
        (|rig| rig.write(FIRST, registers::SYNC_ACTIVATION, &[0x05]), AlStatus::INVALID_DC_SYNC),
        (|rig| drop(rig.coe(FIRST, &[0, 0x20, 0x2B, 0x32, 0x1C, 1, 3, 0, 0, 0])), AlStatus::SYNC_MODE_UNSUPPORTED),
        (|rig| replace(rig, 2, SyncManager::enabled(0x1101, 8, SmControl::OUTPUTS)), AlStatus::INVALID_OUTPUTS),
        (|rig| replace(rig, 2, SyncManager::enabled(0x1040, 8, SmControl::OUTPUTS)), AlStatus::INVALID_OUTPUTS),
        (|rig| replace(rig, 3, SyncManager::enabled(OUTPUTS + 4, 19, SmControl::INPUTS)), AlStatus::INVALID_OUTPUTS),
    ];
    for (number, (mistake, code)) in mistakes.into_iter().enumerate() {
        let mut rig = with_sync0(2, 0x03);
        mistake(&mut rig);
        assert_eq!(rig.request(FIRST, 0x04), (0x12, code), "{number}");
    }
    let mut rig = with_sync0(2, 0x03);
    rig.reach(FIRST, AlState::SafeOp);
    assert!(rig.lens(FIRST) == (8, 19) && INPUTS > OUTPUTS);
}

fn replace(rig: &mut Rig, n: u8, manager: SyncManager) {
    rig.write(FIRST, registers::sync_manager_activate(n), &[0]);
    rig.set_manager(FIRST, n, manager);
}

/// DP3CL-5.20 An alarm sends no emergency.
#[test]
fn no_emergencies() {
    let mut rig = rig();
    rig.bring_to_preop(FIRST);
    assert_eq!(rig.request(FIRST, 0x08), (0x12, AlStatus::INVALID_CHANGE), "E-800");
    rig.now += 50 * MS;
    assert_eq!(rig.coe(FIRST, &[0, 0x20, 0x40, 0x3F, 0x60, 0, 0, 0, 0, 0])[6..8], [0x50, 0xFF]);
    rig.now += 50 * MS;
    assert_eq!(rig.collect(FIRST), None);
}

/// Reads an object of at most 4 bytes.
fn upload(rig: &mut Rig, index: u16, sub: u8) -> u32 {
    let [low, high] = index.to_le_bytes();
    let answer = rig.coe(FIRST, &[0, 0x20, 0x40, low, high, sub, 0, 0, 0, 0]);
    assert_eq!(answer[1], 0x30, "{index:04X}:{sub} {answer:X?}");
    let bytes = 4 - usize::from(answer[2] >> 2 & 3);
    answer[6..6 + bytes].iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte))
}

/// Writes an object of 1, 2 or 4 bytes.
fn download(rig: &mut Rig, index: u16, sub: u8, value: &[u8]) {
    let [low, high] = index.to_le_bytes();
    let mut data = vec![0, 0x20, 0x23 | (4 - value.len() as u8) << 2, low, high, sub];
    data.extend(value);
    data.resize(10, 0);
    assert_eq!(rig.coe(FIRST, &data)[2], 0x60, "{index:04X}:{sub}");
}

/// DP3CL-5.22 Its mailbox has only CoE; it has no identification, and no bootstrap.
#[test]
fn what_it_does_not_have() {
    let mut rig = rig();
    assert_eq!(rig.request(FIRST, 0x03), (0x11, AlStatus::BOOT_UNSUPPORTED), "E-802");
    assert_eq!(rig.request(FIRST, 0x11), (0x01, AlStatus::NONE));
    rig.bring_to_preop(FIRST);
    assert_eq!(rig.request(FIRST, 0x22), (0x02, AlStatus::NONE));
    let others = [MailboxProtocol::Eoe, MailboxProtocol::Foe, MailboxProtocol::Soe, MailboxProtocol::Voe];
    for protocol in others {
        let message = rig.message(protocol, &[1, 2, 3, 4, 5, 6]);
        rig.post(FIRST, &message);
        let answer = rig.collect(FIRST).expect("an answer");
        let answer = MailboxMessage::decode(&answer).expect("a message");
        assert_eq!(answer.header.protocol, MailboxProtocol::Error, "{protocol:?}");
        assert_eq!(MailboxFault::decode(answer.data), Ok(MailboxFault::UNSUPPORTED_PROTOCOL), "{protocol:?}");
    }
}

/// DP3CL-1.12 Its EEPROM has the sync managers, FMMUs and mailbox of the maker's slave description, and its ESI file
/// agrees with that description about the mailbox.
#[test]
fn eeprom_and_esi_of_the_maker() {
    let rig = rig();
    let eeprom = rig.chain.slave(0).controller().eeprom();
    let sii = Sii::new(eeprom).expect("an EEPROM");
    assert_eq!((eeprom.len(), sii.info().protocols), (2048, MailboxProtocols::COE));
    let managers = sii.category(CategoryKind::SyncManagers).expect("some").sync_managers();
    let managers: Vec<_> = managers.map(|manager| (manager.start, manager.len, manager.control.0)).collect();
    // The lengths of the process data are those of the mapping at power-on.
    assert_eq!(managers, [(0x1000, 128, 0x26), (0x1080, 128, 0x22), (0x1100, 8, 0x64), (0x1400, 19, 0x20)]);
    let usages: Vec<_> = sii.category(CategoryKind::Fmmus).expect("some").fmmus().collect();
    assert_eq!(usages[..3], [FmmuUsage::Outputs, FmmuUsage::Inputs, FmmuUsage::MailboxState]);
    let modes: Vec<_> = sii.category(CategoryKind::DcModes).expect("one").dc_modes().collect();
    assert_eq!(modes[0].assign_activate, 0x0300);
    let mut device = Dp3cl::default();
    let settings = device.controller_settings();
    let esi = esi_of(&mut device, &settings).expect("it can be described");
    let mailbox = "SdoInfo=\"1\" PdoAssign=\"1\" PdoConfig=\"1\" CompleteAccess=\"0\" SegmentedSdo=\"0\"";
    assert!(esi.contains(mailbox), "{esi}");
    assert!(esi.contains("Physics=\"YY\""), "two ports of MII");
    let mut drive = Drive::new(DriveConfig::default());
    let settings = drive.controller_settings();
    assert!(esi_of(&mut drive, &settings).expect("it can be described").contains("SegmentedSdo=\"1\""));
}

/// DP3CL-2.12 A saved P7-00 is the alias of the controller after the next power-on, and an alias that a master has
/// written to the EEPROM stays until P7-00 changes.
#[test]
fn the_alias_is_that_of_the_eeprom() {
    let mut rig = rig();
    let alias = |rig: &mut Rig| rig.read_u16(FIRST, registers::STATION_ALIAS);
    let restart = |rig: &mut Rig| {
        rig.power_cycle(0);
        rig.give_stations();
    };
    rig.bring_to_preop(FIRST);
    download(&mut rig, 0x2700, 0, &40_000_u16.to_le_bytes());
    download(&mut rig, 0x4002, 0, &[1]);
    assert_eq!(alias(&mut rig), 0);
    restart(&mut rig);
    assert_eq!(alias(&mut rig), 40_000);
    let mut first: [u8; 14] = rig.chain.slave(0).controller().eeprom()[..14].try_into().expect("14 bytes");
    first[8..10].copy_from_slice(&[0x77, 0x07]);
    let checksum = ecmsk::ethercat::sii::checksum(&first);
    for command in [[1, 2, 4, 0, 0, 0, 0x77, 0x07], [1, 2, 7, 0, 0, 0, checksum, 0]] {
        rig.write(FIRST, registers::SII_CONTROL, &command);
    }
    // A command to load the words anew leaves the alias.
    rig.write(FIRST, registers::SII_CONTROL, &[0, 4]);
    assert_eq!(alias(&mut rig), 40_000);
    restart(&mut rig);
    assert_eq!(alias(&mut rig), 0x0777);
    rig.bring_to_preop(FIRST);
    download(&mut rig, 0x2700, 0, &[5, 0]);
    download(&mut rig, 0x4002, 0, &[1]);
    restart(&mut rig);
    assert_eq!(alias(&mut rig), 5);
}

/// DP3CL-5.16 An alarm of the bus is cleared in two places: AL control acknowledges the error of the AL status, and
/// F0-00 clears the alarm; neither replaces the other.
#[test]
fn two_things_to_acknowledge() {
    for acknowledge_first in [true, false] {
        let mut rig = rig();
        rig.bring_to_preop(FIRST);
        assert_eq!(rig.request(FIRST, 0x08), (0x12, AlStatus::INVALID_CHANGE), "E-800");
        rig.now += 20 * MS;
        assert_eq!((upload(&mut rig, 0x603F, 0), upload(&mut rig, 0x3100, 0)), (0xFF50, 800));
        for acknowledge in [acknowledge_first, !acknowledge_first] {
            if acknowledge {
                assert_eq!(rig.request(FIRST, 0x12), (0x02, AlStatus::NONE));
            } else {
                download(&mut rig, 0x4000, 0, &[1]);
            }
            rig.now += 20 * MS;
            let has_alarm = acknowledge == acknowledge_first && acknowledge_first;
            assert_eq!(upload(&mut rig, 0x603F, 0) != 0, has_alarm);
            let has_error = acknowledge == acknowledge_first && !acknowledge_first;
            assert_eq!(rig.al_status(FIRST).0 & 0x10 != 0, has_error);
        }
    }
}

/// DP3CL-2.10 U3 behind a controller: outputs 300 us before each SYNC0 of 1 ms, except once.
#[test]
fn monitors_of_the_cycle() {
    let mut rig = with_sync0(20, 0x03);
    rig.reach(FIRST, AlState::SafeOp);
    let start = rig.read_u64(FIRST, registers::SYNC0_START);
    for n in 0..40 {
        let before = if n == 20 { 500_000 } else { 300_000 };
        rig.now = start + n * MS - before - rig.pause;
        assert_eq!(rig.logical(Command::Lrw, 0, &[0; 27]).wkc, 3);
        if n == 5 {
            // It goes to OP after its first pulses; the frames of that take some time.
            rig.write(FIRST, registers::AL_CONTROL, &[8, 0]);
        }
    }
    rig.now = start + 39 * MS + 100_000;
    assert_eq!(rig.al_status(FIRST), (0x08, AlStatus::NONE));
    let u3: Vec<u32> = (0x3300..=0x330B).map(|index| upload(&mut rig, index, 0)).collect();
    assert_eq!([0, 2, 3].map(|n| u3[n]), [1000, 1200, 800], "PDI period");
    assert_eq!([4, 6, 7].map(|n| u3[n]), [1000; 3], "Sync0 period");
    assert_eq!([9, 10, 11].map(|n| u3[n]), [300, 500, 300], "PDI to Sync0");
    assert_eq!(u3[8], 1000, "ECAT timer period");
    // The reads take time, in which SYNC0 goes on: both times are computed for one moment.
    let since = (u3[5] as u16).wrapping_sub(u3[1] as u16);
    assert_eq!((since % 1000, u3[5] / 1000 >= 39), (300, true), "{u3:?}");
}

/// DP3CL-8.5 SI1 and SI2 are the latch inputs of the controller: the times of their edges are those at which the shaft was there, and
/// those at which a terminal was forced.
#[test]
fn terminals_are_latch_inputs() {
    let travel = Travel {
        negative_limit: None,
        positive_limit: Some(2_505),
        home: Some(HomeSwitch::Cam { first: 205, last: 1_204 }),
        ..Travel::for_turn(10_000)
    };
    let wiring = [Some(Input::Home), Some(Input::PositiveLimit), None, None];
    let mut rig = rig_of(Dp3clConfig { travel, wiring, ..Dp3clConfig::default() });
    rig.bring_to_preop(FIRST);
    for parameter in [0x2205, 0x2206, 0x2207, 0x2208] {
        download(&mut rig, parameter, 0, &[0, 0]);
    }
    download(&mut rig, 0x6060, 0, &[8]);
    rig.set_process_data(FIRST, 0);
    rig.reach(FIRST, AlState::SafeOp);
    rig.write(FIRST, registers::LATCH_CONTROL, &[3, 1]);
    let send = |rig: &mut Rig, word: u8, target: i32| {
        let mut image = [0; 27];
        image[0] = word;
        image[2..6].copy_from_slice(&target.to_le_bytes());
        rig.now = (rig.now / MS + 1) * MS - rig.pause;
        assert_eq!(rig.logical(Command::Lrw, 0, &image).wkc, 3);
        rig.now
    };
    send(&mut rig, 0, 0);
    rig.reach(FIRST, AlState::Op);
    for word in [0x06, 0x07, 0x0F] {
        (0..150).for_each(|_| assert!(send(&mut rig, word, 0) > 0));
    }
    assert_eq!(rig.read(FIRST, registers::LATCH_STATUS, 2), [0, 0]);
    // 100 u each ms: the frame that brings a target begins the way to it, and the next one ends it.
    let begins = send(&mut rig, 0x0F, 100);
    for step in 2..40 {
        send(&mut rig, 0x0F, step * 100);
    }
    for (input, edge, place) in
        [(0, LatchEdge::Positive, 205), (0, LatchEdge::Negative, 1205), (1, LatchEdge::Positive, 2505)]
    {
        let at = rig.read_u64(FIRST, latch_time(input, edge));
        assert_eq!(at, begins + place * MS / 100, "{input} {edge:?}");
    }
    // Reading has acknowledged them; SI2 is still on.
    assert_eq!(rig.read(FIRST, registers::LATCH_STATUS, 2), [0, 4]);
    let force = |bits| Fault::ForceInputs { channel: 0, pattern: Some(InputPattern::Bits(bits)) };
    let before = rig.now;
    rig.chain.slave_mut(0).device_mut().apply_fault(force(0b01));
    send(&mut rig, 0x0F, 3900);
    let at = rig.read_u64(FIRST, latch_time(0, LatchEdge::Positive));
    assert!((before - MS..=before + MS).contains(&at), "{at} {before}");
    assert_eq!(rig.read(FIRST, registers::LATCH_STATUS, 2), [4, 0]);
    // After power-on the levels are there, without an edge.
    rig.power_cycle(0);
    rig.give_stations();
    rig.now += 20 * MS;
    assert_eq!(rig.read(FIRST, registers::LATCH_STATUS, 2), [0, 4]);
    assert_eq!(rig.read_u64(FIRST, latch_time(1, LatchEdge::Positive)), 0);
}
