//! The duration of a program's start over an ECM-XF, compared with the simulated bus, in the board's time. The work
//! that is done ahead of SET_STATE is invisible to programs.

use std::sync::{Arc, Mutex};

use ecmsk::cia402::Mode;
use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::engine::{EngineConfig, StateFailure};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::xf::{XfBus, XfBusOptions};
use ecmsk::fieldbus::{AlState, Ns};
use ecmsk::sk::{CycleTime, DcShift, MasterCommand, MasterState, SlaveCommand, SlaveKind, StateByte};
use ecmsk::slave::handle::SimHandle;
use ecmsk::slave::{AlStatus, Slave};
use ecmsk::xf::chip::{Chip, Controllers, Profile, SlaveModels};
use ecmsk::xf::host::{HostConfig, Wires};
use ecmsk::xf::{CommandCode, HEADER_LEN};
use support::chip_line::{ChipLine, xf_bus, xf_bus_reached_by};
use support::start::{Program, Start, Took, times};

use crate::host::Host;

/// The packets on the wires of a chip.
#[derive(Clone, Copy, Debug, Default)]
struct Traffic {
    /// The numbers of SDO_REQ, STATE_SET and RECONFIG packets, without repetitions.
    sdos: u64,
    states: u64,
    layouts: u64,
}

/// Wires that count packets.
struct Counted<W> {
    wires: W,
    traffic: Arc<Mutex<Traffic>>,
    newest: (u8, u8),
}

impl<W: Wires> Wires for Counted<W> {
    type Error = W::Error;

