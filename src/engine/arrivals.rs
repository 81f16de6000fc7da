//! The times at which written frames arrive at a board in real time.

use std::time::Duration;

use crate::fieldbus::Ns;

/// How far [`Arrival::shown`] may be ahead of [`Arrival::at`]. Frames that wait for the simulated wire cause smaller
/// differences. After a longer gap in board time, `shown` goes back to `at`. \[OURS]
const ORDER_MAX_NS: Ns = 50_000_000;

/// The arrival times that were given to written frames.
#[derive(Default)]
pub(super) struct Arrivals {
    /// The earliest time at which the next frame may arrive at the board, on the runner's clock: until then the frame
    /// before it occupies the simulated wire.
    next: Duration,
    /// The newest arrival, board time. Frames written later do not arrive before it, unless board time was skipped
    /// since.
    newest: Ns,
    /// How much board time had been skipped in total when `newest` was set.
    skipped: Ns,
    /// The newest [`Arrival::shown`] that was returned to a writer.
    shown: Ns,
}

/// When a written frame arrives.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Arrival {
    /// When the wire is free for the frame, on the runner's clock.
    pub turn: Duration,
    /// When the board takes the frame, board time.
    pub at: Ns,
    /// The arrival time that the writer gets, board time. It is `at`, or the `shown` of the frame before if `at` is up
    /// to 50 ms earlier. So recordings, which are sorted by this time, keep the order in which the frames were written,
    /// also when board time skips cycles.
    pub shown: Ns,
}

impl Arrivals {
    /// Determines when a frame arrives that is written at `now` on the runner's clock. `board_now` is the board time at
    /// `now`, `skipped` the board time that was skipped in total until then. `waits` gets the time until the wire is
    /// free and decides whether the frame waits for it. If so, the frame then occupies the wire for `host`; otherwise
    /// it is not sent.
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
        // If board time was skipped since the last write, the arrival time of that write may be in the skipped time:
        // later than the present board time. It must not delay later frames.
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
