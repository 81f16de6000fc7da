//! What every simulated device does alike: AL states, mailbox, identity, process data.
//!
//! A device keeps a [`Base`] and implements [`Model`] with what is its own: its objects, its axes, and what its time does
//! apart from its axes. [`Slave`] and the dictionary's [`Device`](super::dictionary::Device) follow from that.

use super::al::ApplicationLayer;
use super::axis::Axis;
use super::dictionary::{self, Object, Values};
use super::lines::Lines;
use super::makers::MakersObjects;
use super::plant::Following;
use super::process_data::{self, Mapping, Pdo, Plan};
use super::switches::Input;
use super::{AXES_MAX, AlStatus, Fault, Slave};
use crate::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::{AlState, Ns};

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
pub struct Base<M> {
    name: String,
    serial: u32,
    identity: &'static Identity,
    /// The stored values of its objects.
    pub values: Values,
    /// Objects besides those of its table; apart from what a cycle uses.
    makers: Option<Box<MakersObjects>>,
    mapping: Mapping,
    /// Lengths of sync managers 2 and 3.
    sync_managers: (u16, u16),
    plan: Plan<M>,
    al: ApplicationLayer,
}

impl<M> Base<M> {
    /// A device that is switched on now: its name for people, its serial number (0x1018:4), what it says of itself,
    /// its stored values, the PDOs that it has.
    pub fn new(name: String, serial: u32, identity: &'static Identity, values: Values, pdos: &[Pdo<M>]) -> Self {
        let (al, mapping, plan) = (ApplicationLayer::default(), Mapping::new(pdos), Plan::with_room());
        Self { name, serial, identity, al, values, makers: None, mapping, sync_managers: (0, 0), plan }
    }

    /// Its AL state.
    pub const fn al_state(&self) -> AlState {
        self.al.state()
    }

    /// Whether the process data that the plan moves are as long as the master has set the sync managers.
    ///
    /// \[OURS] Sync manager 2 is looked at first.
    fn fits_sync_managers(&self) -> Result<(), AlStatus> {
        let ((outputs, inputs), (wanted_outputs, wanted_inputs)) = (self.plan.lengths(), self.sync_managers);
        if outputs != wanted_outputs {
            return Err(AlStatus::INVALID_OUTPUTS);
        }
        if inputs == wanted_inputs { Ok(()) } else { Err(AlStatus::INVALID_INPUTS) }
    }
}

/// What is a device's own.
pub trait Model: Send + Sized + 'static {
    /// Its objects, ascending by address, [`identity`] first; [`check`](dictionary::check) them when compiling.
    fn objects() -> &'static [Object<Self>];

    /// Its PDOs when it is switched on, of whatever kind it is.
    fn pdos() -> &'static [Pdo<Self>];

    /// What every device keeps.
    fn base(&self) -> &Base<Self>;

    /// What every device keeps, to change it.
    fn base_mut(&mut self) -> &mut Base<Self>;

    /// Its axes.
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

    /// Whether it has distributed clocks.
    fn has_dc(&self) -> bool {
        true
    }

    /// `dt_ns` pass, apart from the axes.
    fn pass(&mut self, dt_ns: Ns) {
        let _ = dt_ns;
    }

    /// There are no outputs any more: a state below OP was entered, or they stayed away. The axes brake.
    fn lose_outputs(&mut self) {}
}

fn lose_outputs<M: Model>(device: &mut M) {
    device.axes_mut().iter_mut().for_each(|axis| axis.machine_mut().lose_master());
    device.lose_outputs();
}

/// Time passes in the AL state machine. True: its watchdog has just ended OP.
fn step_al<M: Model>(device: &mut M, dt_ns: Ns) -> bool {
    let Base { al, plan, .. } = device.base_mut();
    if plan.lengths().0 == 0 {
        // Who has no outputs misses none.
        al.feed();
    }
    al.step(dt_ns)
}

/// Makes the plan of what is mapped now.
fn compile<M: Model>(device: &mut M) -> Result<(), AlStatus> {
    let mut plan = std::mem::take(&mut device.base_mut().plan);
    let compiled = plan.compile(device, &device.base().mapping);
    device.base_mut().plan = plan;
    compiled.and_then(|()| device.base().fits_sync_managers())
}

