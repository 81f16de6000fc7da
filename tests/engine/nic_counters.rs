//! Wrong working counters, over the bus of a network card: inputs with a wrong counter are not used, and missing inputs
//! become stale. And its axes when it is switched off.

use ecmsk::cia402::{Controlword, Mode};
use ecmsk::coe::SdoSize;
use ecmsk::engine::{EngineConfig, EventKind, HomingPhase, StateFailure};
use ecmsk::ethercat::{Command, SlaveSet};
use ecmsk::fieldbus::nic::{ChainWires, NicBus};
use ecmsk::fieldbus::sim::SimHandle;
use ecmsk::fieldbus::{STALE_AFTER, STALE_AT_LAST_NS};
use ecmsk::master::Settings;
use ecmsk::sk::{CycleTime, DcShift, DriveSync, MasterCommand, MasterState, Motion, SlaveCommand, StateByte};
use ecmsk::slave::Slave;

use crate::homer::{Homer, Script};
use crate::host::Host;
use crate::probe::drives;
use crate::puppet::{ENABLED, Puppet, SWITCHED_ON};
use support::lying_wire::{Answer, Lies, LyingWires};

/// The bytes of a drive in CSP or CSV: its outputs, and behind them its inputs.
const OUTPUTS: usize = 6;
const INPUTS: usize = 10;
/// Cycles of 1 ms until inputs are stale: the longer of 10 cycles and 20 ms.
const STALE_CYCLES: usize = 20;
/// The most cycles that the search for the slave with missing inputs takes.
const SEARCH_CYCLES: i32 = 6;

const _: () = assert!(STALE_AFTER.0 == 10 && STALE_AFTER.1 == 20_000_000 && STALE_AT_LAST_NS == 100_000_000);

/// Where the inputs of a drive are in the logical memory, if there are drives alone.
fn inputs_of(slave: usize) -> u32 {
    ((slave - 1) * (OUTPUTS + INPUTS) + OUTPUTS) as u32
}

/// A board with these slaves at the end of a wire that changes datagrams.
fn board(slaves: Vec<Box<dyn Slave>>) -> (Host, Lies, SimHandle) {
    let (network, lies) = (SimHandle::default(), Lies::default());
    let wires = ChainWires::new(slaves, network.clone()).expect("they have an EEPROM");
    let bus = NicBus::new(LyingWires::new(wires, lies.clone()), Settings::default());
    (Host::new(EngineConfig::default(), bus), lies, network)
}

/// A board in OP with these slaves as drives in CSP, at the end of a wire that changes datagrams.
fn in_op(slaves: Vec<Box<dyn Slave>>) -> (Host, Lies, SimHandle) {
    let count = slaves.len();
    let (mut host, lies, network) = board(slaves);
    host.op(count);
    (host, lies, network)
}

/// Suppresses the inputs of one of that many slaves from now on, with those of others and alone.
fn mute(lies: &Lies, slave: usize, slaves: u16) {
    lies.tell(move |answer: &mut Answer<'_>| {
        // In a datagram without this slave its inputs cannot be missing.
        if answer.command != Command::Lrw || answer.counter > 3 * (slaves - 1) {
            answer.silence(inputs_of(slave), INPUTS);
        }
    });
}

/// A board with three drives in CSV at that speed, in counts/s.
fn three_in_csv(velocity: i32) -> (Host, Lies, SimHandle) {
    let (mut host, lies, network) = board(drives(3));
    host.declare_drives(3);
    for slave in 1..=3 {
        host.build(|frame, size| {
            let mode = SlaveCommand::DriveMode { mode: Mode::Csv, sync: DriveSync::DcSync };
            frame.put_slave(size, slave, &mode.into());
        });
    }
    host.go(MasterState::Op).drained();
    (1..=3).for_each(|slave| {
        host.servo_on(slave);
    });
    host.build(|frame, size| {
        (1..=3).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::Csv(Motion::to(velocity)).into()));
    });
    host.drained().cycles(300);
    (host, lies, network)
}

fn velocity(network: &SimHandle, host: &mut Host, slave: u8) -> i64 {
    let before = network.shaft(slave, 0).expect("a shaft");
    host.cycles(10);
    (network.shaft(slave, 0).expect("a shaft") - before) * 100
}

