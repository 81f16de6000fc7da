//! A network of slave models that are called directly.

use super::{EnterError, ImageRanges, ImmediateNetwork, SLAVES_MAX, SlaveIdentity};
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::{AlState, MAX_SLAVES, Ns};
use crate::slave::handle::SimHandle;
use crate::slave::{Slave, step_all};

/// A slave model at its position on the cable.
struct Station {
    slave: Box<dyn Slave>,
    identity: SlaveIdentity,
}

/// Slave models in the order of the cable, with a handle by which scripts and tests cause faults such as a cut cable.
pub struct SlaveModels {
    stations: Vec<Station>,
    handle: SimHandle,
    /// The time that has passed in the slaves since the network was made, ns.
    clock: Ns,
}

impl SlaveModels {
    /// A network of these slaves. A scan finds at most the first 128 of them.
    pub fn new(slaves: Vec<Box<dyn Slave>>) -> Self {
        let station = |slave| Station { slave, identity: SlaveIdentity::default() };
        Self { stations: slaves.into_iter().map(station).collect(), handle: SimHandle::default(), clock: 0 }
    }

    /// The same network, controlled by `handle` instead of its own handle. This is for a script, for example, that
    /// already has a copy of `handle`.
    pub fn reached_by(self, handle: SimHandle) -> Self {
        Self { handle, ..self }
    }

    /// The handle with which scripts and tests control the network while it runs. It counts slaves from 1. It can cause
    /// faults in the first 40 slaves, the maximum of a board; a cut cable affects the slaves after these too.
    pub fn handle(&self) -> SimHandle {
        self.handle.clone()
    }

    /// Cuts the cable after the first `slaves` slaves; 0 cuts it before the first one, so that the port has no link.
    pub fn cut_after(&mut self, slaves: u8) {
        self.handle.cut_after(slaves);
    }

    /// Repairs the cable after [`Self::cut_after`].
    pub fn heal(&mut self) {
        self.handle.heal();
    }

    /// Makes a slave stop answering, or answer again. Frames still pass through the slave, and time passes in it.
    pub fn silence(&mut self, slave: u8, silent: bool) {
        self.handle.silence(slave + 1, silent);
    }

    /// The model of a slave, to inspect it; `None` if there is no such slave.
    pub fn slave(&self, slave: u8) -> Option<&dyn Slave> {
        self.stations.get(usize::from(slave)).map(|station| &*station.slave)
    }

    /// The model of a slave, to cause a fault in it; `None` if there is no such slave.
    pub fn slave_mut(&mut self, slave: u8) -> Option<&mut (dyn Slave + 'static)> {
        self.stations.get_mut(usize::from(slave)).map(|station| &mut *station.slave)
    }

    /// Whether frames reach the slave and the slave answers.
    fn answers(&self, slave: u8) -> bool {
        let is_beyond = usize::from(slave) >= MAX_SLAVES;
        usize::from(slave) < self.reachable() && (is_beyond || self.handle.answering().contains(slave + 1))
    }

    fn answering(&self, slave: u8) -> Option<&Station> {
        self.answers(slave).then(|| self.stations.get(usize::from(slave)))?
    }

    fn answering_mut(&mut self, slave: u8) -> Option<&mut Station> {
        self.answers(slave).then(|| self.stations.get_mut(usize::from(slave)))?
    }

    fn reachable(&self) -> usize {
        self.stations.len().min(self.handle.reach().into()).min(SLAVES_MAX)
    }

    /// Restarts the slaves that have lost their power, which takes them to Init. They do not answer before their power is
    /// restored.
    fn power_off(&mut self) {
        for slave in self.handle.take_powered_off().iter() {
            if let Some(station) = self.stations.get_mut(usize::from(slave) - 1) {
                station.slave.restart();
            }
        }
    }

    fn apply_faults(&mut self) {
        let stations = &mut self.stations;
        self.handle.take_faults(|slave, fault| {
            if let Some(station) = stations.get_mut(usize::from(slave).wrapping_sub(1)) {
                station.slave.apply_fault(fault);
            }
        });
    }
}

