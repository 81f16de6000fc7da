//! A bus that owns its cycle and takes outputs ahead, as an ECM-XF does: the seam carries one.

use std::collections::VecDeque;

use ecmsk::fieldbus::{AlState, BusError, Busy, CycleDone, Fieldbus, Inputs, Job, JobDone, Ns, Outputs, Pacing};
use ecmsk::sk::CycleTime;

/// Another bus behind a FIFO of outputs and a pipeline of answers.
pub struct AheadBus<B> {
    inner: B,
    depth: u16,
    /// Cycles between outputs being sent and their answer being seen.
    pipeline: usize,
    queue: VecDeque<Outputs>,
    last: Outputs,
    answers: VecDeque<(CycleDone, Inputs)>,
    next: Ns,
    cycle_in_op: CycleTime,
    op: bool,
    going_to: Option<AlState>,
}

impl<B: Fieldbus> AheadBus<B> {
    pub fn new(inner: B, depth: u16, pipeline: usize) -> Self {
        Self {
            inner,
            depth,
            pipeline,
            queue: VecDeque::new(),
            last: Outputs::default(),
            answers: VecDeque::new(),
            // Its clock is its own: a third of a cycle beside ours.
            next: 333_333,
            cycle_in_op: CycleTime::DEFAULT,
            op: false,
            going_to: None,
        }
    }
}

impl<B: Fieldbus> Fieldbus for AheadBus<B> {
    fn pacing(&self) -> Pacing {
        Pacing::Bus { depth: self.depth }
    }

    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy> {
        self.inner.start(job, now)?;
        match job {
            Job::Configure(config) => self.cycle_in_op = config.cycle,
            Job::State { target, .. } => self.going_to = Some(target),
            Job::Scan | Job::Sdo(_) => {}
        }
        Ok(())
    }

    fn poll_job(&mut self, now: Ns) -> Option<JobDone> {
        let done = self.inner.poll_job(now)?;
        if let JobDone::State(Ok(())) = done {
            self.op = self.going_to == Some(AlState::Op);
        }
        Some(done)
    }

    fn cancel_job(&mut self) {
        self.inner.cancel_job();
    }

    fn room(&self) -> u16 {
        if self.inner.room() == 0 { 0 } else { self.depth - self.held() }
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
        if self.room() == 0 {
            return Err(BusError::Full { held: self.held() });
        }
        self.queue.push_back(outputs.clone());
        Ok(())
    }

    fn poll(&mut self, now: Ns, inputs: &mut Inputs) -> Option<CycleDone> {
        if self.next > now {
            return None;
        }
        let at = self.next;
        self.next += if self.op { self.cycle_in_op.ns() } else { CycleTime::DEFAULT.ns() };
        let carried = self.queue.pop_front();
        let id = carried.as_ref().map(|outputs| outputs.id);
        if let Some(outputs) = carried {
            self.last = outputs;
        }
        if self.op {
            self.inner.push(&self.last).ok()?;
        }
        let mut fresh = Inputs::default();
        if let Some((_, newest)) = self.answers.back() {
            fresh.clone_from(newest);
        }
        let done = self.inner.poll(at, &mut fresh)?;
        self.answers.push_back((CycleDone { outputs: id, ..done }, fresh));
        let seen =
            if self.answers.len() > self.pipeline { self.answers.pop_front()? } else { return self.poll(now, inputs) };
        inputs.clone_from(&seen.1);
        Some(CycleDone { at, ..seen.0 })
    }
}
