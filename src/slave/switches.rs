//! The travel of an axis: two limit switches, a home switch, the index pulse of its encoder, and end stops.
//!
//! All positions are counts of the shaft. Homing shifts the position that the drive shows, never these counts. A switch
//! is active in a range of counts, both ends included. An edge is therefore between two counts and is detected at the
//! first count after it; the index pulse is one count wide. [`Switches::next`] finds the counts between two positions
//! at which a switch changes, so that edges and pulses are latched exactly, however far the shaft moves in a cycle.

use super::plant::Motor;

/// \[OURS] The distance in turns after which a homing run ends in an error, unless [`Travel::search_limit`] sets another
/// one.
const SEARCH_LIMIT_TURNS: u64 = 100;
/// \[OURS] The distance of the limit switches of [`Travel::for_turn`] from 0, turns.
const LIMIT_TURNS: i64 = 10;

/// A digital input of a drive: a switch along the travel of its axis, or the index pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Input {
    /// Negative limit switch, bit 0 of 0x60FD.
    NegativeLimit,
    /// Positive limit switch, bit 1 of 0x60FD.
    PositiveLimit,
    /// Home switch, bit 2 of 0x60FD.
    Home,
    /// Index pulse of the encoder, which no bit of 0x60FD shows.
    Index,
}

impl Input {
    /// Every input.
    pub const ALL: [Self; 4] = [Self::NegativeLimit, Self::PositiveLimit, Self::Home, Self::Index];

    /// The name of the input in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NegativeLimit => "negative limit switch",
            Self::PositiveLimit => "positive limit switch",
            Self::Home => "home switch",
            Self::Index => "index pulse",
        }
    }
}

/// The states of the three switches, as bits 0 to 2 of 0x60FD (CiA 402-2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Inputs(u8);

impl Inputs {
    /// Whether a switch is active. Always false for the index pulse, which is not a switch.
    pub const fn has(self, input: Input) -> bool {
        self.0 & Self::bit(input) != 0
    }

    /// Whether both limit switches are active at once.
    pub const fn has_both_limits(self) -> bool {
        self.has(Input::NegativeLimit) && self.has(Input::PositiveLimit)
    }

    /// The value of object 0x60FD (digital inputs), of which only bits 0 to 2 are used.
    pub fn bits(self) -> u32 {
        self.0.into()
    }

    /// The states with the limit switches exchanged, for mirrored homing methods.
    pub const fn mirrored(self) -> Self {
        Self(self.0 & 0b100 | (self.0 & 0b001) << 1 | (self.0 & 0b010) >> 1)
    }

    const fn bit(input: Input) -> u8 {
        match input {
            Input::NegativeLimit => 0b001,
            Input::PositiveLimit => 0b010,
            Input::Home => 0b100,
            Input::Index => 0,
        }
    }
}

/// The range of counts in which a home switch is active.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomeSwitch {
    /// A cam: active from `first` to `last`, both included.
    Cam {
        /// The lowest count at which the switch is active.
        first: i64,
        /// The highest count at which the switch is active.
        last: i64,
    },
    /// A step: active at this count and above.
    From(i64),
    /// A step: active at this count and below.
    UpTo(i64),
}

/// The switches and end stops along the travel of an axis, in counts of its shaft. An input that is `None` is not wired: it
/// reads 0, and a homing method that needs it ends in a homing error.
///
/// [`Travel::limits_stop_motion`] says whether limit switches act in CSP, CSV and CST; homing always uses them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Travel {
    /// The negative limit switch is active at this count and below. `None`: it is not wired.
    pub negative_limit: Option<i64>,
    /// The positive limit switch is active at this count and above. `None`: it is not wired.
    pub positive_limit: Option<i64>,
    /// The range in which the home switch is active. `None`: it is not wired.
    pub home: Option<HomeSwitch>,
    /// The position of the index pulse within a turn: it comes at every count with this remainder modulo the counts per
    /// turn. `None`: there is no index pulse.
    pub index: Option<u32>,
    /// Mechanical end stops: the lowest and the highest count that the shaft can reach. `None`: there are no end stops.
    pub stops: Option<(i64, i64)>,
    /// The maximum distance of a homing run, counts: all motion of the run added up, forward and back. A longer run ends in a
    /// homing error.
    pub search_limit: u64,
    /// \[OURS] Whether limit switches also act in CSP, CSV and CST: an active limit switch stops a motion in its
    /// direction on the quick-stop ramp (0x6085). The statusword shows internal limit active (bit 11) while the target
    /// is beyond the switch. The opposite direction stays free. If false, an axis passes the limit switches, like a
    /// drive that leaves them to its master.
    pub limits_stop_motion: bool,
}

