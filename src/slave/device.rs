//! What every simulated device does alike: AL states, mailbox, identity, process data, faults.
//!
//! A kind of slave keeps a [`Base`] and implements [`Model`], which says what sets it apart: its objects, its PDOs, its
//! axes. [`Slave`](super::Slave) and the dictionary's [`Device`](super::dictionary::Device) are implemented in `device/as_slave.rs` for
//! every [`Model`]; the objects of every device are in `device/objects.rs`.

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

/// Vendor ID, 0x1018:1, of the devices here. \[OURS] "ECMS": no vendor has this number.
pub const VENDOR_ID: u32 = 0x4543_4D53;

/// What every device keeps, whatever its kind.
#[derive(Clone, Debug)]
#[repr(C)] // What a cycle uses lies at the end.
pub struct Base<M> {
    name: String,
    serial: u32,
    identity: &'static Identity,
    /// The stored values of its objects.
    pub values: Values,
    /// Manufacturer-specific objects, which are not in the table of the kind. No cycle uses them.
    pub(super) manufacturer: Option<Box<ManufacturerObjects>>,
    /// The files of the device, if it has some. No cycle uses them.
    files: Option<Box<FileStore>>,
    /// The octets that masters store to test long transfers.
    test_memory: Vec<u8>,
    mapping: Mapping,
    /// How the device is synchronized. No cycle uses it.
    sync_types: SyncTypes,
    /// The lengths of sync managers 2 and 3 that the master has set, bytes.
    sync_managers: (u16, u16),
    pub(super) plan: Plan<M>,
    al: ApplicationLayer,
}

impl<M: Model> Base<M> {
    /// A device at power-on: the name that people know it by, its serial number (0x1018:4), its identity, its stored
    /// values, and its PDOs.
    pub fn new(name: String, serial: u32, identity: &'static Identity, values: Values, pdos: &[Pdo<M>]) -> Self {
        let (al, mapping, plan) = (ApplicationLayer::default(), Mapping::new(pdos, M::LIMITS), Plan::with_room());
        // A transfer does not allocate.
        let test_memory = Vec::with_capacity(if M::TEST_MEMORY { TEST_MEMORY_BYTES_MAX } else { 0 });
        let (manufacturer, sync_managers) = (None, (0, 0));
        let files = M::FIRMWARE.map(|firmware| Box::new(FileStore::new(firmware)));
        let sync_types = SyncTypes::default();
        Self {
            name,
            serial,
            identity,
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

    /// The device loses its power and gets it back: its AL state, its mapping and its stored values are those of power-on.
    /// Manufacturer-specific objects keep their values, and files stay.
    pub fn restart(&mut self, values: Values, pdos: &[Pdo<M>]) {
        let (name, manufacturer) = (std::mem::take(&mut self.name), self.manufacturer.take());
        let files = self.files.take();
        let limits = *self.mapping.limits();
        let new = Self::new(name, self.serial, self.identity, values, pdos).with_limits(limits, pdos);
        *self = Self { manufacturer, files, ..new };
    }

    /// The same device with other limits of its mapping.
    #[must_use]
    pub fn with_limits(mut self, limits: MappingLimits, pdos: &[Pdo<M>]) -> Self {
        self.mapping = Mapping::new(pdos, limits);
        self
    }

    /// Whether the device has [`TEST_MEMORY`].
    const fn has_test_memory(&self) -> bool {
        M::TEST_MEMORY
    }

    /// The octets in it.
    const fn test_memory(&self) -> &[u8] {
        self.test_memory.as_slice()
    }

    /// The AL state of the device.
    pub const fn al_state(&self) -> AlState {
        self.al.state()
    }

    /// Whether the mapped process data are as long as the sync managers.
    ///
    /// \[OURS] Sync manager 2 is checked first.
    fn fits_sync_managers(&self) -> Result<(), AlStatus> {
        let ((outputs, inputs), (wanted_outputs, wanted_inputs)) = (self.plan.lengths(), self.sync_managers);
        if outputs != wanted_outputs {
            return Err(AlStatus::INVALID_OUTPUTS);
        }
        if inputs == wanted_inputs { Ok(()) } else { Err(AlStatus::INVALID_INPUTS) }
    }
}

/// A kind of slave: what sets it apart from the others.
pub trait Model: Send + Sized + 'static {
    /// What devices of this kind allow in their mapping.
    const LIMITS: MappingLimits = MappingLimits::USUAL;

    /// Whether devices of this kind have complete access.
    const COMPLETE_ACCESS: bool = true;

    /// Whether the watchdog of outputs is a mistake in SafeOP, too.
    const WATCHDOG_IN_SAFEOP: bool = false;

    /// Whether devices of this kind have [`TEST_MEMORY`].
    const TEST_MEMORY: bool = true;

    /// The firmware with which devices of this kind come from the factory; `None`: they have no files and no bootstrap.
    const FIRMWARE: Option<&'static str> = None;

    /// The object dictionary, ascending by address, [`identity`] first. [`check`](super::dictionary::check) it in a constant.
    fn objects() -> &'static [Object<Self>];

    /// The PDOs that devices of this kind can have at power-on.
    fn pdos() -> &'static [Pdo<Self>];

    /// PDOs that masters often make of the objects of this kind, whatever their index: a cycle moves them as fast as those of
    /// power-on.
    fn often_mapped() -> &'static [Pdo<Self>] {
        &[]
    }

