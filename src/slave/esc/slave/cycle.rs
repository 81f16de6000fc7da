//! The cycle of a device: its time advances, it takes over outputs and provides inputs. Its new state is passed to the
//! controller and the mailbox.

use super::EscSlave;
use crate::ethercat::coe::{Emergency, ObjectAddress};
use crate::ethercat::{AlState, Ns};
use crate::slave::esc::Controller;
use crate::slave::esc::application::Application;

/// \[OURS] The interval at which a device is checked for errors to report by emergencies, ns.
pub const ERROR_CYCLE_NS: Ns = 10_000_000;
/// The objects with the error code and the error register of a device, which emergencies carry.
const ERROR_CODE: ObjectAddress = ObjectAddress::new(crate::ethercat::cia402::ERROR_CODE, 0);
const ERROR_REGISTER: ObjectAddress = ObjectAddress::new(0x1001, 0);

impl EscSlave {
    /// Runs a cycle of the device: its time advances, it takes over its newest outputs and provides new inputs. Without
    /// another trigger the next cycle follows in `next_ns`.
    pub(super) fn cycle(&mut self, now: Ns, next_ns: Ns) {
        let passed = self.pass_time(now, next_ns);
        if passed > 0 {
            self.device.step(passed);
        }
        self.end_cycle(now, self.state());
    }

    /// Returns the time by which the caller must advance the device so that it reaches `now`, ns. Schedules the next
    /// cycle in `next_ns`, if neither outputs nor SYNC0 trigger a cycle before.
    pub(super) fn pass_time(&mut self, now: Ns, next_ns: Ns) -> Ns {
        self.free_run = now + next_ns;
        let passed = now.saturating_sub(self.stepped);
        self.stepped += passed;
        passed
    }

    /// Ends a cycle after the device's time has advanced: the device takes over its newest outputs and provides new inputs.
    #[inline]
    pub(super) fn end_cycle(&mut self, now: Ns, state: AlState) {
        if self.has_latches {
            self.pass_latch_changes();
        }
        if state >= AlState::SafeOp {
            let misses_outputs = !self.application.outputs_came && !self.outputs.is_empty();
            let has_outputs = state == AlState::Op && !(misses_outputs && self.device.waits_for_outputs());
            self.device.exchange(has_outputs.then_some(&*self.outputs), &mut self.inputs);
            if !self.waits_for_lock() {
                let Controller { managers, memory, .. } = &mut self.controller;
                managers.put(self.application.managers.inputs, &self.inputs, memory);
            }
        }
        if self.device.state() != state {
            self.application.follow(&mut self.controller, &*self.device);
            self.is_quiet = false;
        }
        if now.saturating_sub(self.looked) >= ERROR_CYCLE_NS {
            self.look_for_errors(now);
        }
    }

    /// Reports the level changes of the device's inputs to the latch inputs of the controller.
    fn pass_latch_changes(&mut self) {
        let Self { controller, device, stepped, .. } = self;
        device.tell_latch_changes(&mut |change| {
            controller.set_latch_input(change.input, change.is_on, stepped.saturating_sub(change.ago_ns));
        });
    }

    /// Whether the device still waits for the first SYNC0 pulse within its time limit. It provides no inputs before that pulse.
    fn waits_for_lock(&self) -> bool {
        let Application { is_synchronized, sync_came, .. } = self.application;
        is_synchronized && !sync_came && self.device.sync_lock_limit_ns().is_some()
    }

    #[inline(never)]
    fn look_for_errors(&mut self, now: Ns) {
        let has_mailbox = self.application.has_mailbox && self.state() > AlState::Init;
        if !self.controller.settings().emergencies || !has_mailbox {
            return;
        }
        self.looked = now;
        let Ok(code) = self.device.upload(ERROR_CODE) else { return };
        let code = code.bits as u16;
        if code != self.error_code {
            self.error_code = code;
            let register = self.device.upload(ERROR_REGISTER).map_or(0, |register| register.bits as u8);
            self.mailbox.raise(Emergency { code, register, data: [0; 5] });
            self.is_quiet = false;
        }
    }
}
