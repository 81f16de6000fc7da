//! The values that an axis reports after each step: position, torque, error code, and the bits of its statusword.

use super::{Axis, FOLLOWING_ERROR, Motion};
use crate::ethercat::cia402::{DriveState, Mode, Statusword};
use crate::slave::plant::PlantReading;

/// The values of an axis at the end of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Measured {
    /// Statusword, 0x6041.
    pub statusword: Statusword,
    /// Torque actual value, 0x6077, 0.1 % of rated torque.
    pub torque: i16,
    /// Position actual value, 0x6064, counts.
    pub position: i32,
    /// Error code, 0x603F.
    pub error_code: u16,
}

impl Axis {
    /// The values measured at the end of the last step, or when the position was set since.
    pub const fn measured(&self) -> &Measured {
        &self.measured
    }

    pub(super) fn measure(&mut self) {
        let PlantReading { position, torque, limited } = self.plant.reading();
        let torque = rounded(torque * 1000.0);
        self.measured = Measured {
            statusword: self.statusword(limited),
            torque: torque.clamp(i16::MIN.into(), i16::MAX.into()) as i16,
            position: position.wrapping_add(self.origin) as i32,
            error_code: self.machine.fault().map_or(0, |fault| fault.code),
        };
    }

    /// The statusword: the state bits with bits 10 to 13. While the axis is off or brakes in a cyclic mode, bits 10 to 12
    /// are 0 \[OURS]. `limited` says whether the plant was at a limit of its torque or speed.
    fn statusword(&self, limited: bool) -> Statusword {
        let mut word = self.machine.status_bits();
        if self.mode == Mode::Homing {
            let limited = self.motion == Motion::Follow && limited;
            let limit = if limited { Statusword::INTERNAL_LIMIT } else { 0 };
            return Statusword(word | limit | self.homing.status_bits(self.is_standing_still()));
        }
        if self.motion == Motion::Follow && self.machine.state() == DriveState::OperationEnabled {
            word |= Statusword::BIT12;
            if self.target_reached {
                word |= Statusword::TARGET_REACHED;
            }
            if self.position_limited || limited {
                word |= Statusword::INTERNAL_LIMIT;
            }
        }
        if self.machine.fault().is_some_and(|fault| fault.code == FOLLOWING_ERROR) {
            word |= Statusword::BIT13;
        }
        Statusword(word)
    }
}

/// The nearest integer; halves are rounded away from 0.
pub(in crate::slave) fn rounded(x: f64) -> i64 {
    (if x < 0.0 { x - 0.5 } else { x + 0.5 }) as i64
}
