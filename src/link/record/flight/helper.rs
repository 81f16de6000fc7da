//! Runs the [`Keeper`], on a thread of its own or on the recorder's thread.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::keeper::{Done, Job, Keeper};
use crate::link::record::SYNC_EVERY;
use crate::threads;

/// How long the end of a recording waits until the last moment is kept. A moment that is not kept by then will be kept
/// when the folder is opened again. \[OURS]
const END_WAIT_MAX: Duration = Duration::from_secs(10);

/// The message to the user if the keeper's thread has panicked. Segments are still written without it.
const PANICKED: &str =
    "the thread that keeps moments and syncs to the disk has failed; open the board again, and report it";

/// A message to the keeper's thread.
pub(super) enum Message {
    Job(Job),
    /// The keeper has to tick at once, and to send on this channel when the tick is done.
    Tick(Sender<()>),
}

pub(super) enum Helper {
    /// The keeper runs on the recorder's thread. This is for a virtual clock: programs may wait for the disk there, and
    /// the files of two equal runs must be equal. `ticked` is the time of the last tick; `None` in tests, which tick
    /// themselves.
    Here { keeper: Box<Keeper>, ticked: Option<Instant>, done: Vec<Done> },
    /// The keeper runs on a thread of its own.
    Thread { jobs: Option<Sender<Message>>, done: Receiver<Done>, thread: Option<JoinHandle<()>> },
}

impl Helper {
    pub fn here(keeper: Keeper, ticks: bool) -> Self {
        Self::Here { keeper: Box::new(keeper), ticked: ticks.then(Instant::now), done: Vec::new() }
    }

    /// # Errors
    /// The system provides no thread.
    pub fn thread(mut keeper: Keeper) -> std::io::Result<Self> {
        let (jobs, to_do) = channel();
        let (tell, done) = channel();
        let work = move || {
            // Sending fails if the recorder's thread has ended. Then nobody needs the report.
            let mut report = |done| drop(tell.send(done));
            if catch_unwind(AssertUnwindSafe(|| work(&mut keeper, &to_do, &mut report))).is_err() {
                report(Done::NotKept(PANICKED.to_owned()));
            }
        };
        let thread = threads::spawn("ecmsk-flight", work)?;
        Ok(Self::Thread { jobs: Some(jobs), done, thread: Some(thread) })
    }

    /// Gives the keeper a job.
    pub fn post(&mut self, job: Job) {
        match self {
            Self::Here { keeper, done, .. } => keeper.work(job, &mut |what| done.push(what)),
            Self::Thread { jobs, .. } => {
                // The thread runs until this sender is dropped. So sending fails only after a panic, which was reported
                // already.
                let _ = jobs.as_ref().map(|jobs| jobs.send(Message::Job(job)));
            }
        }
    }

    /// The results that the keeper has reported since the last call.
    pub fn done(&mut self) -> Vec<Done> {
        match self {
            Self::Here { keeper, ticked, done } => {
                if let Some(at) = ticked.as_mut().filter(|at| at.elapsed() >= SYNC_EVERY) {
                    *at = Instant::now();
                    keeper.tick(&mut |what| done.push(what));
                }
                std::mem::take(done)
            }
            Self::Thread { done, .. } => done.try_iter().collect(),
        }
    }

    /// Lets the keeper sync and look for marks at once. Called by tests and at the end of a recording.
    pub fn tick(&mut self) {
        match self {
            Self::Here { keeper, done, .. } => keeper.tick(&mut |what| done.push(what)),
            Self::Thread { jobs, .. } => {
                let (over, is_over) = channel();
                if jobs.as_ref().is_some_and(|jobs| jobs.send(Message::Tick(over)).is_ok()) {
                    // If the disk takes longer, the marks of the last second are lost.
                    let _ = is_over.recv_timeout(END_WAIT_MAX);
                }
            }
        }
    }

    /// Ends the thread after it has done its jobs; returns whether it has ended in time. Without a thread: syncs, and
    /// returns whether that has succeeded.
    pub fn end(&mut self) -> bool {
        let (jobs, thread) = match self {
            Self::Here { keeper, done, .. } => return keeper.sync(&mut |what| done.push(what)),
            Self::Thread { jobs, thread, .. } => (jobs, thread),
        };
        drop(jobs.take());
        thread.take().is_none_or(|thread| threads::end_within(thread, END_WAIT_MAX))
    }
}

/// The loop of the keeper's thread; it ends when the sender of the jobs is dropped.
fn work(keeper: &mut Keeper, to_do: &Receiver<Message>, report: &mut dyn FnMut(Done)) {
    let mut ticked = Instant::now();
    loop {
        match to_do.recv_timeout(SYNC_EVERY.saturating_sub(ticked.elapsed())) {
            Ok(Message::Job(job)) => keeper.work(job, report),
            Ok(Message::Tick(over)) => {
                keeper.tick(report);
                // Sending fails if the caller has stopped waiting.
                let _ = over.send(());
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        if ticked.elapsed() >= SYNC_EVERY {
            ticked = Instant::now();
            keeper.tick(report);
        }
    }
    keeper.sync(report);
}
