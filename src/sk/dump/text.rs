//! The text of a dump.

use core::fmt::{self, Display, Formatter};

use super::{
    ByteOne, CommandDump, KindEvidence, ResponseDump, SlaveData, SlaveReading, SlotLine, SlotMeaning, SlotRole,
};
use crate::cia402::{Mode, Statusword};
use crate::coe::SdoSize;
use crate::sk::{
    AxisTarget, CommandId, DcShift, DriveSync, FifoAction, HspAxis, MASTER_CYCLIC, MasterCommand, MasterResponse,
    MasterState, Motion, RawSlot, SdoCommand, SdoResponse, SlaveCommand, SlaveKind, SlotCommand, SlotSize,
};

impl Display for CommandDump<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write_lines(f, self.lines())
    }
}

impl Display for ResponseDump<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write_lines(f, self.lines())
    }
}

fn write_lines(f: &mut Formatter<'_>, lines: impl Iterator<Item = (usize, SlotLine)>) -> fmt::Result {
    for (n, (_, line)) in lines.enumerate() {
        if n > 0 {
            f.write_str("\n")?;
        }
        line.fmt(f)?;
    }
    Ok(())
}

impl Display for SlotRole {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Master => f.pad("ECM"),
            Self::Slave(n) => write!(f, "slave {n}"),
            Self::Sdo => f.pad("SDO"),
        }
    }
}

impl Display for SlotLine {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.role {
            SlotRole::Slave(n) => write!(f, "slave {n:<2} ")?,
            role => write!(f, "{role:<8} ")?,
        }
        match &self.meaning {
            SlotMeaning::MasterCommand(command) => self.master_command(f, command)?,
            SlotMeaning::SlaveCommand(command) => self.slave_command(f, command)?,
            SlotMeaning::SdoCommand(command) => self.sdo_command(f, command)?,
            SlotMeaning::Malformed(reason) => {
                write!(f, "{} {}: {reason}", CommandId::from_code(self.raw.id), self.raw_fields())?;
            }
            SlotMeaning::MasterResponse(response) => master_response(f, response)?,
            SlotMeaning::SlaveResponse(reading) => self.slave_response(f, reading)?,
            SlotMeaning::SdoResponse(response) => self.sdo_response(f, response)?,
        }
        if self.fields_in_text().is_some_and(|in_text| in_text != self.fields_without_crc()) {
            write!(f, " (more bytes are set: {})", self.raw_fields())?;
        }
        match &self.crc {
            Some(crc) => write!(f, ", {crc}"),
            None => Ok(()),
        }
    }
}

impl SlotLine {
    /// The fields that the line's text tells; `None` if the text is the raw fields themselves.
    fn fields_in_text(&self) -> Option<RawSlot> {
        let used = self.meaning.encode(self.size)?;
        Some(match self.meaning {
            SlotMeaning::SdoCommand(SdoCommand::Read { .. }) => RawSlot { parm: self.raw.parm, ..used },
            _ => used,
        })
    }

    fn raw_fields(&self) -> RawFields {
        RawFields { slot: self.fields_without_crc(), size: self.size, role: self.role }
    }

    fn master_command(&self, f: &mut Formatter<'_>, command: &MasterCommand) -> fmt::Result {
        command.id().fmt(f)?;
        match *command {
            MasterCommand::GetStatus | MasterCommand::LocalRead | MasterCommand::SoftReset => Ok(()),
            MasterCommand::SetState(state) => write!(f, " {state}"),
            MasterCommand::SetAxis { group, kinds } => set_axis(f, group, &kinds, self.size),
            MasterCommand::SetDc { cycle, shift } => {
                write!(f, " {} us, ", cycle.us())?;
                match shift {
                    DcShift::Auto => f.write_str("auto shift"),
                    DcShift::AutoHigh => f.write_str("auto shift (0xFFFF0000)"),
                    DcShift::Other(raw) => write!(f, "shift 0x{raw:08X} (without effect)"),
                }
            }
            MasterCommand::SetEx { check_commands, fill_responses } => {
                write!(f, " command CRC check {}, response CRC {}", on_off(check_commands), on_off(fill_responses))
            }
            MasterCommand::SetFifo(FifoAction::Clear) => f.write_str(" clear"),
            MasterCommand::SetFifo(FifoAction::Threshold(free)) => write!(f, " threshold {free}"),
            MasterCommand::LocalWrite(outputs) => write!(f, " outputs 0b{outputs:06b}"),
            MasterCommand::Other(_) => self.foreign_id(f),
        }
    }

