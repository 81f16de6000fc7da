//! The errors of the native API for an ECM-XF. Each says what happened, at which slave or object, and what to do.

use std::time::Duration;

use crate::ethercat::AlStatus;
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::link::chip_link::ChipError;
use crate::span::Span;
use crate::xf::host::{BudgetError, HostError, ProcessOutcome, StepError};
use crate::xf::{EtherCatState, Malformed};

/// Why a function of [`Xf`](super::Xf) or [`ProcessData`](super::ProcessData) failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
#[non_exhaustive]
pub enum XfError {
    /// The link cannot be used.
    #[error(transparent)]
    Link(#[from] ChipError),
    /// The chip refuses a command or does not answer, or the driver has stopped.
    #[error(transparent)]
    Chip(#[from] HostError),
    /// The network has no slave with that number.
    #[error("slave {slave} is not on the network, which has {found}; the first one is 0")]
    NoSuchSlave { slave: u8, found: u8 },
    /// A slave aborts an SDO transfer.
    #[error(
        "slave {slave} aborts the SDO transfer of {object}: {abort}; check object, size and state in the slave's manual"
    )]
    SdoAborted { slave: u8, object: ObjectAddress, abort: AbortCode },
    /// The number of bytes that the chip returned for an object differs from the size of the Rust type that the program
    /// uses.
    #[error("{object} of slave {slave} has {found} bytes, not {wanted}; read it as a type of that size, or as bytes")]
    SdoSize { slave: u8, object: ObjectAddress, found: usize, wanted: usize },
    /// After a change of state some slaves are in another state, or report an error.
    #[error(
        "{wanted:?} was not reached: {}; look the code up in the slave's manual, and check its mapping and the states \
         between",
        stuck(.slaves)
    )]
    StateStuck {
        wanted: EtherCatState,
        /// The slaves that did not reach the state: number, state, AL status code.
        slaves: Vec<(u8, Option<EtherCatState>, u16)>,
    },
    /// A slave does not map the object.
    #[error("slave {slave} has no {object} among its {direction}; it maps {mapped}")]
    NotMapped {
        slave: u8,
        object: ObjectAddress,
        /// The direction: `outputs` or `inputs`.
        direction: &'static str,
        /// The objects that the slave does map in this direction, as text.
        mapped: String,
    },
    /// A mapped object has a different size than the Rust type, or does not begin at a byte boundary.
    #[error(
        "{object} of slave {slave} has {bits} bits from bit {at} of its process data on, and the type {wanted} from a \
         whole byte on"
    )]
    FieldSize { slave: u8, object: ObjectAddress, bits: u8, at: usize, wanted: usize },
    /// The mapping of a slave differs from the chip's layout of its process data.
    #[error(
        "slave {slave} maps {mapped} bytes of {direction}, and the chip has laid out {laid_out}: run Reconfig or \
         ConfigMap in PreOP after a change"
    )]
    OtherLayout { slave: u8, direction: &'static str, mapped: usize, laid_out: usize },
    /// An exchange of process data failed: the chip did not take the outputs, or gave no inputs.
    #[error("process data were not taken ({outcome:?}): {}", advice(*.outcome))]
    ProcessData { outcome: ProcessOutcome },
    /// The cycle is too short to transfer the process data to the chip.
    #[error(transparent)]
    Budget(#[from] BudgetError),
    /// The chip takes no PDO out of the RxFIFO.
    #[error(
        "the RxFIFO has held {held} PDOs for {}: switch it on (FifoEnable), and bring a slave to OP",
        Span(*.waited)
    )]
    RxFifoStalled { held: u8, waited: Duration },
    /// The program has not added an axis with this motor number.
    #[error("there is no axis {motor}; add it first (add_axis), with the slave it belongs to")]
    NoAxis { motor: u8 },
    /// An axis that may be on cannot be added again.
    #[error("axis {motor} may be on; switch it off first (disable)")]
    AxisOn { motor: u8 },
    /// A slave can have only one axis: the helper would write one controlword for both.
    #[error("axis {motor} leads slave {slave} already; a slave has one axis")]
    SlaveHasAxis { slave: u8, motor: u8 },
    /// The controlword or statusword is beyond the first 256 bytes of a slave's process data, which are all that the
    /// helper can address.
    #[error(
        "{object} of slave {slave} is byte {at} of its process data, and the helper reaches the first 256; map it first"
    )]
    BeyondHelperRange { slave: u8, object: ObjectAddress, at: usize },
    /// An axis did not reach the wanted state within its time limit.
    #[error("axis {motor} is in {found} after {} and not in {wanted}; look at its error code, 0x603F", Span(*.waited))]
    AxisStuck { motor: u8, found: &'static str, wanted: &'static str, waited: Duration },
}

impl From<Malformed> for XfError {
    fn from(malformed: Malformed) -> Self {
        Self::Chip(malformed.into())
    }
}

impl From<StepError<ChipError>> for XfError {
    fn from(error: StepError<ChipError>) -> Self {
        match error {
            StepError::Host(error) => Self::Chip(error),
            StepError::Wires(error) => Self::Link(error),
        }
    }
}

fn stuck(slaves: &[(u8, Option<EtherCatState>, u16)]) -> String {
    let one = |(slave, state, al_status): &(u8, Option<EtherCatState>, u16)| match state {
        Some(state) => format!("slave {slave} is in {state:?}, AL status code {}", AlStatus(*al_status)),
        None => format!("slave {slave} does not answer"),
    };
    slaves.iter().map(one).collect::<Vec<_>>().join("; ")
}

const fn advice(outcome: ProcessOutcome) -> &'static str {
    match outcome {
        ProcessOutcome::Full => "the RxFIFO was full; write after the next cycle",
        ProcessOutcome::Refused => "their length is not what the chip has laid out, or no slave is above PreOP",
        ProcessOutcome::NotWritten => "later ones have gone out since; plan the path on from there",
        ProcessOutcome::Unknown => "whether the chip has them is unknown; stop the axes and look where they are",
        ProcessOutcome::AnswerLost | ProcessOutcome::Done { .. } => "they were, their inputs are lost",
    }
}
