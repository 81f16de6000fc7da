//! The simulated pulse module as a slave: roles, objects, pulses that follow their targets, digital lines.
use ecmsk::cia402::{Controlword, DriveState, Mode, Statusword};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::fieldbus::pdo::ProcessData;
use ecmsk::fieldbus::{AlState, AxisIn, AxisOut, Ns, Refusal, Role};
use ecmsk::slave::plant::PulseTrain;
use ecmsk::slave::{AlStatus, Channels, DeviceFault, Fault, Hsp, HspConfig, Slave};

use AlState::*;

use crate::wired::{config, configure, exchange};
use support::dice::Dice;

pub const MS: Ns = 1_000_000;
const BOTH: [Channels; 2] = [Channels::One, Channels::Two];

fn hsp_in(state: AlState, config_: HspConfig, mode: Mode) -> Hsp {
    let mut hsp = Hsp::new(config_);
    for next in [PreOp, SafeOp, Op].into_iter().take_while(|next| *next <= state) {
        hsp.enter(next).expect("the state is open to it");
        if next == PreOp {
            configure(&mut hsp, &config(Role::Hsp(mode))).expect("it has this mode");
        }
    }
    hsp
}

fn read(hsp: &mut Hsp, index: u16, sub: u8) -> Result<(u8, u32), AbortCode> {
    hsp.upload(ObjectAddress::new(index, sub)).map(|value| (value.size, value.bits))
}

fn write(hsp: &mut Hsp, index: u16, sub: u8, size: SdoSize, value: u32) -> Result<(), AbortCode> {
    hsp.download(ObjectAddress::new(index, sub), size, value)
}

/// A master that exchanges process data with a module once a cycle.
pub struct Master {
    pub hsp: Hsp,
    data: ProcessData,
    cycle_ns: Ns,
    pub out: [AxisOut; 2],
    pub seen: [AxisIn; 2],
}

impl Master {
    /// The module in OP, its self test over.
    fn op(config: HspConfig, mode: Mode, cycle_ns: Ns) -> Self {
        let data = ProcessData::of(Role::Hsp(mode), config.channels == Channels::Two).expect("it has the mode");
        let hsp = hsp_in(Op, config, mode);
        let mut master = Self { hsp, data, cycle_ns, out: Default::default(), seen: Default::default() };
        master.cycles((200 * MS).div_ceil(cycle_ns));
        master
    }

    /// The same with both axes (or the only one) in Operation enabled, at their positions.
    pub fn enabled(config: HspConfig, mode: Mode, cycle_ns: Ns) -> Self {
        let mut master = Self::op(config, mode, cycle_ns);
        for axis in 0..2 {
            if mode == Mode::Csp {
                master.out[axis].target = master.seen[axis].position;
            }
            master.walk_up(axis);
        }
        master
    }

    fn walk_up(&mut self, axis: usize) {
        for word in [Controlword::SHUTDOWN, Controlword::SWITCH_ON, Controlword::ENABLE_OPERATION] {
            self.out[axis].controlword = word;
            self.cycles((20 * MS).div_ceil(self.cycle_ns).max(4));
        }
    }

    pub fn cycle(&mut self) {
        exchange(&mut self.hsp, &self.data, Some(&self.out), &mut self.seen);
        self.hsp.step(self.cycle_ns);
    }

    pub fn cycles(&mut self, n: u64) {
        (0..n).for_each(|_| self.cycle());
    }

    fn state(&self, axis: usize) -> Option<DriveState> {
        self.seen[axis].statusword.state()
    }
}

fn two() -> HspConfig {
    HspConfig { positions: [1000, -1000], ..HspConfig::with(Channels::Two) }
}

/// [OURS] No power stage charges and no brake opens: each step of the walk up takes 2 ms.
#[test]
fn it_is_switched_on_in_no_time() {
    let mut master = Master::op(HspConfig::with(Channels::One), Mode::Csp, MS);
    for (word, state) in [
        (Controlword::SHUTDOWN, DriveState::ReadyToSwitchOn),
        (Controlword::SWITCH_ON, DriveState::SwitchedOn),
        (Controlword::ENABLE_OPERATION, DriveState::OperationEnabled),
    ] {
        master.out[0].controlword = word;
        // Its inputs come with the next exchange.
        master.cycles(3);
        assert_eq!(master.state(0), Some(state));
    }
}

