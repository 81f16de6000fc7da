//! Two network cards at the ends of the cable, a ring: a cut does not cost a cycle.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ecmsk::engine::EngineConfig;
use ecmsk::ethercat::{CableEnd, SlaveSet};
use ecmsk::fieldbus::nic::{CardPair, ChainWires, GRACE_NS, NicBus, NicWires, Ring};
use ecmsk::fieldbus::sim::SimHandle;
use ecmsk::fieldbus::{Fieldbus, Ns, RingState};
use ecmsk::master::{FrameBuffer, Settings, Wire, WireDown};
use ecmsk::sk::{MasterState, Motion, SlaveCommand, StateByte};
use ecmsk::slave::Slave;

use crate::host::Host;
use crate::probe::drives;
use crate::puppet::Puppet;
use support::dice::Dice;

/// The source address of probes.
const PROBES: [u8; 6] = [0x04; 6];

/// Cards whose second cable can be pulled while the bus has them, and whose probes may be late.
struct Cards {
    chain: ChainWires,
    has_second: Arc<AtomicBool>,
    /// How late probes come from the second card, ns, and those that are on their way.
    late_ns: Ns,
    late: VecDeque<(Ns, FrameBuffer, usize)>,
}

impl Cards {
    fn new(chain: ChainWires, has_second: &Arc<AtomicBool>) -> Self {
        Self { chain, has_second: Arc::clone(has_second), late_ns: 0, late: VecDeque::new() }
    }
}

impl CardPair for Cards {
    fn send(&mut self, end: CableEnd, frame: &[u8]) -> Result<(), WireDown> {
        self.chain.connect_second(self.has_second.load(Ordering::Relaxed));
        CardPair::send(&mut self.chain, end, frame)
    }

    fn receive(&mut self, end: CableEnd, buffer: &mut FrameBuffer) -> Option<usize> {
        let now = self.now();
        if let Some((_, frame, len)) = self.late.pop_front_if(|(due, ..)| end == CableEnd::Last && *due <= now) {
            buffer.copy_from_slice(&frame);
            return Some(len);
        }
        loop {
            let len = CardPair::receive(&mut self.chain, end, buffer)?;
            if end == CableEnd::First || self.late_ns == 0 || buffer[7..12] != PROBES[1..] {
                return Some(len);
            }
            self.late.push_back((now + self.late_ns, *buffer, len));
        }
    }

    fn now(&self) -> Ns {
        CardPair::now(&self.chain)
    }

    fn wait(&mut self, until: Ns) {
        let due = self.late.front().map_or(until, |(due, ..)| until.min(*due));
        CardPair::wait(&mut self.chain, due);
    }

    fn is_real_time(&self) -> bool {
        CardPair::is_real_time(&self.chain)
    }
}

struct Bench {
    host: Host,
    network: SimHandle,
    has_second: Arc<AtomicBool>,
}

/// A board in OP with these slaves in a ring.
fn ring(slaves: Vec<Box<dyn Slave>>) -> Bench {
    let (network, has_second) = (SimHandle::default(), Arc::new(AtomicBool::new(true)));
    let count = slaves.len();
    let chain = ChainWires::new(slaves, network.clone()).expect("they have an EEPROM");
    let wires = Ring::new(Cards::new(chain, &has_second), PROBES);
    let mut host = Host::new(EngineConfig::default(), NicBus::new(wires, Settings::default()));
    host.op(count);
    Bench { host, network, has_second }
}