/// Whether an entry may stand in a PDO.
fn may_map<M: Model>(device: &M, direction: dictionary::PdoDirection, entry: u32) -> Result<(), AbortCode> {
    process_data::may_map(device, direction, entry).map_err(|code| {
        let at = ObjectAddress::new((entry >> 16) as u16, (entry >> 8) as u8);
        let is_elsewhere = device.base().mapping.has(at.index) || makers_have(device, at);
        if is_absent(code) && is_elsewhere { AbortCode::NOT_MAPPABLE } else { code }
    })
}

fn makers_have<M: Model>(device: &M, at: ObjectAddress) -> bool {
    let read = |makers: &MakersObjects| makers.read(at, SdoScope::Entry, &mut [], AbortCode::NO_OBJECT).is_ok();
    device.base().makers.as_deref().is_some_and(read)
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
        mailbox(self)?;
        let Base { mapping, makers, .. } = self.base();
        if mapping.has(object.index) {
            return mapping.read(object, scope, value);
        }
        match dictionary::read(self, object, scope, value) {
            Err(code) if is_absent(code) => {
                makers.as_ref().map_or(Err(code), |makers| makers.read(object, scope, value, code))
            }
            answer => answer,
        }
    }

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        mailbox(self)?;
        let Base { mapping, al, .. } = self.base();
        if mapping.has(object.index) {
            let may_map = |direction, entry| may_map(self, direction, entry);
            let list = mapping.written(object, scope, value, al.state(), may_map)?;
            self.base_mut().mapping.put(list);
            return Ok(());
        }
        match dictionary::write(self, object, scope, value) {
            Err(code) if is_absent(code) => {
                let makers = self.base_mut().makers.as_mut();
                makers.map_or(Err(code), |makers| makers.write(object, scope, value, code))
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
        self.base_mut().al.feed();
        process_data::take_outputs(self, outputs);
    }

    fn step(&mut self, dt_ns: Ns) {
        if step_al(self, dt_ns) {
            lose_outputs(self);
        }
        self.axes_mut().iter_mut().for_each(|axis| axis.step(dt_ns));
        self.pass(dt_ns);
    }

    fn begin_step(&mut self, dt_ns: Ns) -> Option<Following<'_>> {
        if step_al(self, dt_ns) {
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

    fn suffer(&mut self, fault: Fault) -> bool {
        if let Fault::ForceInputs { channel, pattern } = fault {
            return self.lines_mut().get_mut(channel).map(|lines| lines.force(pattern)).is_some();
        }
        let (Fault::Alarm { axis, .. } | Fault::Stick { axis, .. } | Fault::Jam { axis, .. }) = fault else {
            return false;
        };
        let Some(axis) = self.axes_mut().get_mut(axis) else { return false };
        match fault {
            Fault::Alarm { fault, .. } => axis.machine_mut().raise(fault),
            Fault::Stick { input: Some(input), value, .. } => axis.stick(input, value),
            Fault::Stick { input: None, value, .. } => {
                Input::ALL.into_iter().for_each(|input| axis.stick(input, value))
            }
            Fault::Jam { jammed, .. } => axis.jam(jammed),
            Fault::ForceInputs { .. } => {}
        }
        true
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

    fn shafts(&self) -> [Option<i64>; AXES_MAX] {
        let mut shafts = [None; AXES_MAX];
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

impl<M: Model> process_data::Planned for M {
    fn plan(&self) -> &Plan<M> {
        &self.base().plan
    }

    fn pdos() -> &'static [Pdo<M>] {
        M::pdos()
    }
}

/// Objects 0x1000 to 0x1018, which every device has and programs look for, and 0x1C00: what its sync managers are for.
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

/// Objects 0x1C32 and 0x1C33 of a device with a clock of its own: how it is synchronised. \[OURS] DC with SYNC0 until a
/// master says otherwise, and the type makes no difference: the simulated network has one clock.
pub const fn synchronization<M: Model>() -> [Object<M>; 4] {
    const DC_SYNC0: i64 = 2;
    [
        Object::u8(0x1C32, 0, "SM output parameter").default(1),
        Object::u16(0x1C32, 1, "Synchronization type").rw_up_to(AlState::PreOp).range(0, DC_SYNC0).default(DC_SYNC0),
        Object::u8(0x1C33, 0, "SM input parameter").default(1),
        Object::u16(0x1C33, 1, "Synchronization type").rw_up_to(AlState::PreOp).range(0, DC_SYNC0).default(DC_SYNC0),
    ]
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
