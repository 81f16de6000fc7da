//! Pulse modules (HSP) of one and of two channels, with both sizes of a slot: layouts, SV_ON, CSP, CSV, outputs.

use ecmsk::cia402::{DriveState, Mode, Statusword};
use ecmsk::coe::SdoSize;
use ecmsk::engine::{EngineConfig, Firmware, Reason};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{AxisIn, AxisOut};
use ecmsk::sk::{
    AxisTarget, DriveSync, Frame, HspResponse, MasterCommand, MasterState, Motion, RawSlot, SlaveCommand, SlaveKind,
    SlotSize,
};
use ecmsk::slave::{Channels, DeviceFault, Fault, Hsp, HspConfig};

use crate::drives::discarded;
use crate::host::Host;
use crate::probe::Bench;
use crate::puppet::{DISABLED, ENABLED, FAULT, Puppet, READY, SWITCHED_ON};

const SIZES: [SlotSize; 2] = SlotSize::ALL;

fn config(slot: SlotSize) -> EngineConfig {
    EngineConfig { slot, ..EngineConfig::default() }
}

/// OP in that mode, slave 1 being an HSP and the others none.
fn op(host: &mut Host, mode: Mode) {
    let mut kinds = [SlaveKind::None; 8];
    kinds[0] = SlaveKind::Hsp;
    host.master(MasterCommand::SetAxis { group: 0, kinds });
    host.slave(1, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync });
    host.go(MasterState::Op).drained();
}

/// A board in OP with a puppet HSP.
fn board(size: SlotSize, channels: usize, mode: Mode, puppet: Puppet) -> (Host, Puppet) {
    let puppet = puppet.with_channels(channels);
    let mut host = Host::new(config(size), SimBus::new(vec![puppet.boxed()]));
    op(&mut host, mode);
    puppet.forget();
    (host, puppet)
}

/// The same with the HSP on.
fn board_on(size: SlotSize, channels: usize, mode: Mode) -> (Host, Puppet) {
    let (mut host, puppet) = board(size, channels, mode, Puppet::obedient());
    host.slave(1, SlaveCommand::ServoOn).cycles(20);
    assert!(answer(&host).statusword.is_enabled());
    puppet.forget();
    host.cycles(3);
    (host, puppet)
}

fn answer(host: &Host) -> HspResponse {
    HspResponse::decode(&host.slot(1), host.size)
}

fn motion(first: (i32, u16), second: (i32, u16)) -> Motion {
    let axis = |(target, outputs)| AxisTarget { target, outputs };
    Motion { first: axis(first), second: axis(second) }
}

fn command(mode: Mode, motion: Motion) -> SlaveCommand {
    if mode == Mode::Csp { SlaveCommand::Csp(motion) } else { SlaveCommand::Csv(motion) }
}

/// The bytes of slave 1's slot in the newest report.
fn bytes(host: &Host) -> Vec<u8> {
    let slot = host.size.bytes();
    host.report.bytes()[slot..2 * slot].to_vec()
}

fn shows(position: i32, inputs: u16) -> AxisIn {
    AxisIn { statusword: Statusword(0x1637), torque: 0x1234, position, error_code: 0x5678, inputs }
}

/// SK-3.22 The golden response of a two-channel HSP in 16-byte mode: position 2 is at byte 10, unaligned. There is
/// neither torque nor error code. SK-3.21 In 12-byte mode: position, inputs, 0. SK-3.24 A one-channel HSP in 16-byte
/// mode: bytes 10 to 15 are 0.
#[test]
fn golden_responses() {
    // Id and index, statusword 0x1637, then the vectors resp-hsp-12 and resp-hsp-2ch-16.
    let golden: [(SlotSize, usize, [AxisIn; 2], &[u8]); 4] = [
        (
            SlotSize::Bytes16,
            2,
            [shows(70_000, 1), shows(-70_000, 0x8000)],
            &[0x16, 3, 0x37, 0x16, 0x70, 0x11, 1, 0, 1, 0, 0x90, 0xEE, 0xFE, 0xFF, 0x00, 0x80],
        ),
        (
            SlotSize::Bytes16,
            1,
            [shows(70_000, 1), shows(-70_000, 0x8000)],
            &[0x16, 3, 0x37, 0x16, 0x70, 0x11, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0],
        ),
        (SlotSize::Bytes12, 1, [shows(500, 0xA5), shows(7, 7)], &[0x16, 3, 0x37, 0x16, 0xF4, 1, 0, 0, 0xA5, 0, 0, 0]),
        (SlotSize::Bytes12, 2, [shows(500, 0xA5), shows(7, 7)], &[0x16, 3, 0x37, 0x16, 0xF4, 1, 0, 0, 0xA5, 0, 0, 0]),
    ];
    for (size, channels, [first, second], expected) in golden {
        let (mut host, puppet) = board(size, channels, Mode::Csv, Puppet::new());
        puppet.strings().shows = first;
        puppet.strings().shows_second = second;
        host.raw(1, RawSlot { id: 0x16, index: 3, ..RawSlot::ZERO }).cycles(3);
        assert_eq!(bytes(&host), expected, "{size:?}, {channels} channels");
    }
}