    fn now(&self) -> Ns {
        self.wires.now()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), W::Error> {
        let mut traffic = self.traffic.lock().unwrap();
        if to_chip.len() > HEADER_LEN {
            let packet = (to_chip[0x0B], to_chip[0x0C]);
            if std::mem::replace(&mut self.newest, packet) != packet {
                match CommandCode::from_code(packet.1) {
                    CommandCode::SdoRequest => traffic.sdos += 1,
                    CommandCode::StateSet => traffic.states += 1,
                    CommandCode::Reconfig => traffic.layouts += 1,
                    _ => {}
                }
            }
        }
        drop(traffic);
        self.wires.exchange(to_chip, from_chip)
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), W::Error> {
        self.wires.wait_until(time)
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, W::Error> {
        self.wires.wait_ready(until)
    }
}

/// A bus over a chip of that profile, and its traffic.
fn counted(
    profile: Profile,
    slaves: Vec<Box<dyn Slave>>,
) -> (XfBus<Counted<ChipLine<SlaveModels>>>, Arc<Mutex<Traffic>>) {
    let traffic = Arc::default();
    let wires = ChipLine::new(Chip::new(profile, SlaveModels::new(slaves)));
    let wires = Counted { wires, traffic: Arc::clone(&traffic), newest: (0, 0) };
    let size_is_fixed = profile.size_is_fixed;
    let clock_hz = (!size_is_fixed).then_some(24_000_000);
    let options = XfBusOptions { clock_hz, size_is_fixed, ..XfBusOptions::DEFAULT };
    let config = HostConfig { size: Some(profile.size), ..HostConfig::DEFAULT };
    (XfBus::new(wires, config, options), traffic)
}

/// How long SafeOP takes, and OP from there, on the simulated bus and over a chip as links have it by default.
fn both(start: &Start) -> [[Took; 2]; 2] {
    [times(start, SimBus::new(start.slaves())), times(start, xf_bus(start.slaves(), XfBusOptions::DEFAULT))]
}

/// Starts of many kinds, as far as the slaves have their mapping by default.
fn starts() -> [(&'static str, Start); 5] {
    [
        ("a drive", Start::of_drives(1)),
        ("9 drives", Start::of_drives(9)),
        ("40 drives", Start::of_drives(40)),
        ("40 of all kinds", Start::of_forty_mixed()),
        ("40 drives, one declared none", Start::of_drives(40).without(&[20])),
    ]
}

/// XF-20.9 A program that rests between its declarations and SET_STATE reaches SafeOP within 1.2 times a board's time.
#[test]
fn behind_a_rest_safeop_comes_as_soon_as_on_a_board() {
    for (name, start) in starts() {
        let [[board, _], [chip, _]] = both(&start.resting(2500));
        assert!(chip.ns * 10 <= board.ns * 12, "{name}: {} and {} ms", board.ms(), chip.ms());
    }
}

/// XF-20.9 With exactly the pauses of the vendor's samples, 2 ms between two frames and none before SET_STATE, nothing can be
/// done ahead: the SDOs of the configuration, each a command of the chip, and the layout are all still to come. The test shows
/// how much longer than on a board SafeOP takes then, and the rest after which it comes within 1.2 times a board's time.
#[test]
fn how_long_safeop_takes_by_the_pauses_of_a_program() {
    for (name, start, per_cent_at_once, enough_ms) in [
        ("9 drives", Start::of_drives(9), 180, 400),
        ("40 drives", Start::of_drives(40), 280, 2000),
        ("40 of all kinds", Start::of_forty_mixed(), 300, 2300),
    ] {
        for (rest_ms, per_cent) in [(0, per_cent_at_once), (enough_ms, 120)] {
            let [[board, _], [chip, _]] = both(&start.clone().resting(rest_ms));
            let line = format!("{name}, rest {rest_ms}: {} and {} ms", board.ms(), chip.ms());
            assert!(chip.ns * 100 <= board.ns * per_cent, "{line}");
        }
    }
}

/// XF-20.9 For drives whose mode has its own PDO with the right entries, only its assignment is written. The layout is
/// made ahead if it is as long as the present assignment, as for velocities; a torque is shorter, and is laid out after
/// it. XF-19.16 Its four objects are then read again.
#[test]
fn drives_in_csv_are_written_the_assignment_alone() {
    let drives = |mode, drives| Start { mode, ..Start::of_drives(drives) }.resting(2500);
    for (mode, layouts, read_again) in [(Mode::Csv, [1, 0], 0), (Mode::Cst, [0, 1], 4)] {
        let start = drives(mode, 9);
        let (bus, traffic) = counted(Profile::NEW, start.slaves());
        let mut program = Program::new(bus);
        program.declare(&start);
        let before = *traffic.lock().unwrap();
        program.go(MasterState::SafeOp);
        let after = *traffic.lock().unwrap();
        // The mode, the assignment: its count away, its entry, its count.
        let sdos = after.sdos - before.sdos;
        assert_eq!((sdos, [before.layouts, after.layouts - before.layouts]), ((4 + read_again) * 9, layouts));
    }
    // Each of these SDOs takes 3.5 ms, which no rest hides: a program would see an earlier write by SDO.
    for (count, per_cent) in [(9, 120), (40, 165)] {
        let [[board, _], [chip, _]] = both(&drives(Mode::Csv, count));
        assert!(chip.ns * 100 <= board.ns * per_cent, "{count}: {} and {} ms", board.ms(), chip.ms());
    }
}

/// XF-20.9 A program that gives up after 1000 reports, as those of the vendor's samples do, has 9 drives in SafeOP by then,
/// with any firmware, even without a rest.
#[test]
fn nine_drives_are_there_before_a_program_gives_up() {
    let start = Start::of_drives(9);
    for profile in [Profile::NEW, Profile::OLD, Profile::XFU] {
        let took = times(&start, counted(profile, start.slaves()).0);
        assert!(took.iter().all(|took| took.reports <= 900), "{profile:?}: {took:?}");
    }
}

/// XF-20.9 SK-4.57 Forty slaves of any kinds, some of them declared none, are in OP within 6 s, without a rest.
#[test]
fn forty_of_any_kinds_are_in_op_within_6_s() {
    let none = [5, 12, 19, 26, 33, 40];
    let more = [
        ("40 drives, six declared none", Start::of_drives(40).without(&none)),
        ("40 of all kinds, one declared none", Start::of_forty_mixed().without(&[20])),
        ("40 of all kinds, six declared none", Start::of_forty_mixed().without(&none)),
        ("40 drives in CSV", Start { mode: Mode::Csv, ..Start::of_drives(40) }),
        ("40 pulse modules", Start::of(vec![SlaveKind::Hsp; 40])),
    ];
    for (name, start) in starts().into_iter().chain(more) {
        let took = times(&start, xf_bus(start.slaves(), XfBusOptions::DEFAULT));
        let ns: Ns = took.iter().map(|took| took.ns).sum();
        assert!(ns < 6_000_000_000, "{name}: {took:?}");
    }
}

/// XF-20.9 Work done ahead is not repeated: after a rest one SDO goes to each drive, that of its mode, the process data
/// are laid out already, and all go to SafeOP by one command.
#[test]
fn what_was_done_ahead_is_not_done_again() {
    let start = Start::of_drives(9).resting(1000);
    let (bus, traffic) = counted(Profile::NEW, start.slaves());
    let mut program = Program::new(bus);
    program.declare(&start);
    let before = *traffic.lock().unwrap();
    program.go(MasterState::SafeOp);
    let after = *traffic.lock().unwrap();
    let went = [after.sdos - before.sdos, after.layouts - before.layouts, after.states - before.states];
    assert_eq!((before.layouts, went), (1, [9, 0, 1]));
}

/// A board over a chip, and the handle on its slaves.
fn board(slaves: Vec<Box<dyn Slave>>) -> (Host, SimHandle) {
    let handle = SimHandle::default();
    (Host::new(EngineConfig::default(), xf_bus_reached_by(slaves, handle.clone(), XfBusOptions::DEFAULT)), handle)
}

fn drives(n: usize) -> Vec<Box<dyn Slave>> {
    Start::of_drives(n).slaves()
}

/// Runs the same program on a board and over a chip, and compares what it has seen, and its objects in the end.
fn same(slaves: usize, program: impl Fn(&mut Host, &SimHandle) -> Vec<String>) {
    let sim = SimBus::new(drives(slaves));
    let network = sim.handle();
    let on_board = program(&mut Host::new(EngineConfig::default(), sim), &network);
    let (mut host, network) = board(drives(slaves));
    assert_eq!(program(&mut host, &network), on_board);
}

/// Objects that a configuration writes.
const WRITTEN: [(u16, u8); 9] = [
    (0x6060, 0),
    (0x1C12, 0),
    (0x1C12, 1),
    (0x1600, 0),
    (0x1600, 1),
    (0x1601, 1),
    (0x1C13, 1),
    (0x1A00, 4),
    (0x1C32, 1),
];

fn objects(host: &mut Host, slave: u8) -> String {
    let values = WRITTEN.map(|(index, sub)| {
        let value = host.read_object(slave, index, sub);
        // Another answer first, so that the slot does not show the next object already.
        let _ = host.read_object(slave, 0x1000, 0);
        value
    });
    format!("{values:X?}")
}

/// SK-7.34 XF-19.1 A program that reads the objects of its drives between SET_AXIS and SET_STATE reads the same values
/// as on a board, at any time, and for every mode of the drives. So it does in SafeOP, and in PreOP again.
#[test]
fn no_sdo_shows_what_is_done_ahead() {
    for mode in [Mode::Csp, Mode::Csv] {
        for rest in [0, 12, 25, 60, 300] {
            same(3, |host, _| {
                host.declare_drives(3);
                for slave in 1..=3 {
                    host.slave(slave, SlaveCommand::DriveMode { mode, sync: ecmsk::sk::DriveSync::DcSync });
                }
                let mut seen = vec![objects(host.cycles(rest), 1), objects(host.cycles(rest), 3)];
                host.go(MasterState::SafeOp);
                seen.push(objects(host, 3));
                host.go(MasterState::PreOp).cycles(rest);
                seen.push(objects(host, 3));
                seen
            });
        }
    }
}

/// SK-7.34 XF-19.1 A program's SDO writes while its network is prepared count as on a board: the board's own mode and
/// its own mapping come behind it.
#[test]
fn a_write_that_comes_meanwhile_is_written_over() {
    use ecmsk::coe::SdoSize::{One, Two};
    for rest in [0, 12, 25, 60, 300] {
        for (index, sub, size, value) in [(0x6060, 0, One, 6), (0x1C12, 0, One, 0), (0x1C32, 1, Two, 0)] {
            same(3, |host, _| {
                host.declare_drives(3).cycles(rest);
                let written = host.write_object(2, index, sub, size, value);
                host.cycles(rest).go(MasterState::SafeOp);
                let seen = objects(host, 2);
                host.go(MasterState::Op).drained().servo_on(2).csp(2, 5000).drained().cycles(300);
                vec![format!("{written:?}"), seen, host.drive(2).position.to_string()]
            });
        }
    }
}

/// XF-19.1 SET_AXIS changes the declaration while the network is prepared for the old one: the declaration at SET_STATE
/// counts.
#[test]
fn declarations_that_change_meanwhile_count() {
    for rest in [3, 12, 25, 60, 100, 150, 200, 300] {
        same(4, |host, _| {
            host.declare_drives(4).cycles(rest);
            let mut kinds = [SlaveKind::Drive; 8];
            kinds[1] = SlaveKind::Io;
            host.master(MasterCommand::SetAxis { group: 0, kinds }).cycles(rest);
            host.master(MasterCommand::SetState(MasterState::SafeOp));
            host.until("the failure", |host| host.state() == StateByte::failed(Some(MasterState::PreOp)));
            let failure = format!("{:?}", host.board.engine().state_failure());
            kinds[1] = SlaveKind::None;
            let cycle = CycleTime::from_us(2000).unwrap();
            host.master(MasterCommand::SetAxis { group: 0, kinds });
            host.master(MasterCommand::SetDc { cycle, shift: DcShift::Auto }).cycles(rest);
            host.go(MasterState::Op).drained().servo_on(3).csp(3, 4000).drained().cycles(300);
            vec![failure, host.drive(3).position.to_string(), host.drive(2).statusword.0.to_string()]
        });
    }
}

/// XF-20.9 SK-4.55 A slave that vanishes while its network is prepared is missed when SET_STATE comes, and not before; when it is
/// back the next SET_STATE has all of them.
#[test]
fn a_slave_that_vanishes_meanwhile_is_missed() {
    for rest in [0, 5, 12, 25, 60, 100, 200, 1500] {
        let (mut host, network) = board(drives(4));
        host.declare_drives(4).cycles(20);
        network.silence(3, true);
        host.cycles(rest);
        assert_eq!(host.state(), StateByte::reached(MasterState::PreOp));
        host.master(MasterCommand::SetState(MasterState::SafeOp));
        host.until("the failure", |host| host.state() == StateByte::failed(Some(MasterState::PreOp)));
        assert_eq!(host.board.engine().state_failure(), Some(StateFailure::Silent { slave: 3 }), "{rest}");
        network.silence(3, false);
        host.go(MasterState::Op).drained().servo_on(3);
    }
}

/// XF-19.1 A slave that refuses SafeOP is reported as on a board, whether its network was prepared or not.
#[test]
fn a_slave_that_refuses_is_told_as_on_a_board() {
    for rest in [0, 300] {
        same(3, |host, network| {
            network.refuse(2, Some((AlState::SafeOp, AlStatus(0x001E))));
            host.declare_drives(3).cycles(rest).master(MasterCommand::SetState(MasterState::SafeOp));
            host.until("the failure", |host| host.state() == StateByte::failed(Some(MasterState::PreOp)));
            let refused = format!("{:?}", host.board.engine().state_failure());
            network.refuse(2, None);
            host.go(MasterState::Op);
            vec![refused]
        });
    }
}

/// XF-19.1 A slave that aborts the SDOs of a configuration is reported with the first one that matters, whether its
/// network was prepared or not.
#[test]
fn a_slave_that_aborts_is_told_all_the_same() {
    let failure = |rest| {
        let (mut host, network) = board(drives(3));
        network.abort_sdo(2, Some(AbortCode::DEVICE_STATE));
        host.declare_drives(3).cycles(rest).master(MasterCommand::SetState(MasterState::SafeOp));
        host.until("the failure", |host| host.state() == StateByte::failed(Some(MasterState::PreOp)));
        let failure = host.board.engine().state_failure();
        network.abort_sdo(2, None);
        host.go(MasterState::Op);
        failure
    };
    let expected = failure(0);
    assert!(expected.is_some());
    assert_eq!([12, 60, 300].map(failure), [expected; 3]);
}

/// XF-19.1 SW_RESET while the network is prepared: the board boots, knows of no declaration any more, and starts as at first.
#[test]
fn a_reset_meanwhile_is_one_like_any_other() {
    for rest in [3, 12, 25, 60, 100, 200, 500] {
        let (mut host, _) = board(drives(4));
        host.declare_drives(4).cycles(rest).soft_reset();
        host.op(4).servo_on(4).csp(4, 2000).drained().cycles(300);
        assert!((host.drive(4).position - 2000).abs() <= 131, "{rest}");
    }
}

/// XF-19.1 After a stall of the PC the preparation of the network goes on.
#[test]
fn a_stall_meanwhile_costs_nothing_but_time() {
    for rest in [12, 25, 60, 100, 200] {
        let bus = xf_bus(drives(4), XfBusOptions::DEFAULT);
        let clock = Arc::clone(&bus.wires().clock);
        let mut host = Host::new(EngineConfig::default(), bus);
        host.declare_drives(4).cycles(rest);
        clock.fetch_add(700_000_000, std::sync::atomic::Ordering::Relaxed);
        host.cycles(rest).go(MasterState::Op).drained().servo_on(4);
    }
}

/// XF-19.1 An SDO that comes while the network is prepared is answered soon: it waits for the layout at most.
#[test]
fn an_sdo_meanwhile_does_not_wait_long() {
    for rest in 1..40 {
        let (mut host, _) = board(drives(4));
        host.declare_drives(4).cycles(5 * rest);
        let since = host.board.now();
        assert_eq!(host.read_object(2, 0x1000, 0).map(|kind| kind & 0xFFFF), Ok(402));
        let took_ms = (host.board.now() - since) / 1_000_000;
        assert!(took_ms < 90, "{took_ms} ms behind {} ms", 5 * rest);
    }
}

/// A drive, and the highest state that it reached.
struct Highest(Box<dyn Slave>, Arc<Mutex<AlState>>);

impl Slave for Highest {
    support::hand_on_slave!(0: name, state, read, set_sync_managers, step, begin_step, end_step, has_dc, shaft);

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        self.0.enter(target)?;
        let mut highest = self.1.lock().unwrap();
        *highest = target.max(*highest);
        Ok(())
    }

    fn write(&mut self, object: ObjectAddress, scope: ecmsk::coe::SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.0.write(object, scope, value)
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        self.0.exchange(outputs, inputs);
    }

    fn set_sync_cycle(&mut self, cycle_ns: Option<Ns>) {
        self.0.set_sync_cycle(cycle_ns);
    }
}

/// SK-4.57 XF-20.9 Slaves that are declared none go to SafeOP with the others at most, and are back in PreOP when the others are there;
/// in OP they never are.
#[test]
fn slaves_declared_none_come_back_to_preop() {
    let highest: [Arc<Mutex<AlState>>; 2] = Default::default();
    let mut slaves = drives(6);
    for (slave, highest) in [2, 5].into_iter().zip(&highest) {
        slaves.insert(slave, Box::new(Highest(drives(1).remove(0), Arc::clone(highest))));
    }
    let mut kinds = [SlaveKind::Drive; 8];
    (kinds[2], kinds[5]) = (SlaveKind::None, SlaveKind::None);
    let (mut host, network) = board(slaves);
    host.master(MasterCommand::SetAxis { group: 0, kinds });
    for _ in 0..2 {
        host.go(MasterState::SafeOp).cycles(50).go(MasterState::Op).drained().servo_on(1);
        assert_eq!(highest.each_ref().map(|highest| *highest.lock().unwrap()), [AlState::SafeOp; 2]);
        // From PreOP on objects of a mapping can be written: they are there.
        for slave in [3, 6] {
            let written = host.write_object(slave, 0x1C12, 0, ecmsk::coe::SdoSize::One, 0);
            assert_eq!(written, Ok(0));
            let _ = host.read_object(slave, 0x1000, 0);
        }
        host.go(MasterState::PreOp);
    }
    // A slave that refuses SafeOP holds up no other one, and neither does one that stays there.
    network.refuse(3, Some((AlState::SafeOp, AlStatus(0x001E))));
    network.refuse(6, Some((AlState::PreOp, AlStatus(0x0011))));
    host.go(MasterState::Op).drained().servo_on(8);
}

/// XF-20.9 A change of state that is reversed while slaves declared none are in SafeOP with the others leaves them in
/// PreOP.
#[test]
fn a_change_taken_back_leaves_nobody_behind() {
    for cycles in (200..800).step_by(40) {
        let (mut host, _) = board(drives(4));
        let mut kinds = [SlaveKind::Drive; 8];
        kinds[2] = SlaveKind::None;
        host.master(MasterCommand::SetAxis { group: 0, kinds }).cycles(20);
        host.master(MasterCommand::SetState(MasterState::SafeOp)).cycles(cycles).go(MasterState::PreOp);
        host.cycles(10).go(MasterState::Op).drained();
        let written = host.write_object(3, 0x1C12, 0, ecmsk::coe::SdoSize::One, 0);
        assert_eq!(written, Ok(0), "{cycles}");
    }
}

/// XF-19.5 A chip whose packets cannot be changed, which the link does not know, is used with its packets.
#[test]
fn a_chip_that_keeps_its_packets_is_used_as_it_is() {
    let profile = Profile { size_is_fixed: true, ..Profile::NEW };
    let chip = Chip::new(profile, SlaveModels::new(drives(2)));
    let bus = XfBus::new(ChipLine::new(chip), HostConfig::DEFAULT, XfBusOptions::DEFAULT);
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(2).servo_on(2);
}

/// XF-19.1 The same with real frames behind the chip.
#[test]
fn with_frames_behind_the_chip() {
    for (rest_ms, most) in [(0, 900), (1500, 500)] {
        let start = Start::of_drives(9).resting(rest_ms);
        let network = Controllers::new(start.slaves(), SimHandle::default()).expect("drives have an EEPROM");
        let options = XfBusOptions { clock_hz: Some(24_000_000), ..XfBusOptions::DEFAULT };
        let config = HostConfig { size: Some(Profile::NEW.size), ..HostConfig::DEFAULT };
        let bus = XfBus::new(ChipLine::new(Chip::new(Profile::NEW, network)), config, options);
        let took = times(&start, bus);
        assert!(took[0].ms() <= most, "rest {rest_ms}: {took:?}");
    }
}
