//! Texts for states, ports and identities of slaves.

use ecmsk::bus::{FoundSlave, SlaveState};
use ecmsk::ethercat::registers::{AlStatusRegister, PORTS, RequestedState};
use ecmsk::ethercat::{AlState, AlStatus};

/// The name of a state in the spelling that all verbs of the tool use; `None` for an unknown state.
pub const fn state_name(state: RequestedState) -> Option<&'static str> {
    match state {
        RequestedState::State(AlState::Init) => Some("Init"),
        RequestedState::State(AlState::PreOp) => Some("PreOP"),
        RequestedState::State(AlState::SafeOp) => Some("SafeOP"),
        RequestedState::State(AlState::Op) => Some("OP"),
        RequestedState::Boot => Some("Boot"),
        RequestedState::Unknown(_) => None,
    }
}

/// A state with its AL status, e.g. `SafeOP with an error, AL status 0x001B (sync manager watchdog)`.
pub fn state_text(state: SlaveState) -> String {
    let SlaveState { status, code } = state;
    let name = match status.state() {
        RequestedState::Unknown(0) => "a state that is not known".to_owned(),
        unknown @ RequestedState::Unknown(_) => format!("state 0x{:X}", unknown.code()),
        known => state_name(known).unwrap_or_default().to_owned(),
    };
    match (status.contains(AlStatusRegister::ERROR), code) {
        (false, AlStatus::NONE) => name,
        (false, code) => format!("{name}, AL status {code}"),
        (true, code) => format!("{name} with an error, AL status {code}"),
    }
}

/// The name of a slave from its EEPROM, or a placeholder if it has none.
pub const fn name(of_slave: &str) -> &str {
    if of_slave.is_empty() { "(no name)" } else { of_slave }
}

/// The type of a port, from register 0x0007; `None` if the port does not exist.
pub const fn port_kind(port_types: u8, port: usize) -> Option<&'static str> {
    match port_types >> (2 * port as u8) & 0b11 {
        2 => Some("EBUS"),
        3 => Some("MII"),
        _ => None,
    }
}

/// The number of the slave that is connected to port 1 to 3 of another slave; `None` if there is none.
pub fn behind(slaves: &[FoundSlave], slave: u8, port: usize) -> Option<u8> {
    let is_there =
        |found: &&FoundSlave| found.upstream.is_some_and(|up| up.slave == slave && usize::from(up.port) == port);
    slaves.iter().find(is_there).map(|found| found.slave)
}

/// The numbers of the existing ports of a slave, from 0 to 3.
pub fn ports(slave: &FoundSlave) -> impl Iterator<Item = usize> {
    let types = slave.port_types;
    (0..PORTS).filter(move |port| port_kind(types, *port).is_some())
}