    fn slave_command(&self, f: &mut Formatter<'_>, slot: &SlotCommand) -> fmt::Result {
        slot.command.id().fmt(f)?;
        if slot.index != 0 {
            write!(f, " #{}", slot.index)?;
        }
        match &slot.command {
            SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync } => write!(f, " {mode}, DC sync"),
            SlaveCommand::DriveMode { mode, sync: DriveSync::FreeRun } => write!(f, " {mode}, free run"),
            SlaveCommand::IoWrite(outputs) => write!(f, " outputs 0x{outputs:04X}"),
            SlaveCommand::Csp(to) => motion(f, "target", to),
            SlaveCommand::Csv(to) => motion(f, "velocity", to),
            SlaveCommand::Cst(torque) => write!(f, " torque {}", Percent(*torque)),
            SlaveCommand::Other(_) => self.foreign_id(f),
            SlaveCommand::GetStatus
            | SlaveCommand::AlarmClear
            | SlaveCommand::ServoOn
            | SlaveCommand::ServoOff
            | SlaveCommand::IoRead
            | SlaveCommand::GoHome
            | SlaveCommand::AbortHome => Ok(()),
        }
    }

    fn sdo_command(&self, f: &mut Formatter<'_>, command: &SdoCommand) -> fmt::Result {
        command.id().fmt(f)?;
        match *command {
            SdoCommand::GetStatus => Ok(()),
            SdoCommand::Read { slave, object } => {
                write!(f, " slave {slave} {object}")?;
                match self.raw.parm >> 8 {
                    0 => Ok(()),
                    high => write!(f, " (0x{high:02X} above the slave's number is not looked at)"),
                }
            }
            SdoCommand::Write { slave, object, size, value } => {
                let bits = match size {
                    SdoSize::One => "u8",
                    SdoSize::Two => "u16",
                    SdoSize::Four => "u32",
                };
                write!(f, " slave {slave} {object} {bits} = {}", value & size.mask())?;
                if value & !size.mask() != 0 {
                    write!(f, " (of 0x{value:08X})")?;
                }
                Ok(())
            }
            SdoCommand::Other(_) => self.foreign_id(f),
        }
    }

    fn slave_response(&self, f: &mut Formatter<'_>, reading: &SlaveReading) -> fmt::Result {
        reading.id.fmt(f)?;
        match reading.byte_one {
            ByteOne::Index(0) | ByteOne::Mode(0) => {}
            ByteOne::Index(index) => write!(f, " #{index}")?,
            ByteOne::Mode(code) => match Mode::from_code(code) {
                Some(mode) => write!(f, " mode {mode}")?,
                None => write!(f, " mode {code}")?,
            },
        }
        match reading.kind {
            KindEvidence::Given(kind) | KindEvidence::Implied(kind) => write!(f, " {}", kind_name(kind))?,
            KindEvidence::Guessed(kind) => write!(f, " {}?", kind_name(kind))?,
            KindEvidence::Unknown => {}
        }
        match &reading.data {
            SlaveData::Nothing => Ok(()),
            SlaveData::Drive(drive) => {
                status_and_position(f, drive.statusword, drive.position)?;
                write!(f, ", torque {}, error code 0x{:04X}", Percent(drive.torque), drive.error_code)
            }
            SlaveData::Io(io) if reading.id == CommandId::IoWrite => write!(f, " outputs 0x{:04X}", io.bits),
            SlaveData::Io(io) => write!(f, " inputs 0x{:04X}", io.bits),
            SlaveData::Hsp(hsp) => {
                status_and_position(f, hsp.statusword, hsp.first.position)?;
                write!(f, ", inputs 0x{:04X}", hsp.first.inputs)?;
                match hsp.second {
                    nothing if nothing == HspAxis::default() => Ok(()),
                    HspAxis { position, inputs } => write!(f, "; axis 2 position {position}, inputs 0x{inputs:04X}"),
                }
            }
            SlaveData::Undecoded(_) => {
                let reason = match reading.kind {
                    KindEvidence::Unknown => "kind of slave unknown",
                    _ => "there should be no slave",
                };
                write!(f, " {}: {reason}", self.raw_fields())
            }
        }
    }

    fn sdo_response(&self, f: &mut Formatter<'_>, response: &SdoResponse) -> fmt::Result {
        match *response {
            SdoResponse::Empty => f.write_str("no transfer yet"),
            SdoResponse::Done { id, slave, object, value } => {
                write!(f, "{id} slave {slave} {object} = {value} (0x{value:08X})")
            }
            SdoResponse::Aborted { id, slave, object, code } => {
                write!(f, "{id} slave {slave} {object} aborted: {code}")
            }
            SdoResponse::Other(raw) => {
                write!(f, "{} {}: no answer to an SDO command", CommandId::from_code(raw.id), self.raw_fields())
            }
        }
    }

    /// The text after the id of a command that does not belong into this slot.
    fn foreign_id(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let reason = match (CommandId::from_code(self.raw.id), self.role) {
            (CommandId::Unknown(_), _) => "no such command",
            (_, SlotRole::Master) => "not a command for the ECM",
            (_, SlotRole::Slave(_)) => "not a command for a slave",
            (_, SlotRole::Sdo) => "not a command for the SDO slot",
        };
        write!(f, " {}: {reason}", self.raw_fields())
    }
}

