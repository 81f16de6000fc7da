//! What stops axes: when a program ends, and before the network is started anew.

use std::time::Duration;

use super::{Xf, XfError};
use crate::ethercat::Ns;
use crate::ethercat::cia402::DriveState;
use crate::link::chip_link::ChipLink;
use crate::xf::EtherCatState;
use crate::xf::host::{HostError, HostState};
use crate::xf::request::{Call, FifoEnable, HelperStateGet, HelperStateSet, MotorNumber, Slaves, StateSet};

/// How long all axes together may take to a standstill, and then to Switch on disabled. \[OURS]
const STANDSTILL_LIMIT: Duration = Duration::from_secs(3);
/// How long the network may take to SafeOP. \[OURS]
const SAFE_OP_LIMIT: Duration = Duration::from_secs(5);
/// How long exchanges may fail one after the other until the wires count as cut. \[OURS]
const SILENCE_LIMIT: Duration = Duration::from_secs(2);
/// How many exchanges may fail one after the other, on a link whose clock stands. \[OURS]
const FAILURES_MAX: u32 = 4000;
/// Between a failed exchange and the next one. \[OURS]
const PAUSE: Duration = Duration::from_millis(1);
/// How often a command of the stop is run if it may not have reached the chip. \[OURS]
const TRIES: u32 = 3;

/// Motors of the helper, a bit each: those that may be on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Motors(u128);

impl Motors {
    pub(super) fn insert(&mut self, motor: MotorNumber) {
        self.0 |= 1 << motor.get();
    }

    pub(super) fn remove(&mut self, motor: MotorNumber) {
        self.0 &= !(1 << motor.get());
    }

    pub(super) const fn contains(self, motor: MotorNumber) -> bool {
        self.0 & 1 << motor.get() != 0
    }

    const fn is_empty(self) -> bool {
        self.0 == 0
    }

    fn iter(self) -> impl Iterator<Item = MotorNumber> {
        (0..=127).filter_map(|motor| MotorNumber::decode(motor).ok()).filter(move |motor| self.contains(*motor))
    }
}

/// What has failed while everything is tried to stop the axes.
struct Effort {
    /// Exchanges that failed since the newest answer, since when, and how many answers there were then.
    failures: u32,
    failing_since: Ns,
    answers: u64,
    /// The driver had stopped and was started again; that is done once.
    restarted: bool,
    /// Nothing reaches the chip any more, for this reason.
    given_up: Option<XfError>,
    /// The first thing that went wrong.
    first: Result<(), XfError>,
}

impl Effort {
    fn note(&mut self, done: Result<(), XfError>) {
        if self.first.is_ok() {
            self.first = done;
        }
    }
}

impl<L: ChipLink> Xf<L> {
    /// Ends the program's work with the chip. If it has sent outputs or switched an axis on, the axes that may be on make
    /// a quick stop (0x605A, 0x6085 of the drive) and are switched off, the FIFO is switched off, and the network goes to
    /// SafeOP, in which a slave's outputs have no effect. Dropping does the same, and cannot say what went wrong.
    ///
    /// What fails for one axis keeps no other one from its own stop. Exchanges that fail are tried again until the wires
    /// were silent for 2 s, and a driver that has stopped is started once more.
    ///
    /// Only a program that still runs can do this. If it is killed, the chip repeats the last outputs for ever: in CSP
    /// an axis stands, in CSV and CST it goes on. What has to stop then has to be stopped by the machine.
    ///
    /// # Errors
    /// The first thing that went wrong: [`XfError::AxisStuck`], [`XfError::Chip`], [`XfError::Link`]. All that could
    /// still be done was done.
    pub fn close(mut self) -> Result<(), XfError> {
        self.stop()
    }

    /// Leaves the chip, its network and its axes as they are, for a program that comes back to them.
    pub fn leave(mut self) {
        self.moves = false;
        self.on = Motors::default();
    }

    fn stop(&mut self) -> Result<(), XfError> {
        if !std::mem::take(&mut self.moves) && self.on.is_empty() {
            return Ok(());
        }
        // What waits comes behind the stop, and nobody is left for results.
        self.host.abandon_all();
        let mut effort = self.effort();
        self.stop_axes(&mut effort);
        let limit = self.host.config().deadlines.busy_ns;
        let off = self.insist(&mut effort, &FifoEnable { on: false }, limit, drop);
        effort.note(off);
        let safe_op = StateSet { slaves: Slaves::All, state: EtherCatState::SafeOp };
        let safe_op = self.insist(&mut effort, &safe_op, super::ns(SAFE_OP_LIMIT), drop);
        effort.note(safe_op);
        // Dropping does not try again.
        self.on = Motors::default();
        effort.first
    }

    /// Stops the axes that may be on before the network is started anew. Init takes the outputs from one that cannot be
    /// stopped.
    pub(super) fn stop_before_init(&mut self) {
        let mut effort = self.effort();
        self.stop_axes(&mut effort);
    }

    /// The network was started anew: no axis is led.
    pub(super) fn forget_axes(&mut self) {
        self.axes.clear();
        self.on = Motors::default();
    }

    fn effort(&self) -> Effort {
        let (failing_since, answers) = (self.link.now(), self.host.counters().answers);
        Effort { failures: 0, failing_since, answers, restarted: false, given_up: None, first: Ok(()) }
    }

