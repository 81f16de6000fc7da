//! Determines the reserve of the FIFO: the number of commands in it when the next target of a motion arrives.

use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{CommandId, FIFO_ENTRIES, Frame, MasterResponse, MasterState, SlotSize};

/// If the targets do not change for this long, the motion has ended, ns. \[OURS] It is normal that the FIFO becomes
/// empty then.
const REST_NS: i64 = 100_000_000;

/// Follows the command frames and the level of the FIFO.
#[derive(Debug)]
pub struct Reserve {
    targets: [Option<i32>; MAX_SLAVES],
    /// The time at which a target changed last.
    moved_ns: i64,
    /// The number of commands in the FIFO at the last report in OP.
    waiting: Option<u16>,
    /// Whether the FIFO has reached its level since the motion began: between two reports the number of commands did
    /// not rise.
    is_filled: bool,
}

impl Reserve {
    /// Starts without frames.
    pub const fn new() -> Self {
        Self { targets: [None; MAX_SLAVES], moved_ns: i64::MIN, waiting: None, is_filled: false }
    }

    /// Processes a command frame. If it continues a motion, returns the number of commands in the FIFO. If the FIFO is
    /// empty, `None` is returned, because the frame may begin a motion; gaps are found by other means.
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

    /// Processes a report.
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

    /// The reserve counts only after the FIFO has reached its level, and not while it becomes empty at the end of the
    /// motion.
    #[test]
    fn what_waits_on_the_way_counts() {
        let mut reserve = Reserve::new();
        let mut found = Vec::new();
        // The program sends four targets at once, then one after each report, one of them late; then it stops.
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
