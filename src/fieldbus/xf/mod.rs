//! A network behind an ECM-XF: the board's jobs as commands of the chip, and its process data through the chip's FIFOs.
//!
//! | file | what it answers |
//! | --- | --- |
//! | `mod.rs` | [`XfBus`], the bus as the engine sees it |
//! | `options.rs` | how it uses its chip: [`XfBusOptions`] |
//! | `jobs.rs`, `jobs/` | scan, configuration and changes of state as sequences of commands, and in `run.rs` how these are asked; `ask.rs`: one command and its answer |
//! | `ahead.rs` | what of a configuration is done before it is asked for |
//! | `flow.rs` | process data: what is written and read in which exchange |
//! | `plan.rs` | how a cycle is held: the packets' size, sets in an exchange, exchanges under way |
//! | `level.rs` | how many sets of outputs lie in the chip, by estimate |
//! | `ledger.rs` | which outputs each cycle carried |
//! | `answers.rs` | what the cycles have sent back, until it is polled |
//! | `clear.rs` | the chip's FIFO is emptied, and what it had sent by then |
//! | `watch.rs` | which slaves are lost, and what a reset of the chip means |
//! | `local_io.rs` | local inputs and outputs at pins of the chip |
//! | `network.rs` | what is known of the network |
//!
//! The bus uses the driver ([`Host`]) over its wires in steps, until the wires' clock has reached the time for which the
//! engine polls. It starts no thread.

mod ahead;
mod answers;
mod ask;
mod clear;
mod flow;
mod jobs;
mod ledger;
mod level;
mod local_io;
mod network;
mod options;
pub mod plan;
mod watch;

use std::collections::VecDeque;

use super::{
    AlState, BusConfig, BusError, Busy, Cleared, CycleDone, Fieldbus, Inputs, Job, JobDone, Ns, Outputs, Pacing,
    SdoRequest, SlaveSet,
};
use crate::sk::CycleTime;
use crate::xf::host::{COMFORTABLE_SIZE, Host, HostConfig, HostState, StepError, Wires};
use ahead::Ahead;
use answers::{ANSWERS, Answer, IMAGE_MAX};
use ask::{Ask, Asked};
use clear::Clearing;
use flow::{Flying, Set};
use jobs::Running;
use ledger::Ledger;
use level::FillLevel;
pub use local_io::LocalPins;
use local_io::PinSetup;
use network::Network;
pub use options::XfBusOptions;
use plan::IN_FLIGHT_MAX;
use watch::{TakingDown, Watch};

/// The most cycles by which an answer is polled late: so many TxPDOs the chip keeps (XF EN 1236). \[OURS]
const ANSWER_DELAY: u16 = 64;
/// The most entries of each FIFO that are asked for; fewer if the chip's memory does not hold them. \[OURS]
const ENTRIES: usize = 64;
/// The memory of both FIFOs, bytes (XF EN 1236).
const FIFO_MEMORY: usize = 0x4000;
/// So many sets are on their way where one follows another: one waits for its exchange, one is under way in it, and one
/// lies in the chip until its next cycle. \[OURS]
const ON_THE_WAY: u64 = 3;
/// By so much a real clock of the wires may be before that of an engine without a runner, until the two are taken for one
/// again. \[OURS]
const SKEW_MAX_NS: Ns = 2_000_000;
/// The same with a runner, which catches up on as much (`engine::Threaded`). \[OURS]
const LATE_MAX_NS: Ns = 1_000_000_000;
/// The longest packet with its idle time takes less at 24 MHz, and two of them hardly more. \[OURS]
const CATCH_UP_NS: Ns = 1_000_000;
/// How often the header is asked for while a command runs and no slave is in OP: in cycles of OP process data go first. \[OURS]
const BUSY_POLL_NS: Ns = 200_000;
/// After the driver has stopped it is started again so much later. \[OURS]
const RESTART_NS: Ns = 100_000_000;

/// Whether the chip was set to short packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shortening {
    Due,
    UnderWay,
    /// It was, or it keeps those that it has.
    Done,
}

