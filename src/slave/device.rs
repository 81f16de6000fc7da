//! The common part of all simulated devices: AL states, mailbox, identity, process data, faults.
//!
//! A kind of slave has a [`Base`] and implements [`Model`], which defines the specifics of the kind: its objects, its PDOs,
//! its axes. `device/as_slave.rs` implements [`Slave`](super::Slave) and the dictionary's
//! [`Device`](super::dictionary::Device) for every [`Model`]; `device/objects.rs` has the objects of every device.

mod as_slave;
mod information;
mod objects;
mod sync_types;
mod test_memory;

use super::al::ApplicationLayer;
use super::axis::Axis;
use super::communication::{Communication, LatchChange, SyncEvent};
use super::dictionary::{Object, Values};
use super::esc::EscSettings;
use super::files::FileStore;
use super::lines::Lines;
use super::manufacturer::ManufacturerObjects;
use super::plant::Servo;
use super::process_data::{Mapping, MappingLimits, Pdo, Plan};
use super::switches::Input;
use super::{AlStatus, Fault};
use crate::ethercat::cia402::error_name;
use crate::ethercat::registers::{PORTS, RequestedState};
use crate::ethercat::{AlState, Ns};

pub use super::identity::Identity;
pub(super) use as_slave::fall;
pub use objects::{both, description, free_run, identity, synchronization};
use sync_types::SyncTypes;
pub use test_memory::{TEST_MEMORY, TEST_MEMORY_BYTES_MAX};

/// Vendor ID, 0x1018:1, of the simulated devices. \[OURS] "ECMS": no vendor has this number.
pub const VENDOR_ID: u32 = 0x4543_4D53;

/// The data that every device has, whatever its kind.
#[derive(Clone, Debug)]
#[repr(C)] // The fields that a cycle uses are together at the end, so that they share cache lines.
pub struct Base<M> {
    name: String,
    serial: u32,
    identity: Identity,
    /// The stored values of the object dictionary.
    pub values: Values,
    /// Manufacturer-specific objects that were added to the object dictionary of this kind of device; `None`: no such
    /// objects.
    pub(super) manufacturer: Option<Box<ManufacturerObjects>>,
    /// The files of the device; `None` if it does not support files.
    files: Option<Box<FileStore>>,
    /// The content of the test object [`TEST_MEMORY`].
    test_memory: Vec<u8>,
    mapping: Mapping,
    /// The synchronization types, 0x1C32:1 and 0x1C33:1.
    sync_types: SyncTypes,
    /// The lengths of sync managers 2 and 3 as set by the master, bytes.
    sync_managers: (u16, u16),
    pub(super) plan: Plan<M>,
    al: ApplicationLayer,
}

impl<M: Model> Base<M> {
    /// A device in its power-on state, with its display name, serial number (0x1018:4), identity, stored values and PDOs.
    pub fn new(name: String, serial: u32, identity: &Identity, values: Values, pdos: &[Pdo<M>]) -> Self {
        let (al, mapping, plan) = (ApplicationLayer::default(), Mapping::new(pdos, M::LIMITS), Plan::with_room());
        // Reserved in advance, so that transfers do not allocate.
        let test_memory = Vec::with_capacity(if M::TEST_MEMORY { TEST_MEMORY_BYTES_MAX } else { 0 });
        let (manufacturer, sync_managers) = (None, (0, 0));
        let files = M::FIRMWARE.map(|firmware| Box::new(FileStore::new(firmware)));
        let sync_types = SyncTypes::default();
        Self {
            name,
            serial,
            identity: *identity,
            al,
            values,
            manufacturer,
            files,
            test_memory,
            mapping,
            sync_types,
            sync_managers,
            plan,
        }
    }

    /// Power-cycles the device: the AL state and the mapping are reset, and `values` replace the stored values. The
    /// caller passes the values that the device keeps without power. Manufacturer-specific objects keep their values,
    /// and files are kept.
    pub fn restart(&mut self, values: Values, pdos: &[Pdo<M>]) {
        let (name, manufacturer) = (std::mem::take(&mut self.name), self.manufacturer.take());
        let files = self.files.take();
        let limits = *self.mapping.limits();
        let new = Self::new(name, self.serial, &self.identity, values, pdos).with_limits(limits, pdos);
        *self = Self { manufacturer, files, ..new };
    }

    /// This device with other limits for its PDO mapping, such as the number of entries of a PDO. `pdos` are the PDOs
    /// at power-on; the mapping is reset to them.
    #[must_use]
    pub fn with_limits(mut self, limits: MappingLimits, pdos: &[Pdo<M>]) -> Self {
        self.mapping = Mapping::new(pdos, limits);
        self
    }

    /// Whether the device has the test object [`TEST_MEMORY`].
    const fn has_test_memory(&self) -> bool {
        M::TEST_MEMORY
    }

