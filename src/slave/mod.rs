//! Models of EtherCAT slaves. A master drives them through the trait [`Slave`]; they do not depend on the board.
//!
//! | file or folder | content |
//! | --- | --- |
//! | `drive.rs`, `hsp.rs`, `io.rs` | servo drive and stepper, pulse module, digital IO; their objects in `*/objects.rs` |
//! | `dp3cl/` | complete model of the stepper drive Xinje DP3CL |
//! | `device/`, `device.rs` | the common part of all kinds: AL states, mailbox, identity, process data, faults |
//! | `identity.rs` | the identity objects of a device |
//! | `communication.rs` | the settings of sync managers, watchdog and clocks that a device checks |
//! | `al.rs` | the allowed changes of the AL state, and the watchdog for outputs |
//! | `dictionary/`, `dictionary.rs` | reading and writing of objects by SDO |
//! | `manufacturer/`, `manufacturer.rs` | manufacturer-specific objects that are read from a file |
//! | `process_data/`, `process_data.rs` | PDO mapping, and the transfer of process data in a cycle |
//! | `axis/`, `axis.rs` | the axis: modes of operation, following error, statusword |
//! | `axis_objects.rs` | the objects of every axis, and the settings that the axis reads from them |
//! | `state_machine.rs` | the states and transitions of CiA 402 |
//! | `homing/` | homing: `method.rs` the homing methods (0x6098), `run.rs` one search for home, `mod.rs` the mode |
//! | `switches.rs` | limit switches, home switch, index pulse and end stops along the travel of an axis |
//! | `plant/`, `plant.rs` | the physics: a motor with its load and control loops, or a pulse train |
//! | `lines.rs` | digital inputs and outputs |
//! | `files.rs` | the files of a device: firmware and others |
//! | `fault.rs` | faults inside a device, for scripts and tests |
//! | `handle.rs` | the handle with which scripts and tests access a running network |
//! | `esc/` | the slave controllers of the slaves, as the network sees them |
//! | `cable.rs` | faults between a network and its slaves: cuts, lost power, refused states, aborted SDOs |
//!
//! To add a kind of slave: implement [`device::Model`] in a file beside `drive.rs`, and add its row to `address/kinds.rs`.
//! `testbed/build.rs` builds it. If the board maps other process data for it, also add a table to `fieldbus/pdo.rs`. To add
//! a homing method: `homing/method.rs`. To add a fault: `fault.rs`, and a script verb in `testbed/script/verbs.rs`.

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

/// The maximum number of axes of a slave: a pulse module with two channels has two.
pub const AXES_MAX: usize = 2;

/// The value of at most 4 bytes that an SDO upload has read, or the first 4 bytes of a longer value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SdoValue {
    /// The number of bytes, out of 4, that belong to the value.
    pub size: u8,
    /// The bytes of the value as a little-endian number, zero-extended.
    pub bits: u32,
}

impl SdoValue {
    /// Calls `read` with a buffer of 4 bytes. `read` copies the first bytes of the value into it and returns the length
    /// of the whole value. For a longer value, the result is the first 4 bytes.
    fn of(read: impl FnOnce(&mut [u8]) -> Result<usize, AbortCode>) -> Result<Self, AbortCode> {
        let mut first = [0; 4];
        let len = read(&mut first)?;
        Ok(Self { size: len.min(4) as u8, bits: u32::from_le_bytes(first) })
    }
}

/// One simulated slave: AL state machine, mailbox, process data and physics.
///
/// Time advances only in [`Slave::step`]. Calculations use integers, or `+ - * /` and `sqrt` of `f64`, which give the same
/// bits on every target.
pub trait Slave: Send {
    /// The display name of the slave, such as `drive`.
    fn name(&self) -> &str;

    /// The identity of the slave and its serial number, in any state; `None` if the slave has none.
    fn identity(&self) -> Option<(&Identity, u32)> {
        None
    }

    /// The station alias that the slave has at power-on; 0: none.
    fn station_alias(&self) -> u16 {
        0
    }

    /// The AL state. A slave may leave a state on its own, for example when no outputs come.
    fn state(&self) -> AlState;

    /// Requests an AL state. After `Ok` the slave is in that state.
    ///
    /// # Errors
    /// The AL status code of the refusal, for example for a change that is not allowed, or for an invalid PDO mapping on the
    /// way to SafeOP.
    fn enter(&mut self, target: AlState) -> Result<(), AlStatus>;

