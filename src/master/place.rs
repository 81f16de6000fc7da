//! Places for sequences that a running program causes: what such a sequence needs of memory is there before it begins.
//!
//! A sequence is a future whose type has no name, so that it lies in a box. A box that is made for each one would be memory that the
//! thread with the cycles asks for. A place is made once, for one kind of sequence, and holds one after the other.

use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// A place for one sequence at a time, each of which is asked for by a `Q` and gives an `R`.
pub(crate) type Place<Q, R> = Box<dyn Sequences<Q, R>>;

/// What can be done with a [`Place`].
pub(crate) trait Sequences<Q, R>: Send {
    /// Begins a sequence. One that is under way is given up.
    fn begin(&mut self, order: Q);

    /// Goes on with the sequence; what it has given. Without one that is under way there is nothing to wait for, and none ends.
    fn poll(&mut self, context: &mut Context<'_>) -> Poll<R>;

    /// Gives up the sequence that is under way: it is dropped.
    fn give_up(&mut self);
}

/// A place for the sequences that `begin` makes.
pub(crate) fn place<Q, R, F>(begin: impl FnMut(Q) -> F + Send + 'static) -> Place<Q, R>
where
    Q: 'static,
    F: Future<Output = R> + Send + 'static,
{
    Box::new(Seat { begin, sequence: Box::pin(None) })
}

struct Seat<B, F> {
    begin: B,
    /// The one under way.
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