/// Reads a slave's identity by SDO, in PreOP, since models have no EEPROM. The slave is in Init afterwards.
fn identity(slave: &mut dyn Slave) -> SlaveIdentity {
    // The result is ignored: if a slave refuses PreOP and therefore aborts the SDOs, its numbers are 0 and its name is empty.
    let _ = slave.enter(AlState::PreOp);
    let mut number = |sub| slave.upload(ObjectAddress::new(0x1018, sub)).map_or(0, |value| value.bits);
    let (vendor, product, revision) = (number(1), number(2), number(3));
    let mut name = [0; 64];
    let len = slave.read(ObjectAddress::new(0x1008, 0), SdoScope::Entry, &mut name).unwrap_or(0);
    let name = String::from_utf8_lossy(&name[..len.min(64)]).into_owned();
    let _ = slave.enter(AlState::Init);
    SlaveIdentity { vendor, product, revision, name, alias: 0 }
}

impl ImmediateNetwork for SlaveModels {
    fn has_link(&self) -> bool {
        self.reachable() > 0
    }

    fn scan(&mut self) -> u8 {
        let reachable = self.reachable();
        for slave in 0..reachable as u8 {
            if let Some(station) = self.answering_mut(slave) {
                let _ = station.slave.enter(AlState::Init);
                station.identity = identity(&mut *station.slave);
            }
        }
        reachable as u8
    }

    fn identity(&self, slave: u8) -> Option<&SlaveIdentity> {
        self.stations.get(usize::from(slave)).map(|station| &station.identity)
    }

    fn has_dc(&self, slave: u8) -> bool {
        self.stations.get(usize::from(slave)).is_some_and(|station| station.slave.has_dc())
    }

    fn state(&self, slave: u8) -> Option<AlState> {
        self.answering(slave).map(|station| station.slave.state())
    }

    fn enter(&mut self, slave: u8, state: AlState) -> Result<(), EnterError> {
        let refusal = self.handle.refusal(slave + 1, state);
        let station = self.answering_mut(slave).ok_or(EnterError::NoAnswer)?;
        if let Some(status) = refusal {
            return Err(EnterError::CommandRefused(status));
        }
        station.slave.enter(state).map_err(EnterError::CommandRefused)
    }

    fn set_sync_managers(&mut self, slave: u8, outputs: u16, inputs: u16) {
        if let Some(station) = self.answering_mut(slave) {
            station.slave.set_sync_managers(outputs, inputs);
        }
    }

    fn set_sync_cycle(&mut self, slave: u8, cycle_ns: Option<Ns>) {
        if let Some(station) = self.answering_mut(slave) {
            station.slave.set_sync_cycle(cycle_ns);
        }
    }

    fn read(
        &mut self,
        slave: u8,
        object: ObjectAddress,
        scope: SdoScope,
        value: &mut [u8],
    ) -> Result<usize, AbortCode> {
        self.answering_mut(slave).ok_or(AbortCode::TIMEOUT)?.slave.read(object, scope, value)
    }

    fn write(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        self.answering_mut(slave).ok_or(AbortCode::TIMEOUT)?.slave.write(object, scope, value)
    }

    fn exchange(&mut self, places: &[ImageRanges], outputs: &[u8], inputs: &mut [u8], _lrw: bool) -> u16 {
        let reachable = self.reachable();
        let answering = self.handle.answering();
        let mut working_counter = 0;
        for (n, (station, place)) in self.stations[..reachable].iter_mut().zip(places).enumerate() {
            let is_silent = n < MAX_SLAVES && !answering.contains(n as u8 + 1);
            if is_silent || place.commanded < AlState::SafeOp || station.slave.state() < AlState::SafeOp {
                continue;
            }
            let sent = (place.commanded == AlState::Op).then(|| &outputs[place.outputs()]);
            working_counter += place.counts(place.commanded.min(station.slave.state()), AlState::Op);
            station.slave.exchange(sent, &mut inputs[place.inputs()]);
        }
        working_counter
    }

    fn sdo_delay_ns(&self, slave: u8) -> Ns {
        self.handle.sdo_delay_ns(slave + 1)
    }

    fn sdo_abort(&self, slave: u8, object: ObjectAddress) -> Option<AbortCode> {
        self.handle.sdo_abort(slave + 1, object)
    }

    fn pass(&mut self, dt_ns: Ns) {
        self.power_off();
        self.apply_faults();
        step_all(&mut self.stations, |station| &mut *station.slave, dt_ns);
        self.clock += dt_ns;
        let shafts = self.stations.iter().map(|station| station.slave.shafts());
        self.handle.publish(self.clock, shafts.take(MAX_SLAVES));
    }
}
