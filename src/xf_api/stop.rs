//! Stops the axes when a program ends, and before the network is initialised again.

use std::time::Duration;

use super::{Xf, XfError};
use crate::ethercat::Ns;
use crate::ethercat::cia402::DriveState;
use crate::link::chip_link::ChipLink;
use crate::xf::EtherCatState;
use crate::xf::host::{HostError, HostState};
use crate::xf::request::{Call, FifoEnable, HelperStateGet, HelperStateSet, MotorNumber, Slaves, StateSet};

/// How long all axes together may take to come to a standstill, and then again to reach Switch on disabled. \[OURS]
const STANDSTILL_LIMIT: Duration = Duration::from_secs(3);
/// How long the network may take to reach SafeOP. \[OURS]
const SAFE_OP_LIMIT: Duration = Duration::from_secs(5);
/// How long all exchanges may fail until the wires count as cut. \[OURS]
const SILENCE_LIMIT: Duration = Duration::from_secs(2);
/// How many exchanges in a row may fail until the wires count as cut, for links whose clock does not advance. \[OURS]
const FAILURES_MAX: u32 = 4000;
/// Pause between a failed exchange and the next one. \[OURS]
const PAUSE: Duration = Duration::from_millis(1);
/// How many times a command of the stop is sent if it may not have reached the chip. \[OURS]
const TRIES: u32 = 3;

/// A set of the helper's motors, one bit each.
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

/// What has failed so far while the axes are stopped.
struct StopProgress {
    /// Number of failed exchanges since the newest answer. `failing_since` is the time of the first of these failures,
    /// `answers` the number of answers at that time.
    failures: u32,
    failing_since: Ns,
    answers: u64,
    /// Whether the driver has stopped and was restarted, which is done only once.
    restarted: bool,
    /// The error after which no further command is tried, because nothing reaches the chip any more.
    given_up: Option<XfError>,
    /// The first error that occurred while the axes were stopped.
    first: Result<(), XfError>,
}

impl StopProgress {
    fn note(&mut self, done: Result<(), XfError>) {
        if self.first.is_ok() {
            self.first = done;
        }
    }
}

impl<L: ChipLink> Xf<L> {
    /// Ends the program's work with the chip. If the program has sent outputs or switched an axis on, the axes that may
    /// be on make a quick stop (0x605A, 0x6085 of the drive) and are switched off. Then the FIFO is switched off, and
    /// the network goes to SafeOP, in which a slave's outputs have no effect. Dropping does the same, but cannot report
    /// errors.
    ///
    /// An error at one axis does not prevent the stop of the other axes. Failed exchanges are retried until no answer
    /// has come for 2 s, and a driver that has stopped is restarted once.
    ///
    /// Only a program that still runs can do this. If the program is killed, the chip repeats the last outputs forever:
    /// in CSP an axis stands still, in CSV and CST it keeps moving. For this case the machine itself needs a way to
    /// stop its axes.
    ///
    /// # Errors
    /// The first error that occurred: [`XfError::AxisStuck`] if an axis did not come to rest or did not switch off in
    /// time, otherwise as with [`Xf::run`]. All further steps of the stop were tried nevertheless.
    pub fn close(mut self) -> Result<(), XfError> {
        self.stop()
    }

    /// Leaves the chip, its network and its axes running as they are, for a program that connects again later.
    pub fn leave(mut self) {
        self.moves = false;
        self.on = Motors::default();
    }

    fn stop(&mut self) -> Result<(), XfError> {
        if !std::mem::take(&mut self.moves) && self.on.is_empty() {
            return Ok(());
        }
        // The stop must not wait for queued commands, whose results nobody reads any more.
        self.host.abandon_all();
        let mut progress = self.progress();
        self.stop_axes(&mut progress);
        let limit = self.host.config().timeouts.busy_ns;
        let off = self.run_with_retry(&mut progress, &FifoEnable { on: false }, limit, drop);
        progress.note(off);
        let safe_op = StateSet { slaves: Slaves::All, state: EtherCatState::SafeOp };
        let safe_op = self.run_with_retry(&mut progress, &safe_op, super::ns(SAFE_OP_LIMIT), drop);
        progress.note(safe_op);
        // After this attempt, dropping the value does not stop the axes again.
        self.on = Motors::default();
        progress.first
    }

    /// Stops the axes that may be on before the network is initialised again. An axis that cannot be stopped gets no
    /// outputs any more once the network is in Init, so its drive itself has to stop the motor.
    pub(super) fn stop_before_init(&mut self) {
        let mut progress = self.progress();
        self.stop_axes(&mut progress);
    }

    /// Removes all axes after the network was initialised again: the helper drives no axis any more.
    pub(super) fn forget_axes(&mut self) {
        self.axes.clear();
        self.on = Motors::default();
    }

    fn progress(&self) -> StopProgress {
        let (failing_since, answers) = (self.link.now(), self.host.counters().answers);
        StopProgress { failures: 0, failing_since, answers, restarted: false, given_up: None, first: Ok(()) }
    }

