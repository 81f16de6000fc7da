//! Homing of pulse modules: which axes GO_HOME starts, which modes are written back and when, and the other axis
//! meanwhile. First with puppet axes, then with the simulated module.

use ecmsk::cia402::Mode;
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope, SdoSize};
use ecmsk::engine::{EngineConfig, Firmware, HomingEnd, HomingPhase, Reason};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{AlState, Fieldbus, Ns};
use ecmsk::sk::{
    AxisTarget, DriveSync, HspResponse, MasterCommand, MasterState, Motion, SlaveCommand, SlaveKind, SlotSize,
};
use ecmsk::slave::{AlStatus, Channels, HomeSwitch, Hsp, HspConfig, Slave, Travel};

use crate::homer::{BIT_4, BIT_13, Homer, Script};
use crate::host::Host;
use crate::rig::ahead;
use support::ahead_bus::AheadBus;
use support::images::{Images, number};

const SECOND: u16 = 0x800;

/// A module of two channels whose axes are puppets.
#[derive(Clone)]
struct Pair([Homer; 2], Images);

impl Pair {
    fn split(object: ObjectAddress) -> (usize, ObjectAddress) {
        match object.index {
            0x6800..=0x6FFF => (1, ObjectAddress::new(object.index - SECOND, object.sub)),
            _ => (0, object),
        }
    }
}

impl Slave for Pair {
    fn name(&self) -> &str {
        "pair"
    }

    fn state(&self) -> AlState {
        Slave::state(&self.0[0])
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        self.0.iter_mut().try_for_each(|axis| axis.enter(target))
    }

    fn read(&mut self, object: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
        if let Some(len) = self.1.read(object, value) {
            return Ok(len);
        }
        let (axis, object) = Self::split(object);
        // A master knows by the controlword that the axis exists.
        if object.index == 0x6040 { Ok(2) } else { self.0[axis].read(object, scope, value) }
    }

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        let configures = self.1.take(object, number(value));
        let (axis, object) = Self::split(object);
        match object.index {
            0x6060 if configures => self.0[axis].state().mode = value[0],
            _ if configures => {}
            _ => return self.0[axis].write(object, scope, value),
        }
        Ok(())
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        let shown = self.0.each_ref().map(|axis| axis.state().shows);
        self.1.put_inputs(&shown, inputs);
        let Some(outputs) = outputs.map(|outputs| self.1.outputs(outputs)) else { return };
        for (axis, out) in self.0.iter().zip(&outputs) {
            axis.state().obey(out);
        }
    }

    fn step(&mut self, _dt_ns: Ns) {}
}

/// A board with one module, in OP and on.
fn on(bus: impl Fieldbus + 'static, slot: SlotSize, firmware: Firmware, mode: Mode) -> Host {
    let mut host = Host::new(EngineConfig { slot, firmware, ..EngineConfig::default() }, bus);
    let mut kinds = [SlaveKind::None; 8];
    kinds[0] = SlaveKind::Hsp;
    host.master(MasterCommand::SetAxis { group: 0, kinds });
    host.slave(1, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync });
    host.go(MasterState::Op).drained();
    host.servo_on(1).cycles(50);
    host
}

fn pair_on(slot: SlotSize, firmware: Firmware) -> (Host, [Homer; 2]) {
    let axes = [Homer::new(), Homer::new()];
    let host = on(SimBus::new(vec![Box::new(Pair(axes.clone(), Images::default()))]), slot, firmware, Mode::Csp);
    (host, axes)
}

/// The host writes 0x6060 or 0x6860.
fn write_mode(host: &mut Host, axis: usize, mode: u32) {
    // Another answer first, so that an old one does not match.
    host.read_object(1, 0x6098, 0).unwrap();
    assert_eq!(host.write_object(1, 0x6060 + SECOND * axis as u16, 0, SdoSize::One, mode), Ok(mode));
}

