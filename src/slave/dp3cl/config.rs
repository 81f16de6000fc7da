//! What a DP3CL is built and set up as: its rating, its dial switch, what is wired to its inputs, and the variants of
//! decisions where the maker's manual says nothing or contradicts itself.

use super::dial::Dial;
use super::rating::Rating;
use crate::slave::state_machine::TransitionTimes;
use crate::slave::switches::{Input, Travel};

/// The variants of decisions that a real drive may settle otherwise; all off by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dp3clVariants {
    /// The start address of sync manager 1 has to be in the window that the manual prints, 0x1200 to 0x12FF. \[OURS] Off,
    /// since the maker's own slave description puts it at 0x1080.
    pub strict_sync_managers: bool,
    /// PDOs have 10 sub-indices as in the maker's slave description, not 24 as in the manual \[OURS].
    pub ten_entries: bool,
    /// A set-point during a motion with bit 5 = 0 is kept and begins after the motion, as CiA 402 says. \[OURS] Off: the
    /// manual says that a new command must be sent.
    pub one_deep_buffer: bool,
    /// 0x60FF, 0x606B, 0x606D and 0x606F are in command units/s, as CiA 402 says. \[OURS] Off: they are in 0.1 rpm.
    pub speeds_in_units: bool,
    /// The motor has no index pulse: homing methods that need it run until a limit switch or a halt ends them \[OURS].
    pub without_index: bool,
}

/// The configuration of a [`Dp3cl`](super::Dp3cl).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dp3clConfig {
    /// The name that people know it by.
    pub name: String,
    /// Serial number, 0x1018:4.
    pub serial: u32,
    /// The rating.
    pub rating: Rating,
    /// Where the shaft stands at power-on, command units.
    pub position: i64,
    /// Its switches and end stops along the travel, in command units. \[OURS] An index pulse comes once a turn, at the place that
    /// [`Travel::index`] says.
    pub travel: Travel,
    /// The sensor that is wired to each of SI1 to SI4; `None`: none is.
    pub wiring: [Option<Input>; 4],
    /// How long the transitions of its state machine take.
    pub times: TransitionTimes,
    /// The dial switch.
    pub dial: Dial,
    /// The supply voltage, mV.
    pub supply_mv: u32,
    /// Whether a motor is connected.
    pub has_motor: bool,
    /// Variants of decisions.
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
