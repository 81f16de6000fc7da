//! Slaves with taps: the outputs that each was sent in each cycle of the network, with any master.

use std::sync::{Arc, Mutex, MutexGuard};

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::fieldbus::{AxisOut, MAX_AXES};
use ecmsk::slave::{Fault, Slave};
use support::images::{Images, number};

/// A slave's outputs in a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Took {
    pub axes: [AxisOut; MAX_AXES],
    /// Whether each axis acts on its target: it is enabled, and not in homing mode.
    pub follows: [bool; MAX_AXES],
}

/// All slaves' outputs in a cycle; `None`: the slave took none.
pub type Row = Vec<Option<Took>>;

/// A fault that an axis has when it takes a target.
#[derive(Clone, Copy, Debug)]
struct Trap {
    place: usize,
    axis: usize,
    target: i32,
    fault: Fault,
}

#[derive(Default)]
struct Journal {
    slaves: usize,
    rows: Vec<Row>,
    /// The place of the slave that was served last in this cycle.
    newest: Option<usize>,
    trap: Option<Trap>,
}

/// The log of all taps of a network; clones share it.
#[derive(Clone, Default)]
pub struct Log(Arc<Mutex<Journal>>);

impl Log {
    fn lock(&self) -> MutexGuard<'_, Journal> {
        self.0.lock().expect("no panic")
    }

    /// Puts a tap on each slave of a network.
    pub fn tapped(&self, slaves: Vec<Box<dyn Slave>>) -> Vec<Box<dyn Slave>> {
        self.lock().slaves = slaves.len();
        let tap = |(place, inner)| Box::new(Tap::new(place, inner, self.clone())) as Box<dyn Slave>;
        slaves.into_iter().enumerate().map(tap).collect()
    }

    /// All cycles since the last call in which a slave took outputs. The first row holds each slave's outputs before.
    pub fn take(&self) -> Vec<Row> {
        let mut journal = self.lock();
        let newest = |place: usize| journal.rows.iter().rev().find_map(|row| row[place]);
        let before = (0..journal.slaves).map(newest).collect();
        journal.newest = None;
        std::mem::replace(&mut journal.rows, vec![before])
    }

    /// A slave's newest outputs.
    pub fn newest(&self, slave: usize) -> Option<Took> {
        self.lock().rows.iter().rev().find_map(|row| row[slave - 1])
    }

    /// An axis has that fault when it takes that target and follows it.
    pub fn trap(&self, slave: usize, axis: usize, target: i32, fault: Fault) {
        self.lock().trap = Some(Trap { place: slave - 1, axis, target, fault });
    }

    /// Whether a fault still waits for its target.
    pub fn is_armed(&self) -> bool {
        self.lock().trap.is_some()
    }

    /// The fault that these outputs trigger.
    fn note(&self, place: usize, took: Took) -> Option<Fault> {
        let mut journal = self.lock();
        if journal.newest.is_none_or(|newest| place <= newest) {
            let row = vec![None; journal.slaves];
            journal.rows.push(row);
        }
        journal.newest = Some(place);
        if let Some(row) = journal.rows.last_mut() {
            row[place] = Some(took);
        }
        let springs = |trap: &mut Trap| {
            trap.place == place && took.follows[trap.axis] && took.axes[trap.axis].target == trap.target
        };
        journal.trap.take_if(springs).map(|trap| trap.fault)
    }
}

/// A slave with its tap.
struct Tap {
    place: usize,
    inner: Box<dyn Slave>,
    images: Images,
    /// Mode of operation of each axis, 0x6060.
    modes: [u8; MAX_AXES],
    log: Log,
}

impl Tap {
    fn new(place: usize, inner: Box<dyn Slave>, log: Log) -> Self {
        Self { place, inner, images: Images::default(), modes: [0; MAX_AXES], log }
    }
}

const HOMING: u8 = 6;

impl Slave for Tap {
    support::hand_on_slave!(inner: name, state, enter, read_entries, set_sync_managers, step, apply_fault, has_dc, shaft);

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.inner.write(object, scope, value)?;
        self.images.take(object, number(value));
        if object.index & !0x0800 == 0x6060 {
            self.modes[usize::from(object.index & 0x0800 != 0)] = number(value) as u8;
        }
        Ok(())
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        self.inner.exchange(outputs, inputs);
        let Some(outputs) = outputs else { return };
        let shown = self.images.inputs(inputs);
        let follows = std::array::from_fn(|axis| shown[axis].statusword.is_enabled() && self.modes[axis] != HOMING);
        if let Some(fault) = self.log.note(self.place, Took { axes: self.images.outputs(outputs), follows }) {
            self.inner.apply_fault(fault);
        }
    }
}