fn phase(host: &Host) -> HomingPhase {
    host.board.engine().homing_phase(1)
}

fn until_idle(host: &mut Host) {
    host.until("the end of homing", |host| phase(host) == HomingPhase::Idle);
}

fn rejected(host: &Host, reason: Reason) -> u64 {
    host.counters().rejected[reason.kind()]
}

fn starts(axis: &Homer) -> bool {
    axis.words().iter().any(|word| word & BIT_4 != 0)
}

fn forget(axes: &[Homer; 2]) {
    axes.iter().for_each(|axis| {
        axis.words();
        axis.modes();
    });
}

/// Every non-empty choice of axes.
const CHOICES: [&[usize]; 3] = [&[0], &[1], &[0, 1]];

/// SK-3.28 GO_HOME acts on those axes whose 0x6060 / 0x6860 is 6. SK-3.26 In 12-byte mode it does not move axis 2.
/// SK-7.22 The mode of axes that went home is written back, and no other one; in profile 1.5 (SK-7.23) none. The other
/// axis holds its target.
#[test]
fn go_home_acts_on_the_axes_in_mode_6() {
    for (slot, firmware) in SlotSize::ALL.into_iter().flat_map(|slot| [(slot, Firmware::V17), (slot, Firmware::V15)]) {
        for chosen in CHOICES {
            let (mut host, axes) = pair_on(slot, firmware);
            host.slave(1, SlaveCommand::Csp(Motion { first: to(5100), second: to(5200) })).drained().cycles(5);
            chosen.iter().for_each(|axis| write_mode(&mut host, *axis, 6));
            forget(&axes);
            host.slave(1, SlaveCommand::GoHome).drained().cycles(5);
            let moves = |n: &usize| chosen.contains(n) && (*n == 0 || slot == SlotSize::Bytes16);
            let any = (0..2).any(|n| moves(&n));
            assert_eq!(phase(&host), if any { HomingPhase::Homing } else { HomingPhase::Idle });
            until_idle(&mut host);
            host.cycles(50);
            for (n, axis) in axes.iter().enumerate() {
                let what = format!("{slot:?} {firmware:?} {chosen:?} axis {n}");
                let homed = moves(&n);
                assert_eq!((axis.begun(), starts(axis)), (u32::from(homed), homed), "{what}");
                let restored = homed && firmware == Firmware::V17;
                assert_eq!(axis.modes(), if restored { vec![8] } else { vec![] }, "{what}");
                assert_eq!(axis.mode(), if chosen.contains(&n) && !restored { 6 } else { 8 }, "{what}");
                let second = if slot == SlotSize::Bytes16 { 5200 } else { 5000 };
                let held = if n == 0 { 5100 } else { second };
                assert_eq!(axis.position(), if homed { -700_000 } else { held }, "{what}");
            }
            let refused = u64::from(!any);
            let counted = (rejected(&host, Reason::NotInHomingMode), host.counters().rejected_total());
            assert_eq!(counted, (refused, refused), "{slot:?} {chosen:?}");
        }
    }
}

fn to(target: i32) -> AxisTarget {
    AxisTarget { target, outputs: 0 }
}

