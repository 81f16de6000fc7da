//! The bus of a network card: slave controllers behind this project's own master, in virtual time, over a wire that
//! loses frames.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use ecmsk::cia402::Mode;
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::engine::{EngineConfig, Event, EventKind};
use ecmsk::ethercat::{AlState, AlStatus, Command, DatagramHeader, FrameHeader, FrameWriter, SlaveSet};
use ecmsk::fieldbus::nic::{ChainWires, NicBus, NicWires, Ring};
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::fieldbus::{Ns, Role};
use ecmsk::master::{FrameBuffer, Settings, Wire, WireDown};
use ecmsk::sk::{MasterCommand, MasterState, Motion, SlaveCommand, StateByte};
use ecmsk::slave::esc::{CabledChain, EscSettings, EscSlave, eeprom_of};
use ecmsk::slave::{Drive, DriveConfig, Slave};

use crate::host::Host;
use crate::puppet::Puppet;

/// Losses of a wire: bit n is for the n-th frame from now on.
#[derive(Clone, Default)]
struct Losses {
    /// Frames that reach no slave.
    outward: Arc<AtomicU64>,
    /// Frames that have reached the slaves, and do not come back.
    homeward: Arc<AtomicU64>,
}

/// Takes the next bit.
fn next(bits: &AtomicU64) -> bool {
    let before = bits.load(Ordering::Relaxed);
    bits.store(before >> 1, Ordering::Relaxed);
    before & 1 != 0
}

struct LossyWires {
    wires: ChainWires,
    losses: Losses,
}

impl Wire for LossyWires {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        if next(&self.losses.outward) { Ok(()) } else { self.wires.send(frame) }
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        loop {
            let len = self.wires.receive(buffer)?;
            if !next(&self.losses.homeward) {
                return Some(len);
            }
        }
    }
}

impl NicWires for LossyWires {
    fn now(&self) -> Ns {
        self.wires.now()
    }

    fn wait(&mut self, until: Ns) {
        self.wires.wait(until);
    }

    fn is_real_time(&self) -> bool {
        false
    }
}

/// A board with these slaves at the end of a wire, in OP.
fn in_op(slaves: Vec<Box<dyn Slave>>) -> (Host, Losses) {
    in_op_reached_by(slaves, SimHandle::default())
}

/// The same, with a handle on its slaves and cables.
fn in_op_reached_by(slaves: Vec<Box<dyn Slave>>, network: SimHandle) -> (Host, Losses) {
    let losses = Losses::default();
    let count = slaves.len();
    let wires = ChainWires::new(slaves, network).expect("they have an EEPROM");
    let wires = LossyWires { wires, losses: losses.clone() };
    let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
    host.op(count);
    (host, losses)
}

/// NIC-2.3 Whatever frames are lost on the way out or back, each target reaches the slave in order, and none is
/// missing. The cycles are counted.
#[test]
fn no_target_is_left_out_when_frames_are_lost() {
    for (outward, homeward) in
        [(0b1, 0), (0, 0b1), (0b1010_0101, 0), (0, 0b0011_0110), (0b1001, 0b110_0000), (!0 >> 60, 0)]
    {
        let puppet = Puppet::obedient();
        let (mut host, losses) = in_op(vec![puppet.boxed()]);
        host.servo_on(1);
        for n in 1..=60 {
            host.csp(1, n * 10);
            if n == 20 {
                losses.outward.store(outward, Ordering::Relaxed);
                losses.homeward.store(homeward, Ordering::Relaxed);
            }
            host.cycles(1);
        }
        host.cycles(20);
        let expected: Vec<i32> = (1..=60).map(|n| n * 10).collect();
        assert_eq!(puppet.targets_from(10), expected, "{outward:b} {homeward:b}");
        let counters = host.counters();
        assert_eq!((counters.outputs_lost, counters.full, counters.for_lost), (0, 0, 0), "{counters:?}");
        // Some of the lost frames did not belong to a cycle.
        let lost = u64::from(outward.count_ones() + homeward.count_ones());
        assert!((1..=lost).contains(&counters.answers_lost), "{outward:b} {homeward:b}: {counters:?}");
    }
}

