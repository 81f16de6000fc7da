//! Drives: the walks of SV_ON and SV_OFF, the process data meanwhile, and modes.

use ecmsk::cia402::{DriveState, Mode};
use ecmsk::coe::SdoSize;
use ecmsk::engine::{EngineConfig, Reason};
use ecmsk::fieldbus::Role;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::sk::{DriveSync, MasterState, Motion, SlaveCommand};
use ecmsk::slave::state_machine::TransitionTimes;
use ecmsk::slave::{Drive, DriveConfig};

use crate::host::Host;
use crate::puppet::{DISABLED, ENABLED, FAULT, FAULT_REACTION, NOT_READY, Puppet, QUICK_STOP, READY, SWITCHED_ON};

/// A board in OP with one puppet drive that shows Switch on disabled, at 1000 counts.
pub fn board() -> (Host, Puppet) {
    let puppet = Puppet::new();
    puppet.stand(1000);
    puppet.strings().objects.insert((0x6060, 0), (1, 8));
    let mut host = Host::new(EngineConfig::default(), SimBus::new(vec![puppet.boxed()]));
    host.op(1).cycles(3);
    puppet.forget();
    (host, puppet)
}

/// The same, walked up to Operation enabled.
fn board_on() -> (Host, Puppet) {
    let (mut host, puppet) = board();
    walk_up(&mut host, &puppet);
    (host, puppet)
}

pub fn walk_up(host: &mut Host, puppet: &Puppet) {
    host.slave(1, SlaveCommand::ServoOn).cycles(3);
    for statusword in [READY, SWITCHED_ON, ENABLED] {
        puppet.show(statusword);
        host.cycles(3);
    }
    puppet.forget();
}

/// One frame with a target, executed.
fn aim(host: &mut Host, target: i32) {
    host.csp(1, target).drained();
}

pub fn discarded(host: &Host) -> u64 {
    host.counters().discarded_before_enabled
}

/// SK-7.8 SV_ON walks up: shutdown 0x06, switch on 0x07, enable 0x0F, each after the statusword shows the step before.
/// SK-7.14 It takes one entry; the walk goes on while later entries run.
/// SK-7.15 However long a drive takes, the board waits for it.
#[test]
fn servo_on_walks_up_step_by_step() {
    for patience in [1, 2, 50, 3000] {
        let (mut host, puppet) = board();
        let executed = host.counters().executed;
        host.cycles(20);
        assert_eq!(puppet.controlwords(), [0x00], "the board does nothing by itself");
        host.slave(1, SlaveCommand::ServoOn).drained();
        assert_eq!(host.counters().executed, executed + 1, "one entry");
        let mut words = vec![0x00];
        for (shown, asked) in [(DISABLED, 0x06), (READY, 0x07), (SWITCHED_ON, 0x0F), (ENABLED, 0x0F)] {
            puppet.show(shown);
            // A cycle shows the statusword, and the next one carries the controlword that follows from it.
            host.idle().cycles(2);
            words.push(asked);
            words.dedup();
            assert_eq!(puppet.controlwords(), words, "after {shown:04x}");
            host.arrive_marked([9]).cycles(patience);
            assert_eq!((puppet.controlwords(), host.mark_shown()), (words.clone(), 9), "{shown:04x} holds");
        }
    }
}

/// SK-7.8 The walk begins at the drive's present state.
#[test]
fn servo_on_begins_where_the_drive_is() {
    for (shown, words) in [(READY, [0x00, 0x07].as_slice()), (SWITCHED_ON, &[0x00, 0x0F]), (ENABLED, &[0x00, 0x0F])] {
        let (mut host, puppet) = board();
        puppet.show(shown);
        host.cycles(3).slave(1, SlaveCommand::ServoOn).cycles(5);
        assert_eq!(puppet.controlwords(), words);
    }
    // The board waits for a drive that is still initialising.
    let (mut host, puppet) = board();
    puppet.show(NOT_READY);
    host.cycles(3).slave(1, SlaveCommand::ServoOn).cycles(200);
    assert_eq!(puppet.controlwords(), [0x00]);
    puppet.show(DISABLED);
    host.cycles(3);
    assert_eq!(puppet.controlwords(), [0x00, 0x06]);
}

