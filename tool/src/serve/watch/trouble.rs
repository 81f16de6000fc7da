//! Texts for what is wrong with a board, for `/healthz`, the log and systemd.

use std::time::Duration;

use ecmsk::link::LinkStats;
use ecmsk::sk::{MasterState, StateByte};

/// The text for a board that is open but shows no sign of life. `is_here`: the board runs in this process, so its
/// cycles are counted. Otherwise only its reports are.
pub fn silence(is_here: bool, stands: Duration) -> String {
    let seconds = stands.as_secs_f64();
    if is_here {
        format!("the board's cycle stands still for {seconds:.1} s: this machine is too busy, or the server hangs")
    } else {
        format!("no report of the board for {seconds:.1} s: look at its cable and its supply")
    }
}

/// What is wrong with the network of a board that answers: the cable, or lost slaves. `state` is the state in the
/// latest report.
pub fn of_network(stats: &LinkStats, state: StateByte) -> Option<String> {
    if stats.network_down {
        return Some(
            "the board receives nothing from its network: look at the cable to the first slave and at the network card"
                .to_owned(),
        );
    }
    let lost: Vec<String> = stats.lost.iter().map(|slave| slave.to_string()).collect();
    let why = stats.state_failure.map(|failure| format!(": {failure}")).unwrap_or_default();
    match &lost[..] {
        [] if state.is_failed() && state.state() == Some(MasterState::Op) => Some(format!("a slave is lost{why}")),
        [] => None,
        [slave] => Some(format!("slave {slave} is lost{why}")),
        slaves => Some(format!("slaves {} are lost{why}", slaves.join(", "))),
    }
}

#[cfg(test)]
mod tests {
    use ecmsk::fieldbus::SlaveSet;

    use super::*;

    /// Lost slaves are named if the board knows them; otherwise the state byte only shows that there is one. A state
    /// change that has failed below OP is no lost slave.
    #[test]
    fn lost_slaves_are_named() {
        let of = |lost, state| {
            of_network(&LinkStats { lost: SlaveSet::from_bits(lost), ..LinkStats::default() }, StateByte(state))
        };
        assert_eq!(of(0, 8), None);
        assert_eq!(of(0, 0x12), None);
        assert_eq!(of(0, 0x18).as_deref(), Some("a slave is lost"));
        assert_eq!(of(0b100, 0x18).as_deref(), Some("slave 3 is lost"));
        assert_eq!(of(0b101, 0x18).as_deref(), Some("slaves 1, 3 are lost"));
        let down = LinkStats { network_down: true, ..LinkStats::default() };
        assert!(of_network(&down, StateByte(8)).is_some_and(|why| why.contains("cable")));
    }
}
