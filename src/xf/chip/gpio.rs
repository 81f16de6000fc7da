//! GPIO 0 to 19: modes, pull resistors, outputs, debounced inputs, interrupts.

use crate::ethercat::Ns;
use crate::xf::request::{DebounceClock, DebounceSource, GpioMode, GpioPull, GpioTrigger};

/// Number of GPIOs: 0 to 19.
pub const PINS: usize = 20;

#[derive(Clone, Copy)]
struct Pin {
    mode: GpioMode,
    pull: GpioPull,
    trigger: GpioTrigger,
    is_debounced: bool,
    /// The output value that the host has set.
    output: bool,
    /// The level with which an external signal drives the pin; `None` if nothing drives it.
    wired: Option<bool>,
    /// The level that the chip reads, after debouncing.
    level: bool,
    /// The time since which the level at the pin differs from `level`, the level that the chip reads; `None` if they
    /// are equal.
    differs_since: Option<Ns>,
}

impl Pin {
    /// The state at power-on: all GPIOs are floating inputs (XF EN, "GPIO"), with nothing wired to them.
    const START: Self = Self {
        mode: GpioMode::Input,
        pull: GpioPull::None,
        trigger: GpioTrigger::Off,
        is_debounced: false,
        output: false,
        wired: None,
        level: false,
        differs_since: None,
    };

    /// The level at the pin. `[OURS]` A floating pin is low; a quasi-bidirectional pin is pulled up.
    const fn level(&self) -> bool {
        match self.mode {
            GpioMode::Output => self.output,
            GpioMode::OpenDrain | GpioMode::QuasiBidirectional if !self.output => false,
            mode => match self.wired {
                Some(level) => level,
                None => matches!(mode, GpioMode::QuasiBidirectional) || matches!(self.pull, GpioPull::Up),
            },
        }
    }

    /// Whether a rising (`rises`) or falling edge raises the interrupt.
    ///
    /// `[OURS]` The manual's codes are 1 both, 2 falling, 3 rising. The vendor's driver sends 3 for both, 4 for falling and 5
    /// for rising. The model understands 4 and 5 as the driver does, and 3 as the manual does.
    const fn is_triggered(&self, rises: bool) -> bool {
        match self.trigger {
            GpioTrigger::Off => false,
            GpioTrigger::Both => true,
            GpioTrigger::Falling | GpioTrigger::Driver4 => !rises,
            GpioTrigger::Rising | GpioTrigger::Driver5 => rises,
        }
    }
}

/// All GPIOs. In masks bit k is GPIO k.
pub(super) struct Gpio {
    pins: [Pin; PINS],
    flags: u32,
    debounce_ns: Ns,
}

impl Gpio {
    pub const fn new() -> Self {
        Self { pins: [Pin::START; PINS], flags: 0, debounce_ns: 0 }
    }

    /// Resets as at power-on; the signals wired to the pins stay.
    pub fn reset(&mut self, now: Ns) {
        let wired = self.pins.map(|pin| pin.wired);
        *self = Self::new();
        for (pin, wired) in self.pins.iter_mut().zip(wired) {
            pin.wired = wired;
            pin.level = pin.level();
        }
        self.settle(now);
    }

    pub fn set_mode(&mut self, now: Ns, pins: u32, mode: GpioMode, pull: GpioPull) {
        self.change(now, pins, |pin| (pin.mode, pin.pull) = (mode, pull));
    }

    pub fn set_debounced(&mut self, now: Ns, pins: u32, on: bool) {
        self.change(now, pins, |pin| pin.is_debounced = on);
    }

    /// Sets the debounce clock. `[OURS]` An input changes once its level was constant for one period of this clock.
    pub fn set_debounce_clock(&mut self, clock: DebounceClock) {
        let periods: Ns = 1 << clock.exponent();
        self.debounce_ns = match clock.source() {
            DebounceSource::Mhz192 => periods * 1_000 / 192,
            DebounceSource::Khz10 => periods * 100_000,
        };
    }

    pub fn set_trigger(&mut self, channel: u8, trigger: GpioTrigger) {
        self.pins[usize::from(channel)].trigger = trigger;
    }

    /// Sets the outputs of the pins in the mask `pins` to `values`; bit k is GPIO k.
    pub fn set_outputs(&mut self, now: Ns, pins: u32, values: u32) {
        for k in 0..PINS {
            self.change(now, pins & 1 << k, |pin| pin.output = values & 1 << k != 0);
        }
    }

    pub fn wire(&mut self, now: Ns, channel: u8, level: Option<bool>) {
        if usize::from(channel) < PINS {
            self.change(now, 1 << channel, |pin| pin.wired = level);
        }
    }

    pub const fn flags(&self) -> u32 {
        self.flags
    }

    pub const fn clear(&mut self, pins: u32) {
        self.flags &= !pins;
    }

    /// The levels that the chip reads, after debouncing; bit k is GPIO k.
    pub fn values(&self) -> u32 {
        self.pins.iter().enumerate().fold(0, |values, (k, pin)| values | u32::from(pin.level) << k)
    }

    /// The level at a pin, before debouncing; low for a channel that does not exist.
    pub fn level(&self, channel: u8) -> bool {
        self.pins.get(usize::from(channel)).is_some_and(Pin::level)
    }

    /// Lets time pass until `now`: debounced inputs take over a level that was constant for long enough.
    pub fn settle(&mut self, now: Ns) {
        for k in 0..PINS {
            let pin = &mut self.pins[k];
            let level = pin.level();
            if level == pin.level {
                pin.differs_since = None;
                continue;
            }
            let since = *pin.differs_since.get_or_insert(now);
            let waits = pin.is_debounced && pin.mode == GpioMode::Input && now < since + self.debounce_ns;
            if !waits {
                (pin.level, pin.differs_since) = (level, None);
                if pin.is_triggered(level) {
                    self.flags |= 1 << k;
                }
            }
        }
    }

    fn change(&mut self, now: Ns, pins: u32, change: impl Fn(&mut Pin)) {
        self.settle(now);
        let chosen = |k: &usize| pins & 1 << k != 0;
        (0..PINS).filter(chosen).for_each(|k| change(&mut self.pins[k]));
        self.settle(now);
    }
}