/// The inputs of one of three drives in CSV do not arrive any more, working counter 8 of 9, though it is in OP and gets
/// its outputs. After 20 cycles it is lost, reported by its name and counted, and stopped on its quick-stop ramp. The
/// others go on, and their inputs are used as soon as it is known whose inputs are missing. `STALE_AFTER`, [OURS].
#[test]
fn an_axis_in_csv_whose_inputs_never_arrive_is_stopped() {
    let (mut host, lies, network) = three_in_csv(20_000);
    assert_eq!(host.state(), StateByte::reached(MasterState::Op));
    let (mark, before) = (host.mark(), host.counters());
    let muted_at = network.shaft(2, 0).expect("a shaft");
    mute(&lies, 2, 3);
    host.cycles(STALE_CYCLES - 1);
    assert_eq!(host.state(), StateByte::reached(MasterState::Op), "one cycle before");
    let went_on = network.shaft(2, 0).expect("a shaft") - muted_at;
    assert!((18 * 20..=20 * 20).contains(&went_on), "until then it goes on: {went_on}");
    host.cycles(1);
    assert_eq!(host.state(), StateByte::failed(Some(MasterState::Op)));
    assert_eq!(host.board.engine().state_failure(), Some(StateFailure::Stale { slave: 2 }));
    assert_eq!(host.board.engine().lost(), [2].into_iter().collect::<SlaveSet>());
    let kinds: Vec<EventKind> = host.board.engine().events_since(mark).map(|event| event.kind).collect();
    assert_eq!(kinds, [EventKind::WorkingCounter { counted: 8, expected: 9 }, EventKind::InputsStale { slave: 2 }]);
    let held = host.counters().inputs_held - before.inputs_held;
    assert_eq!((held, host.counters().inputs_stale), (STALE_CYCLES as u64 - 1, 1), "{:?}", host.counters());
    // Commands sent to it since are counted as not executed; it brakes to rest.
    host.slave(2, SlaveCommand::Csv(Motion::to(1))).cycles(300);
    assert!(host.counters().for_lost > before.for_lost);
    assert_eq!(velocity(&network, &mut host, 2), 0, "it stands");
    for slave in [1, 3] {
        assert_eq!(velocity(&network, &mut host, slave), 20_000, "slave {slave} goes on");
        let (shown, true_one) = (host.drive(slave.into()).position, network.shaft(slave, 0).expect("a shaft"));
        assert!((i64::from(shown) - true_one).abs() <= 60, "slave {slave}: {shown} {true_one}");
    }
    let held = host.counters().inputs_held - before.inputs_held;
    assert!(held <= STALE_CYCLES as u64, "{held}: those of others come");
}

/// The inputs of the other slaves are held only during the search for the one whose inputs are missing.
#[test]
fn inputs_of_others_come_again_when_it_is_known_whose_do_not() {
    let puppets = [(); 3].map(|()| Puppet::new());
    let (mut host, lies, _) = in_op(puppets.iter().map(Puppet::boxed).collect());
    let mut step = |n| {
        puppets.iter().for_each(|puppet| puppet.stand(n));
        host.cycles(1);
        [1, 2, 3].map(|slave| host.drive(slave).position)
    };
    let [.., shown] = [1, 2, 3, 4, 5].map(&mut step);
    // A slave's inputs were measured some cycles before.
    let late = 5 - shown[0];
    assert_eq!(shown, [5 - late; 3]);
    mute(&lies, 2, 3);
    let mut last_held = 0;
    for n in 6..5 + i32::try_from(STALE_CYCLES).expect("few") {
        let [first, muted, last] = step(n);
        assert_eq!(muted, shown[1]);
        if (first, last) != (n - late, n - late) {
            last_held = n - 5;
        }
    }
    assert!((1..=SEARCH_CYCLES).contains(&last_held), "held until cycle {last_held}");
}

