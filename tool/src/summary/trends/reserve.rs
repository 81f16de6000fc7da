//! The reserve of the FIFO: how many commands still wait when the next target of a motion comes.

use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{CommandId, FIFO_ENTRIES, Frame, MasterResponse, MasterState, SlotSize};

/// Targets that stay for this long end a motion, ns. \[OURS] The FIFO empties then, as it should.
const REST_NS: i64 = 100_000_000;

/// Follows the commands and the FIFO.
#[derive(Debug)]
pub struct Reserve {
    targets: [Option<i32>; MAX_SLAVES],
    /// When a target changed last.
    moved_ns: i64,
    /// The commands that waited at the last report in OP.
    waiting: Option<u16>,
    /// Whether the FIFO has been filled since the motion began: from one report to the next no more commands waited.
    is_filled: bool,
}

impl Reserve {
    /// Starts without frames.
    pub const fn new() -> Self {
        Self { targets: [None; MAX_SLAVES], moved_ns: i64::MIN, waiting: None, is_filled: false }
    }

    /// Adds a command frame. Returns how many commands still waited, if it goes on with a motion. Where none waited, it may
    /// be the first one of a motion: gaps are found otherwise.
    pub fn command(&mut self, at_ns: i64, frame: &Frame, size: SlotSize) -> Option<u16> {
        let mut moves = false;
        for (slave, target) in (1..=size.max_slaves()).zip(&mut self.targets) {
            let slot = frame.slot(size, slave);
            if CommandId::from_code(slot.id) == CommandId::Csp {
                let now = slot.data1 as i32;
                moves |= target.replace(now).is_some_and(|before| before != now);
            }
        }
        if !moves {
            return None;
        }
        if at_ns.saturating_sub(self.moved_ns) > REST_NS {
            self.is_filled = false;
        }
        self.moved_ns = at_ns;
        self.waiting.filter(|waiting| self.is_filled && *waiting > 0)
    }

    /// Adds a report.
    pub fn report(&mut self, board: &MasterResponse) {
        if board.state.state() != Some(MasterState::Op) {
            (self.waiting, self.is_filled) = (None, false);
            return;
        }
        let waiting = FIFO_ENTRIES.saturating_sub(board.fifo_free);
        let before = self.waiting.replace(waiting);
        self.is_filled |= waiting > 0 && before.is_some_and(|before| before >= waiting);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecmsk::sk::{Motion, SlaveCommand, StateByte};

    const SIZE: SlotSize = SlotSize::Bytes12;

    fn board(waiting: u16) -> MasterResponse {
        let mut board = MasterResponse::decode(&Frame::new().slot(SIZE, 0));
        (board.state, board.fifo_free) = (StateByte::reached(MasterState::Op), FIFO_ENTRIES - waiting);
        board
    }

    /// The reserve counts from when the FIFO was filled, and not while it empties at the end.
    #[test]
    fn what_waits_on_the_way_counts() {
        let mut reserve = Reserve::new();
        let mut found = Vec::new();
        // The program sends four targets at once, then one for each report; a late one; and stops.
        let waiting = [0, 3, 4, 4, 4, 4, 2, 3, 4, 4, 3, 2, 1, 0];
        let sends = [4, 1, 1, 1, 1, 0, 2, 1, 1, 0, 0, 0, 0, 0];
        let mut target = 0;
        for (ms, (waiting, sends)) in (0..).zip(waiting.into_iter().zip(sends)) {
            reserve.report(&board(waiting));
            for _ in 0..sends {
                target += 10;
                let mut frame = Frame::new();
                frame.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(target)).into());
                found.extend(reserve.command(ms * 1_000_000, &frame, SIZE));
            }
        }
        assert_eq!(found.iter().min(), Some(&2), "{found:?}");
        assert!(!found.contains(&3) || found.iter().position(|n| *n == 3) > found.iter().position(|n| *n == 2));
    }
}
