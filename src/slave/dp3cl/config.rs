//! The configuration of a DP3CL: its rating, its dial switch, the wiring of its inputs, and variants for points that the
//! manufacturer's manual leaves open or contradicts.

use super::dial::Dial;
use super::rating::Rating;
use crate::slave::state_machine::TransitionTimes;
use crate::slave::switches::{Input, Travel};

/// Alternative behaviours at points that the manuals leave open or contradict, where a real drive may differ from this
/// model. All are off by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dp3clVariants {
    /// The start address of sync manager 1 must be in the range that the manual gives, 0x1200 to 0x12FF. \[OURS] Off by
    /// default, because the manufacturer's ESI file puts sync manager 1 at 0x1080.
    pub strict_sync_managers: bool,
    /// PDOs have 10 sub-indices, as in the manufacturer's ESI file, instead of 24 as in the manual \[OURS].
    pub ten_entries: bool,
    /// A set-point during a motion with controlword bit 5 = 0 is stored and starts after the motion, as CiA 402 says.
    /// \[OURS] Off by default: the manual says that a new command must be sent.
    pub one_deep_buffer: bool,
    /// 0x60FF, 0x606B, 0x606D and 0x606F are in command units/s, as CiA 402 says. \[OURS] Off by default: they are in 0.1
    /// rpm.
    pub speeds_in_units: bool,
    /// The motor has no index pulse. A homing method that needs an index pulse runs until a limit switch or a halt ends
    /// it \[OURS].
    pub without_index: bool,
}

/// The configuration of a [`Dp3cl`](super::Dp3cl).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dp3clConfig {
    /// The display name of the drive.
    pub name: String,
    /// Serial number, 0x1018:4.
    pub serial: u32,
    /// The rating: peak current and supply range.
    pub rating: Rating,
    /// The position of the shaft at power-on, command units.
    pub position: i64,
    /// The switches and end stops along the travel, in command units. \[OURS] The index pulse comes once per turn, at the
    /// position [`Travel::index`].
    pub travel: Travel,
    /// For each of the input terminals SI1 to SI4, the sensor that is wired to it (a limit switch or the home switch);
    /// `None` for a terminal without a sensor.
    pub wiring: [Option<Input>; 4],
    /// The durations of the transitions of the CiA 402 state machine.
    pub times: TransitionTimes,
    /// The positions of the dial switch, SW1 to SW8.
    pub dial: Dial,
    /// The supply voltage, mV.
    pub supply_mv: u32,
    /// Whether a motor is connected.
    pub has_motor: bool,
    /// The alternative behaviours that are switched on.
    pub variants: Dp3clVariants,
}

impl Default for Dp3clConfig {
    fn default() -> Self {
        Self {
            name: "dp3cl".into(),
            serial: 0,
            rating: Rating::default(),
            position: 0,
            travel: Travel::for_turn(super::parameters::SUBDIVISION_DEFAULT.into()),
            wiring: super::inputs::USUAL_WIRING,
            times: TransitionTimes::default(),
            dial: Dial::default(),
            supply_mv: 36_000,
            has_motor: true,
            variants: Dp3clVariants::default(),
        }
    }
}
