//! The CiA 402 state machine, transition by transition, from the tables of CiA 402-2 (IEC 61800-7-201).
use ecmsk::cia402::{Controlword, DriveState, Statusword};
use ecmsk::fieldbus::Ns;
use ecmsk::slave::DeviceFault;
use ecmsk::slave::state_machine::{OptionCodes, Power, Ramp, StateMachine, TransitionTimes};

use DriveState::*;

const MS: Ns = 1_000_000;
const AT_ONCE: TransitionTimes = TransitionTimes { self_test_ns: 0, switch_on_ns: 0, enable_ns: 0 };
const OPTIONS: OptionCodes = OptionCodes { quick_stop: 2, shutdown: 0, disable_operation: 0, fault_reaction: 2 };
const FAULT: DeviceFault = DeviceFault { code: 0x2310, resettable: true };

const DISABLE_VOLTAGE: u16 = 0x00;
const QUICK_STOP: u16 = 0x02;
const SHUTDOWN: u16 = 0x06;
const SWITCH_ON: u16 = 0x07;
const ENABLE: u16 = 0x0F;
const FAULT_RESET: u16 = 0x80;

fn send(machine: &mut StateMachine, word: u16) {
    machine.command(Controlword(word));
    // More than the longest chain of transitions; the shaft moves all the time.
    for _ in 0..5 {
        machine.step(MS, false);
    }
}

/// A machine that was brought to a state by the transitions that lead there.
fn machine_in(state: DriveState, options: OptionCodes) -> StateMachine {
    let mut machine = StateMachine::new(AT_ONCE, options);
    let way: &[u16] = match state {
        NotReadyToSwitchOn => return machine,
        SwitchOnDisabled => &[DISABLE_VOLTAGE],
        ReadyToSwitchOn => &[DISABLE_VOLTAGE, SHUTDOWN],
        SwitchedOn => &[DISABLE_VOLTAGE, SHUTDOWN, SWITCH_ON],
        OperationEnabled | FaultReactionActive => &[DISABLE_VOLTAGE, SHUTDOWN, SWITCH_ON, ENABLE],
        QuickStopActive => &[DISABLE_VOLTAGE, SHUTDOWN, SWITCH_ON, ENABLE, QUICK_STOP],
        Fault => &[DISABLE_VOLTAGE],
    };
    for word in way {
        send(&mut machine, *word);
    }
    match state {
        FaultReactionActive => machine.raise(FAULT),
        Fault => {
            machine.raise(FAULT);
            send(&mut machine, DISABLE_VOLTAGE);
        }
        _ => {}
    }
    assert_eq!(machine.state(), state);
    machine
}

/// Every command in every state: transitions 2 to 11, 15 and the half of 12 that a command makes.
#[test]
fn every_command_in_every_state() {
    use DriveState::{
        FaultReactionActive as Reaction, OperationEnabled as Enabled, QuickStopActive as Stopping,
        ReadyToSwitchOn as Ready, SwitchOnDisabled as Disabled, SwitchedOn as On,
    };
    let words = [DISABLE_VOLTAGE, QUICK_STOP, SHUTDOWN, SWITCH_ON, ENABLE, FAULT_RESET];
    for (state, ends) in [
        (Disabled, [Disabled, Disabled, Ready, Disabled, Disabled, Disabled]), // 2
        (Ready, [Disabled, Disabled, Ready, On, Enabled, Ready]),              // 7, 7, 3, 3 and 4
        (On, [Disabled, Disabled, Ready, On, Enabled, On]),                    // 10, 10, 6, 4
        (Enabled, [Disabled, Stopping, Ready, On, Enabled, Enabled]),          // 9, 11, 8, 5
        (Stopping, [Disabled, Stopping, Stopping, Stopping, Stopping, Stopping]), // 12
        (Reaction, [Reaction; 6]),
        (Fault, [Fault, Fault, Fault, Fault, Fault, Disabled]), // 15
    ] {
        for (word, expected) in words.into_iter().zip(ends) {
            let mut machine = machine_in(state, OPTIONS);
            send(&mut machine, word);
            assert_eq!(machine.state(), expected, "{word:#04X} in {state}");
        }
    }
}

/// Bits of the controlword that a command ignores have no effect.
#[test]
fn other_bits_of_the_controlword_do_not_matter() {
    for (state, word, expected) in [
        (SwitchOnDisabled, 0xFF7E, ReadyToSwitchOn),
        (ReadyToSwitchOn, 0xFF77, SwitchedOn),
        (SwitchedOn, 0xFF7F, OperationEnabled),
        (OperationEnabled, 0xFF7D, SwitchOnDisabled),
        (OperationEnabled, 0xFF7B, QuickStopActive),
    ] {
        let mut machine = machine_in(state, OPTIONS);
        send(&mut machine, word);
        assert_eq!(machine.state(), expected, "{word:#06X} in {state}");
    }
}

