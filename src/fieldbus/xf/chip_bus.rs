//! All of the bus but the sequence of its job: what the driver is to do next, and what has come of it.

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

/// By so much a real clock of the wires may be before that of an engine without a runner, until the two are taken for one
/// again. \[OURS]
const SKEW_MAX_NS: Ns = 2_000_000;
/// The same with a runner, which catches up on as much (`engine::Threaded`). \[OURS]
const LATE_MAX_NS: Ns = 1_000_000_000;
/// How often the header is asked for while a command runs and no slave is in OP: in cycles of OP process data go first. \[OURS]
const BUSY_POLL_NS: Ns = 200_000;
/// After the driver has stopped it is started again so much later. \[OURS]
const RESTART_NS: Ns = 100_000_000;

/// Whether the chip was set to short packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shortening {
    Due,
    UnderWay,
    /// It was, or it keeps those that it has.
    Done,
}

/// The bus without the sequence of its job, which reaches it by a mutex.
#[derive(Debug)]
pub(super) struct ChipBus<W> {
    pub(super) wires: W,
    pub(super) host: Host,
    pub(super) options: XfBusOptions,
    /// The engine's time less that of the wires; `None`: nobody has called yet.
    pub(super) skew: Option<Ns>,
    /// A runner tells its time, and may be late.
    pub(super) has_runner: bool,
    pub(super) network: Network,
    /// The chip's own cycles are told: a slave is in OP.
    pub(super) runs: bool,
    pub(super) job: Option<Running>,
    /// A configuration that begins when what was made of it ahead has ended.
    pub(super) next_job: Option<Running>,
    pub(super) ahead: Ahead,
    /// Its sequence has gone on in this turn.
    pub(super) has_gone_on: bool,
    /// The slaves' states as the job has read them last; `None`: no answer.
    pub(super) states: [Option<AlState>; MAX_SLAVES],
    /// What of it is under way.
    pub(super) part: Part,
    /// Whether the chip was set to short packets at its start.
    pub(super) shortening: Shortening,
    /// How often the header is asked for while a command runs beside process data.
    pub(super) busy_poll_in_op_ns: Ns,
    /// The command of the job under way.
    pub(super) asked: Option<Asked>,
    pub(super) sdo: Option<(SdoRequest, Asked)>,
    pub(super) job_done: Option<JobDone>,
    pub(super) sdo_done: Option<SdoDone>,
    /// Sets that are to be written.
    pub(super) queue: VecDeque<Set>,
    /// The set that the chip repeats when it has no other, for all that is known; `None`: none was written in this OP.
    pub(super) newest_written: Option<Set>,
    /// It is to be written once more: a slave was lost since then, or its slaves may not have got it.
    pub(super) repeat_is_due: bool,
    /// What was handed to the driver, the oldest first.
    pub(super) flying: VecDeque<Flying>,
    /// The newest exchange of cycles wrote some.
    pub(super) wrote_last: bool,
    pub(super) level: FillLevel,
    pub(super) ledger: Ledger,
    pub(super) clearing: Clearing,
    pub(super) answers: VecDeque<Answer>,
    /// Buffers of answers that were polled.
    pub(super) spare: Vec<Answer>,
    /// The answers that were received when a header was looked at last.
    pub(super) headers: u64,
    /// Those when the newest process data ended.
    pub(super) reported_at: u64,
    pub(super) next_read: Ns,
    /// The newest cycle of the chip that was received, in time of the wires.
    pub(super) newest_cycle: Ns,
    /// Inputs may have been lost since then.
    pub(super) gap: bool,
    pub(super) lost_cycles: u32,
    /// Sets that were given up since the newest cycle was polled.
    pub(super) outputs_lost: u32,
    /// The newest cycle that was polled, engine time.
    pub(super) told_at: Ns,
    /// The id of the newest outputs that were taken while the chip had no network.
    pub(super) dropped: Option<u64>,
    /// Sets that were dropped when the last slave left OP, and the id of the newest of them. The board takes them back with a
    /// clear, unless for it the network stays in OP.
    pub(super) left_behind: u64,
    pub(super) newest_left_behind: Option<u64>,
    pub(super) newest_inputs: Vec<u8>,
    /// They are not those of the newest cycle that was polled.
    pub(super) is_held: bool,
    pub(super) watch: Watch,
    /// The slaves that were lost in the newest inputs which were polled.
    pub(super) told_lost: SlaveSet,
    pub(super) taking_down: TakingDown,
    pub(super) pins: PinSetup,
    /// Levels of the chip's pins for the local outputs.
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
            // One more for a set of our own.
            queue: VecDeque::with_capacity(ENTRIES + 1),
            newest_written: None,
            repeat_is_due: false,
            flying: VecDeque::with_capacity(IN_FLIGHT_MAX + 1),
            wrote_last: false,
            level: FillLevel::default(),
            // Whether a set was sent is known as late as an answer comes, however few lie in the chip.
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

