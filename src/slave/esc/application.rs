//! The AL state machine of a slave behind its slave controller: which changes of state it makes, and how it answers
//! requests. `checks.rs` has the checks.
//!
//! Source: ETG.1000.6 6.4, ETG.1020, and the behaviour of public slave stacks; rules ECAT-11.

use super::Controller;
use super::mailbox::{ANSWERS, REQUESTS};
use super::managers::MANAGERS_MAX;
use crate::ethercat::registers::{AlControl, AlStatusRegister, RequestedState, SyncManager};
use crate::ethercat::sii::{CategoryKind, Sii, SiiSmType};
use crate::ethercat::{AlState, AlStatus, Ns};
use crate::slave::{Slave, SyncEvent};

/// How long a slave waits for outputs or SYNC0 on its way to OP, ns. After that it stays in SafeOP with an error. Public slave
/// stacks wait 9 s minus a margin of 50 ms.
pub const OP_WAIT_NS: Ns = 8_950_000_000;

/// The numbers of the sync managers for process data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ProcessManagers {
    pub(super) outputs: u8,
    pub(super) inputs: u8,
}

impl ProcessManagers {
    /// Sync managers 2 and 3 of a slave with a mailbox, which has sync managers 0 and 1. Without a mailbox, the first sync
    /// manager that the EEPROM describes for each direction.
    pub(super) fn of(eeprom: &[u8], has_mailbox: bool) -> Self {
        if has_mailbox {
            return Self { outputs: 2, inputs: 3 };
        }
        let described = Sii::new(eeprom).ok().and_then(|sii| sii.category(CategoryKind::SyncManagers));
        let first = |kind| {
            let place = described.and_then(|managers| managers.sync_managers().position(|one| one.kind == kind));
            place.and_then(|place| u8::try_from(place).ok()).filter(|place| *place < NO_MANAGER).unwrap_or(NO_MANAGER)
        };
        Self { outputs: first(SiiSmType::Outputs), inputs: first(SiiSmType::Inputs) }
    }
}

/// The last sync manager number, 15, means a direction without process data. That sync manager is normally disabled, so
/// its length reads as 0 and no `Option` is needed.
const NO_MANAGER: u8 = MANAGERS_MAX as u8 - 1;

/// The AL state machine of a slave: AL status and AL status code, the pending request of the master, and what the slave waits
/// for.
#[derive(Clone, Debug)]
pub(super) struct Application {
    status: AlStatusRegister,
    code: AlStatus,
    pub(super) has_mailbox: bool,
    pub(super) managers: ProcessManagers,
    /// A write to AL control that is not processed yet, and the time at which it is processed.
    requested: Option<(AlControl, Ns)>,
    /// The time until which the slave waits for outputs or SYNC0 on its way to OP; `None` if it does not wait.
    waiting: Option<Ns>,
    /// The time by which SYNC0 must have come, in SafeOP and OP; `None` without such a limit.
    lock_due: Option<Ns>,
    /// Whether the SYNC unit generated SYNC0 when SafeOP was entered, so that the slave runs by SYNC0.
    pub(super) is_synchronized: bool,
    /// Whether SYNC0 has come since SafeOP was entered.
    pub(super) sync_came: bool,
    /// Whether outputs have come since SafeOP was entered.
    pub(super) outputs_came: bool,
}

/// What the slave has to start after a change of the AL state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    None,
    /// The mailbox starts, in PreOP or in bootstrap.
    MailboxOn,
    /// Process data start: the slave has come to SafeOP or OP from PreOP or Init.
    ProcessDataOn,
}

impl Application {
    pub(super) fn new(has_mailbox: bool, managers: ProcessManagers) -> Self {
        Self {
            status: AlStatusRegister::of(RequestedState::State(AlState::Init)),
            code: AlStatus::NONE,
            has_mailbox,
            managers,
            requested: None,
            waiting: None,
            lock_due: None,
            is_synchronized: false,
            sync_came: false,
            outputs_came: false,
        }
    }

    /// The AL state that the network reads, including bootstrap.
    pub(super) const fn shown_state(&self) -> RequestedState {
        self.status.state()
    }

    pub(super) fn is_in_bootstrap(&self) -> bool {
        self.shown_state() == RequestedState::Boot
    }

    /// The AL state as the device model knows it, which has no bootstrap: while AL status shows bootstrap, this is Init.
    pub(super) fn state(&self) -> AlState {
        match self.status.state() {
            RequestedState::State(state) => state,
            _ => AlState::Init,
        }
    }

    const fn has_error(&self) -> bool {
        self.status.contains(AlStatusRegister::ERROR)
    }

