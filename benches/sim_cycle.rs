//! What a cycle of the simulated network costs: `cargo bench --bench sim_cycle`.
//!
//! Prints nanoseconds; nothing here passes or fails.

use std::hint::black_box;
use std::time::Instant;

use ecmsk::cia402::{Controlword, Mode};
use ecmsk::fieldbus::sim::SimBus;
use ecmsk::fieldbus::{
    AlState, BusConfig, Fieldbus, Inputs, Job, JobDone, MAX_SLAVES, Ns, Outputs, Role, SlaveConfig, SlaveSet,
};
use ecmsk::sk::{CycleTime, DriveSync};
use ecmsk::slave::axis::Axis;
use ecmsk::slave::plant::{Effort, Motor, Plant};
use ecmsk::slave::{Drive, DriveConfig, Slave};

const CYCLE_NS: Ns = 1_000_000;
const ROUNDS: u32 = 200_000;

fn main() {
    let mut plant = Plant::new(&Motor::default(), 0);
    let mut from = 0;
    per_round("plant, following a position", ROUNDS, |_| {
        plant.run(Effort::Position { from, fraction: 0.0, by: 500.0 }, CYCLE_NS);
        from += 500;
    });
    per_round("plant, standing", ROUNDS, |_| {
        plant.run(Effort::Position { from, fraction: 0.0, by: 0.0 }, CYCLE_NS);
    });

    let mut axis = enabled_axis();
    let mut target = 0;
    per_round("axis, following a position", ROUNDS, |_| {
        target += 500;
        axis.targets_mut().position = target;
        axis.step(CYCLE_NS);
    });

    for drives in [1, 40] {
        let mut bus = running_bus(drives);
        let mut outputs = Outputs::default();
        let mut inputs = Inputs::default();
        let mut now = 10_000_000_000;
        let what = format!("bus with {drives} drives, all following");
        per_round(&what, ROUNDS / 10, |round| {
            for slave in &mut outputs.slaves {
                slave[0].controlword = Controlword(walk(round));
                slave[0].target = if round < 200 { 0 } else { (round as i32 - 200) * 500 };
            }
            bus.push(&outputs).expect("the bus is up");
            now += CYCLE_NS;
            bus.poll(now, &mut inputs);
        });
        black_box(&inputs);
    }
}

fn walk(round: u32) -> u16 {
    [0x06, 0x07, 0x0F][(round as usize / 50).min(2)]
}

/// The best of several batches: what else the machine does only makes a batch slower.
fn per_round(what: &str, rounds: u32, mut body: impl FnMut(u32)) {
    const BATCHES: u32 = 40;
    let mut best = f64::INFINITY;
    for batch in 0..BATCHES {
        let start = Instant::now();
        for round in 0..rounds / BATCHES {
            body(batch * (rounds / BATCHES) + round);
        }
        best = best.min(start.elapsed().as_nanos() as f64 / f64::from(rounds / BATCHES));
    }
    println!("{what:40} {best:8.1} ns");
}

fn enabled_axis() -> Axis {
    let mut axis = Drive::new(DriveConfig::default()).axis().clone();
    for round in 0..300 {
        axis.machine_mut().command(Controlword(if round < 120 { 0x06 } else { 0x0F }));
        axis.step(CYCLE_NS);
    }
    assert!(axis.measured().statusword.is_enabled(), "the axis is on");
    axis
}

fn running_bus(drives: usize) -> SimBus {
    let slaves = (0..drives).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>);
    let mut bus = SimBus::new(slaves.collect());
    let role = SlaveConfig { role: Role::Drive(Mode::Csp), sync: DriveSync::DcSync };
    let config = BusConfig { cycle: CycleTime::DEFAULT, slaves: [role; MAX_SLAVES] };
    let state = |target| Job::State { target, slaves: SlaveSet::first(drives as u8), timeout_ns: 10_000_000_000 };
    let mut now = 0;
    for job in [Job::Scan, state(AlState::PreOp), Job::Configure(config), state(AlState::Op)] {
        bus.start(job, now).expect("no other job");
        let done = loop {
            now += CYCLE_NS;
            if let Some(done) = bus.poll_job(now) {
                break done;
            }
        };
        assert!(!matches!(done, JobDone::Configure(Err(_)) | JobDone::State(Err(_))), "{done:?}");
    }
    bus
}
