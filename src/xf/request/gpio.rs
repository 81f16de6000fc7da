//! Requests for general-purpose inputs and outputs: codes 31, GPIO_CONFIG_SET, and 32, GPIO_FUNC_OP. At power-on all
//! GPIOs are floating inputs.
//!
//! The requests with `Ext` in their names reach GPIO 16 to 19, which only certain versions of the chip have. Some of
//! them need firmware 9 or newer.

use super::{AllPins, GpioChannel, UpperPins};
use crate::xf::layout::layout;
use crate::xf::value::choices;

layout! {
    /// ECM_GpioGetValue, command code 32, parameter byte 1: reads the inputs of GPIO 0 to 15 (XF EN 940). Answer: u16
    /// at byte 0 of the data, bit k is GPIO k.
    pub struct GpioGetValue;

    /// ECM_GpioExtGetValue, command code 32, parameter byte 3, from firmware 9 on: reads the inputs of GPIO 0 to 19
    /// (XF EN 953). Answer: u32 at byte 0 of the data, bit k is GPIO k.
    pub struct GpioExtGetValue;

    /// ECM_GpioGetIntFlag, command code 32, parameter byte 5: reads the interrupt flags of GPIO 0 to 15 (XF EN 968).
    /// Answer: u16 at byte 0 of the data, bit k is GPIO k.
    pub struct GpioGetIntFlag;

    /// ECM_GpioExtGetIntFlag, command code 32, parameter byte 7: reads the interrupt flags of GPIO 0 to 19 (XF EN 980).
    /// Answer: u32 at byte 0 of the data, bit k is GPIO k.
    pub struct GpioExtGetIntFlag;
}

choices! {
    /// The mode of a GPIO.
    pub GpioMode(u8), "GPIO mode", "0 input, 1 output, 2 open drain, 3 quasi-bidirectional" {
        /// 0: input.
        Input = 0,
        /// 1: output.
        Output = 1,
        /// 2: open drain, so that the output only pulls to low.
        OpenDrain = 2,
        /// 3: quasi-bidirectional: an output that a device outside may pull to low, and that can be read as an input.
        QuasiBidirectional = 3,
    }

    /// The pull resistor at a GPIO.
    pub GpioPull(u8), "GPIO pull", "0 none, 1 up, 2 down" {
        /// 0: no resistor.
        None = 0,
        /// 1: pull-up.
        Up = 1,
        /// 2: pull-down.
        Down = 2,
    }

    /// The edges that raise the interrupt of a GPIO. The manuals number them 0 to 3. The vendor's driver of 2020 sends
    /// 0, 3, 4 and 5 (OBS), so 4 and 5 are accepted too and kept unchanged.
    pub GpioTrigger(u8), "GPIO interrupt type", "0 off, 1 both edges, 2 falling, 3 rising, or 4, 5 of the vendor's driver" {
        /// 0: no edge, no interrupt.
        Off = 0,
        /// 1: both edges.
        Both = 1,
        /// 2: falling edges.
        Falling = 2,
        /// 3: rising edges.
        Rising = 3,
        /// 4: sent by the vendor's driver; its meaning is unknown.
        Driver4 = 4,
        /// 5: sent by the vendor's driver; its meaning is unknown.
        Driver5 = 5,
    }

    /// The clock source for debouncing inputs.
    pub DebounceSource(u8), "debounce clock source", "0 192 MHz, 1 10 kHz" {
        /// 0: 192 MHz.
        Mhz192 = 0,
        /// 1: 10 kHz.
        Khz10 = 1,
    }
}

