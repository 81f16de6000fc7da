//! Models of EtherCAT slaves. A master drives them through the trait [`Slave`]; they know nothing of the board.
//!
//! | file or folder | what it answers |
//! | --- | --- |
//! | `drive.rs`, `hsp.rs`, `io.rs` | the kinds of slave: servo drive and stepper, pulse module, module of digital inputs and outputs; their objects are in `drive/objects.rs` and `hsp/objects.rs` |
//! | `dp3cl/` | the stepper drive Xinje DP3CL, whole |
//! | `device/`, `device.rs` | what every kind does alike: AL states, mailbox, identity, process data, faults |
//! | `identity.rs` | who a device is |
//! | `communication.rs` | what a device reads from the registers of its controller |
//! | `al.rs` | which changes of its AL state a slave takes part in, and the watchdog of its outputs |
//! | `dictionary/`, `dictionary.rs` | how objects are read and written by SDO |
//! | `manufacturer/`, `manufacturer.rs` | manufacturer-specific objects that are read from a file |
//! | `process_data/`, `process_data.rs` | how objects are mapped into PDOs, and how a cycle moves them |
//! | `axis/`, `axis.rs` | how an axis follows its targets: modes of operation, following error, statusword |
//! | `axis_objects.rs` | which objects every axis has, and which settings it reads from them |
//! | `state_machine.rs` | the states and transitions of CiA 402 |
//! | `homing/` | homing: `method.rs` the homing methods (0x6098), `run.rs` one search for home, `mod.rs` the mode around it |
//! | `switches.rs` | limit switches, home switch, index pulse and end stops along the travel of an axis |
//! | `plant/`, `plant.rs` | the physics: a motor with its load and control loops, or a train of pulses |
//! | `lines.rs` | digital inputs and outputs |
//! | `files.rs` | the files of a device: firmware and others |
//! | `fault.rs` | what can go wrong inside a device, for scripts and tests |
//! | `handle.rs` | the handle by which scripts and tests reach a network while it runs |
//! | `esc/` | the slave controllers around the slaves, as the network sees them |
//! | `cable.rs` | what goes wrong between a network and its slaves: cut cables, slaves without power, refused states, aborted SDOs |
//!
//! To add a kind of slave: implement [`device::Model`] in a file beside `drive.rs`, add its row to
//! `address/slaves/kinds.rs` and, if the board maps other process data for it, a role to `fieldbus/mod.rs` and a table to
//! `fieldbus/pdo.rs`. To add a homing method: `homing/method.rs`. To add a fault: `fault.rs`, and a verb for scripts to
//! `testbed/script/verbs.rs`.

pub mod al;
pub mod axis;
mod axis_objects;
pub mod cable;
mod communication;
pub mod device;
pub mod dictionary;
pub mod dp3cl;
pub mod drive;
pub mod esc;
mod fault;
pub mod files;
pub mod handle;
pub mod homing;
pub mod hsp;
mod identity;
pub mod io;
pub mod lines;
mod manufacturer;
pub mod plant;
pub mod process_data;
pub mod state_machine;
pub mod switches;

pub use communication::{Communication, LatchChange, SyncEvent, SyncManagerSettings};
pub use dp3cl::{Dp3cl, Dp3clConfig};
pub use drive::{Drive, DriveConfig, DriveKind};
pub use fault::{AxisFault, Fault};
pub use files::FileStore;
pub use hsp::{Channels, Hsp, HspConfig};
pub use io::{Io, IoConfig};
pub use lines::InputPattern;
pub use manufacturer::{
    FormatError, MANUFACTURER_FILE_BYTES_MAX, MANUFACTURER_VALUE_BYTES_MAX, ManufacturerObject, ManufacturerObjects,
    ManufacturerType, ManufacturerValue, Mappable,
};
pub use state_machine::DeviceFault;
pub use switches::{HomeSwitch, Input, Travel};

pub use crate::ethercat::AlStatus;

use crate::ethercat::coe::{AbortCode, ObjectAddress, ObjectListType, SdoScope, SdoSize};
use dictionary::{EntryDescription, ObjectDescription};
use esc::EscSettings;
use identity::Identity;
use plant::{SIDE_BY_SIDE, Servo, follow_side_by_side};

use crate::ethercat::registers::{PORTS, RequestedState};
use crate::ethercat::{AlState, Ns};

/// The most axes that a slave has: a pulse module of two channels has two.
pub const AXES_MAX: usize = 2;

/// A value of at most 4 bytes that an SDO upload has read, or the first 4 bytes of a longer one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SdoValue {
    /// How many of the 4 bytes belong to the value.
    pub size: u8,
    /// The value, zero-extended.
    pub bits: u32,
}

impl SdoValue {
    /// The value of which `read` puts the first bytes into 4 bytes and gives the whole length.
    fn of(read: impl FnOnce(&mut [u8]) -> Result<usize, AbortCode>) -> Result<Self, AbortCode> {
        let mut first = [0; 4];
        let len = read(&mut first)?;
        Ok(Self { size: len.min(4) as u8, bits: u32::from_le_bytes(first) })
    }
}