impl Travel {
    /// No input is wired, and there are no end stops.
    pub const NONE: Self = Self {
        negative_limit: None,
        positive_limit: None,
        home: None,
        index: None,
        stops: None,
        search_limit: u64::MAX,
        limits_stop_motion: false,
    };

    /// \[OURS] A travel on which every homing method finds home from position 0, the position at power-on: limit switches
    /// 10 turns away on either side, a home cam half a turn wide around 0, an index pulse at every whole turn, no end
    /// stops, and homing runs of at most 100 turns. These default limit switches act in homing only.
    pub fn for_turn(counts_per_turn: u32) -> Self {
        let turn = i64::from(counts_per_turn.max(1));
        Self {
            negative_limit: Some(-LIMIT_TURNS * turn),
            positive_limit: Some(LIMIT_TURNS * turn),
            home: Some(HomeSwitch::Cam { first: -turn / 4, last: turn / 4 }),
            index: Some(0),
            stops: None,
            search_limit: SEARCH_LIMIT_TURNS * turn.unsigned_abs(),
            limits_stop_motion: false,
        }
    }
}

impl Default for Travel {
    /// The travel for the default servo motor, [`Motor::default`], see [`Self::for_turn`].
    fn default() -> Self {
        Self::for_turn(Motor::default().counts_per_turn)
    }
}

/// The switches of an axis: where each is active, whether it is wired, and the state in which it is stuck.
#[derive(Clone, Debug)]
pub struct Switches {
    /// The range of counts of each of the three switches: active inside of it, or outside if the switch is inverted.
    ranges: [(Input, Option<(i64, i64)>); 3],
    /// Whether each of the three switches is inverted: active outside of its range of counts instead of inside.
    inverted: [bool; 3],
    index: Option<i64>,
    turn: i64,
    search_limit: f64,
    /// The state in which each input is stuck, true for active, in the order of [`Input`]; `None` for a working input.
    stuck: [Option<bool>; 4],
}

impl Switches {
    /// The switches of a travel on a shaft with this number of counts per turn.
    pub fn new(travel: &Travel, counts_per_turn: u32) -> Self {
        let home = travel.home.map(|home| match home {
            HomeSwitch::Cam { first, last } => (first, last),
            HomeSwitch::From(first) => (first, i64::MAX),
            HomeSwitch::UpTo(last) => (i64::MIN, last),
        });
        Self {
            ranges: [
                (Input::NegativeLimit, travel.negative_limit.map(|last| (i64::MIN, last))),
                (Input::PositiveLimit, travel.positive_limit.map(|first| (first, i64::MAX))),
                (Input::Home, home),
            ],
            inverted: [false; 3],
            index: travel.index.map(i64::from),
            turn: counts_per_turn.max(1).into(),
            search_limit: travel.search_limit as f64,
            stuck: [None; 4],
        }
    }

    /// These switches with other terminals: `wiring` gives for each switch the range of counts in which its terminal is
    /// on, both ends included, and whether the switch is active outside of that range instead; `None`: the switch is
    /// not wired. The search limit and the index pulse, even a stuck one, are kept. The three switches are no longer
    /// stuck.
    #[must_use]
    pub fn rewired(&self, wiring: impl Fn(Input) -> Option<((i64, i64), bool)>) -> Self {
        let wired = self.ranges.map(|(input, _)| (input, wiring(input)));
        Self {
            ranges: wired.map(|(input, wired)| (input, wired.map(|(range, _)| range))),
            inverted: wired.map(|(_, wired)| wired.is_some_and(|(_, inverted)| inverted)),
            stuck: [None, None, None, self.stuck[Input::Index as usize]],
            ..*self
        }
    }

