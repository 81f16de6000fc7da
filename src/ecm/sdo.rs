//! Typed SDO transfers, one at a time.
//!
//! The SDO slot of the reports repeats an answer until the next answer. A call that sends the same request again would
//! take the old answer for its own. So it reads another object first (SK-6.10).

use std::time::Duration;

use super::exchange::{LIMIT_MAX, Session, Task, Waited};
use super::{Ecm, EcmError};
use crate::ethercat::coe::{ObjectAddress, SdoSize};
use crate::sk::{CommandId, MasterState, SdoCommand, SdoResponse};

/// Objects to read before a request that equals the last one (SK-6.10): normally the device type, which every slave
/// has. \[OURS] Vendor id, product code or revision is read instead in two cases: the request is for the device type
/// itself, or a late answer with the device type may still come.
const IN_BETWEEN: [ObjectAddress; 4] = [
    ObjectAddress::new(0x1000, 0),
    ObjectAddress::new(0x1018, 1),
    ObjectAddress::new(0x1018, 2),
    ObjectAddress::new(0x1018, 3),
];

/// A type that an SDO transfer can read and write.
pub trait SdoValue: Copy + Send {
    /// The size of the value in an SDO command.
    const SIZE: SdoSize;

    /// The value in the form of Data2 of the SDO slot.
    fn to_raw(self) -> u32;

    /// Converts Data2 of an answer, in which the board has filled the bytes beyond the object's size with 0. `None` if
    /// the value does not fit the type.
    fn from_raw(raw: u32) -> Option<Self>;
}

macro_rules! sdo_values {
    ($($int:ty as $unsigned:ty = $size:ident;)*) => {$(
        impl SdoValue for $int {
            const SIZE: SdoSize = SdoSize::$size;

            fn to_raw(self) -> u32 {
                u32::from(self as $unsigned)
            }

            fn from_raw(raw: u32) -> Option<Self> {
                <$unsigned>::try_from(raw).ok().map(|value| value as Self)
            }
        }
    )*};
}

sdo_values! {
    u8 as u8 = One;
    i8 as u8 = One;
    u16 as u16 = Two;
    i16 as u16 = Two;
    u32 as u32 = Four;
    i32 as u32 = Four;
}

impl Ecm {
    /// Reads an object of a slave, in PreOP, SafeOP or OP.
    ///
    /// ```
    /// use ecmsk::coe::ObjectAddress;
    /// use ecmsk::ecm::{Ecm, EcmError};
    ///
    /// let ecm = Ecm::open("sim:?slaves=drive&clock=virtual")?;
    /// ecm.sdo_write(1, ObjectAddress::new(0x6098, 0), 33_i8)?;
    /// assert_eq!(ecm.sdo_read::<i8>(1, ObjectAddress::new(0x6098, 0))?, 33);
    /// let error = ecm.sdo_read::<u32>(1, ObjectAddress::new(0x5555, 0)).unwrap_err();
    /// assert!(matches!(error, EcmError::SdoAborted { slave: 1, .. }));
    /// # Ok::<(), EcmError>(())
    /// ```
    ///
    /// # Errors
    /// [`EcmError::SdoAborted`] with the abort code if the slave refuses, [`EcmError::SdoTooWide`] if the value does not fit
    /// `T`, [`EcmError::Timeout`] if no answer comes in time, [`EcmError::WrongState`] below PreOP, [`EcmError::NoSuchSlave`]
    /// for slave 0 and for one above 40 (30 with 16-byte slots), [`EcmError::Link`] if the link fails.
    pub fn sdo_read<T: SdoValue>(&self, slave: u8, object: ObjectAddress) -> Result<T, EcmError> {
        let raw = self.transfer(SdoCommand::Read { slave, object }, self.exchange.options.sdo_limit)?;
        let bits = u32::from(T::SIZE.bytes()) * 8;
        T::from_raw(raw).ok_or(EcmError::SdoTooWide { slave, object, value: raw, bits })
    }

    /// Writes an object of a slave, in PreOP, SafeOP or OP, with the size of the type `T`. A request without an answer
    /// is sent again.
    ///
    /// # Errors
    /// As [`Ecm::sdo_read`].
    pub fn sdo_write<T: SdoValue>(&self, slave: u8, object: ObjectAddress, value: T) -> Result<(), EcmError> {
        let command = SdoCommand::Write { slave, object, size: T::SIZE, value: value.to_raw() };
        self.transfer(command, self.exchange.options.sdo_limit).map(|_| ())
    }

