//! A puppet slave: it shows the statusword and the position that the test sets, and keeps the outputs that it gets.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};

use ecmsk::cia402::{Controlword, DriveState, Statusword};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::fieldbus::{AlState, AxisIn, AxisOut, Ns, Role};
use ecmsk::slave::{AlStatus, Slave};

use support::images::{Images, number};

/// Statuswords of a drive with voltage on, as CiA 402-2 draws them.
pub const NOT_READY: u16 = 0x0000;
pub const DISABLED: u16 = 0x0250;
pub const READY: u16 = 0x0231;
pub const SWITCHED_ON: u16 = 0x0233;
pub const ENABLED: u16 = 0x0237;
pub const QUICK_STOP: u16 = 0x0217;
pub const FAULT_REACTION: u16 = 0x021F;
pub const FAULT: u16 = 0x0218;

/// The slave's reaction to the outputs of a cycle.
pub type Reflex = fn(&mut AxisIn, &AxisOut);

/// The slave's state, which the test may read and change at any time.
#[derive(Default)]
pub struct Strings {
    state: AlState,
    /// Its inputs in the next cycle.
    pub shows: AxisIn,
    /// The outputs that it got, one set for each cycle in OP.
    pub sent: Vec<AxisOut>,
    /// The inputs of its second axis in the next cycle.
    pub shows_second: AxisIn,
    /// The outputs that its second axis got.
    pub sent_second: Vec<AxisOut>,
    /// Roles that it was configured for.
    pub roles: Vec<Role>,
    /// Objects: size and value.
    pub objects: BTreeMap<(u16, u8), (u8, u32)>,
    /// Objects read so far.
    pub uploads: Vec<ObjectAddress>,
    pub reflex: Option<Reflex>,
    images: Images,
}

impl Strings {
    /// The AL state it is in.
    pub const fn al_state(&self) -> AlState {
        self.state
    }

    /// Makes it leave its AL state by itself.
    pub const fn fall(&mut self, to: AlState) {
        self.state = to;
    }

    /// Makes it show that statusword whatever its outputs.
    pub const fn freeze(&mut self, statusword: u16) {
        self.shows.statusword = Statusword(statusword);
        self.reflex = None;
    }
}

/// The slave; clones share it.
#[derive(Clone, Default)]
pub struct Puppet(Arc<Mutex<Strings>>);

impl Puppet {
    /// A slave that shows Switch on disabled.
    pub fn new() -> Self {
        let puppet = Self::default();
        puppet.show(DISABLED);
        puppet
    }

    /// An obedient slave: it reaches a state and a target within a cycle.
    pub fn obedient() -> Self {
        let puppet = Self::new();
        puppet.strings().reflex = Some(obey);
        puppet
    }

    pub fn boxed(&self) -> Box<dyn Slave> {
        Box::new(self.clone())
    }

    pub fn strings(&self) -> MutexGuard<'_, Strings> {
        self.0.lock().unwrap()
    }

    /// Shows a statusword from the next cycle on.
    pub fn show(&self, statusword: u16) {
        self.strings().shows.statusword = Statusword(statusword);
    }

    /// Is at this position from the next cycle on.
    pub fn stand(&self, position: i32) {
        self.strings().shows.position = position;
    }

    /// Makes it a pulse module of that many channels, by its objects. Its second axis shows Switch on disabled.
    pub fn with_channels(self, channels: usize) -> Self {
        let mut strings = self.strings();
        strings.shows_second.statusword = Statusword(DISABLED);
        for axis in 0..channels as u16 {
            strings.objects.insert((0x6040 + 0x800 * axis, 0), (2, 0));
            strings.objects.insert((0x6060 + 0x800 * axis, 0), (1, 8));
        }
        drop(strings);
        self
    }

    /// The outputs of both axes.
    pub fn sent_two(&self) -> [Vec<AxisOut>; 2] {
        let strings = self.strings();
        [strings.sent.clone(), strings.sent_second.clone()]
    }

    /// The last outputs of both axes.
    pub fn last_two(&self) -> [AxisOut; 2] {
        self.sent_two().map(|sent| *sent.last().expect("no outputs have come"))
    }

    /// The last outputs.
    pub fn last(&self) -> AxisOut {
        *self.strings().sent.last().expect("no outputs have come")
    }

    /// Clears the record of outputs.
    pub fn forget(&self) {
        let mut strings = self.strings();
        strings.sent.clear();
        strings.sent_second.clear();
    }

    /// Controlwords in the order they came, repetitions left out.
    pub fn controlwords(&self) -> Vec<u16> {
        let mut words: Vec<u16> = self.strings().sent.iter().map(|out| out.controlword.0).collect();
        words.dedup();
        words
    }

    /// Targets in the order they came, repetitions left out.
    pub fn targets(&self) -> Vec<i32> {
        let mut targets: Vec<i32> = self.strings().sent.iter().map(|out| out.target).collect();
        targets.dedup();
        targets
    }

    /// Targets from the first `target` on, which has to occur: earlier targets, which hold the position, are left out.
    #[track_caller]
    pub fn targets_from(&self, target: i32) -> Vec<i32> {
        let targets = self.targets();
        let first = targets.iter().position(|one| *one == target).expect("the first one");
        targets[first..].to_vec()
    }
}

