//! The guide's table of commands (UG17 1.8, table 1.3). Tests of the wire format and of the engine compare with it.

use ecmsk::sk::SlaveKind;

/// Which slots take a command: the guide's column "slot", with what its text says of kinds of slaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Column {
    /// Every slot.
    Any,
    /// The board's slot: E of the guide.
    Board,
    /// Any slave's slot, whatever its kind (DRIVE_MODE).
    AnySlave,
    /// The slots of slaves of these kinds: D and I of the guide.
    Kinds(&'static [SlaveKind]),
    /// The SDO slot: S of the guide.
    Sdo,
}
use Column::{Any, AnySlave, Board, Kinds, Sdo};
use SlaveKind::{Drive, Hsp, Io, Step};

const AXES: Column = Kinds(&[Drive, Hsp, Step]);

/// Code, name, slots, states (Init, PreOP, SafeOP, OP). CSV does not go to a stepper, CST to a drive alone.
pub const TABLE: [(u8, &str, Column, &str); 22] = [
    (0x00, "GET_STATUS", Any, "ipso"),
    (0x01, "SET_STATE", Board, "ipso"),
    (0x02, "SET_AXIS", Board, "ip"),
    (0x03, "SET_DC", Board, "ip"),
    (0x04, "SET_EX", Board, "ips"),
    (0x05, "SET_FIFO", Board, "o"),
    (0x06, "DRIVE_MODE", AnySlave, "ip"),
    (0x07, "SDO_RD", Sdo, "pso"),
    (0x08, "SDO_WR", Sdo, "pso"),
    (0x10, "ALM_CLR", AXES, "o"),
    (0x11, "SV_ON", AXES, "o"),
    (0x12, "SV_OFF", AXES, "o"),
    (0x13, "IO_RD", Kinds(&[Io]), "o"),
    (0x14, "IO_WR", Kinds(&[Io]), "o"),
    (0x15, "CSP", AXES, "o"),
    (0x16, "CSV", Kinds(&[Drive, Hsp]), "o"),
    (0x17, "CST", Kinds(&[Drive]), "o"),
    (0x18, "GO_HOME", AXES, "o"),
    (0x19, "ABORT_HOME", AXES, "o"),
    (0x21, "LIO_RD", Board, "ipso"),
    (0x22, "LIO_WR", Board, "ipso"),
    (0xBB, "SW_RESET", Board, "ipso"),
];

/// The row of a command: its slots and its states.
pub fn row(code: u8) -> Option<(Column, &'static str)> {
    TABLE.iter().find(|row| row.0 == code).map(|(_, _, column, states)| (*column, *states))
}
