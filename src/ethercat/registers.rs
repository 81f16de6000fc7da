//! The registers of a slave controller (ESC): their addresses, access rights and bits.
//!
//! [`MAP`] is the only list of addresses. Registers with several fields have a type each: [`Fmmu`], [`SyncManager`],
//! [`SiiControl`], the AL and DL registers, and the bits of events and distributed clocks.
//!
//! Source: ETG.1000.4 6, and the data sheets of slave controllers; rules ECAT-2.

mod al;
mod clock;
mod fmmu;
mod link;
mod map;
mod sii;
mod sync_manager;

pub use al::{AlControl, AlEvents, AlStatusRegister, AlStatusWithCode, EcatEvents, RequestedState};
pub use clock::{Features, LATCHES, LatchEdge, LatchStatus, SyncActivation, SystemTimeDifference};
pub use fmmu::{FMMU_LEN, Fmmu, FmmuDirections};
pub use link::{DlControl, DlStatus, LoopControl, PORTS};
pub use map::*;
pub use sii::{SiiCommand, SiiControl};
pub use sync_manager::{
    BufferMode, SYNC_MANAGER_LEN, SmActivate, SmControl, SmDirection, SmPdiControl, SmStatus, SyncManager,
};
