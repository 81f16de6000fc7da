//! Calls for the board itself: its CRC switches, its FIFO, its reset, and the wait until it can be opened again.

use std::time::{Duration, Instant};

use super::exchange::{Session, Task, ahead_of_the_board};
use super::standstill::LeftBehind;
use super::{Close, Ecm, EcmError, Options};
use crate::address::uri::LinkUri;
use crate::link::{FAILED_OPEN, LinkError};
use crate::sk::{FifoAction, MasterCommand};

/// \[OURS] The pause between two attempts to open a board that is absent.
const RETRY_INTERVAL: Duration = Duration::from_millis(50);

/// Which of the two directions carry CRCs: the switches of the board's command SET_EX.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CrcSwitches {
    /// Whether the board checks the CRCs of command frames and executes no frame with a wrong one (SK-1.24). This API
    /// fills the CRCs in any case.
    pub check_commands: bool,
    /// Whether the board fills the CRCs of its reports, so that corrupted reports are detected.
    pub fill_responses: bool,
}

impl Ecm {
    /// Switches the CRCs of command frames and of reports on or off. The board stores the switches and applies them at
    /// its next start ([`Ecm::reset`], or power on). Not possible in OP.
    ///
    /// # Errors
    /// [`EcmError::WrongState`] in OP, [`EcmError::Setting`] for reports without a CRC if [`Options::strict_crc`] requires one,
    /// [`EcmError::Timeout`] if the board does not answer in time, [`EcmError::Link`] if the link fails.
    pub fn set_crc(&self, switches: CrcSwitches) -> Result<(), EcmError> {
        if self.exchange.options.strict_crc && !switches.fill_responses {
            return Err(EcmError::Setting {
                what: "the CRC of reports",
                found: "switched off".to_owned(),
                allowed: "fill_responses, or open the board without Options::strict_crc",
            });
        }
        let found = self.state()?;
        if self.exchange.lock()?.in_op() {
            return Err(EcmError::WrongState { what: "set_crc", needs: "Init, PreOP or SafeOP", found });
        }
        let CrcSwitches { check_commands, fill_responses } = switches;
        self.master("SET_EX", &MasterCommand::SetEx { check_commands, fill_responses }).map(|_| ())
    }

    /// Discards the entries of the board's FIFO. An axis in CSP then holds the target that was executed last: it stops
    /// at once and without a ramp. An axis in CSV keeps the velocity that was executed last, and one in CST the torque.
    /// To stop gently, end the stream instead.
    ///
    /// An open [`Stream`](super::Stream) refuses further targets and steps ([`EcmError::Cleared`]), because its next
    /// targets would not continue the positions of the axes. Ending the stream brings moving axes to a standstill.
    ///
    /// # Errors
    /// [`EcmError::WrongState`] outside OP, [`EcmError::Timeout`] if reports do not show in time that the FIFO was cleared,
    /// [`EcmError::Link`] if the link fails.
    pub fn clear_fifo(&self) -> Result<(), EcmError> {
        drop(self.exchange.lock_in_op("clear_fifo")?);
        let (hint, limit) = ("see whether frames get lost (Ecm::stats)", self.exchange.options.servo_limit);
        let clear = [(0, MasterCommand::SetFifo(FifoAction::Clear).encode())];
        self.exchange.run(
            &Task::new("clearing the FIFO", hint, limit, &clear).seen(&ahead_of_the_board),
            // The board executes SET_FIFO when it arrives, and the frame that carries the command then becomes the first
            // entry of the empty FIFO. So once this entry is executed, the FIFO has been cleared.
            |session, sent| Ok(session.executed(sent).then_some(())),
        )
    }

    /// Restarts the board (SW_RESET). Moving axes are brought to a standstill first. Then the board forgets everything
    /// except the CRC switches, and the connection ends. The slaves lose their master, so that drives switch off. To go
    /// on, wait for the board with [`Ecm::open_when_there`].
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
    /// The errors of [`Ecm::close`] if the axes were not brought to a standstill first; the board is reset all the same.
    /// [`EcmError::Timeout`] if the board goes on making reports, [`EcmError::NoReport`] if the reports stop and the link does
    /// not report that the board is lost, [`EcmError::Link`] for any other error of the link.
    pub fn reset(mut self) -> Result<(), EcmError> {
        self.exchange.link.check()?;
        let rested = self.bring_to_rest(false, &mut LeftBehind::default());
        let hint = "see whether frames get lost (Ecm::stats), or switch the board off and on";
        let (limit, commands) = (self.exchange.options.state_limit, [(0, MasterCommand::SoftReset.encode())]);
        let task = Task::new("SW_RESET", hint, limit, &commands);
        let seen = |session: &Session| format!("it still reports, in {}", session.board().state);
        let done = self.exchange.run(&task.seen(&seen), |_, _| Ok(None::<()>));
        // The board has been reset, so its axes have no master and cannot be stopped. Closing without a stop returns no
        // error.
        let _ = self.end(Close::Leave);
        match done {
            Err(EcmError::Link(LinkError::Lost { .. })) => rested,
            Err(error) => Err(error),
            Ok(()) => rested,
        }
    }

    /// Opens a board as soon as it is available: after [`Ecm::reset`], or after it was unplugged. Also returns how long
    /// the call waited for the board, in virtual time on a link that has it.
    ///
    /// # Errors
    /// [`EcmError::Timeout`] if the board does not appear in time, with the last error of opening it. Errors of
    /// [`Ecm::open_with`] that waiting cannot remedy end the call at once.
    pub fn open_when_there(uri: &str, options: Options, limit: Duration) -> Result<(Self, Duration), EcmError> {
        let limit = limit.min(super::exchange::LIMIT_MAX);
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
                std::thread::sleep(RETRY_INTERVAL.min(limit.saturating_sub(began.elapsed())));
            }
            tries += 1;
        }
    }
}
