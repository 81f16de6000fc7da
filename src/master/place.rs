//! Preallocated, reusable slots for futures, so that jobs started while cycles run do not allocate.
//!
//! The type of the future of an `async fn` has no name, so the future is stored in a box. A new box for each future
//! would be an allocation on the thread that runs the cycles. A slot is allocated once, for one kind of future, and
//! holds one future after the other.

use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// A slot for one sequence at a time. `Q`: the arguments from which a sequence is made; `R`: its result.
pub(crate) type Place<Q, R> = Box<dyn Sequences<Q, R>>;

/// The operations of a [`Place`].
pub(crate) trait Sequences<Q, R>: Send {
    /// Begins a sequence. A running one is dropped.
    fn begin(&mut self, order: Q);

    /// Polls the sequence and returns its result when it is ready. An empty slot is always pending.
    fn poll(&mut self, context: &mut Context<'_>) -> Poll<R>;

    /// Drops the running sequence, if there is one. The slot is then free for another one.
    fn give_up(&mut self);
}

/// Allocates a slot for the sequences that `begin` makes.
pub(crate) fn place<Q, R, F>(begin: impl FnMut(Q) -> F + Send + 'static) -> Place<Q, R>
where
    Q: 'static,
    F: Future<Output = R> + Send + 'static,
{
    Box::new(Seat { begin, sequence: Box::pin(None) })
}

struct Seat<B, F> {
    begin: B,
    /// The running sequence; `None`: the slot is free.
    sequence: Pin<Box<Option<F>>>,
}

impl<Q, R, B, F> Sequences<Q, R> for Seat<B, F>
where
    B: FnMut(Q) -> F + Send,
    F: Future<Output = R> + Send,
{
    fn begin(&mut self, order: Q) {
        let sequence = (self.begin)(order);
        self.sequence.set(Some(sequence));
    }

    fn poll(&mut self, context: &mut Context<'_>) -> Poll<R> {
        let Some(sequence) = self.sequence.as_mut().as_pin_mut() else { return Poll::Pending };
        let ended = sequence.poll(context);
        if ended.is_ready() {
            self.give_up();
        }
        ended
    }

    fn give_up(&mut self) {
        self.sequence.set(None);
    }
}