/// One simulated slave: AL state machine, mailbox, process data and physics.
///
/// Time passes only in [`Slave::step`]. Arithmetic is integers or `+ - * /` and `sqrt` of `f64`, so that every target
/// computes the same bits.
pub trait Slave: Send {
    /// The name that people know it by, e.g. `drive`.
    fn name(&self) -> &str;

    /// The identity of the slave and its serial number, in any state; `None`: the slave tells none.
    fn identity(&self) -> Option<(&Identity, u32)> {
        None
    }

    /// The station alias that the slave has at power-on; 0: none.
    fn station_alias(&self) -> u16 {
        0
    }

    /// The AL state. A slave may leave a state by itself, e.g. when no outputs come.
    fn state(&self) -> AlState;

    /// Requests an AL state. The slave is in that state if the answer is `Ok`.
    ///
    /// # Errors
    /// The AL status code with which the slave refuses.
    fn enter(&mut self, target: AlState) -> Result<(), AlStatus>;

    /// Requests what the AL control register asks for. Bootstrap is a matter of the controller in front of a slave with
    /// [files](Self::files); the slave itself stands in Init then, and refuses it here.
    ///
    /// # Errors
    /// The AL status code with which the slave refuses. It may have fallen back to a lower state.
    fn request_state(&mut self, request: RequestedState) -> Result<(), AlStatus> {
        request.without_boot().and_then(|state| self.enter(state))
    }

    /// The AL status code of the last change of state that the slave has refused, or with which it has left a state by
    /// itself; 0 after a change that was made.
    fn al_status(&self) -> AlStatus {
        AlStatus(0)
    }

    /// The slave is switched off and on again.
    fn restart(&mut self) {
        // Every slave can go to Init.
        let _ = self.enter(AlState::Init);
    }

    /// SDO upload: puts as many of the first bytes of the value into `value` as there is room for. The length of the whole
    /// value.
    ///
    /// # Errors
    /// The SDO abort code.
    fn read(&mut self, object: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode>;

    /// SDO download of a whole value.
    ///
    /// # Errors
    /// The SDO abort code.
    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode>;

    /// The first object of the slave with an index of at least `from`; `None`: there is none. SDO information tells a master
    /// which objects there are.
    fn object_from(&self, from: u16) -> Option<u16> {
        let _ = from;
        None
    }

    /// The description of an object.
    ///
    /// # Errors
    /// [`AbortCode::NO_OBJECT`]; [`AbortCode::NO_DICTIONARY`]: the slave tells nothing of its objects.
    fn describe_object(&self, index: u16) -> Result<ObjectDescription<'_>, AbortCode> {
        let _ = index;
        Err(AbortCode::NO_DICTIONARY)
    }