layout! {
    /// ECM_GpioSetMode, command code 31, parameter byte 0: sets the mode of GPIO 0 to 15 (XF EN 825). Information
    /// bytes: `i0` and `i1` mask of the GPIOs, `i2` mode, `i3` pull resistor.
    pub struct GpioSetMode {
        /// The GPIOs whose mode is set: bit k is GPIO k.
        pub pins: u16 = info(0).hex(),
        /// The new mode of the selected GPIOs.
        pub mode: GpioMode = info(2),
        /// The pull resistor of the selected GPIOs.
        pub pull: GpioPull = info(3).or(0),
    }

    /// ECM_GpioSetMode, command code 31, parameter byte 8: sets the mode of GPIO 16 to 19 (XF EN 838). Information
    /// bytes: `i0` mask of the GPIOs, `i2` mode, `i3` pull resistor.
    pub struct GpioSetModeExt {
        /// The GPIOs whose mode is set: bit k is GPIO 16 + k.
        pub pins: UpperPins = info(0).hex(),
        /// The new mode of the selected GPIOs.
        pub mode: GpioMode = info(2),
        /// The pull resistor of the selected GPIOs.
        pub pull: GpioPull = info(3).or(0),
    }

    /// ECM_GpioEnableDebounce, command code 31, parameter byte 2: switches debouncing of inputs among GPIO 0 to 15 on
    /// or off (XF EN 850). Information bytes: `i0` and `i1` mask of the GPIOs, `i2` 1 on, 0 off.
    pub struct GpioEnableDebounce {
        /// The GPIOs whose debouncing is set: bit k is GPIO k.
        pub pins: u16 = info(0).hex(),
        /// Whether the selected inputs are debounced.
        pub on: bool = info(2),
    }

    /// ECM_GpioEnableDebounce, command code 31, parameter byte 9: switches debouncing of inputs among GPIO 16 to 19 on
    /// or off (XF EN 861). Information bytes: `i0` mask of the GPIOs, `i2` 1 on, 0 off.
    pub struct GpioEnableDebounceExt {
        /// The GPIOs whose debouncing is set: bit k is GPIO 16 + k.
        pub pins: UpperPins = info(0).hex(),
        /// Whether the selected inputs are debounced.
        pub on: bool = info(2),
    }

    /// ECM_GpioSetDebounceClock, command code 31, parameter byte 3: sets the sampling period of debounced inputs to
    /// 2^exponent periods of the clock source (XF EN 876). Information byte `i0`: bits 0 to 3 exponent, bit 4 clock
    /// source.
    pub struct GpioSetDebounceClock {
        /// The clock source, and how many of its periods make one sampling period.
        pub clock: DebounceClock,
    }

    /// ECM_GpioIntEnable, command code 31, parameter byte 1: sets which edges of a GPIO raise an interrupt (XF EN 890).
    /// Information bytes: `i0` channel, `i1` edges.
    pub struct GpioIntEnable {
        /// The GPIO, 0..=19. GPIO 16 to 19 exist only with "certain versions" of the chip, which the manuals do not
        /// name.
        pub channel: GpioChannel = info(0),
        /// The edges of the input that raise an interrupt.
        pub trigger: GpioTrigger = info(1),
    }

    /// ECM_GpioIntClear, command code 31, parameter byte 4: clears interrupt flags of GPIO 0 to 15 (XF EN 899).
    /// Information bytes: `i0` and `i1` mask of the GPIOs.
    pub struct GpioIntClear {
        /// The GPIOs whose interrupt flags are cleared: bit k is GPIO k.
        pub pins: u16 = info(0).hex(),
    }

    /// ECM_GpioIntClear, command code 31, parameter byte 6, from firmware 9 on: clears interrupt flags of GPIO 0 to 19
    /// (XF EN 910). Information bytes: `i0` to `i2` mask of the GPIOs.
    pub struct GpioIntClearExt {
        /// The GPIOs whose interrupt flags are cleared: bit k is GPIO k.
        pub pins: AllPins = info(0).bytes(3).hex(),
    }

    /// ECM_GpioSetValue, command code 32, parameter byte 0: sets the outputs of GPIO 0 to 15 (XF EN 920). Information
    /// bytes: `i0` and `i1` bits.
    pub struct GpioSetValue {
        /// The outputs: bit k is GPIO k.
        pub values: u16 = info(0).hex(),
    }

    /// ECM_GpioExtSetValue, command code 32, parameter byte 2, from firmware 9 on: sets the outputs of GPIO 0 to 19
    /// (XF EN 930). Information bytes: `i0` to `i2` bits.
    pub struct GpioExtSetValue {
        /// The outputs: bit k is GPIO k.
        pub values: AllPins = info(0).bytes(3).hex(),
    }

    /// The sampling period of debounced inputs: 2^exponent periods of the clock source.
    pub struct DebounceClock {
        exponent: u8 = info(0).part(0, 4),
        source: DebounceSource = info(0).part(4, 4),
    }
}

impl DebounceClock {
    /// The sampling clock with these settings; `None` unless the exponent is 0..=15.
    pub const fn new(exponent: u8, source: DebounceSource) -> Option<Self> {
        if exponent <= 15 { Some(Self { exponent, source }) } else { None }
    }

    /// The exponent of the sampling period, 0..=15.
    pub const fn exponent(self) -> u8 {
        self.exponent
    }

    /// The clock from whose periods the sampling period is made: 192 MHz or 10 kHz.
    pub const fn source(self) -> DebounceSource {
        self.source
    }
}
