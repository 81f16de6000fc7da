//! What every simulated device does alike: AL states, mailbox, identity, process data, faults.
//!
//! A kind of slave keeps a [`Base`] and implements [`Model`], which says what sets it apart: its objects, its PDOs, its
//! axes. [`Slave`] and the dictionary's [`Device`](super::dictionary::Device) are implemented here for every [`Model`].

use super::al::ApplicationLayer;
use super::axis::Axis;
use super::dictionary::{self, Object, Values};
use super::lines::Lines;
use super::manufacturer::ManufacturerObjects;
use super::plant::Following;
use super::process_data::{self, Mapping, Pdo, Plan};
use super::switches::Input;
use super::{AlStatus, Fault, ObjectDirectory, Slave};
use crate::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::{AlState, Ns};

/// Vendor ID, 0x1018:1, of the devices here. \[OURS] "ECMS": no vendor has this number.
pub const VENDOR_ID: u32 = 0x4543_4D53;

/// The identity of a kind of slave, as its objects show it.
#[derive(Clone, Copy, Debug)]
pub struct Identity {
    /// Device type, 0x1000: device profile and kind of device.
    pub device_type: u32,
    /// Device name, 0x1008.
    pub name: &'static str,
    /// Vendor ID, 0x1018:1.
    pub vendor_id: u32,
    /// Product code, 0x1018:2.
    pub product_code: u32,
    /// Revision, 0x1018:3.
    pub revision: u32,
}

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
    manufacturer: Option<Box<ManufacturerObjects>>,
    mapping: Mapping,
    /// The lengths of sync managers 2 and 3 that the master has set, bytes.
    sync_managers: (u16, u16),
    plan: Plan<M>,
    al: ApplicationLayer,
}

impl<M> Base<M> {
    /// A device at power-on: the name that people know it by, its serial number (0x1018:4), its identity, its stored
    /// values, and its PDOs.
    pub fn new(name: String, serial: u32, identity: &'static Identity, values: Values, pdos: &[Pdo<M>]) -> Self {
        let (al, mapping, plan) = (ApplicationLayer::default(), Mapping::new(pdos), Plan::with_room());
        Self { name, serial, identity, al, values, manufacturer: None, mapping, sync_managers: (0, 0), plan }
    }

    /// The AL state of the device.
    pub const fn al_state(&self) -> AlState {
        self.al.state()
    }

    /// The PDO mapping and assignment objects.
    pub(super) const fn mapping(&self) -> &Mapping {
        &self.mapping
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
    /// The object dictionary, ascending by address, [`identity`] first. [`check`](dictionary::check) it in a constant.
    fn objects() -> &'static [Object<Self>];

    /// The PDOs that devices of this kind can have at power-on.
    fn pdos() -> &'static [Pdo<Self>];

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

    /// `dt_ns` pass in all of the device but its axes.
    fn pass(&mut self, dt_ns: Ns) {
        let _ = dt_ns;
    }

    /// No outputs come any more: the device has left OP by a change of state or by its watchdog. Its axes brake without
    /// this call.
    fn lose_outputs(&mut self) {}
}

/// Changes an axis (from 0). False: the device has no such axis.
fn change_axis<M: Model>(device: &mut M, axis: usize, change: impl FnOnce(&mut Axis)) -> bool {
    device.axes_mut().get_mut(axis).map(change).is_some()
}

fn lose_outputs<M: Model>(device: &mut M) {
    device.axes_mut().iter_mut().for_each(|axis| axis.machine_mut().lose_master());
    device.lose_outputs();
}

/// Time passes in the AL state machine; its watchdog may end OP.
fn step_al<M: Model>(device: &mut M, dt_ns: Ns) {
    let Base { al, plan, .. } = device.base_mut();
    if plan.lengths().0 == 0 {
        // Without mapped outputs the watchdog of outputs must not expire.
        al.note_outputs();
    }
    if al.step(dt_ns) {
        lose_outputs(device);
    }
}

/// Compiles the present mapping into the plan by which a cycle moves process data.
fn compile<M: Model>(device: &mut M) -> Result<(), AlStatus> {
    let mut plan = std::mem::take(&mut device.base_mut().plan);
    let compiled = plan.compile(device, &device.base().mapping);
    device.base_mut().plan = plan;
    compiled.and_then(|()| device.base().fits_sync_managers())
}

/// Whether an object may be mapped into a PDO of that direction.
fn may_map<M: Model>(device: &M, direction: dictionary::PdoDirection, entry: u32) -> Result<(), AbortCode> {
    process_data::may_map(device, direction, entry).map_err(|code| {
        let at = ObjectAddress::new((entry >> 16) as u16, (entry >> 8) as u8);
        let is_elsewhere = device.base().mapping.has(at.index) || has_manufacturer_object(device, at);
        if is_absent(code) && is_elsewhere { AbortCode::NOT_MAPPABLE } else { code }
    })
}

fn has_manufacturer_object<M: Model>(device: &M, at: ObjectAddress) -> bool {
    let read = |manufacturer: &ManufacturerObjects| {
        manufacturer.read(at, SdoScope::Entry, &mut [], AbortCode::NO_OBJECT).is_ok()
    };
    device.base().manufacturer.as_deref().is_some_and(read)
}

/// Whether an abort code says that the object dictionary of the kind has no such object, so that the object may be a
/// manufacturer-specific one.
const fn is_absent(code: AbortCode) -> bool {
    matches!(code, AbortCode::NO_OBJECT | AbortCode::NO_SUB_INDEX)
}

/// In Init the mailbox does not answer, and the SDO transfer of the master times out.
fn check_mailbox<M: Model>(device: &M) -> Result<(), AbortCode> {
    if device.base().al_state() == AlState::Init { Err(AbortCode::TIMEOUT) } else { Ok(()) }
}

impl<M: Model> Slave for M {
    fn name(&self) -> &str {
        &self.base().name
    }

