//! The ports of a slave controller: their links, and whether they are open, according to DL control and the links.

use super::Controller;
use crate::ethercat::Ns;
use crate::ethercat::registers::{self, DL_CONTROL, DL_STATUS, DlControl, DlStatus, EcatEvents, LoopControl, PORTS};

/// The duration of temporary loop settings, DL control bit 1 \[OURS: the data sheets say about one second], ns.
const TEMPORARY_NS: Ns = 1_000_000_000;

impl Controller {
    /// Sets for each port whether it has a link, and counts lost links.
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

    /// Whether a port is open, so that frames leave by it. A closed port is skipped.
    pub const fn is_open(&self, port: usize) -> bool {
        self.open[port]
    }

    /// Whether the loop setting and the link of an existing port open it.
    fn opens(&self, port: usize) -> bool {
        match DlControl(self.memory.u32(DL_CONTROL)).loop_control(port) {
            LoopControl::Auto => self.links[port],
            LoopControl::AutoClose => self.links[port] && self.opened[port],
            LoopControl::Open => true,
            LoopControl::Closed => false,
        }
    }

    /// Applies the loop settings in DL control, permanently or for one second.
    pub(super) fn control_loops(&mut self) {
        let is_temporary = self.memory.u32(DL_CONTROL) & DlControl::TEMPORARY != 0;
        self.temporary_until = is_temporary.then(|| self.arrival + TEMPORARY_NS);
        if !is_temporary {
            self.permanent_loops = self.memory.u8(DL_CONTROL + 1);
        }
        self.opened = self.links;
        self.show_links();
    }

    /// Restores the permanent loop settings when temporary ones end.
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
