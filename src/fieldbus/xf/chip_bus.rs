//! The state of the bus, except the async function of its running job. It gives the driver commands and process data to
//! exchange, and evaluates the results.

use std::collections::VecDeque;

use super::ahead::Ahead;
use super::answers::{ANSWERS, Answer, IMAGE_MAX};
use super::ask::Asked;
use super::clear::Clearing;
use super::flow::{Flying, Set};
use super::jobs::{Part, Running};
use super::ledger::Ledger;
use super::level::FillLevel;
use super::local_io::PinSetup;
use super::network::Network;
use super::plan::IN_FLIGHT_MAX;
use super::watch::{TakingDown, Watch};
use super::{ANSWER_DELAY, ENTRIES, XfBusCounters, XfBusOptions};
use crate::fieldbus::{AlState, JobDone, MAX_SLAVES, Ns, SdoDone, SdoRequest, SlaveSet};
use crate::xf::host::{COMFORTABLE_SIZE, Host, HostConfig, HostState, StepError, Wires};

/// Without a runner: the maximum time by which a real clock of the wires may be ahead of the engine's time, ns. If it
/// is ahead by more, the engine was not called for a while, and the offset of the two clocks is measured again. \[OURS]
const SKEW_MAX_NS: Ns = 2_000_000;
/// With a runner (`engine::Threaded`): the limit in place of [`SKEW_MAX_NS`], ns. It is longer, because the runner
/// catches up on delays of up to this time. \[OURS]
const LATE_MAX_NS: Ns = 1_000_000_000;
/// The maximum interval at which the chip is polled for the end of a command while no slave is in OP, ns. In OP process
/// data have priority, and the interval is that of the driver's configuration. \[OURS]
const BUSY_POLL_NS: Ns = 200_000;
/// How long after an error the stopped driver is started again, ns. \[OURS]
const RESTART_NS: Ns = 100_000_000;

/// Whether the chip was set to short packets after its start, which makes the many commands on the way to OP faster:
/// [`ChipBus::shorten`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shortening {
    Due,
    UnderWay,
    /// The chip was set to short packets, or keeps its packet size.
    Done,
}

