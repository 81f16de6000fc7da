//! Two cards at the ends of the cable.

use ecmsk::ethercat::registers::{DL_CONTROL, SYSTEM_TIME_DELAY};
use ecmsk::fieldbus::nic::{ChainWires, NicWires, Ring};
use ecmsk::master::{Master, Settings};
use ecmsk::slave::esc::Chain;
use ecmsk::slave::handle::SimHandle;
use ecmsk::slave::{Drive, DriveConfig, Slave};

use crate::rig::{SECOND, STEP};

fn drives(n: usize) -> Vec<Box<dyn Slave>> {
    (0..n).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>).collect()
}

/// Scans; returns the number of slaves.
fn scan(master: &mut Master, wires: &mut impl NicWires) -> u8 {
    let scan = master.scan();
    let end = NicWires::now(wires) + 10 * SECOND;
    while NicWires::now(wires) < end {
        master.poll(NicWires::now(wires), wires);
        if let Some(found) = master.take(scan) {
            return found.expect("slaves");
        }
        let until = NicWires::now(wires) + STEP;
        NicWires::wait(wires, until);
    }
    panic!("the scan does not end");
}

/// The delays in the clocks' registers, and the control of the ports.
fn registers(chain: &Chain) -> Vec<(Vec<u8>, Vec<u8>)> {
    let of = |n| {
        let controller = chain.slave(n).controller();
        (controller.peek(SYSTEM_TIME_DELAY, 4).to_vec(), controller.peek(DL_CONTROL, 4).to_vec())
    };
    (0..chain.len()).map(of).collect()
}

/// The delays in a ring are those of the same slaves in a line, and no port has changed. If a cable is cut no port is
/// closed: the slaves behind the gap would be gone.
#[test]
fn delays_in_a_ring_are_those_of_a_line() {
    let mut line = ChainWires::new(drives(5), SimHandle::default()).expect("they have an EEPROM");
    assert_eq!(scan(&mut Master::new(Settings::default()), &mut line), 5);
    let expected = registers(line.slaves().chain());
    assert!(expected[4].0 > expected[0].0, "{expected:?}");

    for cut in [None, Some(0), Some(2), Some(4)] {
        let network = SimHandle::default();
        let mut chain = ChainWires::new(drives(5), network.clone()).expect("they have an EEPROM");
        chain.connect_second(true);
        if let Some(cut) = cut {
            network.cut_after(cut);
        }
        let mut ring = Ring::new(chain, [4; 6]);
        assert_eq!(scan(&mut Master::new(Settings::default()), &mut ring), 5, "cut after {cut:?}");
        let found = registers(ring.pair().slaves().chain());
        match cut {
            None => assert_eq!(found, expected),
            Some(_) => assert!(found.iter().zip(&expected).all(|(found, line)| found.1 == line.1), "{found:?}"),
        }
    }
}