/// Transitions 0 and 1: a drive comes up by itself, after its self test.
#[test]
fn it_comes_up_by_itself_after_the_self_test() {
    let times = TransitionTimes { self_test_ns: 20 * MS, ..AT_ONCE };
    let mut machine = StateMachine::new(times, OPTIONS);
    for _ in 0..19 {
        machine.step(MS, true);
        assert_eq!(machine.state(), NotReadyToSwitchOn);
    }
    machine.step(MS, true);
    assert_eq!(machine.state(), SwitchOnDisabled);
}

/// SK-7.15 Transitions 3 and 4 take their time; a command that is taken back ends them, and they start anew.
#[test]
fn switching_on_takes_its_time() {
    let times = TransitionTimes { self_test_ns: 0, switch_on_ns: 10 * MS, enable_ns: 40 * MS };
    let mut machine = StateMachine::new(times, OPTIONS);
    send(&mut machine, DISABLE_VOLTAGE);
    send(&mut machine, SHUTDOWN);
    let mut steps_to = |word, state| {
        machine.command(Controlword(word));
        (1..).take(1000).find(|_| {
            machine.step(MS, true);
            machine.state() == state
        })
    };
    assert_eq!(steps_to(SWITCH_ON, SwitchedOn), Some(10));
    assert_eq!(steps_to(ENABLE, OperationEnabled), Some(40));
    assert_eq!(steps_to(SWITCH_ON, SwitchedOn), Some(1));
    machine.command(Controlword(ENABLE));
    for _ in 0..39 {
        machine.step(MS, true);
    }
    machine.command(Controlword(SWITCH_ON));
    machine.step(MS, true);
    machine.command(Controlword(ENABLE));
    for _ in 0..39 {
        machine.step(MS, true);
        assert_eq!(machine.state(), SwitchedOn);
    }
    machine.step(MS, true);
    assert_eq!(machine.state(), OperationEnabled);
}

/// SK-7.13 The statusword of every state, as value and mask of CiA 402-2; on: 37h, off: 50h in the low byte.
#[test]
fn the_statusword_shows_the_state() {
    for (state, value, mask, low_byte) in [
        (NotReadyToSwitchOn, 0x00, 0x4F, 0x00),
        (SwitchOnDisabled, 0x40, 0x4F, 0x50),
        (ReadyToSwitchOn, 0x21, 0x6F, 0x31),
        (SwitchedOn, 0x23, 0x6F, 0x33),
        (OperationEnabled, 0x27, 0x6F, 0x37),
        (QuickStopActive, 0x07, 0x6F, 0x17),
        (FaultReactionActive, 0x0F, 0x4F, 0x1F),
        (Fault, 0x08, 0x4F, 0x18),
    ] {
        let bits = machine_in(state, OPTIONS).status_bits();
        assert_eq!(bits & mask, value, "{state}");
        assert_eq!(bits & 0xFF, low_byte, "{state}");
        assert_eq!(Statusword(bits).state(), Some(state));
        assert_eq!(bits & Statusword::REMOTE != 0, state != NotReadyToSwitchOn, "{state}");
    }
}

/// Object 0x605A: how the motor brakes in Quick stop active, and transitions 12 (0..=4) and 16 (5..=8).
#[test]
fn quick_stop_option_codes() {
    for (code, ramp, stays) in [
        (0, None, false),
        (1, Some(Ramp::SlowDown), false),
        (2, Some(Ramp::QuickStop), false),
        (3, Some(Ramp::TorqueLimit), false),
        (4, Some(Ramp::TorqueLimit), false),
        (5, Some(Ramp::SlowDown), true),
        (6, Some(Ramp::QuickStop), true),
        (7, Some(Ramp::TorqueLimit), true),
        (8, Some(Ramp::TorqueLimit), true),
    ] {
        let mut machine = machine_in(OperationEnabled, OptionCodes { quick_stop: code, ..OPTIONS });
        machine.command(Controlword(QUICK_STOP));
        machine.step(MS, false);
        assert_eq!(machine.state(), QuickStopActive, "code {code}");
        assert_eq!(machine.power(), ramp.map_or(Power::Off, Power::Stop), "code {code}");
        if ramp.is_some() {
            machine.step(MS, false);
            assert_eq!(machine.state(), QuickStopActive, "code {code}: the shaft still moves");
        }
        machine.step(MS, true);
        assert_eq!(machine.state(), if stays { QuickStopActive } else { SwitchOnDisabled }, "code {code}");
        if stays {
            send(&mut machine, ENABLE);
            assert_eq!(machine.state(), OperationEnabled, "code {code}");
        }
    }
}

