//! A bus that owns its cycle and takes outputs ahead, as an ECM-XF does: either ideal, or with the delays and losses of
//! a real one.

use std::collections::VecDeque;
use std::fmt;

use ecmsk::fieldbus::{
    AlState, BusConfig, BusError, Busy, Cleared, Configured, CycleDone, Fieldbus, Inputs, Job, JobDone, MAX_SLAVES, Ns,
    Outputs, Pacing, RingState, Role, SdoDone, SdoRequest, SlaveSet,
};
use ecmsk::sk::CycleTime;

use crate::dice::Dice;

/// The properties of a bus.
#[derive(Clone, Copy)]
pub struct Ahead {
    /// The most sets of outputs that the bus takes ahead.
    pub depth: u16,
    /// The fewest cycles between sending outputs and seeing their answer.
    pub pipeline: usize,
    /// The time of the bus's first cycle: the bus has its own clock.
    pub phase: Ns,
    /// How much slower the bus's clock is: a cycle is that much longer than configured.
    pub slower: Ns,
    pub honesty: Honesty,
}

impl fmt::Debug for Ahead {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { depth, pipeline, phase, slower, honesty } = self;
        match honesty.seed {
            0 => write!(f, "depth {depth}, pipeline {pipeline}, phase {phase}, slower {slower}"),
            _ => write!(f, "depth {depth}, pipeline {pipeline}, phase {phase}, slower {slower}, {honesty:?}"),
        }
    }
}

/// The delays and losses of a real bus. Zero everywhere: none.
#[derive(Clone, Copy, Debug, Default)]
pub struct Honesty {
    pub seed: u64,
    /// An answer may take up to that many cycles more than `pipeline`; the number varies.
    pub jitter: usize,
    /// Age of the reported fill level, in polls.
    pub stale_looks: usize,
    /// Bytes of the FIFO, which holds fewer sets of outputs if each is larger; 0: always `depth` sets.
    pub bytes: u32,
    /// Polls that a clear takes; it acts after half of them.
    pub clear_looks: u32,
    /// One poll in that many finds no cycle, and the next one finds them all; 0: every poll finds the cycles that have
    /// passed.
    pub blind: u64,
    /// Answers that the bus keeps until they are polled; the oldest is dropped first. 0: all.
    pub keeps: usize,
    /// One answer in that many is lost although there is room; 0: none.
    pub loses: u64,
    /// The bus takes no SDO during a change of state.
    pub refuses_sdo: bool,
    /// Cycles of silence after which a slave is reported as lost.
    pub loss_delay: u64,
    /// A Configure of some slaves makes the others leave OP.
    pub disturbs: bool,
    /// The bus reports no working counter.
    pub uncounted: bool,
}

/// The longest delay of an answer of an honest bus, cycles.
const ANSWER_DELAY: u16 = 64;

impl Ahead {
    /// An ideal bus: everything is reported and done at once.
    pub const fn kind(depth: u16, pipeline: usize, phase: Ns, slower: Ns) -> Self {
        let honesty = Honesty {
            seed: 0,
            jitter: 0,
            stale_looks: 0,
            bytes: 0,
            clear_looks: 0,
            blind: 0,
            keeps: 0,
            loses: 0,
            refuses_sdo: false,
            loss_delay: 0,
            disturbs: false,
            uncounted: false,
        };
        Self { depth, pipeline, phase, slower, honesty }
    }

    /// A bus like a chip at the end of an SPI: all delays and losses, each small.
    pub const fn chip() -> Self {
        let honesty = Honesty {
            seed: 1,
            jitter: 2,
            stale_looks: 2,
            bytes: 0x4000,
            clear_looks: 3,
            blind: 10,
            keeps: 64,
            loses: 0,
            refuses_sdo: false,
            loss_delay: 3,
            disturbs: false,
            uncounted: true,
        };
        Self { depth: 64, pipeline: 2, phase: 333_333, slower: 100, honesty }
    }