/// SK-4.58 The module refuses a configuration for another kind of slave, and is configured in PreOP alone. SK-7.35 It
/// has no CST.
#[test]
fn roles() {
    for channels in BOTH {
        let module = HspConfig::with(channels);
        let refused = |al_status, abort| Err(Refusal { slave: 0, al_status, abort });
        let mut hsp = hsp_in(PreOp, module.clone(), Mode::Csp);
        for mode in [Mode::Csp, Mode::Csv, Mode::Cst] {
            for role in [Role::Drive(mode), Role::Step(Mode::Csp), Role::Io] {
                assert_eq!(configure(&mut hsp, &config(role)), refused(0x001D, None), "{role:?}");
            }
        }
        for mode in [Mode::Cst, Mode::Homing] {
            let no_mode = Some((ObjectAddress::new(0x6060, 0), AbortCode::VALUE_RANGE));
            assert_eq!(configure(&mut hsp, &config(Role::Hsp(mode))), refused(0, no_mode), "{mode}");
        }
        for mode in [Mode::Csv, Mode::Csp] {
            assert_eq!(configure(&mut hsp, &config(Role::Hsp(mode))), Ok(()));
            assert_eq!(read(&mut hsp, 0x6061, 0), Ok((1, mode.code().into())));
        }
        for state in [Init, SafeOp, Op] {
            let mut hsp = hsp_in(state, module.clone(), Mode::Csp);
            assert_eq!(configure(&mut hsp, &config(Role::Hsp(Mode::Csp))), refused(0x0011, None), "{state:?}");
        }
        let mut hsp = Hsp::new(module.clone());
        hsp.enter(PreOp).unwrap();
        assert_eq!(hsp.enter(SafeOp), Err(AlStatus(0x001D)), "nothing is mapped");
        configure(&mut hsp, &config(Role::Hsp(Mode::Csp))).unwrap();
        configure(&mut hsp, &config(Role::Unused)).unwrap();
        assert_eq!(hsp.enter(SafeOp), Err(AlStatus(0x001D)), "not used");
    }
}

/// SK-7.5 In CSP the RxPDOs are 6040 607A 60FE and 6840 687A 68FE, the TxPDOs 6041 6064 60FD and 6841 6864 68FD. SK-7.6
/// In CSV the targets are 60FF and 68FF. A module of one channel has the first half.
#[test]
fn process_data_are_what_the_mode_fixes() {
    for channels in BOTH {
        for (mode, target) in [(Mode::Csp, 0x607A), (Mode::Csv, 0x60FF)] {
            let mut hsp = hsp_in(PreOp, HspConfig::with(channels), mode);
            for (assign, objects) in [(0x1C12, [0x6040, target, 0x60FE]), (0x1C13, [0x6041, 0x6064, 0x60FD])] {
                let count = read(&mut hsp, assign, 0).unwrap().1;
                assert_eq!(count, channels as u32, "{channels:?}");
                for axis in 0..count as u16 {
                    let pdo = read(&mut hsp, assign, axis as u8 + 1).unwrap().1 as u16;
                    assert_eq!(read(&mut hsp, pdo, 0), Ok((1, 3)), "{channels:?} {mode} axis {axis}");
                    for (n, object) in objects.into_iter().enumerate() {
                        let (_, entry) = read(&mut hsp, pdo, n as u8 + 1).unwrap();
                        let (index, sub, bits) = ((entry >> 16) as u16, (entry >> 8) as u8, entry & 0xFF);
                        assert_eq!(index, object + 0x800 * axis, "{channels:?} {mode} axis {axis}");
                        let (size, _) = read(&mut hsp, index, sub).unwrap();
                        assert_eq!(u32::from(size) * 8, bits, "the entry has the object's size");
                    }
                }
            }
        }
        let mut unmapped = Hsp::new(HspConfig::with(channels));
        unmapped.enter(PreOp).unwrap();
        assert_eq!([0x1C12, 0x1C13].map(|assign| read(&mut unmapped, assign, 0)), [Ok((1, channels as u32)); 2]);
    }
}

