//! The packets, the clock and the sets ahead that `ecmsk migrate` names hold the cycle: no cycle in a motion repeats outputs.

use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::migrate::{IDLE_NS, INT0_IDLE_NS, Needs, Network};
use ecmsk::sk::{CycleTime, DcShift, MasterCommand, MasterState, SlaveCommand, SlaveKind};
use ecmsk::slave::{Drive, DriveConfig, Slave};
use ecmsk::xf::DataSize;
use ecmsk::xf::chip::Timing;
use ecmsk::xf::host::HostConfig;
use support::chip_line::xf_bus_at;

use crate::host::Host;
use crate::puppet::Puppet;

/// Targets of the motion.
const TARGETS: i32 = 300;

/// So many drives in a cycle of so many us, and what they need with a clock in Hz.
fn needs(drives: usize, cycle_us: u32, clock_hz: u32) -> Needs {
    let mut network = Network { cycle: CycleTime::from_us(cycle_us).expect("a cycle"), ..Network::default() };
    network.kinds[..drives].fill(Some(SlaveKind::Drive));
    Needs::of(&network, clock_hz)
}

/// Cycles in the middle of a motion in which the first drive got the target of the cycle before once more. The program
/// keeps 60 targets in the board's FIFO.
fn repeats(needs: &Needs, drives: usize, size: DataSize, idle_ns: u64, ahead: u16) -> usize {
    let puppet = Puppet::obedient();
    let others = (1..drives).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>);
    let slaves = std::iter::once(puppet.boxed()).chain(others).collect();
    let config = HostConfig { wanted_size: Some(size), idle_ns, ..HostConfig::DEFAULT };
    let options = XfBusOptions { ahead, clock_hz: Some(needs.clock_hz), ..XfBusOptions::DEFAULT };
    let mut host = Host::new(EngineConfig::default(), xf_bus_at(needs.clock_hz, slaves, config, options));
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

/// TOOL-178, TOOL-180 With INT0 and without, in small and large networks, from the least clock on.
#[test]
fn what_migrate_names_holds() {
    assert_eq!(INT0_IDLE_NS, Timing::default().packet_ns);
    for (drives, cycle_us, clock_hz) in [
        (1, 1000, 24_000_000),
        (2, 500, 24_000_000),
        (8, 250, 24_000_000),
        (20, 500, 24_000_000),
        (8, 1000, 24_000_000),
        (8, 1000, 1_000_000),
        (40, 1000, 24_000_000),
    ] {
        let with_any = needs(drives, cycle_us, clock_hz);
        for (packets, idle_ns) in [(with_any.with_int0, INT0_IDLE_NS), (with_any.without_int0, IDLE_NS)] {
            let Ok(packets) = packets else { continue };
            // The least clock that holds, with the packets that were chosen.
            let needs = Needs { clock_hz: packets.least_clock_hz, ..with_any };
            let ahead = needs.transport_sets_with(packets.size, idle_ns);
            let found = repeats(&needs, drives, packets.size, idle_ns, ahead);
            assert_eq!(found, 0, "{drives} drives, {cycle_us} us, {packets:?}, ahead={ahead}");
        }
    }
}

/// TOOL-180 Fewer sets ahead than the transport takes do not hold it: the figure is none that anything would pass.
#[test]
fn fewer_sets_ahead_repeat_outputs() {
    let needs = needs(8, 1000, 24_000_000);
    let packets = needs.with_int0.expect("packets");
    assert!(needs.transport_sets(packets.size) > 2);
    assert!(repeats(&needs, 8, packets.size, INT0_IDLE_NS, 2) > 50);
}

/// TOOL-178 Smaller packets than those that are named do not hold: 40 drives in 1 ms without INT0, one set in a packet.
#[test]
fn smaller_packets_do_not_hold() {
    let needs = needs(40, 1000, 24_000_000);
    let least = needs.least_size().expect("a size");
    assert!(needs.without_int0.expect("packets").size > least);
    assert!(repeats(&needs, 40, least, IDLE_NS, needs.ahead_max) > 20);
}