/// SK-7.10 SV_OFF walks down to Switch on disabled, each step after the statusword shows the one before.
/// SK-7.14 It takes one entry; later entries run meanwhile.
#[test]
fn servo_off_walks_down_step_by_step() {
    let (mut host, puppet) = board_on();
    aim(&mut host, 1500);
    puppet.forget();
    host.slave(1, SlaveCommand::ServoOff).cycles(3);
    let mut words = vec![0x0F, 0x07];
    assert_eq!(puppet.controlwords(), words);
    for (shown, asked) in [(ENABLED, 0x07), (SWITCHED_ON, 0x06), (READY, 0x00), (DISABLED, 0x00)] {
        puppet.show(shown);
        host.cycles(2).arrive_marked([7]).cycles(50);
        words.push(asked);
        words.dedup();
        assert_eq!((puppet.controlwords(), host.mark_shown()), (words.clone(), 7));
    }
    host.cycles(500);
    assert_eq!(puppet.last().controlword.0, 0x00);
}

/// SK-7.8 SK-7.10 An SV_ON that comes at any time after an SV_OFF is carried out, and so is an SV_OFF after an SV_ON.
#[test]
fn walks_in_quick_succession_end_as_the_last_one_says() {
    for obedient in [true, false] {
        for gap in 0..60 {
            let puppet = Puppet::obedient();
            let slave = if obedient { puppet.boxed() } else { Box::new(Drive::new(DriveConfig::default())) };
            let mut host = Host::new(EngineConfig::default(), SimBus::new(vec![slave]));
            host.op(1).servo_on(1).cycles(5);
            host.slave(1, SlaveCommand::ServoOff).cycles(gap).slave(1, SlaveCommand::ServoOn).cycles(400);
            assert!(host.drive(1).statusword.is_enabled(), "SV_ON {gap} cycles after SV_OFF: {:?}", host.drive(1));
            host.slave(1, SlaveCommand::ServoOff).cycles(400).slave(1, SlaveCommand::ServoOn).cycles(gap);
            host.slave(1, SlaveCommand::ServoOff).cycles(400);
            let state = host.drive(1).statusword.state();
            assert_eq!(state, Some(DriveState::SwitchOnDisabled), "SV_OFF {gap} cycles after SV_ON");
        }
    }
}

/// SK-7.9 SV_ON does not reset a fault, and is not remembered: a motor does not start because a fault went away.
#[test]
fn servo_on_in_a_fault_is_without_effect() {
    for fault in [FAULT, FAULT_REACTION] {
        let (mut host, puppet) = board();
        puppet.show(fault);
        host.cycles(3).slave(1, SlaveCommand::ServoOn).slave(1, SlaveCommand::ServoOn).cycles(100);
        assert_eq!(puppet.controlwords(), [0x00], "no reset, no step");
        puppet.show(DISABLED);
        host.cycles(500);
        assert_eq!(puppet.controlwords(), [0x00], "nothing starts by itself");
        puppet.forget();
        walk_up(&mut host, &puppet);
        assert_eq!(puppet.last_word(&mut host), 0x0F, "a new SV_ON works");
    }
}

/// SK-7.9 A fault ends a walk, and the walk does not go on when the fault is gone.
#[test]
fn a_fault_ends_a_walk() {
    for at in [DISABLED, READY, SWITCHED_ON] {
        let (mut host, puppet) = board();
        puppet.show(at);
        host.slave(1, SlaveCommand::ServoOn).cycles(5);
        puppet.show(FAULT);
        host.cycles(5);
        puppet.show(DISABLED);
        host.cycles(2);
        puppet.forget();
        host.cycles(500);
        assert_eq!(puppet.controlwords(), [0x00], "SV_ON at {at:04x}");
    }
}

