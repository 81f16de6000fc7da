//! Runs a job: its future is polled until it has ended or the job's timeout is over. No SDO runs beside a job.

use std::task::{Context, Poll, Waker};

use parking_lot::MutexGuard;

use super::{Running, Sequence, sdo_done};
use crate::ethercat::Ns;
use crate::fieldbus::xf::chip_bus::ChipBus;
use crate::fieldbus::{Job, JobDone, Refusal};
use crate::xf::host::{HostState, Wires};

/// Polls the future of the running job as long as the chip's answers let it make progress.
pub(in crate::fieldbus::xf) fn run_job<W: Wires>(
    bus: &mut MutexGuard<'_, ChipBus<W>>,
    sequence: &mut Sequence,
    now: Ns,
) {
    let Some(mut job) = bus.job.take() else { return };
    bus.has_gone_on = !job.has_begun;
    if !job.has_begun {
        if !bus.is_free() {
            return bus.keep_or_end(job, now);
        }
        job.has_begun = true;
        sequence.begin((job.job, job.is_ahead));
    }
    match MutexGuard::unlocked(bus, || sequence.poll(&mut Context::from_waker(Waker::noop()))) {
        Poll::Ready(_) if job.is_ahead => {
            bus.end_ahead();
            let next = bus.next_job.take();
            bus.begin_job(next);
        }
        Poll::Ready(done) => bus.job_done = Some(done),
        Poll::Pending if bus.has_gone_on => bus.job = Some(job),
        Poll::Pending => bus.keep_or_end(job, now),
    }
}

impl<W: Wires> ChipBus<W> {
    /// Whether the driver accepts a command of a job now.
    pub(super) fn is_free(&self) -> bool {
        self.host.state() == HostState::Running && !self.is_holding()
    }

    /// Keeps a job running, or ends it with its result if its timeout is over.
    fn keep_or_end(&mut self, job: Running, now: Ns) {
        match self.late(&job) {
            Some(done) if now >= job.deadline => {
                self.abandon_job();
                self.job_done = Some(done);
            }
            _ => self.job = Some(job),
        }
    }

    /// The result of a change of state whose timeout is over; `None` for other jobs, which have no timeout.
    fn late(&self, job: &Running) -> Option<JobDone> {
        let Job::State { target, slaves, .. } = job.job else { return None };
        let slave = slaves.iter().find(|slave| self.state(*slave) != Some(target));
        Some(slave.map_or_else(|| job.cut_off(), |slave| JobDone::State(Err(Refusal::no_answer(slave)))))
    }

    /// Ends a job that is not complete. If the job has brought the last slave out of OP, the chip's cycles are no longer
    /// polled.
    pub(in crate::fieldbus::xf) fn abandon_job(&mut self) {
        self.abandon_asked();
        if self.runs && self.network.in_op().is_empty() {
            self.leave_op();
        }
    }

    pub(in crate::fieldbus::xf) fn abandon_asked(&mut self) {
        if let Some(asked) = self.asked.take() {
            asked.abandon(&mut self.host);
        }
    }

    pub(in crate::fieldbus::xf) fn run_sdo(&mut self) {
        let Some((request, asked)) = &self.sdo else { return };
        if let Some(reply) = asked.reply(&mut self.host) {
            self.sdo_done = Some(sdo_done(request, reply));
            self.sdo = None;
        }
    }
}
