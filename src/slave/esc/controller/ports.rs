//! The ports of a controller: which have a link, and which are open, by DL control and their links.

use super::Controller;
use crate::ethercat::Ns;
use crate::ethercat::registers::{self, DL_CONTROL, DL_STATUS, DlControl, DlStatus, EcatEvents, LoopControl, PORTS};

/// How long ports are as DL control says with its bit 1 \[OURS: the data sheets say about a second], ns.
const TEMPORARY_NS: Ns = 1_000_000_000;

impl Controller {
    /// Sets which ports have a link.
    pub fn set_links(&mut self, links: [bool; PORTS]) {
        for (port, link) in links.into_iter().enumerate() {
            if self.links[port] && !link {
                self.memory.count(registers::LOST_LINKS + port as u16);
                self.opened[port] = false;
            }
        }
        if self.links != links {
            self.links = links;
            self.show_links();
        }
    }

    /// Whether a frame leaves by a port, or comes back at once.
    pub const fn is_open(&self, port: usize) -> bool {
        self.open[port]
    }

    /// Whether a port that is there is open, by its loop control and its link.
    fn opens(&self, port: usize) -> bool {
        match DlControl(self.memory.u32(DL_CONTROL)).loop_control(port) {
            LoopControl::Auto => self.links[port],
            LoopControl::AutoClose => self.links[port] && self.opened[port],
            LoopControl::Open => true,
            LoopControl::Closed => false,
        }
    }

    /// DL control was written: how its ports are, for good or for a second.
    pub(super) fn control_loops(&mut self) {
        let is_temporary = self.memory.u32(DL_CONTROL) & DlControl::TEMPORARY != 0;
        self.temporary_until = is_temporary.then(|| self.arrival + TEMPORARY_NS);
        if !is_temporary {
            self.permanent_loops = self.memory.u8(DL_CONTROL + 1);
        }
        self.opened = self.links;
        self.show_links();
    }

    /// Ports that were set for a second are as before.
    pub(super) fn end_temporary_loops(&mut self) {
        let control = self.memory.u32(DL_CONTROL) & !DlControl::TEMPORARY;
        self.memory.set_u32(DL_CONTROL, control);
        self.memory.set_u8(DL_CONTROL + 1, self.permanent_loops);
        self.show_links();
    }

    pub(super) fn show_links(&mut self) {
        let exists = self.settings.ports.map(|port| port >= 2);
        let open = std::array::from_fn(|port| exists[port] && self.opens(port));
        self.ports_have_changed |= open != self.open;
        self.open = open;
        let before = DlStatus(self.memory.u16(DL_STATUS));
        let status = (0..PORTS)
            .fold(before, |status, port| status.with_port(port, self.links[port] && exists[port], !self.open[port]));
        if status != before {
            self.memory.set_u16(DL_STATUS, status.0);
            self.raise(EcatEvents::DL_STATUS);
        }
    }
}
