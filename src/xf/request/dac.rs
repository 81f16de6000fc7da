//! Requests for the analog output: code 34, DAC_FUNC_OP.

use super::{Analog, DacDelay};
use crate::xf::layout::layout;
use crate::xf::value::choices;

layout! {
    /// ECM_DacClose, command code 34, parameter byte 21: closes the DAC (XF EN 1042).
    pub struct DacClose;

    /// ECM_DacStartConv, command code 34, parameter byte 0: outputs the value that was set (XF EN 1069).
    pub struct DacStartConv;
}

choices! {
    /// The trigger at which the DAC outputs the value that was set.
    pub DacTrigger(u32), "ECM_DacOpen trigger", "0x0000, 0x0010, 0x0030, 0x1030, 0x2030 or 0x3030" {
        /// 0x0000: [`DacSetData`] itself is the trigger.
        SetData = 0x0000,
        /// 0x0010: [`DacStartConv`] is the trigger.
        StartConv = 0x0010,
        /// 0x0030: a low level of the pin DAC_ST is the trigger.
        PinLow = 0x0030,
        /// 0x1030: a high level of the pin DAC_ST is the trigger.
        PinHigh = 0x1030,
        /// 0x2030: a rising edge of the pin DAC_ST is the trigger.
        PinRising = 0x2030,
        /// 0x3030: a falling edge of the pin DAC_ST is the trigger.
        PinFalling = 0x3030,
    }
}

layout! {
    /// ECM_DacOpen, command code 34, parameter byte 20: opens the DAC (XF EN 1034). Data, 4 bytes (@offset): @0 u32
    /// trigger.
    pub struct DacOpen {
        /// The trigger at which the DAC outputs the value that was set.
        pub trigger: DacTrigger = at(0),
    }

    /// ECM_DacSetDelayTime, command code 34, parameter byte 22: sets the duration of a conversion (XF EN 1050). Data, 4
    /// bytes (@offset): @0 u32 in units of 1/96 us.
    pub struct DacSetDelayTime {
        /// The duration of a conversion, 0..=1023 in units of 1/96 us. The manuals call it the delay time.
        pub delay: DacDelay = at(0),
    }

    /// ECM_DacSetData, command code 34, parameter byte 11: sets the output value (XF EN 1058). Data, 4 bytes (@offset):
    /// @0 u32, 0..=4095 for 0 V to 3.3 V.
    pub struct DacSetData {
        /// The value to output, 0..=4095 for 0 V to 3.3 V.
        pub value: Analog = at(0),
    }
}
