//! Typed SDO access, one transfer at a time.
//!
//! The SDO slot keeps its answer, so a request that equals the last one would find that answer and take it for its own.
//! Before such a request another object is read (SK-6.10).

use std::time::Duration;

use super::core::{LONGEST, Task};
use super::session::Session;
use super::{Ecm, EcmError};
use crate::coe::{ObjectAddress, SdoSize};
use crate::sk::{CommandId, MasterState, SdoCommand, SdoResponse};

/// Device type: every slave has it (SK-6.10). \[OURS] What is read instead if that itself is asked for again, or its answer
/// is still to come: vendor id, product code, revision.
const DETOURS: [ObjectAddress; 4] = [
    ObjectAddress::new(0x1000, 0),
    ObjectAddress::new(0x1018, 1),
    ObjectAddress::new(0x1018, 2),
    ObjectAddress::new(0x1018, 3),
];

/// A type that an SDO can move.
pub trait SdoValue: Copy + Send {
    /// Its size on the wire.
    const SIZE: SdoSize;

    /// As Data2.
    fn to_raw(self) -> u32;

    /// From Data2, which is zero-extended; `None` if it holds more than this type.
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
    /// [`EcmError::SdoAborted`], [`EcmError::SdoTooWide`], [`EcmError::Timeout`], [`EcmError::WrongState`],
    /// [`EcmError::NoSuchSlave`], [`EcmError::Link`].
    pub fn sdo_read<T: SdoValue>(&self, slave: u8, object: ObjectAddress) -> Result<T, EcmError> {
        let raw = self.transfer(SdoCommand::Read { slave, object }, self.core.options.sdo_limit)?;
        let bits = u32::from(T::SIZE.bytes()) * 8;
        T::from_raw(raw).ok_or(EcmError::SdoTooWide { slave, object, value: raw, bits })
    }

    /// Writes an object of a slave, with the size of the type. If the board does not answer it is written again.
    ///
    /// # Errors
    /// As [`Ecm::sdo_read`].
    pub fn sdo_write<T: SdoValue>(&self, slave: u8, object: ObjectAddress, value: T) -> Result<(), EcmError> {
        let command = SdoCommand::Write { slave, object, size: T::SIZE, value: value.to_raw() };
        self.transfer(command, self.core.options.sdo_limit).map(|_| ())
    }

    pub(super) fn transfer(&self, command: SdoCommand, limit: Duration) -> Result<u32, EcmError> {
        let began = self.core.now();
        let limit = limit.min(LONGEST);
        let turn = self.core.sdo_turn.try_lock_for(limit).ok_or(EcmError::Busy { what: "the SDO slot" })?;
        self.wait_for_second()?;
        let wanted = Wanted::of(&command);
        let (size, detour) = {
            let mut session = self.core.lock()?;
            self.core.catch_up(&mut session)?;
            if !matches!(session.board.state.state(), Some(MasterState::PreOp | MasterState::SafeOp | MasterState::Op))
            {
                let found = session.board.state;
                return Err(EcmError::WrongState { what: "an SDO", needs: "PreOP, SafeOP or OP", found });
            }
            let late = &session.late;
            let clash = |object: &&ObjectAddress| **object == wanted.object || late.contains(object);
            let detour = DETOURS.iter().find(|object| !clash(object)).unwrap_or(&DETOURS[0]);
            let needed = wanted.is_shown(&session) || !late.is_empty();
            (session.size, needed.then_some(*detour))
        };
        if wanted.slave == 0 || usize::from(wanted.slave) > size.max_slaves() {
            return Err(EcmError::NoSuchSlave { slave: wanted.slave, declared: size.max_slaves() });
        }
        if let Some(object) = detour {
            // An abort clears the way too.
            match self.exchange(SdoCommand::Read { slave: wanted.slave, object }, limit) {
                Ok(_) | Err(EcmError::SdoAborted { .. }) => {}
                Err(error) => return Err(error),
            }
            // The board makes one transfer after the other: what was late is over.
            self.core.lock()?.late.clear();
        }
        let left = limit.saturating_sub(self.core.now().saturating_sub(began));
        let done = self.exchange(command, left);
        drop(turn);
        done
    }

    fn exchange(&self, command: SdoCommand, limit: Duration) -> Result<u32, EcmError> {
        let wanted = Wanted::of(&command);
        let slot = self.core.lock()?.size.sdo_slot();
        let task = Task {
            what: if wanted.id == CommandId::SdoRead { "an SDO read" } else { "an SDO write" },
            hint: "see whether the slave is on the network, and give it more time with Options::sdo_limit",
            limit,
            commands: &[(slot, command.encode())],
            resend: true,
            own: false,
        };
        let seen = move |_: &Session| format!("slave {} has not answered for {}", wanted.slave, wanted.object);
        let done = self.core.run(&task, |session, _| wanted.answer(session), seen);
        if let Err(EcmError::Timeout { .. }) = done {
            // Its answer may come yet, and must not be taken for that of a later one.
            let mut session = self.core.lock()?;
            if !session.late.contains(&wanted.object) {
                session.late.push(wanted.object);
            }
        }
        done
    }
}

/// What an answer has to show.
#[derive(Clone, Copy)]
struct Wanted {
    id: CommandId,
    slave: u8,
    object: ObjectAddress,
    /// Of a write, which the answer repeats.
    value: Option<u32>,
}

impl Wanted {
    fn of(command: &SdoCommand) -> Self {
        let (slave, object, value) = match *command {
            SdoCommand::Read { slave, object } => (slave, object, None),
            SdoCommand::Write { slave, object, value, .. } => (slave, object, Some(value)),
            SdoCommand::GetStatus | SdoCommand::Other(_) => (0, DETOURS[0], None),
        };
        Self { id: command.id(), slave, object, value }
    }

    fn is_shown(self, session: &Session) -> bool {
        !matches!(Self { value: None, ..self }.answer(session), Ok(None))
    }

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
