//! A bus that owns its cycle and takes outputs ahead, as an ECM-XF does: the seam carries one.

use std::collections::VecDeque;

use ecmsk::fieldbus::{
    AlState, BusError, Busy, CycleDone, Fieldbus, Inputs, Job, JobDone, Ns, Outputs, Pacing, SlaveSet,
};
use ecmsk::sk::CycleTime;

/// How a bus differs from another.
#[derive(Clone, Copy, Debug)]
pub struct Ahead {
    /// Outputs it takes ahead.
    pub depth: u16,
    /// Cycles between outputs being sent and their answer being seen.
    pub pipeline: usize,
    /// When its first cycle is: its clock is its own.
    pub phase: Ns,
    /// How much slower its clock is: so much longer than it was told is a cycle.
    pub slower: Ns,
}

/// Another bus behind a FIFO of outputs and a pipeline of answers.
pub struct AheadBus<B> {
    inner: B,
    how: Ahead,
    queue: VecDeque<Outputs>,
    last: Outputs,
    /// What the slaves sent in the newest cycle.
    newest: Inputs,
    answers: VecDeque<(CycleDone, Inputs)>,
    next: Ns,
    cycle_in_op: CycleTime,
    /// Slaves that it brought to OP.
    in_op: SlaveSet,
    moving: Option<(AlState, SlaveSet)>,
}

impl<B: Fieldbus> AheadBus<B> {
    pub fn new(inner: B, how: Ahead) -> Self {
        Self {
            inner,
            how,
            queue: VecDeque::with_capacity(how.depth.into()),
            last: Outputs::default(),
            newest: Inputs::default(),
            answers: VecDeque::with_capacity(how.pipeline + 1),
            next: how.phase,
            cycle_in_op: CycleTime::DEFAULT,
            in_op: SlaveSet::EMPTY,
            moving: None,
        }
    }

    /// Its next cycle passes; `None`: none does, the cable is cut.
    fn pass(&mut self) -> Option<CycleDone> {
        let at = self.next;
        self.next += if self.in_op.is_empty() { CycleTime::DEFAULT } else { self.cycle_in_op }.ns() + self.how.slower;
        let mut id = None;
        if !self.in_op.is_empty() && self.inner.room() > 0 {
            if let Some(outputs) = self.queue.pop_front() {
                id = Some(outputs.id);
                self.last = outputs;
            }
            self.inner.push(&self.last).expect("there is room");
        }
        let done = self.inner.poll(at, &mut self.newest)?;
        Some(CycleDone { outputs: id, ..done })
    }
}

impl<B: Fieldbus> Fieldbus for AheadBus<B> {
    fn pacing(&self) -> Pacing {
        Pacing::Bus { depth: self.how.depth }
    }

    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy> {
        self.inner.start(job, now)?;
        match job {
            Job::Configure(config) => self.cycle_in_op = config.cycle,
            Job::State { target, slaves, .. } => self.moving = Some((target, slaves)),
            Job::Scan => self.in_op = SlaveSet::EMPTY,
            Job::Sdo(_) => {}
        }
        Ok(())
    }

    fn poll_job(&mut self, now: Ns) -> Option<JobDone> {
        let done = self.inner.poll_job(now)?;
        if let (JobDone::State(Ok(())), Some((target, slaves))) = (done, self.moving) {
            if target != AlState::Op {
                self.in_op = self.in_op.difference(slaves);
            } else if self.in_op.is_empty() {
                // What was sent before the slaves left OP is not meant for now.
                self.last = Outputs::default();
                self.in_op = slaves;
            } else {
                self.in_op = self.in_op.union(slaves);
            }
        }
        Some(done)
    }

    fn cancel_job(&mut self) {
        self.inner.cancel_job();
    }

    fn cancel_sdo(&mut self) {
        self.inner.cancel_sdo();
    }

    fn room(&self) -> u16 {
        if self.inner.room() == 0 { 0 } else { self.how.depth - self.held() }
    }

    fn held(&self) -> u16 {
        self.queue.len() as u16
    }

    fn discard_ahead(&mut self) -> u16 {
        let held = self.held();
        self.queue.clear();
        held
    }

    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError> {
        if self.inner.room() == 0 {
            return Err(BusError::Down);
        }
        if self.room() == 0 {
            return Err(BusError::Full { held: self.held() });
        }
        self.queue.push_back(outputs.clone());
        Ok(())
    }

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        while self.next <= now {
            let at = self.next;
            let Some(done) = self.pass() else { continue };
            self.answers.push_back((done, self.newest.clone()));
            // The first cycles after the start have no answer yet.
            if self.answers.len() > self.how.pipeline {
                let (answered, seen) = self.answers.pop_front()?;
                inputs.clone_from(&seen);
                return Some(CycleDone { at, ..answered });
            }
        }
        None
    }
}
