//! A slave with a tap on its process data.

use std::sync::{Arc, Mutex};

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::fieldbus::{AlState, Ns, SlaveOut};
use ecmsk::slave::{AlStatus, Fault, Slave};

use support::images::{Images, number};

/// What went into a slave in the last cycle; `None`: it took nothing.
pub type Seen = Arc<Mutex<Option<SlaveOut>>>;

/// The slave.
pub struct Tap {
    inner: Box<dyn Slave>,
    seen: Seen,
    images: Images,
}

impl Tap {
    pub fn on(inner: Box<dyn Slave>) -> (Box<dyn Slave>, Seen) {
        let seen = Seen::default();
        (Box::new(Self { inner, seen: seen.clone(), images: Images::default() }), seen)
    }
}

impl Slave for Tap {
    fn name(&self) -> &str {
        self.inner.name()
    }

    fn state(&self) -> AlState {
        self.inner.state()
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        let entered = self.inner.enter(target);
        if self.inner.state() != AlState::Op {
            *self.seen.lock().expect("no panic") = None;
        }
        entered
    }

    fn read(&mut self, object: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
        self.inner.read(object, scope, value)
    }

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.inner.write(object, scope, value)?;
        self.images.take(object, number(value));
        Ok(())
    }

    fn set_sync_managers(&mut self, outputs: u16, inputs: u16) {
        self.inner.set_sync_managers(outputs, inputs);
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        *self.seen.lock().expect("no panic") = outputs.map(|outputs| self.images.outputs(outputs));
        self.inner.exchange(outputs, inputs);
    }

    fn step(&mut self, dt_ns: Ns) {
        self.inner.step(dt_ns);
    }

    fn apply_fault(&mut self, fault: Fault) -> bool {
        self.inner.apply_fault(fault)
    }

    fn has_dc(&self) -> bool {
        self.inner.has_dc()
    }

    fn shaft(&self, axis: usize) -> Option<i64> {
        self.inner.shaft(axis)
    }
}
