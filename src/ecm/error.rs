//! What can go wrong, one enum: each variant says what happened, to what, and ends with what to do.

use std::time::Duration;

use super::config::ConfigError;
use crate::cia402::{Mode, Statusword};
use crate::coe::{AbortCode, ObjectAddress};
use crate::link::LinkError;
use crate::sk::{MasterState, StateByte};
use crate::span::Span;

/// An error of the native API.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EcmError {
    /// The link failed; after [`LinkError::Lost`] open a new [`Ecm`](super::Ecm), nothing reconnects by itself.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The configuration is wrong; nothing of it was sent.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The link does not say how wide slots are, and no report showed it.
    #[error("`{name}` does not say how many bytes a slot has; put `slot=12` or `slot=16` (CONFIG2 high) into the link")]
    SlotUnknown {
        /// Which link.
        name: String,
    },
    /// A setting cannot be used.
    #[error("{what} is {found}; set {allowed}")]
    Setting {
        /// Which.
        what: &'static str,
        /// What was given.
        found: String,
        /// What may be given.
        allowed: &'static str,
    },
    /// The board said nothing.
    #[error(
        "{what}: no usable report for {} ({bad_crc} with a wrong CRC since it was opened); \
         check the cable to the first slave and the board's power",
        Span(*.waited)
    )]
    NoReport {
        /// What waited for it.
        what: &'static str,
        /// How long.
        waited: Duration,
        /// Reports thrown away since the board was opened.
        bad_crc: u64,
    },
    /// The board talks, but what was waited for did not happen.
    #[error("{what}: not done after {}, {seen}; {hint}", Span(*.waited))]
    Timeout {
        /// What was waited for.
        what: &'static str,
        /// How long.
        waited: Duration,
        /// What was seen instead.
        seen: String,
        /// What to do.
        hint: &'static str,
    },
    /// A change of state ended somewhere else.
    #[error("{wanted} was not reached, the board is in {found}: {suspect}")]
    StateStuck {
        /// What was asked for.
        wanted: MasterState,
        /// Where it ended.
        found: StateByte,
        /// Which slave it was, as far as the wire shows it.
        suspect: Suspect,
    },
    /// The network's state does not allow it.
    #[error("{what} needs {needs}, the board is in {found}; use set_state first")]
    WrongState {
        /// What was tried.
        what: &'static str,
        /// The states that allow it.
        needs: &'static str,
        /// The state.
        found: StateByte,
    },
    /// The network has another number of slaves than the configuration.
    #[error(
        "{} configured and the board found {found}; correct `slaves`, or check cables and power",
        slaves_are(*.declared)
    )]
    SlaveCount {
        /// In the configuration.
        declared: usize,
        /// On the network.
        found: usize,
    },
    /// No slave of that number is configured.
    #[error(
        "there is no slave {slave}, {} configured; call configure, or adopt for a board that runs",
        slaves_are(*.declared)
    )]
    NoSuchSlave {
        /// The number.
        slave: u8,
        /// How many there are.
        declared: usize,
    },
    /// The slave is of another kind.
    #[error("slave {slave} is configured as {kind}, {what} is not for it; use it on {wanted}")]
    WrongKind {
        /// Slave.
        slave: u8,
        /// What it is.
        kind: &'static str,
        /// What was tried.
        what: &'static str,
        /// What it is for.
        wanted: &'static str,
    },
    /// An axis in another mode.
    #[error("slave {slave} runs in {mode}, not in {wanted}; change its mode in the configuration")]
    WrongMode {
        /// Slave.
        slave: u8,
        /// Its mode.
        mode: Mode,
        /// The mode of what was tried.
        wanted: Mode,
    },
    /// A slave refused an SDO transfer.
    #[error(
        "{verb} {object} of slave {slave} was aborted with {code}; check object, size and state in the slave's manual"
    )]
    SdoAborted {
        /// `reading` or `writing`.
        verb: &'static str,
        /// Slave.
        slave: u8,
        /// Object.
        object: ObjectAddress,
        /// Why.
        code: AbortCode,
    },
    /// An object holds more than the type it was read as.
    #[error("{object} of slave {slave} is 0x{value:X}, too wide for {bits} bits; read it as a wider type")]
    SdoTooWide {
        /// Slave.
        slave: u8,
        /// Object.
        object: ObjectAddress,
        /// What it holds.
        value: u32,
        /// Bits of the type.
        bits: u32,
    },
    /// The axis is not on.
    #[error("slave {slave} is not in Operation enabled (statusword 0x{:04X}); call servo_on first", statusword.0)]
    NotEnabled {
        /// Slave.
        slave: u8,
        /// Its statusword.
        statusword: Statusword,
    },
    /// The second channel of an HSP is not on, the first one is.
    #[error("the second channel of slave {slave} is not in Operation enabled; call clear_alarm, then servo_on")]
    SecondOff {
        /// Slave.
        slave: u8,
    },
    /// A slave has been lost in OP: what its slot shows is old.
    #[error(
        "{} lost, the board is in {found}; check cable and power, then set_state brings it back",
        slave.map_or_else(|| "a slave (the board does not say which) is".to_owned(), |slave| format!("slave {slave} is"))
    )]
    SlaveLost {
        /// Which, as far as it is known.
        slave: Option<u8>,
        /// The state.
        found: StateByte,
    },
    /// A stream so deep could not be brought to a standstill within the limit of closing.
    #[error(
        "depth is {found}; with a cycle of {cycle:?} set 1 to {max}: what is ahead of the board and the ramp have to end \
         within the 2 s of closing"
    )]
    TooDeep {
        /// What was given.
        found: u16,
        /// The most frames that can be ahead.
        max: u16,
        /// The network's cycle.
        cycle: Duration,
    },
    /// The drive has an alarm.
    #[error("slave {slave} has alarm 0x{code:04X}; remove the cause (drive's manual), then clear_alarm and servo_on")]
    Alarm {
        /// Slave.
        slave: u8,
        /// 0x603F; an HSP shows none.
        code: u16,
    },
    /// The guard refused a target.
    #[error(
        "target {target} of slave {slave} is {} counts from its position {actual}, allowed are {limit}; \
         start from the actual position, or widen the axis's guard",
        target.wrapping_sub(*actual).unsigned_abs()
    )]
    TooFar {
        /// Slave.
        slave: u8,
        /// Counts.
        target: i32,
        /// Counts.
        actual: i32,
        /// Counts.
        limit: u32,
    },
    /// A position in units is outside the wire's 32 bits.
    #[error("{units} units of slave {slave} are no 32-bit count; check the value and the axis's scale")]
    OutOfRange {
        /// Slave.
        slave: u8,
        /// What was asked for.
        units: f64,
    },
    /// The FIFO was cleared under a stream: the axes are not where its next targets begin.
    #[error("the FIFO was cleared while the stream was open; end it, and start another one from the actual positions")]
    Cleared,
    /// The axis is homing.
    #[error("slave {slave} is homing; wait for it to end, or abort it")]
    IsHoming {
        /// Slave.
        slave: u8,
    },
    /// Homing ended without a home.
    #[error("homing of slave {slave} failed: {why}; check its method and switches, then home again")]
    HomingFailed {
        /// Slave.
        slave: u8,
        /// How.
        why: &'static str,
    },
    /// Somebody else uses it.
    #[error("{what} is in use by another thread; wait for it to end")]
    Busy {
        /// What.
        what: &'static str,
    },
}