/// The report of a cycle shows the command of that cycle, as on a simulated network.
#[test]
fn an_answer_belongs_to_the_outputs_of_its_own_cycle() {
    let indices = |host: &mut Host| {
        host.servo_on(1);
        let mut shown = Vec::new();
        for n in 1..=40u8 {
            let command = SlaveCommand::Csp(Motion::to(n.into())).with_index(n);
            host.build(|frame, size| frame.put_slave(size, 1, &command)).cycles(1);
            shown.push(host.slot(1).index);
        }
        shown
    };
    let (mut on_wire, _) = in_op(vec![Puppet::obedient().boxed()]);
    let mut on_sim = Host::new(EngineConfig::default(), SimBus::new(vec![Puppet::obedient().boxed()]));
    on_sim.op(1);
    assert_eq!(indices(&mut on_wire), indices(&mut on_sim));
}

/// A drive with fixed process data, those of a drive at power-on.
struct Fixed {
    drive: Drive,
    /// An entry that differs from the drive's.
    other: Option<(ObjectAddress, u32)>,
    /// The abort code of writes to them.
    code: AbortCode,
    /// Whether it hides its assignments, too.
    hides_assignments: bool,
}

impl Slave for Fixed {
    support::hand_on_slave!(drive: name, state, enter, set_sync_managers, step, apply_fault, has_dc, shaft);

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        self.drive.exchange(outputs, inputs);
    }

    fn read(&mut self, object: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
        if self.hides_assignments && matches!(object.index, 0x1C12 | 0x1C13) {
            return Err(AbortCode::NO_OBJECT);
        }
        let len = self.drive.read(object, scope, value)?;
        if let Some((_, other)) = self.other.filter(|(at, _)| *at == object) {
            value[..len].copy_from_slice(&other.to_le_bytes()[..len]);
        }
        Ok(len)
    }

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        if (0x1600..0x1C14).contains(&object.index) {
            return Err(self.code);
        }
        self.drive.write(object, scope, value)
    }
}

/// A slave with fixed process data is used if they are the wanted ones, whatever its abort code for writes. Otherwise
/// it is refused, with the object that differs and the code.
#[test]
fn fixed_process_data_are_checked_instead_of_written() {
    let drive = || Drive::new(DriveConfig::default());
    for code in [
        AbortCode::READ_ONLY,
        AbortCode::UNSUPPORTED_ACCESS,
        AbortCode::DEVICE_STATE,
        AbortCode::VALUE_RANGE,
        AbortCode::NO_OBJECT,
        AbortCode::GENERAL,
    ] {
        let fixed = Fixed { drive: drive(), other: None, code, hides_assignments: false };
        let (mut host, _) = in_op(vec![Box::new(fixed)]);
        host.servo_on(1);
        for n in 1..=50 {
            host.csp(1, n * 10).cycles(1);
        }
        host.cycles(20);
        assert!((host.drive(1).position - 500).abs() <= 1, "{code}: {}", host.drive(1).position);
    }
    // Only its EEPROM gives the assignment.
    let settings = EscSettings::default();
    let eeprom = eeprom_of(&mut drive(), &settings).expect("it can be described");
    let hiding = Fixed { drive: drive(), other: None, code: AbortCode::NO_OBJECT, hides_assignments: true };
    let network = SimHandle::default();
    let mut cable =
        CabledChain::new(vec![Box::new(drive())], network.cable().clone()).expect("a drive can be described");
    cable.chain_mut().add(EscSlave::new(Box::new(hiding), settings, eeprom, 0), 0, 1);
    let wires = ChainWires::on_cable(cable, network);
    let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
    host.op(2);
    assert_eq!(host.state().0, 8, "OP");
    let code = AbortCode::VALUE_RANGE;
    let fixed = |other| Box::new(Fixed { drive: drive(), other, code, hides_assignments: false }) as Box<dyn Slave>;
    for (object, value) in [
        (ObjectAddress::new(0x1600, 2), 0x60FF_0020),
        (ObjectAddress::new(0x1A00, 0), 5),
        (ObjectAddress::new(0x1C12, 1), 0x1601),
    ] {
        let slaves = vec![fixed(Some((object, value)))];
        let wires = ChainWires::new(slaves, SimHandle::default()).expect("it has an EEPROM");
        let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
        host.declare_drives(1).master(MasterCommand::SetState(MasterState::Op));
        host.until("the failure", |host| host.board.engine().state_failure().is_some());
        let failure = host.board.engine().state_failure().expect("there is one").to_string();
        assert!(failure.contains("slave 1") && failure.contains(&object.to_string()), "{failure}");
        assert!(failure.contains(&format!("aborted with {code}")), "{failure}");
    }
}

