//! The errors of the native API. Each message names what happened and where, and ends with what to do.

use std::time::Duration;

use super::config::ConfigError;
use crate::address::scale::SoftLimits;
use crate::ethercat::cia402::{ErrorCode, Mode, Statusword};
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::link::LinkError;
use crate::machine_file::MachineFileError;
use crate::sk::{MasterState, SlaveKind, StateByte};
use crate::span::Span;

/// An error of the native API.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
#[non_exhaustive]
pub enum EcmError {
    /// The link failed. After [`LinkError::Lost`] open a new [`Ecm`](super::Ecm): there is no automatic reconnection.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The configuration cannot be used. Nothing of it was sent to the board.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The machine file cannot be used.
    #[error(transparent)]
    Machine(#[from] MachineFileError),
    /// The slot size of the board is not known: the link's URI does not give it, and no report had a CRC that is right
    /// for exactly one slot size.
    #[error("`{name}` does not say how many bytes a slot has; put `slot=12` or `slot=16` (CONFIG2 high) into the link")]
    SlotUnknown { name: String },
    /// The value of an option or of a parameter is not allowed.
    #[error("{what} is {found}; set {allowed}")]
    Setting { what: &'static str, found: String, allowed: &'static str },
    /// The board has made no usable report for longer than the timeout. A report with a wrong CRC is not usable.
    #[error(
        "{what}: no usable report for {} ({bad_crc} with a wrong CRC since it was opened); {}",
        Span(*.waited), silence(*.network_down)
    )]
    NoReport {
        /// The name of the operation that needed a report.
        what: &'static str,
        /// How long the operation has waited.
        waited: Duration,
        /// The number of reports since the board was opened that were discarded because of a wrong CRC.
        bad_crc: u64,
        /// Whether the board is a model in this process that gets no frames back from its slaves, for example because the
        /// first cable is cut, see [`LinkStats::network_down`](crate::link::LinkStats::network_down).
        network_down: bool,
    },
    /// The board makes reports, but they did not show the effect of the operation in time.
    #[error("{what}: not done after {}, {seen}; {hint}", Span(*.waited))]
    Timeout {
        what: &'static str,
        /// How long the operation has waited.
        waited: Duration,
        /// What the newest report shows instead of the effect, as text.
        seen: String,
        hint: &'static str,
    },
    /// A change of state ended in another state.
    #[error("{wanted} was not reached, the board is in {found}: {suspect}")]
    StateStuck {
        wanted: MasterState,
        /// The state in which the change ended.
        found: StateByte,
        /// The slave that probably prevented the change of state.
        suspect: Suspect,
    },
    /// The call is not allowed in the present state of the network.
    #[error("{what} needs {needs}, the board is in {found}; use set_state first")]
    WrongState {
        what: &'static str,
        /// The states that allow the call.
        needs: &'static str,
        found: StateByte,
    },
    /// The network and the configuration have different numbers of slaves.
    #[error(
        "{} configured and the board found {found}; correct `slaves`, or check cables and power",
        slaves_are(*.declared)
    )]
    SlaveCount {
        /// The number of slaves in the configuration.
        declared: usize,
        /// The number of slaves that the board has found.
        found: usize,
    },
    /// No slave with that number is configured.
    #[error(
        "there is no slave {slave}, {} configured; call configure, or adopt for a board that runs",
        slaves_are(*.declared)
    )]
    NoSuchSlave {
        slave: u8,
        /// The number of configured slaves.
        declared: usize,
    },
    /// The call is not for this kind of slave.
    #[error("slave {slave} is configured as {kind}, {what} is not for it; use it on {wanted}")]
    WrongKind {
        slave: u8,
        kind: &'static str,
        what: &'static str,
        /// The kinds of slaves that the call is for.
        wanted: &'static str,
    },
    /// The axis is configured for another mode.
    #[error("slave {slave} runs in {mode}, not in {wanted}; change its mode in the configuration")]
    WrongMode {
        slave: u8,
        mode: Mode,
        /// The mode for which the call sets a target.
        wanted: Mode,
    },
    /// A slave refused an SDO transfer.
    #[error(
        "{verb} {object} of slave {slave} was aborted with {code}; check object, size and state in the slave's manual"
    )]
    SdoAborted {
        /// What the transfer was for: `reading` or `writing`.
        verb: &'static str,
        slave: u8,
        object: ObjectAddress,
        code: AbortCode,
    },
    /// The value of an object does not fit the type with which it was read.
    #[error("{object} of slave {slave} is 0x{value:X}, too wide for {bits} bits; read it as a wider type")]
    SdoTooWide { slave: u8, object: ObjectAddress, value: u32, bits: u32 },
    /// The axis is not in Operation enabled.
    #[error("slave {slave} is not in Operation enabled (statusword 0x{:04X}); call servo_on first", statusword.0)]
    NotEnabled { slave: u8, statusword: Statusword },
    /// The first channel of an HSP is switched on, the second one is not.
    #[error("the second channel of slave {slave} is not in Operation enabled; call clear_alarm, then servo_on")]
    SecondOff { slave: u8 },
    /// A slave was lost in OP: its slot keeps old values.
    #[error(
        "{} lost, the board is in {found}; check cable and power, then set_state brings it back",
        slave.map_or_else(|| "a slave (the board does not say which) is".to_owned(), |slave| format!("slave {slave} is"))
    )]
    SlaveLost {
        /// The lost slave; `None` if reports do not show which one it is.
        slave: Option<u8>,
        found: StateByte,
    },
    /// The depth of a stream is too large. When the stream ends, the board still executes that many frames before the
    /// axes are ramped, so that closing would take more than 2 s.
    #[error(
        "depth is {found}; with a cycle of {cycle:?} set 1 to {max}: what is ahead of the board and the ramp have to end \
         within the 2 s of closing"
    )]
    TooDeep { found: u16, max: u16, cycle: Duration },
    /// The drive has an alarm.
    #[error("slave {slave} has alarm {}; remove the cause (drive's manual), then clear_alarm and servo_on", ErrorCode(*.code))]
    Alarm {
        slave: u8,
        /// The error code (0x603F); 0 for an HSP, whose reports have none.
        code: u16,
    },
    /// The guard of the axis refused a target.
    #[error(
        "target {target} of slave {slave} is {} counts from its position {actual}, allowed are {limit}; \
         start from the actual position, or widen the axis's guard",
        target.wrapping_sub(*actual).unsigned_abs()
    )]
    TooFar {
        slave: u8,
        /// The target, counts.
        target: i32,
        /// The actual position, counts.
        actual: i32,
        /// The greatest distance that the guard allows, counts.
        limit: u32,
    },
    /// A target is beyond the soft limits of its axis ([`Axis::limits`](super::Axis::limits)) and leads further out.
    #[error(
        "target {target} of slave {slave} is beyond its soft limits {} to {} (counts); correct the program, or the limits of \
         the axis",
        .limits.min,
        .limits.max
    )]
    SoftLimit {
        slave: u8,
        /// The target, counts.
        target: i32,
        /// The limits of the axis.
        limits: SoftLimits,
    },
    /// A position in units does not fit the 32 bits of the wire.
    #[error("{units} units of slave {slave} are no 32-bit count; check the value and the axis's scale")]
    OutOfRange { slave: u8, units: f64 },
    /// The FIFO was cleared while the stream was open, so that its next targets do not continue the positions of the axes.
    #[error("the FIFO was cleared while the stream was open; end it, and start another one from the actual positions")]
    Cleared,
    /// The axis is homing, and takes no other command until homing ends.
    #[error("slave {slave} is homing; wait for it to end, or abort it")]
    IsHoming { slave: u8 },
    /// Homing ended without "homing attained".
    #[error("homing of slave {slave} failed: {why}; check its method and switches, then home again")]
    HomingFailed { slave: u8, why: &'static str },
    /// The program has ended the wait, see [`Ecm::with_interrupt`](super::Ecm::with_interrupt).
    #[error(
        "the program has interrupted the wait; what was sent may still take effect, so look at the state of the board"
    )]
    Interrupted,
    /// Another thread uses something that only one call may use at a time: the board, the SDO slot, the stream, or
    /// homing.
    #[error("{what} is in use by another thread; wait for it to end")]
    Busy { what: &'static str },
}