    /// A bus like a chip at the end of an SPI: the seed chooses each delay and loss.
    pub fn honest(seed: u64) -> Self {
        let mut dice = Dice(seed ^ 0x686F_6E65_7374_2121);
        let pipeline = dice.pick(&[0, 1, 2, 2, 3, 5, 20]);
        let honesty = Honesty {
            seed,
            jitter: dice.pick(&[0, 1, 2, 4, 40]),
            stale_looks: dice.below(3) as usize,
            bytes: dice.pick(&[0, 512, 0x4000]),
            clear_looks: dice.below(9) as u32,
            blind: dice.pick(&[0, 3, 10, 50]),
            keeps: 64,
            loses: dice.pick(&[0, 0, 50, 1000]),
            refuses_sdo: dice.one_in(2),
            loss_delay: dice.pick(&[0, 1, 5, 40]),
            disturbs: dice.one_in(2),
            uncounted: dice.one_in(2),
        };
        let phase = dice.below(1_000_000);
        Self { depth: dice.pick(&[16, 32, 64]), pipeline, phase, slower: dice.pick(&[0, 100, 2500]), honesty }
    }
}

/// A silent slave.
#[derive(Clone, Copy)]
struct Silence {
    /// The cycle in which the silence began, and the first outputs that the slave missed.
    since: u64,
    outputs: u64,
}

/// A clear under way.
struct Clear {
    looks: u32,
    acts_at: u32,
    done: Option<Cleared>,
}

/// Another bus behind a FIFO of outputs and a queue of answers.
pub struct AheadBus<B> {
    inner: B,
    how: Ahead,
    dice: Dice,
    queue: VecDeque<Outputs>,
    /// Sets of outputs that the FIFO holds with the configured process data.
    depth: u16,
    last: Outputs,
    /// The newest outputs sent.
    sent: Option<u64>,
    /// The inputs of the newest cycle.
    newest: Inputs,
    answers: VecDeque<(CycleDone, Inputs)>,
    /// Answers that are held back now.
    late: usize,
    lost: u32,
    cycles: u64,
    silent: [Option<Silence>; MAX_SLAVES],
    next: Ns,
    /// The time of the newest poll, and whether it finds a cycle.
    looked: Ns,
    finds: bool,
    /// Fill levels at the newest polls, and the sets pushed since the newest one.
    levels: VecDeque<usize>,
    pushed: VecDeque<usize>,
    clear: Option<Clear>,
    cycle_in_op: CycleTime,
    /// Slaves that the bus has brought to OP.
    in_op: SlaveSet,
    /// The job under way, if it is no SDO.
    moving: Option<(AlState, SlaveSet)>,
    /// Slaves that leave OP before these are configured.
    before: Option<(SlaveSet, BusConfig)>,
    disturbed: SlaveSet,
}

impl<B: Fieldbus> AheadBus<B> {
    pub fn new(inner: B, how: Ahead) -> Self {
        let looks = how.honesty.stale_looks + 1;
        Self {
            inner,
            how,
            dice: Dice(how.honesty.seed ^ 0x6469_6365_2121_2121),
            queue: VecDeque::with_capacity(how.depth.into()),
            depth: how.depth,
            last: Outputs::default(),
            sent: None,
            newest: Inputs::default(),
            answers: VecDeque::with_capacity(256),
            late: how.pipeline,
            lost: 0,
            cycles: 0,
            silent: [None; MAX_SLAVES],
            next: how.phase,
            looked: 0,
            finds: true,
            levels: VecDeque::from(vec![0; looks]),
            pushed: VecDeque::from(vec![0; looks]),
            clear: None,
            cycle_in_op: CycleTime::DEFAULT,
            in_op: SlaveSet::EMPTY,
            moving: None,
            before: None,
            disturbed: SlaveSet::EMPTY,
        }
    }

    /// Runs the cycles that are due at `now`, and updates the visible state of the bus.
    fn look(&mut self, now: Ns) {
        if now <= self.looked {
            return;
        }
        self.looked = now;
        while self.next <= now {
            self.pass();
        }
        let Honesty { jitter, blind, .. } = self.how.honesty;
        self.finds = blind == 0 || !self.dice.one_in(blind);
        if jitter > 0 {
            let change = self.dice.below(3);
            let most = self.how.pipeline + jitter;
            self.late = (self.late + change as usize).saturating_sub(1).clamp(self.how.pipeline, most);
        }
        self.levels.pop_front();
        self.levels.push_back(self.queue.len());
        self.pushed.pop_front();
        self.pushed.push_back(0);
        self.clear_on();
    }

