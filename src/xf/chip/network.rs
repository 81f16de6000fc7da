//! The seam between the chip and its network.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `network.rs` | the seam, [`Network`] |
//! | `operation.rs` | what takes time: asked for, and answered later |
//! | `list.rs` | lists that allocate nothing |
//! | `at_once.rs`, `slaves.rs` | networks for which nothing takes time; slave models as one |
//! | `controllers.rs`, `wire.rs` | a master and slave controllers, between which every frame is real |
//! | `simulated.rs` | either of the two, as a link names it |

pub mod at_once;
pub mod controllers;
pub mod list;
pub mod operation;
pub mod simulated;
pub mod slaves;
mod wire;

pub use at_once::AtOnce;
pub use controllers::Controllers;
pub use list::List;
pub use operation::{Answer, EepromFailure, Entered, EnteringSlaves, Operation, Value};
pub use simulated::SimulatedNetwork;
pub use slaves::SlaveModels;

use crate::ethercat::coe::{AbortCode, Emergency, ObjectAddress};
use crate::ethercat::{AlState, AlStatus, Ns};
use crate::xf::request::DcTiming;

/// The most slaves that the chip numbers.
pub const SLAVES_MAX: usize = 128;
/// The most bytes of process data in each direction. `[OURS]` The largest data segment.
pub const IMAGE_MAX: usize = crate::xf::DataSize::MAX.bytes();

/// What the EEPROM of a slave says about it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// Vendor id.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Revision.
    pub revision: u32,
    /// The device's name.
    pub name: String,
    /// The station alias; 0: none.
    pub alias: u16,
}

/// Where the process data of a slave are in the images, and to which state the chip has brought it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// First byte of its outputs in the RxPDO.
    pub outputs_at: u16,
    /// Bytes of its outputs.
    pub output_bytes: u16,
    /// First byte of its inputs in the TxPDO.
    pub inputs_at: u16,
    /// Bytes of its inputs.
    pub input_bytes: u16,
    /// The state to which the chip has brought it; the slave may have left it by itself.
    pub commanded: AlState,
}

impl Place {
    /// Its bytes in the image of outputs.
    pub const fn outputs(&self) -> std::ops::Range<usize> {
        self.outputs_at as usize..self.outputs_at as usize + self.output_bytes as usize
    }

    /// Its bytes in the image of inputs.
    pub const fn inputs(&self) -> std::ops::Range<usize> {
        self.inputs_at as usize..self.inputs_at as usize + self.input_bytes as usize
    }

    /// What the slave counts in the working counter in that state: 1 for inputs that are read, 2 for outputs that are written. LRW
    /// adds so much by itself (ETG.1000.4 5.4); of an LWR beside an LRD the chip counts each slave twice (XF EN 434).
    /// `outputs_from`: the state from which outputs count.
    pub fn counts(&self, state: AlState, outputs_from: AlState) -> u16 {
        let read = state >= AlState::SafeOp && self.input_bytes > 0;
        let written = state >= outputs_from && self.output_bytes > 0;
        u16::from(read) + 2 * u16::from(written)
    }
}

/// Why a slave does not enter a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EnterError {
    /// It does not answer.
    NoAnswer,
    /// It refuses, with that AL status code.
    Refused(AlStatus),
}

/// What a slave needs to know before it goes to SafeOP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlaveSetup {
    /// Bytes of its outputs.
    pub output_bytes: u16,
    /// Bytes of its inputs.
    pub input_bytes: u16,
    /// Its SYNC signals; `None`: it runs without distributed clocks.
    pub sync: Option<DcTiming>,
}

/// The process data of a cycle.
#[derive(Debug)]
pub struct Exchange<'a> {
    /// What belongs to whom, the first one to slave 0.
    pub places: &'a [Place],
    /// All outputs.
    pub outputs: &'a [u8],
    /// All inputs. Those of slaves that do not answer keep their values.
    pub inputs: &'a mut [u8],
    /// They travel in LRW, not in LWR and LRD.
    pub lrw: bool,
}

/// A network as the chip needs it. Slaves are numbered from 0; a number that no slave has is one that does not answer.
///
/// What takes time on a wire is asked for by [`Self::start`] and answered by [`Self::poll`].
pub trait Network: Send {
    /// Whether operations take time, so that they begin with the command; otherwise they are done at once, at its end.
    fn takes_time(&self) -> bool;

    /// Whether there are registers, EEPROMs, files and mailboxes behind the slaves' objects. Without them the chip answers what
    /// needs them with the command error.
    fn knows_registers(&self) -> bool;

    /// From which state on outputs count in the working counter. `[OURS]` For models it is OP.
    fn outputs_count_from(&self) -> AlState {
        AlState::Op
    }

    /// Whether the network port has a link.
    fn has_link(&self) -> bool;

    /// What the last scan has read of a slave's EEPROM; `None` if there is no such slave.
    fn identity(&self, slave: u8) -> Option<&Identity>;

    /// Whether the slave has distributed clocks.
    fn has_dc(&self, slave: u8) -> bool;

    /// The AL state as it was read last; `None`: the slave does not answer.
    fn state(&self, slave: u8) -> Option<AlState>;

    /// The AL status code that was read with it; `None`: there is no register for it.
    fn al_status(&self, _slave: u8) -> Option<AlStatus> {
        None
    }

    /// Sets what a slave has to know before it goes to SafeOP. False: it cannot have such process data.
    fn set_up(&mut self, slave: u8, setup: &SlaveSetup) -> bool;

    /// Sets whose clock leads the others: that of the first slave that has one, or the chip's own.
    fn set_reference(&mut self, _is_first_slave: bool) {}

    /// How much longer than others SDO transfers with a slave take, where that is not on the wire.
    fn sdo_delay_ns(&self, _slave: u8) -> Ns {
        0
    }

    /// The abort code with which a slave aborts a transfer of SDO_REQ whatever its dictionary says; `None`: it does not.
    fn sdo_abort(&self, _slave: u8, _object: ObjectAddress) -> Option<AbortCode> {
        None
    }

    /// Starts an operation; the one before is given up. The answer, if it has come already.
    fn start(&mut self, operation: Operation) -> Option<Answer>;

    /// The answer of the operation that was started, once.
    fn poll(&mut self) -> Option<Answer> {
        None
    }

    /// Gives up the operation that was started.
    fn give_up(&mut self) {}

    /// When [`Self::work`] has to be called next for the operation that was started; `None`: whenever time passes.
    fn next_work(&self) -> Option<Ns> {
        None
    }

    /// Goes on with the operation that was started.
    fn work(&mut self, _now: Ns) {}

    /// The process data of a cycle. The working counter.
    fn exchange(&mut self, exchange: Exchange<'_>) -> u16;

    /// `dt_ns` pass, until `now`.
    fn pass(&mut self, now: Ns, dt_ns: Ns);

    /// The next emergency that a slave has sent.
    fn take_emergency(&mut self) -> Option<(u8, Emergency)> {
        None
    }

    /// Sets whether what a slave sends unasked stays in its mailbox until [`Operation::ReceiveMail`].
    fn keep_mail(&mut self, _slave: u8, _keeps: bool) {}

    /// Whether there is mail in a mailbox whose mail stays.
    fn has_mail(&self, _slave: u8) -> bool {
        false
    }

    /// The chip has started: what it knew of the network is gone.
    fn reset(&mut self) {}
}
