//! A network card that is removed, in virtual time.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use ecmsk::engine::{EngineConfig, Stepped, Stop};
use ecmsk::ethercat::{CableEnd, SlaveSet};
use ecmsk::fieldbus::nic::{CardPair, ChainWires, NicBus, NicWires, Ring};
use ecmsk::fieldbus::sim::SimHandle;
use ecmsk::fieldbus::{CardsGone, Ns};
use ecmsk::master::{FrameBuffer, Settings, Wire, WireDown};
use ecmsk::sk::{Frame, MasterState, Motion, SlaveCommand, StateByte};

use crate::host::Host;
use crate::probe::drives;
use crate::puppet::Puppet;

/// The wires of a card that can be pulled.
struct Pulled {
    wires: ChainWires,
    is_gone: Arc<AtomicBool>,
}

impl Wire for Pulled {
    fn send(&mut self, frame: &[u8]) -> Result<(), WireDown> {
        if self.is_gone.load(Ordering::Relaxed) { Err(WireDown) } else { Wire::send(&mut self.wires, frame) }
    }

    fn receive(&mut self, buffer: &mut FrameBuffer) -> Option<usize> {
        Wire::receive(&mut self.wires, buffer)
    }
}

impl NicWires for Pulled {
    fn now(&self) -> Ns {
        NicWires::now(&self.wires)
    }

    fn wait(&mut self, until: Ns) {
        NicWires::wait(&mut self.wires, until);
    }

    fn is_real_time(&self) -> bool {
        false
    }

    fn cards_gone(&self) -> Option<CardsGone> {
        let is_gone = self.is_gone.load(Ordering::Relaxed);
        is_gone.then(|| CardsGone { text: "eth1 was pulled".into(), is_all: true })
    }
}

/// Each call ends at once when the card is gone: a read without a limit, a write, a call that lets time pass, and the
/// check whether the board is open. Closing takes no time then, though axes are enabled.
#[test]
fn every_call_ends_at_once() {
    let is_gone = Arc::new(AtomicBool::new(false));
    let wires = ChainWires::new(drives(2), Default::default()).expect("they have an EEPROM");
    let bus = NicBus::new(Pulled { wires, is_gone: Arc::clone(&is_gone) }, Settings::default());
    let mut host = Host::new(EngineConfig::default(), bus);
    host.op(2).servo_on(1).servo_on(2);
    let stepped = Stepped::new(host.board, 125_000, 32);
    let (frame, mut report) = (Frame::new(), Frame::new());
    for _ in 0..100 {
        stepped.write(&frame).expect("it is open");
        stepped.read(&mut report, None).expect("a report");
    }
    is_gone.store(true, Ordering::Relaxed);
    assert_eq!(stepped.read(&mut report, None).map(|_| ()), Err(Stop::BusGone));
    assert_eq!(stepped.read(&mut report, Some(Duration::ZERO)).map(|_| ()), Err(Stop::BusGone));
    assert_eq!(stepped.write(&frame), Err(Stop::BusGone));
    assert_eq!(stepped.pass(1_000_000), Err(Stop::BusGone));
    assert_eq!(stepped.check(), Err(Stop::BusGone));
    let mut board = stepped.close().expect("the board");
    assert_eq!(board.engine().state(), StateByte::reached(MasterState::Op));
    let (began, cycles) = (board.now(), board.cycles());
    board.switch_off();
    assert_eq!((board.now(), board.cycles()), (began, cycles));
}

/// Two cards, one of which can be pulled.
struct TwoCards {
    chain: ChainWires,
    network: SimHandle,
    pulled: CableEnd,
    is_gone: Arc<AtomicBool>,
}

impl TwoCards {
    fn is_gone(&self, end: CableEnd) -> bool {
        end == self.pulled && self.is_gone.load(Ordering::Relaxed)
    }
}

impl CardPair for TwoCards {
    fn send(&mut self, end: CableEnd, frame: &[u8]) -> Result<(), WireDown> {
        self.chain.connect_second(!self.is_gone(CableEnd::Last));
        if self.is_gone(CableEnd::First) {
            self.network.cut_after(0);
        }
        if self.is_gone(end) { Err(WireDown) } else { CardPair::send(&mut self.chain, end, frame) }
    }

    fn receive(&mut self, end: CableEnd, buffer: &mut FrameBuffer) -> Option<usize> {
        if self.is_gone(end) { None } else { CardPair::receive(&mut self.chain, end, buffer) }
    }

    fn now(&self) -> Ns {
        CardPair::now(&self.chain)
    }

    fn wait(&mut self, until: Ns) {
        CardPair::wait(&mut self.chain, until);
    }

    fn is_real_time(&self) -> bool {
        false
    }

    fn cards_gone(&self) -> Option<CardsGone> {
        self.is_gone(self.pulled).then(|| CardsGone { text: "eth2 was pulled".into(), is_all: false })
    }
}

/// NIC-3.2 One of two cards is gone: each slave gets each target once and in order by the other one, no cycle is lost,
/// and the broken ring is counted and reported.
#[test]
fn a_ring_goes_on_by_the_other_card() {
    for pulled in CableEnd::BOTH {
        let is_gone = Arc::new(AtomicBool::new(false));
        let puppets: Vec<Puppet> = (0..4).map(|_| Puppet::obedient()).collect();
        let network = SimHandle::default();
        let chain = ChainWires::new(puppets.iter().map(Puppet::boxed).collect(), network.clone());
        let chain = chain.expect("they have an EEPROM");
        let cards = TwoCards { chain, network, pulled, is_gone: Arc::clone(&is_gone) };
        let bus = NicBus::new(Ring::new(cards, [0x04; 6]), Settings::default());
        let mut host = Host::new(EngineConfig::default(), bus);
        host.op(4);
        (1..=4).for_each(|slave| {
            host.servo_on(slave);
        });
        host.drained().cycles(20);
        puppets.iter().for_each(Puppet::forget);
        let before = host.counters();
        for n in 1..=90 {
            is_gone.store(n >= 30, Ordering::Relaxed);
            host.build(|frame, size| {
                (1..=4).for_each(|slave| frame.put_slave(size, slave, &SlaveCommand::Csp(Motion::to(10 * n)).into()));
            });
            host.cycles(1);
        }
        host.cycles(20);
        assert!(host.board.cards_gone().is_some_and(|gone| !gone.is_all), "{pulled:?}");
        assert_eq!(host.board.engine().lost(), SlaveSet::EMPTY, "{pulled:?}");
        let counters = host.counters();
        assert_eq!(counters.answers_lost - before.answers_lost, 0, "{pulled:?}");
        assert_eq!((counters.outputs_lost, counters.for_lost, counters.full), (0, 0, 0), "{pulled:?}");
        let ring_broken = counters.ring_broken - before.ring_broken;
        assert!((75..85).contains(&ring_broken), "{pulled:?}: {ring_broken}");
        let expected: Vec<i32> = (0..=90).map(|n| 10 * n).collect();
        puppets.iter().for_each(|puppet| assert_eq!(puppet.targets(), expected, "{pulled:?}"));
    }
}