/// SK-3.23 The golden command of a two-channel HSP in 16-byte mode: target 1, outputs 1, target 2 at byte 10, outputs 2.
/// SK-4.25 SK-4.26 SK-7.5 SK-7.6 CSP and CSV alike; a one-channel HSP, and one in 12-byte mode, gets the first half.
#[test]
fn golden_commands() {
    let golden = [0xFB, 0xFF, 0xFF, 0xFF, 0xFF, 0x00, 0x15, 0xCD, 0x5B, 0x07, 0x55, 0xAA];
    for (mode, id) in [(Mode::Csp, 0x15), (Mode::Csv, 0x16)] {
        for (size, channels) in SIZES.into_iter().flat_map(|size| [(size, 1), (size, 2)]) {
            let (mut host, puppet) = board_on(size, channels, mode);
            let still = puppet.last_two()[1];
            let mut frame = Frame::new();
            let slot = size.bytes();
            frame.bytes_mut()[slot] = id;
            frame.bytes_mut()[slot + 4..2 * slot].copy_from_slice(&golden[..slot - 4]);
            host.send(&frame).drained();
            let [first, second] = puppet.last_two();
            assert_eq!((first.target, first.outputs), (-5, 0x00FF), "{size:?} {channels} {mode}");
            let two = size == SlotSize::Bytes16 && channels == 2;
            let expected = if two { (123_456_789, 0xAA55) } else { (still.target, still.outputs) };
            assert_eq!((second.target, second.outputs), expected, "{size:?} {channels} {mode}");
            assert_eq!((answer(&host).head.id, host.counters().rejected_total(), discarded(&host)), (id, 0, 0));
        }
    }
}

/// SK-3.25 The layout is the same in every response, whatever the command; only the commands CSP and CSV read bytes 8
/// to 15.
#[test]
fn other_commands_read_nothing_and_are_answered_alike() {
    for (size, channels) in SIZES.into_iter().flat_map(|size| [(size, 1), (size, 2)]) {
        let (mut host, puppet) = board(size, channels, Mode::Csp, Puppet::new());
        puppet.strings().shows = AxisIn { statusword: Statusword(ENABLED), ..shows(-3, 0x0F0F) };
        puppet.strings().shows_second = shows(99, 0xF0F0);
        host.cycles(3);
        for id in [0x00, 0x10, 0x11, 0x12, 0x13, 0x14, 0x17, 0x07, 0x55] {
            host.raw(1, RawSlot { id, parm: 0xFFFF, data1: u32::MAX, data2: u32::MAX, data3: u32::MAX, index: 0 });
            host.cycles(3);
            let two = size == SlotSize::Bytes16 && channels == 2;
            let second = if two { (99, 0xF0F0) } else { (0, 0) };
            let seen = answer(&host);
            assert_eq!((seen.first.position, seen.first.inputs), (-3, 0x0F0F), "{size:?} {channels} {id:02X}");
            assert_eq!((seen.second.position, seen.second.inputs), second, "{size:?} {channels} {id:02X}");
            assert_eq!(seen.statusword.0, ENABLED, "{size:?} {channels} {id:02X}: axis 1's");
        }
        for out in puppet.sent_two().iter().flatten() {
            assert_eq!(out.outputs, 0);
            assert!([-3, 99, 0].contains(&out.target), "{out:?}");
        }
    }
}