/// SK-7.8 A drive that brakes by its own quick stop is brought out of it first: disable voltage, then the walk.
#[test]
fn servo_on_goes_on_after_a_quick_stop() {
    let (mut host, puppet) = board();
    host.slave(1, SlaveCommand::ServoOn).cycles(3);
    for (shown, asked) in [(READY, 0x07), (QUICK_STOP, 0x00), (DISABLED, 0x06), (READY, 0x07), (SWITCHED_ON, 0x0F)] {
        puppet.show(shown);
        host.cycles(3);
        assert_eq!(puppet.last().controlword.0, asked, "after {shown:04x}");
    }
}

/// SK-7.8 The board does not bring back a drive that leaves Operation enabled by itself; a new SV_ON does.
#[test]
fn a_drive_that_drops_out_stays_out() {
    for dropped in [DISABLED, READY, SWITCHED_ON, QUICK_STOP, FAULT_REACTION, FAULT] {
        let (mut host, puppet) = board_on();
        aim(&mut host, 2000);
        puppet.show(dropped);
        host.cycles(3);
        puppet.show(DISABLED);
        host.cycles(3);
        puppet.forget();
        host.cycles(1000);
        assert_eq!(puppet.controlwords(), [0x00], "after {dropped:04x}");
        walk_up(&mut host, &puppet);
        assert_eq!(puppet.last_word(&mut host), 0x0F);
    }
}

/// SK-7.16 While the drive is not in Operation enabled the target is its actual position, wherever it is pushed.
#[test]
fn the_target_is_the_actual_position_until_enabled() {
    let (mut host, puppet) = board();
    let mut shown = 1000;
    for (n, statusword) in [DISABLED, READY, SWITCHED_ON, FAULT, DISABLED].into_iter().enumerate() {
        puppet.show(statusword);
        for step in 0..100 {
            let position = 5000 * n as i32 - 37 * step;
            puppet.stand(position);
            host.cycle();
            assert_eq!(puppet.last().target, shown, "a cycle carries what the one before it has shown");
            shown = position;
        }
        host.slave(1, SlaveCommand::ServoOn);
    }
}

/// SK-7.16 The very first process data of OP have the actual position already, also after OP was left.
#[test]
fn the_first_outputs_hold_the_actual_position() {
    let (mut host, puppet) = board();
    for (n, back) in [MasterState::SafeOp, MasterState::PreOp, MasterState::SafeOp].into_iter().enumerate() {
        host.go(back);
        let position = 77_000 * (n as i32 + 1);
        puppet.stand(position);
        puppet.forget();
        host.go(MasterState::Op).cycles(5);
        assert_eq!((puppet.targets(), puppet.controlwords()), (vec![position], vec![0x00]), "back from {back}");
    }
}

/// SK-7.16 Operation enabled alone moves no shaft: the target stays where the drive was enabled until the first motion
/// command, also when a force pushes the shaft away, and then it is the command's.
#[test]
fn the_first_motion_command_is_the_first_new_target() {
    let (mut host, puppet) = board();
    host.slave(1, SlaveCommand::ServoOn).cycles(3);
    puppet.show(SWITCHED_ON);
    puppet.stand(-1234);
    host.cycles(3);
    puppet.show(ENABLED);
    host.cycles(3);
    puppet.forget();
    for n in 0..200 {
        puppet.stand(-1234 - n);
        host.idle().cycle();
    }
    assert_eq!(puppet.targets(), [-1234], "the drive holds against the force");
    assert_eq!(discarded(&host), 0);
    aim(&mut host, -1300);
    host.cycles(100);
    assert_eq!(puppet.targets(), [-1234, -1300]);
}

/// SK-7.16 SK-7.18 An old target is not used again after the drive was off.
#[test]
fn an_old_target_is_forgotten_with_the_power() {
    let (mut host, puppet) = board_on();
    aim(&mut host, 9000);
    puppet.stand(9000);
    host.slave(1, SlaveCommand::ServoOff).cycles(2);
    for statusword in [SWITCHED_ON, READY, DISABLED] {
        puppet.show(statusword);
        host.cycles(3);
    }
    puppet.stand(400);
    host.cycles(3);
    walk_up(&mut host, &puppet);
    host.cycles(100);
    assert_eq!(puppet.targets(), [400]);
}

