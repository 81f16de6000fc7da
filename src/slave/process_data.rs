//! The process data of a device: the mapping of its objects (`mapping.rs`), and the transfer in a cycle (`plan.rs`).
//!
//! In PreOP a master writes which objects form a PDO (0x1600.. for outputs, 0x1A00.. for inputs) and which PDOs are
//! assigned (0x1C12, 0x1C13). When the device goes to SafeOP, the mapping is compiled into a `Plan`, with which a cycle
//! transfers the process image without searching for objects.

mod mapping;
mod plan;

pub use mapping::{ENTRIES_MAX, IMAGE_BYTES_MAX, Mapping, MappingLimits, Mover, PDOS_MAX, Pdo};
pub use plan::MAPPED_MAX;
pub(super) use plan::{
    Plan, each_entry, fixed, may_map, put_inputs, put_object, rx_pdo, take_object, take_outputs, tx_pdo,
};
