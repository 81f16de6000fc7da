//! The electric side of the drive: supply, motor current, outputs, LEDs, station number.

use super::alarms::Dp3clAlarm;
use super::inputs::Dp3clOutputs;
use super::leds::{Dp3clLeds, LinkLed, RedLed};
use super::{Dp3cl, parameters};
use crate::ethercat::cia402::DriveState;
use crate::ethercat::{AlState, Ns};
use crate::slave::AlStatus;

/// The unit of P0-12, ns. \[OURS] The manual prints none: a millisecond.
const HOLDING_DELAY_UNIT_NS: Ns = 1_000_000;

impl Dp3cl {
    /// The auto tuning at power-on, P1-00, finds out whether there is a motor.
    pub(super) fn test_at_power_on(&mut self) {
        let tunes = self.base.values.get(parameters::AUTO_TUNING) != 0;
        if tunes && !self.config.has_motor {
            self.raise(Dp3clAlarm::OpenMotor);
        }
        self.check_supply();
    }

    /// Changes the supply voltage, mV.
    pub fn set_supply(&mut self, supply_mv: u32) {
        self.config.supply_mv = supply_mv;
        self.check_supply();
    }

    /// The alarms of the supply. P3-02 is the threshold of under voltage, V; 0: there is no such alarm.
    fn check_supply(&mut self) {
        let threshold_mv = u32::from(self.base.values.get(parameters::UNDER_VOLTAGE)) * 1000;
        if self.config.supply_mv > self.config.rating.supply_max_mv() {
            self.raise(Dp3clAlarm::OverVoltage);
        } else if self.config.supply_mv < threshold_mv {
            self.raise(Dp3clAlarm::UnderVoltage);
        }
    }

    /// The outputs ERR and BRK.
    pub fn outputs(&self) -> Dp3clOutputs {
        let values = &self.base.values;
        Dp3clOutputs::of(
            values.get(parameters::ALARM_OUTPUT),
            values.get(parameters::BRAKE_OUTPUT),
            self.axis.machine().fault().is_some(),
            self.has_current(),
        )
    }

    /// What the LEDs show.
    pub fn leds(&self) -> Dp3clLeds {
        let alarm = match self.axis.machine().fault().map(|fault| Dp3clAlarm::of_error_code(fault.code)) {
            None => RedLed::Off,
            Some(Some(alarm)) if alarm.number() < 10 => RedLed::Flashes(alarm.number() as u8),
            Some(_) => RedLed::On,
        };
        let by_bus = self.alarms.present().is_some_and(|alarm| alarm.al_status() != AlStatus(0));
        Dp3clLeds {
            power: true,
            alarm,
            run: self.base.al_state() != AlState::Init && !by_bus,
            link_in: self.link_led(0),
            link_out: self.link_led(1),
        }
    }

    /// What the LED of a port shows.
    const fn link_led(&self, port: usize) -> LinkLed {
        match (self.links[port], self.exchanged || self.traffic) {
            (false, _) => LinkLed::Off,
            (true, true) => LinkLed::Flashing,
            (true, false) => LinkLed::On,
        }
    }

    /// The time of the command filter that the parameter P0-02 sets; the dial switch may set another one.
    pub const fn filter_time(&self) -> u16 {
        self.memory.filter_time()
    }

    /// The peak current of the motor, mA. \[OURS] The dial switch replaces P4-00 unless SW1 to SW3 are off.
    pub fn peak_ma(&self) -> u32 {
        let by_parameter = u32::from(self.base.values.get(parameters::PEAK_CURRENT)) * 100;
        self.config.dial.peak_ma(self.config.rating).map_or(by_parameter, u32::from)
    }

    /// The current in the motor, mA: none while the power stage is off; while no pulses come for the time of P0-12 that of
    /// P0-08, unless SW4 keeps it full; otherwise that of P0-05.
    pub fn motor_ma(&self) -> u32 {
        if !self.has_current() {
            return 0;
        }
        let values = &self.base.values;
        let delay_ns = Ns::from(values.get(parameters::HOLDING_DELAY)) * HOLDING_DELAY_UNIT_NS;
        let holds = self.without_pulses_ns >= delay_ns && !self.config.dial.holds_full_current();
        let percent = if holds { parameters::HOLDING_CURRENT } else { parameters::RUNNING_CURRENT };
        self.peak_ma() * u32::from(values.get(percent)) / 100
    }

    /// Whether the power stage is on.
    fn has_current(&self) -> bool {
        use DriveState::*;
        matches!(self.axis.machine().state(), OperationEnabled | QuickStopActive | FaultReactionActive)
    }
}