/// The state of the bus, without the async function of the running job. That function has a reference to this state,
/// and locks its mutex while it is polled.
#[derive(Debug)]
pub(super) struct ChipBus<W> {
    pub(super) wires: W,
    pub(super) host: Host,
    pub(super) options: XfBusOptions,
    /// Offset of the engine's clock to the clock of the wires to the chip (engine minus wires), ns; `None`: it was not
    /// measured yet.
    pub(super) skew: Option<Ns>,
    /// Whether a runner drives the bus and passes the engine's time to it. A runner may be late.
    pub(super) has_runner: bool,
    pub(super) network: Network,
    /// Whether a slave is in OP, so that the engine polls the chip's own cycles.
    pub(super) runs: bool,
    pub(super) job: Option<Running>,
    /// A requested configuration that waits for the preparation of the same configuration, which is already laying out
    /// the process data.
    pub(super) next_job: Option<Running>,
    pub(super) ahead: Ahead,
    /// Whether the async function of the job has made progress when it was polled, so that it is polled once more.
    pub(super) has_gone_on: bool,
    /// The AL states of the slaves as the running job has read them last; `None`: no answer.
    pub(super) states: [Option<AlState>; MAX_SLAVES],
    /// Which part of the running job is being executed.
    pub(super) part: Part,
    /// Whether the chip was set to short packets after its start, see [`Self::shorten`].
    pub(super) shortening: Shortening,
    /// The interval at which the chip is polled for the end of a command while slaves are in OP, ns: that of the
    /// driver's configuration, which may be longer so that process data have priority.
    pub(super) busy_poll_in_op_ns: Ns,
    /// The command of the running job whose answer is awaited.
    pub(super) asked: Option<Asked>,
    pub(super) sdo: Option<(SdoRequest, Asked)>,
    pub(super) job_done: Option<JobDone>,
    pub(super) sdo_done: Option<SdoDone>,
    /// Sets of outputs that wait to be written, or are in flight to the chip.
    pub(super) queue: VecDeque<Set>,
    /// The newest set of outputs that was written to the chip, as far as is known. The chip repeats it while its FIFO
    /// is empty. `None`: none was written since the slaves entered OP.
    pub(super) newest_written: Option<Set>,
    /// Whether `newest_written` has to be written once more. Either a slave was lost since then and must not get the
    /// outputs that the chip would repeat, or slaves may not have received the set.
    pub(super) repeat_is_due: bool,
    /// Exchanges of process data in flight, the oldest first.
    pub(super) flying: VecDeque<Flying>,
    /// Whether the newest exchange of process data in OP wrote sets of outputs. If many cycles wait in the chip, the
    /// next exchange then only reads.
    pub(super) wrote_last: bool,
    pub(super) level: FillLevel,
    pub(super) ledger: Ledger,
    pub(super) clearing: Clearing,
    pub(super) answers: VecDeque<Answer>,
    /// Unused buffers for answers, so that an answer needs no allocation.
    pub(super) spare: Vec<Answer>,
    /// How many answers the driver had received when an answer header was evaluated last, so that no header is
    /// evaluated twice.
    pub(super) headers: u64,
    /// How many answers the driver had received when an exchange of process data ended last. Some answers later
    /// ([`SETTLED`](super::clear::SETTLED)) the fill levels in the headers include this exchange.
    pub(super) reported_at: u64,
    pub(super) next_read: Ns,
    /// When the newest received cycle of the chip ran, on the clock of the wires to the chip.
    pub(super) newest_cycle: Ns,
    /// Whether cycles and their inputs may have been lost since `newest_cycle`. When the next cycle is read, the
    /// missing cycles are counted.
    pub(super) gap: bool,
    pub(super) lost_cycles: u32,
    /// The number of sets of outputs that were given up since the newest cycle was polled.
    pub(super) outputs_lost: u32,
    /// When the newest polled cycle ran, on the engine's clock.
    pub(super) told_at: Ns,
    /// The id of the newest outputs that were accepted and dropped while no slave was in OP.
    pub(super) dropped: Option<u64>,
    /// `left_behind`: the number of sets of outputs that were dropped when the last slave left OP.
    /// `newest_left_behind`: the id of the newest of these sets. They count as discarded once the board has called
    /// `clear_ahead`, but as lost if slaves enter OP or outputs are accepted before that.
    pub(super) left_behind: u64,
    pub(super) newest_left_behind: Option<u64>,
    pub(super) newest_inputs: Vec<u8>,
    /// Whether `newest_inputs` are older than the newest polled cycle.
    pub(super) is_held: bool,
    pub(super) watch: Watch,
    /// The lost slaves in the newest inputs that the engine has polled.
    pub(super) told_lost: SlaveSet,
    pub(super) taking_down: TakingDown,
    pub(super) pins: PinSetup,
    /// The levels of the GPIO pins that are local outputs.
    pub(super) local_levels: u16,
    pub(super) stopped_at: Option<Ns>,
    pub(super) counters: XfBusCounters,
}

