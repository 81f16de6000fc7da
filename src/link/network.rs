//! The slaves behind a board, as the server of the board reports them: in the syntax of the tool's options.

use crate::address::slaves::list;
use crate::address::uri::LinkUri;
use crate::machine_file::slaves_of_link;

/// Slaves and units of a network, in the syntax of the tool's `--slaves` and `--counts-per-unit`. An empty text means
/// unknown.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct KnownNetwork {
    /// The slaves in network order: `drive*2,io`.
    pub slaves: String,
    /// Counts per unit, for all axes or for some: `1=5000,2=131072/360`.
    pub counts_per_unit: String,
}

impl KnownNetwork {
    /// Replaces each value that is unknown by that of `other`.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        let or = |this: String, other: String| if this.is_empty() { other } else { this };
        Self { slaves: or(self.slaves, other.slaves), counts_per_unit: or(self.counts_per_unit, other.counts_per_unit) }
    }

    /// Whether neither slaves nor units are known.
    pub fn is_empty(&self) -> bool {
        self.slaves.is_empty() && self.counts_per_unit.is_empty()
    }

    /// The slaves in the URI of a `sim:` or `xf-sim:` link. Other URIs do not list slaves, so they are unknown.
    pub(crate) fn of_sim(name: &str) -> Self {
        let uri = LinkUri::parse(name).ok().filter(|uri| uri.scheme().is_model());
        let listed = uri.and_then(|uri| slaves_of_link(&uri).ok());
        Self::of_slaves(listed.unwrap_or_default().iter().map(|slave| slave.model.name().to_owned()))
    }

    /// The network of the given slaves, each a word of the option `--slaves`, in network order.
    pub(crate) fn of_slaves(words: impl Iterator<Item = String>) -> Self {
        Self { slaves: list(words), ..Self::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ecm::{Axis, Slave};

    /// The slaves have the syntax of `--slaves`.
    #[test]
    fn a_known_network_has_the_syntax_of_the_slaves_option() {
        let of_sim = |name| KnownNetwork::of_sim(name).slaves;
        assert_eq!(of_sim("sim:?slaves=drive*2,drive:start@5,io,hsp2,step&clock=virtual"), "drive*3,io,hsp2,step");
        assert_eq!(of_sim("xf-sim:?slaves=drive,io"), "drive,io");
        assert_eq!((of_sim("usb:"), of_sim("puppet:")), (String::new(), String::new()));
        let slaves = [Slave::Drive(Axis::CSP), Slave::Drive(Axis::CSV), Slave::Drive(Axis::CSV), Slave::Unused];
        let words = slaves.iter().map(Slave::to_string);
        assert_eq!(KnownNetwork::of_slaves(words).slaves, "drive,drive:csv*2,none");
    }
}
