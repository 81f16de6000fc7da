//! A bus that says when its jobs begin and end.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use ecmsk::fieldbus::{AlState, BusConfig, BusError, Busy, Fieldbus, Job, JobDone, Ns, Outputs, SdoRequest, SlaveSet};

use support::hand_on;

/// A job and its times.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    pub job: Job,
    pub began: Ns,
    pub ended: Option<Ns>,
}

/// Every job a bus was given, in order; clones see the same ones.
#[derive(Clone, Default)]
pub struct Spans(Arc<Mutex<Vec<Span>>>, Arc<AtomicU32>, Arc<AtomicU64>, Arc<Mutex<Outputs>>);

impl Spans {
    /// The bus is busy that often when it is to start something.
    pub fn be_busy(&self, times: u32) {
        self.1.store(times, Ordering::Relaxed);
    }

    /// Sets of outputs that it took.
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
            Job::Sdo(request) => Some((request, *span)),
            _ => None,
        });
        transfers.collect()
    }

    /// How many there were.
    pub fn len(&self) -> usize {
        self.0.lock().unwrap().len()
    }

    /// What the last change from PreOP to SafeOP configured.
    pub fn configured(&self) -> BusConfig {
        let spans = self.0.lock().unwrap();
        let newest = spans.iter().rev().find_map(|span| match span.job {
            Job::Configure(config) => Some(config),
            _ => None,
        });
        newest.expect("nothing was configured")
    }

    /// The changes of state.
    pub fn moves(&self) -> Vec<(AlState, SlaveSet)> {
        let spans = self.0.lock().unwrap();
        let moves = spans.iter().filter_map(|span| match span.job {
            Job::State { target, slaves, .. } => Some((target, slaves)),
            _ => None,
        });
        moves.collect()
    }

    /// The job under way.
    pub fn under_way(&self) -> Option<Job> {
        self.0.lock().unwrap().last().filter(|span| span.ended.is_none()).map(|span| span.job)
    }
}

/// Another bus, watched.
pub struct Watch<B> {
    inner: B,
    spans: Spans,
}

impl<B: Fieldbus> Watch<B> {
    pub fn new(inner: B) -> (Self, Spans) {
        let spans = Spans::default();
        (Self { inner, spans: spans.clone() }, spans)
    }

    /// The same watch on a bus that stands in the place of that one.
    pub fn over<C: Fieldbus>(self, change: impl FnOnce(B) -> C) -> Watch<C> {
        Watch { inner: change(self.inner), spans: self.spans }
    }

    /// The SDO under way, or the other job, ends; `None`: it is cancelled.
    fn end(&mut self, is_sdo: bool, now: Option<Ns>) {
        let mut spans = self.spans.0.lock().unwrap();
        let newest = spans.iter_mut().rev().find(|span| matches!(span.job, Job::Sdo(_)) == is_sdo);
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
        if self.spans.1.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| n.checked_sub(1)).is_ok() {
            return Err(Busy);
        }
        self.inner.start(job, now)?;
        self.spans.0.lock().unwrap().push(Span { job, began: now, ended: None });
        Ok(())
    }

    fn poll_job(&mut self, now: Ns) -> Option<JobDone> {
        let done = self.inner.poll_job(now)?;
        self.end(matches!(done, JobDone::Sdo(_)), Some(now));
        Some(done)
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
