//! When the next exchange may begin: after the idle time, or at the edge of INT0.

use super::config::{HostConfig, Pacing};
use crate::ethercat::Ns;

/// What has to be waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pace {
    /// Nothing.
    Go,
    /// This time.
    Until(Ns),
    /// INT0, until this time at the latest.
    Int0(Ns),
    /// INT0 did not come.
    Missed,
}

#[derive(Clone, Debug)]
pub(super) struct Pacer {
    /// The present idle time.
    idle_ns: Ns,
    /// Not before this time.
    not_before: Ns,
    /// INT0 is waited for, since then.
    waiting_since: Option<Ns>,
    /// Waits in vain, one after the other, for a chip that otherwise answers.
    pub(super) misses: u32,
}

impl Pacer {
    pub(super) const fn new(config: &HostConfig) -> Self {
        Self { idle_ns: config.idle_ns, not_before: 0, waiting_since: None, misses: 0 }
    }

    /// An exchange begins.
    pub(super) const fn began(&mut self) {
        self.waiting_since = None;
    }

    /// An exchange has ended. `ready` is whether INT0 has come since it began.
    pub(super) fn ended(&mut self, now: Ns, config: &HostConfig, ready: bool, whole_packet: bool) {
        if config.pacing == Pacing::Int0 && whole_packet {
            self.waiting_since = (!ready).then_some(now);
            let extra = if self.idle_ns > config.idle_ns { self.idle_ns } else { 0 };
            self.not_before = now.saturating_add(extra);
        } else {
            self.not_before = now.saturating_add(self.idle_ns);
        }
    }

    /// The edge of INT0.
    pub(super) const fn ready(&mut self) {
        self.waiting_since = None;
        self.misses = 0;
    }

    /// Nothing is sent before this time, whatever INT0 does.
    pub(super) fn hold(&mut self, until: Ns) {
        self.waiting_since = None;
        self.not_before = self.not_before.max(until);
    }

    /// INT0 did not come since the chip does not take packets: it starts, or has packets of another n.
    pub(super) const fn excuse_int0(&mut self) {
        self.misses = 0;
    }

    /// The chip was not ready: more idle time from now on.
    pub(super) fn slower(&mut self, config: &HostConfig) {
        self.excuse_int0();
        // An idle time of 0 would stay 0.
        self.idle_ns = self.idle_ns.max(1_000).saturating_mul(2).min(config.idle_max_ns.max(config.idle_ns));
    }

    /// The chip was ready: less idle time, down to what is configured.
    pub(super) fn faster(&mut self, config: &HostConfig) {
        self.idle_ns = (self.idle_ns / 2).max(config.idle_ns);
    }

    /// What has to be waited for now. A wait in vain is given once; the exchange may then begin.
    pub(super) fn pace(&mut self, now: Ns, config: &HostConfig) -> Pace {
        if now < self.not_before {
            return Pace::Until(self.not_before);
        }
        let Some(since) = self.waiting_since else { return Pace::Go };
        let until = since.saturating_add(config.deadlines.int0_ns);
        if now < until {
            return Pace::Int0(until);
        }
        self.waiting_since = None;
        self.misses += 1;
        Pace::Missed
    }
}
