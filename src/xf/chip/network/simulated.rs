//! The simulated slaves of a modelled chip, either as models or with slave controllers.

use super::{
    Controllers, Operation, OperationAnswer, ProcessExchange, SlaveIdentity, SlaveModels, SlaveNetwork, SlaveSetup,
};
use crate::ethercat::coe::{AbortCode, Emergency, ObjectAddress};
use crate::ethercat::{AlState, AlStatus, Ns};
use crate::slave::Slave;
use crate::slave::handle::SimHandle;

/// The network of a modelled chip, with simulated slaves.
#[allow(clippy::large_enum_variant, reason = "a chip has one")]
pub enum SimulatedNetwork {
    /// Slave models that are called directly.
    Models(SlaveModels),
    /// Slaves with slave controllers, reached by frames.
    Controllers(Controllers),
}

impl SimulatedNetwork {
    /// The handle with which scripts and tests control the network while it runs.
    pub fn handle(&self) -> SimHandle {
        match self {
            Self::Models(models) => models.handle(),
            Self::Controllers(controllers) => controllers.handle(),
        }
    }

    /// The model of a slave, to inspect it; `None` if there is no such slave.
    pub fn slave(&self, slave: u8) -> Option<&dyn Slave> {
        match self {
            Self::Models(models) => models.slave(slave),
            Self::Controllers(controllers) => controllers.slave(slave),
        }
    }

    /// The model of a slave, to cause a fault in it; `None` if there is no such slave.
    pub fn slave_mut(&mut self, slave: u8) -> Option<&mut dyn Slave> {
        match self {
            Self::Models(models) => models.slave_mut(slave).map(|slave| slave as &mut dyn Slave),
            Self::Controllers(controllers) => controllers.slave_mut(slave),
        }
    }
}

/// Evaluates a method call on either kind of network: `either!(self, network => network.method())`.
macro_rules! either {
    ($self:expr, $network:ident => $call:expr) => {
        match $self {
            SimulatedNetwork::Models($network) => $call,
            SimulatedNetwork::Controllers($network) => $call,
        }
    };
}

impl SlaveNetwork for SimulatedNetwork {
    fn takes_time(&self) -> bool {
        either!(self, network => network.takes_time())
    }

    fn knows_registers(&self) -> bool {
        either!(self, network => network.knows_registers())
    }

    fn outputs_count_from(&self) -> AlState {
        either!(self, network => network.outputs_count_from())
    }

    fn has_link(&self) -> bool {
        either!(self, network => SlaveNetwork::has_link(network))
    }

    fn identity(&self, slave: u8) -> Option<&SlaveIdentity> {
        either!(self, network => SlaveNetwork::identity(network, slave))
    }

    fn has_dc(&self, slave: u8) -> bool {
        either!(self, network => SlaveNetwork::has_dc(network, slave))
    }

    fn state(&self, slave: u8) -> Option<AlState> {
        either!(self, network => SlaveNetwork::state(network, slave))
    }

    fn al_status(&self, slave: u8) -> Option<AlStatus> {
        either!(self, network => network.al_status(slave))
    }

    fn set_up(&mut self, slave: u8, setup: &SlaveSetup) -> bool {
        either!(self, network => network.set_up(slave, setup))
    }

    fn set_reference(&mut self, is_first_slave: bool) {
        either!(self, network => network.set_reference(is_first_slave));
    }

    fn sdo_delay_ns(&self, slave: u8) -> Ns {
        either!(self, network => SlaveNetwork::sdo_delay_ns(network, slave))
    }

    fn sdo_abort(&self, slave: u8, object: ObjectAddress) -> Option<AbortCode> {
        either!(self, network => SlaveNetwork::sdo_abort(network, slave, object))
    }

    fn start(&mut self, operation: Operation) -> Option<OperationAnswer> {
        either!(self, network => network.start(operation))
    }

    fn poll(&mut self) -> Option<OperationAnswer> {
        either!(self, network => network.poll())
    }

    fn give_up(&mut self) {
        either!(self, network => network.give_up());
    }

    fn next_work(&self) -> Option<Ns> {
        either!(self, network => network.next_work())
    }

    fn work(&mut self, now: Ns) {
        either!(self, network => network.work(now));
    }

    fn exchange(&mut self, exchange: ProcessExchange<'_>) -> u16 {
        either!(self, network => SlaveNetwork::exchange(network, exchange))
    }

    fn pass(&mut self, now: Ns, dt_ns: Ns) {
        either!(self, network => SlaveNetwork::pass(network, now, dt_ns));
    }

    fn take_emergency(&mut self) -> Option<(u8, Emergency)> {
        either!(self, network => network.take_emergency())
    }

    fn keep_mail(&mut self, slave: u8, keeps: bool) {
        either!(self, network => network.keep_mail(slave, keeps));
    }

    fn has_mail(&self, slave: u8) -> bool {
        either!(self, network => network.has_mail(slave))
    }

    fn reset(&mut self) {
        either!(self, network => network.reset());
    }
}
