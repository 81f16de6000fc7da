//! The board over an ECM-XF that is silent for a while, so that it is not known whether it has taken the newest set of
//! outputs.

use std::convert::Infallible;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use ecmsk::cia402::{Controlword, Mode};
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::xf::{XfBus, XfBusOptions};
use ecmsk::fieldbus::{
    AlState, AxisOut, BusConfig, Cleared, Fieldbus, Inputs, Job, MAX_SLAVES, Ns, Outputs, Role, SlaveConfig, SlaveSet,
};
use ecmsk::sk::{CycleTime, DriveSync, FIFO_ENTRIES, FifoAction, MasterCommand, MasterState, SlaveCommand, StateByte};
use ecmsk::slave::Slave;
use ecmsk::slave::handle::SimHandle;
use ecmsk::xf::AnswerHeader;
use ecmsk::xf::chip::{Chip, Profile, SlaveModels};
use ecmsk::xf::host::{HostConfig, Wires};
use ecmsk::xf::packet::write_not_ready;
use support::chip_line::ChipLine;

use crate::host::{BOOT_LIMIT, Host};
use crate::puppet::Puppet;

const US: Ns = 1_000;
const MS: Ns = 1_000_000;
/// Longer than the driver waits for an answer, and shorter than a slave stays in OP without outputs.
const SILENT_NS: Ns = 150 * MS;

/// What the host of a silent chip sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Silence {
    /// Its packets arrive, and no answer comes back.
    NoAnswer,
    /// Its packets do not arrive, and the answer is "not ready".
    NotReady,
}

/// Wires to a chip that is silent for a while.
struct Silent {
    line: ChipLine<SlaveModels>,
    during: Arc<Mutex<Range<Ns>>>,
    silence: Silence,
}

impl Wires for Silent {
    type Error = Infallible;

    fn now(&self) -> Ns {
        self.line.now()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), Infallible> {
        let is_silent = self.during.lock().unwrap().contains(&self.now());
        self.line.cut.store(is_silent && self.silence == Silence::NotReady, Ordering::Relaxed);
        self.line.exchange(to_chip, from_chip)?;
        if is_silent {
            from_chip.fill(0);
        }
        if is_silent && self.silence == Silence::NotReady {
            // Exchanges that search for a packet have other lengths.
            let _ = write_not_ready(from_chip, Profile::NEW.size, AnswerHeader::default());
        }
        Ok(())
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), Infallible> {
        self.line.wait_until(time)
    }

    fn wait_ready(&mut self, until: Ns) -> Result<bool, Infallible> {
        self.line.wait_ready(until)
    }
}

/// A bus over such wires, their clock, and when they are silent.
fn bus(
    silence: Silence,
    slaves: Vec<Box<dyn Slave>>,
    handle: SimHandle,
) -> (XfBus<Silent>, Arc<AtomicU64>, Arc<Mutex<Range<Ns>>>) {
    let line = ChipLine::new(Chip::new(Profile::NEW, SlaveModels::new(slaves).reached_by(handle)));
    let (clock, during) = (line.clock.clone(), Arc::<Mutex<Range<Ns>>>::default());
    let wires = Silent { line, during: during.clone(), silence };
    let config = HostConfig { size: Some(Profile::NEW.size), ..HostConfig::DEFAULT };
    (XfBus::new(wires, config, XfBusOptions { size_is_fixed: true, ..XfBusOptions::DEFAULT }), clock, during)
}

/// Makes the chip silent from that delay on.
fn fall_silent(clock: &AtomicU64, during: &Mutex<Range<Ns>>, later_ns: Ns) {
    let from = clock.load(Ordering::Relaxed) + later_ns;
    *during.lock().unwrap() = from..from + SILENT_NS;
}

/// A board in OP with two drives that are on.
struct Rig {
    host: Host,
    puppets: [Puppet; 2],
    handle: SimHandle,
    clock: Arc<AtomicU64>,
    during: Arc<Mutex<Range<Ns>>>,
}

impl Rig {
    fn new(silence: Silence) -> Self {
        let (puppets, handle) = ([Puppet::obedient(), Puppet::obedient()], SimHandle::default());
        let slaves = puppets.iter().map(Puppet::boxed).collect();
        let (bus, clock, during) = bus(silence, slaves, handle.clone());
        let mut host = Host::new(EngineConfig::default(), bus);
        host.op(2).servo_on(1).servo_on(2).drained().cycles(20);
        Self { host, puppets, handle, clock, during }
    }
}

/// Runs `episode` in boards whose chip falls silent at every phase of writing a set. In some phases it is not known
/// whether the set was written.
fn at_any_moment(mut episode: impl FnMut(&mut Rig, i32)) {
    for silence in [Silence::NoAnswer, Silence::NotReady] {
        let mut rig = Rig::new(silence);
        let lost = |rig: &Rig| rig.host.counters().outputs_lost;
        for n in 1..=60 {
            fall_silent(&rig.clock, &rig.during, n as Ns * 50 * US);
            episode(&mut rig, 10 * n);
        }
        assert!(lost(&rig) > 0, "{silence:?}: it was always known");
        for puppet in &rig.puppets {
            assert!(puppet.targets().is_sorted(), "{silence:?}: {:?}", puppet.targets());
        }
    }
}

