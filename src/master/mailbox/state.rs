//! The state of a slave's mailbox that lasts from one request to the next.

use crate::ethercat::mailbox::MailboxCounter;

/// Counters and flags of one slave's mailbox.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::master) struct MailboxState {
    /// The counter of the newest request.
    pub(in crate::master) counter: MailboxCounter,
    /// The counter of the newest message of the slave.
    pub(in crate::master) received: MailboxCounter,
    /// Whether the slave's last two messages had different counters, so that an equal one means the same message again.
    pub(in crate::master) is_counting: bool,
    /// The repeat request bit of the sync manager, as written last.
    pub(in crate::master) repeat: bool,
    /// Whether a sequence is using the mailbox.
    pub(in crate::master) is_open: bool,
    /// Whether the slave may still answer an abandoned request.
    pub(in crate::master) owes: bool,
    /// Whether another master uses the mailbox, too. Requests then have counter 0, so that the slave does not take a
    /// request of the other master for a repeat.
    pub(in crate::master) is_shared: bool,
}

impl MailboxState {
    /// Called when the slave enters PreOP: it has forgotten all messages.
    pub(in crate::master) const fn begin(&mut self) {
        (self.counter, self.received, self.repeat) = (MailboxCounter::NONE, MailboxCounter::NONE, false);
        (self.owes, self.is_counting) = (false, false);
    }

    /// Whether a sequence is using the mailbox.
    pub(in crate::master) const fn is_open(&self) -> bool {
        self.is_open
    }
}
