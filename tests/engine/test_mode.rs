//! Test mode: CONFIG1 high.

use ecmsk::engine::{ALL_ON_NS, EngineConfig, ONE_ON_NS};
use ecmsk::fieldbus::Ns;
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::link::{self, Wait};
use ecmsk::sk::{FifoAction, Frame, MasterCommand, MasterState, RawSlot, SlaveCommand, SlaveKind, SlotSize, StateByte};

use crate::host::Host;
use crate::network_rig::two_buses;
use crate::probe::drives;
use crate::puppet::Puppet;
use support::ahead_bus::{Ahead, AheadBus};

const ON: EngineConfig = EngineConfig {
    slot: SlotSize::Bytes12,
    firmware: ecmsk::engine::Firmware::V17,
    test: true,
    partial_frames: ecmsk::engine::PartialFrames::Dropped,
    state_timeout_ns: 10_000_000_000,
    sdo_timeout_ns: 1_000_000_000,
};

fn board(how: Option<Ahead>, n: usize) -> (Host, Vec<Puppet>, SimHandle) {
    let puppets: Vec<Puppet> = (0..n).map(|_| Puppet::new()).collect();
    let bus = SimBus::new(puppets.iter().map(Puppet::boxed).collect());
    let network = bus.handle();
    let host = match how {
        None => Host::new(ON, bus),
        Some(how) => Host::new(ON, AheadBus::new(bus, how)),
    };
    (host, puppets, network)
}

/// The output patterns of every slave, and how many cycles of 1 ms each was there.
fn patterns(puppets: &[Puppet]) -> Vec<(Vec<u16>, u64)> {
    let sent: Vec<Vec<u16>> =
        puppets.iter().map(|puppet| puppet.strings().sent.iter().map(|out| out.outputs).collect()).collect();
    let mut patterns: Vec<(Vec<u16>, u64)> = Vec::new();
    for cycle in 0..sent.iter().map(Vec::len).min().unwrap() {
        let now: Vec<u16> = sent.iter().map(|sent| sent[cycle]).collect();
        match patterns.last_mut() {
            Some((last, cycles)) if *last == now => *cycles += 1,
            _ => patterns.push((now, 1)),
        }
    }
    patterns
}

fn last(puppets: &[Puppet]) -> Vec<u16> {
    puppets.iter().map(|puppet| puppet.last().outputs).collect()
}

/// SK-4.70 SK-10.12 The board goes to OP by itself, with the defaults: all slaves IO, 1000 us. No frame is sent.
/// SK-4.71 All outputs are on for 2 s, then one after another, slave by slave, and all over again.
#[test]
fn the_walk() {
    assert_eq!(ALL_ON_NS, 2_000_000_000);
    let one_on = ONE_ON_NS / 1_000_000;
    for how in two_buses() {
        let (mut host, puppets, _) = board(how, 2);
        assert_eq!(host.state(), StateByte(0), "no report yet");
        host.until("OP", |host| host.state() == StateByte::reached(MasterState::Op));
        let round = 2000 + 32 * one_on;
        host.cycles(round as usize + 3000);
        let seen = patterns(&puppets);
        // The first outputs may go out before the walk begins.
        let seen = if seen[0].0 == [0, 0] { &seen[1..] } else { &seen[..] };
        let near = |cycles: u64, expected: u64| cycles.abs_diff(expected) <= 12;
        assert!(seen[0].0 == [0xFFFF; 2] && near(seen[0].1, 2000), "{how:?}: {:?}", seen[0]);
        for (step, (image, cycles)) in seen[1..33].iter().enumerate() {
            let alone = 1u16 << (step % 16);
            assert_eq!(*image, if step < 16 { [alone, 0] } else { [0, alone] }, "{how:?}: step {step}");
            assert!(near(*cycles, one_on), "{how:?}: step {step}: {cycles} cycles");
        }
        assert_eq!((&seen[33].0[..], &seen[34].0[..]), (&[0xFFFF; 2][..], &[1, 0][..]), "{how:?}: the next round");
        assert_eq!((host.counters().frames, host.board.engine().period_ns()), (0, 1_000_000));
    }
}

/// SK-10.12 CONFIG1 low or floating: there is no test mode. SK-4.71
#[test]
fn the_normal_mode() {
    assert!(!EngineConfig::default().test);
    let puppet = Puppet::new();
    let mut host = Host::new(EngineConfig::default(), SimBus::new(vec![puppet.boxed()]));
    host.cycles(3000);
    assert_eq!(host.state(), StateByte::reached(MasterState::PreOp));
    host.go(MasterState::Op).cycles(5000);
    assert!(puppet.strings().sent.iter().all(|out| out.outputs == 0));
}