impl<W: Wires> ChipBus<W> {
    pub(super) fn new(wires: W, config: HostConfig, options: XfBusOptions) -> Self {
        let ahead = options.ahead.clamp(1, XfBusOptions::AHEAD_MAX);
        let busy_poll_in_op_ns = config.busy_poll_ns;
        let busy_poll_ns = busy_poll_in_op_ns.min(BUSY_POLL_NS);
        let host = Host::new(wires.now(), HostConfig { pipelined_writes: true, busy_poll_ns, ..config });
        Self {
            wires,
            host,
            options: XfBusOptions { ahead, ..options },
            skew: None,
            has_runner: false,
            network: Network::new(),
            runs: false,
            job: None,
            next_job: None,
            ahead: Ahead::default(),
            has_gone_on: false,
            states: [None; MAX_SLAVES],
            part: Part::Any,
            shortening: Shortening::Due,
            busy_poll_in_op_ns,
            asked: None,
            sdo: None,
            job_done: None,
            sdo_done: None,
            // One more than the chip's RxFIFO has entries, for a set of outputs that is written a second time.
            queue: VecDeque::with_capacity(ENTRIES + 1),
            newest_written: None,
            repeat_is_due: false,
            flying: VecDeque::with_capacity(IN_FLIGHT_MAX + 1),
            wrote_last: false,
            level: FillLevel::default(),
            // Room for more ids than the chip can hold sets: the id of a sent set stays in the ledger until a later
            // answer shows that the set was sent.
            ledger: Ledger::new(2 * ENTRIES + usize::from(ANSWER_DELAY) + 1),
            clearing: Clearing::Idle,
            answers: VecDeque::with_capacity(ANSWERS),
            spare: (0..ANSWERS).map(|_| Answer::default()).collect(),
            headers: 0,
            reported_at: 0,
            next_read: 0,
            newest_cycle: 0,
            gap: false,
            lost_cycles: 0,
            outputs_lost: 0,
            told_at: 0,
            dropped: None,
            left_behind: 0,
            newest_left_behind: None,
            newest_inputs: vec![0; IMAGE_MAX],
            is_held: false,
            watch: Watch::default(),
            told_lost: SlaveSet::EMPTY,
            taking_down: TakingDown::No,
            pins: PinSetup::Due,
            local_levels: 0,
            stopped_at: None,
            counters: XfBusCounters::default(),
        }
    }

    /// The maximum number of sets of outputs in the chip and in flight to it.
    pub(super) fn depth(&self) -> u16 {
        let Network { transport_sets, entries, .. } = self.network;
        self.options.ahead.saturating_add(transport_sets).min(u16::from(entries).max(1))
    }

    /// The time on the clock of the wires to the chip when the engine's time is `now`. Without a runner the engine's
    /// clock stands still while the engine is not called, but a real clock of the wires does not. The offset of the two
    /// clocks is then measured again.
    pub(super) fn wires_time(&mut self, now: Ns) -> Ns {
        let wires = self.wires.now();
        let skew = *self.skew.get_or_insert(now.wrapping_sub(wires));
        let time = now.wrapping_sub(skew);
        let most = if self.has_runner { LATE_MAX_NS } else { SKEW_MAX_NS };
        if self.options.real_time && wires > time.saturating_add(most) {
            self.skew = Some(now.wrapping_sub(wires));
            return wires;
        }
        time
    }

    pub(super) fn engine_time(&self, at: Ns) -> Ns {
        at.wrapping_add(self.skew.unwrap_or(0))
    }

    /// Handles an error of the driver or of its wires. A driver that has stopped is started again after [`RESTART_NS`].
    pub(super) fn stopped(&mut self, error: &StepError<W::Error>, until: Ns) {
        let at = self.wires.now();
        let since = *self.stopped_at.get_or_insert(at);
        if at.saturating_sub(since) >= RESTART_NS && matches!(error, StepError::Host(_)) {
            // The restart of the driver switches the chip's FIFO off, even if slaves are in OP: everything in it is
            // lost.
            self.lose_all();
            self.taking_down = TakingDown::Due;
            if self.shortening == Shortening::UnderWay {
                // The driver has stopped while the packet size was being changed, so this chip cannot be set to another
                // size and keeps its own.
                self.shortening = Shortening::Done;
                self.host.keep_size();
            }
            self.host.restart(at);
            self.stopped_at = None;
        }
        let _ = self.wires.wait_until(until);
    }