    fn show(&mut self, status: AlStatusRegister, code: AlStatus, controller: &mut Controller) {
        (self.status, self.code) = (status, code);
        controller.set_al_status(status, code);
        if !status.contains(AlStatusRegister::ERROR) {
            // Enables the outputs again if the watchdog has deactivated their sync manager.
            controller.managers.deactivate(self.managers.outputs, false, &mut controller.memory);
        }
    }

    fn succeed(&mut self, state: AlState, controller: &mut Controller) {
        self.show(AlStatusRegister::of(RequestedState::State(state)), AlStatus::NONE, controller);
    }

    /// Goes to, or stays in, a state with the error flag and an AL status code.
    fn fail(&mut self, state: AlState, code: AlStatus, controller: &mut Controller) {
        self.fail_in(RequestedState::State(state), code, controller);
    }

    fn fail_in(&mut self, state: RequestedState, code: AlStatus, controller: &mut Controller) {
        self.waiting = None;
        let status = AlStatusRegister::of(state).with(AlStatusRegister::ERROR);
        self.show(status, code, controller);
    }

    /// Takes the slave to the lower state `to` without a request of the master, with the error flag and an AL status code.
    pub(super) fn fall(&mut self, to: AlState, code: AlStatus, controller: &mut Controller, device: &mut dyn Slave) {
        // Every device can go to a lower state, so the result is always `Ok`.
        let _ = device.enter(to);
        self.fail(to, code, controller);
    }

    /// Handles an expired watchdog: the slave leaves OP and accepts no outputs until the master has acknowledged the error.
    pub(super) fn lose_outputs(&mut self, controller: &mut Controller, device: &mut dyn Slave) {
        let was_in_op = self.state() == AlState::Op;
        device.expire_watchdog();
        // Some devices treat an expired watchdog as an error in SafeOP too. In all other devices, it has no effect in
        // SafeOP.
        if !was_in_op && device.al_status() != AlStatus::WATCHDOG {
            return;
        }
        self.outputs_came = false;
        self.fall(AlState::SafeOp, AlStatus::WATCHDOG, controller, device);
        controller.managers.deactivate(self.managers.outputs, true, &mut controller.memory);
    }

    /// Handles the deactivation of SYNC0 by the master: in OP the slave falls to SafeOP or lower, with an error. In
    /// SafeOP and below, the slave shows an error only if the device reports one.
    pub(super) fn lose_sync(&mut self, controller: &mut Controller, device: &mut dyn Slave) {
        device.report_sync(SyncEvent::LockLost);
        if self.state() < AlState::Op {
            if device.al_status() != AlStatus::NONE {
                self.fail(device.state(), device.al_status(), controller);
            }
            return;
        }
        let code = if device.state() < AlState::Op { device.al_status() } else { AlStatus::FATAL_SYNC };
        self.fall(device.state().min(AlState::SafeOp), code, controller, device);
    }

    /// If the device has left its state on its own, shows the device's state and AL status code, with the error flag.
    /// Does nothing with device emulation, where AL status only copies AL control.
    pub(super) fn follow(&mut self, controller: &mut Controller, device: &dyn Slave) {
        if device.state() != self.state() && !controller.is_device_emulated() {
            self.fail(device.state(), device.al_status(), controller);
        }
    }

    /// Records a write to AL control, to be processed at time `due`.
    pub(super) fn request(&mut self, control: AlControl, due: Ns) {
        self.requested = Some((control, due));
    }

    /// The time of the next action of [`Self::advance`]; `None` if no request, wait or time limit is pending.
    pub(super) fn due(&self) -> Option<Ns> {
        [self.requested.map(|(_, due)| due), self.waiting, self.lock_due].into_iter().flatten().min()
    }

    /// Whether an action of [`Self::advance`] is pending, due or not.
    pub(super) const fn is_busy(&self) -> bool {
        self.requested.is_some() || self.waiting.is_some() || self.lock_due.is_some()
    }

    /// Processes a request of the master that is due, checks the time limit for SYNC0, and continues a pending change to OP.
    /// Called after a frame and when time has passed.
    pub(super) fn advance(&mut self, now: Ns, controller: &mut Controller, device: &mut dyn Slave) -> Change {
        if let Some((control, _)) = self.requested.take_if(|(_, due)| *due <= now) {
            controller.note_al_control_read();
            let change = self.handle(control, now, controller, device);
            if change != Change::None {
                return change;
            }
        }
        if self.lock_due.take_if(|due| *due <= now).is_some() {
            self.check_lock(now, controller, device);
        }
        if let Some(until) = self.waiting {
            self.try_op(until, now, controller, device);
        }
        Change::None
    }

