//! A bus that records when its jobs begin and end.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use ecmsk::fieldbus::{
    AlState, BusConfig, BusError, Busy, Fieldbus, Job, JobDone, Ns, Outputs, SdoDone, SdoRequest, SlaveSet,
};

use support::hand_on;

/// A job or SDO that a bus has started.
#[derive(Clone, Copy, Debug)]
pub enum Started {
    Job(Job),
    Sdo(SdoRequest),
}

/// A job or an SDO and its times.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    pub job: Started,
    pub began: Ns,
    pub ended: Option<Ns>,
}

/// Every job of a bus, in order; clones share the record.
#[derive(Clone, Default)]
pub struct Spans(Arc<Mutex<Vec<Span>>>, Arc<AtomicU32>, Arc<AtomicU64>, Arc<Mutex<Outputs>>);

impl Spans {
    /// Makes the bus busy for that many starts of jobs.
    pub fn be_busy(&self, times: u32) {
        self.1.store(times, Ordering::Relaxed);
    }

    /// The number of sets of outputs that it took.
    pub fn pushes(&self) -> u64 {
        self.2.load(Ordering::Relaxed)
    }

    /// The newest outputs that it took.
    pub fn outputs(&self) -> Outputs {
        self.3.lock().unwrap().clone()
    }

    /// The SDO transfers.
    pub fn transfers(&self) -> Vec<(SdoRequest, Span)> {
        let spans = self.0.lock().unwrap();
        let transfers = spans.iter().filter_map(|span| match span.job {
            Started::Sdo(request) => Some((request, *span)),
            _ => None,
        });
        transfers.collect()
    }

    /// The number of jobs.
    pub fn len(&self) -> usize {
        self.0.lock().unwrap().len()
    }

    /// The configuration of the last change from PreOP to SafeOP.
    pub fn configured(&self) -> BusConfig {
        let spans = self.0.lock().unwrap();
        let newest = spans.iter().rev().find_map(|span| match span.job {
            Started::Job(Job::Configure(config)) => Some(config),
            _ => None,
        });
        newest.expect("nothing was configured")
    }

    /// The changes of state.
    pub fn moves(&self) -> Vec<(AlState, SlaveSet)> {
        let spans = self.0.lock().unwrap();
        let moves = spans.iter().filter_map(|span| match span.job {
            Started::Job(Job::State { target, slaves, .. }) => Some((target, slaves)),
            _ => None,
        });
        moves.collect()
    }

    /// The job under way.
    pub fn under_way(&self) -> Option<Started> {
        self.0.lock().unwrap().last().filter(|span| span.ended.is_none()).map(|span| span.job)
    }
}

/// A wrapper that watches another bus.
pub struct Watch<B> {
    inner: B,
    spans: Spans,
}

impl<B: Fieldbus> Watch<B> {
    pub fn new(inner: B) -> (Self, Spans) {
        let spans = Spans::default();
        (Self { inner, spans: spans.clone() }, spans)
    }

    /// The same watch on a bus that replaces that one.
    pub fn over<C: Fieldbus>(self, change: impl FnOnce(B) -> C) -> Watch<C> {
        Watch { inner: change(self.inner), spans: self.spans }
    }

    /// Records a start, unless the test makes the bus busy.
    fn started(&mut self, job: Started, now: Ns) -> Result<(), Busy> {
        if self.spans.1.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| n.checked_sub(1)).is_ok() {
            return Err(Busy);
        }
        match job {
            Started::Job(job) => self.inner.start(job, now)?,
            Started::Sdo(request) => self.inner.start_sdo(request, now)?,
        }
        self.spans.0.lock().unwrap().push(Span { job, began: now, ended: None });
        Ok(())
    }

    /// Records the end of the SDO under way, or of the other job; `None`: it is cancelled.
    fn end(&mut self, is_sdo: bool, now: Option<Ns>) {
        let mut spans = self.spans.0.lock().unwrap();
        let newest = spans.iter_mut().rev().find(|span| matches!(span.job, Started::Sdo(_)) == is_sdo);
        if let Some(span) = newest {
            span.ended = span.ended.or(now).or(Some(span.began));
        }
    }
}

impl<B: Fieldbus> Fieldbus for Watch<B> {
    hand_on!(inner: pacing, prepare, room, clear_ahead, poll_clear, poll);

    fn push(&mut self, outputs: &Outputs) -> Result<(), BusError> {
        self.spans.2.fetch_add(1, Ordering::Relaxed);
        self.spans.3.lock().unwrap().clone_from(outputs);
        self.inner.push(outputs)
    }

    fn start(&mut self, job: Job, now: Ns) -> Result<(), Busy> {
        self.started(Started::Job(job), now)
    }

    fn start_sdo(&mut self, request: SdoRequest, now: Ns) -> Result<(), Busy> {
        self.started(Started::Sdo(request), now)
    }

    fn poll_job(&mut self, now: Ns) -> Option<JobDone> {
        self.inner.poll_job(now).inspect(|_| self.end(false, Some(now)))
    }

    fn poll_sdo(&mut self, now: Ns) -> Option<SdoDone> {
        self.inner.poll_sdo(now).inspect(|_| self.end(true, Some(now)))
    }

    fn cancel_job(&mut self) {
        self.inner.cancel_job();
        self.end(false, None);
    }

    fn cancel_sdo(&mut self) {
        self.inner.cancel_sdo();
        self.end(true, None);
    }
}
