//! The trait between the chip and its network.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `network.rs` | the trait [`SlaveNetwork`] |
//! | `operation.rs` | operations that take time, with their answers |
//! | `list.rs` | lists without allocation |
//! | `immediate.rs`, `slaves.rs` | networks that answer at once; slave models as such a network |
//! | `controllers.rs`, `wire.rs` | a master and slave controllers, with real frames between them |
//! | `simulated.rs` | an enum of these two networks |

pub mod controllers;
pub mod immediate;
pub mod list;
pub mod operation;
pub mod simulated;
pub mod slaves;
mod wire;

pub use controllers::Controllers;
pub use immediate::ImmediateNetwork;
pub use list::List;
pub use operation::{EepromFailure, Entered, EnteringSlaves, Operation, OperationAnswer, SdoData};
pub use simulated::SimulatedNetwork;
pub use slaves::SlaveModels;

use crate::ethercat::coe::{AbortCode, Emergency, ObjectAddress};
use crate::ethercat::{AlState, AlStatus, Ns};
use crate::xf::request::DcTiming;

/// The largest number of slaves that the chip supports.
pub const SLAVES_MAX: usize = 128;
/// The largest size of process data in each direction, in bytes. `[OURS]` The largest data segment.
pub const IMAGE_MAX: usize = crate::xf::DataSize::MAX.bytes();

/// The identity of a slave from its EEPROM.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SlaveIdentity {
    /// Vendor id of the slave.
    pub vendor: u32,
    /// Product code of the slave.
    pub product: u32,
    /// Revision number of the slave.
    pub revision: u32,
    /// The device's name.
    pub name: String,
    /// The station alias; 0 for none.
    pub alias: u16,
}

/// The position of a slave's process data in the process images, and the state to which the chip has brought the slave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImageRanges {
    /// Offset of the slave's outputs in the RxPDO, in bytes.
    pub outputs_at: u16,
    /// Size of the slave's outputs in bytes.
    pub output_bytes: u16,
    /// Offset of the slave's inputs in the TxPDO, in bytes.
    pub inputs_at: u16,
    /// Size of the slave's inputs in bytes.
    pub input_bytes: u16,
    /// The state to which the chip has brought the slave. The slave may have left that state by itself.
    pub commanded: AlState,
}

impl ImageRanges {
    /// The range of the slave's outputs in the process image of outputs.
    pub const fn outputs(&self) -> std::ops::Range<usize> {
        self.outputs_at as usize..self.outputs_at as usize + self.output_bytes as usize
    }

    /// The range of the slave's inputs in the process image of inputs.
    pub const fn inputs(&self) -> std::ops::Range<usize> {
        self.inputs_at as usize..self.inputs_at as usize + self.input_bytes as usize
    }

    /// The slave's contribution to the expected working counter in AL state `state`: 1 for inputs that are read, plus 2 for
    /// outputs that are written, from the state `outputs_from` on. With LRW the slave itself adds these numbers (ETG.1000.4
    /// 5.4). With LRD and LWR it adds 1 to each, and the chip doubles the working counter of the LWR (XF EN 434).
    pub fn counts(&self, state: AlState, outputs_from: AlState) -> u16 {
        let read = state >= AlState::SafeOp && self.input_bytes > 0;
        let written = state >= outputs_from && self.output_bytes > 0;
        u16::from(read) + 2 * u16::from(written)
    }
}

/// Why a slave does not enter a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EnterError {
    /// The slave does not answer.
    NoAnswer,
    /// The slave refuses, with that AL status code.
    CommandRefused(AlStatus),
}

/// The settings of a slave that are made before it goes to SafeOP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveSetup {
    /// Size of the slave's outputs in bytes.
    pub output_bytes: u16,
    /// Size of the slave's inputs in bytes.
    pub input_bytes: u16,
    /// The slave's SYNC signals; `None` if it runs without distributed clocks.
    pub sync: Option<DcTiming>,
}

/// The process data of a cycle.
#[derive(Debug)]
pub struct ProcessExchange<'a> {
    /// The positions of the slaves' data in `outputs` and `inputs`; index n is slave n.
    pub places: &'a [ImageRanges],
    /// The outputs of all slaves.
    pub outputs: &'a [u8],
    /// The inputs of all slaves. Inputs of slaves that do not answer keep their values.
    pub inputs: &'a mut [u8],
    /// Whether the data travel in LRW; otherwise in LWR and LRD.
    pub lrw: bool,
}