/// SK-7.26 SK-7.41 An axis of two that is home is not restored while the other one still homes; then both are. SK-7.37
/// Commands for the slave until then count as ignored, also those for the axis that is home.
#[test]
fn no_axis_is_restored_before_the_other_is_home() {
    let buses = std::iter::once(None).chain(ahead().map(Some));
    for (how, late) in buses.flat_map(|how| [(how, 0), (how, 1)]) {
        let axes = [Homer::new(), Homer::new()];
        let bus = SimBus::new(vec![Box::new(Pair(axes.clone(), Images::default()))]);
        let mut host = match how {
            None => on(bus, SlotSize::Bytes16, Firmware::V17, Mode::Csp),
            Some(how) => on(AheadBus::new(bus, how), SlotSize::Bytes16, Firmware::V17, Mode::Csp),
        };
        (0..2).for_each(|axis| write_mode(&mut host, axis, 6));
        forget(&axes);
        axes[late].script(Script { takes: 1500, ..Script::default() });
        host.slave(1, SlaveCommand::GoHome).drained().cycles(1000);
        assert_eq!(axes[1 - late].position(), -700_000, "{how:?}: it is home");
        assert_eq!(
            [0, 1].map(|n| axes[n].modes()),
            [const { Vec::<u32>::new() }; 2],
            "{how:?}: nothing is written yet"
        );
        assert_eq!(phase(&host), HomingPhase::Homing);
        let ignored = host.counters().ignored_homing;
        host.slave(1, SlaveCommand::Csp(Motion { first: to(9), second: to(9) })).drained();
        assert_eq!(host.counters().ignored_homing, ignored + 1);
        until_idle(&mut host);
        host.cycles(50);
        for (n, axis) in axes.iter().enumerate() {
            let what = format!("{how:?}, {late} is late, axis {n}");
            assert_eq!((axis.modes(), axis.jump(), axis.position()), (vec![8], 0, -700_000), "{what}");
        }
    }
}

/// SK-7.21 Each axis ends on its own: an error, SK-6.5 a host's write of its mode; ABORT_HOME and SV_OFF end both.
#[test]
fn ends_of_one_axis_and_of_both() {
    type Case = (fn(&mut Host, &[Homer; 2]), [HomingEnd; 2]);
    let cases: [Case; 5] = [
        (
            |_, axes| axes[1].script(Script { takes: 1, result: BIT_13, ..Script::default() }),
            [HomingEnd::Attained, HomingEnd::Error],
        ),
        (|host, _| write_mode(host, 1, 8), [HomingEnd::Attained, HomingEnd::ModeWritten]),
        (|host, _| write_mode(host, 0, 8), [HomingEnd::ModeWritten, HomingEnd::Attained]),
        (
            |host, _| {
                host.slave(1, SlaveCommand::AbortHome);
            },
            [HomingEnd::Aborted; 2],
        ),
        (
            |host, _| {
                host.slave(1, SlaveCommand::ServoOff);
            },
            [HomingEnd::ServoOff; 2],
        ),
    ];
    for (n, (case, expected)) in cases.into_iter().enumerate() {
        let (mut host, axes) = pair_on(SlotSize::Bytes16, Firmware::V17);
        (0..2).for_each(|axis| write_mode(&mut host, axis, 6));
        axes.iter().for_each(|axis| axis.script(Script { takes: 600, ..Script::default() }));
        let mark = host.mark();
        host.slave(1, SlaveCommand::GoHome).drained().cycles(100);
        case(&mut host, &axes);
        until_idle(&mut host);
        host.cycles(50);
        let mut ends = [None; 2];
        for event in host.board.engine().events_since(mark) {
            if let ecmsk::engine::EventKind::HomingEnded { slave: 1, axis, end } = event.kind {
                assert_eq!(ends[usize::from(axis)].replace(end), None, "case {n}: axis {axis} ends once");
            }
        }
        assert_eq!(ends, expected.map(Some), "case {n}");
        assert_eq!([0, 1].map(|axis| axes[axis].mode()), [8; 2], "case {n}");
        assert_eq!([0, 1].map(|axis| axes[axis].jump()), [0; 2], "case {n}");
    }
}

