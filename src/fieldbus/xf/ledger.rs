//! Which outputs each cycle carried, as the chip's counts tell it.
//!
//! The chip takes a set of outputs out of its RxFIFO in each cycle, if there is one, and puts a set of inputs into its
//! TxFIFO. A header has the fill levels of both at one moment. With `W` sets written and `R` read by then, `W` less the
//! fill level of the RxFIFO have been sent, in as many cycles as `R` and the fill level of the TxFIFO are together. From
//! one such pair follows how many sets had been sent at least in any cycle: no cycle sends more than one, and each sends one
//! while the RxFIFO is not empty.
//!
//! The levels lag behind: which writes and reads they know of is one of the [`LAG`] newest states, so that the least of
//! them counts. What is known never becomes less, and it is late by a cycle at most when the FIFO runs dry.

use std::collections::VecDeque;

/// How many of the newest states of `W` and `R` the levels of a header may belong to (OBS: they lag two exchanges).
const LAG: usize = 3;
/// Headers that are remembered.
const SAMPLES: usize = 4;
/// Milestones that are remembered: as many cycles as the chip keeps.
const MILESTONES: usize = 64;

/// The moment of a header: so many sets had been sent in so many cycles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Moment {
    sent: u64,
    cycles: u64,
    /// Sets that lay in the RxFIFO for sure.
    waiting: u64,
}

impl Moment {
    /// How many sets had been sent at least when that cycle had run.
    fn sent_in(self, cycle: u64) -> u64 {
        match cycle.checked_sub(self.cycles) {
            Some(later) => self.sent + later.min(self.waiting),
            None => self.sent.saturating_sub(self.cycles - cycle),
        }
    }
}

/// What was written and read by some exchange.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct State {
    written: u64,
    read: u64,
}

/// The account of outputs and cycles since the bus was made.
#[derive(Clone, Debug)]
pub(super) struct Ledger {
    /// The newest state is the last one.
    states: [State; LAG],
    /// The moments that each of the newest headers may have been at.
    samples: [[Option<Moment>; LAG]; SAMPLES],
    /// Cycles behind which so many sets had been sent for sure, since the FIFO held no others: with many cycles waiting to
    /// be read, what a header says about them is older than the samples.
    milestones: VecDeque<(u64, u64)>,
    /// Sets that may lie in the RxFIFO beside those that are known, until it was empty.
    doubtful: u64,
    /// Of each of them how many sets that are known were written before it, and its id.
    doubts: VecDeque<(u64, u64)>,
    /// The id of the newest of them that has been sent since, if it came to lie there.
    settled_doubt: Option<u64>,
    /// So many exchanges more may have headers from before the newest of them.
    doubt_lag: usize,
    /// The RxFIFO is stopped, or about to be: cycles that pass send nothing of it for all that is known.
    stopped: bool,
    /// Sets that have been sent for sure.
    sent: u64,
    /// The id of the newest set among them.
    newest_sent: Option<u64>,
    /// The ids of the sets behind those: the first one is that of set `sent`, counted from 0.
    ids: VecDeque<u64>,
}

impl Ledger {
    /// An account that holds so many ids without allocating.
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

    /// Sets with these ids are in the RxFIFO, and so many cycles were read, since the exchange before.
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

    /// Whether the sets with these ids came to lie in the RxFIFO is not known.
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

    /// Headers know all that was written and read.
    pub(super) fn caught_up(&mut self) {
        self.states = [self.newest(); LAG];
    }

