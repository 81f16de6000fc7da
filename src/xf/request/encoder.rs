//! Requests for the encoder input: code 33, QEI_FUNC_OP.

use crate::xf::layout::layout;
use crate::xf::value::choices;

layout! {
    /// ECM_EncStart, command code 33, parameter byte 5: starts counting (XF EN 1007).
    pub struct EncStart;

    /// ECM_EncStop, command code 33, parameter byte 6: stops counting (XF EN 1014).
    pub struct EncStop;

    /// ECM_EncGetCount, command code 33, parameter byte 21: reads the count (XF EN 1021). Answer: u32 at byte 0 of the
    /// data.
    pub struct EncGetCount;
}

choices! {
    /// How many edges per period the encoder counts, and whether it counts up to a comparison value.
    pub EncoderMode(u32), "ECM_EncOpen mode", "0x000 x4 free, 0x100 x2 free, 0x200 x4 compare, 0x300 x2 compare" {
        /// 0x000: counts all four edges of a period, without a limit.
        X4Free = 0x000,
        /// 0x100: counts two edges of a period, without a limit.
        X2Free = 0x100,
        /// 0x200: counts all four edges of a period, up to a comparison value, at which the encoder's interrupt occurs.
        /// No command sets that value.
        X4Compare = 0x200,
        /// 0x300: counts two edges of a period, up to a comparison value, at which the encoder's interrupt occurs. No
        /// command sets that value.
        X2Compare = 0x300,
    }
}

layout! {
    /// ECM_EncOpen, command code 33, parameter byte 4: opens the encoder (XF EN 995). Data, 4 bytes (@offset): @0 u32
    /// mode.
    pub struct EncOpen {
        /// How many edges per period are counted, and whether up to a comparison value.
        pub mode: EncoderMode = at(0),
    }
}