/// On which slave a change of state got stuck, as far as a host can find out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Suspect {
    /// It does not answer an SDO.
    Silent {
        /// Slave.
        slave: u8,
    },
    /// It has not got the objects of its kind.
    NotOfKind {
        /// Slave.
        slave: u8,
        /// What it was declared as.
        kind: &'static str,
        /// The object that is missing.
        missing: ObjectAddress,
    },
    /// Nothing is configured: without it the board takes every slave for an IO slave.
    Undeclared,
    /// All answer and fit; the wire does not carry AL status codes.
    Unknown,
    /// No slave is there at all, or the state allows no SDO to look.
    Network,
}

impl std::fmt::Display for Suspect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Silent { slave } => write!(f, "slave {slave} does not answer; check its cable and power"),
            Self::NotOfKind { slave, kind, missing } => {
                write!(f, "slave {slave} is no {kind}, it has no object {missing}; correct the configuration")
            }
            Self::Undeclared => f.write_str(
                "no slave is configured, so that the board takes all for IO slaves; call configure first",
            ),
            Self::Unknown => f.write_str(
                "every slave answers and fits, one refuses (the wire does not say which); look at the slaves' error LEDs",
            ),
            Self::Network => f.write_str("no slave can be asked; check the cable to the first slave and its power"),
        }
    }
}

/// `1 slave is`, `3 slaves are`.
fn slaves_are(count: usize) -> String {
    format!("{count} {}", if count == 1 { "slave is" } else { "slaves are" })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One slave is one slave.
    #[test]
    fn one_slave() {
        let said = |declared| EcmError::SlaveCount { declared, found: 2 }.to_string();
        assert!(said(1).starts_with("1 slave is configured and the board found 2; "), "{}", said(1));
        assert!(said(3).starts_with("3 slaves are configured and "), "{}", said(3));
        let said = EcmError::NoSuchSlave { slave: 4, declared: 1 }.to_string();
        assert!(said.starts_with("there is no slave 4, 1 slave is configured; "), "{said}");
    }
}
