//! A load that sags while its brake opens, on buses that take outputs ahead.

use ecmsk::cia402::{Controlword, Statusword};
use ecmsk::fieldbus::{AxisIn, AxisOut};
use ecmsk::sk::{Frame, MasterState, Motion, SlaveCommand};

use crate::network_rig::Net;
use crate::puppet::{DISABLED, ENABLED, READY, SWITCHED_ON};
use support::ahead_bus::Ahead;

/// Counts by which the load sags in a cycle, and cycles that the brake takes to open.
const SAG: i32 = 50;
const BRAKE_CYCLES: u16 = 40;

/// A vertical axis. Its error code counts the cycles of the brake; its torque is the farthest that a target has pulled it
/// back up in one cycle since it was enabled, in counts.
fn vertical(shows: &mut AxisIn, out: &AxisOut) {
    let word = match (shows.statusword.0, out.controlword) {
        (_, Controlword::DISABLE_VOLTAGE) => DISABLED,
        (DISABLED | SWITCHED_ON, Controlword::SHUTDOWN) => READY,
        (READY, Controlword::SWITCH_ON) => SWITCHED_ON,
        (SWITCHED_ON, Controlword::ENABLE_OPERATION) if shows.error_code < BRAKE_CYCLES => {
            shows.error_code += 1;
            shows.position -= SAG;
            SWITCHED_ON
        }
        (SWITCHED_ON, Controlword::ENABLE_OPERATION) => ENABLED,
        (word, _) => word,
    };
    shows.statusword = Statusword(word);
    if word == ENABLED {
        shows.torque = shows.torque.max((out.target - shows.position) as i16);
        shows.position = out.target;
    }
}

/// How far the axis is pulled back when it is switched on while a program streams empty frames, or targets for slave 2.
/// Also returns the steps of slave 2 from one cycle to the next.
fn pulled_back(how: Ahead, moves_another: bool) -> (i32, Vec<i32>) {
    let mut net = Net::new(Some(how), 2);
    net.host.go(MasterState::Op).drained();
    if moves_another {
        net.host.servo_on(2).cycles(30);
    }
    net.puppets[0].strings().reflex = Some(vertical);
    net.puppets[1].forget();
    let mut target = 0;
    let mut send = |net: &mut Net, on: bool| {
        let mut frame = Frame::new();
        if on {
            frame.put_slave(net.host.size, 1, &SlaveCommand::ServoOn.into());
        }
        if moves_another {
            target += 10;
            frame.put_slave(net.host.size, 2, &SlaveCommand::Csp(Motion::to(target)).into());
        }
        net.host.arrive(&frame);
    };
    (0..100).for_each(|_| send(&mut net, false));
    for n in 0..1000 {
        send(&mut net, n == 0);
        net.host.cycle();
    }
    net.host.drained().cycles(30);
    assert!(net.host.drive(1).statusword.is_enabled(), "{how:?}");
    let targets: Vec<i32> = net.puppets[1].strings().sent.iter().map(|out| out.target).collect();
    let steps = targets.windows(2).map(|pair| pair[1] - pair[0]);
    (net.host.drive(1).torque.into(), steps.collect())
}

/// SK-12.3 An axis that sags while its brake opens is not pulled back to its earlier position, however deep the bus:
/// only by the sag until its answer is seen. SK-7.16
#[test]
fn a_deep_bus_pulls_a_sagging_axis_back_no_further() {
    for (pipeline, phase, slower) in [(0, 333_333, 0), (2, 999_999, 2500), (4, 500_000, 300)] {
        for depth in [2, 8, 64] {
            let how = Ahead::kind(depth, pipeline, phase, slower);
            let (pulled, _) = pulled_back(how, false);
            let late = pipeline as i32 + 3;
            assert!(pulled <= late * SAG, "{how:?}: {pulled} counts");
        }
    }
}

/// SK-12.3 The same holds for a program that sends few entries, and then many at once while the brake opens: cycles
/// without an entry do not count for entries that are pushed later.
#[test]
fn a_burst_while_the_brake_opens() {
    for (pipeline, phase, slower) in [(4, 500_000, 300), (20, 333_333, 0), (30, 999_999, 2500)] {
        for waits in [10, 30, 50] {
            let how = Ahead::kind(64, pipeline, phase, slower);
            let mut net = Net::new(Some(how), 1);
            net.host.go(MasterState::Op).drained();
            net.puppets[0].strings().reflex = Some(vertical);
            let mut frame = Frame::new();
            frame.put_slave(net.host.size, 1, &SlaveCommand::ServoOn.into());
            net.host.arrive(&frame);
            let is_opening = |net: &Net| net.puppets[0].strings().shows.error_code > 0;
            let mut opening = 0;
            for n in 0..300 {
                opening += usize::from(is_opening(&net));
                let frames = if opening == waits / 2 { 100 } else { usize::from(n % 5 == 0) };
                (0..frames).for_each(|_| _ = net.host.arrive(&Frame::new()));
                net.host.cycle();
            }
            net.host.drained().cycles(30);
            assert!(net.host.drive(1).statusword.is_enabled(), "{how:?}");
            let (pulled, late) = (i32::from(net.host.drive(1).torque), pipeline as i32 + 3);
            assert!(pulled <= late * SAG, "{how:?}, {waits}: {pulled} counts");
        }
    }
}

/// SK-12.3 The same holds while another axis follows targets, and that axis does not stop for it.
#[test]
fn another_axis_goes_on_meanwhile() {
    for (pipeline, phase, slower) in [(0, 333_333, 0), (2, 999_999, 0), (4, 500_000, 0)] {
        for depth in [8, 64] {
            let how = Ahead::kind(depth, pipeline, phase, slower);
            let (pulled, steps) = pulled_back(how, true);
            let late = pipeline as i32 + 6;
            assert!(pulled <= late * SAG, "{how:?}: {pulled} counts");
            let first = steps.iter().position(|step| *step != 0).expect("it moves");
            let moves = steps[first..].iter().rposition(|step| *step != 0).expect("it moves");
            let gaps = steps[first..first + moves].iter().filter(|step| **step == 0).count();
            assert_eq!(gaps, 0, "{how:?}: it stood still");
        }
    }
}