    fn state(&self) -> AlState {
        self.base().al_state()
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        let was = self.base().al_state();
        let ready = if (was, target) == (AlState::PreOp, AlState::SafeOp) { compile(self) } else { Ok(()) };
        let base = self.base_mut();
        base.al.enter(target, ready)?;
        if target == AlState::Init {
            base.sync_managers = (0, 0);
        }
        if was == AlState::Op && target != AlState::Op {
            lose_outputs(self);
        }
        Ok(())
    }

    fn read(&mut self, object: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
        check_mailbox(self)?;
        let Base { mapping, manufacturer, .. } = self.base();
        if mapping.has(object.index) {
            return mapping.read(object, scope, value);
        }
        match dictionary::read(self, object, scope, value) {
            Err(code) if is_absent(code) => {
                manufacturer.as_ref().map_or(Err(code), |manufacturer| manufacturer.read(object, scope, value, code))
            }
            answer => answer,
        }
    }

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        check_mailbox(self)?;
        let Base { mapping, al, .. } = self.base();
        if mapping.has(object.index) {
            let may_map = |direction, entry| may_map(self, direction, entry);
            let list = mapping.written(object, scope, value, al.state(), may_map)?;
            self.base_mut().mapping.put(list);
            return Ok(());
        }
        match dictionary::write(self, object, scope, value) {
            Err(code) if is_absent(code) => {
                let manufacturer = self.base_mut().manufacturer.as_mut();
                manufacturer.map_or(Err(code), |manufacturer| manufacturer.write(object, scope, value, code))
            }
            answer => answer,
        }
    }

    fn set_sync_managers(&mut self, outputs: u16, inputs: u16) {
        self.base_mut().sync_managers = (outputs, inputs);
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        process_data::put_inputs(self, inputs);
        let Some(outputs) = outputs.filter(|_| self.base().al_state() == AlState::Op) else { return };
        self.base_mut().al.note_outputs();
        process_data::take_outputs(self, outputs);
    }

    fn step(&mut self, dt_ns: Ns) {
        step_al(self, dt_ns);
        self.axes_mut().iter_mut().for_each(|axis| axis.step(dt_ns));
        self.pass(dt_ns);
    }

