//! Requests for the analog input: code 35, ADC_FUNC_OP.

use crate::xf::Malformed;
use crate::xf::layout::{FieldLayout, FieldList, FieldReader, FieldWriter, Fixed, at, layout};
use crate::xf::value::choices;

layout! {
    /// ECM_AdcClose, command code 35, parameter byte 41: closes the ADC (XF EN 1084).
    pub struct AdcClose;
}

choices! {
    /// The signal that the ADC measures.
    pub AdcMode(u32), "ECM_AdcOpen mode", "0x000 single ended, 0x100 differential" {
        /// 0x000: one input against ground.
        SingleEnded = 0x000,
        /// 0x100: the difference between two inputs.
        Differential = 0x100,
    }
}

layout! {
    /// ECM_AdcOpen, command code 35, parameter byte 40: opens the ADC (XF EN 1076). Data, 4 bytes (@offset): @0 u32
    /// mode.
    pub struct AdcOpen {
        /// Whether one input is measured against ground, or the difference between two inputs.
        pub mode: AdcMode = at(0),
    }
}

/// Declares requests whose only content is a fixed u32, in data with a length of `of` bytes. When a request is decoded,
/// only the bits in the mask `bits` are compared.
macro_rules! fixed {
    ($(
        $(#[$doc:meta])*
        $name:ident = $decl:expr, bits $looked_at:expr, of $bytes:expr, $called:literal, $allowed:literal;
    )*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        pub struct $name;

        impl $name {
            const NUMBER: Fixed = Fixed::new::<u32>($decl, $looked_at, $called, $allowed);
        }

        impl FieldLayout<'_> for $name {
            const FIELDS: FieldList = FieldList::NONE.with(Self::NUMBER.field);
            const END: usize = $bytes;

            fn put(&self, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
                Self::NUMBER.put(to)
            }

            fn take(from: &FieldReader<'_>) -> Result<Self, Malformed> {
                Self::NUMBER.check(from).map(|()| Self)
            }
        }
    )*};
}

/// The number 0x1000, which the manuals prescribe for data of the ADC commands and do not explain.
///
/// `[OURS]` It looks like a mask of sample modules with bit 12 set, since [`AdcGetConvData`] sends 12. Additional bits are
/// accepted. A request without this bit is malformed, since no manual describes it.
const SAMPLE_MODULE: u32 = 0x1000;
/// Size of the data of [`AdcConfigSampleModule`], in bytes. `[OURS]` The two reserved words in these data are ignored.
const WITH_RESERVED: usize = 12;
/// A mask of all bits: the number must equal the one in the manuals.
const WHOLE: u32 = u32::MAX;

fixed! {
    /// ECM_AdcConfigSampleModule, command code 35, parameter byte 42: sets the trigger of conversions to software,
    /// which is the only choice (XF EN 1091). Data, 12 bytes (@offset): @0 reserved, @4 u32 trigger, 0, @8 reserved.
    AdcConfigSampleModule = at(4).named("trigger").or(0), bits WHOLE, of WITH_RESERVED,
        "ECM_AdcConfigSampleModule trigger", "0 software";

    /// ECM_AdcGetDataValidFlag, command code 35, parameter byte 17: asks whether a conversion is complete (XF EN 1102).
    /// Data, 4 bytes (@offset): @0 u32 0x1000. Answer: u32 at byte 0 of the data, not 0 if complete.
    AdcGetDataValidFlag = at(0).hex().or(SAMPLE_MODULE), bits SAMPLE_MODULE, of 4,
        "ECM_AdcGetDataValidFlag number", "0x1000, or more bits beside it";

    /// ECM_AdcStartConv, command code 35, parameter byte 12: starts a conversion (XF EN 1117). Data, 4 bytes (@offset):
    /// @0 u32 0x1000; additional bits are accepted.
    AdcStartConv = at(0).hex().or(SAMPLE_MODULE), bits SAMPLE_MODULE, of 4,
        "ECM_AdcStartConv number", "0x1000, or more bits beside it";

    /// ECM_AdcGetConvData, command code 35, parameter byte 15: reads the converted value (XF EN 1128). Data, 4 bytes
    /// (@offset): @0 u32 12, which the manuals prescribe without an explanation. Answer: u32 at byte 0 of the data,
    /// 0..=4095 for 0 V to 3.3 V.
    AdcGetConvData = at(0).hex().or(12), bits WHOLE, of 4, "ECM_AdcGetConvData number", "12";
}