/// What a bus has counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct XfBusCounters {
    /// Sets of outputs that the chip has not taken, or of which nobody knows.
    pub sets_lost: u64,
    /// Cycles whose inputs were lost.
    pub cycles_lost: u64,
    /// How often the chip was reset.
    pub chip_resets: u64,
}

/// The entries of each of the chip's FIFOs, 1..=64, with so many bytes of process data in both directions together.
pub fn fifo_entries(process_bytes: usize) -> u8 {
    (FIFO_MEMORY / process_bytes.max(1)).clamp(1, ENTRIES) as u8
}

/// A network behind an ECM-XF.
#[derive(Debug)]
pub struct XfBus<W> {
    wires: W,
    host: Host,
    options: XfBusOptions,
    /// The engine's time less that of the wires; `None`: nobody has called yet.
    skew: Option<Ns>,
    /// A runner tells its time, and may be late.
    has_runner: bool,
    network: Network,
    /// The chip's own cycles are told: a slave is in OP.
    runs: bool,
    job: Option<Running>,
    /// A configuration that begins when what was made of it ahead has ended.
    next_job: Option<Running>,
    ahead: Ahead,
    /// Whether the chip was set to short packets at its start.
    shortening: Shortening,
    /// How often the header is asked for while a command runs beside process data.
    busy_poll_in_op_ns: Ns,
    /// The command of the job under way.
    asked: Option<Asked>,
    /// A command that the driver has not taken yet.
    pending: Option<Ask>,
    sdo: Option<(SdoRequest, Asked)>,
    ended: VecDeque<JobDone>,
    /// Sets that are to be written.
    queue: VecDeque<Set>,
    /// The set that the chip repeats when it has no other, for all that is known; `None`: none was written in this OP.
    newest_written: Option<Set>,
    /// It is to be written once more: a slave was lost since then, or its slaves may not have got it.
    repeat_is_due: bool,
    /// What was handed to the driver, the oldest first.
    flying: VecDeque<Flying>,
    /// The newest exchange of cycles wrote some.
    wrote_last: bool,
    level: FillLevel,
    ledger: Ledger,
    clearing: Clearing,
    answers: VecDeque<Answer>,
    /// Buffers of answers that were polled.
    spare: Vec<Answer>,
    /// The answers that were received when a header was looked at last.
    headers: u64,
    /// Those when the newest process data ended.
    reported_at: u64,
    next_read: Ns,
    /// The newest cycle of the chip that was received, in time of the wires.
    newest_cycle: Ns,
    /// Inputs may have been lost since then.
    gap: bool,
    lost_cycles: u32,
    /// Sets that were given up since the newest cycle was polled.
    outputs_lost: u32,
    /// The newest cycle that was polled, engine time.
    told_at: Ns,
    /// The id of the newest outputs that were taken while the chip had no network.
    dropped: Option<u64>,
    /// Sets that were dropped when the last slave left OP, and the id of the newest of them. The board takes them back with a
    /// clear, unless for it the network stays in OP.
    left_behind: u64,
    newest_left_behind: Option<u64>,
    newest_inputs: Vec<u8>,
    /// They are not those of the newest cycle that was polled.
    is_held: bool,
    watch: Watch,
    /// The slaves that were lost in the newest inputs which were polled.
    told_lost: SlaveSet,
    taking_down: TakingDown,
    pins: PinSetup,
    /// Levels of the chip's pins for the local outputs.
    local_levels: u16,
    stopped_at: Option<Ns>,
    counters: XfBusCounters,
}

