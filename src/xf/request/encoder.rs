//! The encoder input: code 33, QEI_FUNC_OP.

use crate::xf::layout::layout;
use crate::xf::value::choices;

layout! {
    /// ECM_EncStart, code 33, `par` 5: starts to count (XF EN 1007).
    pub struct EncStart;

    /// ECM_EncStop, code 33, `par` 6: stops to count (XF EN 1014).
    pub struct EncStop;

    /// ECM_EncGetCount, code 33, `par` 21: the count, @0 u32 (XF EN 1021).
    pub struct EncGetCount;
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

layout! {
    /// ECM_EncOpen, code 33, `par` 4: opens the encoder (XF EN 995). 4 bytes: @0 u32 mode.
    pub struct EncOpen {
        /// How it counts.
        pub mode: EncoderMode = at(0),
    }
}
