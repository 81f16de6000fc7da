//! The encoder input: code 33, QEI_FUNC_OP.

use super::{Arguments, Call, plain};
use crate::ethercat::U32Le;
use crate::xf::value::choices;
use crate::xf::{CommandCode, Malformed, segment};

plain! {
    /// ECM_EncStart, code 33, `par` 5: starts to count (XF EN 1007).
    EncStart, EncoderFunction(5) -> ();
    /// ECM_EncStop, code 33, `par` 6: stops to count (XF EN 1014).
    EncStop, EncoderFunction(6) -> ();
    /// ECM_EncGetCount, code 33, `par` 21: the count, @0 u32 (XF EN 1021).
    EncGetCount, EncoderFunction(21) -> u32;
}

choices! {
    /// How the encoder counts.
    pub EncoderMode(u32), "ECM_EncOpen mode", "0x000 x4 free, 0x100 x2 free, 0x200 x4 compare, 0x300 x2 compare" {
        /// 0x000: all four edges, freely.
        X4Free = 0x000,
        /// 0x100: two edges, freely.
        X2Free = 0x100,
        /// 0x200: all four edges, up to a comparison.
        X4Compare = 0x200,
        /// 0x300: two edges, up to a comparison.
        X2Compare = 0x300,
    }
}

/// ECM_EncOpen, code 33, `par` 4: opens the encoder (XF EN 995). 4 bytes: @0 u32 mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EncOpen {
    /// How it counts.
    pub mode: EncoderMode,
}

impl Call<'_> for EncOpen {
    const CODE: CommandCode = CommandCode::EncoderFunction;
    const FUNCTION: Option<u8> = Some(4);
    type Answer<'a> = ();

    fn encode(&self, data: &mut [u8]) -> Result<Arguments, Malformed> {
        Ok(Arguments::NONE.len(segment::put(data, &U32Le::new(self.mode.code()))?))
    }

    fn decode(_: &Arguments, data: &[u8]) -> Result<Self, Malformed> {
        Ok(Self { mode: EncoderMode::decode(segment::get::<U32Le>(data)?.get())? })
    }
}
