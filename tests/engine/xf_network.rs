//! The commands by which a board over an ECM-XF sets up the chip's network: Init first if it is up, and SYNC0 for the slaves
//! that run with distributed clocks.

use std::convert::Infallible;
use std::sync::{Arc, Mutex};

use ecmsk::cia402::Mode;
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::Ns;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::xf::{XfBus, XfBusOptions};
use ecmsk::sk::{CycleTime, DcShift, DriveSync, MasterCommand, MasterState, SlaveCommand};
use ecmsk::slave::{Drive, DriveConfig, Slave};
use ecmsk::xf::chip::{Chip, Profile, SlaveModels};
use ecmsk::xf::host::{HostConfig, Wires};
use ecmsk::xf::{CommandCode, HEADER_LEN};
use support::chip_line::ChipLine;

use crate::host::Host;
use crate::probe::drives;

/// A packet on the wires: its code, its parameter, information byte 0, its reserve, and the first 8 bytes of its data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Packet {
    code: CommandCode,
    parameter: u8,
    information: u8,
    reserve: u16,
    data: [u8; 8],
}

type Log = Arc<Mutex<Vec<Packet>>>;

/// Wires that log packets, without repetitions.
struct Logged {
    wires: ChipLine<SlaveModels>,
    log: Log,
    newest: (u8, u8),
}

impl Wires for Logged {
    type Error = Infallible;

    fn now(&self) -> Ns {
        self.wires.now()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), Infallible> {
        if to_chip.len() > HEADER_LEN + 8 {
            let packet = (to_chip[0x0B], to_chip[0x0C]);
            if std::mem::replace(&mut self.newest, packet) != packet {
                let data = to_chip[HEADER_LEN..HEADER_LEN + 8].try_into().unwrap();
                let (code, parameter, information) = (CommandCode::from_code(packet.1), to_chip[0x0D], to_chip[0x04]);
                let reserve = u16::from_le_bytes([to_chip[0x08], to_chip[0x09]]);
                self.log.lock().unwrap().push(Packet { code, parameter, information, reserve, data });
            }
        }
        self.wires.exchange(to_chip, from_chip)
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), Infallible> {
        self.wires.wait_until(time)
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, Infallible> {
        self.wires.wait_ready(until)
    }
}

fn board(slaves: Vec<Box<dyn Slave>>) -> (Host, Log) {
    let log = Log::default();
    let line = ChipLine::new(Chip::new(Profile::NEW, SlaveModels::new(slaves)));
    let wires = Logged { wires: line, log: Arc::clone(&log), newest: (0, 0) };
    let options = XfBusOptions { clock_hz: Some(24_000_000), ..XfBusOptions::DEFAULT };
    let config = HostConfig { size: Some(Profile::NEW.size), ..HostConfig::DEFAULT };
    (Host::new(EngineConfig::default(), XfBus::new(wires, config, options)), log)
}

/// Takes the log, and returns the codes up to ECAT_INIT_OP that belong to the start of a network, with what they ask for:
/// the parameter, or the state of STATE_SET.
fn start(log: &Log) -> Vec<(CommandCode, u8)> {
    use CommandCode::{EcatInit, FifoClear, FifoEnable, StateSet};
    let packets = std::mem::take(&mut *log.lock().unwrap());
    let end = packets.iter().position(|packet| packet.code == EcatInit).expect("the network is initialised");
    let of_start = |packet: &&Packet| matches!(packet.code, EcatInit | FifoClear | FifoEnable | StateSet);
    let asked = |Packet { code, parameter, information, .. }: &Packet| {
        (*code, if *code == StateSet { *information } else { *parameter })
    };
    packets[..=end].iter().filter(of_start).map(asked).collect()
}

/// XF-19.17 The start of a network as applications have it: FIFO off (18), cleared (51), state Init (12) if a network was up,
/// ECAT_INIT (1). It is up when a board is reset in any state, and when the cycle time changes.
#[test]
fn a_network_that_is_up_goes_to_init_first() {
    use CommandCode::{EcatInit, FifoClear, FifoEnable, StateSet};
    let (mut host, log) = board(drives(2));
    assert!(start(&log).ends_with(&[(FifoEnable, 0), (FifoClear, 0), (EcatInit, 0)]), "nothing was up");
    let after_init = [(FifoEnable, 0), (FifoClear, 0), (StateSet, 1), (EcatInit, 0)];
    for state in [MasterState::PreOp, MasterState::SafeOp, MasterState::Op] {
        host.declare_drives(2).go(state);
        log.lock().unwrap().clear();
        host.soft_reset();
        let seen = start(&log);
        assert!(seen.ends_with(&after_init), "{state}: {seen:?}");
    }
    host.master(MasterCommand::SetDc { cycle: CycleTime::from_us(2000).unwrap(), shift: DcShift::Auto });
    host.declare_drives(2).go(MasterState::SafeOp);
    let seen = start(&log);
    assert!(seen.ends_with(&after_init), "another cycle: {seen:?}");
    host.go(MasterState::Op).drained().servo_on(2);
}

/// XF-19.19 The chip's own clock is the reference clock (bit 12 of the reserve of ECAT_INIT_OP is 0: no master shift), so a
/// snapshot of the board names no slave.
#[test]
fn the_reference_clock_is_the_chips() {
    let (mut host, log) = board(drives(2));
    let packets = std::mem::take(&mut *log.lock().unwrap());
    let init = packets.iter().find(|packet| packet.code == CommandCode::EcatInit).expect("the network is initialised");
    assert_eq!(init.reserve & 1 << 12, 0);
    host.op(2);
    assert_eq!(host.board.snapshot().reference_clock, None);
}

/// A drive, and the SYNC0 cycle that it has got.
struct Clocked(Drive, Arc<Mutex<Option<Ns>>>);

impl Slave for Clocked {
    support::hand_on_slave!(0: name, state, enter, read, set_sync_managers, step, begin_step, end_step, has_dc, shaft);

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.0.write(object, scope, value)
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        self.0.exchange(outputs, inputs);
    }