/// SK-3.27 SV_ON walks both axes up, each at its own pace, SV_OFF walks both down, whatever the size of a slot. The
/// second axis of a one-channel HSP is never driven.
#[test]
fn servo_on_and_off_act_on_both_axes() {
    for (size, channels) in SIZES.into_iter().flat_map(|size| [(size, 1), (size, 2)]) {
        let (mut host, puppet) = board(size, channels, Mode::Csp, Puppet::new());
        let words = |host: &mut Host, first: u16, second: u16| {
            puppet.show(first);
            puppet.strings().shows_second.statusword = Statusword(second);
            host.idle().cycles(3);
            puppet.last_two().map(|out| out.controlword.0)
        };
        let both = |first, second| [first, if channels == 2 { second } else { 0 }];
        host.slave(1, SlaveCommand::ServoOn).cycles(3);
        let what = format!("{size:?} {channels}");
        assert_eq!(words(&mut host, DISABLED, DISABLED), both(0x06, 0x06), "{what}");
        assert_eq!(words(&mut host, READY, DISABLED), both(0x07, 0x06), "{what}");
        assert_eq!(words(&mut host, SWITCHED_ON, READY), both(0x0F, 0x07), "{what}");
        assert_eq!(words(&mut host, ENABLED, SWITCHED_ON), both(0x0F, 0x0F), "{what}");
        assert_eq!(words(&mut host, ENABLED, ENABLED), both(0x0F, 0x0F), "{what}");
        host.slave(1, SlaveCommand::ServoOff).cycles(3);
        assert_eq!(words(&mut host, ENABLED, ENABLED), both(0x07, 0x07), "{what}");
        assert_eq!(words(&mut host, SWITCHED_ON, ENABLED), both(0x06, 0x07), "{what}");
        assert_eq!(words(&mut host, READY, READY), both(0x00, 0x00), "{what}");
    }
}

/// SK-4.20 ALM_CLR on an HSP is a fault reset. SK-3.27 On both axes: on those that have a fault.
#[test]
fn alarm_clear_resets_both_axes() {
    for size in SIZES {
        for faulted in [[true, true], [true, false], [false, true]] {
            let (mut host, puppet) = board(size, 2, Mode::Csp, Puppet::new());
            let [first, second] = faulted.map(|faulted| if faulted { FAULT } else { DISABLED });
            puppet.show(first);
            puppet.strings().shows_second.statusword = Statusword(second);
            host.cycles(3);
            puppet.forget();
            host.slave(1, SlaveCommand::AlarmClear).cycles(30);
            let rose = |sent: &[AxisOut]| sent.iter().any(|out| out.controlword.0 & 0x80 != 0);
            let rises = puppet.sent_two().map(|sent| rose(&sent));
            assert_eq!(rises, faulted, "{size:?}");
        }
    }
    // With the simulated module the fault ends.
    let two = Hsp::new(HspConfig::with(Channels::Two));
    let Bench { mut host, network, .. } = Bench::new(config(SlotSize::Bytes16), vec![Box::new(two)]);
    op(&mut host, Mode::Csp);
    host.slave(1, SlaveCommand::ServoOn).until("on", |host| answer(host).statusword.is_enabled()).cycles(50);
    for axis in [0, 1] {
        network.apply_fault(1, Fault::Alarm { axis, fault: DeviceFault { code: 0x7500, resettable: true } });
    }
    host.until("the fault", |host| answer(host).statusword.state() == Some(DriveState::Fault));
    let second = |host: &mut Host| Statusword(host.read_object(1, 0x6841, 0).unwrap() as u16).state();
    assert_eq!(second(&mut host), Some(DriveState::Fault));
    host.slave(1, SlaveCommand::AlarmClear).cycles(50);
    assert_eq!(answer(&host).statusword.state(), Some(DriveState::SwitchOnDisabled));
    host.read_object(1, 0x1018, 1).unwrap();
    assert_eq!(second(&mut host), Some(DriveState::SwitchOnDisabled));
}

/// SK-7.16 SK-7.17 Until the first motion command the target of each axis is where it is (CSP), or 0 (CSV).
/// SK-7.18 Targets that come before are discarded, and a command counts once, also if it is for two axes. Its outputs
/// are taken.
#[test]
fn targets_before_operation_enabled_are_discarded_and_outputs_are_taken() {
    for mode in [Mode::Csp, Mode::Csv] {
        let (mut host, puppet) = board(SlotSize::Bytes16, 2, mode, Puppet::new());
        let at = |puppet: &Puppet, first, second| {
            puppet.strings().shows.position = first;
            puppet.strings().shows_second.position = second;
        };
        let held = |first, second| if mode == Mode::Csp { [first, second] } else { [0, 0] };
        at(&puppet, 300, -400);
        host.slave(1, command(mode, motion((7000, 0x0102), (8000, 0x0304)))).drained().cycles(3);
        assert_eq!(discarded(&host), 1, "{mode}");
        assert_eq!(puppet.last_two().map(|out| out.target), held(300, -400), "{mode}");
        assert_eq!(puppet.last_two().map(|out| out.outputs), [0x0102, 0x0304], "{mode}");
        // Axis 1 is on, axis 2 is not yet: its target alone is discarded, and counts.
        host.slave(1, SlaveCommand::ServoOn).cycles(3);
        for shown in [READY, SWITCHED_ON, ENABLED] {
            puppet.show(shown);
            host.cycles(3);
        }
        host.slave(1, command(mode, motion((350, 5), (8000, 6)))).drained().cycles(3);
        assert_eq!(discarded(&host), 2, "{mode}");
        assert_eq!(puppet.last_two().map(|out| out.target), [350, held(0, -400)[1]], "{mode}");
        assert_eq!(puppet.last_two().map(|out| out.outputs), [5, 6], "{mode}");
        for shown in [READY, SWITCHED_ON, ENABLED] {
            puppet.strings().shows_second.statusword = Statusword(shown);
            host.cycles(3);
        }
        host.slave(1, command(mode, motion((360, 0), (-410, 0)))).drained().cycles(3);
        assert_eq!((discarded(&host), host.counters().rejected_total()), (2, 0), "{mode}");
        assert_eq!(puppet.last_two().map(|out| out.target), [360, -410], "{mode}");
    }
}