/// SK-7.27 Each axis of a module counts by its own statusword: axis 1 being home in the slot does not end the homing of
/// axis 2, and axis 2 has ended as soon as 0x6841 says so.
#[test]
fn the_next_slave_waits_for_both_axes() {
    let (axes, next) = ([Homer::new(), Homer::new()], Homer::new());
    let bus = SimBus::new(vec![Box::new(Pair(axes.clone(), Images::default())), Box::new(next.clone())]);
    let mut host = Host::new(EngineConfig { slot: SlotSize::Bytes16, ..EngineConfig::default() }, bus);
    let mut kinds = [SlaveKind::None; 8];
    (kinds[0], kinds[1]) = (SlaveKind::Hsp, SlaveKind::Drive);
    host.master(MasterCommand::SetAxis { group: 0, kinds }).go(MasterState::Op).drained();
    host.servo_on(1).servo_on(2).cycles(50);
    (0..2).for_each(|axis| write_mode(&mut host, axis, 6));
    assert_eq!(host.write_object(2, 0x6060, 0, SdoSize::One, 6), Ok(6));
    axes[0].script(Script { takes: 0, ..Script::default() });
    axes[1].script(Script { takes: 300, ..Script::default() });
    host.slave(1, SlaveCommand::GoHome).drained().cycles(100);
    assert_eq!(HspResponse::decode(&host.slot(1), host.size).statusword.0 & 0x1400, 0x1400, "the slot says done");
    host.slave(2, SlaveCommand::GoHome).drained().cycles(10);
    assert_eq!((rejected(&host, Reason::HomingElsewhere), next.begun()), (1, 0));
    host.until("home", |_| axes[1].position() == -700_000);
    host.cycles(1).slave(2, SlaveCommand::GoHome).drained().cycles(10);
    assert_eq!((rejected(&host, Reason::HomingElsewhere), next.begun()), (1, 1));
}

/// SK-7.30 GO_HOME for a module of which no axis is in mode 6 is rejected. SK-7.38 If one axis in mode 6 is not on by
/// SV_ON, none starts.
#[test]
fn rejections() {
    let (mut host, axes) = pair_on(SlotSize::Bytes16, Firmware::V17);
    host.slave(1, SlaveCommand::GoHome).drained();
    assert_eq!(rejected(&host, Reason::NotInHomingMode), 1);
    (0..2).for_each(|axis| write_mode(&mut host, axis, 6));
    axes[1].fall(crate::puppet::FAULT);
    host.cycles(5);
    host.slave(1, SlaveCommand::GoHome).drained().cycles(50);
    assert_eq!((rejected(&host, Reason::NotEnabled), [0, 1].map(|axis| axes[axis].begun())), (1, [0, 0]));
    write_mode(&mut host, 1, 8);
    host.slave(1, SlaveCommand::GoHome).drained().cycles(50);
    assert_eq!([0, 1].map(|axis| axes[axis].begun()), [1, 0], "axis 1 alone is on, and is asked");
    assert_eq!(rejected(&host, Reason::NotEnabled), 1);
}

/// A module with switches nearer than the default ones.
fn module(channels: Channels) -> SimBus {
    let travel = Travel {
        negative_limit: Some(-8000),
        positive_limit: Some(9000),
        home: Some(HomeSwitch::Cam { first: -500, last: 700 }),
        ..HspConfig::default().travels[0]
    };
    let config = HspConfig { positions: [3000, -3000], travels: [travel; 2], ..HspConfig::with(channels) };
    SimBus::new(vec![Box::new(Hsp::new(config))])
}

