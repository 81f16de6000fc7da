//! A wrapper around a device that refuses AL states and aborts SDOs as a script demands.

use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::registers::{PORTS, RequestedState};
use crate::ethercat::{AlState, AlStatus, Ns};
use crate::slave::cable::Cable;
use crate::slave::dictionary::{EntryDescription, ObjectDescription};
use crate::slave::esc::EscSettings;
use crate::slave::identity::Identity;
use crate::slave::plant::Servo;
use crate::slave::{AxisFault, Communication, Fault, FileStore, LatchChange, ManufacturerObjects, Slave, SyncEvent};

/// A device that refuses AL states and aborts SDO transfers where the script of its cable demands it.
pub(super) struct Scripted {
    device: Box<dyn Slave>,
    cable: Cable,
    /// The number of the slave on the cable, from 1.
    number: u8,
}

impl Scripted {
    pub(super) fn new(device: Box<dyn Slave>, cable: Cable, number: u8) -> Self {
        Self { device, cable, number }
    }

    /// Checks a change of state against the script. \[OURS] A change to a lower state is never refused, because a slave that
    /// has lost its outputs has to leave OP.
    fn may_enter(&self, state: AlState) -> Result<(), AlStatus> {
        match self.cable.refusal(self.number, state) {
            Some(status) if state > self.device.state() => Err(status),
            _ => Ok(()),
        }
    }

    fn may_transfer(&self, object: ObjectAddress) -> Result<(), AbortCode> {
        self.cable.sdo_abort(self.number, object).map_or(Ok(()), Err)
    }
}

/// Changes of state and SDO transfers are checked against the script first. All other functions only call the device.
impl Slave for Scripted {
    fn name(&self) -> &str {
        self.device.name()
    }

    fn identity(&self) -> Option<(&Identity, u32)> {
        self.device.identity()
    }

    fn station_alias(&self) -> u16 {
        self.device.station_alias()
    }

    fn state(&self) -> AlState {
        self.device.state()
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        self.may_enter(target)?;
        self.device.enter(target)
    }

    fn request_state(&mut self, request: RequestedState) -> Result<(), AlStatus> {
        if let RequestedState::State(state) = request {
            self.may_enter(state)?;
        }
        self.device.request_state(request)
    }

    fn al_status(&self) -> AlStatus {
        self.device.al_status()
    }

    fn restart(&mut self) {
        self.device.restart();
    }

    fn read(&mut self, object: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
        self.may_transfer(object)?;
        self.device.read(object, scope, value)
    }

    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.may_transfer(object)?;
        self.device.write(object, scope, value)
    }

    fn object_from(&self, from: u16) -> Option<u16> {
        self.device.object_from(from)
    }

    fn describe_object(&self, index: u16) -> Result<ObjectDescription<'_>, AbortCode> {
        self.device.describe_object(index)
    }

    fn describe_entry(&self, at: ObjectAddress) -> Result<EntryDescription<'_>, AbortCode> {
        self.device.describe_entry(at)
    }

    fn set_sync_managers(&mut self, outputs: u16, inputs: u16) {
        self.device.set_sync_managers(outputs, inputs);
    }

    fn set_communication(&mut self, communication: &Communication) {
        self.device.set_communication(communication);
    }

    fn report_sync(&mut self, event: SyncEvent) {
        self.device.report_sync(event);
    }

    fn sync_lock_limit_ns(&self) -> Option<Ns> {
        self.device.sync_lock_limit_ns()
    }

    fn note_links(&mut self, links: [bool; PORTS]) {
        self.device.note_links(links);
    }

    fn latch_levels(&self) -> Option<u8> {
        self.device.latch_levels()
    }

    fn tell_latch_changes(&mut self, tell: &mut dyn FnMut(LatchChange)) {
        self.device.tell_latch_changes(tell);
    }

    fn expire_watchdog(&mut self) {
        self.device.expire_watchdog();
    }

    fn set_sync_cycle(&mut self, cycle_ns: Option<Ns>) {
        self.device.set_sync_cycle(cycle_ns);
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        self.device.exchange(outputs, inputs);
    }

    fn step(&mut self, dt_ns: Ns) {
        self.device.step(dt_ns);
    }

    fn begin_step(&mut self, dt_ns: Ns) -> Option<&mut Servo> {
        self.device.begin_step(dt_ns)
    }

    fn end_step(&mut self, dt_ns: Ns) {
        self.device.end_step(dt_ns);
    }

    fn apply_fault(&mut self, fault: Fault) -> bool {
        self.device.apply_fault(fault)
    }

    fn set_identity(&mut self, vendor: Option<u32>, product: Option<u32>, revision: Option<u32>) {
        self.device.set_identity(vendor, product, revision);
    }

    fn add_manufacturer_objects(&mut self, objects: ManufacturerObjects) {
        self.device.add_manufacturer_objects(objects);
    }

    fn has_long_values(&self) -> bool {
        self.device.has_long_values()
    }

    fn files(&mut self) -> Option<&mut FileStore> {
        self.device.files()
    }

    fn controller_settings(&self) -> EscSettings {
        self.device.controller_settings()
    }

    fn has_dc(&self) -> bool {
        self.device.has_dc()
    }

    fn waits_for_outputs(&self) -> bool {
        self.device.waits_for_outputs()
    }

    fn shaft(&self, axis: usize) -> Option<i64> {
        self.device.shaft(axis)
    }

    fn fault(&self, axis: usize) -> Option<AxisFault> {
        self.device.fault(axis)
    }
}
