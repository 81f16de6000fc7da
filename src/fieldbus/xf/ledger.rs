//! Which outputs each cycle carried, derived from the chip's fill levels.
//!
//! In each cycle the chip takes a set of outputs out of its RxFIFO, if there is one, and puts a set of inputs into its
//! TxFIFO. A header has the fill levels of both FIFOs at one moment. If `W` sets have been written and `R` cycles read
//! by then, the number of sets sent is `W` minus the fill level of the RxFIFO, and the number of cycles is `R` plus the
//! fill level of the TxFIFO. One header gives such a pair of numbers (sets sent, cycles), and with it a lower bound for
//! the number of sets sent by any cycle: no cycle sends more than one set, and each cycle sends one while the RxFIFO is
//! not empty.
//!
//! The levels of a header lag behind: they belong to one of the [`LAG`] newest states of `W` and `R`, and it is not
//! known to which. So the minimum over these states is used. The bound never decreases, and when the FIFO runs dry it
//! is late by at most one cycle.

use std::collections::VecDeque;

/// How many of the newest states ([`State`]: sets written and cycles read) the levels of a header may belong to (OBS:
/// they lag two exchanges).
const LAG: usize = 3;
/// How many of the newest answer headers are remembered.
const SAMPLES: usize = 4;
/// The maximum number of entries in [`Ledger::milestones`]: the chip keeps that many cycles until they are read.
const MILESTONES: usize = 64;

/// The state of the chip at a moment to which the fill levels of a header belong: the number of sets of outputs sent
/// and of cycles by then.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Moment {
    sent: u64,
    cycles: u64,
    /// How many sets of outputs were certainly in the RxFIFO at the moment of the header.
    waiting: u64,
}

impl Moment {
    /// The minimum number of sets of outputs that had been sent by the end of the cycle with this number. Cycles count
    /// from 1 in the order in which they are read.
    fn sent_in(self, cycle: u64) -> u64 {
        match cycle.checked_sub(self.cycles) {
            Some(later) => self.sent + later.min(self.waiting),
            None => self.sent.saturating_sub(self.cycles - cycle),
        }
    }
}

/// The bus's own counts after an exchange: `W`, the sets of outputs written, and `R`, the cycles read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct State {
    written: u64,
    read: u64,
}

/// Counts sets of outputs and cycles since the bus was created, and derives which sets each cycle has sent.
#[derive(Clone, Debug)]
pub(super) struct Ledger {
    /// The counts after the newest exchanges, the newest last.
    states: [State; LAG],
    /// For each of the newest headers, the moments to which its fill levels may belong: one for each of the newest
    /// states.
    samples: [[Option<Moment>; LAG]; SAMPLES],
    /// Pairs of a cycle and the number of sets of outputs that were certainly sent by its end. Each comes from a
    /// header: it is the cycle by whose end all sets that the RxFIFO contained were sent. If many cycles wait to be
    /// read, the headers that show what these cycles sent are no longer in `samples`.
    milestones: VecDeque<(u64, u64)>,
    /// The number of doubtful sets of outputs: it is not known whether they have reached the RxFIFO and are still in
    /// it. 0 after the FIFO was empty.
    doubtful: u64,
    /// The doubtful sets of outputs. For each: how many sets had certainly been written before it, and its id.
    doubts: VecDeque<(u64, u64)>,
    /// The id of the newest doubtful set of outputs when the RxFIFO was last found empty. If this set had reached the
    /// RxFIFO, it was sent by then.
    settled_doubt: Option<u64>,
    /// For how many further exchanges the headers may still be older than the newest doubtful set.
    doubt_lag: usize,
    /// Whether the RxFIFO is stopped or about to be. From an unknown cycle on it then sends no sets of outputs.
    stopped: bool,
    /// The number of sets of outputs that were certainly sent.
    sent: u64,
    /// The id of the newest set of outputs that was certainly sent.
    newest_sent: Option<u64>,
    /// The ids of the sets of outputs that may not have been sent yet, the oldest first. The first one is the id of the
    /// set that follows the `sent` sets that were certainly sent.
    ids: VecDeque<u64>,
}

impl Ledger {
    /// A ledger with room for `depth` ids, for which it does not allocate again.
    pub(super) fn new(depth: usize) -> Self {
        Self {
            states: [State::default(); LAG],
            samples: [[Some(Moment::default()); LAG]; SAMPLES],
            milestones: VecDeque::with_capacity(MILESTONES),
            doubtful: 0,
            doubts: VecDeque::with_capacity(depth),
            settled_doubt: None,
            doubt_lag: 0,
            stopped: false,
            sent: 0,
            newest_sent: None,
            ids: VecDeque::with_capacity(depth),
        }
    }

    fn newest(&self) -> State {
        self.states[LAG - 1]
    }

