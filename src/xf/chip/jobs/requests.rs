//! What a procedure asks of the network: operations one after the other, written as the sequence that they are.
//!
//! A procedure is an `async fn`, as the master's sequences are. The chip polls it itself, hands over what it asks for, and gives it
//! the answer.

use std::future::poll_fn;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use parking_lot::Mutex;

use super::{Begun, Gained};
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::{AlState, Ns};
use crate::xf::chip::network::{Answer, EepromFailure, Entered, EnteringSlaves, Network, Operation, Value};

/// What a procedure waits for.
#[allow(clippy::large_enum_variant, reason = "there is one, and boxing it would allocate")]
#[derive(Debug, Default)]
enum Slot {
    #[default]
    Empty,
    /// It asks for this.
    Asked(Operation),
    /// The network has been asked.
    Running,
    Answered(Answer),
}

/// The way of a procedure to the network.
#[derive(Clone, Debug, Default)]
pub(in crate::xf::chip) struct Requests(Arc<Mutex<Slot>>);

/// A procedure under way.
pub(in crate::xf::chip) struct Procedure {
    requests: Requests,
    task: Pin<Box<dyn Future<Output = Gained> + Send>>,
}

impl Procedure {
    /// Goes on as far as the answers of the network allow; what came of it, if it has ended.
    pub(super) fn run(&mut self, network: &mut impl Network) -> Option<Gained> {
        self.requests.go_on(self.task.as_mut(), network)
    }
}

impl Requests {
    /// Begins a procedure. On a network for which nothing takes time it ends at once, and nothing is allocated.
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
    async fn ask(&self, operation: Operation) -> Answer {
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

    /// [`Operation::Scan`].
    pub(super) async fn scan(&self) -> u8 {
        match self.ask(Operation::Scan).await {
            Answer::Scanned(found) => found,
            _ => 0,
        }
    }

    /// An operation of which nothing comes back.
    pub(super) async fn run(&self, operation: Operation) {
        self.ask(operation).await;
    }

    /// [`Operation::Enter`].
    pub(super) async fn enter(&self, slaves: EnteringSlaves) -> Entered {
        match self.ask(Operation::Enter(slaves)).await {
            Answer::Entered(entered) => entered,
            _ => Entered::empty((0, AlState::Init, Ok(()))),
        }
    }

    /// [`Operation::Read`]: the value as far as there is room, and its whole length.
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

    /// [`Operation::Write`].
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

    /// [`Operation::Datagram`].
    pub(super) async fn datagram(&self, operation: Operation) -> Option<(Vec<u8>, u16)> {
        match self.ask(operation).await {
            Answer::Datagram(answer) => answer,
            _ => None,
        }
    }

    /// [`Operation::ReadEeprom`] or [`Operation::WriteEeprom`].
    pub(super) async fn eeprom(&self, operation: Operation) -> Result<Vec<u16>, EepromFailure> {
        match self.ask(operation).await {
            Answer::Eeprom(result) => result,
            _ => Err(EepromFailure::NoAnswer),
        }
    }

    /// [`Operation::SetManager`].
    pub(super) async fn set_manager(&self, operation: Operation) -> bool {
        matches!(self.ask(operation).await, Answer::ManagerSet(true))
    }

    /// [`Operation::ReadFile`] or [`Operation::WriteFile`].
    pub(super) async fn file(&self, operation: Operation) -> Result<Vec<u8>, u32> {
        match self.ask(operation).await {
            Answer::File(result) => result,
            _ => Err(AbortCode::TIMEOUT.0),
        }
    }

    /// [`Operation::ReceiveMail`].
    pub(super) async fn mail(&self, slave: u8) -> Option<Vec<u8>> {
        match self.ask(Operation::ReceiveMail { slave }).await {
            Answer::Mail(mail) => mail,
            _ => None,
        }
    }
}