/// SK-5.4 SK-5.5 Under GET_STATUS and while the FIFO is empty targets and outputs of both axes hold.
#[test]
fn targets_and_outputs_hold() {
    for mode in [Mode::Csp, Mode::Csv] {
        let (mut host, puppet) = board_on(SlotSize::Bytes16, 2, mode);
        host.slave(1, command(mode, motion((70, 0xAAAA), (-80, 0x5555)))).drained();
        puppet.forget();
        for _ in 0..100 {
            host.idle().cycle();
            assert_eq!(answer(&host).head.id, 0);
        }
        host.cycles(100);
        let [sent, second] = puppet.sent_two();
        assert_eq!((sent.len(), second.len()), (200, 200));
        assert!(sent.iter().all(|out| (out.target, out.outputs) == (70, 0xAAAA)), "{mode}");
        assert!(second.iter().all(|out| (out.target, out.outputs) == (-80, 0x5555)), "{mode}");
        // Leaving OP ends both.
        host.go(MasterState::SafeOp).go(MasterState::Op).cycles(3);
        assert_eq!(puppet.last_two().map(|out| (out.controlword.0, out.outputs)), [(0, 0); 2]);
    }
}

/// SK-7.31 SK-7.33 CSP and CSV need DRIVE_MODE's mode. SK-7.32 They go by 0x6060 as it was written last; where 0x6860 is
/// something else (SK-3.29: axis 2 has its own, 0x800 higher) axis 2's target is discarded while axis 1 moves. A rejected command sets no outputs.
#[test]
fn a_motion_command_needs_its_mode() {
    let (mut host, puppet) = board_on(SlotSize::Bytes16, 2, Mode::Csp);
    let rejected = |host: &Host| host.counters().rejected[Reason::WrongMode.kind()];
    let csp = |n| command(Mode::Csp, motion((n, n as u16), (-n, n as u16)));
    host.slave(1, csp(10)).slave(1, command(Mode::Csv, motion((77, 77), (77, 77)))).drained().cycles(3);
    assert_eq!((rejected(&host), puppet.last_two().map(|out| out.target)), (1, [10, -10]));
    assert_eq!(puppet.last_two().map(|out| out.outputs), [10, 10]);

    host.write_object(1, 0x6860, 0, SdoSize::One, 6).unwrap();
    host.slave(1, csp(20)).drained().cycles(3);
    assert_eq!((rejected(&host), discarded(&host)), (1, 1));
    assert_eq!(puppet.last_two().map(|out| out.target), [20, -10], "axis 2 is held where it is");

    host.write_object(1, 0x6060, 0, SdoSize::One, 6).unwrap();
    host.slave(1, csp(30)).drained().cycles(3);
    assert_eq!((rejected(&host), discarded(&host)), (2, 1));
    assert_eq!(puppet.last_two().map(|out| (out.target, out.outputs)), [(20, 20), (-10, 20)]);

    host.write_object(1, 0x6060, 0, SdoSize::One, 8).unwrap();
    host.write_object(1, 0x6860, 0, SdoSize::One, 8).unwrap();
    host.slave(1, csp(40)).drained().cycles(3);
    assert_eq!((rejected(&host), discarded(&host)), (2, 1));
    assert_eq!(puppet.last_two().map(|out| out.target), [40, -40]);
}