/// A box in the cable reduces each working counter of process data by one for good. It is not known whose inputs are
/// missing, since each slave answers when it is asked alone. All are lost after 20 cycles, and none moves on.
#[test]
fn a_counter_that_is_too_low_for_no_reason_stops_all() {
    for off in [u16::MAX, 1, 100] {
        let (mut host, lies, network) = three_in_csv(20_000);
        lies.tell(move |answer: &mut Answer<'_>| {
            if answer.command == Command::Lrw {
                answer.count = answer.count.wrapping_add(off);
            }
        });
        host.cycles(STALE_CYCLES - 1);
        assert_eq!(host.state(), StateByte::reached(MasterState::Op), "{off}");
        host.cycles(1);
        assert_eq!(host.state(), StateByte::failed(Some(MasterState::Op)), "{off}");
        assert_eq!((host.board.engine().lost(), host.counters().inputs_stale), (SlaveSet::first(3), 3), "{off}");
        host.cycles(300);
        for slave in 1..=3 {
            assert_eq!(velocity(&network, &mut host, slave), 0, "{off}: slave {slave}");
        }
    }
}

/// The greatest age of inputs: 10 cycles, but at least 20 ms.
#[test]
fn inputs_are_stale_after_ten_cycles_and_20_ms() {
    for (cycle_us, cycles) in [(250, 80), (500, 40), (2000, 10), (4000, 10)] {
        let (mut host, lies, _) = board(drives(3));
        let cycle = CycleTime::from_us(cycle_us).expect("one of the board's");
        host.declare_drives(3).master(MasterCommand::SetDc { cycle, shift: DcShift::Auto });
        host.go(MasterState::Op).drained().cycles(30);
        mute(&lies, 2, 3);
        host.cycles(cycles - 1);
        assert_eq!(host.state(), StateByte::reached(MasterState::Op), "{cycle_us} us");
        host.cycles(1);
        assert_eq!(host.state(), StateByte::failed(Some(MasterState::Op)), "{cycle_us} us");
    }
}

/// Nobody can be asked whose inputs stay away: each state of a slave is read with a counter that cannot be, so that the
/// search never ends. After 100 ms, not before, all slaves of the datagram are lost, and stand. `STALE_AT_LAST_NS`.
#[test]
fn where_nobody_can_be_asked_inputs_are_stale_after_100_ms() {
    const AL_STATUS_BYTES: usize = 6;
    let (mut host, lies, network) = three_in_csv(20_000);
    lies.tell(|answer: &mut Answer<'_>| match answer.command {
        Command::Fprd if answer.data.len() == AL_STATUS_BYTES => answer.count = 1,
        Command::Lrw => answer.silence(inputs_of(2), INPUTS),
        _ => {}
    });
    let cycles = (STALE_AT_LAST_NS / 1_000_000) as usize;
    let before = network.shaft(2, 0).expect("a shaft");
    host.cycles(cycles - 1);
    assert_eq!(host.state(), StateByte::reached(MasterState::Op), "one cycle before");
    let way = network.shaft(2, 0).expect("a shaft") - before;
    assert!((19 * cycles as i64..=20 * cycles as i64).contains(&way), "until then it goes on: {way}");
    host.cycles(1);
    assert_eq!(host.state(), StateByte::failed(Some(MasterState::Op)));
    assert_eq!((host.board.engine().lost(), host.counters().inputs_stale), (SlaveSet::first(3), 3));
    host.cycles(300);
    for slave in 1..=3 {
        assert_eq!(velocity(&network, &mut host, slave), 0, "slave {slave}");
    }
}

/// A working counter above the sum of all slaves, with inputs that would enable a drive at a wrong position: none of
/// them reaches an axis. Switching on waits, and completes at the drive's position when counters are right again.
#[test]
fn a_counter_that_is_too_high_enables_no_servo() {
    for excess in [1, 2, 100] {
        let puppets = [Puppet::obedient(), Puppet::obedient()];
        puppets[0].stand(1234);
        let (mut host, lies, _) = in_op(puppets.iter().map(Puppet::boxed).collect());
        host.cycles(5);
        lies.tell(move |answer: &mut Answer<'_>| {
            if answer.command == Command::Lrw {
                answer.data.fill(0x7D);
                let [low, high] = SWITCHED_ON.to_le_bytes();
                (answer.data[OUTPUTS], answer.data[OUTPUTS + 1]) = (low, high);
                answer.count += excess;
            }
        });
        puppets.iter().for_each(Puppet::forget);
        host.slave(1, SlaveCommand::ServoOn).cycles(10);
        let sent = puppets[0].strings().sent.clone();
        assert!(sent.iter().all(|out| out.controlword.0 == 0 && out.target == 1234), "{excess}: {sent:?}");
        assert_eq!(host.drive(1).position, 1234);
        assert_eq!((host.counters().inputs_held, host.counters().inputs_stale), (10, 0));
        lies.end();
        host.until("Operation enabled", |host| host.drive(1).statusword.is_enabled());
        let sent = puppets[0].strings().sent.clone();
        assert!(sent.iter().all(|out| out.target == 1234), "{excess}: {sent:?}");
        assert_eq!(host.state(), StateByte::reached(MasterState::Op));
    }
}

