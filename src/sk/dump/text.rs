//! The text of a dump: how a line and the meaning of its slot are printed.

use core::fmt::{self, Display, Formatter};

use super::{
    ByteOne, CommandDump, KindEvidence, ResponseDump, SlaveData, SlaveReading, SlotLine, SlotMeaning, SlotRole,
};
use crate::ethercat::cia402::{Mode, Statusword};
use crate::sk::argument::TorquePercent;
use crate::sk::{
    CommandId, HspAxis, MASTER_CYCLIC, MasterCommand, MasterResponse, MasterState, RawSlot, SdoCommand, SdoResponse,
    SlaveCommand, SlotCommand, SlotSize,
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
    /// The fields of the slot that the text of the line shows; `None` if the text consists of the raw fields.
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
        match command {
            MasterCommand::Other(_) => self.foreign_id(f),
            _ => command.write_arguments(f, self.size),
        }
    }

    fn slave_command(&self, f: &mut Formatter<'_>, slot: &SlotCommand) -> fmt::Result {
        slot.command.id().fmt(f)?;
        if slot.index != 0 {
            write!(f, " #{}", slot.index)?;
        }
        match slot.command {
            SlaveCommand::Other(_) => self.foreign_id(f),
            _ => slot.command.write_arguments(f),
        }
    }

    fn sdo_command(&self, f: &mut Formatter<'_>, command: &SdoCommand) -> fmt::Result {
        command.id().fmt(f)?;
        match command {
            SdoCommand::Other(_) => return self.foreign_id(f),
            _ => command.write_arguments(f)?,
        }
        match (command, self.raw.parm >> 8) {
            (SdoCommand::Read { .. }, high @ 1..) => {
                write!(f, " (0x{high:02X} above the slave's number is not looked at)")
            }
            _ => Ok(()),
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
            KindEvidence::Given(kind) | KindEvidence::Implied(kind) => write!(f, " {}", kind.dump_name())?,
            KindEvidence::Guessed(kind) => write!(f, " {}?", kind.dump_name())?,
            KindEvidence::Unknown => {}
        }
        match &reading.data {
            SlaveData::Nothing => Ok(()),
            SlaveData::Drive(drive) => {
                status_and_position(f, drive.statusword, drive.position)?;
                write!(f, ", torque {}, error code 0x{:04X}", TorquePercent(drive.torque), drive.error_code)
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

    /// Writes why the command is not decoded: its id does not belong in this slot, or no guide lists the id.
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

fn status_and_position(f: &mut Formatter<'_>, statusword: Statusword, position: i32) -> fmt::Result {
    write!(f, " statusword 0x{:04X} ", statusword.0)?;
    match statusword.state() {
        Some(state) => state.fmt(f)?,
        None => f.write_str("(no CiA 402 state)")?,
    }
    write!(f, ", position {position}")
}

/// The raw fields of a slot in hexadecimal, without the id and the CRC.
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