    fn set_sync_cycle(&mut self, cycle_ns: Option<Ns>) {
        *self.1.lock().unwrap() = cycle_ns;
        self.0.set_sync_cycle(cycle_ns);
    }
}

/// Three such drives; the cycle that each has.
fn clocked() -> (Vec<Box<dyn Slave>>, impl Fn() -> [Option<Ns>; 3]) {
    let cycles: [Arc<Mutex<Option<Ns>>>; 3] = Default::default();
    let slave = |cycle: &Arc<Mutex<Option<Ns>>>| -> Box<dyn Slave> {
        Box::new(Clocked(Drive::new(DriveConfig::default()), Arc::clone(cycle)))
    };
    let slaves = cycles.iter().map(slave).collect();
    (slaves, move || cycles.each_ref().map(|cycle| *cycle.lock().unwrap()))
}

/// Declares which drives run free, and brings them to OP with that cycle; the SYNC0 cycles that they have then.
fn run(host: &mut Host, free: [bool; 3], us: u32, cycles: &impl Fn() -> [Option<Ns>; 3]) -> [Option<Ns>; 3] {
    host.go(MasterState::PreOp).declare_drives(3);
    host.master(MasterCommand::SetDc { cycle: CycleTime::from_us(us).unwrap(), shift: DcShift::Auto });
    for (slave, free) in (1..).zip(free) {
        let sync = if free { DriveSync::FreeRun } else { DriveSync::DcSync };
        host.slave(slave, SlaveCommand::DriveMode { mode: Mode::Csp, sync });
    }
    host.go(MasterState::Op).drained().servo_on(1).servo_on(3);
    cycles()
}

/// XF-19.18 DRIVE_MODE with Data2 = 0, free run: the slave gets no SYNC0, as on a board, and the others get it. It may change
/// from one start to the next, with the cycle time and without.
#[test]
fn a_slave_that_runs_free_gets_no_sync0() {
    let starts = [
        ([false, false, false], 1000),
        ([true, false, false], 1000),
        ([true, false, true], 1000),
        ([false, true, true], 1000),
        ([false, true, true], 2000),
        ([false, false, false], 2000),
    ];
    let (slaves, cycles) = clocked();
    let mut over_board = Host::new(EngineConfig::default(), SimBus::new(slaves));
    let (slaves, over_chip_cycles) = clocked();
    let (mut over_chip, _) = board(slaves);
    for (free, us) in starts {
        let expected = free.map(|free| (!free).then_some(Ns::from(us) * 1000));
        assert_eq!(run(&mut over_board, free, us, &cycles), expected, "{free:?} {us} us, a board");
        assert_eq!(run(&mut over_chip, free, us, &over_chip_cycles), expected, "{free:?} {us} us, a chip");
    }
}

/// XF-19.18 That takes a DCSYNC (50) with AssignActivate 0 for each such slave, then one INIT_DC (3), both before SafeOP (4).
/// Without a slave that runs free neither is sent.
#[test]
fn free_run_is_set_before_safeop() {
    use CommandCode::{DcSync, InitDc, StateSet};
    let (slaves, cycles) = clocked();
    let (mut host, log) = board(slaves);
    let sent = |log: &Log| {
        let packets = std::mem::take(&mut *log.lock().unwrap());
        let safeop = packets.iter().position(|packet| packet.code == StateSet && packet.information == 4);
        let is_clock = |packet: &&Packet| matches!(packet.code, DcSync | InitDc);
        assert_eq!(packets[safeop.expect("SafeOP")..].iter().find(is_clock), None, "after SafeOP");
        let shown = |packet: &Packet| match packet.code {
            // The slave, and AssignActivate.
            DcSync => Some((packet.data[0], u16::from_le_bytes([packet.data[2], packet.data[3]]))),
            _ => None,
        };
        packets.iter().filter(is_clock).map(shown).collect::<Vec<_>>()
    };
    run(&mut host, [false; 3], 1000, &cycles);
    assert_eq!(sent(&log), []);
    run(&mut host, [true, false, true], 1000, &cycles);
    assert_eq!(sent(&log), [Some((0, 0)), Some((2, 0)), None]);
    run(&mut host, [true, false, true], 1000, &cycles);
    assert_eq!(sent(&log), [], "it is set already");
    run(&mut host, [false, false, true], 1000, &cycles);
    assert_eq!(sent(&log), [Some((0, 0x0300)), None]);
}
