//! The exported functions. Each has its line in `exports.txt` and is imported in `lib.rs`.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `vendor.rs` | `OpenECMUSB`, `CloseECMUSB`, `ECMUSBWrite`, `ECMUSBRead` |
//! | `boards.rs` | `ecmsk_open`, `ecmsk_write` and others: several boards, named by URIs; the result codes |
//! | `machine.rs` | `ecmsk_machine_open` and others: what a machine file says |
//! | `info.rs` | `ecmsk_last_error`, counters and other information |
//! | `entry.rs` | the wrapper of every exported function: no panic leaves it, calls are traced for `ECMSK_LOG` |

pub(crate) mod boards;
pub(crate) mod entry;
pub(crate) mod info;
pub(crate) mod machine;
pub(crate) mod vendor;
