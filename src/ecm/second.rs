//! The second channel of an HSP: reports tell its position, its statusword is an object (0x6841). Calls that switch axes
//! read it; streams ask for it again and again, in the SDO slot of their frames. \[OURS]

use std::time::Duration;

use super::config::Slave;
use super::core::Task;
use super::session::Session;
use super::snapshot::Plan;
use super::targets::bits;
use super::{Ecm, EcmError};
use crate::cia402::{STATUSWORD, Statusword};
use crate::coe::{AbortCode, ObjectAddress};
use crate::sk::{CommandId, Frame, RawSlot, SdoCommand, SdoResponse, SlotSize};

/// Its objects are those of the first channel and that much. SK-3
const CHANNEL: u16 = 0x800;
pub(super) const SECOND_STATUSWORD: ObjectAddress = ObjectAddress::new(STATUSWORD + CHANNEL, 0);
/// Every slave has it: read in between, so that an answer can be told from the one before (SK-6.10).
const BETWEEN: ObjectAddress = ObjectAddress::new(0x1000, 0);
/// \[OURS] A stream that asks gives an answer up after that many frames: more than the board's own limit.
const GIVE_UP: u64 = 4000;
/// \[OURS] What another transfer waits for such an answer.
const WAIT: Duration = Duration::from_secs(2);

/// What is known of second channels.
pub(super) struct Second {
    /// Slaves that have one, and those that have none, a bit each.
    has: u64,
    has_none: u64,
    words: [Statusword; SlotSize::Bytes12.slots()],
    shown: RawSlot,
    /// The transfer that a stream has asked for, and the frames written then.
    asked: Option<(u8, ObjectAddress, u64)>,
}

impl Second {
    pub(super) const fn new() -> Self {
        let words = [Statusword(0); SlotSize::Bytes12.slots()];
        Self { has: 0, has_none: 0, words, shown: RawSlot::ZERO, asked: None }
    }

    /// What the SDO slot of a report shows: always the newest transfer.
    pub(super) fn read(&mut self, size: SlotSize, report: &Frame) {
        if size != SlotSize::Bytes16 {
            return;
        }
        let slot = report.slot(size, size.sdo_slot());
        if slot == self.shown {
            return;
        }
        self.shown = slot;
        let (slave, object) = match SdoResponse::decode(&slot) {
            SdoResponse::Done { id: CommandId::SdoRead, slave, object, value } => {
                if object == SECOND_STATUSWORD {
                    self.learn(slave, Some(Statusword(value as u16)));
                }
                (slave, object)
            }
            SdoResponse::Aborted { id: CommandId::SdoRead, slave, object, code } => {
                if object == SECOND_STATUSWORD && code == AbortCode::NO_OBJECT {
                    self.learn(slave, None);
                }
                (slave, object)
            }
            _ => return,
        };
        if self.asked.is_some_and(|(asked, of, _)| (asked, of) == (slave, object)) {
            self.asked = None;
        }
    }

    fn learn(&mut self, slave: u8, word: Option<Statusword>) {
        let Some(place) = self.words.get_mut(usize::from(slave)) else { return };
        let bit = 1 << slave;
        match word {
            Some(word) => (self.has, self.has_none, *place) = (self.has | bit, self.has_none & !bit, word),
            None => (self.has, self.has_none) = (self.has & !bit, self.has_none | bit),
        }
    }

    /// Slaves whose second channel is known to be off, a bit each.
    pub(super) fn off(&self) -> u64 {
        bits(self.has).filter(|slave| !self.words[*slave].is_enabled()).fold(0, |off, slave| off | 1 << slave)
    }

    /// The statusword of a second channel, if there is one.
    pub(super) fn word(&self, slave: u8) -> Option<Statusword> {
        (self.has & 1 << slave != 0).then(|| self.words[usize::from(slave)])
    }

    const fn is_unknown(&self, slave: u8) -> bool {
        (self.has | self.has_none) & 1 << slave == 0
    }

    /// The request that a stream puts into its next frame, if there is one to ask for.
    pub(super) fn request(&mut self, plan: &Plan, frames: u64) -> Option<SdoCommand> {
        if self.has == 0 {
            return None;
        }
        if let Some((_, _, at)) = self.asked
            && frames < at + GIVE_UP
        {
            return None;
        }
        let last = match SdoResponse::decode(&self.shown) {
            SdoResponse::Done { slave, object, .. } => Some((slave, object)),
            _ => None,
        };
        let had = last.filter(|(_, object)| *object == SECOND_STATUSWORD).map_or(0, |(slave, _)| slave);
        let axes = || plan.slaves().map(|(slave, _)| slave).filter(|slave| self.has & 1 << slave != 0);
        let slave = axes().find(|slave| *slave > had).or_else(|| axes().next())?;
        let object = if last == Some((slave, SECOND_STATUSWORD)) { BETWEEN } else { SECOND_STATUSWORD };
        self.asked = Some((slave, object, frames));
        Some(SdoCommand::Read { slave, object })
    }

    /// That request did not go out.
    pub(super) const fn not_asked(&mut self) {
        self.asked = None;
    }
}

impl Ecm {
    /// The statusword of a slave's second channel, read now; `None` for a slave without one.
    pub(super) fn second_word(&self, slave: u8) -> Result<Option<Statusword>, EcmError> {
        if !self.may_have_second(slave)? {
            return Ok(None);
        }
        let command = SdoCommand::Read { slave, object: SECOND_STATUSWORD };
        match self.transfer(command, self.core.options.sdo_limit) {
            Ok(word) => Ok(Some(Statusword(word as u16))),
            Err(EcmError::SdoAborted { code: AbortCode::NO_OBJECT, .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn may_have_second(&self, slave: u8) -> Result<bool, EcmError> {
        let session = self.core.lock()?;
        let is_hsp = matches!(session.plan.slave(slave), Some(Slave::Hsp(_)));
        Ok(is_hsp && session.size == SlotSize::Bytes16 && session.second.has_none & 1 << slave == 0)
    }

    /// Finds out which slaves have a second channel, and what it does, before a stream begins.
    pub(super) fn learn_seconds(&self) -> Result<(), EcmError> {
        let unknown: u64 = {
            let session = self.core.lock()?;
            let hsp = session.plan.slaves().filter(|(_, config)| matches!(config, Slave::Hsp(_)));
            let wide = session.size == SlotSize::Bytes16 && session.in_op();
            hsp.filter(|(slave, _)| wide && session.second.is_unknown(*slave))
                .fold(0, |all, (slave, _)| all | 1 << slave)
        };
        bits(unknown).try_for_each(|slave| self.second_word(slave as u8).map(drop))
    }

    /// Waits until a transfer that a stream has asked for is over: the board would reject another one meanwhile.
    pub(super) fn wait_for_second(&self) -> Result<(), EcmError> {
        if self.core.lock()?.second.asked.is_none() {
            return Ok(());
        }
        let task = Task { what: "an SDO", hint: "try again", limit: WAIT, commands: &[], resend: false, own: false };
        let is_over = |session: &mut Session, _| Ok(session.second.asked.is_none().then_some(()));
        match self.core.run(&task, is_over, |_| "the SDO slot is busy".to_owned()) {
            Ok(()) | Err(EcmError::Timeout { .. }) => Ok(()),
            Err(error) => Err(error),
        }
    }
}
