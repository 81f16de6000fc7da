//! The chip's DAC and ADC.

use crate::ethercat::Ns;
use crate::xf::request::{AdcMode, Analog, DacTrigger};

/// The middle of the ADC's range of 0 to 4095: the value of a differential input of 0 V.
const MIDDLE: i32 = 2048;

pub(super) struct AnalogUnit {
    dac: Option<DacTrigger>,
    delay_ns: Ns,
    data: u16,
    /// A running DAC conversion: its end in the chip's time, ns, and the value that it outputs then.
    converting: Option<(Ns, u16)>,
    output: u16,
    start_pin: bool,
    adc: Option<AdcMode>,
    adc_done_at: Option<Ns>,
    adc_value: Option<u16>,
    last_value: u16,
    inputs: [u16; 2],
}

impl AnalogUnit {
    pub const fn new() -> Self {
        Self {
            dac: None,
            delay_ns: 0,
            data: 0,
            converting: None,
            output: 0,
            start_pin: false,
            adc: None,
            adc_done_at: None,
            adc_value: None,
            last_value: 0,
            inputs: [0; 2],
        }
    }

    /// Resets DAC and ADC as at power-on; the levels at their pins stay.
    pub const fn reset(&mut self) {
        let (start_pin, inputs) = (self.start_pin, self.inputs);
        *self = Self { start_pin, inputs, ..Self::new() };
    }

    pub fn open_dac(&mut self, now: Ns, trigger: DacTrigger) {
        self.dac = Some(trigger);
        self.convert_at_level(now);
    }

    pub const fn close_dac(&mut self) {
        (self.dac, self.converting) = (None, None);
    }

    /// Sets the DAC's conversion time, in units of 1/96 us.
    pub fn set_delay(&mut self, units: u32) {
        self.delay_ns = Ns::from(units) * 1_000 / 96;
    }

    /// Sets the value for DAC conversions, and converts it at once if the DAC's trigger is new data or the present
    /// level of DAC_ST. Returns false if the DAC is closed.
    pub fn set_data(&mut self, now: Ns, value: Analog) -> bool {
        self.data = value.get() as u16;
        if self.dac == Some(DacTrigger::SetData) {
            self.convert(now);
        }
        self.convert_at_level(now);
        self.dac.is_some()
    }

    /// Starts a DAC conversion; returns false if the DAC is closed. `[OURS]` If the DAC's trigger is a pin or new data,
    /// nothing is started, and the result is true.
    pub fn start_dac(&mut self, now: Ns) -> bool {
        if self.dac == Some(DacTrigger::StartConv) {
            self.convert(now);
        }
        self.dac.is_some()
    }

    /// Sets the level of the pin DAC_ST, and starts a DAC conversion if this edge or level triggers it.
    pub fn set_start_pin(&mut self, now: Ns, level: bool) {
        let edge = (self.start_pin, level);
        self.start_pin = level;
        if matches!((self.dac, edge), (Some(DacTrigger::PinRising), (false, true)))
            || matches!((self.dac, edge), (Some(DacTrigger::PinFalling), (true, false)))
        {
            self.convert(now);
        }
        self.convert_at_level(now);
    }

    /// Starts a DAC conversion if the pin DAC_ST has the level that triggers the DAC. `[OURS]` As long as the pin has this
    /// level, each new value is converted at once.
    fn convert_at_level(&mut self, now: Ns) {
        let level = match self.dac {
            Some(DacTrigger::PinLow) => false,
            Some(DacTrigger::PinHigh) => true,
            _ => return,
        };
        if self.start_pin == level {
            self.convert(now);
        }
    }

    fn convert(&mut self, now: Ns) {
        self.converting = Some((now + self.delay_ns, self.data));
        self.settle(now);
    }

    /// The value that the DAC outputs; `None` if it is closed.
    pub fn output(&self) -> Option<u16> {
        self.dac.map(|_| self.output)
    }

    pub const fn open_adc(&mut self, mode: AdcMode) {
        self.adc = Some(mode);
    }

    pub const fn close_adc(&mut self) {
        (self.adc, self.adc_done_at, self.adc_value) = (None, None, None);
    }

    /// Starts an ADC conversion of `takes_ns`; returns false if the ADC is closed.
    pub fn start_adc(&mut self, now: Ns, takes_ns: Ns) -> bool {
        (self.adc_done_at, self.adc_value) = (self.adc.map(|_| now + takes_ns), None);
        self.adc.is_some()
    }

    pub const fn adc_is_open(&self) -> bool {
        self.adc.is_some()
    }

    /// Whether an ADC conversion is complete and its value was not read yet.
    pub const fn adc_is_valid(&self) -> bool {
        self.adc_value.is_some()
    }

    /// Takes the converted value. `[OURS]` Reading makes the value invalid; a further read returns the last value
    /// again.
    pub fn take_adc(&mut self) -> u16 {
        self.last_value = self.adc_value.take().unwrap_or(self.last_value);
        self.last_value
    }

    /// Sets the values at the two ADC inputs, 0..=4095 each; larger ones count as 4095.
    pub fn wire_adc(&mut self, positive: u16, negative: u16) {
        self.inputs = [positive.min(4095), negative.min(4095)];
    }

    /// Ends the conversions that are complete at `now`: the DAC outputs its value, the ADC's value becomes valid.
    pub fn settle(&mut self, now: Ns) {
        if let Some((_, value)) = self.converting.take_if(|(end, _)| *end <= now) {
            self.output = value;
        }
        if self.adc_done_at.take_if(|end| *end <= now).is_some() {
            let [positive, negative] = self.inputs.map(i32::from);
            self.adc_value = Some(match self.adc {
                Some(AdcMode::Differential) => differential(positive, negative),
                _ => positive as u16,
            });
        }
    }
}

/// The value of two inputs in differential mode. `[OURS]` Half their difference, around the middle of the range, so that every
/// difference is in the range.
fn differential(positive: i32, negative: i32) -> u16 {
    (MIDDLE + (positive - negative) / 2).clamp(0, 4095) as u16
}
