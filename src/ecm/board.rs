//! The board itself: CRC switches, FIFO, reset, and waiting until it is there again.

use std::time::{Duration, Instant};

use super::core::Task;
use super::leftover::Left;
use super::servo::require_op;
use super::{Close, Ecm, EcmError, Options};
use crate::link::uri::LinkUri;
use crate::link::{FAILED_OPEN, LinkError};
use crate::sk::{FifoAction, MasterCommand};

/// \[OURS] Pause between two tries to open a board that is not there.
const TRY_AGAIN: Duration = Duration::from_millis(50);

/// What the board does with CRCs (SET_EX).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CrcSwitches {
    /// It checks those of command frames and executes none that is wrong (SK-1.24). This API fills them always.
    pub check_commands: bool,
    /// It fills those of its reports, so that one turned over on the way is noticed.
    pub fill_responses: bool,
}

impl Ecm {
    /// Switches the CRCs of command frames and of reports, from the board's next boot on ([`Ecm::reset`], or power). The
    /// board keeps the switches. Not in OP.
    ///
    /// # Errors
    /// [`EcmError::WrongState`], [`EcmError::Setting`] for reports without a CRC where [`Options::strict_crc`] wants one,
    /// [`EcmError::Timeout`], [`EcmError::Link`].
    pub fn set_crc(&self, switches: CrcSwitches) -> Result<(), EcmError> {
        if self.core.options.strict_crc && !switches.fill_responses {
            return Err(EcmError::Setting {
                what: "the CRC of reports",
                found: "switched off".to_owned(),
                allowed: "fill_responses, or open the board without Options::strict_crc",
            });
        }
        let found = self.state()?;
        if self.core.lock()?.in_op() {
            return Err(EcmError::WrongState { what: "set_crc", needs: "Init, PreOP or SafeOP", found });
        }
        let CrcSwitches { check_commands, fill_responses } = switches;
        self.master("SET_EX", &MasterCommand::SetEx { check_commands, fill_responses }).map(|_| ())
    }

    /// Drops what waits in the board's FIFO. An axis in CSP holds the target that was executed last: it stops at once and
    /// without a ramp. One in CSV turns on, one in CST keeps its torque, as executed last. To stop gently end the stream
    /// instead.
    ///
    /// A [`Stream`](super::Stream) that is open has lost its way then: it takes no target and no step any more
    /// ([`EcmError::Cleared`]). Its end ramps what still moves.
    ///
    /// # Errors
    /// [`EcmError::WrongState`], [`EcmError::Timeout`], [`EcmError::Link`].
    pub fn clear_fifo(&self) -> Result<(), EcmError> {
        {
            let mut session = self.core.lock()?;
            self.core.catch_up(&mut session)?;
            require_op(&session, "clear_fifo")?;
        }
        let task = Task {
            what: "clearing the FIFO",
            hint: "see whether frames get lost (Ecm::stats)",
            limit: self.core.options.servo_limit,
            commands: &[(0, MasterCommand::SetFifo(FifoAction::Clear).encode())],
            resend: true,
            own: false,
        };
        self.core.run(
            &task,
            // It acts on arrival; its own frame is the first entry after it.
            |session, sent| Ok(session.executed(sent).then_some(())),
            |session| format!("{} entries are ahead of the board", session.credit.ahead()),
        )
    }

    /// Boots the board (SW_RESET): moving axes are ramped to a standstill, then it forgets everything but the CRC switches
    /// and goes away, with the connection. The axes lose their master: drives switch off. To go on, wait for it with
    /// [`Ecm::open_when_there`].
    ///
    /// ```
    /// use std::time::Duration;
    ///
    /// use ecmsk::ecm::{Ecm, EcmError, Options};
    ///
    /// let ecm = Ecm::open("sim:?slaves=drive&clock=virtual&name=reset")?;
    /// let uri = ecm.link_info().name.clone();
    /// ecm.reset()?;
    /// let (ecm, took) = Ecm::open_when_there(&uri, Options::default(), Duration::from_secs(30))?;
    /// assert!(took > Duration::ZERO && ecm.state()?.state().is_some());
    /// # Ok::<(), EcmError>(())
    /// ```
    ///
    /// # Errors
    /// Why axes may have moved at that moment, as [`Ecm::close`]: it is reset all the same. [`EcmError::Timeout`] if the
    /// board is still there, [`EcmError::NoReport`], [`EcmError::Link`].
    pub fn reset(mut self) -> Result<(), EcmError> {
        self.core.link.check()?;
        let rested = self.rest(false, &mut Left::default());
        let task = Task {
            what: "SW_RESET",
            hint: "see whether frames get lost (Ecm::stats), or switch the board off and on",
            limit: self.core.options.state_limit,
            commands: &[(0, MasterCommand::SoftReset.encode())],
            resend: true,
            own: false,
        };
        let done = self.core.run(
            &task,
            |_, _| Ok(None::<()>),
            |session| format!("it still reports, in {}", session.board.state),
        );
        // There is nothing left to ramp.
        self.leave();
        match done {
            Err(EcmError::Link(LinkError::Lost { .. })) => rested,
            Err(error) => Err(error),
            Ok(()) => rested,
        }
    }

    /// Opens a board as soon as it is there: after [`Ecm::reset`], or when it was unplugged. Gives the time that took, on
    /// the board's clock where that is virtual.
    ///
    /// # Errors
    /// [`EcmError::Timeout`] if it is not there in time, with what was found last; what [`Ecm::open_with`] says of a link
    /// that will not come by waiting.
    pub fn open_when_there(uri: &str, options: Options, limit: Duration) -> Result<(Self, Duration), EcmError> {
        let limit = limit.min(super::core::LONGEST);
        let is_virtual = LinkUri::parse(uri).is_ok_and(|uri| uri.value("clock") == Some("virtual"));
        let began = Instant::now();
        let mut tries = 0;
        loop {
            let waited = if is_virtual { FAILED_OPEN * tries } else { began.elapsed() };
            let last = match Self::open_with(uri, options) {
                Ok(ecm) => return Ok((ecm, waited)),
                Err(error) => error,
            };
            let may_come = matches!(
                last,
                EcmError::NoReport { .. } | EcmError::Link(LinkError::NoBoard { .. } | LinkError::Lost { .. })
            );
            if !may_come {
                return Err(last);
            }
            if waited >= limit {
                let seen = format!("last: {last}");
                let hint = "check the board's power and its plug, then open it again";
                return Err(EcmError::Timeout { what: "the board's return", waited, seen, hint });
            }
            if !is_virtual {
                std::thread::sleep(TRY_AGAIN.min(limit.saturating_sub(began.elapsed())));
            }
            tries += 1;
        }
    }

    /// Ends every use, and sends nothing.
    fn leave(&mut self) {
        // Closing in this way cannot fail.
        let _ = self.end(Close::Leave);
    }
}
