//! The 22 commands: their ids, the slots in which they may be sent, the kinds of slaves that accept them, the states
//! that allow them, when they take effect, and what becomes of an axis's target (UG17 1.8, table 1.3).
//!
//! To add a command of the board, add a row to the table in this file. Then complete it in these files:
//!
//! - `command.rs`, `command/slave.rs` or `command/sdo.rs`, by its slot: its arguments in a frame, in a dump and in
//!   JSON;
//! - `engine/commands.rs`: its effect in the model of the board, and `engine/volatile.rs` for what it sets until SW_RESET;
//! - `tests/support/src/guide.rs` and `docs/rules/board.md`: the guide's table, and the rule.
//!
//! A test fails for each file that was forgotten (`tests/sk/commands.rs`, which also has the bytes of every command).
//! Once the command is a variant of its enum in `command/`, the compiler names the matches over it. Everything else
//! that depends on a command, such as the kind of slave that a dump guesses by it, follows from its row.

use core::fmt;

use super::argument::SlaveKind;
use super::state::MasterState;

/// Where a command is allowed, as bit masks: a bit for each [`SlotKind`] in which it may be sent, and a bit for each
/// kind of slave that accepts it, by [`SlaveKind::nibble`].
#[derive(Clone, Copy)]
struct Takers {
    slots: u8,
    kinds: u16,
}

impl Takers {
    const fn new(slots: &[SlotKind], kinds: &[SlaveKind]) -> Self {
        let (mut takers, mut n) = (Self { slots: 0, kinds: 0 }, 0);
        while n < slots.len() {
            takers.slots |= 1 << slots[n] as u8;
            n += 1;
        }
        n = 0;
        while n < kinds.len() {
            takers.kinds |= 1 << kinds[n].nibble();
            n += 1;
        }
        takers
    }

    /// A command for the slots of slaves, accepted by these kinds.
    const fn slaves(kinds: &[SlaveKind]) -> Self {
        Self::new(&[SlotKind::Slave], kinds)
    }
}

const EVERY_SLOT: Takers =
    Takers::new(&SlotKind::ALL, &[SlaveKind::Drive, SlaveKind::Io, SlaveKind::Hsp, SlaveKind::Step]);
const BOARD: Takers = Takers::new(&[SlotKind::Master], &[]);
const ANY_SLAVE: Takers = Takers { kinds: u16::MAX, ..Takers::slaves(&[]) };
const AXES: Takers = Takers::slaves(&[SlaveKind::Drive, SlaveKind::Hsp, SlaveKind::Step]);
const DRIVES_AND_HSPS: Takers = Takers::slaves(&[SlaveKind::Drive, SlaveKind::Hsp]);
const DRIVES: Takers = Takers::slaves(&[SlaveKind::Drive]);
const IO: Takers = Takers::slaves(&[SlaveKind::Io]);
const SDO: Takers = Takers::new(&[SlotKind::Sdo], &[]);
const NOBODY: Takers = Takers::new(&[], &[]);

/// The states that allow a command, one bit each. The letters are those of the guide's table: I Init, P PreOP, S
/// SafeOP, O OP.
const IP: u8 = MasterState::Init.code() | MasterState::PreOp.code();
const IPS: u8 = IP | MasterState::SafeOp.code();
const IPSO: u8 = IPS | O;
const PSO: u8 = MasterState::PreOp.code() | MasterState::SafeOp.code() | O;
const O: u8 = MasterState::Op.code();

/// When the board executes a command in OP.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Acts {
    /// When the command's frame is the next one in the FIFO.
    InTurn,
    /// As [`Acts::InTurn`], but ignored for an axis in homing, since the command would move that axis (SV_ON, CSP, CSV,
    /// CST, GO_HOME). SK-7 `[OURS]`: SV_OFF and ALM_CLR are [`Acts::InTurn`]. SV_OFF always acts, and ends homing;
    /// ALM_CLR always acts too, since it starts no motor.
    UnlessHoming,
    /// When the command's frame arrives, without waiting in the FIFO (SK-5 `[OURS]`).
    OnArrival,
}
use Acts::{InTurn, OnArrival, UnlessHoming};

