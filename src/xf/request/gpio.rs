//! General inputs and outputs: codes 31, GPIO_CONFIG_SET, and 32, GPIO_FUNC_OP. All are floating inputs at first.
//!
//! The functions whose names end in `Ext` are for chips or firmware that have GPIO 16 to 19 or more functions.

use super::{AllPins, GpioChannel, UpperPins};
use crate::xf::layout::layout;
use crate::xf::value::choices;

layout! {
    /// ECM_GpioGetValue, code 32, `par` 1: the inputs, @0 u16, bit k is GPIO k (XF EN 940).
    pub struct GpioGetValue;

    /// ECM_GpioExtGetValue, code 32, `par` 3, from firmware 9 on: the inputs, @0 u32, bit k is GPIO k, 0 to 19
    /// (XF EN 953).
    pub struct GpioExtGetValue;

    /// ECM_GpioGetIntFlag, code 32, `par` 5: the interrupt flags, @0 u16, bit k is GPIO k (XF EN 968).
    pub struct GpioGetIntFlag;

    /// ECM_GpioExtGetIntFlag, code 32, `par` 7: the interrupt flags, @0 u32, bit k is GPIO k, 0 to 19 (XF EN 980).
    pub struct GpioExtGetIntFlag;
}

choices! {
    /// What a GPIO is.
    pub GpioMode(u8), "GPIO mode", "0 input, 1 output, 2 open drain, 3 quasi-bidirectional" {
        /// 0: input.
        Input = 0,
        /// 1: output.
        Output = 1,
        /// 2: open drain.
        OpenDrain = 2,
        /// 3: quasi-bidirectional.
        QuasiBidirectional = 3,
    }

    /// The resistor at a GPIO.
    pub GpioPull(u8), "GPIO pull", "0 none, 1 up, 2 down" {
        /// 0: none.
        None = 0,
        /// 1: pull-up.
        Up = 1,
        /// 2: pull-down.
        Down = 2,
    }

    /// Which edges raise the interrupt of a GPIO. The manuals number them 0 to 3; the vendor's driver of 2020 sends 0,
    /// 3, 4 and 5 (OBS), so that 4 and 5 are taken as well and keep their numbers.
    pub GpioTrigger(u8), "GPIO interrupt type", "0 off, 1 both edges, 2 falling, 3 rising, or 4, 5 of the vendor's driver" {
        /// 0: none.
        Off = 0,
        /// 1: both.
        Both = 1,
        /// 2: the falling one.
        Falling = 2,
        /// 3: the rising one.
        Rising = 3,
        /// 4: only the vendor's driver knows what it means.
        Driver4 = 4,
        /// 5: only the vendor's driver knows what it means.
        Driver5 = 5,
    }

    /// What counts the clock of debouncing.
    pub DebounceSource(u8), "debounce clock source", "0 192 MHz, 1 10 kHz" {
        /// 0: 192 MHz.
        Mhz192 = 0,
        /// 1: 10 kHz.
        Khz10 = 1,
    }
}

layout! {
    /// ECM_GpioSetMode, code 31, `par` 0: what GPIO 0 to 15 are. `i0`, `i1` mask, `i2` mode, `i3` pull (XF EN 825).
    pub struct GpioSetMode {
        /// Which ones: bit k is GPIO k.
        pub pins: u16 = info(0).hex(),
        /// What they are.
        pub mode: GpioMode = info(2),
        /// Their resistor.
        pub pull: GpioPull = info(3).or(0),
    }

    /// ECM_GpioSetMode, code 31, `par` 8: what GPIO 16 to 19 are. `i0` mask, `i2` mode, `i3` pull (XF EN 838).
    pub struct GpioSetModeExt {
        /// Which ones.
        pub pins: UpperPins = info(0).hex(),
        /// What they are.
        pub mode: GpioMode = info(2),
        /// Their resistor.
        pub pull: GpioPull = info(3).or(0),
    }

    /// ECM_GpioEnableDebounce, code 31, `par` 2: whether inputs among GPIO 0 to 15 are debounced. `i0`, `i1` mask, `i2`
    /// switch (XF EN 850).
    pub struct GpioEnableDebounce {
        /// Which ones: bit k is GPIO k.
        pub pins: u16 = info(0).hex(),
        /// They are debounced.
        pub on: bool = info(2),
    }

    /// ECM_GpioEnableDebounce, code 31, `par` 9: whether inputs among GPIO 16 to 19 are debounced. `i0` mask, `i2`
    /// switch (XF EN 861).
    pub struct GpioEnableDebounceExt {
        /// Which ones.
        pub pins: UpperPins = info(0).hex(),
        /// They are debounced.
        pub on: bool = info(2),
    }

    /// ECM_GpioSetDebounceClock, code 31, `par` 3: inputs are sampled every 2^exponent periods of the source. `i0` bits
    /// 0 to 3 exponent, bit 4 source (XF EN 876).
    pub struct GpioSetDebounceClock {
        /// The clock.
        pub clock: DebounceClock,
    }

    /// ECM_GpioIntEnable, code 31, `par` 1: which edges of a GPIO raise an interrupt. `i0` channel, `i1` edges
    /// (XF EN 890).
    pub struct GpioIntEnable {
        /// Which one; above 15 with certain versions alone.
        pub channel: GpioChannel = info(0),
        /// Which edges.
        pub trigger: GpioTrigger = info(1),
    }

    /// ECM_GpioIntClear, code 31, `par` 4: clears interrupt flags. `i0`, `i1` mask (XF EN 899).
    pub struct GpioIntClear {
        /// Which ones: bit k is GPIO k.
        pub pins: u16 = info(0).hex(),
    }

    /// ECM_GpioIntClear, code 31, `par` 6, from firmware 9 on: clears interrupt flags. `i0` to `i2` mask (XF EN 910).
    pub struct GpioIntClearExt {
        /// Which ones.
        pub pins: AllPins = info(0).bytes(3).hex(),
    }

    /// ECM_GpioSetValue, code 32, `par` 0: the outputs. `i0`, `i1` bits (XF EN 920).
    pub struct GpioSetValue {
        /// Bit k is GPIO k.
        pub values: u16 = info(0).hex(),
    }

    /// ECM_GpioExtSetValue, code 32, `par` 2, from firmware 9 on: the outputs. `i0` to `i2` bits (XF EN 930).
    pub struct GpioExtSetValue {
        /// Bit k is GPIO k.
        pub values: AllPins = info(0).bytes(3).hex(),
    }

    /// How often debounced inputs are sampled: every 2^exponent periods of the source.
    pub struct DebounceClock {
        exponent: u8 = info(0).part(0, 4),
        source: DebounceSource = info(0).part(4, 4),
    }
}

impl DebounceClock {
    /// The clock; `None` unless the exponent is 0..=15.
    pub const fn new(exponent: u8, source: DebounceSource) -> Option<Self> {
        if exponent <= 15 { Some(Self { exponent, source }) } else { None }
    }

    /// The exponent, 0..=15.
    pub const fn exponent(self) -> u8 {
        self.exponent
    }

    /// The source.
    pub const fn source(self) -> DebounceSource {
        self.source
    }
}