/// A working counter that is wrong in one cycle now and then, too low or too high, and inputs beside it that are not
/// those of the slave: all targets reach it once and in order, no report shows these inputs, no slave is lost, and each
/// of these cycles is counted.
#[test]
fn one_wrong_counter_now_and_then_is_counted_and_nothing_else() {
    let puppets = [Puppet::obedient(), Puppet::obedient()];
    let (mut host, lies, _) = in_op(puppets.iter().map(Puppet::boxed).collect());
    host.servo_on(1).servo_on(2);
    puppets.iter().for_each(Puppet::forget);
    let before = host.counters();
    let mut wrong = 0;
    for n in 1..=300 {
        if n % 7 == 0 {
            wrong += 1;
            lies.tell(move |answer: &mut Answer<'_>| {
                if answer.command == Command::Lrw {
                    answer.data.fill(0x7D);
                    answer.count = if n % 2 == 0 { 1 } else { u16::MAX };
                }
            });
        } else {
            lies.end();
        }
        host.build(|frame, size| {
            [1, 2].into_iter().for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::Csp(Motion::to(n)).into()));
        });
        host.cycles(1);
        for slave in [1, 2] {
            let shown = host.drive(slave);
            assert!(shown.statusword.0 == ENABLED && (n - 3..=n).contains(&shown.position), "{n}: {shown:?}");
        }
    }
    lies.end();
    host.cycles(20);
    let counters = host.counters();
    assert_eq!(counters.inputs_held - before.inputs_held, wrong);
    assert_eq!((counters.inputs_stale, counters.for_lost, counters.full), (0, 0, 0), "{counters:?}");
    assert_eq!(counters.discarded_before_enabled, before.discarded_before_enabled);
    assert_eq!(host.state(), StateByte::reached(MasterState::Op));
    let all: Vec<i32> = (1..=300).collect();
    for puppet in &puppets {
        assert_eq!(puppet.targets_from(1), all);
    }
}

/// Closing a board on a network card, as the end of its program does on Linux, brings its axes to a standstill, switches
/// them off and takes the network to PreOP. The board's part of it, `Board::switch_off`, takes some seconds at most.
#[test]
fn a_board_that_is_switched_off_stops_its_axes() {
    let (mut host, _, network) = three_in_csv(20_000);
    assert_ne!(velocity(&network, &mut host, 1), 0);
    let (began, at) = (host.board.now(), [1, 2, 3].map(|slave| network.shaft(slave, 0).expect("a shaft")));
    assert_eq!(host.board.switch_off(), SlaveSet::EMPTY);
    let took = host.board.now() - began;
    assert!(took < 3_000_000_000, "{took} ns");
    let stood = [1, 2, 3].map(|slave| network.shaft(slave, 0).expect("a shaft"));
    for (at, stood) in at.into_iter().zip(stood) {
        assert!((0..20_000).contains(&(stood - at)), "it brakes, and does not turn round: {at} {stood}");
    }
    host.cycles(300);
    assert_eq!(host.board.engine().state(), StateByte::reached(MasterState::PreOp));
    assert_eq!([1, 2, 3].map(|slave| network.shaft(slave, 0).expect("a shaft")), stood, "they stand");
}