/// The effect of a command on the target of an axis: on the target position, velocity or torque that is in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TargetEffect {
    /// The command sets a target position (CSP).
    Position,
    /// The command sets a target velocity or torque (CSV, CST).
    VelocityOrTorque,
    /// The command does not change the target of its axis, which stays in force. SET_STATE and SW_RESET have this value, too:
    /// they act on the whole network, and not on the axis of a slot.
    Keeps,
    /// The command ends the target: the axis is switched on or off, its alarm is cleared, or it is homed or configured anew.
    Ends,
}
use TargetEffect::{Ends, Keeps, Position, VelocityOrTorque};

/// The row of a command in the table below. Its code is not part of the row.
struct Row {
    name: &'static str,
    takers: Takers,
    states: u8,
    acts: Acts,
    target: TargetEffect,
}

macro_rules! command_ids {
    ($($(#[$doc:meta])* $name:ident = $code:literal, $text:literal, $takers:ident, $states:ident, $acts:ident, $target:ident;)*) => {
        /// Byte 0 of a command slot. A code that no guide lists is kept as [`CommandId::Unknown`].
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum CommandId {
            $($(#[$doc])* #[doc = concat!("`", $text, "`, ", stringify!($code), ".")] #[doc(alias = $text)] $name,)*
            /// A code that is not in the table.
            Unknown(u8),
        }

        impl CommandId {
            /// The 22 commands in the order of their codes.
            pub const ALL: [Self; [$($code),*].len()] = [$(Self::$name,)*];

            /// The command with this code on the wire; [`CommandId::Unknown`] if no guide lists the code.
            #[inline]
            pub const fn from_code(code: u8) -> Self {
                BY_CODE[code as usize]
            }

            /// The code of the command on the wire: byte 0 of its slot.
            #[inline]
            pub const fn code(self) -> u8 {
                match self {
                    $(Self::$name => $code,)*
                    Self::Unknown(code) => code,
                }
            }

            #[inline]
            const fn row(self) -> Row {
                match self {
                    $(Self::$name => {
                        Row { name: $text, takers: $takers, states: $states, acts: $acts, target: $target }
                    })*
                    Self::Unknown(_) => {
                        Row { name: "UNKNOWN", takers: NOBODY, states: 0, acts: InTurn, target: Keeps }
                    }
                }
            }
        }
    };
}

/// The id of every code. It is a lookup table, because the engine looks up a code for each slot in each cycle.
static BY_CODE: [CommandId; 256] = {
    let mut ids = [CommandId::Unknown(0); 256];
    let mut code = 0;
    while code < ids.len() {
        ids[code] = CommandId::Unknown(code as u8);
        code += 1;
    }
    let mut n = 0;
    while n < CommandId::ALL.len() {
        ids[CommandId::ALL[n].code() as usize] = CommandId::ALL[n];
        n += 1;
    }
    ids
};

command_ids! {
    GetStatus = 0x00, "GET_STATUS", EVERY_SLOT, IPSO, InTurn, Keeps;
    SetState = 0x01, "SET_STATE", BOARD, IPSO, OnArrival, Keeps;
    SetAxis = 0x02, "SET_AXIS", BOARD, IP, InTurn, Keeps;
    SetDc = 0x03, "SET_DC", BOARD, IP, InTurn, Keeps;
    SetEx = 0x04, "SET_EX", BOARD, IPS, InTurn, Keeps;
    SetFifo = 0x05, "SET_FIFO", BOARD, O, OnArrival, Keeps;
    DriveMode = 0x06, "DRIVE_MODE", ANY_SLAVE, IP, InTurn, Ends;
    SdoRead = 0x07, "SDO_RD", SDO, PSO, InTurn, Keeps;
    SdoWrite = 0x08, "SDO_WR", SDO, PSO, InTurn, Keeps;
    AlarmClear = 0x10, "ALM_CLR", AXES, O, InTurn, Ends;
    ServoOn = 0x11, "SV_ON", AXES, O, UnlessHoming, Ends;
    ServoOff = 0x12, "SV_OFF", AXES, O, InTurn, Ends;
    IoRead = 0x13, "IO_RD", IO, O, InTurn, Keeps;
    IoWrite = 0x14, "IO_WR", IO, O, InTurn, Keeps;
    Csp = 0x15, "CSP", AXES, O, UnlessHoming, Position;
    Csv = 0x16, "CSV", DRIVES_AND_HSPS, O, UnlessHoming, VelocityOrTorque;
    Cst = 0x17, "CST", DRIVES, O, UnlessHoming, VelocityOrTorque;
    GoHome = 0x18, "GO_HOME", AXES, O, UnlessHoming, Ends;
    AbortHome = 0x19, "ABORT_HOME", AXES, O, InTurn, Ends;
    LocalRead = 0x21, "LIO_RD", BOARD, IPSO, InTurn, Keeps;
    LocalWrite = 0x22, "LIO_WR", BOARD, IPSO, InTurn, Keeps;
    SoftReset = 0xBB, "SW_RESET", BOARD, IPSO, OnArrival, Keeps;
}

/// The kind of a slot in a frame. Each of the three kinds takes its own commands: the columns of the table in UG17 1.8.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlotKind {
    /// Slot 0: commands for the board itself.
    Master,
    /// Slots 1..=40 (1..=30 in 16-byte mode): commands for one slave each.
    Slave,
    /// The last slot: SDO transfers.
    Sdo,
}

impl SlotKind {
    /// All three kinds, in the order of their slots in a frame.
    pub const ALL: [Self; 3] = [Self::Master, Self::Slave, Self::Sdo];
}

impl CommandId {
    /// The name in NEXTW's guides; `UNKNOWN` for a code that they do not list.
    pub const fn name(self) -> &'static str {
        self.row().name
    }

    /// Whether this command may be sent in slots of that kind (UG17 1.8). GET_STATUS may be sent in every slot, an
    /// unknown code in no slot.
    #[inline]
    pub const fn belongs_in(self, slot: SlotKind) -> bool {
        self.row().takers.slots >> slot as u8 & 1 != 0
    }

    /// Whether a slave of that kind takes this command in its slot (UG17 1.8). DRIVE_MODE may be sent before SET_AXIS
    /// has declared the slave. So every kind takes it, and it is the only command that [`SlaveKind::None`] takes.
    #[inline]
    pub const fn is_for(self, kind: SlaveKind) -> bool {
        self.row().takers.kinds >> kind.nibble() & 1 != 0
    }

    /// Whether the command is for axes: drives accept it and IO slaves do not.
    pub const fn is_for_axes(self) -> bool {
        self.is_for(SlaveKind::Drive) && !self.is_for(SlaveKind::Io)
    }

    /// The effect of the command on the target of an axis.
    pub const fn target_effect(self) -> TargetEffect {
        self.row().target
    }

    /// Whether this is a motion command: it sets a target (CSP, CSV, CST).
    pub const fn is_motion(self) -> bool {
        matches!(self.target_effect(), Position | VelocityOrTorque)
    }

    /// The only kind of slave that accepts this command; `None` if several kinds accept it, or none.
    pub const fn only_kind(self) -> Option<SlaveKind> {
        let kinds = self.row().takers.kinds;
        if kinds.is_power_of_two() { SlaveKind::from_nibble(kinds.trailing_zeros() as u8) } else { None }
    }

    /// Whether the board executes this command in that state (UG17 1.8). An unknown code is executed in no state.
    pub const fn is_allowed_in(self, state: MasterState) -> bool {
        self.row().states & state.code() != 0
    }

    /// Whether this command acts when its frame arrives, even in OP, where other commands wait in the FIFO (SK-5
    /// `[OURS]`).
    #[inline]
    pub const fn acts_on_arrival(self) -> bool {
        matches!(self.row().acts, OnArrival)
    }

    /// Whether the board ignores this command for an axis in homing, since the command would move that axis (SK-7
    /// `[OURS]`).
    #[inline]
    pub const fn is_ignored_while_homing(self) -> bool {
        matches!(self.row().acts, UnlessHoming)
    }
}

impl fmt::Display for CommandId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown(code) => write!(f, "UNKNOWN(0x{code:02X})"),
            known => f.write_str(known.name()),
        }
    }
}