/// The default speeds and ramp of homing depend on the counts of a turn: 2 turns/s, a fifth of a turn/s, 100 turns/s².
#[test]
fn homing_goes_by_the_turn() {
    let config = HspConfig { pulses_per_turn: 4000, ..two() };
    let mut hsp = hsp_in(PreOp, config, Mode::Csp);
    for axis in [0, 0x800] {
        for (index, sub, expected) in [(0x6099, 1, 8_000), (0x6099, 2, 800), (0x609A, 0, 400_000)] {
            assert_eq!(read(&mut hsp, index + axis, sub), Ok((4, expected)), "{index:04X}:{sub} + {axis:X}");
        }
    }
}

/// Pulses that follow positions have the positions' rate: when switched off they brake from it on a ramp. From 200,000
/// pulses/s with 4,000,000 pulses/s² that takes 5000 pulses.
#[test]
fn pulses_that_follow_positions_brake_from_their_rate() {
    let mut master = Master::enabled(HspConfig::with(Channels::One), Mode::Csp, MS);
    write(&mut master.hsp, 0x6084, 0, SdoSize::Four, 4_000_000).unwrap();
    for _ in 0..100 {
        master.out[0].target += 200;
        master.cycle();
    }
    let from = master.out[0].target;
    master.out[0].controlword = Controlword::SWITCH_ON;
    master.cycles(200);
    let way = master.seen[0].position - from;
    assert!((4_600..=5_400).contains(&way), "{way}");
    assert_eq!(master.state(0), Some(DriveState::SwitchedOn));
}

/// SK-3.29 Axis 2 has the objects of axis 1, 0x800 higher, with separate values. A module of one channel has none of
/// them.
#[test]
fn axis_2_has_the_objects_of_axis_1_plus_0x800() {
    let mut two = hsp_in(PreOp, two(), Mode::Csp);
    let mut one = hsp_in(PreOp, HspConfig::default(), Mode::Csp);
    let mut found = 0;
    for index in 0x6000..0x6800u16 {
        for sub in 0..4 {
            let first = read(&mut two, index, sub);
            let second = read(&mut two, index + 0x800, sub);
            assert_eq!(first.map(|(size, _)| size), second.map(|(size, _)| size), "{index:04X}:{sub}");
            assert_eq!(read(&mut one, index, sub).map(|(size, _)| size), first.map(|(size, _)| size));
            assert_eq!(read(&mut one, index + 0x800, sub), Err(AbortCode::NO_OBJECT));
            found += u32::from(first.is_ok());
        }
    }
    for index in [0x6040, 0x6041, 0x6060, 0x6061, 0x6064, 0x607A, 0x6098, 0x60FD, 0x60FF, 0x603F] {
        assert!(read(&mut two, index, 0).is_ok(), "{index:04X}");
    }
    assert!(found > 20, "{found} objects");
    assert_eq!((read(&mut two, 0x6064, 0), read(&mut two, 0x6864, 0)), (Ok((4, 1000)), Ok((4, -1000i32 as u32))));
    write(&mut two, 0x6860, 0, SdoSize::One, 9).unwrap();
    assert_eq!((read(&mut two, 0x6061, 0), read(&mut two, 0x6861, 0)), (Ok((1, 8)), Ok((1, 9))));
    write(&mut two, 0x607F, 0, SdoSize::Four, 77).unwrap();
    assert_eq!((read(&mut two, 0x607F, 0), read(&mut two, 0x687F, 0)), (Ok((4, 77)), Ok((4, 4_000_000))));
    assert_eq!(write(&mut two, 0x6860, 0, SdoSize::One, 10), Err(AbortCode::VALUE_RANGE), "it has no CST");
}

/// SK-6.12 The objects that programs look for in any slave are there, and distinguish modules.
#[test]
fn identity() {
    for (channels, name, product) in [(Channels::One, b"HSP1", 0x4853_5031), (Channels::Two, b"HSP2", 0x4853_5032)] {
        let mut hsp = Hsp::new(HspConfig { serial: 7, ..HspConfig::with(channels) });
        assert_eq!(read(&mut hsp, 0x1000, 0), Err(AbortCode::TIMEOUT), "no mailbox in Init");
        hsp.enter(PreOp).unwrap();
        assert_eq!(read(&mut hsp, 0x1000, 0), Ok((4, 0x0004_0192)), "device profile 402, stepper");
        assert_eq!(read(&mut hsp, 0x1008, 0), Ok((4, u32::from_le_bytes(*name))));
        assert_eq!((read(&mut hsp, 0x1018, 2), read(&mut hsp, 0x1018, 4)), (Ok((4, product)), Ok((4, 7))));
        assert_eq!(read(&mut hsp, 0x1001, 0), Ok((1, 0)));
        assert_eq!(write(&mut hsp, 0x6041, 0, SdoSize::Two, 0), Err(AbortCode::READ_ONLY));
    }
}