    /// How many sets of outputs may lie in the chip or be on their way there.
    pub(super) fn depth(&self) -> u16 {
        let Network { transport_sets, entries, .. } = self.network;
        self.options.ahead.saturating_add(transport_sets).min(u16::from(entries).max(1))
    }

    /// The time of the wires at that time of the engine. Where the wires' clock is a real one and no runner tells its time, the
    /// engine stands still whenever it is not called.
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

    /// The driver has stopped with that error, or its wires have. In the end it is started again.
    pub(super) fn stopped(&mut self, error: &StepError<W::Error>, until: Ns) {
        let at = self.wires.now();
        let since = *self.stopped_at.get_or_insert(at);
        if at.saturating_sub(since) >= RESTART_NS && matches!(error, StepError::Host(_)) {
            // The start switches the chip's FIFO off, whatever the slaves do.
            self.lose_all();
            self.taking_down = TakingDown::Due;
            if self.shortening == Shortening::UnderWay {
                // It cannot be set to other packets.
                self.shortening = Shortening::Done;
                self.host.keep_size();
            }
            self.host.restart(at);
            self.stopped_at = None;
        }
        let _ = self.wires.wait_until(until);
    }

    /// Takes what has ended. False: the driver has to do something else before anything is asked of it.
    pub(super) fn begin_turn(&mut self, now: Ns) -> bool {
        self.take_reports(now);
        self.look_at_header();
        if self.take_down(now) || self.shorten(now) {
            return false;
        }
        self.set_up_pins(now);
        true
    }

    /// Hands the driver what is next beside the job.
    pub(super) fn end_turn(&mut self, now: Ns) {
        self.run_sdo();
        self.go_ahead(now);
        self.clear_on(now);
        self.watch_on(now);
        self.feed(now);
    }

    /// Once the chip has started it is set to short packets, since the way to OP is one of many commands, each with packets of its own;
    /// a configuration chooses longer ones where process data need them. Who has chosen an n has chosen it for all. Whether the
    /// driver starts anew for that.
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

    /// The driver has given up, and is started again some time later.
    pub(super) fn has_stopped(&self) -> bool {
        matches!(self.host.state(), HostState::Stopped(_))
    }

    /// No slave is in OP any more.
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

    /// The first slaves are in OP and both FIFOs are empty: from now on the chip's cycles are told.
    pub(super) fn enter_op(&mut self) {
        self.lose_left_behind();
        self.host.set_busy_poll_ns(self.busy_poll_in_op_ns);
        self.level.clear();
        self.newest_cycle = self.wires.now();
        (self.runs, self.gap, self.dropped) = (true, false, None);
        self.newest_written = None;
    }

    /// What lay in the chip and what waited for it when the last slave left OP reaches nobody, and the board has not taken
    /// it back.
    pub(super) fn lose_left_behind(&mut self) {
        let newest = self.newest_left_behind.take().max(self.ledger.newest_unsent());
        let sets = std::mem::take(&mut self.left_behind) + self.ledger.ahead();
        self.lose_sets(sets);
        self.ledger.lost_until(newest);
    }

    /// Sets that lie in the chip or wait for it, by estimate.
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