    /// What every device keeps.
    fn base(&self) -> &Base<Self>;

    /// What every device keeps, to be changed.
    fn base_mut(&mut self) -> &mut Base<Self>;

    /// The axes of the device.
    fn axes(&self) -> &[Axis] {
        &[]
    }

    /// The axes of the device, to be moved.
    fn axes_mut(&mut self) -> &mut [Axis] {
        &mut []
    }

    /// The digital inputs and outputs of the device, one entry for each channel.
    fn lines_mut(&mut self) -> &mut [Lines] {
        &mut []
    }

    /// Whether the device has distributed clocks.
    fn has_dc(&self) -> bool {
        true
    }

    /// As [`Slave::waits_for_outputs`](super::Slave::waits_for_outputs).
    fn waits_for_outputs(&self) -> bool {
        true
    }

    /// The station alias at power-on; 0: none.
    fn station_alias(&self) -> u16 {
        0
    }

    /// What kind of controller is in front of the device.
    fn controller_settings(&self) -> EscSettings {
        EscSettings::default()
    }

    /// `dt_ns` pass in all of the device but its axes.
    fn pass(&mut self, dt_ns: Ns) {
        let _ = dt_ns;
    }

    /// No outputs come any more: the device has left OP by a change of state or by its watchdog. Its axes brake without
    /// this call.
    fn lose_outputs(&mut self) {}

    /// The watchdog of outputs has expired, and the device has left OP.
    fn watchdog_expired(&mut self) {}

    /// Judges a change of the AL state to the next higher one. `mapped`: on the way to SafeOP what the mapping and the lengths
    /// of the sync managers allow, on the way to OP what the synchronization does.
    ///
    /// # Errors
    /// The AL status code with which the device refuses.
    fn check_change(&mut self, to: AlState, mapped: Result<(), AlStatus>) -> Result<(), AlStatus> {
        let _ = to;
        mapped
    }

    /// The device has refused a change of its AL state.
    fn change_refused(&mut self, status: AlStatus) {
        let _ = status;
    }

    /// A master has changed the AL state from `from` to another one.
    fn state_changed(&mut self, from: AlState) {
        let _ = from;
    }

    /// A master requests an AL state that does not exist, or Bootstrap: the AL status code with which the device refuses.
    /// It may have fallen back to a lower state.
    fn refuse_request(&mut self, request: RequestedState) -> AlStatus {
        request.without_boot().err().unwrap_or(AlStatus::INVALID_CHANGE)
    }

    /// The registers of the controller in front of the device, before a change of state.
    fn set_communication(&mut self, communication: &Communication) {
        let _ = communication;
    }

    /// The cycle of SYNC0 on a network without controllers; `None`: the device runs without distributed clocks.
    fn set_sync_cycle(&mut self, cycle_ns: Option<Ns>) {
        let _ = cycle_ns;
    }

    /// The controller tells the device how it is synchronized.
    fn report_sync(&mut self, event: SyncEvent) {
        let _ = event;
    }

    /// As [`Slave::sync_lock_limit_ns`](super::Slave::sync_lock_limit_ns).
    fn sync_lock_limit_ns(&self) -> Option<Ns> {
        None
    }

    /// As [`Slave::note_links`](super::Slave::note_links).
    fn note_links(&mut self, links: [bool; PORTS]) {
        let _ = links;
    }

    /// As [`Slave::latch_levels`](super::Slave::latch_levels).
    fn latch_levels(&self) -> Option<u8> {
        None
    }

    /// As [`Slave::tell_latch_changes`](super::Slave::tell_latch_changes).
    fn tell_latch_changes(&mut self, tell: &mut dyn FnMut(LatchChange)) {
        let _ = tell;
    }

    /// Process data pass.
    #[inline]
    fn note_exchange(&mut self) {}

    /// The true position of the shaft of an axis (from 0), counts; `None`: the device has no such axis.
    fn shaft(&self, axis: usize) -> Option<i64> {
        self.axes().get(axis).map(|axis| axis.plant().position())
    }

    /// What the present fault of an axis (from 0) means, whose error code this is.
    fn fault_meaning(&self, axis: usize, code: u16) -> &'static str {
        let _ = axis;
        error_name(code)
    }

    /// The device is switched off, and on again: the AL state is Init.
    fn restart(&mut self) {}

    /// `dt_ns` pass in the axes.
    #[inline]
    fn step_axes(&mut self, dt_ns: Ns) {
        self.axes_mut().iter_mut().for_each(|axis| axis.step(dt_ns));
    }

    /// `dt_ns` begin to pass in the axes, as by [`Slave::begin_step`](super::Slave::begin_step).
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

    /// Causes a fault in the device, as [`Slave::apply_fault`](super::Slave::apply_fault) does.
    fn apply_fault(&mut self, fault: Fault) -> bool {
        apply_fault(self, fault)
    }
}

/// Causes a fault in the axes and lines of a device. False: it has no such axis or channel.
pub fn apply_fault<M: Model>(device: &mut M, fault: Fault) -> bool {
    match fault {
        Fault::Alarm { axis, fault } => change_axis(device, axis, |axis| axis.machine_mut().raise(fault)),
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

/// Changes an axis (from 0). False: the device has no such axis.
fn change_axis<M: Model>(device: &mut M, axis: usize, change: impl FnOnce(&mut Axis)) -> bool {
    device.axes_mut().get_mut(axis).map(change).is_some()
}