    /// Runs the next cycle; none runs while the cable is cut.
    fn pass(&mut self) {
        let at = self.next;
        self.next += if self.in_op.is_empty() { CycleTime::DEFAULT } else { self.cycle_in_op }.ns() + self.how.slower;
        let mut news = false;
        if !self.in_op.is_empty() && self.inner.room() > 0 {
            let outputs = self.queue.front().unwrap_or(&self.last);
            if self.inner.push(outputs).is_ok()
                && let Some(outputs) = self.queue.pop_front()
            {
                news = true;
                self.sent = Some(outputs.id);
                self.last = outputs;
            }
        }
        let Some(done) = self.inner.poll(at, &mut self.newest) else { return };
        self.cycles += 1;
        let mut seen = self.newest.clone();
        self.hide_losses(&mut seen, news);
        let mut done = CycleDone { at, outputs: self.sent, ..done };
        let Honesty { keeps, loses, uncounted, .. } = self.how.honesty;
        if uncounted {
            (done.working_counter, done.expected_working_counter) = (0, 0);
        }
        self.answers.push_back((done, seen));
        if keeps > 0 && self.answers.len() > keeps || loses > 0 && self.dice.one_in(loses) {
            self.lose_answer();
        }
    }

    /// Drops the oldest kept answer.
    fn lose_answer(&mut self) {
        let Some((done, _)) = self.answers.pop_front() else { return };
        let lost = done.answers_lost + 1;
        match self.answers.front_mut() {
            Some((next, _)) => next.answers_lost += lost,
            None => self.lost += lost,
        }
    }

    /// Reports a slave as lost when it has been silent for long enough, with the first outputs that it missed.
    fn hide_losses(&mut self, seen: &mut Inputs, carries_news: bool) {
        let delay = self.how.honesty.loss_delay;
        // A slave that fell silent before any outputs were sent has received none.
        let first = self.sent.map_or(0, |id| if carries_news { id } else { id + 1 });
        for ((slave, silent), lost_from) in (1..).zip(&mut self.silent).zip(&mut seen.lost_from) {
            if !seen.lost.contains(slave) {
                *silent = None;
                continue;
            }
            let began = Silence { since: self.cycles, outputs: first };
            let Silence { since, outputs } = *silent.get_or_insert(began);
            if self.cycles - since < delay {
                seen.lost.remove(slave);
            } else {
                *lost_from = Some(outputs);
            }
        }
    }

    /// Advances a clear by one poll.
    fn clear_on(&mut self) {
        let Some(clear) = &mut self.clear else { return };
        if clear.looks == clear.acts_at && clear.done.is_none() {
            self.queue.clear();
            clear.done = Some(Cleared { newest_sent: self.sent });
        }
        clear.looks = clear.looks.saturating_sub(1);
    }

    fn is_down(&self) -> bool {
        self.inner.room() == 0
    }

    fn start_inner(&mut self, job: Job, now: Ns) -> Result<(), Busy> {
        self.inner.start(job, now)?;
        match job {
            Job::State { target, slaves, .. } => self.moving = Some((target, slaves)),
            Job::Configure(config) => self.configured(&config),
            Job::Scan => self.in_op = SlaveSet::EMPTY,
        }
        Ok(())
    }

    /// Process data are mapped: the FIFO holds fewer sets if they are larger.
    fn configured(&mut self, config: &BusConfig) {
        self.cycle_in_op = config.cycle;
        let bytes: u32 = config.slaves.iter().filter(|slave| slave.role != Role::Unused).map(|_| 6).sum();
        if let Some(holds) = self.how.honesty.bytes.checked_div(bytes)
            && holds > 0
        {
            self.depth = (holds.max(8) as u16).min(self.how.depth);
        }
    }
}

impl<B: Fieldbus> Fieldbus for AheadBus<B> {
    fn pacing(&self) -> Pacing {
        let Honesty { jitter, keeps, .. } = self.how.honesty;
        let answer_delay = if jitter > 0 || keeps > 0 { ANSWER_DELAY } else { self.how.pipeline as u16 };
        Pacing::Bus { depth: self.how.depth, answer_delay }
    }

