//! What every simulated device does alike: AL states, mailbox, identity, the way process data reach its axes.
//!
//! A device keeps a [`Base`] and implements [`Model`] with what is its own: its objects, the roles it takes, and what
//! its outputs and its time do apart from its axes. [`Slave`] and the dictionary's
//! [`Device`](super::dictionary::Device) follow from that.

use super::al::ApplicationLayer;
use super::axis::Axis;
use super::dictionary::{self, Object, Values};
use super::lines::{InputPattern, Lines};
use super::makers::MakersObjects;
use super::plant::Following;
use super::state_machine::DeviceFault;
use super::switches::Input;
use super::{AlStatus, SdoValue, Slave};
use crate::cia402::MODES_OF_OPERATION;
use crate::coe::{AbortCode, ObjectAddress, SdoSize};
use crate::ethercat::{AlState, Ns};
use crate::fieldbus::{MAX_AXES, Refusal, Role, SlaveConfig, SlaveIn, SlaveOut};
use crate::sk::DriveSync;

/// 0x1018:1 of the devices that are no vendor's. \[OURS] "ECMS": no vendor's number.
pub const VENDOR_ID: u32 = 0x4543_4D53;

/// What a device says of itself.
#[derive(Clone, Copy, Debug)]
pub struct Identity {
    /// 0x1000: device profile and type.
    pub device_type: u32,
    /// 0x1008.
    pub name: &'static str,
    /// 0x1018:1.
    pub vendor_id: u32,
    /// 0x1018:2.
    pub product_code: u32,
    /// 0x1018:3.
    pub revision: u32,
}

/// What every device keeps.
#[derive(Clone, Debug)]
#[repr(C)] // What a cycle uses lies at the end.
pub struct Base {
    name: String,
    serial: u32,
    sync: DriveSync,
    identity: &'static Identity,
    /// The stored values of its objects.
    pub values: Values,
    /// Objects besides those of its table; apart from what a cycle uses.
    makers: Option<Box<MakersObjects>>,
    mapped: Option<Role>,
    al: ApplicationLayer,
}

impl Base {
    /// A device that is switched on now: its name for people, its serial number (0x1018:4), what it says of itself,
    /// its stored values.
    pub fn new(name: String, serial: u32, identity: &'static Identity, values: Values) -> Self {
        let (al, sync) = (ApplicationLayer::default(), DriveSync::default());
        Self { name, serial, identity, al, values, makers: None, mapped: None, sync }
    }

    /// Its AL state.
    pub const fn al_state(&self) -> AlState {
        self.al.state()
    }

    /// The role that process data are mapped for; `None`: none are.
    pub const fn mapped(&self) -> Option<Role> {
        self.mapped
    }
}

/// What is a device's own.
pub trait Model: Send + Sized + 'static {
    /// Its objects, ascending by address, [`identity`] first; [`check`](dictionary::check) them when compiling.
    fn objects() -> &'static [Object<Self>];

    /// What every device keeps.
    fn base(&self) -> &Base;

    /// What every device keeps, to change it.
    fn base_mut(&mut self) -> &mut Base;

    /// Its axes, in the order of their process data.
    fn axes(&self) -> &[Axis] {
        &[]
    }

    /// Its axes, to move them.
    fn axes_mut(&mut self) -> &mut [Axis] {
        &mut []
    }

    /// Its digital lines, those of a channel each.
    fn lines_mut(&mut self) -> &mut [Lines] {
        &mut []
    }

    /// Gets ready for a role, in PreOP; never asked for [`Role::Unused`].
    ///
    /// # Errors
    /// [`not_of_this_kind`], or [`mode_refused`].
    fn take_role(&mut self, role: Role) -> Result<(), Refusal>;

    /// Whether it has distributed clocks.
    fn has_dc(&self) -> bool {
        true
    }

    /// Outputs have come, in OP. The axes have theirs already.
    fn take_outputs(&mut self, outputs: &SlaveOut) {
        let _ = outputs;
    }

    /// The inputs of a cycle. The axes have put in what they measured.
    fn put_inputs(&self, inputs: &mut SlaveIn) {
        let _ = inputs;
    }

    /// `dt_ns` pass, apart from the axes.
    fn pass(&mut self, dt_ns: Ns) {
        let _ = dt_ns;
    }

    /// There are no outputs any more: a state below OP was entered, or they stayed away. The axes brake.
    fn lose_outputs(&mut self) {}
}