    /// Evaluates received process data and answer headers. Returns false while the slaves are being brought to PreOP or
    /// the packet size is being changed: then the driver cannot be used for anything else.
    pub(super) fn begin_turn(&mut self, now: Ns) -> bool {
        self.take_reports(now);
        self.look_at_header();
        if self.take_down(now) || self.shorten(now) {
            return false;
        }
        self.set_up_pins(now);
        true
    }

    /// Gives the driver its next work except the commands of the job: SDOs, a preparation, a clear, the reading of AL
    /// states, process data.
    pub(super) fn end_turn(&mut self, now: Ns) {
        self.run_sdo();
        self.go_ahead(now);
        self.clear_on(now);
        self.watch_on(now);
        self.feed(now);
    }

    /// Sets the chip to short packets after its start: the way to OP consists of many commands, and each of them is
    /// sent in a packet of its own. A configuration chooses longer packets if process data need them. A size that the
    /// user has chosen is kept. Returns whether the packet size is being changed: the driver is then restarting and
    /// accepts nothing else.
    pub(super) fn shorten(&mut self, now: Ns) -> bool {
        if self.shortening == Shortening::Done || self.host.state() != HostState::Running {
            return false;
        }
        let is_chosen = self.options.size_is_fixed || self.host.config().wanted_size.is_some();
        let shortens = !is_chosen && self.host.size() > COMFORTABLE_SIZE;
        self.shortening = if shortens { Shortening::UnderWay } else { Shortening::Done };
        if shortens {
            self.host.resize(now, COMFORTABLE_SIZE);
        }
        shortens
    }

    /// Whether the driver has stopped after an error. The bus starts it again after [`RESTART_NS`].
    pub(super) fn has_stopped(&self) -> bool {
        matches!(self.host.state(), HostState::Stopped(_))
    }

    /// Called when no slave is in OP any more: the engine stops polling the chip's cycles.
    pub(super) fn leave_op(&mut self) {
        if std::mem::take(&mut self.runs) {
            self.ledger.settle();
        }
        self.host.set_busy_poll_ns(self.busy_poll_in_op_ns.min(BUSY_POLL_NS));
        let newest = self.newest_taken();
        let waited = self.queue.len();
        self.drop_queue();
        let dropped = waited - self.queue.len();
        if std::mem::take(&mut self.repeat_is_due) || dropped > 0 {
            self.left_behind += dropped as u64;
            self.newest_left_behind = newest;
        }
        self.dropped = None;
        while let Some(answer) = self.answers.pop_front() {
            self.spare.push(answer);
        }
    }

    /// Called when the first slaves are in OP and both FIFOs are empty: from now on the engine polls the chip's cycles.
    pub(super) fn enter_op(&mut self) {
        self.lose_left_behind();
        self.host.set_busy_poll_ns(self.busy_poll_in_op_ns);
        self.level.clear();
        self.newest_cycle = self.wires.now();
        (self.runs, self.gap, self.dropped) = (true, false, None);
        self.newest_written = None;
    }

    /// Counts as lost the sets of outputs that were in the chip or waited for it when the last slave left OP: they
    /// reach no slave, and the board has not discarded them by `clear_ahead`.
    pub(super) fn lose_left_behind(&mut self) {
        let newest = self.newest_left_behind.take().max(self.ledger.newest_unsent());
        let sets = std::mem::take(&mut self.left_behind) + self.ledger.ahead();
        self.lose_sets(sets);
        self.ledger.lost_until(newest);
    }

    /// An estimate of the number of sets of outputs in the chip and in the queue.
    pub(super) fn held(&self) -> u64 {
        self.queue.len() as u64 + self.level.sets(self.wires.now(), self.network.cycle.ns())
    }

    pub(super) fn room(&self) -> u16 {
        if self.has_stopped() || self.is_clearing() {
            return 0;
        }
        self.depth().saturating_sub(self.held().min(u16::MAX.into()) as u16)
    }
}