fn obey(shows: &mut AxisIn, out: &AxisOut) {
    use DriveState::*;
    let state = shows.statusword.state().expect("a state");
    let word = match (state, out.controlword) {
        (_, Controlword::DISABLE_VOLTAGE) => DISABLED,
        (SwitchOnDisabled | SwitchedOn | OperationEnabled, Controlword::SHUTDOWN) => READY,
        (ReadyToSwitchOn | OperationEnabled, Controlword::SWITCH_ON) => SWITCHED_ON,
        (SwitchedOn, Controlword::ENABLE_OPERATION) => ENABLED,
        _ => shows.statusword.0,
    };
    shows.statusword = Statusword(word);
    if word == ENABLED {
        shows.position = out.target;
    }
}

impl Slave for Puppet {
    fn name(&self) -> &str {
        "puppet"
    }

    fn state(&self) -> AlState {
        self.strings().state
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        self.strings().state = target;
        Ok(())
    }

    fn read(&mut self, object: ObjectAddress, _: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
        let mut strings = self.strings();
        if let Some(len) = strings.images.read(object, value) {
            return Ok(len);
        }
        strings.uploads.push(object);
        let Some((size, bits)) = strings.objects.get(&(object.index, object.sub)) else {
            return Images::read_identity(object, value).ok_or(AbortCode::NO_OBJECT);
        };
        let size = usize::from(*size);
        value[..size].copy_from_slice(&bits.to_le_bytes()[..size]);
        Ok(size)
    }

    fn write(&mut self, object: ObjectAddress, _: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        let mut strings = self.strings();
        let number = number(value);
        if strings.images.take(object, number) {
            if let (0x1C12, Some(role)) = (object.index, strings.images.role()) {
                strings.roles.push(role);
            }
            return Ok(());
        }
        let is_mode = object.index & !0x800 == 0x6060 && strings.images.role().is_some();
        match strings.objects.get_mut(&(object.index, object.sub)) {
            // The board writes the mode of a slave whose mapping it knows, too.
            None if is_mode => Ok(()),
            None => Err(AbortCode::NO_OBJECT),
            Some((bytes, _)) if usize::from(*bytes) != value.len() => Err(AbortCode::LENGTH),
            Some((_, kept)) => {
                *kept = number;
                Ok(())
            }
        }
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        let mut strings = self.strings();
        strings.images.put_inputs(&[strings.shows, strings.shows_second], inputs);
        let Some([out, second]) = outputs.map(|outputs| strings.images.outputs(outputs)) else { return };
        strings.sent.push(out);
        strings.sent_second.push(second);
        if let Some(reflex) = strings.reflex {
            reflex(&mut strings.shows, &out);
            reflex(&mut strings.shows_second, &second);
        }
    }

    fn step(&mut self, _dt_ns: Ns) {}

    fn shaft(&self, axis: usize) -> Option<i64> {
        (axis == 0).then(|| self.strings().shows.position.into())
    }
}