/// A slave that answers is never reported as silent: it refuses without a reason, or an SDO to it times out.
#[test]
fn a_slave_that_answers_is_never_said_not_to() {
    let drive = || Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>;
    let board = |network: &SimHandle| {
        let wires = ChainWires::new(vec![drive()], network.clone()).expect("it has an EEPROM");
        let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
        host.declare_drives(1);
        host
    };
    let failure = |host: &mut Host| {
        host.master(MasterCommand::SetState(MasterState::Op));
        host.until("the failure", |host| host.board.engine().state_failure().is_some());
        host.board.engine().state_failure().expect("there is one").to_string()
    };
    let network = SimHandle::default();
    let mut host = board(&network);
    network.refuse(1, Some((AlState::SafeOp, AlStatus::NONE)));
    let said = failure(&mut host);
    assert!(said.contains("slave 1 answers, has not reached SafeOP"), "{said}");
    for code in [0x1A, 0x2C, 0x2D, 0x32, 0x70, 0x8123] {
        let network = SimHandle::default();
        let mut host = board(&network);
        network.refuse(1, Some((AlState::SafeOp, AlStatus(code))));
        let said = failure(&mut host);
        assert!(said.contains(&format!("slave 1 refused SafeOP: AL status {}", AlStatus(code))), "{said}");
    }
    let network = SimHandle::default();
    let mut host = board(&network);
    network.delay_sdo(1, 3_000_000_000);
    let said = failure(&mut host);
    assert!(said.contains("SDO 0x1C12:0 aborted with 0x05040000"), "{said}");
    let network = SimHandle::default();
    let mut host = board(&network);
    network.cut_after(0);
    let said = failure(&mut host);
    assert!(said.contains("does not answer"), "{said}");
}

/// Wires on which another master sends frames from a certain time on.
struct SharedWires {
    wires: ChainWires,
    is_shared: Arc<AtomicBool>,
}

const STRANGER: [u8; 6] = [0x12, 0, 0, 0, 0, 7];

impl Wire for SharedWires {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        self.wires.send(frame)
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        if !self.is_shared.swap(false, Ordering::Relaxed) {
            return self.wires.receive(buffer);
        }
        let mut frame = FrameWriter::new(buffer, FrameHeader::datagrams(STRANGER)).expect("room");
        frame.push(DatagramHeader::register(Command::Brd, 3, 0, 0x0130), &[2, 0]).expect("room");
        Some(frame.finish().len())
    }
}

impl NicWires for SharedWires {
    fn now(&self) -> Ns {
        self.wires.now()
    }

    fn wait(&mut self, until: Ns) {
        self.wires.wait(until);
    }

    fn is_real_time(&self) -> bool {
        false
    }
}