    /// The description of an entry.
    ///
    /// # Errors
    /// As [`Slave::describe_object`], and [`AbortCode::NO_SUB_INDEX`].
    fn describe_entry(&self, at: ObjectAddress) -> Result<EntryDescription<'_>, AbortCode> {
        let _ = at;
        Err(AbortCode::NO_DICTIONARY)
    }

    /// The indexes of the objects in a list of the SDO information services, in ascending order.
    fn object_list(&self, list: ObjectListType) -> Vec<u16> {
        let mut from = Some(0);
        let objects = std::iter::from_fn(|| {
            let index = self.object_from(from?)?;
            from = index.checked_add(1);
            Some(index)
        });
        let is_in = |index: &u16| {
            let subs = self.describe_object(*index).map_or(0, |object| object.max_sub);
            let mut entries = (0..=subs).filter_map(|sub| self.describe_entry(ObjectAddress::new(*index, sub)).ok());
            entries.any(|entry| dictionary::is_listed(entry.access, list))
        };
        objects.filter(is_in).collect()
    }

    /// SDO upload of one sub-index; of a value of more than 4 bytes the first 4, as the ECM-SK shows them (SK-6).
    ///
    /// # Errors
    /// The SDO abort code.
    fn upload(&mut self, object: ObjectAddress) -> Result<SdoValue, AbortCode> {
        SdoValue::of(|value| self.read(object, SdoScope::Entry, value))
    }

    /// SDO download of 1, 2 or 4 bytes to one sub-index.
    ///
    /// # Errors
    /// The SDO abort code.
    fn download(&mut self, object: ObjectAddress, size: SdoSize, value: u32) -> Result<(), AbortCode> {
        self.write(object, SdoScope::Entry, &value.to_le_bytes()[..size.bytes().into()])
    }

    /// Sets the lengths of sync managers 2 (outputs) and 3 (inputs), bytes; 0: off. A device goes to SafeOP only if they
    /// are as long as the process data that are mapped. Init sets both to 0.
    fn set_sync_managers(&mut self, outputs: u16, inputs: u16) {
        let _ = (outputs, inputs);
    }

    /// Hands over the registers of the controller in front of the slave, before a change of state. Without this call a slave
    /// judges the lengths of its sync managers alone.
    fn set_communication(&mut self, communication: &Communication) {
        let [_, _, outputs, inputs] = communication.sync_managers;
        self.set_sync_managers(outputs.length, inputs.length);
    }

    /// The controller tells the slave how it is synchronized.
    fn report_sync(&mut self, event: SyncEvent) {
        let _ = event;
    }

    /// How long after SafeOP, ns, a slave that runs by SYNC0 waits for its first pulse before it says that it is not synchronized; it
    /// sends no inputs meanwhile. `None`: it sends them, and waits as long as on the way to OP.
    fn sync_lock_limit_ns(&self) -> Option<Ns> {
        None
    }

    /// Which ports of the controller in front of the slave have a link. Without this call it does not know.
    fn note_links(&mut self, links: [bool; PORTS]) {
        let _ = links;
    }

    /// The levels of the latch inputs of the controller in front of the slave, bit 0 that of input 0; `None`: nothing of the slave is
    /// connected to them, and [`Self::tell_latch_changes`] tells nothing.
    fn latch_levels(&self) -> Option<u8> {
        None
    }

    /// Tells each change at the latch inputs during the last [step](Self::step), once.
    fn tell_latch_changes(&mut self, tell: &mut dyn FnMut(LatchChange)) {
        let _ = tell;
    }

    /// The watchdog of outputs in the controller in front of the slave has expired, which runs from the first outputs on: the
    /// slave leaves OP.
    fn expire_watchdog(&mut self) {
        if self.state() == AlState::Op {
            // Every slave can go to a lower state.
            let _ = self.enter(AlState::SafeOp);
        }
    }

    /// Sets the cycle of SYNC0 on a network without controllers; `None`: the slave runs without distributed clocks.
    fn set_sync_cycle(&mut self, cycle_ns: Option<Ns>) {
        let _ = cycle_ns;
    }

    /// The process data of a cycle: the slave takes the output image and puts what it measured last into the input image.
    /// `outputs` is `None` if the master has brought the slave to SafeOP only, in which it takes no outputs.
    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]);

    /// `dt_ns` pass.
    fn step(&mut self, dt_ns: Ns);

    /// The first half of [`Slave::step`]: `dt_ns` begin to pass. A motor that only has to follow a position is handed out,
    /// to be run for that time together with those of other slaves before [`Slave::end_step`] is called.
    fn begin_step(&mut self, dt_ns: Ns) -> Option<&mut Servo> {
        self.step(dt_ns);
        None
    }

    /// The second half of [`Slave::step`].
    fn end_step(&mut self, dt_ns: Ns) {
        let _ = dt_ns;
    }

    /// Causes a fault in the device, or ends it. False: the device has no such axis or channel.
    fn apply_fault(&mut self, fault: Fault) -> bool {
        let _ = fault;
        false
    }

    /// Adds manufacturer-specific objects to the slave's object dictionary. They can be read and written, and mapped as process
    /// data, without any effect.
    fn add_manufacturer_objects(&mut self, objects: ManufacturerObjects) {
        let _ = objects;
    }

    /// Whether a value of the slave may be too long for one message of its mailbox, so that masters need segments.
    fn has_long_values(&self) -> bool {
        true
    }

    /// The files of the slave; `None`: it has none, and no bootstrap.
    fn files(&mut self) -> Option<&mut FileStore> {
        None
    }

    /// What kind of controller is in front of the slave.
    fn controller_settings(&self) -> EscSettings {
        EscSettings::default()
    }

    /// Whether the slave has distributed clocks.
    fn has_dc(&self) -> bool {
        true
    }

    /// Whether the slave goes to OP only once outputs have come. Terminals with outputs alone do not wait: theirs are off until
    /// then.
    fn waits_for_outputs(&self) -> bool {
        true
    }

    /// The true position of the shaft of an axis (from 0), counts; `None`: the slave has no such axis.
    fn shaft(&self, axis: usize) -> Option<i64> {
        let _ = axis;
        None
    }

    /// The fault of an axis (from 0), from when it comes until it is cleared; `None`: there is none, or no such axis.
    fn fault(&self, axis: usize) -> Option<AxisFault> {
        let _ = axis;
        None
    }

    /// The true positions of the shafts of all axes.
    fn shafts(&self) -> [Option<i64>; AXES_MAX] {
        std::array::from_fn(|axis| self.shaft(axis))
    }
}

/// `dt_ns` pass in all slaves of a network, as by [`Slave::step`] of each. `slave` gives the one at a place.
///
/// Motors that only have to follow a position run side by side, which is faster.
pub fn step_all<P>(places: &mut [P], slave: impl Fn(&mut P) -> &mut dyn Slave, dt_ns: Ns) {
    for places in places.chunks_mut(SIDE_BY_SIDE) {
        let mut motors = [const { None }; SIDE_BY_SIDE];
        for (motor, place) in motors.iter_mut().zip(&mut *places) {
            *motor = slave(place).begin_step(dt_ns);
        }
        follow_side_by_side(&mut motors, dt_ns);
        places.iter_mut().for_each(|place| slave(place).end_step(dt_ns));
    }
}