/// A change of the cables of four slaves, and the resulting state of the ring.
type Cut = (&'static str, fn(&Bench), RingState);

const CUTS: [Cut; 4] = [
    ("between slaves 2 and 3", |bench| bench.network.cut_after(2), RingState::Open),
    ("before the first slave", |bench| bench.network.cut_after(0), RingState::FirstDead),
    ("before the last slave", |bench| bench.network.cut_after(3), RingState::Open),
    ("behind the last slave", |bench| bench.has_second.store(false, Ordering::Relaxed), RingState::SecondDead),
];

/// NIC-3.1 NIC-3.2 In a ring each slave gets each target once and in order while a cable is cut and healed, wherever that is, and no cycle is
/// lost.
#[test]
fn a_cut_costs_nothing() {
    for (place, cut, state) in CUTS {
        let puppets: Vec<Puppet> = (0..4).map(|_| Puppet::obedient()).collect();
        let mut bench = ring(puppets.iter().map(Puppet::boxed).collect());
        (1..=4).for_each(|slave| {
            bench.host.servo_on(slave);
        });
        bench.host.drained().cycles(20);
        assert_eq!(bench.host.board.snapshot().ring, Some(RingState::Whole), "{place}");
        puppets.iter().for_each(Puppet::forget);
        let before = bench.host.counters();
        for n in 1..=90 {
            match n {
                30 => cut(&bench),
                60 => {
                    bench.network.heal();
                    bench.has_second.store(true, Ordering::Relaxed);
                }
                45 => assert_eq!(bench.host.board.snapshot().ring, Some(state), "{place}"),
                _ => {}
            }
            bench.host.build(|frame, size| {
                for slave in 1..=4 {
                    let target = Motion::to(10 * n);
                    frame.put_slave(size, slave, &SlaveCommand::Csp(target).into());
                }
            });
            bench.host.cycles(1);
        }
        bench.host.cycles(20);
        assert_eq!(bench.host.board.snapshot().ring, Some(RingState::Whole), "{place}");
        assert_eq!(bench.host.board.engine().lost(), SlaveSet::EMPTY, "{place}");
        let counters = bench.host.counters();
        assert_eq!(counters.answers_lost - before.answers_lost, 0, "{place}");
        assert_eq!((counters.outputs_lost, counters.for_lost, counters.full), (0, 0, 0), "{place}");
        assert!((25..40).contains(&counters.ring_broken), "{place}: {}", counters.ring_broken);
        let expected: Vec<i32> = (0..=90).map(|n| 10 * n).collect();
        for puppet in &puppets {
            assert_eq!(puppet.targets(), expected, "{place}");
        }
    }
}

/// NIC-3.3 A second cut costs the slaves between the two, which are named as lost; the others go on, and by SET_STATE the lost ones
/// come back when a cable is whole again.
#[test]
fn a_second_cut_costs_slaves() {
    let mut bench = ring(drives(4));
    bench.network.cut_after(2);
    bench.host.cycles(50);
    assert_eq!(bench.host.state(), StateByte::reached(MasterState::Op));
    bench.has_second.store(false, Ordering::Relaxed);
    bench.host.cycles(50);
    assert_eq!(bench.host.board.engine().lost(), [3, 4].into_iter().collect());
    assert_eq!(bench.host.state(), StateByte::failed(Some(MasterState::Op)));
    bench.has_second.store(true, Ordering::Relaxed);
    bench.host.cycles(20).go(MasterState::Op);
    assert_eq!(bench.host.board.engine().lost(), SlaveSet::EMPTY);
}

/// The network comes to OP in a ring that is broken from the start, whichever card is dead.
#[test]
fn a_broken_ring_starts() {
    for (place, cut, state) in CUTS {
        let (network, has_second) = (SimHandle::default(), Arc::new(AtomicBool::new(true)));
        let chain = ChainWires::new(drives(4), network.clone()).expect("they have an EEPROM");
        let cards = Cards::new(chain, &has_second);
        let bench = Bench {
            host: Host::new(EngineConfig::default(), ecmsk::fieldbus::sim::SimBus::new(drives(1))),
            network,
            has_second,
        };
        cut(&bench);
        let mut host = Host::new(EngineConfig::default(), NicBus::new(Ring::new(cards, PROBES), Settings::default()));
        host.op(4).servo_on(4).csp(4, 100).drained().cycles(50);
        assert_eq!(host.board.snapshot().ring, Some(state), "{place}");
        assert_eq!(host.drive(4).position, 100, "{place}");
    }
}

/// NIC-3.1 With a cut cable each slave answers in each cycle, although probes come back later than the ring waits for them.
#[test]
fn a_late_probe_costs_nothing() {
    let (network, has_second) = (SimHandle::default(), Arc::new(AtomicBool::new(true)));
    let chain = ChainWires::new(drives(4), network.clone()).expect("they have an EEPROM");
    let mut cards = Cards::new(chain, &has_second);
    cards.late_ns = 3 * GRACE_NS / 2;
    network.cut_after(2);
    let bus = NicBus::new(Ring::new(cards, PROBES), Settings::default());
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(4).servo_on(4).cycles(20);
    let before = host.counters();
    host.csp(4, 100).drained().cycles(50);
    let counters = host.counters();
    assert_eq!(host.board.snapshot().ring, Some(RingState::Open));
    assert_eq!((counters.answers_lost, counters.outputs_lost), (before.answers_lost, before.outputs_lost));
    assert_eq!((host.board.engine().lost(), host.drive(4).position), (SlaveSet::EMPTY, 100));
}

/// A bus of one card reports no ring.
#[test]
fn one_card_makes_no_ring() {
    let chain = ChainWires::new(drives(1), SimHandle::default()).expect("they have an EEPROM");
    assert_eq!(NicWires::ring(&chain), None);
    let bus = NicBus::new(chain, Settings::default());
    assert_eq!(bus.ring(), None);
    let _: &dyn Wire = bus.wires();
}

/// NIC-3.2 However cables are cut and healed, one at a time, wherever and whenever: each slave gets each target once and in order, and no
/// cycle is lost.
#[test]
fn random_cuts_cost_nothing() {
    for seed in 0..25 {
        let mut dice = Dice(seed);
        let slaves = 1 + dice.below(6) as usize;
        let puppets: Vec<Puppet> = (0..slaves).map(|_| Puppet::obedient()).collect();
        let mut bench = ring(puppets.iter().map(Puppet::boxed).collect());
        bench.host.build(|frame, size| {
            (1..=slaves).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::ServoOn.into()));
        });
        bench.host.until("all on", |host| (1..=slaves).all(|slave| host.drive(slave).statusword.is_enabled()));
        bench.host.drained().cycles(20);
        puppets.iter().for_each(Puppet::forget);
        let before = bench.host.counters();
        let (mut is_cut, mut next) = (false, dice.below(20));
        for n in 1..=300 {
            if n == next {
                match (is_cut, dice.below(4)) {
                    (true, _) => {
                        bench.network.heal();
                        bench.has_second.store(true, Ordering::Relaxed);
                    }
                    (false, 0) => bench.has_second.store(false, Ordering::Relaxed),
                    (false, _) => bench.network.cut_after(dice.below(slaves as u64) as u8),
                }
                is_cut = !is_cut;
                next = n + 1 + dice.below(12);
            }
            bench.host.build(|frame, size| {
                (1..=slaves)
                    .for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::Csp(Motion::to(n as i32)).into()));
            });
            bench.host.cycles(1);
        }
        bench.host.cycles(20);
        let counters = bench.host.counters();
        assert_eq!(counters.answers_lost - before.answers_lost, 0, "seed {seed}");
        assert_eq!((counters.outputs_lost, counters.for_lost, counters.full), (0, 0, 0), "seed {seed}");
        assert_eq!(bench.host.state(), StateByte::reached(MasterState::Op), "seed {seed}");
        let expected: Vec<i32> = (1..=300).collect();
        for puppet in &puppets {
            assert_eq!(puppet.targets_from(1), expected, "seed {seed}, {slaves} slaves");
        }
    }
}
