//! The URI keys of links to boards whose EC01M is a model that runs in this process, as Rust types. These keys describe
//! the board and its host interface, so they are the same for simulated slaves, a chip and a network card.

use std::time::Duration;

use super::engine::RunOptions;
use crate::address::keys::millis;
use crate::address::uri::{LinkUri, UriError, slot_size};
use crate::engine::{EngineConfig, Firmware, Rate, RealTime};
use crate::fieldbus::Ns;
use crate::link::common_options::CommonOptions;
use crate::sk::SlotSize;

/// Options of `sim:`, `xf-sim:`, `xf-spi:`, `xf-usb:` and `nic:`, whose EC01M is a model that runs in this process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BoardOptions {
    /// The slot size, which the board's jumper CONFIG2 selects.
    pub slot: SlotSize,
    /// The version of the firmware to simulate.
    pub firmware: Firmware,
    /// Whether the board is in test mode, which the jumper CONFIG1 selects.
    pub test: bool,
    /// The duration of a write, in microseconds of the board's time: 0..=1 000 000.
    pub host_us: u32,
    /// The timeout of a change of the EtherCAT state.
    pub state_timeout: Duration,
    /// The timeout for a slave's answer to an SDO request.
    pub sdo_timeout: Duration,
    /// The real-time priority (SCHED_FIFO) of the cyclic thread, 1..=99; `None` for a normal thread.
    pub priority: Option<u8>,
    /// The processor that the cyclic thread runs on, from 0; `None` for any.
    pub cpu: Option<u16>,
    /// Whether the memory of the process is locked (`mlockall`), so that no cycle waits for a page fault.
    pub lock_memory: bool,
}

impl BoardOptions {
    /// Reads the options from a URI; keys that are not given have their defaults.
    ///
    /// # Errors
    /// [`UriError`] if links of this scheme do not have these keys.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, UriError> {
        Ok(Self {
            slot: uri.required("slot", slot_size)?,
            firmware: uri.choice("fw", [("1.7", Firmware::V17), ("1.5", Firmware::V15)])?,
            test: uri.choice("test", [("0", false), ("1", true)])?,
            host_us: uri.required("host_us", |value| value.parse().ok())?,
            state_timeout: uri.required("state_timeout_ms", millis)?,
            sdo_timeout: uri.required("sdo_timeout_ms", millis)?,
            priority: uri.typed("priority", |value| value.parse().ok())?,
            cpu: uri.typed("cpu", |value| value.parse().ok())?,
            lock_memory: uri.choice("lock_memory", [("no", false), ("yes", true)])?,
        })
    }

    /// The configuration of the board's model that these options give.
    pub(crate) fn engine(&self) -> EngineConfig {
        EngineConfig {
            slot: self.slot,
            firmware: self.firmware,
            state_timeout_ns: self.state_timeout.as_nanos() as Ns,
            sdo_timeout_ns: self.sdo_timeout.as_nanos() as Ns,
            test: self.test,
            ..EngineConfig::default()
        }
    }

    /// The options of the board's host interface: its clock, its queue of reports, its timeouts and its thread.
    pub(crate) fn run(&self, common: &CommonOptions, virtual_time: bool, rate: Rate) -> RunOptions {
        RunOptions {
            virtual_time,
            host_ns: Ns::from(self.host_us) * 1000,
            queue: common.queue,
            read_wait: common.read_wait(),
            write_wait: common.write_wait(),
            real_time: RealTime { priority: self.priority, cpu: self.cpu, lock_memory: self.lock_memory },
            rate,
        }
    }
}
