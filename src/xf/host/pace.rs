//! The time of the next exchange: after the idle time, or at the edge of INT0.

use super::config::{HostConfig, HostPacing};
use crate::ethercat::Ns;

/// When the next exchange may begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ExchangePace {
    /// The exchange may begin now.
    Go,
    /// The exchange may begin at this time.
    Until(Ns),
    /// The exchange may begin when INT0 becomes active; the wait ends at this time.
    Int0(Ns),
    /// INT0 did not become active within [`Timeouts::int0_ns`](super::Timeouts::int0_ns).
    Missed,
}

#[derive(Clone, Debug)]
pub(super) struct HostPacer {
    /// The present idle time, in nanoseconds.
    idle_ns: Ns,
    /// The earliest time for the next exchange.
    not_before: Ns,
    /// The time since which the driver has been waiting for INT0; `None` if it does not wait.
    waiting_since: Option<Ns>,
    /// Number of INT0 timeouts in a row from a chip that otherwise answers.
    pub(super) misses: u32,
}

impl HostPacer {
    pub(super) const fn new(config: &HostConfig) -> Self {
        Self { idle_ns: config.idle_ns, not_before: 0, waiting_since: None, misses: 0 }
    }

    /// Records that an exchange begins.
    pub(super) const fn began(&mut self) {
        self.waiting_since = None;
    }

    /// Records that an exchange has ended. `ready` says whether INT0 has become active since its beginning.
    pub(super) fn ended(&mut self, now: Ns, config: &HostConfig, ready: bool, whole_packet: bool) {
        if config.pacing == HostPacing::Int0 && whole_packet {
            self.waiting_since = (!ready).then_some(now);
            let extra = if self.idle_ns > config.idle_ns { self.idle_ns } else { 0 };
            self.not_before = now.saturating_add(extra);
        } else {
            self.not_before = now.saturating_add(self.idle_ns);
        }
    }

    /// Records the edge of INT0.
    pub(super) const fn ready(&mut self) {
        self.waiting_since = None;
        self.misses = 0;
    }

    /// Forbids exchanges before the time `until`, whatever the level of INT0.
    pub(super) fn hold(&mut self, until: Ns) {
        self.waiting_since = None;
        self.not_before = self.not_before.max(until);
    }

    /// Resets the number of INT0 timeouts in a row, because the edges are missing for another reason: the chip takes no
    /// packets while it starts, or while it expects packets of another data segment size.
    pub(super) const fn excuse_int0(&mut self) {
        self.misses = 0;
    }

    /// Doubles the idle time, up to the configured maximum, because the chip was not ready.
    pub(super) fn slower(&mut self, config: &HostConfig) {
        self.excuse_int0();
        // The lower bound matters: an idle time of 0 would remain 0 when doubled.
        self.idle_ns = self.idle_ns.max(1_000).saturating_mul(2).min(config.idle_max_ns.max(config.idle_ns));
    }

    /// Halves the idle time, down to the configured one, because the chip was ready.
    pub(super) fn faster(&mut self, config: &HostConfig) {
        self.idle_ns = (self.idle_ns / 2).max(config.idle_ns);
    }

    /// The condition for the next exchange. An INT0 timeout is returned once; after that the exchange may begin.
    pub(super) fn pace(&mut self, now: Ns, config: &HostConfig) -> ExchangePace {
        if now < self.not_before {
            return ExchangePace::Until(self.not_before);
        }
        let Some(since) = self.waiting_since else { return ExchangePace::Go };
        let until = since.saturating_add(config.timeouts.int0_ns);
        if now < until {
            return ExchangePace::Int0(until);
        }
        self.waiting_since = None;
        self.misses += 1;
        ExchangePace::Missed
    }
}
