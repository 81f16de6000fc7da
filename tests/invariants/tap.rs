//! A slave with a tap on its process data.

use std::sync::{Arc, Mutex};

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::fieldbus::{AlState, SlaveOut};
use ecmsk::slave::{AlStatus, Slave};

use support::images::{Images, number};

/// The outputs of a slave in the last cycle; `None`: it took none.
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
    support::hand_on_slave!(inner: name, state, read_entries, set_sync_managers, step, apply_fault, has_dc, shaft);

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        let entered = self.inner.enter(target);
        if self.inner.state() != AlState::Op {
            *self.seen.lock().expect("no panic") = None;
        }
        entered
    }

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.inner.write(object, scope, value)?;
        self.images.take(object, number(value));
        Ok(())
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        *self.seen.lock().expect("no panic") = outputs.map(|outputs| self.images.outputs(outputs));
        self.inner.exchange(outputs, inputs);
    }
}
