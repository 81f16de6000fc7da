//! A network card whose slaves another master has left: the promises of SAFETY.md and NIC.md for a program that is
//! killed.

use std::sync::{Arc, Mutex};

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::engine::EngineConfig;
use ecmsk::ethercat::AlState;
use ecmsk::fieldbus::Ns;
use ecmsk::fieldbus::nic::{ChainWires, NicBus, NicWires};
use ecmsk::fieldbus::sim::SimHandle;
use ecmsk::master::{FrameBuffer, Settings, Wire, WireDown};
use ecmsk::sk::{CycleTime, DcShift, MasterCommand, MasterState};
use ecmsk::slave::esc::{EscSettings, Predecessor};
use ecmsk::slave::{Drive, DriveConfig, Slave};

use crate::host::Host;
use crate::probe;

const MS: Ns = 1_000_000;

/// What the test observes on the wires.
#[derive(Default)]
struct Seen {
    /// The program is killed: no frame is sent.
    is_killed: bool,
    last_frame: Ns,
    /// The time at which each slave left OP.
    left: Vec<Option<Ns>>,
}

/// Wires that end with the program; the test watches the slaves on them.
struct Mortal {
    wires: ChainWires,
    seen: Arc<Mutex<Seen>>,
}

impl Wire for Mortal {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        let mut seen = self.seen.lock().expect("nobody has panicked");
        if seen.is_killed {
            return Ok(());
        }
        seen.last_frame = NicWires::now(&self.wires);
        Wire::send(&mut self.wires, frame)
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        Wire::receive(&mut self.wires, buffer)
    }
}

impl NicWires for Mortal {
    fn now(&self) -> Ns {
        NicWires::now(&self.wires)
    }

    fn wait(&mut self, until: Ns) {
        NicWires::wait(&mut self.wires, until);
        let mut seen = self.seen.lock().expect("nobody has panicked");
        let (chain, now) = (self.wires.slaves().chain(), NicWires::now(&self.wires));
        seen.left.resize(chain.len(), None);
        for (n, left) in seen.left.iter_mut().enumerate() {
            *left = if chain.slave(n).state() < AlState::Op { left.or(Some(now)) } else { None };
        }
    }

    fn is_real_time(&self) -> bool {
        false
    }
}

/// MASTER-3.6, MASTER-2.8 Whatever another master has left in its slaves, a board on a network card comes to OP, its axes follow, and if its
/// program is killed each slave has left OP 100 ms after the last frame: 500 ms later no axis moves.
#[test]
fn a_killed_program_stops_in_time() {
    for seed in 0..12 {
        let network = SimHandle::default();
        let mut wires = ChainWires::new(probe::drives(3), network.clone()).expect("they have an EEPROM");
        NicWires::wait(&mut wires, 100 * MS);
        wires.leave(&mut Predecessor::seeded(seed));
        let seen = Arc::new(Mutex::new(Seen::default()));
        let wires = Mortal { wires, seen: Arc::clone(&seen) };
        let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
        host.op(3);
        (1..=3).for_each(|slave| {
            host.servo_on(slave);
        });
        for n in 1..=100 {
            (1..=3).for_each(|slave| {
                host.csp(slave, n * 500);
            });
            host.cycles(1);
        }
        seen.lock().expect("nobody has panicked").is_killed = true;
        host.cycles(700);
        let (left, last_frame) = {
            let seen = seen.lock().expect("nobody has panicked");
            (seen.left.clone(), seen.last_frame)
        };
        for (n, left) in left.iter().enumerate() {
            let after = left.expect("it has left OP") - last_frame;
            assert!((99 * MS..=101 * MS).contains(&after), "seed {seed}, slave {}: {after} ns", n + 1);
        }
        let places = |network: &SimHandle| (1..=3).map(|slave| network.shaft(slave, 0)).collect::<Vec<_>>();
        let stands = places(&network);
        host.cycles(300);
        assert_eq!(places(&network), stands, "seed {seed}");
    }
}

/// A drive behind a controller whose watchdog is too short, and cannot be made longer.
struct Hasty(Drive);

impl Slave for Hasty {
    support::hand_on_slave!(0: name, state, enter, set_sync_managers, step, apply_fault, has_dc, shaft, read);

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        self.0.exchange(outputs, inputs);
    }

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.0.write(object, scope, value)
    }

    fn controller_settings(&self) -> EscSettings {
        EscSettings { fixed_watchdog_divider: Some(0), ..EscSettings::default() }
    }
}

/// A slave that does not take the time of the watchdog is named with that reason, and the user is not asked to check
/// its cable.
#[test]
fn a_watchdog_that_is_not_taken_is_told() {
    let mut slaves = probe::drives(1);
    slaves.push(Box::new(Hasty(Drive::new(DriveConfig::default()))));
    let wires = ChainWires::new(slaves, SimHandle::default()).expect("they have an EEPROM");
    let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
    host.declare_drives(2);
    host.master(MasterCommand::SetDc { cycle: CycleTime::from_us(4000).expect("a cycle"), shift: DcShift::Auto })
        .cycles(2);
    host.master(MasterCommand::SetState(MasterState::Op));
    host.until("the failure", |host| host.board.engine().state_failure().is_some());
    let failure = host.board.engine().state_failure().expect("there is one").to_string();
    for word in ["slave 2", "0x0400", "0x0420", "0x001F"] {
        assert!(failure.contains(word), "{failure}");
    }
    assert!(!failure.contains("cable"), "{failure}");
}
