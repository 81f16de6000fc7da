//! Judges whether a machine with Linux is set up for a board.

mod gadget;
mod host;
mod net;
mod spi;
mod usb;

use super::Machine;
use crate::address::uri::LinkUri;
use crate::machine::findings::{Finding, timer};
use crate::machine::timing::timer_resolution;

impl Machine {
    /// The results of all checks that need no waiting. Something that is missing counts as wrong if the link `wanted`
    /// needs it, and is only mentioned if other links need it.
    pub fn findings(&self, wanted: Option<&LinkUri>) -> Vec<Finding> {
        let mut all = self.usb_findings(wanted);
        all.extend(self.spi_findings(wanted));
        all.extend(self.net_findings(wanted));
        all.extend(self.host_findings());
        all.push(timer(timer_resolution()));
        all
    }
}
