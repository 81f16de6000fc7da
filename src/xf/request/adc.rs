//! The analog input: code 35, ADC_FUNC_OP.

use super::{Analog, Arguments, Call, plain};
use crate::ethercat::U32Le;
use crate::xf::value::choices;
use crate::xf::{CommandCode, Malformed, segment};

plain! {
    /// ECM_AdcClose, code 35, `par` 41: closes the ADC (XF EN 1084).
    AdcClose, AdcFunction(41) -> ();
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

/// ECM_AdcOpen, code 35, `par` 40: opens the ADC (XF EN 1076). 4 bytes: @0 u32 mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct AdcOpen {
    /// What it measures.
    pub mode: AdcMode,
}

impl Call<'_> for AdcOpen {
    const CODE: CommandCode = CommandCode::AdcFunction;
    const FUNCTION: Option<u8> = Some(40);
    type Answer<'a> = ();

    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        Ok(Arguments::NONE.len(segment::put(data, &U32Le::new(self.mode.code()))?))
    }

    fn decode(_: &Arguments, data: &[u8]) -> Result<Self, Malformed> {
        Ok(Self { mode: AdcMode::decode(segment::get::<U32Le>(data)?.get())? })
    }
}

/// Requests whose data are fixed numbers, u32 each, and which bits of them are looked at.
macro_rules! fixed {
    ($(
        $(#[$doc:meta])*
        $name:ident($function:literal) = $numbers:expr, looked at $mask:expr, $field:literal, $allowed:literal, $answer:ty;
    )*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        pub struct $name;

        impl Call<'_> for $name {
            const CODE: CommandCode = CommandCode::AdcFunction;
            const FUNCTION: Option<u8> = Some($function);
            type Answer<'a> = $answer;

            fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
                Ok(Arguments::NONE.len(segment::put(data, &$numbers.map(U32Le::new))?))
            }

            fn decode(_: &Arguments, data: &[u8]) -> Result<Self, Malformed> {
                // As many numbers as are fixed ones.
                let mut found = $numbers.map(U32Le::new);
                let bytes = segment::get_at(data, 0, size_of_val(&found))?;
                bytemuck::bytes_of_mut(&mut found).copy_from_slice(bytes);
                let differs = |((found, fixed), mask): &((&U32Le, u32), u32)| found.get() & mask != fixed & mask;
                match found.iter().zip($numbers).zip($mask).find(differs) {
                    Some(((found, _), _)) => Err(Malformed::only($field, found.get(), $allowed)),
                    None => Ok(Self),
                }
            }
        }
    )*};
}

/// The sample module that the manuals' fixed number means, as a bit.
///
/// `[OURS]` The number looks like a mask of modules. A program that names others beside this one is understood; one that
/// does not name it means what no manual describes.
const SAMPLE_MODULE: u32 = 0x1000;
/// A number that is reserved. `[OURS]` It is ignored.
const RESERVED: u32 = 0;
/// A number that has to be the one of the manuals.
const WHOLE: u32 = u32::MAX;

fixed! {
    /// ECM_AdcConfigSampleModule, code 35, `par` 42: conversions are started by software, the one trigger there is
    /// (XF EN 1091). 12 bytes: @0 reserved, @4 u32 0, the trigger, @8 reserved.
    AdcConfigSampleModule(42) = [0; 3], looked at [RESERVED, WHOLE, RESERVED],
        "ECM_AdcConfigSampleModule trigger", "0 software", ();

    /// ECM_AdcGetDataValidFlag, code 35, `par` 17: whether a conversion is done, @0 u32 not 0 (XF EN 1102). 4 bytes:
    /// @0 u32 0x1000.
    AdcGetDataValidFlag(17) = [SAMPLE_MODULE], looked at [SAMPLE_MODULE],
        "ECM_AdcGetDataValidFlag number", "0x1000, or more bits beside it", u32;

    /// ECM_AdcStartConv, code 35, `par` 12: starts a conversion (XF EN 1117). 4 bytes: @0 u32 0x1000.
    AdcStartConv(12) = [SAMPLE_MODULE], looked at [SAMPLE_MODULE],
        "ECM_AdcStartConv number", "0x1000, or more bits beside it", ();

    /// ECM_AdcGetConvData, code 35, `par` 15: the value, @0 u32, 0..=4095 for 0 V to 3.3 V (XF EN 1128). 4 bytes:
    /// @0 u32 12.
    AdcGetConvData(15) = [12], looked at [WHOLE], "ECM_AdcGetConvData number", "12", Analog;
}