/// The position is the target of the cycle before, to the pulse, on both axes and over the wrap of 32 bits.
#[test]
fn pulses_follow_their_targets_exactly() {
    for cycle_ns in [250_000, MS, 8 * MS] {
        let start = [i64::from(i32::MAX) - 3000, 5];
        let mut master = Master::enabled(HspConfig { positions: start, ..two() }, Mode::Csp, cycle_ns);
        let mut targets = master.out.map(|out| out.target);
        assert_eq!(targets, start.map(|position| position as i32));
        let mut dice = Dice(12345);
        for _ in 0..500 {
            let before = targets;
            for (out, target) in master.out.iter_mut().zip(&mut targets) {
                *target = target.wrapping_add(dice.below(512) as i32 - 100);
                out.target = *target;
            }
            master.cycle();
            assert_eq!(master.seen.map(|axis| axis.position), before, "{cycle_ns}");
            for axis in master.seen {
                // It follows the target, and no limit holds it back.
                assert_eq!(axis.statusword.0 & 0x1800, 0x1000, "{cycle_ns}");
                assert_eq!((axis.torque, axis.error_code), (0, 0));
            }
        }
        master.cycle();
        assert_eq!(master.seen.map(|axis| axis.position), targets);
        let wrapped = master.hsp.shaft(0).unwrap();
        assert!(wrapped > i64::from(i32::MAX), "{wrapped}: the axis has gone over the end");
    }
}

/// A target farther than the greatest rate reaches is caught up with at that rate, and reached to the pulse; meanwhile
/// bit 11 is set. 0x607F lowers the rate.
#[test]
fn pulses_are_no_faster_than_the_greatest_rate() {
    for (limit, per_ms) in [(None, 1000), (Some(250_000), 250), (Some(9_000_000), 1000)] {
        let train = PulseTrain { max_rate: 1_000_000 };
        let mut master = Master::enabled(HspConfig { train, ..two() }, Mode::Csp, MS);
        if let Some(limit) = limit {
            write(&mut master.hsp, 0x607F, 0, SdoSize::Four, limit).unwrap();
            write(&mut master.hsp, 0x687F, 0, SdoSize::Four, limit).unwrap();
        }
        let mut at = [1000, -1000];
        master.out[0].target = 1000 + 20 * per_ms;
        master.out[1].target = -1000 - 20 * per_ms;
        master.cycle();
        for n in 1..=20 {
            master.cycle();
            at = [at[0] + per_ms, at[1] - per_ms];
            assert_eq!(master.seen.map(|axis| axis.position), at, "{limit:?} cycle {n}");
            let limited = master.seen.map(|axis| axis.statusword.0 & Statusword::INTERNAL_LIMIT != 0);
            assert_eq!(limited, [n < 20; 2], "{limit:?} cycle {n}");
            assert_eq!(master.seen.map(|axis| axis.statusword.0 & Statusword::TARGET_REACHED != 0), [n == 20; 2]);
        }
        master.cycles(10);
        assert_eq!(master.seen.map(|axis| axis.position), at, "{limit:?}: it stays there");
        assert_eq!(master.state(0), Some(DriveState::OperationEnabled), "no following error");
    }
}

/// In CSV a velocity is exactly the pulses in a second, until another comes; a change is linear over a cycle.
#[test]
fn velocities_are_pulses_in_a_second() {
    let mut master = Master::enabled(two(), Mode::Csv, MS);
    master.out[0].target = 20_000;
    master.out[1].target = -123_456;
    master.cycles(2);
    let before = master.seen.map(|axis| axis.position);
    // The cycle of the change covers half of it.
    assert_eq!(before, [1000 + 10, -1000 - 62]);
    master.cycles(1000);
    let way = [0, 1].map(|n| master.seen[n].position - before[n]);
    assert_eq!(way[0], 20_000);
    assert!((way[1] + 123_456).abs() <= 1, "{way:?}");
    let rate = master.hsp.upload(ObjectAddress::new(0x686C, 0)).unwrap().bits as i32;
    assert_eq!(rate, -123_456);
    master.out = master.out.map(|out| AxisOut { target: 0, ..out });
    master.cycles(2);
    let stopped = master.seen.map(|axis| axis.position);
    master.cycles(100);
    assert_eq!(master.seen.map(|axis| axis.position), stopped);
}