impl<W: Wires> XfBus<W> {
    /// The network behind the chip at the end of these wires, which is started.
    pub fn new(wires: W, config: HostConfig, options: XfBusOptions) -> Self {
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
            shortening: Shortening::Due,
            busy_poll_in_op_ns,
            asked: None,
            pending: None,
            sdo: None,
            ended: VecDeque::with_capacity(4),
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

    /// The wires, to look at.
    pub const fn wires(&self) -> &W {
        &self.wires
    }

    /// The wires, to cause trouble.
    pub const fn wires_mut(&mut self) -> &mut W {
        &mut self.wires
    }

    /// The driver, to look at.
    pub const fn host(&self) -> &Host {
        &self.host
    }

    /// What was counted.
    pub const fn counters(&self) -> XfBusCounters {
        self.counters
    }

    /// How many sets of outputs may lie in the chip or be on their way there.
    fn depth(&self) -> u16 {
        let Network { transport_sets, entries, .. } = self.network;
        self.options.ahead.saturating_add(transport_sets).min(u16::from(entries).max(1))
    }

    /// The time of the wires at that time of the engine. Where the wires' clock is a real one and no runner tells its time, the
    /// engine stands still whenever it is not called.
    fn wires_time(&mut self, now: Ns) -> Ns {
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

    fn engine_time(&self, at: Ns) -> Ns {
        at.wrapping_add(self.skew.unwrap_or(0))
    }

    /// Exchanges and waits until that time of the engine.
    fn advance(&mut self, now: Ns) {
        let until = self.wires_time(now);
        self.work(until);
    }

    /// Exchanges and waits until that time of the wires.
    fn work(&mut self, until: Ns) {
        while self.wires.now() < until {
            self.turn();
            match self.host.step(&mut self.wires, until) {
                Ok(()) => self.stopped_at = None,
                Err(error) => {
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
                    if self.wires.now() < until {
                        break;
                    }
                }
            }
        }
        self.turn();
    }

    /// Takes what has ended, and hands the driver what is next.
    fn turn(&mut self) {
        let now = self.wires.now();
        self.take_reports(now);
        self.look_at_header();
        if self.take_down(now) {
            return;
        }
        if self.shorten(now) {
            return;
        }
        self.set_up_pins(now);
        self.run_job(now);
        self.run_sdo();
        self.go_ahead(now);
        self.clear_on(now);
        self.watch_on(now);
        self.feed(now);
    }

    /// Once the chip has started it is set to short packets, since the way to OP is one of many commands, each with packets of its own;
    /// a configuration chooses longer ones where process data need them. Who has chosen an n has chosen it for all. Whether the
    /// driver starts anew for that.
    fn shorten(&mut self, now: Ns) -> bool {
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
    fn has_stopped(&self) -> bool {
        matches!(self.host.state(), HostState::Stopped(_))
    }

    /// Starts the driver, and waits until the chip has answered.
    ///
    /// # Errors
    /// It does not answer, or the wires cannot be used.
    pub fn start_up(&mut self) -> Result<(), StepError<W::Error>> {
        while self.host.state() != HostState::Running {
            self.host.step(&mut self.wires, Ns::MAX)?;
        }
        Ok(())
    }

    /// No slave is in OP any more.
    fn leave_op(&mut self) {
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
    fn enter_op(&mut self) {
        self.lose_left_behind();
        self.host.set_busy_poll_ns(self.busy_poll_in_op_ns);
        self.level.clear();
        self.newest_cycle = self.wires.now();
        (self.runs, self.gap, self.dropped) = (true, false, None);
        self.newest_written = None;
    }

    /// What lay in the chip and what waited for it when the last slave left OP reaches nobody, and the board has not taken
    /// it back.
    fn lose_left_behind(&mut self) {
        let newest = self.newest_left_behind.take().max(self.ledger.newest_unsent());
        let sets = std::mem::take(&mut self.left_behind) + self.ledger.ahead();
        self.lose_sets(sets);
        self.ledger.lost_until(newest);
    }
}

impl<W: Wires + Send> Fieldbus for XfBus<W> {
    fn pacing(&self) -> Pacing {
        Pacing::Bus { depth: ENTRIES as u16, answer_delay: ANSWER_DELAY }
    }

    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy> {
        let at = self.wires_time(now);
        match job {
            Job::Sdo(request) => {
                if self.sdo.is_some() || !self.make_way() {
                    return Err(Busy);
                }
                self.note_sdo(&request);
                let SdoRequest { slave, object, write, timeout_ns } = request;
                let ask = match write {
                    None => Ask::Upload { slave, object, timeout_ns },
                    Some((size, value)) => Ask::Download { slave, object, size, value, timeout_ns },
                };
                match ask.submit(&mut self.host, at) {
                    Ok(asked) => self.sdo = Some((request, asked)),
                    Err(error) => self.ended.push_back(jobs::sdo_done(&request, Err(error))),
                }
            }
            Job::Configure(config) if self.job.as_ref().is_some_and(|job| job.is_ahead && job.lays_out(&config)) => {
                self.next_job = Running::new(job, at);
            }
            _ if self.sdo.is_some() || !self.make_way() => return Err(Busy),
            job => {
                self.end_ahead();
                if matches!(job, Job::State { target, .. } if target <= AlState::PreOp) {
                    // [OURS] Each way up to SafeOP has a layout of its own, as makers' drivers have it.
                    self.network.laid_out = false;
                }
                self.job = Running::new(job, at);
            }
        }
        Ok(())
    }

    fn prepare(&mut self, config: &BusConfig, _now: Ns) {
        self.declare(config);
    }

    fn poll_job(&mut self, now: Ns) -> Option<JobDone> {
        self.advance(now);
        self.ended.pop_front()
    }

    fn cancel_job(&mut self) {
        (self.job, self.next_job) = (None, None);
        self.abandon_job();
        self.ended.retain(|done| matches!(done, JobDone::Sdo(_)));
    }

    fn cancel_sdo(&mut self) {
        if let Some((_, asked)) = self.sdo.take() {
            asked.abandon(&mut self.host);
        }
        self.ended.retain(|done| !matches!(done, JobDone::Sdo(_)));
    }

    fn room(&self) -> u16 {
        if self.has_stopped() || self.is_clearing() {
            return 0;
        }
        let held = self.queue.len() as u64 + self.level.sets(self.wires.now(), self.network.cycle.ns());
        self.depth().saturating_sub(held.min(u16::MAX.into()) as u16)
    }

    fn held_estimate(&self) -> Option<u64> {
        let held = self.queue.len() as u64 + self.level.sets(self.wires.now(), self.network.cycle.ns());
        Some(held.saturating_sub(ON_THE_WAY))
    }

    fn clear_ahead(&mut self, _now: Ns) {
        self.begin_clear();
    }

    fn poll_clear(&mut self, now: Ns) -> Option<Cleared> {
        self.advance(now);
        self.take_cleared()
    }

    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError> {
        if self.has_stopped() {
            return Err(BusError::Down);
        }
        if self.room() == 0 {
            return Err(BusError::Full);
        }
        let set = self.set_of(outputs);
        self.queue.push_back(set);
        Ok(())
    }

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        self.advance(now);
        if self.has_stopped() {
            return None;
        }
        let done = if self.runs { self.next_answer(now) } else { self.next_tick(now) }?;
        self.fill(inputs);
        self.told_lost = self.network.lost;
        Some(done)
    }

    fn work_until(&mut self, now: Ns, until: Ns) {
        let wires = self.wires.now();
        if self.options.real_time {
            (self.skew, self.has_runner) = (Some(now.wrapping_sub(wires)), true);
        }
        // [OURS] A late runner gives the wires the time of a cycle with each part that it catches up on, or that of two
        // exchanges: after a stall what lies in the chip is topped up at once, and a machine that is too slow for its cycles
        // has exchanges all the same.
        let behind_ns = self.network.cycle.ns().min(CATCH_UP_NS);
        let until = if now < until { self.wires_time(until) } else { wires.saturating_add(behind_ns) };
        self.work(until);
    }

    fn is_down(&self) -> bool {
        self.has_stopped()
    }

    fn local_inputs(&self) -> Option<u8> {
        self.take_local_inputs()
    }

    fn set_local_outputs(&mut self, bits: u8) {
        self.put_local_outputs(bits);
    }

    fn reference_clock(&self) -> Option<u8> {
        self.network.with_dc.iter().next()
    }
}

/// The cycle that is told while the chip has none, as the board's before OP.
const fn tick_ns() -> Ns {
    CycleTime::DEFAULT.ns()
}