    fn stop_axes(&mut self, progress: &mut StopProgress) {
        use DriveState::{Fault, FaultReactionActive, OperationEnabled, QuickStopActive, SwitchOnDisabled};
        let on = self.on;
        // All axes get the quick stop before the program waits for any of them.
        self.request_state_of_all(progress, on, QuickStopActive);
        let moves = [Some(OperationEnabled), Some(QuickStopActive), Some(FaultReactionActive), None];
        self.wait_all(progress, on, "standstill", |found| !moves.contains(&found));
        // An axis that does not come to rest is switched off too: no torque is safer than torque without control.
        self.request_state_of_all(progress, on, SwitchOnDisabled);
        // A fault is not reset: a drive in Fault has no torque, and its cause stays readable.
        let wanted = SwitchOnDisabled.name();
        let off = self.wait_all(progress, on, wanted, |found| matches!(found, Some(SwitchOnDisabled | Fault)));
        off.iter().for_each(|motor| self.on.remove(motor));
    }

    fn request_state_of_all(&mut self, progress: &mut StopProgress, motors: Motors, state: DriveState) {
        let limit = self.host.config().timeouts.busy_ns;
        for motor in motors.iter() {
            let requested = self.run_with_retry(progress, &HelperStateSet { motor, state }, limit, drop);
            progress.note(requested);
        }
    }

    /// Waits until `is_there` accepts the state of each of these axes, with one common time limit; returns the axes
    /// accepted. `wanted` is the name of such a state, for the error.
    fn wait_all(
        &mut self,
        progress: &mut StopProgress,
        motors: Motors,
        wanted: &'static str,
        is_there: impl Fn(Option<DriveState>) -> bool,
    ) -> Motors {
        let begin = self.link.now();
        let limit = self.host.config().timeouts.busy_ns;
        let (mut there, mut waiting) = (Motors::default(), motors);
        while !waiting.is_empty() {
            for motor in waiting.iter() {
                let waited = Duration::from_nanos(self.link.now().saturating_sub(begin));
                match self.run_with_retry(progress, &HelperStateGet { motor }, limit, |answer| answer.state()) {
                    Ok(found) if is_there(found) => {
                        there.insert(motor);
                        waiting.remove(motor);
                    }
                    Ok(_) if waited < STANDSTILL_LIMIT => {}
                    Ok(found) => {
                        let found = found.map_or("no state", DriveState::name);
                        progress.note(Err(XfError::AxisStuck { motor: motor.get(), found, wanted, waited }));
                        waiting.remove(motor);
                    }
                    Err(error) => {
                        progress.note(Err(error));
                        waiting.remove(motor);
                    }
                }
            }
        }
        there
    }

    /// Runs a command and retries it if it may not have reached the chip. Running the command twice must do no harm.
    fn run_with_retry<'d, C: Call<'d>, T>(
        &mut self,
        progress: &mut StopProgress,
        call: &C,
        busy_ns: Ns,
        take: impl Fn(C::Answer<'_>) -> T,
    ) -> Result<T, XfError> {
        let mut tries = 0;
        loop {
            self.restart_driver(progress)?;
            tries += 1;
            let ticket = self.host.submit_within(self.link.now(), call, busy_ns)?;
            while !self.host.is_done(ticket) {
                self.step_until_cut(progress)?;
            }
            let error = match self.host.take(ticket, call) {
                Some(Ok(answer)) => return Ok(take(answer)),
                Some(Err(error)) => error,
                None => unreachable!("the command is done"),
            };
            // If the chip was reset, it drives no axis any more and refuses the command, so there is no retry.
            let again = matches!(self.host.state(), HostState::Stopped(_))
                || matches!(error, HostError::NoAnswer { .. } | HostError::AnswerLost { .. });
            if !again || tries >= TRIES {
                return Err(error.into());
            }
        }
    }

    /// Restarts a driver that has stopped, once, and waits until it runs.
    fn restart_driver(&mut self, progress: &mut StopProgress) -> Result<(), XfError> {
        if let Some(error) = &progress.given_up {
            return Err(error.clone());
        }
        loop {
            match self.host.state() {
                HostState::Running | HostState::Searching => return Ok(()),
                HostState::Starting(_) => self.step_until_cut(progress)?,
                HostState::Stopped(_) if !progress.restarted => {
                    progress.restarted = true;
                    self.host.restart(self.link.now());
                }
                HostState::Stopped(error) => {
                    progress.given_up = Some(error.into());
                    return Err(error.into());
                }
            }
        }
    }

    /// Steps the driver. A failed exchange is followed by another one, until the wires count as cut.
    fn step_until_cut(&mut self, progress: &mut StopProgress) -> Result<(), XfError> {
        let error = match self.step(Ns::MAX) {
            // The driver has stopped, which has ended all pending commands.
            Ok(()) | Err(XfError::Chip(_)) => return Ok(()),
            Err(error) => error,
        };
        let (now, answers) = (self.link.now(), self.host.counters().answers);
        if progress.failures == 0 || answers > progress.answers {
            (progress.failures, progress.failing_since, progress.answers) = (0, now, answers);
        }
        progress.failures += 1;
        let silent_ns = now.saturating_sub(progress.failing_since);
        if silent_ns >= super::ns(SILENCE_LIMIT) || progress.failures >= FAILURES_MAX {
            progress.given_up = Some(error.clone());
            return Err(error);
        }
        // If the wait fails, the next exchange fails too and is counted.
        let _ = self.link.wait_until(now.saturating_add(super::ns(PAUSE)));
        Ok(())
    }
}

impl<L: ChipLink> Drop for Xf<L> {
    fn drop(&mut self) {
        // A destructor cannot report an error.
        let _ = self.stop();
    }
}