/// SK-7.18 Targets taken out of the FIFO before Operation enabled are discarded and counted, not rejected.
#[test]
fn targets_before_operation_enabled_are_discarded() {
    let (mut host, puppet) = board();
    let mut count = 0;
    for statusword in [DISABLED, READY, SWITCHED_ON] {
        if statusword != DISABLED {
            host.slave(1, SlaveCommand::ServoOn).drained();
        }
        puppet.show(statusword);
        host.cycles(3);
        for n in 0..40 {
            aim(&mut host, 100_000 + n);
            count += 1;
            assert_eq!(discarded(&host), count, "{statusword:04x}");
        }
    }
    puppet.show(ENABLED);
    host.cycles(100);
    assert_eq!(puppet.targets(), [1000], "no target of before ever reaches the drive");
    assert_eq!(host.counters().rejected_total(), 0);
    aim(&mut host, 1100);
    assert_eq!((puppet.targets(), discarded(&host)), (vec![1000, 1100], count));

    // The same when the drive has left Operation enabled.
    puppet.show(FAULT);
    puppet.stand(1090);
    host.cycles(3);
    aim(&mut host, 77);
    assert_eq!((puppet.targets(), discarded(&host)), (vec![1000, 1100, 1090], count + 1));
}

/// SK-7.31 CSP is accepted only in the mode that DRIVE_MODE chose.
#[test]
fn csp_needs_drive_mode_csp() {
    for mode in [Mode::Csv, Mode::Cst] {
        let puppet = Puppet::obedient();
        let mut host = Host::new(EngineConfig::default(), SimBus::new(vec![puppet.boxed()]));
        host.slave(1, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync });
        host.op(1).slave(1, SlaveCommand::ServoOn).cycles(10);
        assert_eq!(puppet.strings().roles, [Role::Drive(mode)]);
        aim(&mut host, 5);
        assert_eq!(host.counters().rejected[Reason::WrongMode.kind()], 1);
        assert_eq!((host.drive(1).head.id, puppet.last().target), (0, 0), "not executed: the answer is GET_STATUS's");
        assert_eq!(discarded(&host), 0, "counted once");
    }
}

/// SK-7.32 CSP is accepted only while 0x6060 was last written 8, by the board or by an SDO of the host. SK-7.16 Until
/// the mode is back and a motion command has come, the target is the actual position. SK-7.18 A target that comes
/// meanwhile is not kept.
#[test]
fn csp_needs_mode_8_in_0x6060() {
    let (mut host, puppet) = board_on();
    aim(&mut host, 1100);
    puppet.stand(1100);
    for mode in [6, 9, 10, 0] {
        let rejected = host.counters().rejected[Reason::WrongMode.kind()];
        assert_eq!(host.write_object(1, 0x6060, 0, SdoSize::One, mode), Ok(mode));
        aim(&mut host, 50_000);
        assert_eq!(host.counters().rejected[Reason::WrongMode.kind()], rejected + 1, "0x6060 = {mode}");
        puppet.stand(1080);
        host.cycles(3);
        assert_eq!(puppet.last().target, 1080);
        // A write that the drive refuses changes nothing.
        host.write_object(1, 0x6060, 0, SdoSize::Two, 8).unwrap_err();
        aim(&mut host, 50_000);
        assert_eq!(host.counters().rejected[Reason::WrongMode.kind()], rejected + 2);

        assert_eq!(host.write_object(1, 0x6060, 0, SdoSize::One, 8), Ok(8));
        host.cycles(50);
        assert_eq!(puppet.last().target, 1080);
        aim(&mut host, 1090);
        assert_eq!(puppet.last().target, 1090);
        assert_eq!(host.counters().rejected[Reason::WrongMode.kind()], rejected + 2);
    }
}

