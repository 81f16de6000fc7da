//! What shows the tests the other side of the board: slaves that take any role, and a bus that keeps the jobs it was
//! given.

use std::sync::{Arc, Mutex};

use ecmsk::cia402::Statusword;
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::fieldbus::{
    AlState, AxisIn, BusConfig, BusError, Busy, CycleDone, Fieldbus, Inputs, Job, JobDone, Ns, Outputs, Pacing,
    Refusal, SlaveConfig, SlaveIn, SlaveOut, SlaveSet,
};
use ecmsk::slave::al::ApplicationLayer;
use ecmsk::slave::{AlStatus, Drive, DriveConfig, SdoValue, Slave};

use crate::host::Host;

/// What an [`AnySlave`] measures, but for its position.
pub const MEASURED: AxisIn =
    AxisIn { statusword: Statusword(0x1250), torque: -321, position: 0, error_code: 0x8611, inputs: 0xA5C3 };

/// A slave that takes every role and every object. Its position counts the cycles that passed it.
#[derive(Default)]
pub struct AnySlave {
    al: ApplicationLayer,
    passed: i32,
}

impl Slave for AnySlave {
    fn name(&self) -> &str {
        "any"
    }

    fn state(&self) -> AlState {
        self.al.state()
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        self.al.enter(target, Ok(()))
    }

    fn configure(&mut self, _config: &SlaveConfig) -> Result<(), Refusal> {
        Ok(())
    }

    fn upload(&mut self, object: ObjectAddress) -> Result<SdoValue, AbortCode> {
        Ok(SdoValue { size: 4, bits: object.index.into() })
    }

    fn download(&mut self, _object: ObjectAddress, _size: SdoSize, _value: u32) -> Result<(), AbortCode> {
        Ok(())
    }

    fn exchange(&mut self, outputs: Option<&SlaveOut>, inputs: &mut SlaveIn) {
        self.passed += 1;
        *inputs = [AxisIn { position: self.passed, ..MEASURED }; 2];
        if outputs.is_some() {
            self.al.feed();
        }
    }

    fn step(&mut self, dt_ns: Ns) {
        self.al.step(dt_ns);
    }
}

/// `n` servo drives.
pub fn drives(n: usize) -> Vec<Box<dyn Slave>> {
    (0..n).map(|_| Box::new(Drive::new(DriveConfig::default())) as Box<dyn Slave>).collect()
}

/// `n` slaves that take any role.
pub fn any_slaves(n: usize) -> Vec<Box<dyn Slave>> {
    (0..n).map(|_| Box::<AnySlave>::default() as Box<dyn Slave>).collect()
}

/// The jobs a bus was given, in order.
#[derive(Clone, Default)]
pub struct Jobs(Arc<Mutex<Vec<Job>>>);

impl Jobs {
    pub fn len(&self) -> usize {
        self.0.lock().unwrap().len()
    }

    /// What the last change from PreOP to SafeOP configured.
    pub fn configured(&self) -> BusConfig {
        let jobs = self.0.lock().unwrap();
        let configs =
            jobs.iter().rev().find_map(|job| if let Job::Configure(config) = job { Some(*config) } else { None });
        configs.expect("nothing was configured")
    }

    /// The changes of state from job number `from` on.
    pub fn moves(&self, from: usize) -> Vec<(AlState, SlaveSet)> {
        let jobs = self.0.lock().unwrap();
        let moves = jobs.iter().skip(from).filter_map(|job| match job {
            Job::State { target, slaves, .. } => Some((*target, *slaves)),
            _ => None,
        });
        moves.collect()
    }
}

/// A bus that keeps the jobs it is given.
struct Recorded {
    bus: SimBus,
    jobs: Jobs,
}

impl Fieldbus for Recorded {
    fn pacing(&self) -> Pacing {
        self.bus.pacing()
    }

    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy> {
        self.bus.start(job, now)?;
        self.jobs.0.lock().unwrap().push(job);
        Ok(())
    }

    fn poll_job(&mut self, now: Ns) -> Option<JobDone> {
        self.bus.poll_job(now)
    }

    fn cancel_job(&mut self) {
        self.bus.cancel_job();
    }

    fn room(&self) -> u16 {
        self.bus.room()
    }

    fn held(&self) -> u16 {
        self.bus.held()
    }

    fn discard_ahead(&mut self) -> u16 {
        self.bus.discard_ahead()
    }

    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError> {
        self.bus.push(outputs)
    }

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        self.bus.poll(now, inputs)
    }
}

/// A board that has booted, its host, and both ends of its network.
pub struct Bench {
    pub host: Host,
    pub network: SimHandle,
    pub jobs: Jobs,
}

impl Bench {
    pub fn new(config: EngineConfig, slaves: Vec<Box<dyn Slave>>) -> Self {
        let bus = SimBus::new(slaves);
        let (network, jobs) = (bus.handle(), Jobs::default());
        let host = Host::new(config, Recorded { bus, jobs: jobs.clone() });
        Self { host, network, jobs }
    }
}
