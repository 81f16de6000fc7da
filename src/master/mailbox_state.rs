//! What the master keeps of a slave's mailbox from one request to the next.

use crate::ethercat::mailbox::MailboxCounter;

/// What the master knows of a mailbox.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct MailboxState {
    /// The counter of the last request.
    pub(super) counter: MailboxCounter,
    /// The counter of the last message of the slave.
    pub(super) received: MailboxCounter,
    /// The bit by which repeats are asked for.
    pub(super) repeat: bool,
    /// A request is under way.
    pub(super) is_open: bool,
    /// The slave has not answered a request that was given up, and may still do so.
    pub(super) owes: bool,
    /// Another master uses the mailbox, too: requests are not counted, so that none of its own is taken for a repeat.
    pub(super) is_shared: bool,
}

impl MailboxState {
    /// The slave enters PreOP: it has forgotten all messages.
    pub(super) const fn begin(&mut self) {
        (self.counter, self.received, self.repeat) = (MailboxCounter::NONE, MailboxCounter::NONE, false);
        self.owes = false;
    }

    /// Whether a request is under way.
    pub(super) const fn is_open(&self) -> bool {
        self.is_open
    }
}
