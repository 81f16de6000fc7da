//! Implements [`Slave`], the object dictionary and process data for every [`Model`].

use super::{Base, Identity, Model, TEST_MEMORY, information, test_memory};
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::registers::{PORTS, RequestedState};
use crate::ethercat::{AlState, Ns};
use crate::slave::communication::{Communication, LatchChange, SyncEvent};
use crate::slave::dictionary::{self, EntryDescription, Object, ObjectDescription, Values};
use crate::slave::esc::EscSettings;
use crate::slave::files::FileStore;
use crate::slave::manufacturer::ManufacturerObjects;
use crate::slave::plant::Servo;
use crate::slave::process_data;
use crate::slave::{AlStatus, AxisFault, Fault, Slave};

fn lose_outputs<M: Model>(device: &mut M) {
    device.axes_mut().iter_mut().for_each(|axis| axis.machine_mut().lose_master());
    device.lose_outputs();
}

/// Makes the device fall back to the AL state `to` on its own, unless its present state is lower. The AL status code gives
/// the reason.
pub fn fall<M: Model>(device: &mut M, to: AlState, status: AlStatus) {
    let was_in_op = device.base().al_state() == AlState::Op;
    device.base_mut().al.fall(to, status);
    if was_in_op && device.base().al_state() != AlState::Op {
        lose_outputs(device);
    }
}

/// Advances the AL state machine by `dt_ns`. If the watchdog for outputs expires, the device leaves OP.
fn step_al<M: Model>(device: &mut M, dt_ns: Ns) {
    let Base { al, plan, .. } = device.base_mut();
    if plan.lengths().0 == 0 {
        // A device without mapped outputs never receives outputs, so its watchdog must not expire.
        al.note_outputs();
    }
    if al.step(dt_ns) {
        lose_outputs(device);
        device.watchdog_expired();
    }
}

/// Makes the plan of the present PDO mapping: the list of copies by which each cycle transfers process data.
///
/// # Errors
/// The AL status code: an entry cannot be mapped, or the lengths differ from those of the sync managers.
fn compile<M: Model>(device: &mut M) -> Result<(), AlStatus> {
    let mut plan = std::mem::take(&mut device.base_mut().plan);
    let compiled = plan.compile(device, &device.base().mapping);
    device.base_mut().plan = plan;
    compiled.and_then(|()| device.base().fits_sync_managers())
}

/// Checks whether an object may be mapped into a PDO of this direction. `entry` is the mapping entry: index in the
/// upper 16 bits, then sub-index, then length in bits. The error is the abort code for the SDO that writes the entry.
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

/// Whether an abort code means that the dictionary of this kind of device does not have the object. The caller then
/// looks for a manufacturer-specific object.
const fn is_absent(code: AbortCode) -> bool {
    matches!(code, AbortCode::NO_OBJECT | AbortCode::NO_SUB_INDEX)
}

/// Returns the abort code for an SDO timeout in Init: the mailbox works from PreOP on, so a master would get no answer.
fn check_mailbox<M: Model>(device: &M) -> Result<(), AbortCode> {
    if device.base().al_state() == AlState::Init { Err(AbortCode::TIMEOUT) } else { Ok(()) }
}

/// Aborts complete access, whatever the object, if the kind of device does not support it.
const fn check_scope<M: Model>(scope: SdoScope) -> Result<(), AbortCode> {
    if M::COMPLETE_ACCESS || matches!(scope, SdoScope::Entry) { Ok(()) } else { Err(AbortCode::UNSUPPORTED_ACCESS) }
}

impl<M: Model> Slave for M {
    fn name(&self) -> &str {
        &self.base().name
    }

    fn identity(&self) -> Option<(&Identity, u32)> {
        Some((&self.base().identity, self.base().serial))
    }

    fn station_alias(&self) -> u16 {
        Model::station_alias(self)
    }

    fn state(&self) -> AlState {
        self.base().al_state()
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        let was = self.base().al_state();
        let ready = if target != was && target == was.above() {
            let mapped = match target {
                AlState::SafeOp => compile(self),
                AlState::Op => self.base().sync_types.check(),
                _ => Ok(()),
            };
            self.check_change(target, mapped)
        } else {
            Ok(())
        };
        let base = self.base_mut();
        if let Err(status) = base.al.enter(target, ready) {
            self.change_refused(status);
            return Err(status);
        }
        if target == AlState::Init {
            base.sync_managers = (0, 0);
        }
        if was != target {
            self.state_changed(was);
        }
        if was == AlState::Op && target != AlState::Op {
            lose_outputs(self);
        }
        Ok(())
    }

    fn request_state(&mut self, request: RequestedState) -> Result<(), AlStatus> {
        if let RequestedState::State(state) = request {
            return self.enter(state);
        }
        let was = self.base().al_state();
        let status = self.refuse_request(request);
        fall(self, was, status);
        Err(status)
    }

    fn al_status(&self) -> AlStatus {
        self.base().al.status()
    }

    fn restart(&mut self) {
        // Every slave can go to Init, so the result is always `Ok`.
        let _ = self.enter(AlState::Init);
        Model::restart(self);
    }

