//! Detects a writer whose program has stopped calling although a velocity or torque that it has commanded is still in
//! force (`hang_ms=`). The server cannot detect this, because the library's background thread continues to send
//! keep-alive messages.
//!
//! The check uses the commands and not the reports: a CSP motion ends with the entries of the board's FIFO and a homing
//! ends at the home position, but a velocity or torque has no end.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::sk::{Frame, MasterCommand, MasterState, SlaveCommand, SlotCommand, SlotSize};

/// The slaves with a velocity or torque in force, which lasts until another command ends it.
pub(super) struct MotionInForce {
    limit: Duration,
    size: SlotSize,
    /// Slaves whose latest motion command was a velocity or a torque other than 0, one bit each.
    slaves: AtomicU64,
}

impl MotionInForce {
    pub(super) const fn new(limit: Duration, size: SlotSize) -> Self {
        Self { limit, size, slaves: AtomicU64::new(0) }
    }

    /// Notes which slaves have a velocity or torque in force after a command frame that the board has accepted. Calls come one
    /// after the other, in the order in which the board has accepted the frames.
    pub(super) fn wrote(&self, frame: &Frame) {
        let mut slaves = self.slaves.load(Ordering::Relaxed);
        for slave in 1..=self.size.max_slaves() {
            let slot = frame.slot(self.size, slave);
            let Ok(SlotCommand { command, .. }) = SlotCommand::decode(&slot, self.size) else { continue };
            let has_no_end = match command {
                SlaveCommand::Csv(motion) => motion.first.target != 0 || motion.second.target != 0,
                SlaveCommand::Cst(torque) => torque != 0,
                SlaveCommand::Csp(_) | SlaveCommand::GoHome | SlaveCommand::ServoOff => false,
                SlaveCommand::GetStatus
                | SlaveCommand::DriveMode { .. }
                | SlaveCommand::AlarmClear
                | SlaveCommand::ServoOn
                | SlaveCommand::IoRead
                | SlaveCommand::IoWrite(_)
                | SlaveCommand::AbortHome
                | SlaveCommand::Other(_) => continue,
            };
            slaves = if has_no_end { slaves | 1 << slave } else { slaves & !(1 << slave) };
        }
        match MasterCommand::decode(&frame.slot(self.size, 0), self.size) {
            // Leaving OP ends all motion.
            Ok(MasterCommand::SetState(state)) if state != MasterState::Op => slaves = 0,
            Ok(MasterCommand::SoftReset) => slaves = 0,
            _ => {}
        }
        self.slaves.store(slaves, Ordering::Relaxed);
    }
}

/// Measures how long the program has made no call of the library on this connection.
pub(super) struct CallMonitor {
    calls: u64,
    since: Instant,
}

impl CallMonitor {
    pub(super) const fn new(now: Instant) -> Self {
        Self { calls: 0, since: now }
    }

    /// Evaluates `calls`, the number of calls so far. Restarts the measurement if this number has changed, a call is in
    /// progress (`is_under_way`) or no velocity or torque is in force. Otherwise returns for how long the program has
    /// made no call, if that is at least `hang_ms=`.
    pub(super) fn look(
        &mut self,
        calls: u64,
        is_under_way: bool,
        now: Instant,
        in_force: &MotionInForce,
    ) -> Option<Duration> {
        if is_under_way || calls != self.calls || in_force.slaves.load(Ordering::Relaxed) == 0 {
            (self.calls, self.since) = (calls, now);
            return None;
        }
        let idle = now.saturating_duration_since(self.since);
        (idle >= in_force.limit).then_some(idle)
    }
}

/// Measures for how long a call that receives has left arrived bytes unread. That happens when a signal handler has interrupted
/// the call and does not return.
#[derive(Default)]
pub(super) struct StuckCall {
    /// When the last message of the link was received, and when the call was first seen to leave bytes unread after that
    /// message.
    since: Option<(Instant, Instant)>,
}