/// Another master that comes while the board runs is reported once, with its address. Losses on a cable are not
/// reported as those of a chip.
#[test]
fn another_master_is_named() {
    let is_shared = Arc::new(AtomicBool::new(false));
    let wires = ChainWires::new(vec![Puppet::obedient().boxed()], SimHandle::default()).expect("it has an EEPROM");
    let wires = SharedWires { wires, is_shared: Arc::clone(&is_shared) };
    let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
    host.op(1);
    let mark = host.mark();
    for _ in 0..3 {
        is_shared.store(true, Ordering::Relaxed);
        host.cycles(10);
    }
    let told: Vec<Event> = host.board.engine().events_since(mark).collect();
    let [Event { kind: EventKind::OtherMaster { address: STRANGER }, .. }] = told[..] else { panic!("{told:?}") };
    assert!(told[0].to_string().contains("12:00:00:00:00:07"), "{}", told[0]);
    let lost = Event { at: 0, kind: EventKind::OutputsLost { sets: 3, has_chip: false } }.to_string();
    assert!(!lost.contains("chip"), "{lost}");
}

/// NIC-2.8 Silence that is too short for the slaves' watchdogs is counted, and the user is not asked to check the
/// wires; longer silence is reported once.
#[test]
fn a_network_that_does_not_answer_is_told() {
    let network = SimHandle::default();
    let (mut host, _) = in_op_reached_by(vec![Box::new(Drive::new(DriveConfig::default()))], network.clone());
    let mut silent_for = |cycles| {
        let (mark, before) = (host.mark(), host.board.engine().counters().answers_lost);
        let told = |host: &Host| {
            host.board.engine().events_since(mark).filter(|event| matches!(event.kind, EventKind::BusDown)).count()
        };
        network.cut_after(0);
        host.cycles(cycles);
        let told_meanwhile = told(&host);
        network.heal();
        host.cycles(20);
        (told_meanwhile, told(&host), host.board.engine().counters().answers_lost - before)
    };
    assert_eq!(silent_for(60), (0, 0, 60));
    let (told_meanwhile, told, _) = silent_for(150);
    assert_eq!((told_meanwhile, told), (1, 1), "while it is silent, and once");
}

/// NIC-2.1 Several slaves are configured at once: each gets the board's writes, and the first one that refuses is
/// named.
#[test]
fn of_several_slaves_that_refuse_the_first_is_named() {
    let puppets: Vec<Puppet> = (0..20).map(|_| Puppet::obedient()).collect();
    let (host, _) = in_op(puppets.iter().map(Puppet::boxed).collect());
    assert_eq!(host.state().0, 8);
    assert!(puppets.iter().all(|puppet| puppet.strings().roles == [Role::Drive(Mode::Csp)]));

    for refusing in [&[3, 4][..], &[20, 7, 12], &[1]] {
        let handle = SimHandle::default();
        let slaves = (0..20).map(|_| Puppet::obedient().boxed()).collect();
        let wires = ChainWires::new(slaves, handle.clone()).expect("they have an EEPROM");
        let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
        let mode = ObjectAddress::new(0x6060, 0);
        for slave in refusing {
            handle.abort_object(*slave, Some((mode, AbortCode::VALUE_RANGE)));
        }
        host.declare_drives(20).master(MasterCommand::SetState(MasterState::Op));
        host.until("the failure", |host| host.board.engine().state_failure().is_some());
        let failure = host.board.engine().state_failure().expect("there is one").to_string();
        let first = refusing.iter().min().expect("one");
        assert!(failure.contains(&format!("slave {first} ")), "{refusing:?}: {failure}");
    }
}

