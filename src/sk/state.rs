//! The state of the network, as requested by SET_STATE and as reported by the board.

use core::fmt;

/// An EtherCAT state of the network that SET_STATE can ask for (UG17 2.1.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum MasterState {
    /// 1: Init.
    Init = 1,
    /// 2: Pre-operational.
    PreOp = 2,
    /// 4: Safe-operational.
    SafeOp = 4,
    /// 8: Operational.
    Op = 8,
}

impl MasterState {
    /// The state that Data1 of SET_STATE requests; `None` if Data1 is not 1, 2, 4 or 8.
    pub const fn from_request(data1: u32) -> Option<Self> {
        match data1 {
            1 => Some(Self::Init),
            2 => Some(Self::PreOp),
            4 => Some(Self::SafeOp),
            8 => Some(Self::Op),
            _ => None,
        }
    }

    /// The state's value on the wire: 1, 2, 4 or 8.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The name as the guides spell it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Init => "Init",
            Self::PreOp => "PreOP",
            Self::SafeOp => "SafeOP",
            Self::Op => "OP",
        }
    }
}

impl fmt::Display for MasterState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Byte 2 of slot 0 of a response: the current state of the network, or a failure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct StateByte(pub u8);

impl StateByte {
    /// 0: the board has booted and is looking for slaves.
    pub const NETWORK_INIT: Self = Self(0);
    /// SK-2 `[OURS]`: bit that marks a failure: slaves were not found, or did not reach the requested state. The low
    /// nibble then holds the last state that all slaves had reached.
    pub const FAILED: u8 = 0x10;

    /// The byte that reports that all slaves are in `state`.
    pub const fn reached(state: MasterState) -> Self {
        Self(state.code())
    }

    /// The byte that reports a failure, with the last state that all slaves had reached, if any.
    pub const fn failed(last_good: Option<MasterState>) -> Self {
        match last_good {
            Some(state) => Self(Self::FAILED | state.code()),
            None => Self(Self::FAILED),
        }
    }

    /// Whether the byte reports that no slave was found or that a slave did not reach the requested state: any value
    /// but 0, 1, 2, 4 and 8 (SK-2).
    pub const fn is_failed(self) -> bool {
        self.0 != Self::NETWORK_INIT.0 && MasterState::from_request(self.0 as u32).is_none()
    }

    /// The usual cause of a failure and what to do, as a text for users; `None` if the byte reports no failure. The
    /// wire does not show which slave failed; a modelled board in this process knows it
    /// ([`StateFailure`](crate::engine::StateFailure)).
    pub const fn explanation(self) -> Option<&'static str> {
        if !self.is_failed() {
            return None;
        }
        Some(match (self.0, self.state()) {
            (Self::FAILED, _) | (_, None) => {
                "the board finds no slave, or a slave failed; look at the network cable and at the slaves' power"
            }
            (_, Some(MasterState::Init)) => {
                "a slave did not go to PreOP; look at the slaves' power and at the cable, then SET_STATE again"
            }
            (_, Some(MasterState::PreOp)) => {
                "a slave did not go on from PreOP; most often it is declared as something else than it is, or not at all, \
                 which counts as IO: declare every slave in PreOP with SET_AXIS (0 drive, 1 IO, 2 HSP, 3 STEP, F none) and \
                 its mode with DRIVE_MODE, then SET_STATE again"
            }
            (_, Some(MasterState::Op)) => {
                "a slave has left OP: by its watchdog, if this machine was late, or as its cable or its power is gone; look at its \
                 own display, then send SET_STATE to bring it back"
            }
            (_, Some(MasterState::SafeOp)) => {
                "a slave fell out of the network or refused the next state; look at its power, its cable and its own \
                 display, then send SET_STATE to bring it back"
            }
        })
    }

    /// The state that decides which commands are allowed: the low nibble, even after a failure. `None` while the
    /// network is initialising, if no state was reached, and for unknown values.
    pub const fn state(self) -> Option<MasterState> {
        if self.0 & !(Self::FAILED | 0x0F) != 0 {
            return None;
        }
        MasterState::from_request((self.0 & 0x0F) as u32)
    }
}

impl fmt::Display for StateByte {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.0, self.state()) {
            (0, _) => f.write_str("network initialising"),
            (Self::FAILED, _) => f.write_str("no slave found"),
            (_, Some(state)) if self.is_failed() => write!(f, "{state} (a slave failed)"),
            (_, Some(state)) => state.fmt(f),
            (other, None) => write!(f, "unknown 0x{other:02X} (no slave found, or a slave failed)"),
        }
    }
}