    /// The content of the test object [`TEST_MEMORY`].
    const fn test_memory(&self) -> &[u8] {
        self.test_memory.as_slice()
    }

    /// The AL state of the device.
    pub const fn al_state(&self) -> AlState {
        self.al.state()
    }

    /// Checks that the mapped process data have the same lengths as the sync managers: outputs as sync manager 2,
    /// inputs as sync manager 3.
    ///
    /// \[OURS] Sync manager 2 is checked first. So if both are wrong, the AL status code is the one for outputs.
    fn fits_sync_managers(&self) -> Result<(), AlStatus> {
        let ((outputs, inputs), (wanted_outputs, wanted_inputs)) = (self.plan.lengths(), self.sync_managers);
        if outputs != wanted_outputs {
            return Err(AlStatus::INVALID_OUTPUTS);
        }
        if inputs == wanted_inputs { Ok(()) } else { Err(AlStatus::INVALID_INPUTS) }
    }
}

/// A kind of slave: the trait defines everything in which the kinds differ.
pub trait Model: Send + Sized + 'static {
    /// The limits of the PDO mapping.
    const LIMITS: MappingLimits = MappingLimits::USUAL;

    /// Whether the device supports SDO complete access.
    const COMPLETE_ACCESS: bool = true;

    /// Whether an expired watchdog for outputs is an error in SafeOP too: the device then stays in SafeOP and reports
    /// AL status code 0x001B. Otherwise only a device in OP reports it.
    const WATCHDOG_IN_SAFEOP: bool = false;

    /// Whether the device has the test object [`TEST_MEMORY`].
    const TEST_MEMORY: bool = true;

    /// The content of the firmware file at the factory, as text; `None`: the device has neither files nor bootstrap.
    const FIRMWARE: Option<&'static str> = None;

    /// The object dictionary in ascending order of address, beginning with [`identity`]. Apply
    /// [`check`](super::dictionary::check) to it in a constant.
    fn objects() -> &'static [Object<Self>];

    /// All PDOs that devices of this kind have at power-on. A single device may have only some of them, by its
    /// configuration.
    fn pdos() -> &'static [Pdo<Self>];

    /// PDOs with the entries that masters often map on devices of this kind. The index of such a PDO does not matter. A
    /// cycle copies a PDO with these entries, or with those of a power-on PDO, in one function call, which is faster
    /// than copying object by object.
    fn often_mapped() -> &'static [Pdo<Self>] {
        &[]
    }

    /// The part of the device that all kinds have in common: AL state, mapping, stored values.
    fn base(&self) -> &Base<Self>;

    /// The part of the device that all kinds have in common, mutable.
    fn base_mut(&mut self) -> &mut Base<Self>;

    /// The axes of the device.
    fn axes(&self) -> &[Axis] {
        &[]
    }

    /// The axes of the device, mutable.
    fn axes_mut(&mut self) -> &mut [Axis] {
        &mut []
    }

    /// The digital inputs and outputs of the device, mutable, one entry per channel.
    fn lines_mut(&mut self) -> &mut [Lines] {
        &mut []
    }

    /// Whether the device has distributed clocks.
    fn has_dc(&self) -> bool {
        true
    }

    /// Whether the device goes to OP only after outputs have come, see
    /// [`Slave::waits_for_outputs`](super::Slave::waits_for_outputs).
    fn waits_for_outputs(&self) -> bool {
        true
    }

    /// The station alias at power-on; 0: none.
    fn station_alias(&self) -> u16 {
        0
    }

    /// The configuration of the slave controller of the device.
    fn controller_settings(&self) -> EscSettings {
        EscSettings::default()
    }

    /// Advances all parts of the device except its axes by `dt_ns`.
    fn pass(&mut self, dt_ns: Ns) {
        let _ = dt_ns;
    }

    /// Reports that outputs no longer come: the device has left OP by a change of state or by its watchdog. A kind of
    /// device with digital outputs switches them off here. The axes brake by themselves.
    fn lose_outputs(&mut self) {}

    /// Reports that the watchdog for outputs has expired: the device has left OP, or it was in SafeOP and has
    /// [`Self::WATCHDOG_IN_SAFEOP`].
    fn watchdog_expired(&mut self) {}

    /// Decides on a change to the next higher AL state. `mapped` is the result of the checks that all devices have in
    /// common: for SafeOP of the mapping and the sync manager lengths, for OP of the synchronization types.
    ///
    /// # Errors
    /// The AL status code with which the device refuses.
    fn check_change(&mut self, to: AlState, mapped: Result<(), AlStatus>) -> Result<(), AlStatus> {
        let _ = to;
        mapped
    }

    /// Reports that the device has refused a change of its AL state.
    fn change_refused(&mut self, status: AlStatus) {
        let _ = status;
    }

    /// Reports that a master has changed the AL state; `from` is the old state.
    fn state_changed(&mut self, from: AlState) {
        let _ = from;
    }

    /// Refuses a request for Bootstrap or for an AL state that does not exist. Returns the AL status code of the refusal.
    /// The device may fall back to a lower state.
    fn refuse_request(&mut self, request: RequestedState) -> AlStatus {
        request.without_boot().err().unwrap_or(AlStatus::INVALID_CHANGE)
    }

    /// Passes the registers of the slave controller to the device, before a change of state.
    fn set_communication(&mut self, communication: &Communication) {
        let _ = communication;
    }

    /// Sets the SYNC0 cycle time on a network without slave controllers, ns; `None`: the device runs without distributed
    /// clocks.
    fn set_sync_cycle(&mut self, cycle_ns: Option<Ns>) {
        let _ = cycle_ns;
    }

    /// Reports a synchronization event of the slave controller to the device.
    fn report_sync(&mut self, event: SyncEvent) {
        let _ = event;
    }

    /// The time that the device waits for the first SYNC0 pulse after the change to SafeOP, ns, see
    /// [`Slave::sync_lock_limit_ns`](super::Slave::sync_lock_limit_ns). `None`: it has no such limit.
    fn sync_lock_limit_ns(&self) -> Option<Ns> {
        None
    }

    /// Reports which ports of the slave controller have a link.
    fn note_links(&mut self, links: [bool; PORTS]) {
        let _ = links;
    }

    /// The levels of the latch inputs of the slave controller that the device drives; bit 0 is input 0. `None`: it
    /// drives no latch inputs.
    fn latch_levels(&self) -> Option<u8> {
        None
    }

    /// Calls `tell` once for each level change at the latch inputs during the last step.
    fn tell_latch_changes(&mut self, tell: &mut dyn FnMut(LatchChange)) {
        let _ = tell;
    }

    /// Called after each exchange of process data. By default nothing is done.
    #[inline]
    fn note_exchange(&mut self) {}

    /// The true shaft position of an axis (from 0), counts; `None`: the device has no such axis.
    fn shaft(&self, axis: usize) -> Option<i64> {
        self.axes().get(axis).map(|axis| axis.plant().position())
    }

    /// The meaning of the present fault of an axis (from 0), whose error code is `code`.
    fn fault_meaning(&self, axis: usize, code: u16) -> &'static str {
        let _ = axis;
        error_name(code)
    }

    /// Resets the parts of the device that a power cycle resets. The caller has already brought the device to Init. By
    /// default this function does nothing.
    fn restart(&mut self) {}

    /// Advances the axes by `dt_ns`.
    #[inline]
    fn step_axes(&mut self, dt_ns: Ns) {
        self.axes_mut().iter_mut().for_each(|axis| axis.step(dt_ns));
    }

    /// The first half of [`Self::step_axes`] by `dt_ns`, see [`Slave::begin_step`](super::Slave::begin_step). Returns
    /// the motor that the caller has to run; `None`: no motor is left to run.
    #[inline]
    fn begin_axes(&mut self, dt_ns: Ns) -> Option<&mut Servo> {
        match self.axes_mut() {
            [axis] => axis.begin_step(dt_ns),
            axes => {
                axes.iter_mut().for_each(|axis| axis.step(dt_ns));
                None
            }
        }
    }

    /// Starts or ends a fault in the device, see [`Slave::apply_fault`](super::Slave::apply_fault). Returns false if
    /// the device has no such axis or channel.
    fn apply_fault(&mut self, fault: Fault) -> bool {
        apply_fault(self, fault)
    }
}

/// Starts or ends a fault in the axes and digital lines of a device. Returns false if the device has no such axis or
/// channel.
pub fn apply_fault<M: Model>(device: &mut M, fault: Fault) -> bool {
    match fault {
        Fault::Alarm { axis, fault } => change_axis(device, axis, |axis| axis.machine_mut().raise(fault)),
        Fault::AlarmCauseEnds { axis } => change_axis(device, axis, |axis| axis.machine_mut().end_cause()),
        Fault::Stick { axis, input, value } => change_axis(device, axis, |axis| match input {
            Some(input) => axis.stick(input, value),
            None => Input::ALL.into_iter().for_each(|input| axis.stick(input, value)),
        }),
        Fault::Jam { axis, jammed } => change_axis(device, axis, |axis| axis.jam(jammed)),
        Fault::ForceInputs { channel, pattern } => {
            device.lines_mut().get_mut(channel).map(|lines| lines.force(pattern)).is_some()
        }
    }
}

/// Changes an axis (from 0). Returns false if the device has no such axis.
fn change_axis<M: Model>(device: &mut M, axis: usize, change: impl FnOnce(&mut Axis)) -> bool {
    device.axes_mut().get_mut(axis).map(change).is_some()
}
