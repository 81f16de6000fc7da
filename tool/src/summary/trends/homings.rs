//! Finds where the homings of an axis have found home, in the coordinates from before the homing.

use ecmsk::sk::DriveResponse;

use crate::plot::states::Homing;

/// A step of the position between two reports is a new zero of the coordinates and no motion, if it is above this many
/// times the largest step of the homing plus [`JUMP_MIN`] counts. \[OURS]
const JUMP_TIMES: i64 = 3;
const JUMP_MIN: i64 = 10;

/// A homing that was successful.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Homed {
    /// The position of the new zero in the coordinates from before the homing, in counts. `None` if it is unknown,
    /// because the axis was still moving when its zero changed.
    pub found_at: Option<i64>,
}

/// Finds the homings of one axis.
#[derive(Debug, Default)]
pub struct HomingFinder {
    homing: Homing,
    position: Option<i32>,
    /// The last step of the position, in counts. The next field is the largest step of the homing.
    step: i64,
    largest: i64,
    jump: Option<i64>,
}

impl HomingFinder {
    /// Must be called when the host sends GO_HOME.
    pub const fn ask(&mut self) {
        self.homing.ask();
    }

    /// Must be called when reports do not show the axis: it is lost, or the network is not in OP.
    pub fn interrupt(&mut self) {
        self.homing.interrupt();
        self.position = None;
    }

    /// Processes a report. Returns the homing that has succeeded with this report, if there is one.
    pub fn report(&mut self, at_ns: i64, drive: &DriveResponse, is_aborted: bool) -> Option<Homed> {
        let was_homing = self.homing.is_under_way();
        let is_failed = self.homing.report(at_ns, drive, is_aborted);
        let is_homing = self.homing.is_under_way();
        let before = self.position.replace(drive.position);
        let step = before.map(|before| i64::from(drive.position) - i64::from(before));
        if !was_homing {
            (self.step, self.largest, self.jump) = (step.unwrap_or_default(), 0, None);
            return None;
        }
        let step = step?;
        let stood = self.step == 0;
        if self.largest > 0 && step.abs() > JUMP_TIMES * self.largest + JUMP_MIN {
            self.jump = Some(-step);
        } else if is_homing {
            self.largest = self.largest.max(step.abs());
        }
        self.step = step;
        let is_attained = !is_homing && !is_failed && !is_aborted && drive.statusword.is_enabled();
        is_attained.then(|| Homed { found_at: self.jump.or(stood.then_some(-step)) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecmsk::cia402::Statusword;
    use ecmsk::sk::{CommandId, SlaveResponse};

    const ENABLED: u16 = 0x0237;

    /// The homing of an axis with these positions, one per millisecond. The homing ends with the last position.
    fn homed(positions: &[i32]) -> Option<Homed> {
        let mut finder = HomingFinder::default();
        finder.ask();
        let mut found = None;
        for (ms, position) in (0..).zip(positions) {
            let is_last = ms as usize + 1 == positions.len();
            let word = if is_last { ENABLED | Statusword::BIT12 | Statusword::TARGET_REACHED } else { ENABLED };
            let drive = DriveResponse {
                head: SlaveResponse { id: CommandId::GoHome.code(), index: 0 },
                statusword: Statusword(word),
                position: *position,
                torque: 0,
                error_code: 0,
            };
            found = finder.report(ms * 1_000_000, &drive, false);
        }
        found
    }

    /// The zero may change at the end, when the axis is at rest, by any number of counts. It may also change during the
    /// motion, by a jump that is too large for a motion.
    #[test]
    fn a_new_zero_is_found() {
        let at = |found_at| Some(Homed { found_at });
        assert_eq!(homed(&[100, 101, 104, 110, 112, 112, 112, 0]), at(Some(112)));
        assert_eq!(homed(&[-5, -6, -7, -6, -4, -3, -3, 0]), at(Some(-3)));
        assert_eq!(homed(&[5, 4, 2, 0, 0, 0]), at(Some(0)), "it was right");
        assert_eq!(homed(&[100, 101, 104, 107, 2, 3, 3, 3]), at(Some(105)), "while it moved");
        assert_eq!(homed(&[100, 101, 104, 107, 109]), at(None), "nobody knows");
    }
}
