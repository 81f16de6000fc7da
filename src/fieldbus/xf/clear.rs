//! SET_FIFO 1 and leaving OP: the chip's RxFIFO is emptied, and how many of its sets were sent by then is found out.

use super::ask::{Ask, Asked};
use super::chip_bus::ChipBus;
use crate::ethercat::Ns;
use crate::fieldbus::Cleared;
use crate::xf::host::Wires;
use crate::xf::request::Fifos;

/// Answers of the chip after which a header tells the fill levels behind a command (OBS: they lag two exchanges).
pub(super) const SETTLED: u64 = 3;

/// How far a clear is.
#[derive(Clone, Copy, Debug)]
pub(super) enum Clearing {
    Idle,
    /// The sets under way are to be known first.
    Begun,
    /// The chip is told to stop taking sets out of its FIFO.
    Stopping(Asked),
    /// So many answers are to be there, so that the fill level of the stopped FIFO is known.
    Settling(u64),
    /// The FIFO is emptied, or is to be; it had that level.
    Emptying(Option<Asked>, u8),
    /// The chip is told to go on, or is to be told; it had sent the outputs with that id.
    SwitchingOn(Option<Asked>, Option<u64>),
    Ended(Option<u64>),
}

impl<W: Wires> ChipBus<W> {
    pub(super) fn begin_clear(&mut self) {
        self.drop_queue();
        // What was to hold lost slaves may be among what is dropped.
        self.repeat_is_due = self.runs && !self.network.lost.is_empty();
        self.clearing = Clearing::Begun;
    }

    /// A clear goes on. What fails is tried again as long as slaves are in OP \[OURS]: else sets that the board takes for
    /// cleared would still be sent, and newer ones behind them.
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
                    // What was cleared must not come again where the newest set is repeated.
                    self.newest_written = self.newest_written.take().filter(|set| Some(set.id) == newest_sent);
                    // A set that counts as sent, since nobody knows whether it was, is sent now.
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
