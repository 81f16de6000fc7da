//! A board under test with both ends of its network, and slaves that take any role.

use ecmsk::cia402::Statusword;
use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::fieldbus::{AlState, AxisIn, Ns, Refusal, SlaveConfig, SlaveIn, SlaveOut};
use ecmsk::slave::al::ApplicationLayer;
use ecmsk::slave::{AlStatus, Drive, DriveConfig, SdoValue, Slave};

use crate::host::Host;
use crate::watch::{Spans, Watch};

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

/// A board that has booted, its host, and both ends of its network.
pub struct Bench {
    pub host: Host,
    pub network: SimHandle,
    pub jobs: Spans,
}

impl Bench {
    pub fn new(config: EngineConfig, slaves: Vec<Box<dyn Slave>>) -> Self {
        let bus = SimBus::new(slaves);
        let network = bus.handle();
        let (bus, jobs) = Watch::new(bus);
        Self { host: Host::new(config, bus), network, jobs }
    }
}
