//! The inputs SI1 to SI4 and the outputs ERR and BRK, and their assignment to functions by parameters.
//!
//! A sensor along the travel is wired to a terminal, and a parameter selects the terminal for a function: with P2-06 = 4,
//! the positive limit switch is the sensor wired to SI4. Forcing the inputs of the device forces the terminals.

use crate::slave::lines::{InputPattern, Lines};
use crate::slave::switches::{HomeSwitch, Input, Travel};

/// The number of input terminals, SI1 to SI4.
pub(super) const PINS: usize = 4;

/// \[OURS] The wiring of SI1 to SI4: no sensor (a push button that clears alarms), POT, NOT and HOME. It fits the factory
/// parameters.
pub(super) const USUAL_WIRING: [Option<Input>; PINS] =
    [None, Some(Input::PositiveLimit), Some(Input::NegativeLimit), Some(Input::Home)];

/// Ranges of shaft counts in which current flows at a terminal: `NOWHERE` is empty, `EVERYWHERE` has all counts.
const NOWHERE: (i64, i64) = (i64::MAX, i64::MIN);
const EVERYWHERE: (i64, i64) = (i64::MIN, i64::MAX);

/// The terminal that one of P2-02 to P2-08 selects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Terminal {
    /// The index of the terminal, from 0.
    pub(super) pin: usize,
    /// Whether the function is on while no current flows at the terminal.
    pub(super) inverted: bool,
}

impl Terminal {
    /// Decodes one of the parameters P2-02 to P2-08: bits 0 to 3 are the number of the terminal, from 1, and bit 4
    /// inverts the function. \[OURS] Without bit 4 the function is on while current flows at the terminal. `None`: the
    /// function has no terminal, or a number that does not exist \[OURS].
    pub(super) fn of(parameter: u16, terminals: usize) -> Option<Self> {
        let pin = usize::from(parameter & 0xF).checked_sub(1).filter(|pin| *pin < terminals)?;
        Some(Self { pin, inverted: parameter & 1 << 4 != 0 })
    }
}

/// The terminals SI1 to SI4 with the sensors wired to them.
#[derive(Clone, Debug)]
pub(super) struct Pins {
    wiring: [Option<Input>; PINS],
    /// The range of positions in which current flows at each terminal, counts.
    ranges: [(i64, i64); PINS],
    /// The value at which the sensor of each terminal is stuck; `None` for a working sensor.
    stuck: [Option<bool>; PINS],
    lines: Lines,
}

impl Pins {
    /// The terminals with their sensors. With `reversed`, the motor turns the other way, so each sensor is at the negated
    /// position.
    pub(super) fn new(wiring: [Option<Input>; PINS], travel: &Travel, reversed: bool) -> Self {
        let range = |sensor| {
            let range = match sensor {
                Input::NegativeLimit => travel.negative_limit.map(|last| (i64::MIN, last)),
                Input::PositiveLimit => travel.positive_limit.map(|first| (first, i64::MAX)),
                Input::Home => travel.home.map(|home| match home {
                    HomeSwitch::Cam { first, last } => (first, last),
                    HomeSwitch::From(first) => (first, i64::MAX),
                    HomeSwitch::UpTo(last) => (i64::MIN, last),
                }),
                Input::Index => None,
            };
            // Negating `i64::MIN` would overflow. Both `i64::MIN` and `i64::MAX` mean that the range is unlimited in
            // that direction, so one becomes the other.
            let opposite = |end: i64| match end {
                i64::MIN => i64::MAX,
                i64::MAX => i64::MIN,
                end => -end,
            };
            range.map(|(first, last)| if reversed { (opposite(last), opposite(first)) } else { (first, last) })
        };
        let ranges = wiring.map(|sensor| sensor.and_then(range).unwrap_or(NOWHERE));
        Self { wiring, ranges, stuck: [None; PINS], lines: Lines::default() }
    }

