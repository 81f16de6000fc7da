//! A slave with a tap on its process data.

use std::sync::{Arc, Mutex};

use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::fieldbus::{AlState, Ns, Refusal, SlaveConfig, SlaveIn, SlaveOut};
use ecmsk::slave::{AlStatus, DeviceFault, Input, SdoValue, Slave};

/// What went into a slave in the last cycle; `None`: it took nothing.
pub type Seen = Arc<Mutex<Option<SlaveOut>>>;

/// The slave.
pub struct Tap {
    inner: Box<dyn Slave>,
    seen: Seen,
}

impl Tap {
    pub fn on(inner: Box<dyn Slave>) -> (Box<dyn Slave>, Seen) {
        let seen = Seen::default();
        (Box::new(Self { inner, seen: seen.clone() }), seen)
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

    fn configure(&mut self, config: &SlaveConfig) -> Result<(), Refusal> {
        self.inner.configure(config)
    }

    fn upload(&mut self, object: ObjectAddress) -> Result<SdoValue, AbortCode> {
        self.inner.upload(object)
    }

    fn download(&mut self, object: ObjectAddress, size: SdoSize, value: u32) -> Result<(), AbortCode> {
        self.inner.download(object, size, value)
    }

    fn exchange(&mut self, outputs: Option<&SlaveOut>, inputs: &mut SlaveIn) {
        *self.seen.lock().expect("no panic") = outputs.copied();
        self.inner.exchange(outputs, inputs);
    }

    fn step(&mut self, dt_ns: Ns) {
        self.inner.step(dt_ns);
    }

    fn raise_fault(&mut self, axis: usize, fault: DeviceFault) -> bool {
        self.inner.raise_fault(axis, fault)
    }

    fn stick_input(&mut self, axis: usize, input: Input, value: Option<bool>) -> bool {
        self.inner.stick_input(axis, input, value)
    }

    fn jam(&mut self, axis: usize, jammed: bool) -> bool {
        self.inner.jam(axis, jammed)
    }

    fn has_dc(&self) -> bool {
        self.inner.has_dc()
    }

    fn shaft(&self, axis: usize) -> Option<i64> {
        self.inner.shaft(axis)
    }
}
