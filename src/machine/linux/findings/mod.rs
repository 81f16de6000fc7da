//! What is right or wrong with a machine with Linux.

mod host;
mod spi;
mod usb;

use super::Machine;
use crate::link::uri::LinkUri;
use crate::machine::findings::{Finding, timer};
use crate::machine::timing::timer_resolution;

impl Machine {
    /// All that can be told without waiting. What is missing for the link that is `wanted` is wrong; for another one it
    /// is just said.
    pub fn findings(&self, wanted: Option<&LinkUri>) -> Vec<Finding> {
        let mut all = self.usb_findings(wanted);
        all.extend(self.spi_findings(wanted));
        all.extend(self.host_findings());
        all.push(timer(timer_resolution()));
        all
    }
}
