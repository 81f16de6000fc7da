//! A simulated bus with its master, which polls once a millisecond.

use std::fmt::Debug;

use ecmsk::cia402::{Controlword, DriveState, Mode};
use ecmsk::coe::ObjectAddress;
use ecmsk::coe::SdoSize;
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::fieldbus::{
    AlState, BusConfig, Configured, CycleDone, Fieldbus, Inputs, Job, JobDone, MAX_SLAVES, Ns, Outputs, Refusal, Role,
    SdoDone, SdoRequest, SlaveConfig, SlaveSet,
};
use ecmsk::sk::{CycleTime, DriveSync};
use ecmsk::slave::{Drive, DriveConfig, Slave};

use AlState::*;

pub const MS: Ns = 1_000_000;
pub const SECOND: Ns = 1_000 * MS;

/// A bus with its master, which polls once a millisecond.
pub struct Bench {
    pub bus: SimBus,
    pub handle: SimHandle,
    pub now: Ns,
    pub outputs: Outputs,
    pub inputs: Inputs,
}

impl Bench {
    /// Drives whose shafts are at 1000, 2000, ...
    pub fn new(drives: u8) -> Self {
        let slaves = (1..=drives).map(|n| {
            let position = i64::from(n) * 1000;
            Box::new(Drive::new(DriveConfig { position, ..DriveConfig::default() })) as Box<dyn Slave>
        });
        Self::of(slaves.collect())
    }

    /// A bus with these slaves.
    pub fn of(slaves: Vec<Box<dyn Slave>>) -> Self {
        let bus = SimBus::new(slaves);
        let handle = bus.handle();
        Self { bus, handle, now: 0, outputs: Outputs::default(), inputs: Inputs::default() }
    }

    pub fn in_state(drives: u8, state: AlState) -> Self {
        let mut bench = Self::new(drives);
        bench.done(Job::Scan);
        if state >= PreOp {
            bench.reach(PreOp, drives);
        }
        if state >= SafeOp {
            assert_eq!(bench.done(configure(Role::Drive(Mode::Csp))), JobDone::Configure(Ok(Configured::default())));
            bench.reach(state, drives);
        }
        bench
    }

    /// All drives in OP and Operation enabled.
    pub fn enabled(drives: u8) -> Self {
        let mut bench = Self::in_state(drives, Op);
        for word in [Controlword::SHUTDOWN, Controlword::SWITCH_ON, Controlword::ENABLE_OPERATION] {
            bench.command(word);
            for _ in 0..60 {
                bench.hold();
                bench.cycle();
            }
        }
        for slave in 1..=drives {
            assert_eq!(bench.drive_state(slave), DriveState::OperationEnabled);
        }
        bench
    }

    pub fn command(&mut self, word: Controlword) {
        for slave in &mut self.outputs.slaves {
            slave[0].controlword = word;
        }
    }

    /// Sets the targets to the shafts' positions.
    pub fn hold(&mut self) {
        for (out, input) in self.outputs.slaves.iter_mut().zip(&self.inputs.slaves) {
            out[0].target = input[0].position;
        }
    }

    /// Runs one cycle with outputs; the bus is up.
    pub fn cycle(&mut self) -> CycleDone {
        self.outputs.id += 1;
        self.bus.push(&self.outputs).expect("the bus is up and empty");
        let id = self.outputs.id;
        let done = self.poll().expect("the bus is up");
        assert_eq!((done.outputs, done.at), (Some(id), self.now));
        done
    }

    pub fn cycles(&mut self, n: u32) {
        for _ in 0..n {
            self.cycle();
        }
    }

    pub fn poll(&mut self) -> Option<CycleDone> {
        self.now += MS;
        self.bus.poll(self.now, &mut self.inputs)
    }

    /// Waits for the only result of the bus, and returns it with the time that it took.
    fn until_ended<T: PartialEq + Debug>(&mut self, poll: impl Fn(&mut SimBus, Ns) -> Option<T>) -> (T, Ns) {
        let start = self.now;
        loop {
            assert!(self.now - start < 100 * SECOND, "it does not end");
            self.poll();
            if let Some(done) = poll(&mut self.bus, self.now) {
                assert_eq!(poll(&mut self.bus, self.now), None, "it ends once");
                return (done, self.now - start);
            }
        }
    }

    /// Runs a job; returns its end and the time that it took.
    pub fn run(&mut self, job: Job) -> (JobDone, Ns) {
        self.bus.start(job, self.now).expect("no other job is under way");
        self.until_ended(|bus, now| bus.poll_job(now))
    }

    pub fn done(&mut self, job: Job) -> JobDone {
        self.run(job).0
    }

    /// Runs an SDO; returns its end and the time that it took.
    pub fn transfer(&mut self, request: SdoRequest) -> (SdoDone, Ns) {
        self.bus.start_sdo(request, self.now).expect("no other SDO is under way");
        self.until_ended(|bus, now| bus.poll_sdo(now))
    }

    pub fn transferred(&mut self, request: SdoRequest) -> SdoDone {
        self.transfer(request).0
    }

    pub fn reach(&mut self, target: AlState, drives: u8) {
        assert_eq!(self.done(state(target, drives)), JobDone::State(Ok(())));
    }

    pub fn drive_state(&self, slave: u8) -> DriveState {
        self.inputs.slaves[usize::from(slave) - 1][0].statusword.state().expect("a defined statusword")
    }

    pub fn position(&self, slave: u8) -> i32 {
        self.inputs.slaves[usize::from(slave) - 1][0].position
    }

    pub fn target(&mut self, slave: u8) -> &mut i32 {
        &mut self.outputs.slaves[usize::from(slave) - 1][0].target
    }
}

pub fn state(target: AlState, drives: u8) -> Job {
    Job::State { target, slaves: SlaveSet::first(drives), timeout_ns: 10 * SECOND }
}

pub fn configure(role: Role) -> Job {
    let slave = SlaveConfig { role, sync: DriveSync::DcSync };
    let selected = SlaveSet::first(MAX_SLAVES as u8);
    Job::Configure(BusConfig { cycle: CycleTime::DEFAULT, selected, slaves: [slave; MAX_SLAVES] })
}

pub fn sdo(slave: u8, index: u16, write: Option<(SdoSize, u32)>) -> SdoRequest {
    SdoRequest { slave, object: ObjectAddress::new(index, 0), write, timeout_ns: SECOND }
}

pub fn set(slaves: &[u8]) -> SlaveSet {
    let mut set = SlaveSet::EMPTY;
    for slave in slaves {
        set.insert(*slave);
    }
    set
}

pub fn refused<T>(slave: u8, al_status: u16) -> Result<T, Refusal> {
    Err(Refusal { slave, al_status, abort: None })
}
