//! The requests of a procedure to the network. A procedure is the sequence of requests of one part of a job.
//!
//! A procedure is an `async fn`, like the sequences of the master. The chip polls the procedure, passes its requests to the
//! network one after the other, and returns the answers to the procedure.

use std::future::poll_fn;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use parking_lot::Mutex;

use super::{JobResult, PartStart};
use crate::ethercat::Ns;
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::xf::chip::network::{Operation, OperationAnswer, SdoData, SlaveNetwork};

/// The state of the one request that a procedure makes at a time.
#[allow(clippy::large_enum_variant, reason = "there is one, and boxing it would allocate")]
#[derive(Debug, Default)]
enum Slot {
    #[default]
    Empty,
    /// The procedure requests this operation, and the network has not begun it.
    Requested(Operation),
    /// The network is executing the operation.
    Running,
    Answered(OperationAnswer),
}

/// The connection of a procedure to the network, through which it makes requests.
#[derive(Clone, Debug, Default)]
pub(in crate::xf::chip) struct Requests(Arc<Mutex<Slot>>);

/// A running procedure: the future that makes the requests of one part of a job.
pub(in crate::xf::chip) struct Procedure {
    requests: Requests,
    task: Pin<Box<dyn Future<Output = JobResult> + Send>>,
}

impl Procedure {
    /// Continues the procedure as far as the network's answers allow; returns its result once it has ended.
    pub(super) fn run(&mut self, network: &mut impl SlaveNetwork) -> Option<JobResult> {
        self.requests.go_on(self.task.as_mut(), network)
    }
}

impl Requests {
    /// Starts a procedure. On a network that answers at once, the procedure ends at once and nothing is allocated. On another
    /// network it continues in [`Procedure::run`].
    pub(super) fn begin<F: Future<Output = JobResult> + Send + 'static>(
        &self,
        network: &mut impl SlaveNetwork,
        procedure: impl FnOnce(Self) -> F,
    ) -> PartStart {
        *self.0.lock() = Slot::Empty;
        let task = procedure(self.clone());
        if network.takes_time() {
            return PartStart::Procedure(Procedure { requests: self.clone(), task: Box::pin(task) });
        }
        PartStart::Result(self.go_on(pin!(task), network).unwrap_or(JobResult::Failed))
    }

    fn go_on(
        &self,
        mut task: Pin<&mut (dyn Future<Output = JobResult> + Send)>,
        network: &mut impl SlaveNetwork,
    ) -> Option<JobResult> {
        let mut context = Context::from_waker(Waker::noop());
        loop {
            if let Poll::Ready(result) = task.as_mut().poll(&mut context) {
                return Some(result);
            }
            let mut slot = self.0.lock();
            let answer = match std::mem::take(&mut *slot) {
                Slot::Requested(operation) => network.start(operation),
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
    pub(super) async fn ask(&self, operation: Operation) -> OperationAnswer {
        *self.0.lock() = Slot::Requested(operation);
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
    ) -> Result<(SdoData, usize), AbortCode> {
        match self.ask(Operation::Read { slave, object, scope, room, timeout_ns }).await {
            OperationAnswer::Value(value) => value,
            _ => Err(AbortCode::TIMEOUT),
        }
    }

    /// [`Operation::Write`]: writes a whole value.
    pub(super) async fn write(
        &self,
        (slave, object): (u8, ObjectAddress),
        scope: SdoScope,
        value: SdoData,
        timeout_ns: Ns,
    ) -> Result<(), AbortCode> {
        match self.ask(Operation::Write { slave, object, scope, value, timeout_ns }).await {
            OperationAnswer::Written(written) => written,
            _ => Err(AbortCode::TIMEOUT),
        }
    }
}