/// SK-3.5 In profile 1.5 byte 1 is the mode of operation of an HSP, too.
#[test]
fn profile_1_5_shows_the_mode() {
    let puppet = Puppet::obedient().with_channels(2);
    let v15 = EngineConfig { firmware: Firmware::V15, ..config(SlotSize::Bytes16) };
    let mut host = Host::new(v15, SimBus::new(vec![puppet.boxed()]));
    op(&mut host, Mode::Csv);
    host.raw(1, RawSlot { id: 0x12, index: 0x77, ..RawSlot::ZERO }).cycle();
    assert_eq!((answer(&host).head.id, answer(&host).head.index), (0x12, 9));
}

/// SK-7.35 DRIVE_MODE 10 for an HSP fails PreOP to SafeOP, whatever the slave would take; 8 and 9 do not.
#[test]
fn there_is_no_cst() {
    for slave in [Puppet::new().with_channels(2).boxed(), Box::<Hsp>::default()] {
        let Bench { mut host, .. } = Bench::new(EngineConfig::default(), vec![slave]);
        let mut kinds = [SlaveKind::None; 8];
        kinds[0] = SlaveKind::Hsp;
        host.master(MasterCommand::SetAxis { group: 0, kinds });
        let mode = |mode| SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync };
        for target in [MasterState::SafeOp, MasterState::Op] {
            host.slave(1, mode(Mode::Cst)).master(MasterCommand::SetState(target));
            host.until("the failure", |host| host.state().0 == 0x12).cycles(500);
            assert_eq!(host.state().0, 0x12, "without retries");
        }
        for good in [Mode::Csv, Mode::Csp] {
            host.slave(1, mode(good)).go(MasterState::Op).go(MasterState::PreOp);
        }
        // Without a slave the mode of the declaration is not checked.
        host.slave(2, mode(Mode::Cst));
        host.master(MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Hsp; 8] }).go(MasterState::Op);
    }
}

/// SK-3.26 In 12-byte mode a two-channel HSP moves axis 1 only. SK-3.23 In 16-byte mode both follow, to the pulse.
/// SK-3.22 SK-3.24 Outputs come back as inputs, separately for each channel.
#[test]
fn pulses_go_where_commands_say() {
    for (size, channels) in SIZES.into_iter().flat_map(|size| [(size, Channels::One), (size, Channels::Two)]) {
        let slave = Hsp::new(HspConfig { positions: [100, 5000], ..HspConfig::with(channels) });
        let Bench { mut host, network, .. } = Bench::new(config(size), vec![Box::new(slave)]);
        op(&mut host, Mode::Csp);
        host.slave(1, SlaveCommand::ServoOn).until("on", |host| answer(host).statusword.is_enabled()).cycles(50);
        let two = size == SlotSize::Bytes16 && channels == Channels::Two;
        let what = format!("{size:?} {channels:?}");
        for n in 1..=500 {
            host.slave(1, command(Mode::Csp, motion((100 + 30 * n, n as u16), (5000 - 20 * n, !n as u16))));
            host.cycle();
        }
        host.drained().cycles(3);
        let second = match channels {
            Channels::One => None,
            Channels::Two if two => Some(-5000),
            Channels::Two => Some(5000),
        };
        assert_eq!((network.shaft(1, 0), network.shaft(1, 1)), (Some(15_100), second), "{what}");
        let seen = answer(&host);
        assert_eq!((seen.first.position, seen.first.inputs), (15_100, 500), "{what}");
        let expected = if two { (-5000, !500) } else { (0, 0) };
        assert_eq!((seen.second.position, seen.second.inputs), expected, "{what}");
        assert_eq!((host.counters().rejected_total(), discarded(&host)), (0, 0), "{what}");
        if channels == Channels::Two {
            let on = Statusword(host.read_object(1, 0x6841, 0).unwrap() as u16);
            assert!(on.is_enabled(), "{what}: axis 2 is on and holds");
        }
    }
}

/// SK-5.5 A velocity keeps running on both axes: as many pulses in a second, exactly.
#[test]
fn velocities_keep_running() {
    let slave = Hsp::new(HspConfig::with(Channels::Two));
    let Bench { mut host, network, .. } = Bench::new(config(SlotSize::Bytes16), vec![Box::new(slave)]);
    op(&mut host, Mode::Csv);
    host.slave(1, SlaveCommand::ServoOn).until("on", |host| answer(host).statusword.is_enabled()).cycles(50);
    host.slave(1, command(Mode::Csv, motion((25_000, 0), (-4000, 0)))).drained().cycles(10);
    let before = [0, 1].map(|axis| network.shaft(1, axis).unwrap());
    host.cycles(1000);
    let way = [0, 1].map(|axis| network.shaft(1, axis).unwrap() - before[axis]);
    assert_eq!(way, [25_000, -4000]);
}
