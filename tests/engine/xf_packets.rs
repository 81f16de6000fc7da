//! The packets and the clock that `ecmsk migrate` names hold the cycle: no cycle in a motion repeats outputs.

use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::migrate::{IDLE_NS, INT0_IDLE_NS, Needs, Network};
use ecmsk::sk::{CycleTime, DcShift, MasterCommand, MasterState, SlaveCommand, SlaveKind};
use ecmsk::slave::{Drive, DriveConfig, Slave};
use ecmsk::xf::DataSize;
use ecmsk::xf::chip::ChipTiming;
use ecmsk::xf::host::HostConfig;
use support::chip_line::xf_bus_at;

use crate::host::Host;
use crate::puppet::Puppet;

/// Targets of the motion.
const TARGETS: i32 = 300;

/// The requirements of that many drives, with the cycle in us and the clock in Hz.
fn needs(drives: usize, cycle_us: u32, clock_hz: u32) -> Needs {
    let mut network = Network { cycle: CycleTime::from_us(cycle_us).expect("a cycle"), ..Network::default() };
    network.kinds[..drives].fill(Some(SlaveKind::Drive));
    Needs::of(&network, clock_hz)
}

/// Cycles in the middle of a motion in which the first drive got the target of the cycle before once more. The program
/// keeps 60 targets in the board's FIFO; beside the sets for the transport, the chip has one set.
fn repeats(needs: &Needs, drives: usize, size: DataSize, idle_ns: u64) -> usize {
    repeats_at(needs.clock_hz, needs, drives, size, idle_ns)
}

/// The same with another clock of the wires, which the bus does not know.
fn repeats_at(clock_hz: u32, needs: &Needs, drives: usize, size: DataSize, idle_ns: u64) -> usize {
    let puppet = Puppet::obedient();
    let others = (1..drives).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>);
    let slaves = std::iter::once(puppet.boxed()).chain(others).collect();
    let config = HostConfig { wanted_size: Some(size), idle_ns, ..HostConfig::DEFAULT };
    let options = XfBusOptions { ahead: 1, clock_hz: Some(needs.clock_hz), ..XfBusOptions::DEFAULT };
    let mut host = Host::new(EngineConfig::default(), xf_bus_at(clock_hz, slaves, config, options));
    host.declare_drives(drives);
    host.master(MasterCommand::SetDc { cycle: needs.cycle, shift: DcShift::Auto });
    host.go(MasterState::Op).drained();
    for slave in 1..=drives {
        host.slave(slave, SlaveCommand::ServoOn);
    }
    host.drained().until("all are on", |host| (1..=drives).all(|slave| host.drive(slave).statusword.is_enabled()));
    for target in 1..=TARGETS {
        host.csp(1, target).until("room", |host| host.answer().fifo_free > 100);
    }
    host.drained();
    let sent: Vec<i32> = puppet.strings().sent.iter().map(|sent| sent.target).collect();
    let at = |target| sent.iter().position(|sent| *sent == target).unwrap_or_else(|| panic!("{target} of {sent:?}"));
    // The first targets come while the FIFO is being filled, the last ones while it runs empty.
    let motion = &sent[at(10)..at(TARGETS - 10)];
    motion.windows(2).filter(|pair| pair[0] == pair[1]).count()
}

/// XF-19.5 With INT0 and without, in small and large networks, at the present clock and at the least one.
#[test]
fn what_migrate_names_holds() {
    assert_eq!(INT0_IDLE_NS, ChipTiming::default().packet_ns);
    for (drives, cycle_us) in [(1, 1000), (2, 500), (8, 250), (8, 1000), (20, 500), (40, 1000)] {
        let given = needs(drives, cycle_us, 24_000_000);
        for (packets, idle_ns) in [(given.with_int0, INT0_IDLE_NS), (given.without_int0, IDLE_NS)] {
            let packets = packets.expect("packets");
            for clock_hz in [24_000_000, packets.least_clock_hz] {
                let needs = needs(drives, cycle_us, clock_hz);
                let of = if idle_ns == IDLE_NS { needs.without_int0 } else { needs.with_int0 };
                let packets = of.expect("packets");
                assert_eq!(packets.in_flight, 1, "{packets:?}");
                let found = repeats(&needs, drives, packets.size, idle_ns);
                assert_eq!(found, 0, "{drives} drives, {cycle_us} us, {clock_hz} Hz, {packets:?}");
            }
        }
    }
}

/// With half of the least clock, which the bus does not know, outputs are repeated: so the named clock is a real limit.
#[test]
fn half_of_the_least_clock_repeats_outputs() {
    let needs = needs(20, 500, 24_000_000);
    let packets = needs.without_int0.expect("packets");
    assert!(packets.transport_sets > 4, "{packets:?}");
    let found = repeats_at(packets.least_clock_hz / 2, &needs, 20, packets.size, IDLE_NS);
    assert!(found > 20, "{found} with {packets:?}");
}

/// Two exchanges under way, each with one set.
#[test]
fn two_exchanges_under_way_hold() {
    for (cycle_us, clock_hz) in [(500, 24_000_000), (1000, 12_000_000)] {
        let needs = needs(40, cycle_us, clock_hz);
        let packets = needs.with_int0.expect("packets");
        assert_eq!((packets.in_flight, packets.sets), (2, 1), "{packets:?}");
        assert_eq!(repeats(&needs, 40, packets.size, INT0_IDLE_NS), 0, "{packets:?}");
    }
}