/// A cycle of 40 drives in CSP allocates nothing, on one card or in a ring, whole or broken, and neither does a frame that is lost.
#[test]
fn cycles_allocate_nothing() {
    let drives = || crate::probe::drives(40);
    let chain = || {
        let network = SimHandle::default();
        (ChainWires::new(drives(), network.clone()).expect("they have an EEPROM"), network)
    };
    let losses = Losses::default();
    let (wires, _) = chain();
    let one = NicBus::new(LossyWires { wires, losses: losses.clone() }, Settings::default());
    let (mut wires, network) = chain();
    wires.connect_second(true);
    let ring = NicBus::new(Ring::new(wires, [4; 6]), Settings::default());
    let hosts = [Host::new(EngineConfig::default(), one), Host::new(EngineConfig::default(), ring)];
    for (mut host, kind) in hosts.into_iter().zip(["one card", "a ring"]) {
        host.op(40);
        host.build(|frame, size| {
            (1..=40).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::ServoOn.into()))
        });
        host.until("all on", |host| (1..=40).all(|slave| host.drive(slave).statusword.is_enabled()));
        let counted = allocation_counter::measure(|| {
            for n in 0..1000 {
                match n {
                    300 => losses.outward.store(0b1001, Ordering::Relaxed),
                    400 => network.cut_after(20),
                    700 => network.heal(),
                    _ => {}
                }
                host.build(|frame, size| {
                    for slave in 1..=40 {
                        frame.put_slave(size, slave, &SlaveCommand::Csp(Motion::to(n * slave as i32)).into());
                    }
                });
                host.cycle();
            }
        });
        assert_eq!((counted.count_total, counted.count_current), (0, 0), "{kind}: {counted:?}");
        host.drained().cycles(50);
        assert_eq!(host.drive(40).position, 999 * 40, "{kind}");
    }
}

/// NIC-2.13 A slave that is lost for some cycles and still in OP gets outputs that move no axis when it answers again,
/// until SET_STATE has brought it back.
#[test]
fn a_lost_slave_that_answers_again_holds() {
    let puppets = [Puppet::new(), Puppet::new()];
    let network = SimHandle::default();
    let wires = ChainWires::new(puppets.iter().map(Puppet::boxed).collect(), network.clone()).expect("an EEPROM");
    let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
    host.go(MasterState::Op);
    let write = |host: &mut Host, bits| {
        host.build(|frame, size| {
            [1, 2].into_iter().for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::IoWrite(bits).into()));
        });
    };
    write(&mut host, 0x11);
    host.drained().cycles(5);
    network.silence(2, true);
    host.until("the loss", |host| host.state() == StateByte::failed(Some(MasterState::Op)));
    network.silence(2, false);
    host.cycles(2);
    puppets[1].forget();
    write(&mut host, 0x22);
    host.cycles(20);
    assert_eq!(puppets[0].last().outputs, 0x22);
    assert!(puppets[1].strings().sent.iter().all(|out| out.outputs == 0), "it is lost");
    host.go(MasterState::Op);
    write(&mut host, 0x33);
    host.drained().cycles(10);
    assert_eq!(puppets.map(|puppet| puppet.last().outputs), [0x33, 0x33]);
}

/// A drive that leaves OP on the test's request, and whose controller takes outputs all the same.
struct Falling {
    puppet: Puppet,
    has_fallen: Arc<AtomicBool>,
}

impl Slave for Falling {
    support::hand_on_slave!(puppet: name, enter, read, step);

    fn state(&self) -> AlState {
        let state = self.puppet.state();
        if self.has_fallen.load(Ordering::Relaxed) { state.min(AlState::SafeOp) } else { state }
    }

    fn al_status(&self) -> AlStatus {
        AlStatus::FATAL_SYNC
    }

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.puppet.write(object, scope, value)
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        let has_fallen = self.has_fallen.load(Ordering::Relaxed);
        self.puppet.exchange(outputs.filter(|_| !has_fallen), inputs);
    }
}