    /// Handles a request in the AL control register. A slave with [files](Self::files) is in Init while its slave controller
    /// handles bootstrap, so a request for bootstrap that reaches the slave is refused.
    ///
    /// # Errors
    /// The AL status code of the refusal. The slave may have fallen back to a lower state.
    fn request_state(&mut self, request: RequestedState) -> Result<(), AlStatus> {
        request.without_boot().and_then(|state| self.enter(state))
    }

    /// The AL status code: the reason of the last refused state change, or why the slave has left a state on its own; 0
    /// after a successful change.
    fn al_status(&self) -> AlStatus {
        AlStatus(0)
    }

    /// Power-cycles the slave: it returns to Init with its power-on values. Non-volatile values are kept.
    fn restart(&mut self) {
        // Every slave can go to Init, so the result is always `Ok`.
        let _ = self.enter(AlState::Init);
    }

    /// SDO upload: copies the value into `value`, as far as there is room. Returns the length of the whole value, bytes.
    ///
    /// # Errors
    /// The SDO abort code, for example if the object does not exist, is write-only, or cannot be accessed in the present state.
    fn read(&mut self, object: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode>;

    /// SDO download of a whole value.
    ///
    /// # Errors
    /// The SDO abort code, for example if the object does not exist, is read-only, or has another length or range.
    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode>;

    /// The lowest existing object index from `from` on; `None` if there is none. The basis of the object lists of SDO
    /// information.
    fn object_from(&self, from: u16) -> Option<u16> {
        let _ = from;
        None
    }

    /// The description of an object for SDO information.
    ///
    /// # Errors
    /// [`AbortCode::NO_OBJECT`]. [`AbortCode::NO_DICTIONARY`]: the slave does not support SDO information.
    fn describe_object(&self, index: u16) -> Result<ObjectDescription<'_>, AbortCode> {
        let _ = index;
        Err(AbortCode::NO_DICTIONARY)
    }