fn master_response(f: &mut Formatter<'_>, response: &MasterResponse) -> fmt::Result {
    let id = CommandId::from_code(response.id);
    match response.id {
        MASTER_CYCLIC => f.write_str("CYCLIC")?,
        _ => id.fmt(f)?,
    }
    write!(f, " state {}", response.state)?;
    match (id, response.result) {
        (CommandId::SetAxis, found) => write!(f, ", {found} slaves found")?,
        (CommandId::LocalRead, inputs) => write!(f, ", inputs 0b{inputs:06b}")?,
        (_, 0) => {}
        (_, result) => write!(f, ", result {result}")?,
    }
    write!(f, ", CRC errors {}", response.error)?;
    let in_op = response.state.state() == Some(MasterState::Op);
    if in_op || response.fifo_free != 0 || response.full_count != 0 {
        write!(f, ", FIFO free {}, full count {}", response.fifo_free, response.full_count)?;
    }
    Ok(())
}

/// The arguments of SET_AXIS, such as ` group 0: 1 DRIVE, 2 IO, 3..8 none`. Three or more neighbours of the same kind are
/// written as a range.
fn set_axis(f: &mut Formatter<'_>, group: u8, kinds: &[SlaveKind; 8], size: SlotSize) -> fmt::Result {
    write!(f, " group {group}:")?;
    let first = usize::from(group) * 8 + 1;
    let slaves_of_group = size.max_slaves().saturating_sub(first - 1).min(8);
    let mut comma = "";
    let mut k = 0;
    while k < slaves_of_group {
        let equal = kinds[k..slaves_of_group].iter().take_while(|kind| **kind == kinds[k]).count();
        let run = if equal >= 3 { equal } else { 1 };
        write!(f, "{comma} {} {}", SlaveRange(first + k, first + k + run - 1), kind_name(kinds[k]))?;
        comma = ",";
        k += run;
    }
    if slaves_of_group < 8 {
        write!(f, "{comma} {} ignored", SlaveRange(first + slaves_of_group, first + 7))?;
    }
    Ok(())
}

fn motion(f: &mut Formatter<'_>, what: &str, motion: &Motion) -> fmt::Result {
    let axis = |f: &mut Formatter<'_>, axis: &AxisTarget| {
        write!(f, " {what} {}", axis.target)?;
        match axis.outputs {
            0 => Ok(()),
            outputs => write!(f, ", outputs 0x{outputs:04X}"),
        }
    };
    axis(f, &motion.first)?;
    if motion.second == AxisTarget::default() {
        return Ok(());
    }
    f.write_str("; axis 2")?;
    axis(f, &motion.second)
}

fn status_and_position(f: &mut Formatter<'_>, statusword: Statusword, position: i32) -> fmt::Result {
    write!(f, " statusword 0x{:04X} ", statusword.0)?;
    match statusword.state() {
        Some(state) => state.fmt(f)?,
        None => f.write_str("(no CiA 402 state)")?,
    }
    write!(f, ", position {position}")
}

fn kind_name(kind: SlaveKind) -> &'static str {
    match kind {
        SlaveKind::None => "none",
        named => named.name(),
    }
}

const fn on_off(on: bool) -> &'static str {
    if on { "on" } else { "off" }
}

/// A slave's number or a range of them: `5` or `6..8`.
struct SlaveRange(usize, usize);

impl Display for SlaveRange {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self(first, last) if first == last => write!(f, "{first}"),
            Self(first, last) => write!(f, "{first}..{last}"),
        }
    }
}

/// A torque, given in 0.1 % of the rated torque.
struct Percent(i16);

impl Display for Percent {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let (sign, tenths) = (if self.0 < 0 { "-" } else { "" }, self.0.unsigned_abs());
        write!(f, "{sign}{}.{} %", tenths / 10, tenths % 10)
    }
}

/// The fields of a slot as hexadecimal numbers, without the id and the CRC.
struct RawFields {
    slot: RawSlot,
    size: SlotSize,
    role: SlotRole,
}

impl Display for RawFields {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let RawSlot { index, parm, data1, data2, data3, .. } = self.slot;
        match self.role {
            SlotRole::Master => write!(f, "byte 1 0x{index:02X} byte 2 0x{parm:02X}")?,
            _ => write!(f, "index 0x{index:02X} parm 0x{parm:04X}")?,
        }
        write!(f, " data1 0x{data1:08X} data2 0x{data2:08X}")?;
        match self.size {
            SlotSize::Bytes12 => Ok(()),
            SlotSize::Bytes16 => write!(f, " data3 0x{data3:08X}"),
        }
    }
}