impl StuckCall {
    /// Checks whether a call is stuck. `takes_nothing`: the call is receiving, and has not read bytes that have
    /// arrived. `heard`: when a call has last read a message. Returns for how long the call has read nothing, if that
    /// is at least `hang_ms=` and a velocity or torque is in force.
    pub(super) fn look(
        &mut self,
        takes_nothing: bool,
        heard: Instant,
        now: Instant,
        in_force: &MotionInForce,
    ) -> Option<Duration> {
        if !takes_nothing || in_force.slaves.load(Ordering::Relaxed) == 0 {
            self.since = None;
            return None;
        }
        let since = match self.since {
            Some((then, since)) if then == heard => since,
            _ => now,
        };
        self.since = Some((heard, since));
        let stuck = now.saturating_duration_since(since);
        (stuck >= in_force.limit).then_some(stuck)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sk::Motion;

    const SIZE: SlotSize = SlotSize::Bytes12;

    fn frame(command: SlaveCommand) -> Frame {
        let mut frame = Frame::new();
        frame.put_slave(SIZE, 3, &command.into());
        frame
    }

    /// TCP-22 The link of a silent program ends only while a velocity or torque other than 0 is in force. A call restarts the
    /// time, and so does a call in progress.
    #[test]
    fn a_silent_program_is_given_up_only_while_a_velocity_or_torque_is_in_force() {
        let began = Instant::now();
        let at = |seconds| began + Duration::from_secs(seconds);
        let looks = |command: Option<SlaveCommand>| {
            let in_force = MotionInForce::new(Duration::from_secs(10), SIZE);
            command.into_iter().for_each(|command| in_force.wrote(&frame(command)));
            // A frame with GET_STATUS in every slot starts and ends no motion.
            in_force.wrote(&Frame::new());
            let mut idle = CallMonitor::new(began);
            assert_eq!(idle.look(5, false, at(20), &in_force), None, "calls were made meanwhile");
            assert_eq!(idle.look(5, false, at(29), &in_force), None);
            let given_up = idle.look(5, false, at(30), &in_force);
            assert_eq!(idle.look(6, false, at(31), &in_force), None);
            assert_eq!(idle.look(6, true, at(99), &in_force), None, "a call is under way");
            assert_eq!(idle.look(6, false, at(100), &in_force), None);
            given_up
        };
        for command in [SlaveCommand::Csv(Motion::to(-1)), SlaveCommand::Cst(5)] {
            assert_eq!(looks(Some(command)), Some(Duration::from_secs(10)));
        }
        for command in [
            SlaveCommand::Csv(Motion::to(0)),
            SlaveCommand::Cst(0),
            SlaveCommand::Csp(Motion::to(100)),
            SlaveCommand::GoHome,
            SlaveCommand::ServoOn,
        ] {
            assert_eq!(looks(Some(command)), None);
        }
        assert_eq!(looks(None), None);
    }

    /// TCP-22 A call that does not take arrived bytes makes the link end after the limit. A call that waits for bytes, or takes
    /// some now and then, does not.
    #[test]
    fn a_call_that_stands_still_is_given_up() {
        let began = Instant::now();
        let at = |seconds| began + Duration::from_secs(seconds);
        let in_force = MotionInForce::new(Duration::from_secs(10), SIZE);
        let mut stuck = StuckCall::default();
        assert_eq!(stuck.look(true, at(0), at(1), &in_force), None);
        assert_eq!(stuck.look(true, at(0), at(99), &in_force), None, "nothing moves");
        in_force.wrote(&frame(SlaveCommand::Csv(Motion::to(7))));
        assert_eq!(stuck.look(true, at(100), at(100), &in_force), None);
        assert_eq!(stuck.look(true, at(105), at(109), &in_force), None, "something was taken");
        assert_eq!(stuck.look(false, at(105), at(112), &in_force), None, "nothing has come");
        assert_eq!(stuck.look(true, at(105), at(120), &in_force), None);
        assert_eq!(stuck.look(true, at(105), at(129), &in_force), None);
        assert_eq!(stuck.look(true, at(105), at(130), &in_force), Some(Duration::from_secs(10)));
    }

    /// TCP-22 Leaving OP, a reset and SV_OFF end a velocity that was in force.
    #[test]
    fn leaving_op_a_reset_and_servo_off_end_the_motion_in_force() {
        let mut out_of_op = Frame::new();
        out_of_op.put_master(SIZE, &MasterCommand::SetState(MasterState::PreOp));
        let mut reset = Frame::new();
        reset.put_master(SIZE, &MasterCommand::SoftReset);
        for end in [out_of_op, reset, frame(SlaveCommand::ServoOff)] {
            let in_force = MotionInForce::new(Duration::from_secs(10), SIZE);
            in_force.wrote(&frame(SlaveCommand::Csv(Motion::to(7))));
            assert_ne!(in_force.slaves.load(Ordering::Relaxed), 0);
            in_force.wrote(&end);
            assert_eq!(in_force.slaves.load(Ordering::Relaxed), 0);
        }
    }
}