/// Slaves 1 to 3 have fallen to SafeOP for want of outputs, are lost, and answer there; the fourth one is on.
fn beside_three_fallen(fourth: Box<dyn Slave>) -> (SimHandle, Host, Losses) {
    let mut slaves: Vec<Box<dyn Slave>> = (0..3).map(|_| Puppet::obedient().boxed()).collect();
    slaves.push(fourth);
    let network = SimHandle::default();
    let (mut host, losses) = in_op_reached_by(slaves, network.clone());
    host.servo_on(4);
    (1..=3).for_each(|slave| network.silence(slave, true));
    host.cycles(200);
    (1..=3).for_each(|slave| network.silence(slave, false));
    host.cycles(300);
    assert_eq!(host.board.engine().lost(), SlaveSet::first(3));
    (network, host, losses)
}

/// Commands that were counted as not executed.
fn counted(host: &Host) -> u64 {
    host.counters().outputs_lost + host.counters().for_lost
}

/// The number of targets 10, 20, ... that did not arrive.
fn missed(puppet: &Puppet, last: i32) -> u64 {
    let targets = puppet.targets();
    (1..=last).filter(|n| !targets.contains(&(n * 10))).count() as u64
}

/// A slave leaves OP while others are already lost in that state, since it got no frame for too long. It is reported
/// with all commands that it missed, although the others add to the working counter and have the same AL status.
#[test]
fn what_a_slave_misses_that_falls_behind_lost_ones_is_counted() {
    let puppet = Puppet::obedient();
    let (_, mut host, losses) = beside_three_fallen(puppet.boxed());
    host.csp(4, 10).cycles(5);
    let (before, for_lost) = (counted(&host), host.counters().for_lost);
    host.csp(4, 20);
    for _ in 0..200 {
        losses.outward.store(!0, Ordering::Relaxed);
        host.cycles(1);
    }
    losses.outward.store(0, Ordering::Relaxed);
    host.cycles(200);
    assert_eq!(host.board.engine().lost(), SlaveSet::first(4));
    assert_eq!((missed(&puppet, 2), counted(&host) - before), (1, 1), "{:?}", host.counters());
    assert_eq!(host.counters().for_lost - for_lost, 1, "the slave is named for it");
}

/// Outputs for a slave that is silent for some cycles while others are lost count as lost sets, or as lost with the
/// slave if it is named. Earlier and later outputs do not.
#[test]
fn what_a_slave_misses_beside_lost_ones_is_counted() {
    for silent in [1, 2, 5] {
        let puppet = Puppet::obedient();
        let (network, mut host, _) = beside_three_fallen(puppet.boxed());
        let before = counted(&host);
        for n in 1..=60 {
            network.silence(4, (21..21 + silent).contains(&n));
            host.csp(4, n * 10).cycles(1);
        }
        host.cycles(50);
        let (missed, counted) = (missed(&puppet, 60), counted(&host) - before);
        assert!(missed >= silent as u64, "{missed}");
        assert!((missed..missed + 5).contains(&counted), "{missed} missed, {counted} counted: {:?}", host.counters());
    }
}

/// A slave that leaves OP, still takes part in cycles, and has the AL status of lost ones is seen when the states are
/// read the next time: outputs sent since the last reading count as lost with it.
#[test]
fn what_a_slave_misses_that_nobody_sees_fall_is_counted() {
    let (puppet, has_fallen) = (Puppet::obedient(), Arc::new(AtomicBool::new(false)));
    let falling = Falling { puppet: puppet.clone(), has_fallen: Arc::clone(&has_fallen) };
    let (_, mut host, _) = beside_three_fallen(Box::new(falling));
    let before = counted(&host);
    for n in 1..=500 {
        has_fallen.store(n >= 251, Ordering::Relaxed);
        host.csp(4, n * 10).cycles(1);
    }
    host.cycles(50);
    assert_eq!(host.board.engine().lost(), SlaveSet::first(4));
    let (missed, counted) = (missed(&puppet, 500), counted(&host) - before);
    assert!((249..=251).contains(&missed), "{missed}");
    assert!((missed..missed + 250).contains(&counted), "{missed} missed, {counted} counted: {:?}", host.counters());
}
