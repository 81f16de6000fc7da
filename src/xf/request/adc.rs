//! The analog input: code 35, ADC_FUNC_OP.

use crate::xf::Malformed;
use crate::xf::layout::{FieldList, Fixed, Layout, Reader, Writer, at, layout};
use crate::xf::value::choices;

layout! {
    /// ECM_AdcClose, code 35, `par` 41: closes the ADC (XF EN 1084).
    pub struct AdcClose;
}

choices! {
    /// What the ADC measures.
    pub AdcMode(u32), "ECM_AdcOpen mode", "0x000 single ended, 0x100 differential" {
        /// 0x000: an input against ground.
        SingleEnded = 0x000,
        /// 0x100: two inputs against each other.
        Differential = 0x100,
    }
}

layout! {
    /// ECM_AdcOpen, code 35, `par` 40: opens the ADC (XF EN 1076). 4 bytes: @0 u32 mode.
    pub struct AdcOpen {
        /// What it measures.
        pub mode: AdcMode = at(0),
    }
}

/// Requests with a fixed number, u32, and as many bytes. Of the number certain bits are looked at.
macro_rules! fixed {
    ($(
        $(#[$doc:meta])*
        $name:ident = $spot:expr, bits $looked_at:expr, of $bytes:expr, $called:literal, $allowed:literal;
    )*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        pub struct $name;

        impl $name {
            const NUMBER: Fixed = Fixed::new::<u32>($spot, $looked_at, $called, $allowed);
        }

        impl Layout<'_> for $name {
            const FIELDS: FieldList = FieldList::NONE.with(Self::NUMBER.field);
            const END: usize = $bytes;

            fn put(&self, to: &mut Writer<'_>) -> Result<(), Malformed> {
                Self::NUMBER.put(to)
            }

            fn take(from: &Reader<'_>) -> Result<Self, Malformed> {
                Self::NUMBER.check(from).map(|()| Self)
            }
        }
    )*};
}

/// The sample module that the manuals' fixed number means, as a bit.
///
/// `[OURS]` The number looks like a mask of modules. A program that names others beside this one is understood; one that
/// does not name it means what no manual describes.
const SAMPLE_MODULE: u32 = 0x1000;
/// The bytes of [`AdcConfigSampleModule`]. `[OURS]` Numbers that are reserved are ignored.
const WITH_RESERVED: usize = 12;
/// A number that has to be the one of the manuals.
const WHOLE: u32 = u32::MAX;

fixed! {
    /// ECM_AdcConfigSampleModule, code 35, `par` 42: conversions are started by software, the one trigger there is
    /// (XF EN 1091). 12 bytes: @0 reserved, @4 u32 0, the trigger, @8 reserved.
    AdcConfigSampleModule = at(4).named("trigger").or(0), bits WHOLE, of WITH_RESERVED,
        "ECM_AdcConfigSampleModule trigger", "0 software";

    /// ECM_AdcGetDataValidFlag, code 35, `par` 17: whether a conversion is done, @0 u32 not 0 (XF EN 1102). 4 bytes:
    /// @0 u32 0x1000.
    AdcGetDataValidFlag = at(0).hex().or(SAMPLE_MODULE), bits SAMPLE_MODULE, of 4,
        "ECM_AdcGetDataValidFlag number", "0x1000, or more bits beside it";

    /// ECM_AdcStartConv, code 35, `par` 12: starts a conversion (XF EN 1117). 4 bytes: @0 u32 0x1000.
    AdcStartConv = at(0).hex().or(SAMPLE_MODULE), bits SAMPLE_MODULE, of 4,
        "ECM_AdcStartConv number", "0x1000, or more bits beside it";

    /// ECM_AdcGetConvData, code 35, `par` 15: the value, @0 u32, 0..=4095 for 0 V to 3.3 V (XF EN 1128). 4 bytes:
    /// @0 u32 12.
    AdcGetConvData = at(0).hex().or(12), bits WHOLE, of 4, "ECM_AdcGetConvData number", "12";
}
