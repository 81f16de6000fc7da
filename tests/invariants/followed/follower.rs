//! A slave that obeys within a cycle and records its outputs: a drive in CSP, or a module of digital outputs.

use std::sync::{Arc, Mutex, MutexGuard};

use ecmsk::cia402::{Controlword, DriveState, Statusword};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::fieldbus::{AlState, AxisIn, AxisOut, Ns};
use ecmsk::slave::al::ApplicationLayer;
use ecmsk::slave::{AlStatus, Slave};
use support::images::{Images, number};

const DISABLED: u16 = 0x0250;
const READY: u16 = 0x0231;
const SWITCHED_ON: u16 = 0x0233;
const ENABLED: u16 = 0x0237;

/// An event of a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Note {
    /// It took outputs in OP; repetitions are left out.
    Got {
        /// The outputs.
        out: AxisOut,
        /// Whether it was in Operation enabled before, and whether it is now.
        was_on: bool,
        is_on: bool,
        /// Its position before.
        position: i32,
    },
    /// It has entered that state, or has fallen to it.
    State(AlState),
}

/// The slave's own state.
#[derive(Default)]
pub struct Inside {
    al: ApplicationLayer,
    shows: AxisIn,
    images: Images,
    notes: Vec<Note>,
    last: Option<Note>,
    /// Whether it has an identity.
    has_identity: bool,
}

impl Inside {
    /// Whether its motor is on.
    pub fn is_on(&self) -> bool {
        self.shows.statusword.0 == ENABLED
    }

    /// Pushes the axis, whose motor is off.
    pub fn shove(&mut self, to: i32) {
        self.shows.position = to;
    }

    pub fn position(&self) -> i32 {
        self.shows.position
    }

    /// The events since the last call.
    pub fn take_notes(&mut self) -> Vec<Note> {
        std::mem::take(&mut self.notes)
    }

    fn note(&mut self, note: Note) {
        if self.last != Some(note) {
            self.last = Some(note);
            self.notes.push(note);
        }
    }

    fn entered(&mut self) {
        let state = self.al.state();
        if state != AlState::Op {
            self.shows.statusword = Statusword(DISABLED);
        }
        self.note(Note::State(state));
    }

    fn obey(&mut self, out: &AxisOut) {
        use DriveState::{OperationEnabled, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn};
        let state = self.shows.statusword.state().expect("a state");
        let word = match (state, out.controlword) {
            // A quick stop ends within the cycle, and follows no target.
            (_, Controlword::DISABLE_VOLTAGE) | (OperationEnabled, Controlword::QUICK_STOP) => DISABLED,
            (SwitchOnDisabled | SwitchedOn | OperationEnabled, Controlword::SHUTDOWN) => READY,
            (ReadyToSwitchOn | OperationEnabled, Controlword::SWITCH_ON) => SWITCHED_ON,
            (SwitchedOn, Controlword::ENABLE_OPERATION) => ENABLED,
            _ => self.shows.statusword.0,
        };
        self.shows.statusword = Statusword(word);
    }
}

/// The slave; clones share it.
#[derive(Clone)]
pub struct Follower(Arc<Mutex<Inside>>);

impl Follower {
    /// `has_identity`: whether it has an identity, as slave controllers need it.
    pub fn new(has_identity: bool) -> Self {
        let follower = Self(Arc::default());
        follower.inside().has_identity = has_identity;
        follower.inside().shows.statusword = Statusword(DISABLED);
        follower
    }

    pub fn inside(&self) -> MutexGuard<'_, Inside> {
        self.0.lock().expect("no panic")
    }
}

impl Slave for Follower {
    fn name(&self) -> &str {
        "follower"
    }

    fn state(&self) -> AlState {
        self.inside().al.state()
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        let mut inside = self.inside();
        inside.al.enter(target, Ok(()))?;
        inside.entered();
        Ok(())
    }

    fn read(&mut self, object: ObjectAddress, _: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
        let inside = self.inside();
        let mapping = inside.images.read(object, value);
        let identity = || if inside.has_identity { Images::read_identity(object, value) } else { None };
        mapping.or_else(identity).ok_or(AbortCode::NO_OBJECT)
    }

    fn write(&mut self, object: ObjectAddress, _: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        let mut inside = self.inside();
        // The board writes the mode of a slave whose mapping it knows, too.
        let is_mode = object.index == 0x6060 && inside.images.role().is_some();
        if inside.images.take(object, number(value)) || is_mode { Ok(()) } else { Err(AbortCode::NO_OBJECT) }
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        let mut inside = self.inside();
        let shows = inside.shows;
        inside.images.put_inputs(&[shows, AxisIn::default()], inputs);
        let Some([out, _]) = outputs.map(|outputs| inside.images.outputs(outputs)) else { return };
        if inside.al.state() != AlState::Op {
            return;
        }
        inside.al.note_outputs();
        let (was_on, position) = (inside.is_on(), inside.shows.position);
        inside.obey(&out);
        let is_on = inside.is_on();
        if is_on {
            inside.shows.position = out.target;
        }
        inside.note(Note::Got { out, was_on, is_on, position });
    }

    fn step(&mut self, dt_ns: Ns) {
        let mut inside = self.inside();
        if inside.al.step(dt_ns) {
            inside.entered();
        }
    }
}
