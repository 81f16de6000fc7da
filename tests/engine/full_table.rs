//! The rules of the full table: the effect of one command in any state, for any slave, in any slot. Written from UG17
//! 1.8 and the decisions of SK-4, SK-6 and SK-7; `full_table_run` goes through all of it.

use ecmsk::engine::{Firmware, Reason};
use ecmsk::sk::{InvalidArgument, RawSlot, SlaveKind, SlotSize};
use support::guide::{self, Column};

/// The kinds of places, in the order of their slots: slot 0, then slaves from 1 on, then the SDO slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    Master,
    DriveCsp,
    DriveCsv,
    DriveCst,
    /// A drive that is off, with 0x6060 = 6.
    Homable,
    /// A drive that is homing, where the state is OP.
    Homing,
    Step,
    Hsp,
    /// A pulse module of two channels.
    Hsp2,
    Io,
    /// A slave that was found and is declared as none.
    DeclaredNone,
    /// A drive that was lost, where the state is a failed one.
    Lost,
    /// An IO slave that was lost, where the state is a failed one.
    LostIo,
    /// An IO slave for the other commands of the frame.
    Witness,
    /// No slave.
    Empty,
    Sdo,
}
use Place::*;

pub const PLACES: [Place; 15] = [
    Master,
    DriveCsp,
    DriveCsv,
    DriveCst,
    Homable,
    Homing,
    Step,
    Hsp,
    Hsp2,
    Io,
    DeclaredNone,
    Lost,
    LostIo,
    Empty,
    Sdo,
];

impl Place {
    pub fn slot(self, size: SlotSize) -> usize {
        if self == Sdo { size.sdo_slot() } else { self as usize }
    }

    pub fn is_io(self) -> bool {
        matches!(self, Io | LostIo)
    }

    pub fn is_lost(self, state: State) -> bool {
        state.failed && matches!(self, Lost | LostIo)
    }

    pub fn is_slave(self) -> bool {
        !matches!(self, Master | Sdo)
    }

    fn is_drive(self) -> bool {
        matches!(self, DriveCsp | DriveCsv | DriveCst | Homable | Homing | Lost)
    }

    fn is_nobody(self) -> bool {
        matches!(self, DeclaredNone | Empty)
    }

    /// The declared kind of a slave; `None` without a slave, and outside slaves' slots.
    fn kind(self) -> Option<SlaveKind> {
        match self {
            _ if self.is_drive() => Some(SlaveKind::Drive),
            Step => Some(SlaveKind::Step),
            Hsp | Hsp2 => Some(SlaveKind::Hsp),
            _ if self.is_io() || self == Witness => Some(SlaveKind::Io),
            _ => None,
        }
    }
}

/// Unknown ids: next to those of the table, and at the ends. `commands` sends all of them.
const UNKNOWN: [u8; 14] = [0x09, 0x0A, 0x0F, 0x1A, 0x1F, 0x20, 0x23, 0x33, 0x7F, 0x80, 0xBA, 0xBC, 0xBF, 0xFF];

/// The state of the board.
#[derive(Clone, Copy, Debug)]
pub struct State {
    /// 1, 2, 4, 8.
    pub code: u8,
    /// 0x10 is set.
    pub failed: bool,
}

impl State {
    pub fn byte(self) -> u8 {
        self.code | if self.failed { 0x10 } else { 0 }
    }

    fn letter(self) -> char {
        match self.code {
            1 => 'i',
            2 => 'p',
            4 => 's',
            _ => 'o',
        }
    }

    pub fn is_op(self) -> bool {
        self.code == 8
    }
}

/// A command with arguments, and why they are wrong, if they are.
#[derive(Clone, Copy, Debug)]
pub struct Sent {
    pub slot: RawSlot,
    pub wrong: Option<InvalidArgument>,
}