    /// Carries out a transfer. Returns the value that was read or written.
    pub(super) fn transfer(&self, command: SdoCommand, limit: Duration) -> Result<u32, EcmError> {
        let mut waited = Waited::since(self.exchange.now());
        let limit = limit.min(LIMIT_MAX);
        let turn = self.exchange.sdo_turn.try_lock_for(limit).ok_or(EcmError::Busy { what: "the SDO slot" })?;
        self.wait_for_sdo_of_stream()?;
        let wanted = Wanted::of(&command);
        let (size, cycle, in_between) = {
            let session = self.exchange.lock_newest()?;
            let cycle = session.network.cycle();
            // The wait for the locks so far counts only in part ([`Waited`]), since this thread may have got no processor
            // meanwhile.
            waited.until(self.exchange.now(), cycle);
            let found = session.board().state;
            if found.state().is_none_or(|state| state < MasterState::PreOp) {
                return Err(EcmError::WrongState { what: "an SDO", needs: "PreOP, SafeOP or OP", found });
            }
            let late = &session.late_sdos;
            let is_ambiguous = |object: &&ObjectAddress| **object == wanted.object || late.contains(object);
            let in_between = IN_BETWEEN.iter().find(|object| !is_ambiguous(object)).unwrap_or(&IN_BETWEEN[0]);
            let is_needed = wanted.is_shown(&session) || !late.is_empty();
            (session.size, cycle, is_needed.then_some(*in_between))
        };
        if wanted.slave == 0 || usize::from(wanted.slave) > size.max_slaves() {
            return Err(EcmError::NoSuchSlave { slave: wanted.slave, declared: size.max_slaves() });
        }
        if let Some(object) = in_between {
            // An abort is an answer too: the slot then shows it, and no longer the old answer to an equal request.
            match self.transfer_once(SdoCommand::Read { slave: wanted.slave, object }, limit) {
                Ok(_) | Err(EcmError::SdoAborted { .. }) => {}
                Err(error) => return Err(error),
            }
            // The board carries out transfers in order: after this answer no late answer to an earlier request can come.
            self.exchange.lock()?.late_sdos.clear();
        }
        let left = limit.saturating_sub(waited.until(self.exchange.now(), cycle));
        let done = self.transfer_once(command, left);
        drop(turn);
        done
    }

    fn transfer_once(&self, command: SdoCommand, limit: Duration) -> Result<u32, EcmError> {
        let wanted = Wanted::of(&command);
        let slot = self.exchange.lock()?.size.sdo_slot();
        let what = if wanted.id == CommandId::SdoRead { "an SDO read" } else { "an SDO write" };
        let hint = "see whether the slave is on the network, and give it more time with Options::sdo_limit";
        let seen = move |_: &Session| format!("slave {} has not answered for {}", wanted.slave, wanted.object);
        let commands = [(slot, command.encode())];
        let task = Task::new(what, hint, limit, &commands).seen(&seen);
        let done = self.exchange.run(&task, |session, _| wanted.answer(session));
        if let Err(EcmError::Timeout { .. }) = done {
            // The answer may still come late. It is noted, so that a later transfer of the same object does not take it
            // for its own.
            let mut session = self.exchange.lock()?;
            if !session.late_sdos.contains(&wanted.object) {
                session.late_sdos.push(wanted.object);
            }
        }
        done
    }
}

/// The fields of the SDO slot by which the answer to a request is recognised.
#[derive(Clone, Copy)]
struct Wanted {
    id: CommandId,
    slave: u8,
    object: ObjectAddress,
    /// The written value, which the answer repeats; `None` for a read request.
    value: Option<u32>,
}

impl Wanted {
    fn of(command: &SdoCommand) -> Self {
        let (slave, object, value) = match *command {
            SdoCommand::Read { slave, object } => (slave, object, None),
            SdoCommand::Write { slave, object, value, .. } => (slave, object, Some(value)),
            SdoCommand::GetStatus | SdoCommand::Other(_) => (0, IN_BETWEEN[0], None),
        };
        Self { id: command.id(), slave, object, value }
    }

    /// Whether the newest report already has an answer that would match the request.
    fn is_shown(self, session: &Session) -> bool {
        !matches!(Self { value: None, ..self }.answer(session), Ok(None))
    }

    /// The value or the abort in the answer; `None` if the newest report shows no matching answer.
    fn answer(self, session: &Session) -> Result<Option<u32>, EcmError> {
        let wanted = (self.id, self.slave, self.object);
        match SdoResponse::decode(&session.slot(session.size.sdo_slot())) {
            SdoResponse::Done { id, slave, object, value } if (id, slave, object) == wanted => {
                Ok(self.value.is_none_or(|written| written == value).then_some(value))
            }
            SdoResponse::Aborted { id, slave, object, code } if (id, slave, object) == wanted => {
                let verb = if id == CommandId::SdoRead { "reading" } else { "writing" };
                Err(EcmError::SdoAborted { verb, slave, object, code })
            }
            _ => Ok(None),
        }
    }
}
