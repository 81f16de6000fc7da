//! A frame passes a slave: what it brings, and the work of the device on its outputs, which the chain lets several slaves do
//! side by side.

use super::EscSlave;
use crate::ethercat::{DatagramHeader, Ns};
use crate::slave::esc::DRIVEN_NS;
use crate::slave::esc::mailbox::{ANSWERS, REQUESTS};
use crate::slave::esc::managers::ManagerEvents;
use crate::slave::plant::Servo;

/// A bit for each sync manager of the mailbox.
const MAILBOX: u16 = 1 << REQUESTS | 1 << ANSWERS;

/// How far a device is with the outputs of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Work {
    /// There is nothing to work on.
    None,
    /// The outputs have come.
    Waiting,
    /// Time passes for so long in the device, its motor among others.
    Stepping(Ns),
    /// Time has passed in the device.
    Stepped,
}

impl EscSlave {
    /// A frame comes to the slave.
    #[inline]
    pub(in crate::slave::esc) fn begin_frame(&mut self, arrival: Ns) {
        self.advance(arrival);
        self.controller.begin_frame(arrival);
    }

    /// A datagram of the frame passes the slave. What its working counter counts.
    #[inline]
    pub(in crate::slave::esc) fn pass(&mut self, header: &mut DatagramHeader, data: &mut [u8]) -> u16 {
        self.controller.pass(header, data)
    }

    /// The frame has passed: the device sees what it has brought. [`Self::begin_work`] and [`Self::end_work`] have to follow.
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

    /// The device begins to work on the outputs of the frame, if there are some. A motor may be handed out, to be run with those
    /// of other slaves before [`Self::end_work`]; they all run for `step_ns`, which the first one says.
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

    /// The device does the rest of its work on the outputs of the frame.
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
