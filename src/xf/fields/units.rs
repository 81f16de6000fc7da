//! GPIO, encoder, DAC, ADC, and the EEPROMs of slaves.

use super::FunctionFields;
use super::field::{Field, Kind};
use super::network::answer;
use super::rows::rows;
use crate::xf::request::*;
use crate::xf::value::Switch;

const fn pins(bytes: u8) -> Field {
    Field::info("pins", 0, bytes).hex()
}

const fn mode() -> Field {
    Field::info("mode", 2, 1).one_of(GpioMode::NAMES)
}

const fn pull() -> Field {
    Field::info("pull", 3, 1).one_of(GpioPull::NAMES).or(0)
}

const fn on() -> Field {
    Field::info("on", 2, 1).one_of(Switch::NAMES)
}

const fn values(bytes: u8) -> Field {
    Field::info("values", 0, bytes).hex()
}

/// A number that the manuals fix.
const fn fixed(number: u32) -> Field {
    Field::at("number", 0, 4).hex().or(number)
}

#[rustfmt::skip]
pub(super) const ROWS: &[FunctionFields] = rows! {
    GpioSetMode, "makes GPIO 0 to 15 inputs or outputs", [pins(2), mode(), pull()];
    GpioSetModeExt, "makes GPIO 16 to 19 inputs or outputs: bit k of pins is GPIO 16 + k", [pins(1), mode(), pull()];
    GpioEnableDebounce, "debounces inputs among GPIO 0 to 15", [pins(2), on()];
    GpioEnableDebounceExt, "debounces inputs among GPIO 16 to 19: bit k of pins is GPIO 16 + k", [pins(1), on()];
    GpioSetDebounceClock, "chooses how often debounced inputs are sampled", [
        Field::info("exponent", 0, 1).part(0, 4), Field::info("source", 0, 1).part(4, 4).one_of(DebounceSource::NAMES),
    ];
    GpioIntEnable, "chooses the edges at which a GPIO raises an interrupt", [
        Field::info("channel", 0, 1), Field::info("trigger", 1, 1).one_of(GpioTrigger::NAMES),
    ];
    GpioIntClear, "clears interrupt flags of GPIO 0 to 15", [pins(2)];
    GpioIntClearExt, "clears interrupt flags of GPIO 0 to 19", [pins(3)];
    GpioSetValue, "sets the outputs of GPIO 0 to 15", [values(2)];
    GpioExtSetValue, "sets the outputs of GPIO 0 to 19", [values(3)];
    GpioGetValue, "gives the inputs of GPIO 0 to 15", [] -> answer(&[Field::at("values", 0, 2).hex()]);
    GpioExtGetValue, "gives the inputs of GPIO 0 to 19", [] -> answer(&[Field::at("values", 0, 4).hex()]);
    GpioGetIntFlag, "gives the interrupt flags of GPIO 0 to 15", [] -> answer(&[Field::at("flags", 0, 2).hex()]);
    GpioExtGetIntFlag, "gives the interrupt flags of GPIO 0 to 19", [] -> answer(&[Field::at("flags", 0, 4).hex()]);

    EncOpen, "opens the encoder", [Field::at("mode", 0, 4).one_of(EncoderMode::NAMES)];
    EncStart, "starts the encoder", [];
    EncStop, "stops the encoder", [];
    EncGetCount, "gives the encoder's count", [] -> answer(&[Field::at("count", 0, 4)]);

    DacOpen, "opens the DAC", [Field::at("trigger", 0, 4).one_of(DacTrigger::NAMES)];
    DacClose, "closes the DAC", [];
    DacSetDelayTime, "sets how long a conversion of the DAC takes, in 1/96 us", [Field::at("delay", 0, 4)];
    DacSetData, "sets the DAC's value, 0 to 4095 for 0 V to 3.3 V", [Field::at("value", 0, 4)];
    DacStartConv, "puts out the DAC's value", [];

    AdcOpen, "opens the ADC", [Field::at("mode", 0, 4).one_of(AdcMode::NAMES)];
    AdcClose, "closes the ADC", [];
    AdcConfigSampleModule, "has conversions of the ADC started by software", [Field::at("trigger", 4, 4).or(0)];
    AdcGetDataValidFlag, "tells whether a conversion of the ADC is done", [fixed(0x1000)]
        -> answer(&[Field::at("valid", 0, 4)]);
    AdcStartConv, "starts a conversion of the ADC", [fixed(0x1000)];
    AdcGetConvData, "gives the ADC's value, 0 to 4095 for 0 V to 3.3 V", [fixed(12)]
        -> answer(&[Field::at("value", 0, 4)]);

    EepromRequest, "reads a slave's EEPROM, for EEPROM_GET, or writes it", [
        Field::at("operation", 0, 2).one_of(EepromOperationCode::NAMES), Field::at("slave", 2, 2),
        Field::at("position", 4, 2).hex(), Field::at("value", 6, 2).hex().or(0),
        Field::at("timeout_us", 8, 4).or(1_000_000),
    ];
    EepromGet, "gives what EEPROM_REQ has read", []
        -> answer(&[Field::ret("error"), Field::tail("data", 0, Kind::Bytes)]);
};