    fn read(&mut self, object: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
        check_mailbox(self)?;
        check_scope::<M>(scope)?;
        let Base { mapping, manufacturer, .. } = self.base();
        if mapping.has(object.index) {
            return mapping.read(object, scope, value);
        }
        if M::TEST_MEMORY && object.index == TEST_MEMORY {
            return test_memory::read(self.base().test_memory(), object, scope, value);
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
        check_scope::<M>(scope)?;
        let Base { mapping, al, .. } = self.base();
        if mapping.has(object.index) {
            let may_map = |direction, entry| may_map(self, direction, entry);
            let list = mapping.written(object, scope, value, al.state(), may_map)?;
            self.base_mut().mapping.put(list);
            return Ok(());
        }
        if M::TEST_MEMORY && object.index == TEST_MEMORY {
            test_memory::may_write(object, scope, value)?;
            let test_memory = &mut self.base_mut().test_memory;
            test_memory.clear();
            test_memory.extend_from_slice(value);
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

    fn object_from(&self, from: u16) -> Option<u16> {
        information::next_object(self, from)
    }

    fn describe_object(&self, index: u16) -> Result<ObjectDescription<'_>, AbortCode> {
        information::object(self, index)
    }

    fn describe_entry(&self, at: ObjectAddress) -> Result<EntryDescription<'_>, AbortCode> {
        information::entry(self, at)
    }

    fn set_sync_managers(&mut self, outputs: u16, inputs: u16) {
        self.base_mut().sync_managers = (outputs, inputs);
    }

    fn set_communication(&mut self, communication: &Communication) {
        let [_, _, outputs, inputs] = communication.sync_managers.map(|sm| if sm.enabled { sm.length } else { 0 });
        let base = self.base_mut();
        base.sync_managers = (outputs, inputs);
        base.sync_types.note_activation(communication.dc_activation);
        Model::set_communication(self, communication);
    }

    fn report_sync(&mut self, event: SyncEvent) {
        Model::report_sync(self, event);
    }

    fn sync_lock_limit_ns(&self) -> Option<Ns> {
        Model::sync_lock_limit_ns(self)
    }

    fn note_links(&mut self, links: [bool; PORTS]) {
        Model::note_links(self, links);
    }

    fn latch_levels(&self) -> Option<u8> {
        Model::latch_levels(self)
    }

    fn tell_latch_changes(&mut self, tell: &mut dyn FnMut(LatchChange)) {
        Model::tell_latch_changes(self, tell);
    }

    fn expire_watchdog(&mut self) {
        let state = self.base().al_state();
        if state == AlState::Op || M::WATCHDOG_IN_SAFEOP && state == AlState::SafeOp {
            fall(self, AlState::SafeOp, AlStatus::WATCHDOG);
            self.watchdog_expired();
        }
    }

    fn set_sync_cycle(&mut self, cycle_ns: Option<Ns>) {
        self.base_mut().sync_types.note_sync0(cycle_ns.is_some());
        Model::set_sync_cycle(self, cycle_ns);
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        process_data::put_inputs(self, inputs);
        self.note_exchange();
        let Some(outputs) = outputs.filter(|_| self.base().al_state() == AlState::Op) else { return };
        self.base_mut().al.note_outputs();
        process_data::take_outputs(self, outputs);
    }

    fn step(&mut self, dt_ns: Ns) {
        step_al(self, dt_ns);
        self.step_axes(dt_ns);
        self.pass(dt_ns);
    }

    fn begin_step(&mut self, dt_ns: Ns) -> Option<&mut Servo> {
        step_al(self, dt_ns);
        self.begin_axes(dt_ns)
    }

    fn end_step(&mut self, dt_ns: Ns) {
        if let [axis] = self.axes_mut() {
            axis.end_step(dt_ns);
        }
        self.pass(dt_ns);
    }

    fn apply_fault(&mut self, fault: Fault) -> bool {
        Model::apply_fault(self, fault)
    }

    fn set_identity(&mut self, vendor: Option<u32>, product: Option<u32>, revision: Option<u32>) {
        let identity = &mut self.base_mut().identity;
        identity.vendor_id = vendor.unwrap_or(identity.vendor_id);
        identity.product_code = product.unwrap_or(identity.product_code);
        identity.revision = revision.unwrap_or(identity.revision);
    }

    fn add_manufacturer_objects(&mut self, manufacturer: ManufacturerObjects) {
        self.base_mut().manufacturer = Some(Box::new(manufacturer));
    }

    fn has_long_values(&self) -> bool {
        M::TEST_MEMORY || self.base().manufacturer.is_some()
    }

    fn files(&mut self) -> Option<&mut FileStore> {
        self.base_mut().files.as_deref_mut()
    }

    fn controller_settings(&self) -> EscSettings {
        Model::controller_settings(self)
    }

    fn has_dc(&self) -> bool {
        Model::has_dc(self)
    }

    fn waits_for_outputs(&self) -> bool {
        Model::waits_for_outputs(self)
    }

    fn shaft(&self, axis: usize) -> Option<i64> {
        Model::shaft(self, axis)
    }

    fn fault(&self, axis: usize) -> Option<AxisFault> {
        let code = self.axes().get(axis)?.machine().fault()?.code;
        Some(AxisFault { code, meaning: self.fault_meaning(axis, code) })
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