    /// Records an exchange: it has put the sets of outputs with these ids into the RxFIFO, and has read `read` cycles.
    pub(super) fn exchanged(&mut self, ids: impl Iterator<Item = u64>, read: u64) {
        let mut newest = self.newest();
        for id in ids {
            self.ids.push_back(id);
            newest.written += 1;
        }
        newest.read += read;
        self.doubt_lag = self.doubt_lag.saturating_sub(1);
        self.states.rotate_left(1);
        self.states[LAG - 1] = newest;
    }

    /// Records doubtful sets of outputs: it is not known whether they have reached the RxFIFO.
    pub(super) fn doubt(&mut self, ids: impl Iterator<Item = u64>) {
        let written = self.newest().written;
        for id in ids {
            self.doubtful += 1;
            if self.doubts.len() == self.doubts.capacity() {
                self.doubts.pop_front();
            }
            self.doubts.push_back((written, id));
        }
        self.exchanged(std::iter::empty(), 0);
        self.doubt_lag = LAG;
    }

    /// Called when so many exchanges without process data have passed ([`SETTLED`](super::clear::SETTLED)) that the
    /// next headers include everything that was written and read.
    pub(super) fn caught_up(&mut self) {
        self.states = [self.newest(); LAG];
    }

    /// Evaluates the fill levels of a header.
    pub(super) fn header(&mut self, rx_fifo: u8, tx_fifo: u8) {
        let (rx_fifo, tx_fifo) = (u64::from(rx_fifo), u64::from(tx_fifo));
        if rx_fifo == 0 && self.doubt_lag == 0 {
            self.doubtful = 0;
            let newest = self.doubts.drain(..).next_back().map(|(_, id)| id);
            self.settled_doubt = self.settled_doubt.max(newest);
        }
        let (doubtful, stopped) = (self.doubtful, self.stopped);
        let moment = |State { written, read }: State| {
            // The RxFIFO cannot contain more sets of outputs than were written by then, so a state with fewer written
            // sets is ruled out. With doubtful sets no state is ruled out: the level may include them, but `written`
            // does not.
            let sent = if doubtful > 0 { Some(written.saturating_sub(rx_fifo)) } else { written.checked_sub(rx_fifo) };
            Some(Moment {
                sent: sent?,
                cycles: read + tx_fifo,
                waiting: if stopped { 0 } else { rx_fifo.saturating_sub(doubtful) },
            })
        };
        self.samples.rotate_left(1);
        let sample = self.states.map(moment);
        self.samples[SAMPLES - 1] = sample;
        let ends = sample.iter().flatten().map(|moment| (moment.cycles + moment.waiting, moment.sent + moment.waiting));
        let Some(end) = ends.reduce(|a, b| (a.0.max(b.0), a.1.min(b.1))) else { return };
        if self.milestones.back().is_none_or(|newest| end.1 >= newest.1) {
            while self.milestones.pop_back_if(|newest| newest.0 >= end.0).is_some() {}
            if self.milestones.len() < MILESTONES && self.milestones.back().is_none_or(|newest| end.1 > newest.1) {
                self.milestones.push_back(end);
            }
        }
    }

    /// The number of cycles that were read from the chip.
    pub(super) fn cycles(&self) -> u64 {
        self.newest().read
    }

    /// The id of the newest outputs that were certainly sent by the end of that cycle. Cycles count from 1 in the order in
    /// which they are read. Called once for each cycle, in that order.
    pub(super) fn sent_in(&mut self, cycle: u64) -> Option<u64> {
        self.send_until(self.sent_at_least(|moment| moment.sent_in(cycle)));
        while let Some((_, sent)) = self.milestones.pop_front_if(|(at, _)| *at <= cycle) {
            self.send_until(sent);
        }
        self.newest_sent
    }

    /// Counts the sets of outputs as sent that the newest headers show as sent, even if the cycles that sent them were
    /// not read.
    pub(super) fn settle(&mut self) {
        self.send_until(self.sent_at_least(|moment| moment.sent));
    }

    /// The number of sets of outputs that were certainly sent. `sent` computes it for the moment of a header.
    fn sent_at_least(&self, sent: impl Fn(&Moment) -> u64) -> u64 {
        let least = |moments: &[Option<Moment>; LAG]| moments.iter().flatten().map(&sent).min();
        self.samples.iter().filter_map(least).max().unwrap_or(0)
    }

    /// The maximum number of sets of outputs that may be in the RxFIFO.
    pub(super) fn ahead(&self) -> u64 {
        self.ids.len() as u64
    }

    /// The id of the oldest set of outputs that may not have been sent; if there is none, the id of the next set.
    pub(super) fn next_id(&self) -> u64 {
        let behind = self.newest_sent.map_or(0, |id| id + 1);
        self.ids.front().copied().unwrap_or(behind)
    }