/// The network of a chip. Slaves are numbered from 0. A number without a slave behaves like a slave that does not
/// answer.
///
/// Operations are started with [`Self::start`]. If the network has frames they take time, and [`Self::poll`] returns the
/// answer.
pub trait SlaveNetwork: Send {
    /// Whether operations take time. If so the chip starts them when it receives the command; otherwise it starts them
    /// when the duration of the command has passed, and gets the answers at once.
    fn takes_time(&self) -> bool;

    /// Whether the slaves have registers, EEPROMs, files and mailboxes besides their objects. If not, the chip answers
    /// commands that need them with the command error.
    fn knows_registers(&self) -> bool;

    /// The state from which on slaves add to the working counter for their outputs. `[OURS]` Slave models do it in OP only.
    fn outputs_count_from(&self) -> AlState {
        AlState::Op
    }

    /// Whether the network port has a link.
    fn has_link(&self) -> bool;

    /// The data that the last scan has read from a slave's EEPROM; `None` if there is no such slave.
    fn identity(&self, slave: u8) -> Option<&SlaveIdentity>;

    /// Whether the slave has distributed clocks.
    fn has_dc(&self, slave: u8) -> bool;

    /// The AL state as last read; `None` if the slave does not answer.
    fn state(&self, slave: u8) -> Option<AlState>;

    /// The AL status code that was read with the state; `None` on a network without registers.
    fn al_status(&self, _slave: u8) -> Option<AlStatus> {
        None
    }

    /// Sets up a slave for SafeOP: the lengths of its process data and its SYNC signals. Returns false if the slave does not
    /// support them; it then stays in PreOP.
    fn set_up(&mut self, slave: u8, setup: &SlaveSetup) -> bool;

    /// Selects the reference clock: the clock of the first slave that has one (true), or the chip's own clock (false).
    fn set_reference(&mut self, _is_first_slave: bool) {}

    /// The time by which a script or test makes SDO transfers with this slave longer, for networks without frames; with frames
    /// the slave itself delays its answers.
    fn sdo_delay_ns(&self, _slave: u8) -> Ns {
        0
    }

    /// The abort code with which a script or test makes the slave abort every SDO_REQ for this object; `None` if the slave is
    /// not to abort it.
    fn sdo_abort(&self, _slave: u8, _object: ObjectAddress) -> Option<AbortCode> {
        None
    }

    /// Starts an operation. An operation that is still running is given up and gets no answer. Returns the answer if it is
    /// already there.
    fn start(&mut self, operation: Operation) -> Option<OperationAnswer>;

    /// Returns the answer to the started operation once it is there, and only once.
    fn poll(&mut self) -> Option<OperationAnswer> {
        None
    }

    /// Gives up the started operation: [`Self::poll`] returns no answer to it.
    fn give_up(&mut self) {}

    /// The time at which [`Self::work`] has to be called next for the started operation; `None` if it need not be called.
    fn next_work(&self) -> Option<Ns> {
        None
    }

    /// Continues the started operation at `now`, as far as the frames that have come back allow.
    fn work(&mut self, _now: Ns) {}

    /// Exchanges the process data of a cycle; returns the working counter.
    fn exchange(&mut self, exchange: ProcessExchange<'_>) -> u16;

    /// Lets `dt_ns` pass in the slaves, until `now`.
    fn pass(&mut self, now: Ns, dt_ns: Ns);

    /// Takes the next emergency that a slave has sent, with the number of the slave, from 0; `None` if there is none.
    fn take_emergency(&mut self) -> Option<(u8, Emergency)> {
        None
    }

    /// Sets whether messages that answer no request of the chip, such as emergencies, stay in a slave's mailbox until
    /// [`Operation::ReceiveMail`]. Otherwise the chip reads them itself.
    fn keep_mail(&mut self, _slave: u8, _keeps: bool) {}

    /// Whether there is a message in a mailbox whose messages are kept for the host, see [`Self::keep_mail`].
    fn has_mail(&self, _slave: u8) -> bool {
        false
    }

    /// Handles a restart of the chip: its knowledge of the network is lost.
    fn reset(&mut self) {}
}