    /// Makes an input stick in a state, true for active; `None` repairs it. A stuck index pulse does not occur, whatever the
    /// state.
    pub const fn stick(&mut self, input: Input, value: Option<bool>) {
        self.stuck[input as usize] = value;
    }

    /// Whether an input is wired, even if it is stuck.
    pub fn is_wired(&self, input: Input) -> bool {
        match input {
            Input::Index => self.index.is_some(),
            _ => self.ranges.iter().any(|(wired, range)| *wired == input && range.is_some()),
        }
    }

    /// The maximum distance of a homing run, forward and back added up, counts.
    pub const fn search_limit(&self) -> f64 {
        self.search_limit
    }

    /// The states of the switches when the shaft is at `position`, counts.
    pub fn read(&self, position: i64) -> Inputs {
        let mut bits = 0;
        for ((input, range), inverted) in self.ranges.into_iter().zip(self.inverted) {
            let Some((first, last)) = range else { continue };
            if self.stuck[input as usize].unwrap_or((first <= position && position <= last) != inverted) {
                bits |= Inputs::bit(input);
            }
        }
        Inputs(bits)
    }

    /// Whether one of the three switches, without the index pulse, changes between two counts. A cycle calls this
    /// function first: it is cheaper than [`Switches::next`], and in most cycles no switch changes.
    pub fn change_between(&self, from: i64, to: i64) -> bool {
        let (low, high) = if from < to { (from, to) } else { (to, from) };
        self.ranges.iter().any(|(input, range)| {
            let crossed = |(first, last)| (low < first && first <= high) || (low <= last && last < high);
            range.is_some_and(crossed) && self.stuck[*input as usize].is_none()
        })
    }

    /// Whether the index pulse comes at the count `position`.
    pub fn has_index(&self, position: i64) -> bool {
        self.next_index(position.wrapping_sub(1), true) == Some(position)
    }

    /// The first count after `from`, in the direction of `to` and not beyond it, at which a switch changes or, if
    /// `index` is true, the index pulse comes. `None`: there is no such count.
    pub fn next(&self, from: i64, to: i64, index: bool) -> Option<i64> {
        let up = to > from;
        let ahead = |at: &i64| if up { from < *at && *at <= to } else { to <= *at && *at < from };
        let edges = self.ranges.into_iter().flat_map(|(input, range)| {
            let working = range.filter(|_| self.stuck[input as usize].is_none());
            working.map_or([None; 2], |(first, last)| match up {
                true => [Some(first), last.checked_add(1)],
                false => [first.checked_sub(1), Some(last)],
            })
        });
        let pulse = if index { self.next_index(from, up) } else { None };
        let places = edges.flatten().chain(pulse).filter(ahead);
        if up { places.min() } else { places.max() }
    }

    /// The first count after `from`, in the direction of `to` and not beyond it, at which the index pulse comes.
    /// `None`: there is no such count.
    pub fn next_pulse(&self, from: i64, to: i64) -> Option<i64> {
        let up = to > from;
        self.next_index(from, up).filter(|at| if up { *at <= to } else { to <= *at })
    }

    /// The count of the next index pulse after `from`, upwards or downwards. `None`: the index pulse is not wired, or
    /// is stuck.
    fn next_index(&self, from: i64, up: bool) -> Option<i64> {
        let index = self.index.filter(|_| self.stuck[Input::Index as usize].is_none())?;
        let way = if up { index.wrapping_sub(from) } else { from.wrapping_sub(index) }.rem_euclid(self.turn);
        let way = if way == 0 { self.turn } else { way };
        Some(if up { from.wrapping_add(way) } else { from.wrapping_sub(way) })
    }
}