    /// The number of newest sets of outputs that the level in a header may not include yet.
    pub(super) fn unseen(&self) -> u64 {
        self.newest().written - self.states[0].written
    }

    /// The id of the newest set of outputs that may still be in the RxFIFO.
    pub(super) fn newest_unsent(&self) -> Option<u64> {
        self.ids.back().copied()
    }

    /// The id of the newest set of outputs that was certainly sent.
    pub(super) const fn newest_sent(&self) -> Option<u64> {
        self.newest_sent
    }

    /// The id of the newest doubtful set of outputs: it is not known whether the set has reached the RxFIFO.
    pub(super) fn newest_doubt(&self) -> Option<u64> {
        self.doubts.back().map(|(_, id)| *id).max(self.settled_doubt)
    }

    /// Called when the RxFIFO is about to be stopped. Cycles continue and their inputs come, but from an unknown cycle on they
    /// send no sets of outputs.
    pub(super) fn stop(&mut self) {
        self.stopped = true;
        self.samples.iter_mut().flatten().flatten().for_each(|moment| moment.waiting = 0);
        self.milestones.clear();
    }

    /// Called when the RxFIFO was stopped and then emptied. `rx_fifo` is the fill level of the stopped FIFO, from a
    /// header after the stop. Returns the id of the newest set of outputs that was sent.
    ///
    /// A doubtful set counts as if it had reached the FIFO \[OURS]. So the result may be too new, by the number of
    /// doubtful sets, but never too old. If it is too new, an axis only moves on to a later target. If it were too old,
    /// an axis would go back to a target that it has left.
    pub(super) fn cleared(&mut self, rx_fifo: u8) -> Option<u64> {
        let State { written, read } = self.newest();
        let (mut sent, mut doubts) = (written, self.doubts.len());
        let newest_is_doubt = |sent, doubts: usize| doubts > 0 && self.doubts[doubts - 1].0 >= sent;
        for _ in 0..rx_fifo {
            if newest_is_doubt(sent, doubts) {
                doubts -= 1;
            } else {
                sent = sent.saturating_sub(1);
            }
        }
        let doubt = newest_is_doubt(sent, doubts).then(|| self.doubts[doubts - 1].1);
        self.send_until(sent);
        self.newest_sent = self.newest_sent.max(doubt).max(self.settled_doubt);
        self.forget_unsent(State { written: self.sent, read })
    }

    /// Called when the content of the RxFIFO is lost, for example by a reset of the chip. Returns the id of the newest
    /// set of outputs that was certainly sent. It is not known whether the next set was sent, too.
    pub(super) fn lost(&mut self) -> Option<u64> {
        let State { read, .. } = self.newest();
        self.forget_unsent(State { written: self.sent, read })
    }

    /// Like [`Self::lost`]; in addition the sets of outputs up to the id `newest` were dropped and will not be sent.
    pub(super) fn lost_until(&mut self, newest: Option<u64>) {
        self.lost();
        self.newest_sent = self.newest_sent.max(newest);
    }

    fn forget_unsent(&mut self, state: State) -> Option<u64> {
        self.ids.clear();
        self.states = [state; LAG];
        self.samples = [[Some(Moment { sent: state.written, cycles: state.read, waiting: 0 }); LAG]; SAMPLES];
        (self.doubtful, self.doubt_lag, self.stopped) = (0, 0, false);
        self.settled_doubt = None;
        self.doubts.clear();
        self.milestones.clear();
        self.newest_sent
    }