/// Inputs that come again before they are stale have no effect. Once they are stale the slave is lost even if they come again:
/// SET_STATE brings it back, off and where it is, and it moves again. While they still do not come it is lost again, and is
/// not enabled.
#[test]
fn stale_inputs_that_come_again() {
    let puppets = [Puppet::obedient(), Puppet::obedient()];
    let (mut host, lies, _) = in_op(puppets.iter().map(Puppet::boxed).collect());
    host.servo_on(1).servo_on(2);
    host.csp(2, 500).cycles(5);
    mute(&lies, 2, 2);
    host.cycles(STALE_CYCLES - 1);
    lies.end();
    host.cycles(100);
    assert_eq!((host.state(), host.counters().inputs_stale), (StateByte::reached(MasterState::Op), 0));
    host.csp(2, 700).cycles(5);
    assert_eq!(host.drive(2).position, 700);

    mute(&lies, 2, 2);
    host.cycles(STALE_CYCLES);
    assert_eq!((host.state(), host.counters().inputs_stale), (StateByte::failed(Some(MasterState::Op)), 1));
    lies.end();
    host.csp(2, 900).cycles(100);
    assert_eq!(host.state(), StateByte::failed(Some(MasterState::Op)));
    assert!(!puppets[1].targets().contains(&900), "it is lost until it is brought back");
    assert_eq!(puppets[1].last().controlword, Controlword::QUICK_STOP, "its axis brakes");
    assert_eq!(host.drive(1).statusword.0, ENABLED, "the other one goes on");

    // SET_STATE comes while its inputs are still missing.
    mute(&lies, 2, 2);
    puppets[1].forget();
    host.master(MasterCommand::SetState(MasterState::Op));
    host.until("the second loss", |host| host.counters().inputs_stale == 2);
    host.slave(2, SlaveCommand::ServoOn).cycles(50);
    assert!(puppets[1].strings().sent.iter().all(|out| out.controlword.0 != 0x0F), "not enabled");

    lies.end();
    puppets[1].stand(4321);
    host.go(MasterState::Op);
    puppets[1].forget();
    host.servo_on(2);
    assert!(puppets[1].targets().iter().all(|target| *target == 4321), "{:?}", puppets[1].targets());
    host.csp(2, 4400).cycles(5);
    assert_eq!((host.drive(2).position, host.drive(1).statusword.0), (4400, ENABLED));
}

/// The inputs of a drive that is homing do not arrive for a while, and the last ones still show the result of an earlier
/// homing. That result does not count as answered in these cycles: homing goes on, and ends by the drive's own result.
#[test]
fn old_inputs_end_no_homing() {
    /// The drive shows the old result for so many cycles after bit 4 has reached it: fewer than a result has to stay.
    const DEAF: u32 = 6;
    let homers = [Homer::new(), Homer::new()];
    let (mut host, lies, _) = in_op(homers.iter().map(|homer| Box::new(homer.clone()) as Box<dyn Slave>).collect());
    host.servo_on(1).servo_on(2);
    let phase = |host: &Host| host.board.engine().homing_phase(1);
    assert_eq!(host.write_object(1, 0x6060, 0, SdoSize::One, 6), Ok(6));
    homers[0].script(Script { deaf: DEAF, takes: 60, home: 700, ..Script::default() });
    host.cycles(30).slave(1, SlaveCommand::GoHome).drained().cycles(4);
    assert_eq!((phase(&host), homers[0].state().shows.statusword.0), (HomingPhase::Homing, 0x1637));
    mute(&lies, 1, 2);
    host.cycles(STALE_CYCLES - 1);
    assert_eq!((phase(&host), homers[0].begun()), (HomingPhase::Homing, 1), "it has begun meanwhile");
    lies.end();
    host.cycles(20);
    assert_eq!((phase(&host), host.counters().inputs_stale), (HomingPhase::Homing, 0));
    host.until("its own result", |host| phase(host) == HomingPhase::Idle);
    assert_eq!(homers[0].position(), 700);
}

/// In a network of 40 drives the search for a slave that is lost ends before the inputs of the others, which share its
/// datagrams, are stale: only the slaves behind the cut are lost.
#[test]
fn a_cut_cable_makes_no_other_slave_stale() {
    for reach in [1, 20, 39] {
        let (mut host, _, network) = in_op(drives(40));
        network.cut_after(reach);
        host.cycles(500);
        let lost = SlaveSet::first(40).difference(SlaveSet::first(reach));
        assert_eq!((host.board.engine().lost(), host.counters().inputs_stale), (lost, 0), "{reach}");
        network.heal();
        host.cycles(100).go(MasterState::Op);
        assert_eq!((host.board.engine().lost(), host.counters().inputs_stale), (SlaveSet::EMPTY, 0), "{reach}");
        assert!(host.counters().inputs_held < 40, "{:?}", host.counters());
    }
}
