//! The analog output: code 34, DAC_FUNC_OP.

use super::{Analog, DacDelay};
use crate::xf::layout::layout;
use crate::xf::value::choices;

layout! {
    /// ECM_DacClose, code 34, `par` 21: closes the DAC (XF EN 1042).
    pub struct DacClose;

    /// ECM_DacStartConv, code 34, `par` 0: puts out what was set (XF EN 1069).
    pub struct DacStartConv;
}

choices! {
    /// What makes the DAC put out what was set.
    pub DacTrigger(u32), "ECM_DacOpen trigger", "0x0000, 0x0010, 0x0030, 0x1030, 0x2030 or 0x3030" {
        /// 0x0000: [`DacSetData`] itself.
        SetData = 0x0000,
        /// 0x0010: [`DacStartConv`].
        StartConv = 0x0010,
        /// 0x0030: the pin DAC_ST is low.
        PinLow = 0x0030,
        /// 0x1030: the pin DAC_ST is high.
        PinHigh = 0x1030,
        /// 0x2030: the pin DAC_ST rises.
        PinRising = 0x2030,
        /// 0x3030: the pin DAC_ST falls.
        PinFalling = 0x3030,
    }
}

layout! {
    /// ECM_DacOpen, code 34, `par` 20: opens the DAC (XF EN 1034). 4 bytes: @0 u32 trigger.
    pub struct DacOpen {
        /// What makes it put out what was set.
        pub trigger: DacTrigger = at(0),
    }

    /// ECM_DacSetDelayTime, code 34, `par` 22: how long a conversion takes (XF EN 1050). 4 bytes: @0 u32 in 1/96 us.
    pub struct DacSetDelayTime {
        /// The time.
        pub delay: DacDelay = at(0),
    }

    /// ECM_DacSetData, code 34, `par` 11: the value (XF EN 1058). 4 bytes: @0 u32, 0..=4095 for 0 V to 3.3 V.
    pub struct DacSetData {
        /// The value.
        pub value: Analog = at(0),
    }
}