impl EcmError {
    /// The error of a call on the wrong kind of slave; `wanted`: the kinds of slaves that the call is for.
    pub(super) const fn wrong_kind(slave: u8, kind: SlaveKind, what: &'static str, wanted: &'static str) -> Self {
        Self::WrongKind { slave, kind: kind.name(), what, wanted }
    }

    /// Whether the link has failed, so that nothing more can be sent.
    pub(super) const fn is_of_link(&self) -> bool {
        matches!(self, Self::Link(error) if !matches!(error, LinkError::BeyondLimit { .. }))
    }
}

/// The slave that probably prevents a change of state. To find it, the API reads from each slave by SDO an object that
/// every slave of its configured kind has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum Suspect {
    /// The slave does not answer the SDO transfer with which the API reads the object.
    Silent { slave: u8 },
    /// The slave lacks the statusword or the device type, an object that every slave of its configured kind has.
    NotOfKind {
        slave: u8,
        kind: &'static str,
        /// The object that is missing.
        missing: ObjectAddress,
    },
    /// No slave is configured (SET_AXIS), so that the board treats every slave as an IO slave.
    Undeclared,
    /// All slaves answer and match the configuration, so the cause is unknown: reports do not contain AL status codes.
    Unknown,
    /// No slave answers, or the state of the network does not allow SDO transfers.
    Network,
}

impl std::fmt::Display for Suspect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Silent { slave } => write!(
                f,
                "slave {slave} does not answer an SDO; check its cable and power, and if it is there, whether it has CoE (an IO slave \
                 may have none)"
            ),
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

/// What the user can do about a board without usable reports, as the end of the error's message.
const fn silence(network_down: bool) -> &'static str {
    if network_down {
        "nothing comes back from the network: look at the cable to the first slave, at the network card or the chip that it begins at, and \
         at the slaves' power, then bring the slaves back by SET_STATE"
    } else {
        "check the cable to the first slave and the board's power"
    }
}

/// The beginning of a sentence about slaves: `1 slave is`, `3 slaves are`.
fn slaves_are(count: usize) -> String {
    format!("{count} {}", if count == 1 { "slave is" } else { "slaves are" })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A message uses the singular for one slave.
    #[test]
    fn one_slave() {
        let said = |declared| EcmError::SlaveCount { declared, found: 2 }.to_string();
        assert!(said(1).starts_with("1 slave is configured and the board found 2; "), "{}", said(1));
        assert!(said(3).starts_with("3 slaves are configured and "), "{}", said(3));
        let said = EcmError::NoSuchSlave { slave: 4, declared: 1 }.to_string();
        assert!(said.starts_with("there is no slave 4, 1 slave is configured; "), "{said}");
    }
}
