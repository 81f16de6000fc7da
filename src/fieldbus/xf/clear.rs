//! Empties the chip's RxFIFO, for SET_FIFO 1 and when the network leaves OP. The bus then finds out how many sets of outputs
//! were sent before.

use super::ask::{Ask, Asked};
use super::chip_bus::ChipBus;
use crate::ethercat::Ns;
use crate::fieldbus::Cleared;
use crate::xf::host::Wires;
use crate::xf::request::Fifos;

/// How many answers have to come after a command before the fill levels in an answer header are certainly newer than
/// the command (OBS: they lag two exchanges).
pub(super) const SETTLED: u64 = 3;

/// The steps of emptying the RxFIFO, which is called a clear here.
#[derive(Clone, Copy, Debug)]
pub(super) enum Clearing {
    Idle,
    /// The clear is requested. It waits for the results of the exchanges in flight, which carry sets of outputs.
    Begun,
    /// The chip executes the command that stops it from taking sets of outputs out of its FIFO.
    Stopping(Asked),
    /// The FIFO is stopped. The clear waits until the driver's count of received answers reaches this value: then the
    /// answer header has the fill level of the stopped FIFO.
    Settling(u64),
    /// First value: the command that empties the FIFO; `None`: it has to be submitted. Second value: the fill level of
    /// the stopped FIFO.
    Emptying(Option<Asked>, u8),
    /// First value: the command that switches the FIFO on again; `None`: it has to be submitted. Second value: the id
    /// of the newest outputs that were sent.
    SwitchingOn(Option<Asked>, Option<u64>),
    Ended(Option<u64>),
}

impl<W: Wires> ChipBus<W> {
    pub(super) fn begin_clear(&mut self) {
        self.drop_queue();
        // The sets that were just dropped from the queue may contain the outputs that keep lost slaves at a standstill,
        // so such outputs are written once more.
        self.repeat_is_due = self.runs && !self.network.lost.is_empty();
        self.clearing = Clearing::Begun;
    }

    /// Continues a clear. A command that fails is repeated while slaves are in OP \[OURS]: otherwise sets of outputs
    /// that the board considers cleared would still be sent, and newer sets after them. Once no slave is in OP, or the
    /// driver has stopped, the clear ends: nothing in the FIFO is sent any more.
    pub(super) fn clear_on(&mut self, now: Ns) {
        let answers = self.host.counters().answers;
        self.clearing = match self.clearing {
            Clearing::Idle | Clearing::Ended(_) => return,
            _ if !self.runs || self.has_stopped() => {
                let newest_sent = self.ledger.lost();
                (self.left_behind, self.newest_left_behind) = (0, None);
                Clearing::Ended(self.dropped.or(newest_sent))
            }
            Clearing::Begun if self.sets_under_way() == 0 => {
                match (Ask::Fifo { on: false }).submit(&mut self.host, now) {
                    Ok(asked) => {
                        self.ledger.stop();
                        Clearing::Stopping(asked)
                    }
                    Err(_) => Clearing::Begun,
                }
            }
            Clearing::Stopping(asked) => match asked.reply(&mut self.host) {
                None => Clearing::Stopping(asked),
                Some(Ok(_)) => Clearing::Settling(answers + SETTLED),
                Some(Err(_)) => Clearing::Begun,
            },
            Clearing::Settling(until) if answers >= until && self.flying.is_empty() => {
                Clearing::Emptying(None, self.host.header().map_or(0, |header| header.rx_fifo))
            }
            Clearing::Emptying(None, level) => {
                Clearing::Emptying(Ask::Clear(Fifos::Rx).submit(&mut self.host, now).ok(), level)
            }
            Clearing::Emptying(Some(asked), level) => match asked.reply(&mut self.host) {
                None => Clearing::Emptying(Some(asked), level),
                Some(Ok(_)) => {
                    self.level.clear();
                    let doubted = self.ledger.newest_doubt();
                    let newest_sent = self.ledger.cleared(level);
                    // Forgets the newest written set unless it is the newest one that was sent: a cleared set must not
                    // be sent as a repetition.
                    self.newest_written = self.newest_written.take().filter(|set| Some(set.id) == newest_sent);
                    // If it is not known whether the newest set has reached the FIFO, it counts as sent and would not
                    // be written again. The slaves may lack it, so it is repeated: the same outputs twice do no harm.
                    self.repeat_is_due |= doubted.is_some() && doubted == newest_sent;
                    Clearing::SwitchingOn(None, newest_sent)
                }
                Some(Err(_)) => Clearing::Emptying(None, level),
            },
            Clearing::SwitchingOn(None, newest_sent) => {
                let asked = (Ask::Fifo { on: true }).submit(&mut self.host, now).ok();
                Clearing::SwitchingOn(asked, newest_sent)
            }
            Clearing::SwitchingOn(Some(asked), newest_sent) => match asked.reply(&mut self.host) {
                None => Clearing::SwitchingOn(Some(asked), newest_sent),
                Some(Ok(_)) => Clearing::Ended(newest_sent),
                Some(Err(_)) => Clearing::SwitchingOn(None, newest_sent),
            },
            other @ (Clearing::Begun | Clearing::Settling(_)) => other,
        };
    }

    pub(super) fn is_clearing(&self) -> bool {
        !matches!(self.clearing, Clearing::Idle)
    }

    pub(super) fn take_cleared(&mut self) -> Option<Cleared> {
        let Clearing::Ended(newest_sent) = self.clearing else { return None };
        self.clearing = Clearing::Idle;
        Some(Cleared { newest_sent })
    }
}
