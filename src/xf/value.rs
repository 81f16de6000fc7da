//! Values that several requests use, limited to their range.

use super::fields::FieldKind;
use super::layout::{FieldValue, field_values};
use super::{Malformed, NetworkState};
use crate::ethercat::AlState;

/// Defines number types with an upper limit.
macro_rules! numbers {
    ($($(#[$doc:meta])* $name:ident($int:ty), $field:literal, 0..=$most:literal;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub struct $name($int);

        impl $name {
            /// The largest allowed number.
            pub const MAX: Self = Self($most);

            /// The number `n`; `None` if it is above [`Self::MAX`].
            pub const fn new(n: $int) -> Option<Self> {
                if n <= $most { Some(Self(n)) } else { None }
            }

            /// The number, which is at most [`Self::MAX`].
            pub const fn get(self) -> $int {
                self.0
            }

            /// Converts the number `n` from the wire.
            ///
            /// # Errors
            /// `n` is above [`Self::MAX`].
            pub fn decode(n: $int) -> Result<Self, Malformed> {
                <Self as FieldValue>::of(n.into())
            }
        }

        impl FieldValue for $name {
            const BYTES: u8 = size_of::<$int>() as u8;
            const KIND: FieldKind = FieldKind::Number;

            fn number(self) -> u32 {
                self.0.into()
            }

            fn of(found: u32) -> Result<Self, Malformed> {
                let malformed = Malformed { field: $field, found, allowed: super::Allowed::Between(0, $most) };
                <$int>::try_from(found).ok().and_then(Self::new).ok_or(malformed)
            }
        }
    )*};
}

numbers! {
    /// A slave by its position on the cable, 0..=127; the first one is 0.
    SlaveNumber(u8), "slave number", 0..=127;
    /// An axis of the CiA 402 helper, 0..=127; the first one is 0.
    MotorNumber(u8), "motor number", 0..=127;
    /// A GPIO channel, 0..=19; above 15 only with certain versions of the chip.
    GpioChannel(u8), "GPIO channel", 0..=19;
    /// GPIO 16 to 19 as bits: bit k is GPIO 16 + k.
    UpperPins(u8), "mask of GPIO 16 to 19", 0..=0x0F;
    /// GPIO 0 to 19 as bits: bit k is GPIO k.
    AllPins(u32), "bits of GPIO 0 to 19", 0..=0xF_FFFF;
    /// A 12-bit analog value, 0..=4095, for 0 V to 3.3 V.
    Analog(u32), "analog value", 0..=4095;
    /// The delay of a DAC conversion, 0..=1023 in units of 1/96 us. A full-scale step takes 8 us, so more than 768 is
    /// advised.
    DacDelay(u32), "DAC delay", 0..=1023;
    /// The number of bytes to read from the flash memory at once, 0..=256.
    FlashBytes(u32), "FOE_FUNC_REQ flash bytes", 0..=256;
    /// An address in the chip's flash memory for files, 0..=0x3FFFF.
    FlashAddress(u32), "flash address", 0..=0x3_FFFF;
}

/// One slave or all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Slaves {
    /// The slave with this number.
    One(SlaveNumber),
    /// All slaves: 0xFF.
    All,
}

impl Slaves {
    /// The byte on the wire that means all slaves.
    const ALL: u8 = 0xFF;

    /// The byte on the wire: 0..=127 or 0xFF.
    pub const fn code(self) -> u8 {
        match self {
            Self::One(slave) => slave.get(),
            Self::All => Self::ALL,
        }
    }
}

field_values! {
    Slaves, 1, FieldKind::Named(&[("all", Slaves::ALL as u32)]), |slaves| slaves.code().into(), |code| match code as u8 {
        Slaves::ALL => Ok(Slaves::All),
        number => match SlaveNumber::new(number) {
            Some(slave) => Ok(Slaves::One(slave)),
            None => Err(Malformed::only("slave number", code, "0 to 127, or 255 for all")),
        },
    };
    bool, 1, Switch::KIND, |on| on.into(), |code| Ok(Switch::of(code)? == Switch::On);
}

impl From<SlaveNumber> for Slaves {
    fn from(slave: SlaveNumber) -> Self {
        Self::One(slave)
    }
}

/// Defines enums with one variant for each code that the manuals allow; decoding fails for any other code. `but for
/// MASK` names bits of the code that decoding ignores.
macro_rules! choices {
    ($($(#[$doc:meta])* $vis:vis $name:ident($int:ty), $field:literal, $allowed:literal $(, but for $ignored:ident)? {
        $($(#[$variant_doc:meta])* $variant:ident = $code:literal,)*
    })*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr($int)]
        $vis enum $name {
            $($(#[$variant_doc])* $variant = $code,)*
        }

        #[allow(dead_code, reason = "not every list of codes needs all of it")]
        impl $name {
            /// All values of the enum.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// The names of the values, with their codes.
            pub const NAMES: &'static [(&'static str, u32)] = &[$((stringify!($variant), $code),)*];

            /// The value with this code; `None` for a code that the manuals do not allow.
            pub const fn from_code(code: $int) -> Option<Self> {
                match code {
                    $($code => Some(Self::$variant),)*
                    _ => None,
                }
            }

            /// The code on the wire.
            pub const fn code(self) -> $int {
                self as $int
            }
        }

        impl $crate::xf::layout::FieldValue for $name {
            const BYTES: u8 = size_of::<$int>() as u8;
            const KIND: $crate::xf::fields::FieldKind = $crate::xf::fields::FieldKind::Choice(Self::NAMES);

            fn number(self) -> u32 {
                self.code().into()
            }

            fn of(number: u32) -> Result<Self, $crate::xf::Malformed> {
                let code = number $(& !$ignored)?;
                let known = <$int>::try_from(code).ok().and_then(Self::from_code);
                known.ok_or($crate::xf::Malformed::only($field, code, $allowed))
            }
        }
    )*};
}

pub(super) use choices;

/// Bit 4 of a requested state, which acknowledges an error as in a slave's AL control; one application sends 0x12 after
/// an error (OBS). `[OURS]` The bit is ignored, since a change to any state acknowledges errors.
const ACKNOWLEDGE: u32 = NetworkState::ERROR as u32;

choices! {
    /// An EtherCAT state with the chip's code (XF EN 619). [`AlState`] has no Boot, since no simulated slave supports
    /// it.
    pub EtherCatState(u8), "EtherCAT state", "1 Init, 2 PreOP, 3 Boot, 4 SafeOP, 8 OP", but for ACKNOWLEDGE {
        /// 1: Init.
        Init = 1,
        /// 2: Pre-operational.
        PreOp = 2,
        /// 3: Bootstrap, for file transfer.
        Boot = 3,
        /// 4: Safe-operational.
        SafeOp = 4,
        /// 8: Operational.
        Op = 8,
    }

    /// A switch, off or on.
    pub(super) Switch(u8), "switch", "0 off, 1 on" {
        /// 0: off.
        Off = 0,
        /// 1: on.
        On = 1,
    }
}

impl From<AlState> for EtherCatState {
    fn from(state: AlState) -> Self {
        match state {
            AlState::Init => Self::Init,
            AlState::PreOp => Self::PreOp,
            AlState::SafeOp => Self::SafeOp,
            AlState::Op => Self::Op,
        }
    }
}
