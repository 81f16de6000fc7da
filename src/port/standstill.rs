//! Stops the axes of a client or host that has vanished without closing the board. A server brings these axes to a
//! standstill in the same way as `Ecm::close` of the native API.

use std::sync::Arc;
use std::time::Duration;

use super::tcp::OnVanish;
use crate::ecm::{Close, Ecm, EcmError, HeldBack, Options, Succeeded, Watch};
use crate::link::{Link, Wait};
use crate::sk::{FifoAction, Frame, MasterCommand};
use crate::tcp::wire::StopEnd;

/// The timeout for writing a frame to a board that makes no reports. \[OURS]
const CLEAR_WRITE_MAX: Duration = Duration::from_millis(200);

/// How bringing axes to a standstill has ended.
#[derive(Clone, Debug)]
pub(super) struct Standstill {
    /// Whether the axes were switched off, too.
    pub(super) off: bool,
    pub(super) end: StopEnd,
    /// The details, for a client that has asked for the stop; may be empty.
    pub(super) text: String,
}

/// A board whose client or host has vanished; `who` names the client or host in the log. Until the axes stand still,
/// only the server uses `link`. Closing this link leaves the board open.
pub(super) struct LeftBoard<'a> {
    pub(super) link: Arc<dyn Link>,
    /// Returns the state of the network (slaves, axes, FIFO) that frames and reports up to the newest one have shown.
    pub(super) watch: &'a dyn Fn() -> Watch,
    pub(super) who: &'a str,
    /// Logs a line; never waits.
    pub(super) tell: &'a dyn Fn(&str),
}

impl LeftBoard<'_> {
    /// Brings the axes to a standstill, within the time limits of [`Ecm::close`]. Returns how that has ended; `None`: the
    /// axes are left as they are, or the board is lost.
    pub(super) fn bring_to_standstill(&self, on_vanish: OnVanish) -> Option<Standstill> {
        let off = match on_vanish {
            OnVanish::Leave => {
                (self.tell)("axes are left as they are (on-vanish=leave)");
                return None;
            }
            OnVanish::Ramp => false,
            OnVanish::ServoOff => true,
        };
        if self.link.check().is_err() {
            return None;
        }
        let who = self.who;
        let (end, text) = match self.stop_axes(off) {
            Ok((Succeeded::Stand { discarded: entries }, held_back)) => {
                let more = dropped(entries) + &pushed(&held_back);
                (self.tell)(&format!("axes stand still after {who}{more}"));
                (StopEnd::Stand, more.trim_start_matches("; ").to_owned())
            }
            Ok((Succeeded::NotInOp, _)) => (StopEnd::NotInOp, String::new()),
            Ok((Succeeded::Unknown { discarded: entries }, _)) => {
                (self.tell)(&format!(
                    "the network was configured before this server came: what moves is not known to it and goes on{}; \
                     use the emergency stop if axes move",
                    dropped(entries)
                ));
                (StopEnd::Unknown, String::new())
            }
            Err(error) => {
                (self.tell)(&format!("axes may still move after {who}: {error}; use the emergency stop"));
                (StopEnd::Failed, error.to_string())
            }
        };
        Some(Standstill { off, end, text })
    }

    /// Returns how the stop has ended, and the axes that did not follow.
    fn stop_axes(&self, off: bool) -> Result<(Succeeded, Vec<HeldBack>), EcmError> {
        let options = Options { close: Close::Leave, ..Options::default() };
        let begun =
            Ecm::over(Arc::clone(&self.link), options).and_then(|ecm| ecm.see_what_is_left(self.watch).map(|()| ecm));
        match begun {
            Ok(ecm) => Ok((ecm.succeed(&(self.watch)(), off)?, ecm.take_held_back()?)),
            Err(error) => {
                self.clear_fifo_unseen();
                Err(error)
            }
        }
    }

    /// Clears the FIFO of a board that makes no reports, without seeing the effect. Such a board may still accept
    /// frames: without its EtherCAT cable it keeps its FIFO entries, and these must not be executed when the cable is
    /// plugged in again.
    fn clear_fifo_unseen(&self) {
        let Some(size) = self.link.info().slot else { return };
        let mut clear = Frame::new();
        clear.put_master(size, &MasterCommand::SetFifo(FifoAction::Clear));
        clear.fill_crc(size);
        if let Err(error) = self.link.write(&clear, Wait::For(CLEAR_WRITE_MAX)) {
            (self.tell)(&format!(
                "what waits in the board's FIFO stays there: {error}; use the emergency stop before its cable is plugged"
            ));
        }
    }
}

/// The number of axes that did not follow that are named in a text, which has to fit into a message.
const NAMED_MAX: usize = 2;

fn pushed(axes: &[HeldBack]) -> String {
    let named: String = axes.iter().take(NAMED_MAX).map(|axis| format!("; {axis}")).collect();
    match axes.len().saturating_sub(NAMED_MAX) {
        0 => named,
        more => format!("{named}; so did {more} more"),
    }
}

fn dropped(entries: u16) -> String {
    match entries {
        0 => String::new(),
        1 => "; one command that waited in the FIFO was dropped".to_owned(),
        entries => format!("; {entries} commands that waited in the FIFO were dropped"),
    }
}
