//! Commands for GPIO, encoder, DAC and ADC: codes 31 to 35.

use super::{CommandOutcome, DONE, answered, done_if};
use crate::xf::chip::Chip;
use crate::xf::chip::network::SlaveNetwork;
use crate::xf::request::{Analog, Request, UpperPins};
use crate::xf::response::Answer;

/// Mask of GPIO 0 to 15.
const LOWER_PINS: u32 = 0xFFFF;
/// Mask of GPIO 0 to 19.
const ALL_PINS: u32 = 0xF_FFFF;

/// Converts a mask of GPIO 16 to 19 to a mask of all GPIOs.
fn upper(pins: UpperPins) -> u32 {
    u32::from(pins.get()) << 16
}

impl<N: SlaveNetwork> Chip<N> {
    /// Runs a command of GPIO, encoder, DAC or ADC; `None` for other commands.
    pub(super) fn run_io(&mut self, request: &Request<'_>, data: &mut [u8]) -> Option<CommandOutcome> {
        if self.set_io(request) { Some(DONE) } else { self.use_io(request, data) }
    }

    /// Runs a command that only sets something in GPIO, encoder, DAC or ADC, and that cannot be refused; returns false for
    /// other commands.
    fn set_io(&mut self, request: &Request<'_>) -> bool {
        let (now, gpio, encoder, analog) = (self.now, &mut self.gpio, &mut self.encoder, &mut self.analog);
        match *request {
            Request::GpioSetMode(set) => gpio.set_mode(now, set.pins.into(), set.mode, set.pull),
            Request::GpioSetModeExt(set) => gpio.set_mode(now, upper(set.pins), set.mode, set.pull),
            Request::GpioEnableDebounce(set) => gpio.set_debounced(now, set.pins.into(), set.on),
            Request::GpioEnableDebounceExt(set) => gpio.set_debounced(now, upper(set.pins), set.on),
            Request::GpioSetDebounceClock(set) => gpio.set_debounce_clock(set.clock),
            Request::GpioIntEnable(set) => gpio.set_trigger(set.channel.get(), set.trigger),
            Request::GpioIntClear(clear) => gpio.clear(clear.pins.into()),
            Request::GpioIntClearExt(clear) => gpio.clear(clear.pins.get()),
            Request::GpioSetValue(set) => gpio.set_outputs(now, LOWER_PINS, set.values.into()),
            Request::GpioExtSetValue(set) => gpio.set_outputs(now, ALL_PINS, set.values.get()),
            Request::EncOpen(open) => encoder.open(open.mode),
            Request::DacOpen(open) => analog.open_dac(now, open.trigger),
            Request::DacClose(_) => analog.close_dac(),
            Request::DacSetDelayTime(set) => analog.set_delay(set.delay.get()),
            Request::AdcOpen(open) => analog.open_adc(open.mode),
            Request::AdcClose(_) => analog.close_adc(),
            _ => return false,
        }
        true
    }

    /// Runs a command that has a result, or that is refused `[OURS]` because its unit is not open.
    fn use_io(&mut self, request: &Request<'_>, data: &mut [u8]) -> Option<CommandOutcome> {
        let (now, gpio, encoder, analog) = (self.now, &mut self.gpio, &mut self.encoder, &mut self.analog);
        Some(match *request {
            Request::GpioGetValue(_) => encoded(gpio.values() as u16, data),
            Request::GpioExtGetValue(_) => encoded(gpio.values(), data),
            Request::GpioGetIntFlag(_) => encoded(gpio.flags() as u16, data),
            Request::GpioExtGetIntFlag(_) => encoded(gpio.flags(), data),

            Request::EncStart(_) => done_if(encoder.run(true)),
            Request::EncStop(_) => done_if(encoder.run(false)),
            Request::EncGetCount(_) => answered(encoder.count(), data),

            Request::DacSetData(set) => done_if(analog.set_data(now, set.value)),
            Request::DacStartConv(_) => done_if(analog.start_dac(now)),

            Request::AdcConfigSampleModule(_) => done_if(analog.adc_is_open()),
            Request::AdcStartConv(_) => done_if(analog.start_adc(now, self.timing.adc_ns)),
            Request::AdcGetDataValidFlag(_) => encoded(u32::from(analog.adc_is_valid()), data),
            Request::AdcGetConvData(_) => answered(Analog::new(analog.take_adc().into()), data),
            _ => return None,
        })
    }
}

fn encoded<'a>(answer: impl Answer<'a>, data: &mut [u8]) -> CommandOutcome {
    Ok(answer.encode(data)?)
}