/// [`Model::take_role`]: the device has not the process data of that role.
///
/// \[OURS] Sync manager 2 is looked at first, and no two kinds have the same outputs.
pub const fn not_of_this_kind() -> Refusal {
    let AlStatus(al_status) = AlStatus::INVALID_OUTPUTS;
    Refusal { slave: 0, al_status, abort: None }
}

/// [`Model::take_role`]: the device does not take that mode.
pub const fn mode_refused(code: AbortCode) -> Refusal {
    Refusal { slave: 0, al_status: 0, abort: Some((ObjectAddress::new(MODES_OF_OPERATION, 0), code)) }
}

fn lose_outputs<M: Model>(device: &mut M) {
    device.axes_mut().iter_mut().for_each(|axis| axis.machine_mut().lose_master());
    device.lose_outputs();
}

/// Whether the device has no object at an address, so that its maker's are looked at.
const fn is_absent(code: AbortCode) -> bool {
    matches!(code, AbortCode::NO_OBJECT | AbortCode::NO_SUB_INDEX)
}

/// Without a mailbox nothing answers, and the master's transfer times out.
fn mailbox<M: Model>(device: &M) -> Result<(), AbortCode> {
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
        let base = self.base_mut();
        let was = base.al_state();
        let ready = if base.mapped.is_some() { Ok(()) } else { Err(AlStatus::INVALID_OUTPUTS) };
        base.al.enter(target, ready)?;
        if target == AlState::Init {
            base.mapped = None;
        }
        if was == AlState::Op && target != AlState::Op {
            lose_outputs(self);
        }
        Ok(())
    }

    fn configure(&mut self, config: &SlaveConfig) -> Result<(), Refusal> {
        if self.base().al_state() != AlState::PreOp {
            let AlStatus(al_status) = AlStatus::INVALID_CHANGE;
            return Err(Refusal { slave: 0, al_status, abort: None });
        }
        if config.role == Role::Unused {
            self.base_mut().mapped = None;
            return Ok(());
        }
        self.take_role(config.role)?;
        let base = self.base_mut();
        base.mapped = Some(config.role);
        base.sync = config.sync;
        Ok(())
    }

    fn upload(&mut self, object: ObjectAddress) -> Result<SdoValue, AbortCode> {
        mailbox(self)?;
        match dictionary::upload(self, object) {
            Err(code) if is_absent(code) => {
                self.base().makers.as_ref().map_or(Err(code), |makers| makers.upload(object, code))
            }
            answer => answer,
        }
    }

    fn download(&mut self, object: ObjectAddress, size: SdoSize, value: u32) -> Result<(), AbortCode> {
        mailbox(self)?;
        match dictionary::download(self, object, size, value) {
            Err(code) if is_absent(code) => {
                let makers = self.base_mut().makers.as_mut();
                makers.map_or(Err(code), |makers| makers.download(object, size, value, code))
            }
            answer => answer,
        }
    }

    fn exchange(&mut self, outputs: Option<&SlaveOut>, inputs: &mut SlaveIn) {
        for (input, axis) in inputs.iter_mut().zip(self.axes()) {
            *input = *axis.measured();
        }
        self.put_inputs(inputs);
        let Some(outputs) = outputs.filter(|_| self.base().al_state() == AlState::Op) else { return };
        let base = self.base_mut();
        base.al.feed();
        if let Some(mode) = base.mapped.and_then(Role::mode) {
            for (axis, out) in self.axes_mut().iter_mut().zip(outputs) {
                axis.command(mode, out);
            }
        }
        self.take_outputs(outputs);
    }

    fn step(&mut self, dt_ns: Ns) {
        if self.base_mut().al.step(dt_ns) {
            lose_outputs(self);
        }
        self.axes_mut().iter_mut().for_each(|axis| axis.step(dt_ns));
        self.pass(dt_ns);
    }

    fn begin_step(&mut self, dt_ns: Ns) -> Option<Following<'_>> {
        if self.base_mut().al.step(dt_ns) {
            lose_outputs(self);
        }
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

    fn raise_fault(&mut self, axis: usize, fault: DeviceFault) -> bool {
        let found = self.axes_mut().get_mut(axis);
        found.map(|axis| axis.machine_mut().raise(fault)).is_some()
    }

    fn stick_input(&mut self, axis: usize, input: Input, value: Option<bool>) -> bool {
        let found = self.axes_mut().get_mut(axis);
        found.map(|axis| axis.stick(input, value)).is_some()
    }

    fn jam(&mut self, axis: usize, jammed: bool) -> bool {
        let found = self.axes_mut().get_mut(axis);
        found.map(|axis| axis.jam(jammed)).is_some()
    }

    fn force_inputs(&mut self, channel: usize, pattern: Option<InputPattern>) -> bool {
        let found = self.lines_mut().get_mut(channel);
        found.map(|lines| lines.force(pattern)).is_some()
    }

    fn give_makers_objects(&mut self, makers: MakersObjects) {
        self.base_mut().makers = Some(Box::new(makers));
    }

    fn has_dc(&self) -> bool {
        Model::has_dc(self)
    }

    fn shaft(&self, axis: usize) -> Option<i64> {
        self.axes().get(axis).map(|axis| axis.plant().position())
    }

    fn shafts(&self) -> [Option<i64>; MAX_AXES] {
        let mut shafts = [None; MAX_AXES];
        for (shaft, axis) in shafts.iter_mut().zip(self.axes()) {
            *shaft = Some(axis.plant().position());
        }
        shafts
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

/// Objects 0x1000 to 0x1018, which every device has and programs look for.
pub const fn identity<M: Model>() -> [Object<M>; 8] {
    [
        Object::u32(0x1000, 0, "Device type").live(|device: &M| device.base().identity.device_type.into()),
        Object::u8(0x1001, 0, "Error register").live(error_register),
        Object::text(0x1008, 0, "Device name", |device: &M| device.base().identity.name),
        Object::u8(0x1018, 0, "Identity").default(4),
        Object::u32(0x1018, 1, "Vendor ID").live(|device: &M| device.base().identity.vendor_id.into()),
        Object::u32(0x1018, 2, "Product code").live(|device: &M| device.base().identity.product_code.into()),
        Object::u32(0x1018, 3, "Revision").live(|device: &M| device.base().identity.revision.into()),
        Object::u32(0x1018, 4, "Serial number").live(|device: &M| device.base().serial.into()),
    ]
}

/// Objects 0x1C32 and 0x1C33 of a device with a clock of its own: how it is synchronised.
pub const fn synchronization<M: Model>() -> [Object<M>; 4] {
    [
        Object::u8(0x1C32, 0, "SM output parameter").default(1),
        Object::u16(0x1C32, 1, "Synchronization type").live(synchronization_type),
        Object::u8(0x1C33, 0, "SM input parameter").default(1),
        Object::u16(0x1C33, 1, "Synchronization type").live(synchronization_type),
    ]
}

/// 0 free run, 2 DC with SYNC0.
fn synchronization_type<M: Model>(device: &M) -> i64 {
    match device.base().sync {
        DriveSync::FreeRun => 0,
        DriveSync::DcSync => 2,
    }
}

/// Error register (CiA 301 7.5.2.2) of the axes' error codes: bit 0 for any, and the bits of their groups.
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
