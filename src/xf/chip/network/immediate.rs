//! Networks that execute every operation at once.

use super::{
    EnterError, Entered, ImageRanges, Operation, OperationAnswer, ProcessExchange, SdoData, SlaveIdentity,
    SlaveNetwork, SlaveSetup,
};
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::{AlState, Ns};

/// A network whose slaves are called directly and not by frames, so that nothing takes time. It has no registers,
/// EEPROMs, files or mailboxes. Slaves are numbered from 0. A number without a slave behaves like a slave that does not
/// answer.
pub trait ImmediateNetwork: Send {
    /// Whether the network port has a link.
    fn has_link(&self) -> bool;

    /// Counts the slaves, at most [`SLAVES_MAX`](super::SLAVES_MAX), brings those that answer to Init, and reads their
    /// identities.
    fn scan(&mut self) -> u8;

    /// The identity of a slave, as read by the last scan; `None` if there is no such slave.
    fn identity(&self, slave: u8) -> Option<&SlaveIdentity>;

    /// Whether the slave has distributed clocks.
    fn has_dc(&self, slave: u8) -> bool;

    /// The AL state of a slave; `None` if the slave does not answer.
    fn state(&self, slave: u8) -> Option<AlState>;

    /// Requests an AL state from a slave, which enters or refuses it at once.
    ///
    /// # Errors
    /// The slave does not answer, or refuses the state.
    fn enter(&mut self, slave: u8, state: AlState) -> Result<(), EnterError>;

    /// Sets the lengths of sync managers 2 (outputs) and 3 (inputs), in bytes.
    fn set_sync_managers(&mut self, slave: u8, outputs: u16, inputs: u16);

    /// Sets the cycle time of SYNC0; `None` if the slave runs without distributed clocks.
    fn set_sync_cycle(&mut self, slave: u8, cycle_ns: Option<Ns>);

    /// SDO upload of as much of the value as `value` has room for. Returns the full length of the value.
    ///
    /// # Errors
    /// The abort code; [`AbortCode::TIMEOUT`] if the slave does not answer.
    fn read(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope, value: &mut [u8])
    -> Result<usize, AbortCode>;

    /// SDO download of a whole value.
    ///
    /// # Errors
    /// As with [`Self::read`].
    fn write(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode>;

    /// The time by which a script or test makes SDO transfers with this slave longer.
    fn sdo_delay_ns(&self, _slave: u8) -> Ns {
        0
    }

    /// The abort code with which a script or test makes the slave abort every SDO_REQ for this object; `None` if the slave is
    /// not to abort it.
    fn sdo_abort(&self, _slave: u8, _object: ObjectAddress) -> Option<AbortCode> {
        None
    }

    /// Exchanges the process data of a cycle, as in [`SlaveNetwork::exchange`]; returns the working counter.
    fn exchange(&mut self, places: &[ImageRanges], outputs: &[u8], inputs: &mut [u8], lrw: bool) -> u16;

    /// Lets `dt_ns` pass in the slaves.
    fn pass(&mut self, dt_ns: Ns);
}

impl<N: ImmediateNetwork> SlaveNetwork for N {
    fn takes_time(&self) -> bool {
        false
    }

    fn has_link(&self) -> bool {
        ImmediateNetwork::has_link(self)
    }

    fn identity(&self, slave: u8) -> Option<&SlaveIdentity> {
        ImmediateNetwork::identity(self, slave)
    }

    fn has_dc(&self, slave: u8) -> bool {
        ImmediateNetwork::has_dc(self, slave)
    }

    fn state(&self, slave: u8) -> Option<AlState> {
        ImmediateNetwork::state(self, slave)
    }

    fn set_up(&mut self, slave: u8, setup: &SlaveSetup) -> bool {
        self.set_sync_managers(slave, setup.output_bytes, setup.input_bytes);
        self.set_sync_cycle(slave, setup.sync.map(|sync| sync.sync0_ns.into()));
        true
    }

    fn sdo_delay_ns(&self, slave: u8) -> Ns {
        ImmediateNetwork::sdo_delay_ns(self, slave)
    }

    fn sdo_abort(&self, slave: u8, object: ObjectAddress) -> Option<AbortCode> {
        ImmediateNetwork::sdo_abort(self, slave, object)
    }

    fn knows_registers(&self) -> bool {
        false
    }

    /// Executes the operation at once and returns its answer.
    fn start(&mut self, operation: Operation) -> Option<OperationAnswer> {
        Some(match operation {
            Operation::Scan => OperationAnswer::Scanned(self.scan()),
            Operation::ReadStates => OperationAnswer::StatesRead,
            Operation::Enter(slaves) => {
                let mut entered = Entered::empty((0, AlState::Init, Ok(())));
                slaves.iter().for_each(|(slave, state)| entered.push((*slave, *state, self.enter(*slave, *state))));
                OperationAnswer::Entered(entered)
            }
            Operation::Read { slave, object, scope, room, .. } => {
                let mut value = SdoData::empty(0);
                let len = value.fill(room, |room| self.read(slave, object, scope, room));
                OperationAnswer::Value(len.map(|len| (value, len)))
            }
            Operation::Write { slave, object, scope, value, .. } => {
                OperationAnswer::Written(self.write(slave, object, scope, &value))
            }
            _ => OperationAnswer::Unknown,
        })
    }

    fn exchange(&mut self, exchange: ProcessExchange<'_>) -> u16 {
        ImmediateNetwork::exchange(self, exchange.places, exchange.outputs, exchange.inputs, exchange.lrw)
    }

    fn pass(&mut self, _now: Ns, dt_ns: Ns) {
        ImmediateNetwork::pass(self, dt_ns);
    }
}
