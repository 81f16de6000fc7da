//! The electrical side of the drive: supply, motor current, outputs, LEDs.

use super::alarms::Dp3clAlarm;
use super::inputs::Dp3clOutputs;
use super::leds::{Dp3clLeds, LinkLed, RedLed};
use super::{Dp3cl, parameters};
use crate::ethercat::cia402::DriveState;
use crate::ethercat::{AlState, Ns};
use crate::slave::AlStatus;

/// The unit of P0-12, ns. \[OURS] One millisecond; the manual gives no unit.
const HOLDING_DELAY_UNIT_NS: Ns = 1_000_000;

impl Dp3cl {
    /// The power-on test: auto tuning, P1-00, detects whether a motor is connected; then the supply is checked.
    pub(super) fn test_at_power_on(&mut self) {
        let tunes = self.base.values.get(parameters::AUTO_TUNING) != 0;
        if tunes && !self.config.has_motor {
            self.raise(Dp3clAlarm::OpenMotor);
        }
        self.check_supply();
    }

    /// Sets the supply voltage, mV.
    pub fn set_supply(&mut self, supply_mv: u32) {
        self.config.supply_mv = supply_mv;
        self.check_supply();
    }

    /// Raises the overvoltage or undervoltage alarm if the supply is out of range. P3-02 is the undervoltage threshold, V;
    /// 0 disables that alarm.
    fn check_supply(&mut self) {
        let threshold_mv = u32::from(self.base.values.get(parameters::UNDER_VOLTAGE)) * 1000;
        if self.config.supply_mv > self.config.rating.supply_max_mv() {
            self.raise(Dp3clAlarm::OverVoltage);
        } else if self.config.supply_mv < threshold_mv {
            self.raise(Dp3clAlarm::UnderVoltage);
        }
    }

    /// The states of the outputs ERR and BRK.
    pub fn outputs(&self) -> Dp3clOutputs {
        let values = &self.base.values;
        Dp3clOutputs::of(
            values.get(parameters::ALARM_OUTPUT),
            values.get(parameters::BRAKE_OUTPUT),
            self.axis.machine().fault().is_some(),
            self.has_current(),
        )
    }

    /// The states of the LEDs.
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

    /// The state of the LED of a port.
    const fn link_led(&self, port: usize) -> LinkLed {
        match (self.links[port], self.exchanged || self.traffic) {
            (false, _) => LinkLed::Off,
            (true, true) => LinkLed::Flashing,
            (true, false) => LinkLed::On,
        }
    }

    /// The value of P0-02, the time of the command filter, as read at power-on. In a real drive the dial switch can
    /// override it; this value ignores the dial switch. The manual gives no unit.
    pub const fn filter_time(&self) -> u16 {
        self.memory.filter_time()
    }

    /// The peak current of the motor, mA. \[OURS] The dial switch overrides P4-00 unless SW1 to SW3 are off.
    pub fn peak_ma(&self) -> u32 {
        let by_parameter = u32::from(self.base.values.get(parameters::PEAK_CURRENT)) * 100;
        self.config.dial.peak_ma(self.config.rating).map_or(by_parameter, u32::from)
    }

    /// The motor current, mA: 0 while the power stage is off. Otherwise it is the running current P0-05, in percent of
    /// the peak current. If no command pulse has come for the delay P0-12, in ms, it is the holding current P0-08, in
    /// percent, unless SW4 keeps the full current.
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

    /// Whether the power stage is on and the motor has current.
    fn has_current(&self) -> bool {
        use DriveState::*;
        matches!(self.axis.machine().state(), OperationEnabled | QuickStopActive | FaultReactionActive)
    }
}
