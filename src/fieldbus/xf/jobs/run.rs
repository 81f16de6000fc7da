//! A job under way: its commands are asked one after the other, with what it waits for in between. An SDO runs beside none.

use super::{Running, Todo, sdo_done};
use crate::ethercat::Ns;
use crate::fieldbus::xf::XfBus;
use crate::fieldbus::xf::ask::Ask;
use crate::xf::host::{HostState, Wires};

impl<W: Wires> XfBus<W> {
    pub(in crate::fieldbus::xf) fn run_job(&mut self, now: Ns) {
        let Some(mut job) = self.job.take() else { return };
        if let Some(ask) = self.pending.take() {
            self.ask(ask, now);
            return self.keep_or_end(job, now);
        }
        let reply = match (&self.asked, job.wait_until) {
            (Some(asked), _) => match asked.reply(&mut self.host) {
                Some(reply) => reply,
                None => return self.keep_or_end(job, now),
            },
            (None, Some(until)) if now < until => return self.keep_or_end(job, now),
            (None, _) if self.is_resizing() || self.is_holding() => return self.keep_or_end(job, now),
            (None, _) => Ok(0),
        };
        self.asked = None;
        job.wait_until = None;
        match self.go_on(&mut job, reply, now) {
            Todo::Ask(ask) => self.ask(ask, now),
            Todo::Wait(until) => job.wait_until = Some(until),
            Todo::Resize(size) => self.host.resize(now, size),
            Todo::Hold => self.send_holding(),
            Todo::Done(_) if job.is_ahead => {
                self.end_ahead();
                self.job = self.next_job.take();
                return;
            }
            Todo::Done(done) => {
                self.ended.push_back(done);
                return;
            }
        }
        self.job = Some(job);
    }

    /// A job that goes on, unless its time is over.
    fn keep_or_end(&mut self, job: Running, now: Ns) {
        match job.late() {
            Some(done) if job.is_late(now) => {
                self.abandon_job();
                self.ended.push_back(done);
            }
            _ => self.job = Some(job),
        }
    }

    fn ask(&mut self, ask: Ask, now: Ns) {
        self.asked = ask.submit(&mut self.host, now).ok();
        self.pending = if self.asked.is_none() { Some(ask) } else { None };
    }

    fn is_resizing(&self) -> bool {
        !matches!(self.host.state(), HostState::Running)
    }

    /// A job ends before its last step. It may have brought the last slave out of OP: the chip has no cycles to tell then.
    pub(in crate::fieldbus::xf) fn abandon_job(&mut self) {
        self.abandon_asked();
        if self.runs && self.network.in_op().is_empty() {
            self.leave_op();
        }
    }

    pub(in crate::fieldbus::xf) fn abandon_asked(&mut self) {
        self.pending = None;
        if let Some(asked) = self.asked.take() {
            asked.abandon(&mut self.host);
        }
    }

    pub(in crate::fieldbus::xf) fn run_sdo(&mut self) {
        let Some((request, asked)) = &self.sdo else { return };
        if let Some(reply) = asked.reply(&mut self.host) {
            self.ended.push_back(sdo_done(request, reply));
            self.sdo = None;
        }
    }
}
