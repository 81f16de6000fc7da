//! The registers of a slave controller (ESC): where each one is, who may write it, and what its bits mean.
//!
//! [`MAP`] is the one list of addresses. The layouts of what has several fields stand beside it: [`Fmmu`], [`SyncManager`],
//! [`SiiControl`], the AL and DL registers, and the bits of events and distributed clocks.
//!
//! Source: ETG.1000.4 6, with the data sheets of controllers; rules ECAT-2.

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
