//! The times at which written frames arrive at a board in real time.

use std::time::Duration;

use crate::fieldbus::Ns;

/// How far a frame's time for the writer may be ahead of its arrival. Frames that are written ahead of the wire are closer;
/// after a longer gap of board time its own time counts. \[OURS]
const ORDER_MAX_NS: Ns = 50_000_000;

/// The arrival times that were given to written frames.
#[derive(Default)]
pub(super) struct Arrivals {
    /// The earliest time at which the next frame may arrive at the board, on the runner's clock: until then the frame
    /// before it occupies the simulated wire.
    next: Duration,
    /// The newest arrival, board time. No later frame arrives before it, unless more board time was skipped since.
    newest: Ns,
    /// How much board time had been skipped in total when `newest` was set.
    skipped: Ns,
    /// The newest time that a writer was given.
    shown: Ns,
}

/// When a written frame arrives.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Arrival {
    /// When the wire is free for the frame, on the runner's clock.
    pub turn: Duration,
    /// When the board takes the frame, board time.
    pub at: Ns,
    /// The time for the writer, board time: that of `at`, but not shortly before that of an earlier frame. Recordings are
    /// sorted by it, and frames reach the board in the order in which they are written, also where it skips cycles.
    pub shown: Ns,
}

impl Arrivals {
    /// The arrival of a frame that is written at `now` on the runner's clock, which is `board_now` of board time, after
    /// `skipped` of it was skipped in total. The frame then occupies the wire for `host`, unless it has to wait for so
    /// long that `waits` denies it: then it is not sent.
    pub(super) fn next(
        &mut self,
        now: Duration,
        (board_now, skipped): (Ns, Ns),
        host: Duration,
        waits: impl FnOnce(Duration) -> bool,
    ) -> Arrival {
        let turn = now.max(self.next);
        if waits(turn - now) {
            self.next = turn + host;
        }
        let at = board_now + (turn - now).as_nanos() as Ns;
        // If board time has skipped a gap since the last write, the arrival time of that write may lie within the gap,
        // which is later than board time is now. This arrival time must not delay later frames.
        let newest = if std::mem::replace(&mut self.skipped, skipped) == skipped { self.newest } else { 0 };
        self.newest = newest.max(at);
        if self.shown.saturating_sub(self.newest) > ORDER_MAX_NS {
            self.shown = self.newest;
        }
        self.shown = self.shown.max(self.newest);
        Arrival { turn, at: self.newest, shown: self.shown }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOST: Duration = Duration::from_micros(125);
    const MS: Ns = 1_000_000;

    /// NIC-2.4 Frames are written faster than the wire takes them, and board time skips a cycle: the board takes the next
    /// frame without a delay, and the times that the writer sees keep the order of the frames.
    #[test]
    fn times_for_the_writer_keep_the_order() {
        let mut arrivals = Arrivals::default();
        let (mut at, mut shown) = (Vec::new(), Vec::new());
        for n in 0..40 {
            let now = Duration::from_millis(10);
            let skipped = if n < 20 { 0 } else { MS };
            let arrival = arrivals.next(now, (10 * MS - skipped, skipped), HOST, |_| true);
            assert_eq!(arrival.turn, now + n * HOST);
            at.push(arrival.at);
            shown.push(arrival.shown);
        }
        assert_eq!(at[20], 10 * MS + 20 * 125_000 - MS, "{at:?}");
        assert!(shown.is_sorted() && shown[..20] == at[..20], "{shown:?}");
    }

    /// A frame that would wait for too long is not sent, and occupies the wire for no time.
    #[test]
    fn a_frame_that_is_not_sent_takes_no_time() {
        let mut arrivals = Arrivals::default();
        let mut turn = |waits| arrivals.next(Duration::ZERO, (0, 0), HOST, |_| waits).turn;
        assert_eq!([turn(true), turn(false), turn(true)], [Duration::ZERO, HOST, HOST]);
    }
}
