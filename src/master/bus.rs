//! The building blocks of sequences of datagrams: send one, wait, check the answer.
//!
//! Everything that takes more than one datagram (a scan, a change of state, an SDO) is an `async fn` that reads like
//! its sequence of datagrams. Only [`Master::poll`](super::Master::poll) runs these futures: each call continues them
//! as far as the received answers allow. No waker and no executor is needed, and the same answers at the same times
//! always give the same steps.

use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::sync::Arc;
use std::task::Poll;

use parking_lot::Mutex;

use super::exchange::Lost;
pub(super) use super::shared::Bus;
use super::shared::Shared;
use crate::ethercat::{Command, Ns};

/// A future that is one running sequence of datagrams.
pub(super) type Task<T> = Pin<Box<dyn Future<Output = T> + Send>>;

/// Why a register access has failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unanswered {
    /// The datagram was sent as often as allowed, and no frame came back.
    Lost,
    /// The frame came back with this working counter instead of 1: no slave has handled the datagram, or several have.
    Counter(u16),
}

impl From<Lost> for Unanswered {
    fn from(_: Lost) -> Self {
        Self::Lost
    }
}

/// A handle of a queued datagram, which gives its answer. Dropping the handle abandons the datagram: its answer is
/// ignored.
pub(super) struct Ticket {
    shared: Arc<Mutex<Shared>>,
    number: usize,
}

impl Ticket {
    /// Waits for the answer and copies its data into `data`. Returns the working counter.
    ///
    /// # Errors
    /// [`Lost`] if no frame with the datagram has come back in any of the tries.
    pub(super) async fn answer(self, data: &mut [u8]) -> Result<u16, Lost> {
        poll_fn(|_| match self.shared.lock().exchange.answer(self.number, data) {
            Some(answer) => Poll::Ready(answer),
            None => Poll::Pending,
        })
        .await
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        self.shared.lock().exchange.release(self.number);
    }
}

const fn register(adp: u16, ado: u16) -> u32 {
    adp as u32 | (ado as u32) << 16
}

impl Bus {
    /// Waits until `time`, on the master's clock.
    pub(super) async fn sleep_until(&self, time: Ns) {
        poll_fn(|_| if self.now() >= time { Poll::Ready(()) } else { Poll::Pending }).await;
    }

    /// Waits until the watch over the slaves has to check them again: its interval has passed, or a cycle had a wrong
    /// working counter.
    pub(super) async fn wait_for_alarm(&self) {
        let next = self.with(|shared| shared.now.saturating_add(shared.settings.watch_ns));
        poll_fn(|_| {
            let is_due = self.with(|shared| shared.now >= next || std::mem::take(&mut shared.is_alarmed));
            if is_due { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
    }

    pub(super) async fn sleep(&self, ns: Ns) {
        self.sleep_until(self.now().saturating_add(ns)).await;
    }

    /// Queues a datagram, which is sent again if it is lost, up to [`Settings::tries`](super::Settings::tries) times.
    pub(super) fn queue(&self, command: Command, adp: u16, ado: u16, data: &[u8]) -> Ticket {
        let tries = self.with(|shared| shared.settings.tries);
        self.queue_with(command, adp, ado, data, tries)
    }

    /// Queues a datagram, which is sent at most `tries` times.
    pub(super) fn queue_with(&self, command: Command, adp: u16, ado: u16, data: &[u8], tries: u8) -> Ticket {
        let number = self.with(|shared| shared.exchange.request(command, register(adp, ado), data, tries));
        Ticket { shared: Arc::clone(&self.0), number }
    }

    /// Sends a datagram and replaces `data` by the data of its answer. Returns the working counter; fails if no frame
    /// comes back in any of the tries.
    pub(super) async fn exchange(&self, command: Command, adp: u16, ado: u16, data: &mut [u8]) -> Result<u16, Lost> {
        self.queue(command, adp, ado, data).answer(data).await
    }

    /// Reads a register of the slave with that station address.
    pub(super) async fn read<const N: usize>(&self, station: u16, ado: u16) -> Result<[u8; N], Unanswered> {
        let mut data = [0; N];
        match self.exchange(Command::Fprd, station, ado, &mut data).await? {
            1 => Ok(data),
            counter => Err(Unanswered::Counter(counter)),
        }
    }

    /// Writes registers of the slave with that station address.
    pub(super) async fn write(&self, station: u16, ado: u16, data: &[u8]) -> Result<(), Unanswered> {
        match self.queue(Command::Fpwr, station, ado, data).answer(&mut []).await? {
            1 => Ok(()),
            counter => Err(Unanswered::Counter(counter)),
        }
    }

    /// Writes registers of all slaves. Returns the working counter: how many slaves have handled the write.
    pub(super) async fn write_all(&self, ado: u16, data: &[u8]) -> Result<u16, Lost> {
        self.queue(Command::Bwr, 0, ado, data).answer(&mut []).await
    }

    /// Writes several registers of all slaves, one after the other, in as few frames as possible.
    pub(super) async fn write_all_of<const N: usize>(&self, writes: [(u16, &[u8]); N]) -> Result<(), Lost> {
        let tickets = writes.map(|(ado, data)| self.queue(Command::Bwr, 0, ado, data));
        for ticket in tickets {
            ticket.answer(&mut []).await?;
        }
        Ok(())
    }
}

/// Runs sequences concurrently. Returns their results in the order of the sequences.
pub(super) async fn join<F: Future>(sequences: impl IntoIterator<Item = F>) -> Vec<F::Output> {
    let mut running: Vec<_> = sequences.into_iter().map(|sequence| (Box::pin(sequence), None)).collect();
    poll_fn(|context| {
        for (sequence, output) in running.iter_mut().filter(|(_, output)| output.is_none()) {
            if let Poll::Ready(ready) = sequence.as_mut().poll(context) {
                *output = Some(ready);
            }
        }
        if running.iter().all(|(_, output)| output.is_some()) { Poll::Ready(()) } else { Poll::Pending }
    })
    .await;
    running.into_iter().filter_map(|(_, output)| output).collect()
}