/// Every id with right arguments and with each kind of wrong arguments, in that state.
pub fn commands(size: SlotSize, state: State) -> Vec<Sent> {
    let mut all = Vec::new();
    let mut put = |id: u8, parm: u16, data1: u32, data2: u32, wrong: Option<InvalidArgument>| {
        all.push(Sent { slot: RawSlot { id, index: 0, parm, data1, data2, data3: 0 }, wrong });
    };
    put(0x01, 0, state.code.into(), 0, None);
    for data1 in [0, 3, 0x10, 0x18, 0x102, u32::MAX] {
        put(0x01, 0, data1, 0, Some(InvalidArgument::State(data1)));
    }
    put(0x02, 4, 0x1111_1111, 0, None);
    put(0x02, 5, 0x1111_1111, 0, Some(InvalidArgument::Group(5)));
    put(0x02, 0xFF, 0, 0, Some(InvalidArgument::Group(0xFF)));
    for nibble in 4..=14u8 {
        put(0x02, 0, u32::from(nibble) << 8, 0, Some(InvalidArgument::Kind { slave: 3, nibble }));
    }
    put(0x03, 0, 1000, 0xFFFF, None);
    put(0x03, 0, 1000, 0xFFFF_0000, None);
    for data1 in [0, 249, 750, 1_000_000, u32::MAX] {
        put(0x03, 0, data1, 0xFFFF, Some(InvalidArgument::CycleTime(data1)));
    }
    put(0x04, 0, 0x10, 0, None);
    put(0x05, 1, 0, 0, None);
    put(0x05, 2, 160, 0, None);
    put(0x05, 2, 0, 0, Some(InvalidArgument::ZeroThreshold));
    for action in [0, 3, 0xFF] {
        put(0x05, action.into(), 160, 0, Some(InvalidArgument::FifoAction(action)));
    }
    put(0x06, 0, 8, 1, None);
    for data1 in [0, 6, 7, 11, 0x108] {
        put(0x06, 0, data1, 1, Some(InvalidArgument::DriveMode(data1)));
    }
    put(0x06, 0, 8, 2, None);
    put(0x07, 1, 0x1018_0001, 0, None);
    put(0x08, 0x0401, 0x6065_0000, 30_000, None);
    let beyond = size.max_slaves() as u16 + 1;
    for slave in [0, beyond] {
        put(0x07, slave, 0x1018_0001, 0, Some(InvalidArgument::SdoSlave(slave)));
        put(0x08, 0x0400 | slave, 0x6065_0000, 0, Some(InvalidArgument::SdoSlave(slave)));
    }
    put(0x07, 1, 0x1018_0100, 0, Some(InvalidArgument::SubIndex(0x100)));
    put(0x08, 0x0401, 0x6065_FFFF, 0, Some(InvalidArgument::SubIndex(0xFFFF)));
    for bytes in [0u8, 3, 5, 0xFF] {
        put(0x08, u16::from(bytes) << 8 | 1, 0x6065_0000, 0, Some(InvalidArgument::SdoSize(bytes)));
    }
    // The other commands have no arguments that could be wrong.
    for (id, ..) in guide::TABLE.iter().filter(|row| !(0x01..=0x08).contains(&row.0)) {
        put(*id, 0, 0, 0, None);
    }
    for id in UNKNOWN {
        put(id, 0, 0x0102_0304, 0, None);
    }
    all
}

/// The outcome of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    Accepted,
    /// Accepted, and its target discarded: the drive is not on.
    Discarded,
    IgnoredHoming,
    ForLost,
    Rejected(Reason),
}

/// The table. If several reasons hold, the first one of these counts [OURS]: unknown id, wrong column, wrong state, bad
/// argument, no slave, wrong kind of slave, wrong mode.
pub fn outcome(sent: &Sent, place: Place, state: State, firmware: Firmware) -> Outcome {
    use Outcome::*;
    let id = sent.slot.id;
    let Some((column, states)) = guide::row(id) else { return Rejected(Reason::UnknownId) };
    let belongs = match column {
        Column::Any => true,
        Column::Board => place == Master,
        Column::Sdo => place == Sdo,
        Column::Kinds(_) | Column::AnySlave => place.is_slave(),
    };
    if !belongs {
        return Rejected(Reason::WrongSlot);
    }
    if !states.contains(state.letter()) {
        return Rejected(Reason::WrongState);
    }
    if let Some(wrong) = sent.wrong
        && column != Column::Any
    {
        return Rejected(Reason::BadArgument(wrong));
    }
    let Column::Kinds(kinds) = column else { return Accepted };
    // The following checks are for OP alone.
    if place.is_nobody() {
        return Rejected(Reason::NoSlave);
    }
    if !place.kind().is_some_and(|kind| kinds.contains(&kind)) {
        return Rejected(Reason::WrongSlot);
    }
    if place.is_lost(state) {
        return match id {
            // ABORT_HOME is for all slaves, in whichever slot it is.
            0x19 => Accepted,
            0x16 | 0x17 => Rejected(Reason::WrongMode),
            _ => ForLost,
        };
    }
    if place == Homing && matches!(id, 0x11 | 0x15 | 0x16 | 0x17 | 0x18) {
        return IgnoredHoming;
    }
    match id {
        0x15..=0x17 => {
            let right = match place {
                DriveCsv => 0x16,
                DriveCst => 0x17,
                Homable => 0,
                _ => 0x15,
            };
            if id == right { Discarded } else { Rejected(Reason::WrongMode) }
        }
        0x18 if place != Homable => Rejected(Reason::NotInHomingMode),
        // Another slave is homing, which only 1.7 rejects; and this drive is off.
        0x18 if firmware == Firmware::V17 => Rejected(Reason::HomingElsewhere),
        0x18 => Rejected(Reason::NotEnabled),
        _ => Accepted,
    }
}