    fn stop_axes(&mut self, effort: &mut Effort) {
        use DriveState::{Fault, FaultReactionActive, OperationEnabled, QuickStopActive, SwitchOnDisabled};
        let on = self.on;
        // All axes begin to stop before any is waited for.
        self.lead_all(effort, on, QuickStopActive);
        let moves = [Some(OperationEnabled), Some(QuickStopActive), Some(FaultReactionActive), None];
        self.wait_all(effort, on, |found| !moves.contains(&found));
        // What does not come to rest is switched off too: no torque is less than a torque that nobody leads.
        self.lead_all(effort, on, SwitchOnDisabled);
        // A fault is left alone: without its reset there is no torque, and why it is there can still be read.
        let off = self.wait_all(effort, on, |found| matches!(found, Some(SwitchOnDisabled | Fault)));
        off.iter().for_each(|motor| self.on.remove(motor));
    }

    fn lead_all(&mut self, effort: &mut Effort, motors: Motors, state: DriveState) {
        let limit = self.host.config().deadlines.busy_ns;
        for motor in motors.iter() {
            let led = self.insist(effort, &HelperStateSet { motor, state }, limit, drop);
            effort.note(led);
        }
    }

    /// Waits until all these axes are where `is_there` wants them, and gives those that are. All share one time limit.
    fn wait_all(
        &mut self,
        effort: &mut Effort,
        motors: Motors,
        is_there: impl Fn(Option<DriveState>) -> bool,
    ) -> Motors {
        let begin = self.link.now();
        let limit = self.host.config().deadlines.busy_ns;
        let (mut there, mut waiting) = (Motors::default(), motors);
        while !waiting.is_empty() {
            for motor in waiting.iter() {
                let waited = Duration::from_nanos(self.link.now().saturating_sub(begin));
                match self.insist(effort, &HelperStateGet { motor }, limit, |answer| answer.state()) {
                    Ok(found) if is_there(found) => {
                        there.insert(motor);
                        waiting.remove(motor);
                    }
                    Ok(_) if waited < STANDSTILL_LIMIT => {}
                    Ok(found) => {
                        let found = found.map_or("no state", DriveState::name);
                        let wanted = DriveState::SwitchOnDisabled.name();
                        effort.note(Err(XfError::AxisStuck { motor: motor.get(), found, wanted, waited }));
                        waiting.remove(motor);
                    }
                    Err(error) => {
                        effort.note(Err(error));
                        waiting.remove(motor);
                    }
                }
            }
        }
        there
    }

    /// Runs a command that does the same when it is run again, and again if it may not have reached the chip.
    fn insist<'d, C: Call<'d>, T>(
        &mut self,
        effort: &mut Effort,
        call: &C,
        busy_ns: Ns,
        take: impl Fn(C::Answer<'_>) -> T,
    ) -> Result<T, XfError> {
        let mut tries = 0;
        loop {
            self.revive(effort)?;
            tries += 1;
            let ticket = self.host.submit_within(self.link.now(), call, busy_ns)?;
            while !self.host.is_done(ticket) {
                self.keep_on(effort)?;
            }
            let error = match self.host.take(ticket, call) {
                Some(Ok(answer)) => return Ok(take(answer)),
                Some(Err(error)) => error,
                None => unreachable!("the command is done"),
            };
            // A chip that was reset leads no axis any more and would refuse.
            let again = matches!(self.host.state(), HostState::Stopped(_))
                || matches!(error, HostError::NoAnswer { .. } | HostError::AnswerLost { .. });
            if !again || tries >= TRIES {
                return Err(error.into());
            }
        }
    }

    /// Starts a driver that has stopped again, once, and waits until it runs.
    fn revive(&mut self, effort: &mut Effort) -> Result<(), XfError> {
        if let Some(error) = &effort.given_up {
            return Err(error.clone());
        }
        loop {
            match self.host.state() {
                HostState::Running | HostState::Searching => return Ok(()),
                HostState::Starting(_) => self.keep_on(effort)?,
                HostState::Stopped(_) if !effort.restarted => {
                    effort.restarted = true;
                    self.host.restart(self.link.now());
                }
                HostState::Stopped(error) => {
                    effort.given_up = Some(error.into());
                    return Err(error.into());
                }
            }
        }
    }

    /// A step of the driver. One that fails is followed by the next one, until the wires count as cut.
    fn keep_on(&mut self, effort: &mut Effort) -> Result<(), XfError> {
        let error = match self.step(Ns::MAX) {
            // The driver has stopped: what waits has ended.
            Ok(()) | Err(XfError::Chip(_)) => return Ok(()),
            Err(error) => error,
        };
        let (now, answers) = (self.link.now(), self.host.counters().answers);
        if effort.failures == 0 || answers > effort.answers {
            (effort.failures, effort.failing_since, effort.answers) = (0, now, answers);
        }
        effort.failures += 1;
        let silent_ns = now.saturating_sub(effort.failing_since);
        if silent_ns >= super::ns(SILENCE_LIMIT) || effort.failures >= FAILURES_MAX {
            effort.given_up = Some(error.clone());
            return Err(error);
        }
        // A wait that fails is counted by the next exchange.
        let _ = self.link.wait_until(now.saturating_add(super::ns(PAUSE)));
        Ok(())
    }
}

impl<L: ChipLink> Drop for Xf<L> {
    fn drop(&mut self) {
        // There is nobody to tell.
        let _ = self.stop();
    }
}