    /// A header has these fill levels.
    pub(super) fn header(&mut self, rx_fifo: u8, tx_fifo: u8) {
        let (rx_fifo, tx_fifo) = (u64::from(rx_fifo), u64::from(tx_fifo));
        if rx_fifo == 0 && self.doubt_lag == 0 {
            self.doubtful = 0;
            let newest = self.doubts.drain(..).next_back().map(|(_, id)| id);
            self.settled_doubt = self.settled_doubt.max(newest);
        }
        let (doubtful, stopped) = (self.doubtful, self.stopped);
        let moment = |State { written, read }: State| {
            // More than was written by then cannot lie there.
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

    /// Cycles that were read.
    pub(super) fn cycles(&self) -> u64 {
        self.newest().read
    }

    /// The id of the newest outputs that were sent for sure when that cycle had run. Cycles count from 1, as they are
    /// read; each is asked for once, in their order.
    pub(super) fn sent_in(&mut self, cycle: u64) -> Option<u64> {
        self.send_until(self.sent_at_least(|moment| moment.sent_in(cycle)));
        while let Some((_, sent)) = self.milestones.pop_front_if(|(at, _)| *at <= cycle) {
            self.send_until(sent);
        }
        self.newest_sent
    }

    /// Takes for sent what had been by the newest headers, whatever cycles have come back.
    pub(super) fn settle(&mut self) {
        self.send_until(self.sent_at_least(|moment| moment.sent));
    }

    /// How many sets had been sent for sure, where `sent` says it for the moment of a header.
    fn sent_at_least(&self, sent: impl Fn(&Moment) -> u64) -> u64 {
        let least = |moments: &[Option<Moment>; LAG]| moments.iter().flatten().map(&sent).min();
        self.samples.iter().filter_map(least).max().unwrap_or(0)
    }

    /// Sets that lie in the RxFIFO at most.
    pub(super) fn ahead(&self) -> u64 {
        self.ids.len() as u64
    }

    /// The id of the oldest set that may not have been sent, or that the next one has.
    pub(super) fn next_id(&self) -> u64 {
        let behind = self.newest_sent.map_or(0, |id| id + 1);
        self.ids.front().copied().unwrap_or(behind)
    }

    /// How many of the newest sets the level of a header may not show.
    pub(super) fn unseen(&self) -> u64 {
        self.newest().written - self.states[0].written
    }

    /// The id of the newest set that may lie in the RxFIFO.
    pub(super) fn newest_unsent(&self) -> Option<u64> {
        self.ids.back().copied()
    }

    /// The id of the newest set that has been sent for sure.
    pub(super) const fn newest_sent(&self) -> Option<u64> {
        self.newest_sent
    }

    /// The id of the newest set of which it is not known whether it came to lie in the RxFIFO.
    pub(super) fn newest_doubt(&self) -> Option<u64> {
        self.doubts.back().map(|(_, id)| *id).max(self.settled_doubt)
    }

    /// The RxFIFO is about to be stopped. Cycles go on and their inputs come, but from an unknown one on they send nothing.
    pub(super) fn stop(&mut self) {
        self.stopped = true;
        self.samples.iter_mut().flatten().flatten().for_each(|moment| moment.waiting = 0);
        self.milestones.clear();
    }

    /// The RxFIFO was stopped at this fill level, which has come in a header taken since, and emptied then.
    ///
    /// Where it is not known whether a set came to lie there, it counts as if it did \[OURS]: what is told as the newest that
    /// was sent may be by so many sets too new, and never too old. An axis goes one target on then, and never back to one
    /// that it has left.
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

    /// What lay in the RxFIFO is gone, as after a reset of the chip; whether the oldest of it was sent nobody knows.
    pub(super) fn lost(&mut self) -> Option<u64> {
        let State { read, .. } = self.newest();
        self.forget_unsent(State { written: self.sent, read })
    }

    /// The same, and that set, which was dropped, is not to come either.
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

    /// A chip whose headers are `lag` exchanges old.
    struct Fifos {
        ledger: Ledger,
        lag: usize,
        /// Ids in the RxFIFO, and what the cycles that wait in the TxFIFO had sent.
        rx: VecDeque<u64>,
        tx: VecDeque<Option<u64>>,
        sent: Option<u64>,
        levels: VecDeque<(u8, u8)>,
        next: u64,
        /// Of each cycle read: the truth, and what the account says.
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

        /// The levels before the exchange are those of its header, if it lags by one; then it writes and reads.
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

    /// XF-19.2 A stream of one set a cycle is known to the set, whatever the counts lag.
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

    /// XF-19.2 Of a FIFO that runs dry nothing is claimed that was not sent, and the last set is known two cycles later.
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

    /// XF-19.11 Where nobody knows whether a set came to lie in the FIFO that a clear has stopped, it counts as if it did.
    #[test]
    fn a_clear_with_a_doubtful_set_goes_not_back() {
        let cleared = |behind: u64, level| {
            let mut ledger = Ledger::new(8);
            ledger.exchanged([1, 2].into_iter(), 0);
            ledger.doubt([3].into_iter());
            ledger.exchanged(4..4 + behind, 0);
            // It may be from before the doubtful set.
            ledger.header(0, 0);
            ledger.stop();
            ledger.cleared(level)
        };
        assert_eq!([cleared(0, 0), cleared(0, 1), cleared(0, 2)], [Some(3), Some(2), Some(1)]);
        assert_eq!([cleared(2, 0), cleared(2, 1), cleared(2, 2), cleared(2, 3)], [Some(5), Some(4), Some(3), Some(2)]);
        // Once the FIFO was empty it has been sent, if ever.
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

    /// XF-19.2 Whatever is written and read when, no cycle is said to have sent what it had not.
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