/// SK-3.28 SK-7.19 SK-7.22 The simulated module, from SDOs to motion: both axes at once, or one while the other one,
/// in CSP, holds its last target: commands for the slave are ignored meanwhile (SK-7.37). Then both go on by as many
/// pulses as they are told, without a jump.
#[test]
fn a_module_homes_and_goes_on() {
    let in_16_bytes = CHOICES.map(|chosen| (SlotSize::Bytes16, chosen));
    for (slot, chosen) in [(SlotSize::Bytes12, CHOICES[0])].into_iter().chain(in_16_bytes) {
        let bus = module(Channels::Two);
        let network = bus.handle();
        let mut host = on(bus, slot, Firmware::V17, Mode::Csp);
        let what = format!("{slot:?} {chosen:?}");
        // Method 17: the negative limit switch; method 20: the left edge of the cam.
        for axis in chosen {
            let (offset, method) = (SECOND * *axis as u16, [17, 20][*axis]);
            write_mode(&mut host, *axis, 6);
            host.write_object(1, 0x6098 + offset, 0, SdoSize::One, method).unwrap();
            host.write_object(1, 0x607C + offset, 0, SdoSize::Four, 100).unwrap();
        }
        let before = [0, 1].map(|axis| network.shaft(1, axis).unwrap());
        assert_eq!(before, [3000, -3000], "{what}");
        host.slave(1, SlaveCommand::GoHome).drained().cycles(20);
        if chosen == [0] {
            assert_eq!(host.counters().ignored_homing, 0);
            host.slave(1, SlaveCommand::Csp(Motion { first: to(3000), second: to(-3100) })).drained().cycles(20);
            assert_eq!(network.shaft(1, 1), Some(-3000), "{what}: axis 2 holds");
            assert_eq!(host.counters().ignored_homing, 1, "{what}");
        }
        if chosen.contains(&0) {
            host.until("bits 10 and 12", |host| {
                let word = HspResponse::decode(&host.slot(1), host.size).statusword.0;
                word & 0x1400 == 0x1400
            });
        }
        until_idle(&mut host);
        host.cycles(50);
        let there = [0, 1].map(|axis| network.shaft(1, axis).unwrap());
        let homes = [-7999, -500];
        for axis in 0..2 {
            let expected = if chosen.contains(&axis) { there[axis] - homes[axis] + 100 } else { there[axis] };
            let seen = host.read_object(1, 0x6064 + SECOND * axis as u16, 0).unwrap() as i32;
            assert_eq!(i64::from(seen), expected, "{what}, axis {axis}: the coordinate after the home event");
            let mode = host.read_object(1, 0x6061 + SECOND * axis as u16, 0);
            assert_eq!(mode, Ok(8), "{what}, axis {axis}");
            if !chosen.contains(&axis) {
                assert_eq!(there[axis], before[axis], "{what}, axis {axis}");
            }
        }
        let [first, second] = [0, 1].map(|axis| host.read_object(1, 0x6064 + SECOND * axis as u16, 0).unwrap() as i32);
        host.slave(1, SlaveCommand::Csp(Motion { first: to(first + 11), second: to(second - 13) }));
        host.drained().cycles(20);
        let moved = [0, 1].map(|axis| network.shaft(1, axis).unwrap() - there[axis]);
        let expected = if slot == SlotSize::Bytes16 { [11, -13] } else { [11, 0] };
        assert_eq!((moved, host.counters().rejected_total()), (expected, 0), "{what}");
    }
}

/// SK-7.22 A module in CSV, and one of one channel: mode 9 comes back, and after it commands set the velocity.
#[test]
fn a_module_in_csv_homes() {
    for channels in [Channels::One, Channels::Two] {
        let bus = module(channels);
        let network = bus.handle();
        let mut host = on(bus, SlotSize::Bytes16, Firmware::V17, Mode::Csv);
        write_mode(&mut host, 0, 6);
        host.write_object(1, 0x6098, 0, SdoSize::One, 18).unwrap();
        host.slave(1, SlaveCommand::GoHome).drained().cycles(20);
        until_idle(&mut host);
        host.cycles(50);
        assert_eq!(host.read_object(1, 0x6061, 0), Ok(9), "{channels:?}");
        let there = network.shaft(1, 0).unwrap();
        assert_eq!(i64::from(host.read_object(1, 0x6064, 0).unwrap() as i32), there - 8999, "{channels:?}");
        host.slave(1, SlaveCommand::Csv(Motion::to(-1000))).drained().cycles(1000);
        let way = there - network.shaft(1, 0).unwrap();
        assert!((900..=1010).contains(&way), "{channels:?}: {way} pulses in about a second");
    }
}