    /// Whether current flows at a terminal when the shaft is at `position`, counts.
    pub(super) fn is_on(&self, pin: usize, position: i64) -> bool {
        match self.constant(pin) {
            Some(value) => value,
            None => {
                let (first, last) = self.ranges[pin];
                first <= position && position <= last
            }
        }
    }

    /// The level of a terminal that is forced or whose sensor is stuck; `None` for a terminal that follows its sensor.
    fn constant(&self, pin: usize) -> Option<bool> {
        if self.lines.is_forced() { Some(self.lines.inputs() >> pin & 1 != 0) } else { self.stuck[pin] }
    }

    /// The state of an input function, such as a limit switch or clearing alarms, when the shaft is at `position`,
    /// counts. `parameter` is the value of the parameter that assigns the function to a terminal. A function without a
    /// terminal is off.
    pub(super) fn function(&self, parameter: u16, position: i64) -> bool {
        Terminal::of(parameter, PINS).is_some_and(|terminal| self.is_on(terminal.pin, position) != terminal.inverted)
    }

    /// The range of counts in which current flows at the terminal of a function, and whether the function is inverted.
    /// `None`: the function has no terminal.
    pub(super) fn wiring_of(&self, parameter: u16) -> Option<((i64, i64), bool)> {
        let Terminal { pin, inverted } = Terminal::of(parameter, PINS)?;
        let range = match self.constant(pin) {
            Some(true) => EVERYWHERE,
            Some(false) => NOWHERE,
            None => self.ranges[pin],
        };
        Some((range, inverted))
    }

    /// The first count after `from` on the way to `to`, `to` included, at which the level of a terminal changes;
    /// `None`: it does not change on the way, or it is forced or stuck.
    pub(super) fn next_change(&self, pin: usize, from: i64, to: i64) -> Option<i64> {
        if self.constant(pin).is_some() {
            return None;
        }
        let (first, last) = self.ranges[pin];
        let up = to > from;
        let places = match up {
            true => [Some(first), last.checked_add(1)],
            false => [first.checked_sub(1), Some(last)],
        };
        let ahead = |at: &i64| if up { from < *at && *at <= to } else { to <= *at && *at < from };
        let places = places.into_iter().flatten().filter(ahead);
        if up { places.min() } else { places.max() }
    }

    /// Makes a sensor stick at a value; `None` repairs it.
    pub(super) fn stick(&mut self, sensor: Input, value: Option<bool>) {
        for (wired, stuck) in self.wiring.iter().zip(&mut self.stuck) {
            if *wired == Some(sensor) {
                *stuck = value;
            }
        }
    }

    /// Forces all terminals to a pattern, in which bit 0 is SI1; with `None` the terminals follow their sensors again.
    pub(super) fn force(&mut self, pattern: Option<InputPattern>) {
        self.lines.force(pattern);
        self.lines.pass(0);
    }

    /// Advances a forced pattern that changes with time by `dt_ns`.
    pub(super) const fn pass(&mut self, dt_ns: u64) {
        self.lines.pass(dt_ns);
    }

    /// Whether the terminals are forced.
    pub(super) const fn are_forced(&self) -> bool {
        self.lines.is_forced()
    }
}

/// The states of the drive's digital outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dp3clOutputs {
    /// ERR: on while the drive has an alarm (with the factory parameters).
    pub err: bool,
    /// BRK: on to open the brake, that is while the motor has current (with the factory parameters).
    pub brk: bool,
}

impl Dp3clOutputs {
    /// The outputs that the parameters P2-02 (alarm) and P2-03 (brake) select. \[OURS] Terminal 1 is ERR and terminal 2 is
    /// BRK; two functions on one terminal are ORed.
    pub(super) fn of(alarm_output: u16, brake_output: u16, alarm: bool, brake_open: bool) -> Self {
        let is_on = |pin| {
            let drives = |parameter, on: bool| {
                Terminal::of(parameter, 2).is_some_and(|terminal| terminal.pin == pin && on != terminal.inverted)
            };
            drives(alarm_output, alarm) || drives(brake_output, brake_open)
        };
        Self { err: is_on(0), brk: is_on(1) }
    }
}