/// SK-4.72 A host that writes outputs ends the walk for good: its outputs hold, and the walk's own outputs are off.
#[test]
fn a_host_ends_the_walk() {
    for how in two_buses() {
        for wait in [10, 2100, 4100] {
            let (mut host, puppets, _) = board(how, 3);
            host.until("OP", |host| host.state().0 == 8).cycles(wait);
            // Only IO_WR ends it.
            let before = last(&puppets);
            host.slave(1, SlaveCommand::IoRead).idle().raw(2, RawSlot { id: 0x15, ..RawSlot::ZERO });
            host.master(MasterCommand::LocalWrite(5)).drained().cycles(5);
            assert_eq!(last(&puppets), before, "{how:?}");
            assert!(before.iter().any(|outputs| *outputs != 0));

            host.slave(2, SlaveCommand::IoWrite(0x00F0)).drained().cycles(20);
            assert_eq!(last(&puppets), [0, 0x00F0, 0], "{how:?}");
            host.slave(3, SlaveCommand::IoWrite(0x000F)).drained().cycles(20);
            assert_eq!(last(&puppets), [0, 0x00F0, 0x000F], "{how:?}: another one's hold");
            host.slave(3, SlaveCommand::IoWrite(0)).drained().cycles(20);
            puppets.iter().for_each(Puppet::forget);
            host.cycles(15_000);
            assert_eq!(patterns(&puppets).len(), 1, "{how:?}: for good");
            // In OP again, too.
            host.go(MasterState::PreOp).go(MasterState::Op).cycles(3000);
            assert_eq!(last(&puppets), [0; 3], "{how:?}");
        }
    }
}

/// SK-4.72 [OURS] A write that SET_FIFO clears before it is sent does not end the walk.
#[test]
fn a_write_that_is_cleared() {
    let how = Ahead::kind(64, 1, 1, 0);
    let (mut host, puppets, _) = board(Some(how), 1);
    host.until("OP", |host| host.state().0 == 8).cycles(100);
    let mut write = Frame::new();
    for bits in [None, None, None, None, Some(0x1234)] {
        if let Some(bits) = bits {
            write.put_slave(host.size, 1, &SlaveCommand::IoWrite(bits).into());
        }
        host.arrive(&write);
    }
    host.cycle();
    host.master(MasterCommand::SetFifo(FifoAction::Clear)).cycles(100);
    assert_eq!(last(&puppets), [0xFFFF]);
    host.cycles(2000);
    assert_eq!(last(&puppets)[0].count_ones(), 1, "the walk goes on");
}

/// SK-4.70 [OURS] The board follows a host's SET_STATE; back in OP the walk restarts.
#[test]
fn a_host_changes_the_state() {
    let (mut host, puppets, _) = board(None, 1);
    host.until("OP", |host| host.state().0 == 8).cycles(3000).go(MasterState::PreOp).cycles(4500);
    assert_eq!(host.state().0, 2, "it is not asked for OP again");
    puppets[0].forget();
    host.go(MasterState::Op).cycles(1500);
    assert_eq!(last(&puppets), [0xFFFF]);
    // SK-4.33 After SW_RESET everything restarts.
    host.slave(1, SlaveCommand::IoWrite(0)).cycles(5).soft_reset();
    puppets[0].forget();
    host.until("OP", |host| host.state().0 == 8).cycles(100);
    assert_eq!(last(&puppets), [0xFFFF]);
}

/// SK-4.71 Slaves of other kinds are skipped. SK-4.58 With the defaults all are IO, so a servo drive keeps the board
/// from OP, and it stays at 0x10 | 2 without a retry.
#[test]
fn other_slaves() {
    let mut host = Host::new(ON, SimBus::new(drives(1)));
    host.until("the failure", |host| host.state().0 == 0x12).cycles(15_000);
    assert_eq!(host.state().0, 0x12);

    let (mut host, puppets, _) = board(None, 3);
    host.until("OP", |host| host.state().0 == 8).go(MasterState::PreOp);
    let kinds = [SlaveKind::Io, SlaveKind::Drive, SlaveKind::Io];
    let mut all = [SlaveKind::None; 8];
    all[..3].copy_from_slice(&kinds);
    host.master(MasterCommand::SetAxis { group: 0, kinds: all }).go(MasterState::Op);
    puppets.iter().for_each(Puppet::forget);
    host.cycles(1000);
    assert_eq!(last(&puppets), [0xFFFF, 0, 0xFFFF]);
    let one_on = (ONE_ON_NS / 1_000_000) as usize;
    host.cycles(1000 + 16 * one_on + one_on / 2);
    assert_eq!(last(&puppets), [0, 0, 1]);
}

/// SK-4.71 SK-4.61 A lost slave does not stop the walk of the others.
#[test]
fn a_lost_slave() {
    let (mut host, puppets, network) = board(None, 2);
    host.until("OP", |host| host.state().0 == 8).cycles(100);
    network.lose(1);
    host.cycles(100);
    assert_eq!((host.state().0, last(&puppets)[1]), (0x18, 0xFFFF));
    network.find(1);
    host.go(MasterState::Op).cycles(100);
    assert_eq!(last(&puppets), [0xFFFF; 2]);
}

/// SK-4.70 SK-4.71 `test=1` in a link: the modules' inputs show the walk.
#[test]
fn the_key_of_a_link() {
    let link = link::open("sim:?slaves=io*2&clock=virtual&test=1&name=test-mode", link::Share::ByUri).unwrap();
    let (mut report, mut seen, size) = (Frame::new(), Vec::new(), SlotSize::Bytes12);
    let until: Ns = 40_000_000_000;
    while link.read(&mut report, Wait::Forever).unwrap().at.0 < until {
        let image = [1, 2].map(|slave| report.slot(size, slave).data1);
        if seen.last() != Some(&image) {
            seen.push(image);
        }
    }
    assert!(seen.windows(3).any(|three| three == [[0xFFFF, 0xFFFF], [1, 0], [2, 0]]), "{seen:X?}");
    link.close();
}