/// Objects 0x605B and 0x605C: with 1 the motor brakes first, still in Operation enabled.
#[test]
fn shutdown_and_disable_operation_option_codes() {
    let options = OptionCodes { shutdown: 1, disable_operation: 1, ..OPTIONS };
    for (word, target) in [(SHUTDOWN, ReadyToSwitchOn), (SWITCH_ON, SwitchedOn)] {
        let mut machine = machine_in(OperationEnabled, options);
        send(&mut machine, word);
        assert_eq!((machine.state(), machine.power()), (OperationEnabled, Power::Stop(Ramp::SlowDown)));
        machine.step(MS, true);
        assert_eq!((machine.state(), machine.power()), (target, Power::Off));
        let mut machine = machine_in(OperationEnabled, options);
        send(&mut machine, word);
        send(&mut machine, ENABLE);
        assert_eq!((machine.state(), machine.power()), (OperationEnabled, Power::Follow), "taken back");
    }
}

/// Transitions 13 and 14 from every state: the reaction of 0x605E where the motor has torque, none where it has not.
#[test]
fn a_fault_in_every_state() {
    for state in [NotReadyToSwitchOn, SwitchOnDisabled, ReadyToSwitchOn, SwitchedOn] {
        let mut machine = machine_in(state, OPTIONS);
        machine.raise(FAULT);
        assert_eq!((machine.state(), machine.power()), (FaultReactionActive, Power::Off), "{state}");
        machine.step(MS, false);
        assert_eq!(machine.state(), Fault, "{state}");
    }
    for state in [OperationEnabled, QuickStopActive] {
        for (code, power) in [
            (0, Power::Off),
            (1, Power::Stop(Ramp::SlowDown)),
            (2, Power::Stop(Ramp::QuickStop)),
            (3, Power::Stop(Ramp::TorqueLimit)),
            (4, Power::Stop(Ramp::TorqueLimit)),
        ] {
            let mut machine = machine_in(state, OptionCodes { fault_reaction: code, ..OPTIONS });
            machine.raise(FAULT);
            assert_eq!((machine.state(), machine.power()), (FaultReactionActive, power), "{state}, code {code}");
            machine.step(MS, false);
            let brakes = power != Power::Off;
            assert_eq!(machine.state(), if brakes { FaultReactionActive } else { Fault }, "{state}, code {code}");
            machine.step(MS, true);
            assert_eq!((machine.state(), machine.power()), (Fault, Power::Off), "{state}, code {code}");
        }
    }
}

/// Transition 15 needs a rising edge of bit 7, in Fault.
#[test]
fn a_fault_reset_is_a_rising_edge() {
    let mut machine = machine_in(OperationEnabled, OPTIONS);
    send(&mut machine, ENABLE | FAULT_RESET);
    machine.raise(FAULT);
    machine.step(MS, true);
    assert_eq!(machine.state(), Fault);
    send(&mut machine, FAULT_RESET);
    assert_eq!(machine.state(), Fault, "the bit was set before");
    send(&mut machine, DISABLE_VOLTAGE);
    assert_eq!((machine.state(), machine.fault()), (Fault, Some(FAULT)));
    send(&mut machine, FAULT_RESET);
    assert_eq!((machine.state(), machine.fault()), (SwitchOnDisabled, None));
}

/// A fault reset does not clear every fault, and no later fault makes it do so.
#[test]
fn some_faults_stay() {
    let lasting = DeviceFault { code: 0x7120, resettable: false };
    let mut machine = machine_in(SwitchedOn, OPTIONS);
    machine.raise(lasting);
    machine.raise(FAULT);
    assert_eq!(machine.fault().map(|fault| fault.code), Some(FAULT.code), "the last one is shown");
    for _ in 0..3 {
        send(&mut machine, DISABLE_VOLTAGE);
        send(&mut machine, FAULT_RESET);
    }
    assert_eq!(machine.state(), Fault);
}

/// [OURS] Without a master a moving drive brakes as by a quick stop and ends in Switch on disabled, whatever 0x605A
/// says; a drive without torque goes there at once.
#[test]
fn a_drive_that_loses_its_master() {
    for code in [2, 6] {
        let mut machine = machine_in(OperationEnabled, OptionCodes { quick_stop: code, ..OPTIONS });
        machine.lose_master();
        machine.step(MS, false);
        assert_eq!((machine.state(), machine.power()), (QuickStopActive, Power::Stop(Ramp::QuickStop)));
        machine.step(MS, true);
        assert_eq!(machine.state(), SwitchOnDisabled);
    }
    for state in [SwitchOnDisabled, ReadyToSwitchOn, SwitchedOn] {
        let mut machine = machine_in(state, OPTIONS);
        machine.lose_master();
        machine.step(MS, true);
        assert_eq!(machine.state(), SwitchOnDisabled);
    }
}
