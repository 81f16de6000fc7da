//! The ratings of the DP3CL: peak current and supply range.

/// The rating of a DP3CL-ABC, encoded in its model number ABC: peak current and supply range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rating {
    /// DP3CL-305: 3 A, 20 to 50 V.
    A3,
    /// DP3CL-705: 7 A, 20 to 50 V.
    #[default]
    A7,
    /// DP3CL-808: 8.4 A, 20 to 80 V.
    A8,
}

impl Rating {
    /// The number in the model name, such as 705.
    pub const fn number(self) -> u16 {
        match self {
            Self::A3 => 305,
            Self::A7 => 705,
            Self::A8 => 808,
        }
    }

    /// The maximum of P4-00, peak current, in units of 100 mA.
    pub const fn peak_max_100ma(self) -> u16 {
        match self {
            Self::A3 => 40,
            Self::A7 => 70,
            Self::A8 => 84,
        }
    }

    /// The factory value of P4-00, peak current, in units of 100 mA.
    pub const fn peak_default_100ma(self) -> u16 {
        match self {
            Self::A3 => 30,
            Self::A7 => 70,
            Self::A8 => 84,
        }
    }

    /// The maximum supply voltage, mV. A higher voltage raises the overvoltage alarm. \[OURS] The manual gives the supply
    /// range but no threshold for the alarm.
    pub const fn supply_max_mv(self) -> u32 {
        match self {
            Self::A3 | Self::A7 => 50_000,
            Self::A8 => 80_000,
        }
    }
}
