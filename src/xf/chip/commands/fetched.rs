//! Results read from EEPROMs, datagrams and mailboxes; lengths of process data that the host assigns.

use super::{CommandOutcome, CommandRefused, DONE, answered};
use crate::ethercat::AlState;
use crate::xf::chip::Chip;
use crate::xf::chip::network::{IMAGE_MAX, SlaveNetwork};
use crate::xf::request::{DirectAssign, Direction, MailboxPart, MailboxStatus, SlaveBits, SlaveNumber};
use crate::xf::response::{Answer, EepromAnswer, RawAnswer};

impl<N: SlaveNetwork> Chip<N> {
    /// EEPROM_GET: the result of the last EEPROM_REQ. `[OURS]` It is refused before an EEPROM was read or written.
    pub(super) fn eeprom_get(&self, data: &mut [u8]) -> CommandOutcome {
        let result = self.results.eeprom.as_ref();
        answered(result.map(|result| EepromAnswer { error: result.error, data: result.data() }), data)
    }

    /// RAW_ECAT_FUNC_GET: the datagram of RAW_ECAT_FUNC_REQ as it came back. `[OURS]` It is refused before a datagram was sent.
    pub(super) fn raw_get(&self, data: &mut [u8]) -> CommandOutcome {
        let answer = self.results.datagram.as_ref().map(|job| RawAnswer {
            operation: job.operation.code(),
            adp: job.adp,
            ado: job.ado,
            logical: job.logical,
            timeout_us: job.timeout_us,
            working_counter: job.working_counter,
            data: &job.data[..job.bytes],
        });
        answered(answer, data)
    }

    /// DIRECT_ASSIGN. The lengths apply from the next layout of process data on, if DIRECT_ASSIGN has switched them on by then.
    ///
    /// `[OURS]` A direction without an assigned length keeps the length of the mapping. A length that does not fit into
    /// the process image, and a slave that was not found, are refused. ECAT_INIT_OP resets the lengths.
    pub(super) fn direct_assign(&mut self, request: &DirectAssign) -> CommandOutcome {
        let (DirectAssign::Switch { slave, .. } | DirectAssign::Length { slave, .. }) = *request;
        if !self.found(slave.into()) {
            return Err(CommandRefused);
        }
        let lengths = &mut self.bus.lengths[usize::from(slave.get())];
        match *request {
            DirectAssign::Switch { on, .. } => lengths.is_assigned = on,
            DirectAssign::Length { bytes, .. } if usize::from(bytes) > IMAGE_MAX => return Err(CommandRefused),
            DirectAssign::Length { direction: Direction::Output, bytes, .. } => lengths.assigned[0] = Some(bytes),
            DirectAssign::Length { direction: Direction::Input, bytes, .. } => lengths.assigned[1] = Some(bytes),
        }
        DONE
    }

    /// The answer of RECV_MAILBOX with a part of a message. `[OURS]` Bytes beyond the message are refused, and so is
    /// any part before a message was fetched.
    pub(super) fn mailbox_part(&self, part: MailboxPart, data: &mut [u8]) -> CommandOutcome {
        let (start, len) = (usize::from(part.start()), usize::from(part.length()));
        let mail = self.results.mail.as_deref();
        answered(mail.and_then(|mail| mail.get(start..start + len)), data)
    }

    /// MBX_STAT: reads which slaves have mail, or sets or reads which mailboxes are polled. `[OURS]` It is refused without a
    /// network. Bits of slaves that were not found are left out; a slave outside OP is shown without mail.
    pub(super) fn mailbox_status(&mut self, request: &MailboxStatus, data: &mut [u8]) -> CommandOutcome {
        if self.bus.count == 0 {
            return Err(CommandRefused);
        }
        let chosen = |is_in: &dyn Fn(u8, SlaveNumber) -> bool| {
            let slaves = self.bus.slaves().filter_map(|slave| Some((slave, SlaveNumber::new(slave)?)));
            let none = SlaveBits::for_slaves(self.bus.count);
            slaves.filter(|(n, slave)| is_in(*n, *slave)).fold(none, |bits, (_, slave)| bits.with(slave))
        };
        match request {
            MailboxStatus::ReadFlags => {
                let has_mail = |n, _| self.network.state(n) == Some(AlState::Op) && self.network.has_mail(n);
                Ok(chosen(&has_mail).encode(data)?)
            }
            MailboxStatus::SetPolling(slaves) => {
                self.bus.wants_polled = chosen(&|_, slave| slaves.contains(slave));
                DONE
            }
            MailboxStatus::ReadPolling => Ok(chosen(&|_, slave| self.bus.wants_polled.contains(slave)).encode(data)?),
        }
    }
}
