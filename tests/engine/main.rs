//! The EC01M model against the specification, over simulated slaves.

mod ahead_bus;
mod bus_ahead;
mod drives;
mod entries;
mod fifo;
mod host;
mod puppet;
mod rig;
mod sdo;
mod watch;

use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::slave::Slave;
use ecmsk::slave::drive::{Drive, DriveConfig};
use host::Host;

fn drives(n: usize) -> Vec<Box<dyn Slave>> {
    (0..n).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>).collect()
}

fn board(n: usize) -> Host {
    Host::new(EngineConfig::default(), SimBus::new(drives(n)))
}

#[test]
fn smoke() {
    let mut host = board(2);
    host.op(2).servo_on(1).servo_on(2);
    for n in 0..2000 {
        host.csp(1, n * 10).csp(2, -n * 5);
        if n % 4 == 0 {
            host.cycle();
        }
        host.until("room", |host| host.answer().fifo_free > 20);
    }
    host.drained().cycles(200);
    println!("{:?} {:?} {:?}", host.answer(), host.drive(1), host.drive(2));
    println!("{:?}", host.board.engine().counters());
    println!("{:?}", host.read_object(1, 0x6041, 0));
}