    /// Fails with the device's AL status code if no SYNC0 pulse has come within the time limit. \[OURS] If the first
    /// pulse is scheduled for later, the time limit starts at that pulse.
    fn check_lock(&mut self, now: Ns, controller: &mut Controller, device: &mut dyn Slave) {
        if self.state() < AlState::SafeOp || !self.is_synchronized || self.sync_came {
            return;
        }
        if let Some(pulse) = controller.next_pulse(now) {
            self.lock_due = device.sync_lock_limit_ns().map(|limit| pulse + limit);
            return;
        }
        device.report_sync(SyncEvent::NotLocked);
        self.fail(device.state(), device.al_status(), controller);
    }

    /// Handles a write to AL control with device emulation, which has no state machine: AL status copies AL control with its
    /// acknowledge bit, and the device goes to that state without checks.
    fn copy_control(&mut self, control: AlControl, controller: &mut Controller, device: &mut dyn Slave) -> Change {
        const COPIED: u16 = 0x1F;
        let from = self.state();
        self.status = AlStatusRegister(control.0 & COPIED);
        controller.set_al_status(self.status, AlStatus::NONE);
        let to = self.state();
        device.set_communication(&controller.communication());
        let _ = device.enter(to);
        let begins = from < AlState::SafeOp && to >= AlState::SafeOp;
        if begins { Change::ProcessDataOn } else { Change::None }
    }

    fn handle(&mut self, control: AlControl, now: Ns, controller: &mut Controller, device: &mut dyn Slave) -> Change {
        if controller.is_device_emulated() {
            return self.copy_control(control, controller, device);
        }
        let to_init = control.state() == RequestedState::State(AlState::Init);
        if self.has_error() {
            if !control.contains(AlControl::ACKNOWLEDGE) && !to_init {
                return Change::None;
            }
            self.show(AlStatusRegister::of(self.shown_state()), AlStatus::NONE, controller);
        }
        let id = AlStatus(controller.settings().device_id);
        if control.contains(AlControl::REQUEST_ID) && id != AlStatus::NONE {
            self.show(self.status.with(AlStatusRegister::ID_LOADED), id, controller);
        } else if self.status.contains(AlStatusRegister::ID_LOADED) {
            self.show(self.status.without(AlStatusRegister::ID_LOADED), AlStatus::NONE, controller);
        }
        let from = self.state();
        self.waiting = None;
        device.set_communication(&controller.communication());
        if self.is_in_bootstrap() {
            self.leave_bootstrap(control.state(), controller);
            return Change::None;
        }
        if control.state() == RequestedState::Boot && from == AlState::Init && device.files().is_some() {
            return self.enter_bootstrap(controller);
        }
        let RequestedState::State(to) = control.state() else {
            let refused = device.request_state(control.state()).err();
            let code = refused.unwrap_or(AlStatus::UNKNOWN_STATE);
            // Bootstrap can be entered from Init only, whether the slave supports it or not: in other states the AL
            // status code is "invalid change".
            let is_wrong_step = code == AlStatus::BOOT_UNSUPPORTED && from != AlState::Init && device.state() == from;
            let code = if is_wrong_step { AlStatus::INVALID_CHANGE } else { code };
            self.fail(device.state(), code, controller);
            return Change::None;
        };
        if to == from {
            return Change::None;
        }
        match self.change(from, to, now, controller, device) {
            Ok(change) => change,
            Err(code) => {
                self.fail(device.state(), code, controller);
                Change::None
            }
        }
    }

    /// Goes from Init to bootstrap, with the mailboxes that the EEPROM defines for it.
    fn enter_bootstrap(&mut self, controller: &mut Controller) -> Change {
        match Self::check_boot_mailbox(controller) {
            Ok(()) => {
                self.show(AlStatusRegister::of(RequestedState::Boot), AlStatus::NONE, controller);
                Change::MailboxOn
            }
            Err(code) => {
                self.fail(AlState::Init, code, controller);
                Change::None
            }
        }
    }

    /// Goes from bootstrap to Init. Any other state is refused.
    fn leave_bootstrap(&mut self, to: RequestedState, controller: &mut Controller) {
        match to {
            RequestedState::State(AlState::Init) => self.succeed(AlState::Init, controller),
            RequestedState::Boot => {}
            RequestedState::State(_) => self.fail_in(RequestedState::Boot, AlStatus::INVALID_CHANGE, controller),
            RequestedState::Unknown(_) => self.fail_in(RequestedState::Boot, AlStatus::UNKNOWN_STATE, controller),
        }
    }

