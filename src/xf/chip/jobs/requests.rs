//! The requests of a procedure to the network: operations one after the other, written as an `async` sequence.
//!
//! A procedure is an `async fn`, like the sequences of the master. The chip polls it, passes its requests to the
//! network, and returns the answers to it.

use std::future::poll_fn;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use parking_lot::Mutex;

use super::{Begun, Gained};
use crate::ethercat::Ns;
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::xf::chip::network::{Answer, Network, Operation, Value};

/// The state of a procedure's request.
#[allow(clippy::large_enum_variant, reason = "there is one, and boxing it would allocate")]
#[derive(Debug, Default)]
enum Slot {
    #[default]
    Empty,
    /// The procedure requests this operation.
    Asked(Operation),
    /// The network is executing the operation.
    Running,
    Answered(Answer),
}

/// The connection of a procedure to the network, through which it makes requests.
#[derive(Clone, Debug, Default)]
pub(in crate::xf::chip) struct Requests(Arc<Mutex<Slot>>);

/// A running procedure.
pub(in crate::xf::chip) struct Procedure {
    requests: Requests,
    task: Pin<Box<dyn Future<Output = Gained> + Send>>,
}

impl Procedure {
    /// Continues the procedure as far as the network's answers allow; returns its result once it has ended.
    pub(super) fn run(&mut self, network: &mut impl Network) -> Option<Gained> {
        self.requests.go_on(self.task.as_mut(), network)
    }
}

impl Requests {
    /// Starts a procedure. On a network that answers at once, the procedure ends at once and nothing is allocated.
    pub(super) fn begin<F: Future<Output = Gained> + Send + 'static>(
        &self,
        network: &mut impl Network,
        procedure: impl FnOnce(Self) -> F,
    ) -> Begun {
        *self.0.lock() = Slot::Empty;
        let task = procedure(self.clone());
        if network.takes_time() {
            return Begun::Procedure(Procedure { requests: self.clone(), task: Box::pin(task) });
        }
        Begun::Gained(self.go_on(pin!(task), network).unwrap_or(Gained::Failed))
    }

    fn go_on(
        &self,
        mut task: Pin<&mut (dyn Future<Output = Gained> + Send)>,
        network: &mut impl Network,
    ) -> Option<Gained> {
        let mut context = Context::from_waker(Waker::noop());
        loop {
            if let Poll::Ready(gained) = task.as_mut().poll(&mut context) {
                return Some(gained);
            }
            let mut slot = self.0.lock();
            let answer = match std::mem::take(&mut *slot) {
                Slot::Asked(operation) => network.start(operation),
                _ => network.poll(),
            };
            *slot = answer.map_or(Slot::Running, Slot::Answered);
            if matches!(*slot, Slot::Running) {
                return None;
            }
        }
    }
}

impl Requests {
    pub(super) async fn ask(&self, operation: Operation) -> Answer {
        *self.0.lock() = Slot::Asked(operation);
        poll_fn(|_| {
            let mut slot = self.0.lock();
            match std::mem::take(&mut *slot) {
                Slot::Answered(answer) => Poll::Ready(answer),
                other => {
                    *slot = other;
                    Poll::Pending
                }
            }
        })
        .await
    }

    /// [`Operation::Read`]: returns as much of the value as there is room for, and its full length.
    pub(super) async fn read(
        &self,
        (slave, object): (u8, ObjectAddress),
        scope: SdoScope,
        room: usize,
        timeout_ns: Ns,
    ) -> Result<(Value, usize), AbortCode> {
        match self.ask(Operation::Read { slave, object, scope, room, timeout_ns }).await {
            Answer::Value(value) => value,
            _ => Err(AbortCode::TIMEOUT),
        }
    }

    /// [`Operation::Write`]: writes a whole value.
    pub(super) async fn write(
        &self,
        (slave, object): (u8, ObjectAddress),
        scope: SdoScope,
        value: Value,
        timeout_ns: Ns,
    ) -> Result<(), AbortCode> {
        match self.ask(Operation::Write { slave, object, scope, value, timeout_ns }).await {
            Answer::Written(written) => written,
            _ => Err(AbortCode::TIMEOUT),
        }
    }
}
