//! Decides when acyclic datagrams are sent: those of jobs and of mailboxes, and those by which the watch in
//! `lost_slaves.rs` checks the slaves. The more often a frame with acyclic datagrams is sent, the sooner the watch
//! notices a lost slave.

use super::shared::Shared;
use super::wire::Wire;
use crate::ethercat::{FRAME_LEN_MAX, Ns};

impl Shared {
    /// While the master runs no cycles, sends acyclic datagrams as fast as their answers come back.
    pub(super) fn send_acyclic_without_cycles(&mut self, now: Ns, wire: &mut (impl Wire + ?Sized)) {
        while !self.has_cycles() && self.exchange.send_queued(now, FRAME_LEN_MAX, wire) {}
    }

    /// After the frames of a cycle, sends one frame with acyclic datagrams, unless an earlier frame with such datagrams
    /// is still in flight.
    pub(super) fn send_acyclic_behind_cycle(&mut self, now: Ns, wire: &mut (impl Wire + ?Sized)) {
        if !self.exchange.is_acyclic_flying() {
            self.exchange.send_queued(now, self.settings.acyclic_bytes_max, wire);
        }
    }
}
