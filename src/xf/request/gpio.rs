//! General inputs and outputs: codes 31, GPIO_CONFIG_SET, and 32, GPIO_FUNC_OP. All are floating inputs at first.
//!
//! The functions whose names end in `Ext` are for chips or firmware that have GPIO 16 to 19 or more functions.

use super::{AllPins, Arguments, GpioChannel, Switch, UpperPins, plain, short};
use crate::xf::value::choices;

plain! {
    /// ECM_GpioGetValue, code 32, `par` 1: the inputs, @0 u16, bit k is GPIO k (XF EN 940).
    GpioGetValue, GpioFunction(1) -> u16;
    /// ECM_GpioExtGetValue, code 32, `par` 3, from firmware 9 on: the inputs, @0 u32, bit k is GPIO k, 0 to 19
    /// (XF EN 953).
    GpioExtGetValue, GpioFunction(3) -> u32;
    /// ECM_GpioGetIntFlag, code 32, `par` 5: the interrupt flags, @0 u16, bit k is GPIO k (XF EN 968).
    GpioGetIntFlag, GpioFunction(5) -> u16;
    /// ECM_GpioExtGetIntFlag, code 32, `par` 7: the interrupt flags, @0 u32, bit k is GPIO k, 0 to 19 (XF EN 980).
    GpioExtGetIntFlag, GpioFunction(7) -> u32;
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

/// A mask of GPIO 0 to 15 as `i0` and `i1`.
const fn low([i0, i1, ..]: [u8; 4]) -> u16 {
    u16::from_le_bytes([i0, i1])
}

/// `i0` and `i1` with a mask of GPIO 0 to 15, and the other two.
const fn with_low(pins: u16, i2: u8, i3: u8) -> [u8; 4] {
    let [i0, i1] = pins.to_le_bytes();
    [i0, i1, i2, i3]
}

/// A mask of GPIO 0 to 19 as `i0` to `i2`.
const fn all([i0, i1, i2, _]: [u8; 4]) -> u32 {
    u32::from_le_bytes([i0, i1, i2, 0])
}

short! {
    /// ECM_GpioSetMode, code 31, `par` 0: what GPIO 0 to 15 are. `i0`, `i1` mask, `i2` mode, `i3` pull (XF EN 825).
    GpioSetMode {
        /// Which ones: bit k is GPIO k.
        pub pins: u16,
        /// What they are.
        pub mode: GpioMode,
        /// Their resistor.
        pub pull: GpioPull,
    }, GpioConfig(0) -> (),
        |request| Arguments::NONE.info(with_low(request.pins, request.mode.code(), request.pull.code())),
        |a| Self { pins: low(a.info), mode: GpioMode::decode(a.info[2])?, pull: GpioPull::decode(a.info[3])? };

    /// ECM_GpioSetMode, code 31, `par` 8: what GPIO 16 to 19 are. `i0` mask, `i2` mode, `i3` pull (XF EN 838).
    GpioSetModeExt {
        /// Which ones.
        pub pins: UpperPins,
        /// What they are.
        pub mode: GpioMode,
        /// Their resistor.
        pub pull: GpioPull,
    }, GpioConfig(8) -> (),
        |request| Arguments::NONE.info([request.pins.get(), 0, request.mode.code(), request.pull.code()]),
        |a| Self {
            pins: UpperPins::decode(a.info[0])?,
            mode: GpioMode::decode(a.info[2])?,
            pull: GpioPull::decode(a.info[3])?,
        };

    /// ECM_GpioEnableDebounce, code 31, `par` 2: whether inputs among GPIO 0 to 15 are debounced. `i0`, `i1` mask, `i2`
    /// switch (XF EN 850).
    GpioEnableDebounce {
        /// Which ones: bit k is GPIO k.
        pub pins: u16,
        /// They are debounced.
        pub on: bool,
    }, GpioConfig(2) -> (),
        |request| Arguments::NONE.info(with_low(request.pins, request.on.into(), 0)),
        |a| Self { pins: low(a.info), on: Switch::decode(a.info[2])? == Switch::On };

    /// ECM_GpioEnableDebounce, code 31, `par` 9: whether inputs among GPIO 16 to 19 are debounced. `i0` mask, `i2`
    /// switch (XF EN 861).
    GpioEnableDebounceExt {
        /// Which ones.
        pub pins: UpperPins,
        /// They are debounced.
        pub on: bool,
    }, GpioConfig(9) -> (),
        |request| Arguments::NONE.info([request.pins.get(), 0, request.on.into(), 0]),
        |a| Self { pins: UpperPins::decode(a.info[0])?, on: Switch::decode(a.info[2])? == Switch::On };

    /// ECM_GpioSetDebounceClock, code 31, `par` 3: inputs are sampled every 2^exponent periods of the source. `i0` bits
    /// 0 to 3 exponent, bit 4 source (XF EN 876).
    GpioSetDebounceClock {
        /// The clock.
        pub clock: DebounceClock,
    }, GpioConfig(3) -> (),
        |request| Arguments::NONE.info([request.clock.code(), 0, 0, 0]),
        |a| Self { clock: DebounceClock::decode(a.info[0])? };

    /// ECM_GpioIntEnable, code 31, `par` 1: which edges of a GPIO raise an interrupt. `i0` channel, `i1` edges
    /// (XF EN 890).
    GpioIntEnable {
        /// Which one; above 15 with certain versions alone.
        pub channel: GpioChannel,
        /// Which edges.
        pub trigger: GpioTrigger,
    }, GpioConfig(1) -> (),
        |request| Arguments::NONE.info([request.channel.get(), request.trigger.code(), 0, 0]),
        |a| Self { channel: GpioChannel::decode(a.info[0])?, trigger: GpioTrigger::decode(a.info[1])? };

    /// ECM_GpioIntClear, code 31, `par` 4: clears interrupt flags. `i0`, `i1` mask (XF EN 899).
    GpioIntClear {
        /// Which ones: bit k is GPIO k.
        pub pins: u16,
    }, GpioConfig(4) -> (),
        |request| Arguments::NONE.info(with_low(request.pins, 0, 0)),
        |a| Self { pins: low(a.info) };

    /// ECM_GpioIntClear, code 31, `par` 6, from firmware 9 on: clears interrupt flags. `i0` to `i2` mask (XF EN 910).
    GpioIntClearExt {
        /// Which ones.
        pub pins: AllPins,
    }, GpioConfig(6) -> (),
        |request| Arguments::NONE.info(request.pins.get().to_le_bytes()),
        |a| Self { pins: AllPins::decode(all(a.info))? };

    /// ECM_GpioSetValue, code 32, `par` 0: the outputs. `i0`, `i1` bits (XF EN 920).
    GpioSetValue {
        /// Bit k is GPIO k.
        pub values: u16,
    }, GpioFunction(0) -> (),
        |request| Arguments::NONE.info(with_low(request.values, 0, 0)),
        |a| Self { values: low(a.info) };

    /// ECM_GpioExtSetValue, code 32, `par` 2, from firmware 9 on: the outputs. `i0` to `i2` bits (XF EN 930).
    GpioExtSetValue {
        /// Bit k is GPIO k.
        pub values: AllPins,
    }, GpioFunction(2) -> (),
        |request| Arguments::NONE.info(request.values.get().to_le_bytes()),
        |a| Self { values: AllPins::decode(all(a.info))? };
}

/// How often debounced inputs are sampled: every 2^exponent periods of the source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct DebounceClock {
    exponent: u8,
    source: DebounceSource,
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

    const fn code(self) -> u8 {
        self.exponent | self.source.code() << 4
    }

    fn decode(code: u8) -> Result<Self, super::Malformed> {
        Ok(Self { exponent: code & 0x0F, source: DebounceSource::decode(code >> 4)? })
    }
}
