//! Handling of a frame by a slave: its datagrams, and the cycle in which the device processes the outputs of the frame. The
//! chain runs this cycle for several slaves together, because their motors are then computed with vector instructions.

use super::EscSlave;
use crate::ethercat::{DatagramHeader, Ns};
use crate::slave::esc::DRIVEN_NS;
use crate::slave::esc::mailbox::{ANSWERS, REQUESTS};
use crate::slave::esc::managers::ManagerEvents;
use crate::slave::plant::Servo;

/// The bits of both mailbox sync managers in the masks of [`ManagerEvents`].
const MAILBOX: u16 = 1 << REQUESTS | 1 << ANSWERS;

/// How far a device has processed the outputs of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Work {
    /// The frame has brought no outputs, or they are processed.
    None,
    /// Outputs have come, and the device's cycle for them has not begun.
    Waiting,
    /// The device's cycle has begun, and the device has to advance by this time, ns. If [`EscSlave::begin_work`] has returned
    /// its motor, the caller has to run the motor for that time.
    Stepping(Ns),
    /// The device has advanced to the present time. It still has to take over outputs and provide inputs.
    Stepped,
}

impl EscSlave {
    /// Begins a frame that arrives at time `arrival`.
    #[inline]
    pub(in crate::slave::esc) fn begin_frame(&mut self, arrival: Ns) {
        self.advance(arrival);
        self.controller.begin_frame(arrival);
    }

    /// Processes a datagram of the frame. Returns the increment of its working counter.
    #[inline]
    pub(in crate::slave::esc) fn pass(&mut self, header: &mut DatagramHeader, data: &mut [u8]) -> u16 {
        self.controller.pass(header, data)
    }

    /// Ends the frame: the device handles what the frame has brought. [`Self::begin_work`] and [`Self::end_work`] must follow;
    /// without them the device does not process new outputs.
    #[inline]
    pub(in crate::slave::esc) fn end_frame(&mut self) {
        let mailbox = if self.application.has_mailbox { MAILBOX } else { 0 };
        let done = self.controller.managers.events;
        let is_common = (done.written | done.read) & mailbox == 0 && done.activated == 0;
        if !self.is_quiet || !is_common || self.controller.is_set_anew() {
            return self.react(self.controller.arrival);
        }
        self.controller.managers.events = ManagerEvents::default();
        if done.written & 1 << self.application.managers.outputs != 0 && self.take_outputs(self.quiet_state) {
            self.work = Work::Waiting;
        }
    }

    /// Begins the device's cycle for the outputs of the frame, if there are any. May return the device's motor, which
    /// the caller runs together with the motors of other slaves before [`Self::end_work`]. All these motors run for the
    /// same time `step_ns`, ns: the caller passes 0, and the first slave sets it. A slave that needs another time
    /// advances its motor alone.
    #[inline]
    pub(in crate::slave::esc) fn begin_work(&mut self, step_ns: &mut Ns) -> Option<&mut Servo> {
        if self.work == Work::None {
            return None;
        }
        let passed = self.pass_time(self.controller.arrival, DRIVEN_NS);
        if *step_ns == 0 {
            *step_ns = passed;
        }
        if passed == 0 || passed != *step_ns {
            self.work = Work::Stepped;
            self.device.step(passed);
            return None;
        }
        self.work = Work::Stepping(passed);
        self.device.begin_step(passed)
    }

    /// Completes the device's cycle: it takes over the outputs of the frame and provides new inputs.
    #[inline]
    pub(in crate::slave::esc) fn end_work(&mut self) {
        match std::mem::replace(&mut self.work, Work::None) {
            Work::None | Work::Waiting => return,
            Work::Stepping(ns) => self.device.end_step(ns),
            Work::Stepped => {}
        }
        self.end_cycle(self.controller.arrival, self.quiet_state);
    }
}