/// A velocity above the greatest rate is cut to it, which bit 11 shows; a lower velocity is not, and neither is the
/// change to it.
#[test]
fn velocities_are_no_higher_than_the_greatest_rate() {
    let train = PulseTrain { max_rate: 100_000 };
    let mut master = Master::enabled(HspConfig { train, ..two() }, Mode::Csv, MS);
    for (target, rate) in [(60_000, 60_000), (100_000, 100_000), (-300_000, -100_000), (100_001, 100_000), (5, 5)] {
        master.out[0].target = target;
        master.cycle();
        for n in 0..20 {
            master.cycle();
            let limited = master.seen[0].statusword.0 & Statusword::INTERNAL_LIMIT != 0;
            // The cycle after a cut velocity begins above the limit.
            if n > 0 || [60_000, 100_000].contains(&target) {
                assert_eq!(limited, rate != target, "{target} cycle {n}");
            }
        }
        let before = master.seen[0].position;
        master.cycles(1000);
        assert!((master.seen[0].position - before - rate).abs() <= 1, "{target}");
    }
}

/// No torque limits the stop of pulses: a quick stop at the limit of torque (0x605A = 3) ends them at once.
#[test]
fn a_quick_stop_without_a_ramp_ends_pulses_at_once() {
    let mut master = Master::enabled(two(), Mode::Csv, MS);
    write(&mut master.hsp, 0x605A, 0, SdoSize::Two, 3).unwrap();
    master.out[0].target = 400_000;
    master.cycles(20);
    let before = master.seen[0].position;
    master.out[0].controlword = Controlword(0x02);
    master.cycles(3);
    let way = master.seen[0].position - before;
    // The cycles that were under way, and at most half of the last one.
    assert!((400..=800).contains(&way), "{way}");
    let at = master.seen[0].position;
    master.cycles(100);
    assert_eq!((master.seen[0].position, master.state(0)), (at, Some(DriveState::SwitchOnDisabled)));
}

/// Axes are independent: one walks up, moves and faults while the other one stays.
#[test]
fn axes_are_independent() {
    for (axis, other) in [(0, 1), (1, 0)] {
        let mut master = Master::op(two(), Mode::Csp, MS);
        master.out[axis].target = master.seen[axis].position;
        master.walk_up(axis);
        assert_eq!(master.state(axis), Some(DriveState::OperationEnabled));
        assert_eq!(master.state(other), Some(DriveState::SwitchOnDisabled));
        let stands = master.seen[other].position;
        master.out = master.out.map(|out| AxisOut { target: 2222, ..out });
        master.cycles(5);
        assert_eq!((master.seen[axis].position, master.seen[other].position), (2222, stands));
        assert!(master.hsp.apply_fault(Fault::Alarm { axis, fault: DeviceFault { code: 0x7500, resettable: true } }));
        master.cycles(5);
        assert_eq!(master.state(axis), Some(DriveState::Fault));
        assert_eq!(master.state(other), Some(DriveState::SwitchOnDisabled));
        assert_eq!(master.seen.map(|seen| seen.error_code), [0; 2], "it is not mapped");
        assert_eq!(read(&mut master.hsp, 0x603F + 0x800 * axis as u16, 0), Ok((2, 0x7500)));
        assert_eq!(read(&mut master.hsp, 0x1001, 0), Ok((1, 0x21)), "the error register is of both");
    }
    let mut one = Hsp::default();
    let fault = DeviceFault { code: 0x7500, resettable: true };
    assert_eq!(
        (one.apply_fault(Fault::Alarm { axis: 0, fault }), one.apply_fault(Fault::Alarm { axis: 1, fault })),
        (true, false)
    );
    assert_eq!((one.shaft(0), one.shaft(1)), (Some(0), None));
}

