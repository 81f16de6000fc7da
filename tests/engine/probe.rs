//! A board under test with both ends of its network, and slaves that take any role.

use ecmsk::cia402::Statusword;
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::engine::EngineConfig;
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::fieldbus::{AlState, AxisIn, Ns};
use ecmsk::slave::al::ApplicationLayer;
use ecmsk::slave::{AlStatus, Drive, DriveConfig, Slave};

use crate::host::Host;
use crate::watch::{Spans, Watch};
use support::images::{Images, number};

/// The inputs of an [`AnySlave`], except its position.
pub const MEASURED: AxisIn =
    AxisIn { statusword: Statusword(0x1250), torque: -321, position: 0, error_code: 0x8611, inputs: 0xA5C3 };

/// A slave that takes every role and every object. Its position counts the cycles.
#[derive(Default)]
pub struct AnySlave {
    al: ApplicationLayer,
    passed: i32,
    images: Images,
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

    fn read(&mut self, object: ObjectAddress, _: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
        if let Some(len) = self.images.read(object, value) {
            return Ok(len);
        }
        value[..4].copy_from_slice(&u32::from(object.index).to_le_bytes());
        Ok(4)
    }

    fn write(&mut self, object: ObjectAddress, _: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.images.take(object, number(value));
        Ok(())
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        self.passed += 1;
        self.images.put_inputs(&[AxisIn { position: self.passed, ..MEASURED }; 2], inputs);
        if outputs.is_some() {
            self.al.note_outputs();
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