/// Waits until the chip answers again, and the FIFO is empty.
fn at_rest(host: &mut Host) {
    host.cycles(400);
    assert_eq!(host.board.engine().fifo_free(), FIFO_ENTRIES);
}

/// XF-20.17 If it is not known whether the newest outputs have reached the chip, they are written once more: the axis
/// goes to its newest target, an SV_OFF switches off, and no frame stays in the FIFO, though no command follows.
#[test]
fn the_newest_outputs_come() {
    at_any_moment(|Rig { host, puppets, .. }, target| {
        at_rest(host.csp(1, target));
        assert_eq!(puppets[0].last().target, target);
    });
    at_any_moment(|Rig { host, puppets, .. }, _| {
        at_rest(host.slave(2, SlaveCommand::ServoOff));
        assert_eq!(puppets[1].last().controlword.0 & 0xF, 0, "{:?}", puppets[1].controlwords());
        host.servo_on(2);
    });
}

/// XF-20.18 A slave that is lost meanwhile is commanded to hold, and none of the others returns to outputs before the
/// newest.
#[test]
fn nobody_goes_back_beside_a_lost_slave() {
    at_any_moment(|Rig { host, puppets, handle, .. }, target| {
        host.csp(1, target).cycles(5);
        handle.lose(2);
        at_rest(host);
        assert_eq!(puppets[0].last().target, target);
        handle.find(2);
        host.master(MasterCommand::SetState(MasterState::Op));
        host.until("OP", |host| host.state() == StateByte::reached(MasterState::Op)).servo_on(2).drained();
    });
}

/// XF-20.18 Outputs that the board's clear takes back are not written once more.
#[test]
fn a_clear_decides_what_comes() {
    at_any_moment(|Rig { host, puppets, .. }, target| {
        let (cleared, before) = (host.counters().cleared, puppets[0].last().target);
        host.csp(1, target - 5).csp(1, target).cycles(4).master(MasterCommand::SetFifo(FifoAction::Clear));
        at_rest(host);
        let cleared = (host.counters().cleared - cleared) as usize;
        assert_eq!(puppets[0].last().target, [target, target - 5, before][cleared], "{cleared} cleared");
        host.csp(1, target + 1).drained().cycles(50);
    });
}

/// The only slave, a drive in CSP, is found and brought to OP.
fn to_op() -> [Job; 5] {
    let slaves = SlaveSet::first(1);
    let state = |target| Job::State { target, slaves, timeout_ns: BOOT_LIMIT };
    let drive = SlaveConfig { role: Role::Drive(Mode::Csp), sync: DriveSync::DcSync };
    let config = BusConfig { cycle: CycleTime::DEFAULT, selected: slaves, slaves: [drive; MAX_SLAVES] };
    [Job::Scan, state(AlState::PreOp), Job::Configure(config), state(AlState::SafeOp), state(AlState::Op)]
}

/// The first slave's outputs with that id, and a target as far.
fn outputs(id: u64) -> Outputs {
    let mut outputs = Outputs { id, ..Outputs::default() };
    outputs.slaves[0][0] = AxisOut { controlword: Controlword::ENABLE_OPERATION, target: id as i32, outputs: 0 };
    outputs
}

/// XF-20.17 XF-20.18 A clear returns the outputs that were sent, also with outputs in doubt, and the slave has those.
#[test]
fn a_clear_tells_what_a_slave_has() {
    let mut doubts = 0;
    let moments = (0..30).flat_map(|moment| [10 * MS, 120 * MS].map(|clear_after| (moment * 100 * US, clear_after)));
    for (moment, clear_after) in moments {
        let puppet = Puppet::new();
        let (mut bus, clock, during) = bus(Silence::NotReady, vec![puppet.boxed()], SimHandle::default());
        let mut now = 0;
        for job in to_op() {
            bus.start(job, now).unwrap();
            let done = (0..BOOT_LIMIT / MS).find_map(|_| {
                now += MS;
                bus.poll_job(now)
            });
            assert!(done.is_some(), "it ends");
        }
        let mut inputs = Inputs::default();
        let mut poll = |bus: &mut XfBus<Silent>, ns: Ns| {
            for _ in 0..ns / (100 * US) {
                now += 100 * US;
                while bus.poll(now, &mut inputs).is_some() {}
            }
            now
        };
        bus.push(&outputs(1)).unwrap();
        poll(&mut bus, 50 * MS);
        bus.push(&outputs(2)).unwrap();
        fall_silent(&clock, &during, moment);
        let at = poll(&mut bus, clear_after);
        bus.clear_ahead(at);
        poll(&mut bus, 400 * MS);
        let at = poll(&mut bus, MS);
        let Cleared { newest_sent } = bus.poll_clear(at).expect("it ends");
        poll(&mut bus, 50 * MS);
        let lost = bus.counters().sets_lost;
        doubts += u32::from((newest_sent, lost) == (Some(2), 1));
        assert_eq!(
            Some(puppet.last().target as u64),
            newest_sent,
            "{moment} ns, cleared after {clear_after} ns, {lost} in doubt"
        );
        assert!(puppet.targets().is_sorted(), "{moment} ns, cleared after {clear_after} ns: {:?}", puppet.targets());
    }
    assert!(doubts > 0, "it was always known");
}
