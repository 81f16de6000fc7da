//! What the frames of a recording tell beside their bytes: their order in time, their slot size, what the slaves are,
//! which commands were executed. Each of these looks at one frame after the other and keeps little, so that a recording
//! may be as long as it likes; frames need not come from a file ([`crate::link::record::Recording`]).

mod executed;
mod kinds;
mod order;
mod size;
mod timeline;

pub use executed::{Executed, LastExecuted};
pub use kinds::Kinds;
pub use order::InOrder;
pub use size::{SizeFinder, SizeFrom};
pub use timeline::{Jumps, LONGEST_SILENCE_NS, Timeline};
