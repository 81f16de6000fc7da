//! Second channels of HSPs. Reports have the position of a second channel, but not its statusword, which must be read
//! by SDO (object 0x6841). Calls that switch axes read it, and streams poll it in the SDO slot of their frames. \[OURS]

use std::time::Duration;

use super::session::Session;
use super::task::Task;
use crate::ecm::config::Slave;
use crate::ecm::network::Network;
use crate::ecm::{Ecm, EcmError};
use crate::ethercat::cia402::{SECOND_AXIS_OFFSET, STATUSWORD, Statusword};
use crate::ethercat::coe::{AbortCode, ObjectAddress};
use crate::ethercat::{MAX_SLAVES, SlaveSet};
use crate::sk::{CommandId, Frame, RawSlot, SdoCommand, SdoResponse, SlotSize};

const SECOND_STATUSWORD: ObjectAddress = ObjectAddress::new(STATUSWORD + SECOND_AXIS_OFFSET, 0);
/// An object that every slave has. Two equal requests in a row may get equal answers, which cannot be told apart. So
/// the stream reads this object between the two (SK-6.10).
const DEVICE_TYPE: ObjectAddress = ObjectAddress::new(0x1000, 0);
/// \[OURS] A stream sends its SDO request again after this many frames without an answer. It writes one frame per cycle:
/// with the shortest cycle, 250 us, this is 1 s.
const ANSWER_FRAMES_MAX: u64 = 4000;
/// \[OURS] How long a call waits for the end of a stream's SDO transfer before it sends its own request.
const STREAM_SDO_LIMIT: Duration = Duration::from_secs(2);

/// What is known about the second channels of HSPs.
pub struct SecondChannels {
    /// Slaves that have a second channel.
    present: SlaveSet,
    /// Slaves that have no second channel.
    absent: SlaveSet,
    /// The newest statuswords of second channels, by slot.
    statuswords: [Statusword; SlotSize::Bytes12.slots()],
    /// The SDO slot of the newest report. If the SDO slot of the next report differs, it has a new answer.
    shown: RawSlot,
    /// The request of a stream that has no answer yet.
    asked: Option<Asked>,
}

#[derive(Clone, Copy)]
struct Asked {
    slave: u8,
    object: ObjectAddress,
    /// The number of frames that were written before the request.
    at_frame: u64,
}

impl SecondChannels {
    pub const fn new() -> Self {
        Self {
            present: SlaveSet::EMPTY,
            absent: SlaveSet::EMPTY,
            statuswords: [Statusword(0); SlotSize::Bytes12.slots()],
            shown: RawSlot::ZERO,
            asked: None,
        }
    }

    /// Reads the SDO slot of a report, which shows the newest transfer of any call or program.
    pub fn read(&mut self, size: SlotSize, report: &Frame) {
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
        if self.asked.is_some_and(|asked| (asked.slave, asked.object) == (slave, object)) {
            self.asked = None;
        }
    }

    /// Notes the statusword of a slave's second channel, or that it has none.
    fn learn(&mut self, slave: u8, statusword: Option<Statusword>) {
        // A slave number from a report may be out of range.
        if !(1..=MAX_SLAVES).contains(&usize::from(slave)) {
            return;
        }
        match statusword {
            Some(statusword) => {
                self.present.insert(slave);
                self.absent.remove(slave);
                self.statuswords[usize::from(slave)] = statusword;
            }
            None => {
                self.present.remove(slave);
                self.absent.insert(slave);
            }
        }
    }

    /// Slaves whose second channel is known to be switched off.
    pub fn off(&self) -> SlaveSet {
        self.present.iter().filter(|slave| !self.statuswords[usize::from(*slave)].is_enabled()).collect()
    }

    /// The statusword of a slave's second channel; `None` if there is none or it is not known.
    pub fn statusword(&self, slave: u8) -> Option<Statusword> {
        self.present.contains(slave).then(|| self.statuswords[usize::from(slave)])
    }

    /// The SDO request for a stream's next frame, which reads the statuswords of all second channels in turn. `None` if
    /// there are no second channels, or while an earlier request has no answer. `frames`: the number of frames written so
    /// far.
    pub fn request(&mut self, network: &Network, frames: u64) -> Option<SdoCommand> {
        if self.present.is_empty() {
            return None;
        }
        if let Some(asked) = self.asked
            && frames < asked.at_frame + ANSWER_FRAMES_MAX
        {
            return None;
        }
        let last = match SdoResponse::decode(&self.shown) {
            SdoResponse::Done { slave, object, .. } => Some((slave, object)),
            _ => None,
        };
        let had = last.filter(|(_, object)| *object == SECOND_STATUSWORD).map_or(0, |(slave, _)| slave);
        let slaves = || network.slaves().map(|(slave, _)| slave).filter(|slave| self.present.contains(*slave));
        let slave = slaves().find(|slave| *slave > had).or_else(|| slaves().next())?;
        let object = if last == Some((slave, SECOND_STATUSWORD)) { DEVICE_TYPE } else { SECOND_STATUSWORD };
        self.asked = Some(Asked { slave, object, at_frame: frames });
        Some(SdoCommand::Read { slave, object })
    }

    /// Forgets the request, because its frame was not sent. The stream makes it again.
    pub const fn not_asked(&mut self) {
        self.asked = None;
    }
}

impl Ecm {
    /// Reads the statusword of a slave's second channel; `None` for a slave without one.
    pub(in crate::ecm) fn second_statusword(&self, slave: u8) -> Result<Option<Statusword>, EcmError> {
        if !self.may_have_second_channel(slave)? {
            return Ok(None);
        }
        let command = SdoCommand::Read { slave, object: SECOND_STATUSWORD };
        match self.transfer(command, self.exchange.options.sdo_limit) {
            Ok(word) => Ok(Some(Statusword(word as u16))),
            Err(EcmError::SdoAborted { code: AbortCode::NO_OBJECT, .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn may_have_second_channel(&self, slave: u8) -> Result<bool, EcmError> {
        let session = self.exchange.lock()?;
        let is_hsp = matches!(session.network.slave(slave), Some(Slave::Hsp(_)));
        Ok(is_hsp && session.size == SlotSize::Bytes16 && !session.second_channels.absent.contains(slave))
    }

    /// Before a stream begins: finds the slaves with a second channel, and reads its statusword.
    pub(in crate::ecm) fn learn_second_channels(&self) -> Result<(), EcmError> {
        let unknown = {
            let session = self.exchange.lock()?;
            let SecondChannels { present, absent, .. } = session.second_channels;
            if session.size == SlotSize::Bytes16 && session.in_op() {
                session.network.hsps.difference(present.union(absent))
            } else {
                SlaveSet::EMPTY
            }
        };
        unknown.iter().try_for_each(|slave| self.second_statusword(slave).map(drop))
    }

    /// Waits until the SDO transfer that a stream has requested has ended, since the board would reject a second one
    /// meanwhile.
    pub(in crate::ecm) fn wait_for_sdo_of_stream(&self) -> Result<(), EcmError> {
        if self.exchange.lock()?.second_channels.asked.is_none() {
            return Ok(());
        }
        let task = Task::new("an SDO", "try again", STREAM_SDO_LIMIT, &[]);
        let is_over = |session: &mut Session, _| Ok(session.second_channels.asked.is_none().then_some(()));
        match self.exchange.run(&task, is_over) {
            Ok(()) | Err(EcmError::Timeout { .. }) => Ok(()),
            Err(error) => Err(error),
        }
    }
}