    fn start_sdo(&mut self, request: SdoRequest, now: Ns) -> Result<(), Busy> {
        if self.before.is_some() || self.how.honesty.refuses_sdo && self.moving.is_some() {
            return Err(Busy);
        }
        self.inner.start_sdo(request, now)
    }

    fn poll_sdo(&mut self, now: Ns) -> Option<SdoDone> {
        self.look(now);
        self.inner.poll_sdo(now)
    }

    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy> {
        if self.before.is_some() || self.how.honesty.refuses_sdo && self.moving.is_some() {
            return Err(Busy);
        }
        if let Job::Configure(config) = job
            && self.how.honesty.disturbs
        {
            let others = self.in_op.difference(config.selected);
            if !others.is_empty() {
                let leave = Job::State { target: AlState::SafeOp, slaves: others, timeout_ns: 1_000_000_000 };
                self.start_inner(leave, now)?;
                self.before = Some((others, config));
                return Ok(());
            }
        }
        self.start_inner(job, now)
    }

    fn poll_job(&mut self, now: Ns) -> Option<JobDone> {
        self.look(now);
        let mut done = self.inner.poll_job(now)?;
        if let JobDone::State(ended) = done
            && let Some((target, slaves)) = self.moving.take()
        {
            if ended.is_err() {
                // A slave that changed its state all the same is seen by its answers.
            } else if target != AlState::Op {
                self.in_op = self.in_op.difference(slaves);
            } else if self.in_op.is_empty() {
                // Outputs that were sent before the slaves left OP are not valid any more.
                self.last = Outputs::default();
                self.in_op = slaves;
            } else {
                self.in_op = self.in_op.union(slaves);
            }
            if let Some((others, config)) = self.before.take() {
                self.disturbed = others;
                self.start_inner(Job::Configure(config), now).expect("nothing else is under way");
                return None;
            }
        }
        if let JobDone::Configure(Ok(Configured { disturbed, .. })) = &mut done {
            *disturbed = std::mem::take(&mut self.disturbed);
        }
        Some(done)
    }

    fn cancel_job(&mut self) {
        self.inner.cancel_job();
        (self.moving, self.before, self.disturbed) = (None, None, SlaveSet::EMPTY);
    }

    fn cancel_sdo(&mut self) {
        self.inner.cancel_sdo();
    }

    fn local_inputs(&self) -> Option<u8> {
        self.inner.local_inputs()
    }

    fn set_local_outputs(&mut self, bits: u8) {
        self.inner.set_local_outputs(bits);
    }

    fn ring(&self) -> Option<RingState> {
        self.inner.ring()
    }

    fn reference_clock(&self) -> Option<u8> {
        self.inner.reference_clock()
    }

    fn room(&self) -> u16 {
        let pushed: usize = self.pushed.iter().sum();
        let seems_held = self.levels[0] + pushed;
        if self.is_down() { 0 } else { self.depth.saturating_sub(seems_held as u16) }
    }

    fn clear_ahead(&mut self, now: Ns) {
        self.look(now);
        let looks = self.how.honesty.clear_looks;
        assert!(self.clear.is_none(), "one clear at a time");
        self.clear = Some(Clear { looks, acts_at: looks.div_ceil(2), done: None });
        if looks == 0 {
            self.clear_on();
        }
    }

    fn poll_clear(&mut self, now: Ns) -> Option<Cleared> {
        self.look(now);
        let clear = self.clear.take_if(|clear| clear.looks == 0)?;
        // Outputs that were pushed before the clear are known to be dropped.
        self.levels.iter_mut().for_each(|level| *level = 0);
        self.pushed.iter_mut().for_each(|pushed| *pushed = 0);
        clear.done
    }

    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError> {
        assert!(self.clear.is_none(), "nothing is pushed while it clears");
        if self.is_down() {
            return Err(BusError::Down);
        }
        if self.queue.len() >= self.depth.into() {
            return Err(BusError::Full);
        }
        self.queue.push_back(outputs.clone());
        *self.pushed.back_mut().expect("there is a newest look") += 1;
        Ok(())
    }

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        self.look(now);
        if !self.finds || self.answers.len() <= self.late {
            return None;
        }
        let (mut done, seen) = self.answers.pop_front()?;
        done.answers_lost += std::mem::take(&mut self.lost);
        inputs.clone_from(&seen);
        Some(done)
    }
}