    /// The description of a sub-index for SDO information.
    ///
    /// # Errors
    /// The errors of [`Slave::describe_object`], and [`AbortCode::NO_SUB_INDEX`].
    fn describe_entry(&self, at: ObjectAddress) -> Result<EntryDescription<'_>, AbortCode> {
        let _ = at;
        Err(AbortCode::NO_DICTIONARY)
    }

    /// The indices of an object list of SDO information, in ascending order.
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

    /// SDO upload of one sub-index. For a value longer than 4 bytes, it returns the first 4 bytes, as the ECM-SK does
    /// (SK-6).
    ///
    /// # Errors
    /// As [`Slave::read`].
    fn upload(&mut self, object: ObjectAddress) -> Result<SdoValue, AbortCode> {
        SdoValue::of(|value| self.read(object, SdoScope::Entry, value))
    }

    /// SDO download of 1, 2 or 4 bytes to one sub-index.
    ///
    /// # Errors
    /// As [`Slave::write`].
    fn download(&mut self, object: ObjectAddress, size: SdoSize, value: u32) -> Result<(), AbortCode> {
        self.write(object, SdoScope::Entry, &value.to_le_bytes()[..size.bytes().into()])
    }

    /// Sets the lengths of sync managers 2 (outputs) and 3 (inputs), bytes; 0 means off. A device goes to SafeOP only if
    /// they match the lengths of the mapped process data. Init resets both to 0.
    fn set_sync_managers(&mut self, outputs: u16, inputs: u16) {
        let _ = (outputs, inputs);
    }

    /// Passes settings of the slave controller to the slave, before a change of state. A slave may check all of them; by
    /// default, and without this call, it checks only the lengths of its sync managers.
    fn set_communication(&mut self, communication: &Communication) {
        let [_, _, outputs, inputs] = communication.sync_managers;
        self.set_sync_managers(outputs.length, inputs.length);
    }

    /// Reports a synchronization event of the slave controller to the slave, for example a missing SYNC0 pulse.
    fn report_sync(&mut self, event: SyncEvent) {
        let _ = event;
    }

    /// For a slave that runs by SYNC0: the time limit for the first SYNC0 pulse after the change to SafeOP, ns. When
    /// this time expires, the slave reports a synchronization error. It sends no inputs before the first pulse. `None`:
    /// it sends inputs at once, and only the change to OP fails without SYNC0.
    fn sync_lock_limit_ns(&self) -> Option<Ns> {
        None
    }

    /// Reports which ports of the slave controller have a link. A network without slave controllers does not call this.
    fn note_links(&mut self, links: [bool; PORTS]) {
        let _ = links;
    }

    /// The levels of the latch inputs of the slave controller; bit 0 is input 0. `None`: the slave drives no latch inputs,
    /// and [`Self::tell_latch_changes`] reports nothing.
    fn latch_levels(&self) -> Option<u8> {
        None
    }

    /// Calls `tell` for each change at the latch inputs during the last [step](Self::step). A second call reports nothing.
    fn tell_latch_changes(&mut self, tell: &mut dyn FnMut(LatchChange)) {
        let _ = tell;
    }

    /// Reports that the slave controller's watchdog for outputs, which runs from the first outputs on, has expired: the
    /// slave leaves OP.
    fn expire_watchdog(&mut self) {
        if self.state() == AlState::Op {
            // Every slave can go to a lower state, so the result is always `Ok`.
            let _ = self.enter(AlState::SafeOp);
        }
    }

    /// Sets the SYNC0 cycle time on a network without slave controllers, ns; `None`: the slave runs without distributed
    /// clocks.
    fn set_sync_cycle(&mut self, cycle_ns: Option<Ns>) {
        let _ = cycle_ns;
    }

    /// Exchanges the process data of a cycle: the slave takes over the output image and writes its latest measurements into
    /// the input image. `outputs` is `None` if the slave accepts no outputs, because the master has brought it only to
    /// SafeOP.
    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]);

    /// Advances the slave by `dt_ns`.
    fn step(&mut self, dt_ns: Ns);

    /// The first half of [`Slave::step`]. If the slave returns a motor, the motor has a position as its setpoint: the
    /// caller runs it for `dt_ns` with [`follow_side_by_side`], together with the motors of other slaves, then calls
    /// [`Slave::end_step`]. `None`: no motor is left to run.
    fn begin_step(&mut self, dt_ns: Ns) -> Option<&mut Servo> {
        self.step(dt_ns);
        None
    }

    /// The second half of [`Slave::step`], called after [`Slave::begin_step`].
    fn end_step(&mut self, dt_ns: Ns) {
        let _ = dt_ns;
    }

    /// Starts or ends a fault in the device. Returns false if the device has no such axis or channel.
    fn apply_fault(&mut self, fault: Fault) -> bool {
        let _ = fault;
        false
    }

    /// Gives the slave another vendor, product code or revision; `None` keeps the present value. Nothing else changes.
    fn set_identity(&mut self, vendor: Option<u32>, product: Option<u32>, revision: Option<u32>) {
        let _ = (vendor, product, revision);
    }

    /// Adds manufacturer-specific objects to the slave's object dictionary. They can be read, written and mapped as process
    /// data, and have no effect.
    fn add_manufacturer_objects(&mut self, objects: ManufacturerObjects) {
        let _ = objects;
    }

    /// Whether the slave may have values that are too long for one mailbox message, so that masters need segments.
    fn has_long_values(&self) -> bool {
        true
    }

    /// The files of the slave; `None` if it has neither files nor bootstrap.
    fn files(&mut self) -> Option<&mut FileStore> {
        None
    }

    /// The properties of the slave controller that this slave gets in a simulation with frames, such as the numbers of FMMUs
    /// and sync managers.
    fn controller_settings(&self) -> EscSettings {
        EscSettings::default()
    }

    /// Whether the slave has distributed clocks.
    fn has_dc(&self) -> bool {
        true
    }

    /// Whether the slave goes to OP only after outputs have come. IO modules do not wait: in OP their outputs are off
    /// until the master has sent outputs.
    fn waits_for_outputs(&self) -> bool {
        true
    }

    /// The true shaft position of an axis (from 0), counts; `None` if the slave has no such axis.
    fn shaft(&self, axis: usize) -> Option<i64> {
        let _ = axis;
        None
    }

    /// The fault of an axis (from 0) until it is cleared; `None` if there is no fault or no such axis.
    fn fault(&self, axis: usize) -> Option<AxisFault> {
        let _ = axis;
        None
    }

    /// The true shaft positions of all axes, counts.
    fn shafts(&self) -> [Option<i64>; AXES_MAX] {
        std::array::from_fn(|axis| self.shaft(axis))
    }
}

/// Advances all slaves of a network by `dt_ns`, with the same result as [`Slave::step`] for each. `slave` returns the slave
/// that an item of `places` holds.
///
/// Motors that have a position as their setpoint are computed together by vector instructions, which is faster.
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