    fn begin_step(&mut self, dt_ns: Ns) -> Option<Following<'_>> {
        step_al(self, dt_ns);
        match self.axes_mut() {
            [axis] => axis.begin_step(dt_ns),
            axes => {
                axes.iter_mut().for_each(|axis| axis.step(dt_ns));
                None
            }
        }
    }

    fn end_step(&mut self, dt_ns: Ns) {
        if let [axis] = self.axes_mut() {
            axis.end_step(dt_ns);
        }
        self.pass(dt_ns);
    }

    fn apply_fault(&mut self, fault: Fault) -> bool {
        match fault {
            Fault::Alarm { axis, fault } => change_axis(self, axis, |axis| axis.machine_mut().raise(fault)),
            Fault::Stick { axis, input, value } => change_axis(self, axis, |axis| match input {
                Some(input) => axis.stick(input, value),
                None => Input::ALL.into_iter().for_each(|input| axis.stick(input, value)),
            }),
            Fault::Jam { axis, jammed } => change_axis(self, axis, |axis| axis.jam(jammed)),
            Fault::ForceInputs { channel, pattern } => {
                self.lines_mut().get_mut(channel).map(|lines| lines.force(pattern)).is_some()
            }
        }
    }

    fn add_manufacturer_objects(&mut self, manufacturer: ManufacturerObjects) {
        self.base_mut().manufacturer = Some(Box::new(manufacturer));
    }

    fn has_dc(&self) -> bool {
        Model::has_dc(self)
    }

    fn shaft(&self, axis: usize) -> Option<i64> {
        self.axes().get(axis).map(|axis| axis.plant().position())
    }

    fn object_directory(&self) -> Option<&dyn ObjectDirectory> {
        Some(self)
    }
}

impl<M: Model> dictionary::Device for M {
    fn objects() -> &'static [Object<Self>] {
        M::objects()
    }

    fn values(&self) -> &Values {
        &self.base().values
    }

    fn values_mut(&mut self) -> &mut Values {
        &mut self.base_mut().values
    }

    fn al_state(&self) -> AlState {
        self.base().al_state()
    }
}

impl<M: Model> process_data::Planned for M {
    fn plan(&self) -> &Plan<M> {
        &self.base().plan
    }

    fn pdos() -> &'static [Pdo<M>] {
        M::pdos()
    }
}

/// Objects 0x1000 to 0x1018, which every device has and programs look for, and the sync manager types, 0x1C00.
pub const fn identity<M: Model>() -> [Object<M>; 13] {
    [
        Object::u32(0x1000, 0, "Device type").live(|device: &M| device.base().identity.device_type.into()),
        Object::u8(0x1001, 0, "Error register").live(error_register),
        Object::text(0x1008, 0, "Device name", |device: &M| device.base().identity.name),
        Object::u8(0x1018, 0, "Identity").default(4),
        Object::u32(0x1018, 1, "Vendor ID").live(|device: &M| device.base().identity.vendor_id.into()),
        Object::u32(0x1018, 2, "Product code").live(|device: &M| device.base().identity.product_code.into()),
        Object::u32(0x1018, 3, "Revision").live(|device: &M| device.base().identity.revision.into()),
        Object::u32(0x1018, 4, "Serial number").live(|device: &M| device.base().serial.into()),
        Object::u8(0x1C00, 0, "Sync manager types").default(4),
        Object::u8(0x1C00, 1, "Mailbox out").default(1),
        Object::u8(0x1C00, 2, "Mailbox in").default(2),
        Object::u8(0x1C00, 3, "Outputs").default(3),
        Object::u8(0x1C00, 4, "Inputs").default(4),
    ]
}

/// Objects 0x1C32 and 0x1C33, the synchronization of a device with distributed clocks. \[OURS] It is DC with SYNC0 until a
/// master writes another type. The type makes no difference, since the simulated network has one clock.
pub const fn synchronization<M: Model>() -> [Object<M>; 4] {
    const DC_SYNC0: i64 = 2;
    [
        Object::u8(0x1C32, 0, "SM output parameter").default(1),
        Object::u16(0x1C32, 1, "Synchronization type").rw_up_to(AlState::PreOp).range(0, DC_SYNC0).default(DC_SYNC0),
        Object::u8(0x1C33, 0, "SM input parameter").default(1),
        Object::u16(0x1C33, 1, "Synchronization type").rw_up_to(AlState::PreOp).range(0, DC_SYNC0).default(DC_SYNC0),
    ]
}

/// The error register (CiA 301 7.5.2.2) for the error codes of the axes: bit 0 for any error, and the bits of their groups.
fn error_register<M: Model>(device: &M) -> i64 {
    let bits = |code: u16| match code >> 12 {
        0 => 0,
        2 => 1 | 1 << 1,
        3 => 1 | 1 << 2,
        4 => 1 | 1 << 3,
        _ if code >> 8 == 0x81 => 1 | 1 << 4,
        0xF => 1 | 1 << 7,
        _ => 1 | 1 << 5,
    };
    device.axes().iter().fold(0, |register, axis| register | bits(axis.measured().error_code))
}
