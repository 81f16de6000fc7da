//! The ECM-SK (chip EC01M), an EtherCAT master on a board: its protocol, its exact software model, links to it.
#![cfg_attr(not(feature = "std"), no_std)]

pub mod ethercat;
pub mod sk;

pub use ethercat::{cia402, coe};

#[cfg(feature = "std")]
pub mod compare;
#[cfg(feature = "std")]
pub mod ecm;
#[cfg(feature = "std")]
pub mod engine;
#[cfg(feature = "std")]
pub mod fieldbus;
#[cfg(feature = "std")]
mod files;
#[cfg(feature = "std")]
pub mod io;
#[cfg(feature = "std")]
pub mod link;
#[cfg(any(all(feature = "std", target_os = "linux"), all(feature = "usb", windows)))]
pub mod machine;
#[cfg(all(feature = "serve", any(unix, windows)))]
pub mod port;
#[cfg(feature = "std")]
pub mod recording;
#[cfg(feature = "sim")]
pub mod replay;
#[cfg(feature = "sim")]
pub mod slave;
#[cfg(feature = "std")]
mod span;
#[cfg(feature = "std")]
pub mod summary;
#[cfg(feature = "std")]
mod threads;

#[cfg(feature = "std")]
pub use ecm::Ecm;