/// SK-7.34 At PreOP to SafeOP the board writes DRIVE_MODE's value to 0x6060, whatever its old value. SK-7.1 SK-7.2 In
/// CSP a drive maps 6040:16 607A:32, and 6041:16 6064:32 6077:16 603F:16 in every mode.
#[test]
fn the_way_to_safeop_writes_the_mode_and_maps_process_data() {
    let mut host = Host::new(EngineConfig::default(), SimBus::new(vec![Box::new(Drive::new(DriveConfig::default()))]));
    host.declare_drives(1);
    for (mode, rx_pdo) in [(Mode::Csv, 0x1601), (Mode::Csp, 0x1600), (Mode::Cst, 0x1602)] {
        host.go(MasterState::PreOp);
        host.slave(1, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync });
        let other = if mode == Mode::Csp { 9 } else { 8 };
        host.write_object(1, 0x6060, 0, SdoSize::One, other).unwrap();
        host.go(MasterState::SafeOp);
        let mut read = |index, sub| host.read_object(1, index, sub).unwrap();
        assert_eq!((read(0x6060, 0), read(0x6061, 0)), (mode.code().into(), mode.code().into()));
        assert_eq!((read(0x1C12, 0), read(0x1C12, 1)), (1, rx_pdo));
        assert_eq!((read(0x1C13, 0), read(0x1C13, 1)), (1, 0x1A00));
        let tx: Vec<u32> = (0..=4).map(|sub| read(0x1A00, sub)).collect();
        assert_eq!(tx, [4, 0x6041_0010, 0x6064_0020, 0x6077_0010, 0x603F_0010]);
    }
    let rx: Vec<u32> = (0..=2).map(|sub| host.read_object(1, 0x1600, sub).unwrap()).collect();
    assert_eq!(rx, [2, 0x6040_0010, 0x607A_0020]);
}

/// SK-7.16 The shaft does not jump from power-on to the first motion command, nor by discarded targets. SK-7.13 A drive
/// that is on reads 37h in the low byte of the statusword. SK-7.15 Drives take their own time to turn on: programs
/// poll.
#[test]
fn no_shaft_jumps() {
    let start = 123_456;
    let slow = TransitionTimes { enable_ns: 700_000_000, ..TransitionTimes::default() };
    let quick = TransitionTimes { switch_on_ns: 0, enable_ns: 0, ..slow };
    let drive = |times| Box::new(Drive::new(DriveConfig { position: start, times, ..DriveConfig::default() }));
    let bus = SimBus::new(vec![drive(slow), drive(quick)]);
    let network = bus.handle();
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(2);
    let mut on_after = [None; 2];
    for n in 0..1500 {
        host.build(|frame, size| {
            for slave in [1, 2] {
                let on = on_after[slave - 1].is_some();
                let command = match n {
                    0 => SlaveCommand::ServoOn,
                    _ if on => SlaveCommand::GetStatus,
                    _ => SlaveCommand::Csp(Motion::to(-start as i32)),
                };
                frame.put_slave(size, slave, &command.into());
            }
        });
        host.drained();
        for slave in [1, 2] {
            assert_eq!(network.shaft(slave as u8, 0), Some(start), "slave {slave}, frame {n}");
            if host.drive(slave).statusword.0 & 0xFF == 0x37 {
                on_after[slave - 1].get_or_insert(n);
            }
        }
    }
    let [Some(slow), Some(quick)] = on_after else { panic!("{on_after:?}") };
    assert!(slow > quick + 300, "{slow} and {quick} frames");
    assert!(discarded(&host) > 300);
    host.slave(1, SlaveCommand::ServoOff).slave(2, SlaveCommand::ServoOff).cycles(100);
    assert!([1, 2].iter().all(|slave| host.drive(*slave).statusword.0 & 1 == 0), "off: bit 0 is clear");
    assert_eq!(network.shaft(1, 0), Some(start));
}

impl Puppet {
    /// The controlword of the next cycle.
    fn last_word(&self, host: &mut Host) -> u16 {
        host.cycle();
        self.last().controlword.0
    }
}
