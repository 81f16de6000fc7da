//! The process data watchdog, registers 0x0400 to 0x0443.

use super::memory::Memory;
use crate::ethercat::Ns;
use crate::ethercat::registers::{
    WATCHDOG_COUNTER_PROCESS_DATA, WATCHDOG_DIVIDER, WATCHDOG_PDI, WATCHDOG_PROCESS_DATA, WATCHDOG_STATUS,
};

/// The watchdog divider at power-on: the unit of the watchdog time is 100 us.
const DIVIDER: u16 = 0x09C2;
/// The watchdog time at power-on: 1000 units, which are 100 ms.
const TIME: u16 = 0x03E8;
/// The period of the 25 MHz clock that the watchdog divider divides, ns.
const TICK_NS: Ns = 40;

/// The process data watchdog. It starts when the first outputs come.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Watchdog {
    /// The time when the watchdog expires; `None` while it is not running.
    due: Option<Ns>,
    /// The watchdog time, ns; `None` if the watchdog is off.
    time_ns: Option<Ns>,
}

impl Watchdog {
    pub(super) fn power_on(fixed_divider: Option<u16>, memory: &mut Memory) -> Self {
        memory.set_u16(WATCHDOG_DIVIDER, fixed_divider.unwrap_or(DIVIDER));
        memory.set_u16(WATCHDOG_PDI, TIME);
        memory.set_u16(WATCHDOG_PROCESS_DATA, TIME);
        Self { due: None, time_ns: Self::time(memory) }
    }

    /// The watchdog time that the registers set, ns; `None` if the watchdog is off.
    pub(super) fn time(memory: &Memory) -> Option<Ns> {
        let units = Ns::from(memory.u16(WATCHDOG_PROCESS_DATA));
        let unit = (Ns::from(memory.u16(WATCHDOG_DIVIDER)) + 2) * TICK_NS;
        (units > 0).then(|| units * unit)
    }

    fn show(&self, memory: &mut Memory) {
        let runs = self.due.is_some() || self.time_ns.is_none();
        memory.set_u16(WATCHDOG_STATUS, runs.into());
    }

    /// Restarts the watchdog because outputs have come.
    #[inline]
    pub(super) fn trigger(&mut self, now: Ns, memory: &mut Memory) {
        let begins = self.due.is_none();
        self.due = self.time_ns.map(|time| now + time);
        if begins {
            self.show(memory);
        }
    }

    /// Applies a new watchdog time. A running watchdog restarts.
    pub(super) fn set(&mut self, now: Ns, memory: &mut Memory) {
        self.time_ns = Self::time(memory);
        if self.due.is_some() {
            self.due = self.time_ns.map(|time| now + time);
        }
        self.show(memory);
    }

    /// The time when the watchdog expires; `None` while it is not running.
    pub(super) const fn due(&self) -> Option<Ns> {
        self.due
    }

    /// Advances to `now`. Returns true if the watchdog has just expired.
    pub(super) fn advance(&mut self, now: Ns, memory: &mut Memory) -> bool {
        let expired = self.due.take_if(|due| *due <= now).is_some();
        if expired {
            memory.count(WATCHDOG_COUNTER_PROCESS_DATA);
            self.show(memory);
        }
        expired
    }
}