    fn send_until(&mut self, sent: u64) {
        while self.sent < sent {
            let Some(id) = self.ids.pop_front() else { break };
            self.newest_sent = Some(id);
            self.sent += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A model of the chip's FIFOs, whose answer headers lag by `lag` exchanges.
    struct Fifos {
        ledger: Ledger,
        lag: usize,
        /// The ids in the RxFIFO, and for each cycle in the TxFIFO the newest id sent by then.
        rx: VecDeque<u64>,
        tx: VecDeque<Option<u64>>,
        sent: Option<u64>,
        levels: VecDeque<(u8, u8)>,
        next: u64,
        /// For each cycle that was read: the newest id that the model had really sent, and the id that the ledger gives
        /// for it.
        seen: Vec<(Option<u64>, Option<u64>)>,
    }

    impl Fifos {
        fn new(lag: usize) -> Self {
            let (rx, tx) = (VecDeque::new(), VecDeque::new());
            let levels = VecDeque::from(vec![(0, 0); lag.saturating_sub(1)]);
            Self { ledger: Ledger::new(64), lag, rx, tx, sent: None, levels, next: 1, seen: Vec::new() }
        }

        fn cycle(&mut self) {
            self.sent = self.rx.pop_front().or(self.sent);
            self.tx.push_back(self.sent);
        }

        /// Makes an exchange, which writes and reads. If the header lags by one exchange, its levels are those from
        /// before this exchange.
        fn exchange(&mut self, write: u64, read: usize) {
            let now = (self.rx.len() as u8, self.tx.len() as u8);
            self.levels.push_back(now);
            let level = if self.lag == 0 { None } else { self.levels.pop_front() };
            let ids = self.next..self.next + write;
            self.next += write;
            self.rx.extend(ids.clone());
            let read = read.min(self.tx.len());
            let first = self.ledger.cycles() + 1;
            self.ledger.exchanged(ids, read as u64);
            let (rx, tx) = level.unwrap_or((self.rx.len() as u8, (self.tx.len() - read) as u8));
            self.ledger.header(rx, tx);
            for (cycle, truth) in (first..).zip(self.tx.drain(..read).collect::<Vec<_>>()) {
                let said = self.ledger.sent_in(cycle);
                assert!(said <= truth, "lag {}: cycle {cycle} had sent {truth:?}, not {said:?}", self.lag);
                self.seen.push((truth, said));
            }
        }
    }

    /// XF-19.2 In a stream of one set of outputs per cycle the sent sets are known exactly, whatever the lag of the fill
    /// levels.
    #[test]
    fn a_stream_is_known_exactly() {
        for lag in 0..=2 {
            let mut fifos = Fifos::new(lag);
            for n in 0..200 {
                fifos.exchange(if n == 0 { 4 } else { 1 }, 1);
                fifos.cycle();
            }
            let exact = fifos.seen.iter().skip(10).filter(|(truth, said)| truth == said).count();
            assert_eq!(exact, fifos.seen.len() - 10, "lag {lag}: {:?}", &fifos.seen[..20]);
        }
    }

    /// XF-19.2 When a FIFO runs dry, no set of outputs counts as sent too early, and the last set is known as sent two
    /// cycles later.
    #[test]
    fn a_dry_fifo_is_known_soon() {
        for lag in 0..=2 {
            let mut fifos = Fifos::new(lag);
            fifos.exchange(5, 0);
            for _ in 0..20 {
                fifos.cycle();
                fifos.exchange(0, 1);
            }
            let first = fifos.seen.iter().position(|(_, said)| *said == Some(5)).expect("it is known");
            let truth = fifos.seen.iter().position(|(truth, _)| *truth == Some(5)).expect("it was sent");
            assert!(first - truth <= 3, "lag {lag}: {first} and {truth}");
        }
    }

    /// XF-19.11 If it is not known whether a set of outputs has reached the FIFO that a clear has stopped, the set counts
    /// as if it had.
    #[test]
    fn a_clear_with_a_doubtful_set_goes_not_back() {
        let cleared = |behind: u64, level| {
            let mut ledger = Ledger::new(8);
            ledger.exchanged([1, 2].into_iter(), 0);
            ledger.doubt([3].into_iter());
            ledger.exchanged(4..4 + behind, 0);
            // The first header after a doubtful set may be from before the set, so it decides nothing.
            ledger.header(0, 0);
            ledger.stop();
            ledger.cleared(level)
        };
        assert_eq!([cleared(0, 0), cleared(0, 1), cleared(0, 2)], [Some(3), Some(2), Some(1)]);
        assert_eq!([cleared(2, 0), cleared(2, 1), cleared(2, 2), cleared(2, 3)], [Some(5), Some(4), Some(3), Some(2)]);
        // After the FIFO was empty, the doubtful set was sent, if it had reached the FIFO.
        let mut ledger = Ledger::new(8);
        ledger.doubt([3].into_iter());
        for _ in 0..LAG {
            ledger.exchanged(std::iter::empty(), 1);
            ledger.header(0, 0);
        }
        ledger.exchanged([4].into_iter(), 0);
        ledger.stop();
        assert_eq!(ledger.cleared(1), Some(3));
    }

    /// XF-19.2 Whatever is written and read at any time, no set counts as sent before it was.
    #[test]
    fn nothing_is_claimed_too_early() {
        for seed in 0..3000_u32 {
            let mut fifos = Fifos::new(seed as usize % 3);
            let mut dice = seed;
            for _ in 0..200 {
                dice = dice.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let (write, read, cycles) = (dice >> 16 & 3, dice >> 20 & 3, dice >> 24 & 3);
                if fifos.rx.len() + write as usize <= 32 {
                    fifos.exchange(write.into(), read as usize);
                }
                for _ in 0..cycles {
                    if fifos.tx.len() < 60 {
                        fifos.cycle();
                    }
                }
            }
            for _ in 0..120 {
                fifos.exchange(0, 1);
                fifos.cycle();
            }
            let (truth, said) = fifos.seen.last().expect("there were cycles");
            assert_eq!(truth, said, "seed {seed}");
        }
    }
}