/// Without a power stage that coasts, pulses end at once by Disable voltage; by Disable operation they end on the ramp.
#[test]
fn pulses_end_when_the_axis_is_switched_off() {
    let moving = || {
        let mut master = Master::enabled(two(), Mode::Csv, MS);
        master.out[0].target = 400_000;
        master.cycles(20);
        master
    };
    let mut coasts = moving();
    coasts.out[0].controlword = Controlword::DISABLE_VOLTAGE;
    coasts.cycles(2);
    let at = coasts.seen[0].position;
    coasts.cycles(20);
    assert_eq!((coasts.seen[0].position, coasts.state(0)), (at, Some(DriveState::SwitchOnDisabled)));

    let mut brakes = moving();
    write(&mut brakes.hsp, 0x6084, 0, SdoSize::Four, 4_000_000).unwrap();
    brakes.out[0].controlword = Controlword::SWITCH_ON;
    brakes.cycle();
    let at = brakes.seen[0].position;
    brakes.cycles(200);
    // 400000 / s down by 4000000 / s²: 100 ms, 20000 pulses.
    let way = brakes.seen[0].position - at;
    assert!((19_000..=21_000).contains(&way), "{way}");
    assert_eq!(brakes.state(0), Some(DriveState::SwitchedOn));
}

/// Output k of a channel comes back as its input k a cycle later, by process data and by SDO.
#[test]
fn lines_of_each_channel() {
    for channels in BOTH {
        let mut master = Master::op(HspConfig::with(channels), Mode::Csp, MS);
        let mut last = [0; 2];
        for bits in (0..16).map(|k| 1u16 << k).chain([0xFFFF, 0x0000, 0xA5C3]) {
            let given = [bits, !bits];
            for (out, outputs) in master.out.iter_mut().zip(given) {
                out.outputs = outputs;
            }
            master.cycle();
            for n in 0..channels as usize {
                assert_eq!((master.seen[n].inputs, master.hsp.outputs(n)), (last[n], given[n]), "{channels:?} {n}");
                let at = 0x800 * n as u16;
                let expected = Ok((4, given[n].into()));
                assert_eq!(read(&mut master.hsp, 0x60FD + at, 0), expected, "{channels:?} {n}");
                assert_eq!(read(&mut master.hsp, 0x60FE + at, 1), expected, "{channels:?} {n}");
            }
            if channels == Channels::One {
                assert_eq!(master.seen[1], AxisIn::default(), "there is no second channel");
            }
            last = given;
        }
    }
}

/// Outside OP the outputs are off and the axes leave Operation enabled: when OP is left, and when outputs are missing
/// for 100 ms, which ends OP.
#[test]
fn outside_op_outputs_are_off_and_pulses_end() {
    let running = || {
        let mut master = Master::enabled(two(), Mode::Csv, MS);
        master.out = master.out.map(|out| AxisOut { outputs: 0xFFFF, target: 50_000, ..out });
        master.cycles(10);
        master
    };
    for state in [SafeOp, PreOp, Init] {
        let mut master = running();
        master.hsp.enter(state).unwrap();
        assert_eq!([0, 1].map(|n| master.hsp.outputs(n)), [0; 2], "{state:?}");
        (0..200).for_each(|_| master.hsp.step(MS));
        let at = [0, 1].map(|n| master.hsp.shaft(n));
        (0..200).for_each(|_| master.hsp.step(MS));
        assert_eq!([0, 1].map(|n| master.hsp.shaft(n)), at, "{state:?}: it stands");
    }
    let mut master = running();
    let held = (0..1000).take_while(|_| {
        master.hsp.step(MS);
        master.hsp.outputs(1) == 0xFFFF
    });
    assert!((98..=101).contains(&held.count()), "the watchdog");
    assert_eq!(master.hsp.state(), SafeOp);
    (0..200).for_each(|_| master.hsp.step(MS));
    let mut seen = Default::default();
    exchange(&mut master.hsp, &master.data, None, &mut seen);
    assert!(seen.iter().all(|axis| axis.statusword.state() == Some(DriveState::SwitchOnDisabled)));
    // SafeOP takes no outputs.
    exchange(&mut master.hsp, &master.data, Some(&master.out), &mut seen);
    assert_eq!(master.hsp.outputs(0), 0);
}
