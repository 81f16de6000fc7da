//! A board in OP over puppets, on a bus that the runner paces or on one that takes outputs ahead; the test controls the
//! network.

use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::SlaveSet;
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::sk::{Frame, MasterCommand, MasterState, Motion, RawSlot, SlaveCommand, StateByte};

use crate::host::{Host, is_over};
use crate::puppet::Puppet;
use crate::rig::ahead;
use crate::watch::{Spans, Watch};
use support::ahead_bus::{Ahead, AheadBus};

/// Every kind of bus: `None` is one that the runner paces.
pub fn buses() -> impl Iterator<Item = Option<Ahead>> {
    std::iter::once(None).chain(ahead().map(Some))
}

/// Two of them, for long tests.
pub fn two_buses() -> impl Iterator<Item = Option<Ahead>> {
    [None, Some(Ahead::kind(8, 2, 333_333, 700))].into_iter().take(if is_over() { 1 } else { 2 })
}

pub fn set(slaves: &[u8]) -> SlaveSet {
    let mut set = SlaveSet::EMPTY;
    slaves.iter().for_each(|slave| set.insert(*slave));
    set
}

pub struct Net {
    pub host: Host,
    pub network: SimHandle,
    pub puppets: Vec<Puppet>,
    pub jobs: Spans,
    /// Targets sent to each slave so far; the n-th one is n.
    pub targets: i32,
}

impl Net {
    /// A board in PreOP with `n` obedient drives.
    pub fn new(how: Option<Ahead>, n: usize) -> Self {
        Self::with_config(how, n, EngineConfig::default())
    }

    pub fn with_config(how: Option<Ahead>, n: usize, config: EngineConfig) -> Self {
        let puppets: Vec<Puppet> = (0..n).map(|_| Puppet::obedient()).collect();
        let bus = SimBus::new(puppets.iter().map(Puppet::boxed).collect());
        let network = bus.handle();
        let (bus, jobs) = Watch::new(bus);
        let mut host = match how {
            None => Host::new(config, bus),
            Some(how) => Host::new(config, AheadBus::new(bus, how)),
        };
        host.declare_drives(n);
        Self { host, network, puppets, jobs, targets: 0 }
    }

    /// In OP, and all are on.
    pub fn on(how: Option<Ahead>, n: usize) -> Self {
        let mut net = Self::new(how, n);
        net.host.go(MasterState::Op).drained();
        for slave in 1..=n {
            net.host.servo_on(slave);
        }
        net.host.cycles(20);
        net.puppets.iter().for_each(Puppet::forget);
        net
    }

    /// Lets a frame with the next target for every slave arrive, and a cycle pass.
    pub fn stream(&mut self, frames: usize) -> &mut Self {
        for _ in 0..frames {
            self.target();
            self.host.cycle();
        }
        self
    }

    /// A frame with the next target for every slave arrives; its index is the target's low byte.
    pub fn target(&mut self) {
        self.targets += 1;
        let mut frame = Frame::new();
        for slave in 1..=self.puppets.len() {
            let csp = SlaveCommand::Csp(Motion::to(self.targets)).with_index(self.targets as u8);
            frame.put_slave(self.host.size, slave, &csp);
        }
        self.host.arrive(&frame);
    }

    /// Waits until all entries are executed and answered.
    pub fn settle(&mut self) -> &mut Self {
        self.host.drained().cycles(30);
        self
    }

    /// Sends SET_STATE and waits until the state byte shows `shown`.
    pub fn ask(&mut self, state: MasterState, shown: StateByte) -> &mut Self {
        self.host.master(MasterCommand::SetState(state));
        self.host.until(&format!("{shown:?}"), |host| host.state() == shown);
        self
    }

    pub fn until_state(&mut self, shown: u8) -> &mut Self {
        self.host.until(&format!("{shown:02X}"), |host| host.state().0 == shown);
        self
    }

    pub fn lost(&self) -> SlaveSet {
        self.host.board.engine().lost()
    }

    pub fn slots(&self, slaves: &[usize]) -> Vec<RawSlot> {
        slaves.iter().map(|slave| self.host.slot(*slave)).collect()
    }

    /// Targets that a slave got, without repetitions and without targets that hold its position.
    pub fn received(&self, slave: usize) -> Vec<i32> {
        self.puppets[slave - 1].targets()
    }
}
