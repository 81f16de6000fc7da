//! Judges a machine with Linux.

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
    /// The results of all checks that need no waiting. What is missing for the link `wanted` is wrong; what is missing for other
    /// links is only mentioned.
    pub fn findings(&self, wanted: Option<&LinkUri>) -> Vec<Finding> {
        let mut all = self.usb_findings(wanted);
        all.extend(self.spi_findings(wanted));
        all.extend(self.net_findings(wanted));
        all.extend(self.host_findings());
        all.push(timer(timer_resolution()));
        all
    }
}
