//! A slave with a tap on its process data.

use std::sync::{Arc, Mutex};

use ecmsk::cia402::{Controlword, Mode};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::fieldbus::{AlState, SlaveOut};
use ecmsk::slave::{AlStatus, Slave};

use support::images::{Images, number};

/// The outputs of a slave in the last cycle; `None`: it took none.
pub type Seen = Arc<Mutex<Option<SlaveOut>>>;

/// The two axes of a slave in one cycle.
#[derive(Clone, Copy, Debug)]
pub struct Cycle {
    /// The target, velocity or torque of each axis; `None`: it follows none, since it is off or being homed.
    pub targets: [Option<i32>; 2],
    /// The positions, measured before these outputs came.
    pub positions: [i32; 2],
}

/// The cycles of a slave, once somebody wants them.
pub type Track = Arc<Mutex<Option<Vec<Cycle>>>>;

/// What a tap shows.
#[derive(Clone, Default)]
pub struct Shown {
    pub seen: Seen,
    pub track: Track,
}

/// The slave.
pub struct Tap {
    inner: Box<dyn Slave>,
    shown: Shown,
    images: Images,
    /// 0x6060 and 0x6860.
    modes: [u8; 2],
}

impl Tap {
    pub fn on(inner: Box<dyn Slave>) -> (Box<dyn Slave>, Shown) {
        let shown = Shown::default();
        let (images, modes) = (Images::default(), [0; 2]);
        (Box::new(Self { inner, shown: shown.clone(), images, modes }), shown)
    }

    fn track(&self, outputs: Option<&SlaveOut>, inputs: &[u8]) {
        let mut track = self.shown.track.lock().expect("no panic");
        let Some(track) = &mut *track else { return };
        // Without outputs it may have no process data at all.
        let Some(outputs) = outputs else { return track.push(Cycle { targets: [None; 2], positions: [0; 2] }) };
        let inputs = self.images.inputs(inputs);
        let target = |axis: usize| {
            let is_on = outputs[axis].controlword == Controlword::ENABLE_OPERATION;
            let follows = inputs[axis].statusword.is_enabled() && self.modes[axis] != Mode::Homing.code();
            (is_on && follows).then_some(outputs[axis].target)
        };
        track.push(Cycle { targets: [0, 1].map(target), positions: [0, 1].map(|axis| inputs[axis].position) });
    }
}

impl Slave for Tap {
    support::hand_on_slave!(inner: name, state, read_entries, set_sync_managers, step, apply_fault, has_dc, shaft);

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        let entered = self.inner.enter(target);
        if self.inner.state() != AlState::Op {
            *self.shown.seen.lock().expect("no panic") = None;
        }
        entered
    }

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.inner.write(object, scope, value)?;
        self.images.take(object, number(value));
        match object.index {
            0x6060 => self.modes[0] = number(value) as u8,
            0x6860 => self.modes[1] = number(value) as u8,
            _ => {}
        }
        Ok(())
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        let told = outputs.map(|outputs| self.images.outputs(outputs));
        *self.shown.seen.lock().expect("no panic") = told;
        self.inner.exchange(outputs, inputs);
        self.track(told.as_ref(), inputs);
    }
}
