//! Who runs the [`Keeper`]: a thread of its own, or the recorder's thread.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::keeper::{Done, Job, Keeper};
use crate::link::record::SYNC_EVERY;
use crate::threads;

/// How long the end of a recording waits until the last moment is kept. What is not kept by then is when the folder is
/// opened again. \[OURS]
const END_WAIT_MAX: Duration = Duration::from_secs(10);

/// What is said if the thread has ended by an error of this crate. The segments go on without it.
const PANICKED: &str =
    "the thread that keeps moments and syncs to the disk has failed; open the board again, and report it";

/// What the thread is sent.
pub(super) enum Message {
    Job(Job),
    /// A tick at once; the sender is told when it is over.
    Tick(Sender<()>),
}

pub(super) enum Helper {
    /// The recorder's thread, for a virtual clock: programs wait for the disk there, and the files of two equal runs are
    /// equal. `ticked` is the time of the last tick; `None` in tests, which tick themselves.
    Here { keeper: Box<Keeper>, ticked: Option<Instant>, done: Vec<Done> },
    /// A thread of its own.
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
            // If the recorder's thread has gone, nobody needs to know.
            let mut report = |done| drop(tell.send(done));
            if catch_unwind(AssertUnwindSafe(|| work(&mut keeper, &to_do, &mut report))).is_err() {
                report(Done::NotKept(PANICKED.to_owned()));
            }
        };
        let thread = threads::spawn("ecmsk-flight", work)?;
        Ok(Self::Thread { jobs: Some(jobs), done, thread: Some(thread) })
    }

    /// Gives the keeper something to do.
    pub fn post(&mut self, job: Job) {
        match self {
            Self::Here { keeper, done, .. } => keeper.work(job, &mut |what| done.push(what)),
            Self::Thread { jobs, .. } => {
                // The thread ends after this sender alone.
                let _ = jobs.as_ref().map(|jobs| jobs.send(Message::Job(job)));
            }
        }
    }

    /// What the keeper has done since the last call.
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

    /// Syncs and looks for marks at once. Tests and the end of a recording do that.
    pub fn tick(&mut self) {
        match self {
            Self::Here { keeper, done, .. } => keeper.tick(&mut |what| done.push(what)),
            Self::Thread { jobs, .. } => {
                let (over, is_over) = channel();
                if jobs.as_ref().is_some_and(|jobs| jobs.send(Message::Tick(over)).is_ok()) {
                    // A disk that is slower than that loses the marks of the last second.
                    let _ = is_over.recv_timeout(END_WAIT_MAX);
                }
            }
        }
    }

    /// Ends the thread once it has done its jobs. Returns whether it has.
    pub fn end(&mut self) -> bool {
        let (jobs, thread) = match self {
            Self::Here { keeper, done, .. } => return keeper.sync(&mut |what| done.push(what)),
            Self::Thread { jobs, thread, .. } => (jobs, thread),
        };
        drop(jobs.take());
        thread.take().is_none_or(|thread| threads::end_within(thread, END_WAIT_MAX))
    }
}

/// The work of the thread, until nobody sends any more.
fn work(keeper: &mut Keeper, to_do: &Receiver<Message>, report: &mut dyn FnMut(Done)) {
    let mut ticked = Instant::now();
    loop {
        match to_do.recv_timeout(SYNC_EVERY.saturating_sub(ticked.elapsed())) {
            Ok(Message::Job(job)) => keeper.work(job, report),
            Ok(Message::Tick(over)) => {
                keeper.tick(report);
                // Who asked may have given up waiting.
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
