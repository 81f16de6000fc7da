//! Digital inputs and outputs: those of IO slaves, and those on the board itself.

use super::config::Slave;
use super::exchange::Task;
use super::{Ecm, EcmError};
use crate::sk::{IoResponse, MasterCommand, SlaveCommand, SlotCommand};

const HINT: &str = "see whether the slave is on the network and frames get lost (Ecm::stats)";

impl Ecm {
    /// Reads the 16 inputs of an IO slave, in OP. Bit k is input k.
    ///
    /// # Errors
    /// [`EcmError::WrongState`] outside OP, [`EcmError::NoSuchSlave`] and [`EcmError::WrongKind`] for a slave that is not
    /// configured as an IO slave, [`EcmError::SlaveLost`], [`EcmError::Timeout`] if the board does not answer in time,
    /// [`EcmError::Link`] if the link fails.
    pub fn inputs(&self, slave: u8) -> Result<u16, EcmError> {
        self.io("reading inputs", slave, SlaveCommand::IoRead)
    }

    /// Sets the 16 outputs of an IO slave, in OP. Bit k is output k. The outputs keep their values until the next call.
    ///
    /// # Errors
    /// As [`Ecm::inputs`].
    pub fn set_outputs(&self, slave: u8, bits: u16) -> Result<(), EcmError> {
        self.io("setting outputs", slave, SlaveCommand::IoWrite(bits)).map(|_| ())
    }

    fn io(&self, what: &'static str, slave: u8, command: SlaveCommand) -> Result<u16, EcmError> {
        let slot = {
            let session = self.exchange.lock_in_op(what)?;
            let config = session.network.declared(slave)?;
            if *config != Slave::Io {
                return Err(EcmError::wrong_kind(slave, config.kind(), what, "an IO slave"));
            }
            SlotCommand::from(command).encode(session.size)
        };
        let (limit, commands) = (self.exchange.options.servo_limit, [(slave.into(), slot)]);
        self.exchange.run(&Task::new(what, HINT, limit, &commands).exclusive(), |session, sent| {
            session.require_op(what)?;
            if session.lost.contains(slave) {
                return Err(EcmError::SlaveLost { slave: Some(slave), found: session.board().state });
            }
            Ok(session.answer(sent, slave.into(), slot.id).map(|answer| IoResponse::decode(&answer).bits))
        })
    }

    /// Reads the six inputs of the board itself, in any state. Bit k is input k.
    ///
    /// # Errors
    /// [`EcmError::Timeout`] if the board does not answer in time, [`EcmError::Link`] if the link fails.
    pub fn local_inputs(&self) -> Result<u8, EcmError> {
        self.local("reading the board's inputs", MasterCommand::LocalRead).map(|result| result as u8)
    }

    /// Sets the six outputs of the board itself, in any state. Bit k is output k.
    ///
    /// # Errors
    /// [`EcmError::Setting`] if bit 6 or 7 is set, [`EcmError::Timeout`] if the board does not answer in time,
    /// [`EcmError::Link`] if the link fails.
    pub fn set_local_outputs(&self, bits: u8) -> Result<(), EcmError> {
        if bits > 0x3F {
            let found = format!("0x{bits:02X}");
            return Err(EcmError::Setting { what: "the board's outputs", found, allowed: "six bits, 0x00 to 0x3F" });
        }
        self.local("setting the board's outputs", MasterCommand::LocalWrite(bits)).map(|_| ())
    }

    fn local(&self, what: &'static str, command: MasterCommand) -> Result<u32, EcmError> {
        let slot = command.encode();
        let (limit, commands) = (self.exchange.options.servo_limit, [(0, slot)]);
        self.exchange.run(&Task::new(what, HINT, limit, &commands).exclusive(), |session, sent| {
            if !session.in_op() {
                return Ok((session.board().id == slot.id).then_some(session.board().result));
            }
            // In OP the answer in slot 0 does not name its command. It belongs to this command if it is in the report
            // of the cycle that executed the frame (SK-8.3).
            Ok(session.result(sent))
        })
    }
}