    fn change(
        &mut self,
        from: AlState,
        to: AlState,
        now: Ns,
        controller: &mut Controller,
        device: &mut dyn Slave,
    ) -> Result<Change, AlStatus> {
        let checked = match (from, to) {
            // `try_op` goes to OP once outputs and SYNC0 have come, or reports an error after `OP_WAIT_NS`.
            (AlState::SafeOp, AlState::Op) => {
                self.waiting = Some(now + OP_WAIT_NS);
                return Ok(Change::None);
            }
            (AlState::Init, AlState::PreOp) => self.check_mailbox(controller),
            (AlState::PreOp, AlState::SafeOp) => self.check_process_data(controller),
            _ => Ok(()),
        };
        // A refusal by the device takes precedence over the checks of the controller.
        device.enter(to)?;
        if let Err(code) = checked {
            // Every device can go to a lower state, so the result is always `Ok`.
            let _ = device.enter(from);
            return Err(code);
        }
        self.succeed(to, controller);
        match (from, to) {
            (AlState::Init, AlState::PreOp) => Ok(Change::MailboxOn),
            (AlState::PreOp, AlState::SafeOp) => {
                self.is_synchronized = controller.sync.is_running();
                (self.outputs_came, self.sync_came) = (false, false);
                let limit = if self.is_synchronized { device.sync_lock_limit_ns() } else { None };
                self.lock_due = limit.map(|limit| now + limit);
                Ok(Change::ProcessDataOn)
            }
            _ => Ok(Change::None),
        }
    }

    /// Goes to OP once outputs and SYNC0 have come, or fails when the waiting time is over.
    fn try_op(&mut self, until: Ns, now: Ns, controller: &mut Controller, device: &mut dyn Slave) {
        let has_outputs = active_len(&controller.managers.registers(self.managers.outputs)) > 0;
        let lacks_outputs = has_outputs && !self.outputs_came && device.waits_for_outputs();
        let lacks_sync = self.is_synchronized && !self.sync_came;
        if lacks_outputs || lacks_sync {
            if now >= until {
                if lacks_sync {
                    device.report_sync(SyncEvent::NotLocked);
                }
                let code = match device.state() {
                    AlState::SafeOp if lacks_outputs => AlStatus::WATCHDOG,
                    AlState::SafeOp => AlStatus::NO_SYNC,
                    _ => device.al_status(),
                };
                self.fail(device.state(), code, controller);
            }
            return;
        }
        self.waiting = None;
        // The master may have activated SYNC0 since it requested OP, so the device gets the present settings.
        device.set_communication(&controller.communication());
        match device.enter(AlState::Op) {
            Ok(()) => self.succeed(AlState::Op, controller),
            Err(code) => self.fail(device.state(), code, controller),
        }
    }

    /// Repeats the checks of the mailbox and of process data after the master has written activate registers of sync managers
    /// (`activated`, bit n for sync manager n). `lens` are the lengths of outputs and inputs at the change to SafeOP, bytes. If
    /// a check fails, the slave falls back to a lower state.
    pub(super) fn check_again(
        &mut self,
        activated: u16,
        lens: (usize, usize),
        controller: &mut Controller,
        device: &mut dyn Slave,
    ) {
        let state = self.state();
        let touched = |n: u8| activated & 1 << n != 0;
        if self.is_in_bootstrap() {
            if (touched(REQUESTS) || touched(ANSWERS))
                && let Err(code) = Self::check_boot_mailbox(controller)
            {
                self.fail(AlState::Init, code, controller);
            }
            return;
        }
        if state == AlState::Init {
            return;
        }
        if self.has_mailbox
            && (touched(REQUESTS) || touched(ANSWERS))
            && let Err(code) = self.check_mailbox(controller)
        {
            return self.fall(AlState::Init, code, controller, device);
        }
        if state < AlState::SafeOp {
            return;
        }
        let ProcessManagers { outputs, inputs } = self.managers;
        if !touched(inputs) && !touched(outputs) {
            return;
        }
        let has_len = |manager: &SyncManager, len| usize::from(active_len(manager)) == len;
        let checked = self.check_areas(controller).and_then(|[outputs, inputs]| match lens {
            (_, len) if !has_len(&inputs, len) => Err(AlStatus::INVALID_INPUTS),
            (len, _) if !has_len(&outputs, len) => Err(AlStatus::INVALID_OUTPUTS),
            _ => Ok(()),
        });
        if let Err(code) = checked {
            self.fall(AlState::PreOp, code, controller, device);
        }
    }
}

/// The length of a sync manager; 0 if it is not enabled.
pub(super) const fn active_len(manager: &SyncManager) -> u16 {
    if manager.is_enabled() { manager.len } else { 0 }
}
