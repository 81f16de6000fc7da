//! A condition of `ecmsk find`, and its evaluation at a report.

use std::cmp::Ordering;

use super::measure::Measure;
use crate::motion::Quantity;

/// The values at one report. `None` means that the value is unknown at this report.
pub trait Values {
    /// A quantity of an axis, in counts, counts per second, or 0.1 % of the rated torque. For an alarm it is the error
    /// code, or 0 without an alarm.
    fn of_axis(&self, quantity: OfAxis, slave: u8) -> Option<i64>;
    /// Whether an axis has a state; without `slave`, whether any axis has it.
    fn flag(&self, flag: Flag, slave: Option<u8>) -> Option<bool>;
    /// The network state: byte 2 of slot 0.
    fn state(&self) -> u8;
    /// The number of free entries of the FIFO.
    fn fifo(&self) -> Option<u16>;
}

/// A quantity of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OfAxis {
    /// The actual position.
    Position,
    /// The target in force.
    Target,
    /// One of the quantities that `summary` reports, too.
    Moving(Quantity),
    /// The error code of an alarm.
    Alarm,
}

impl OfAxis {
    /// Whether the quantity is compared without its sign, as in `summary`. For a following error or a step of the
    /// target, users mostly look for its size. For positions and velocities the sign matters. \[OURS]
    pub const fn is_magnitude(self) -> bool {
        matches!(self, Self::Moving(Quantity::FollowingError | Quantity::TargetStep))
    }
}

/// A state of an axis, true or false.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flag {
    /// Operation enabled.
    Enabled,
    /// Fault, or Fault reaction active.
    Fault,
    /// Quick stop active.
    QuickStop,
    /// The axis is homing.
    Homing,
    /// The board has been in state 0x18 and the slot has not changed since that state began.
    Lost,
    /// A bit of the statusword.
    Bit(u16),
}

/// A condition, which is true or false at each report.
#[derive(Clone, Debug, PartialEq)]
pub enum Condition {
    /// At least one of these conditions is true.
    Any(Vec<Condition>),
    /// All of these conditions are true.
    All(Vec<Condition>),
    /// This condition is false.
    Not(Box<Condition>),
    /// The two numbers have one of the orders of `comparison`.
    Compare { left: Number, comparison: Comparison, right: Number },
    /// The axis has this state; without `slave`, any axis has it.
    Flag { flag: Flag, slave: Option<u8> },
    /// The FIFO was empty during a motion.
    Gap,
}

/// A number in a comparison.
#[derive(Clone, Debug, PartialEq)]
pub enum Number {
    Leaf(Leaf),
    /// The absolute value of a number.
    Magnitude(Box<Number>),
    /// The sum of numbers, each with a factor of 1 or -1.
    Sum(Vec<(f64, Number)>),
}

/// A literal number of the expression, or a quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Leaf {
    /// Its position in the expression, in bytes.
    pub at: usize,
    pub what: What,
    /// The value is divided by this to convert it to the unit of the comparison.
    pub divisor: f64,
}

/// The kind of a [`Leaf`].
#[derive(Clone, Debug, PartialEq)]
pub enum What {
    /// A literal number, with its unit if it has one.
    Literal { value: f64, measure: Option<Measure> },
    /// A quantity of an axis. `is_named`: the axis is given by its name and not by its slave number.
    OfAxis { quantity: OfAxis, slave: u8, is_named: bool },
    /// The state of the network.
    State,
    /// A state of the network by its name.
    StateWord(u8),
    /// The number of free entries of the FIFO.
    Fifo,
}

/// The orders of two numbers for which a comparison is true.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Comparison {
    pub orders: &'static [Ordering],
}

impl Condition {
    /// Whether the condition is true; `None` if this depends on an unknown value. `gap`: whether the FIFO was empty
    /// during a motion.
    pub fn holds(&self, values: &impl Values, gap: bool) -> Option<bool> {
        match self {
            Self::Any(all) => joined(all, true, |condition| condition.holds(values, gap)),
            Self::All(all) => joined(all, false, |condition| condition.holds(values, gap)),
            Self::Not(condition) => Some(!condition.holds(values, gap)?),
            Self::Compare { left, comparison, right } => {
                let order = left.value(values)?.partial_cmp(&right.value(values)?)?;
                Some(comparison.orders.contains(&order))
            }
            Self::Flag { flag, slave } => values.flag(*flag, *slave),
            Self::Gap => Some(gap),
        }
    }

    /// Whether `has` returns true for this condition or for any condition inside it.
    pub fn has(&self, has: &impl Fn(&Self) -> bool) -> bool {
        has(self)
            || match self {
                Self::Any(all) | Self::All(all) => all.iter().any(|condition| condition.has(has)),
                Self::Not(condition) => condition.has(has),
                Self::Compare { .. } | Self::Flag { .. } | Self::Gap => false,
            }
    }

    /// Whether the condition depends on the target in force.
    pub fn has_target(&self) -> bool {
        use OfAxis::{Moving, Target};
        self.has_quantity(&|quantity| {
            matches!(quantity, Target | Moving(Quantity::FollowingError | Quantity::TargetStep))
        })
    }

    /// Whether the condition depends on a velocity.
    pub fn has_velocity(&self) -> bool {
        self.has_quantity(&|quantity| quantity == OfAxis::Moving(Quantity::Velocity))
    }

    fn has_quantity(&self, is_it: &impl Fn(OfAxis) -> bool) -> bool {
        let is_leaf = |leaf: &Leaf| match leaf.what {
            What::OfAxis { quantity, .. } => is_it(quantity),
            What::Literal { .. } | What::State | What::StateWord(_) | What::Fifo => false,
        };
        self.has(&|condition| match condition {
            Self::Compare { left, right, .. } => left.any_leaf(&is_leaf) || right.any_leaf(&is_leaf),
            Self::Any(_) | Self::All(_) | Self::Not(_) | Self::Flag { .. } | Self::Gap => false,
        })
    }
}

/// Joins conditions: the result is `decides` if any condition has this value, else the opposite. It is unknown (`None`)
/// if an unknown condition could have changed it.
fn joined(all: &[Condition], decides: bool, holds: impl Fn(&Condition) -> Option<bool>) -> Option<bool> {
    let mut joined = Some(!decides);
    for condition in all {
        match holds(condition) {
            Some(found) if found == decides => return Some(decides),
            Some(_) => {}
            None => joined = None,
        }
    }
    joined
}

impl Number {
    fn value(&self, values: &impl Values) -> Option<f64> {
        match self {
            Self::Leaf(leaf) => Some(leaf.value(values)? / leaf.divisor),
            Self::Magnitude(number) => Some(number.value(values)?.abs()),
            Self::Sum(all) => all.iter().map(|(sign, number)| Some(sign * number.value(values)?)).sum(),
        }
    }

    fn any_leaf(&self, is: &impl Fn(&Leaf) -> bool) -> bool {
        match self {
            Self::Leaf(leaf) => is(leaf),
            Self::Magnitude(number) => number.any_leaf(is),
            Self::Sum(all) => all.iter().any(|(_, number)| number.any_leaf(is)),
        }
    }

    /// All leaves of this number, from left to right.
    pub fn leaves(&mut self) -> Vec<&mut Leaf> {
        match self {
            Self::Leaf(leaf) => vec![leaf],
            Self::Magnitude(number) => number.leaves(),
            Self::Sum(all) => all.iter_mut().flat_map(|(_, number)| number.leaves()).collect(),
        }
    }
}

impl Leaf {
    fn value(&self, values: &impl Values) -> Option<f64> {
        match self.what {
            What::Literal { value, .. } => Some(value),
            What::OfAxis { quantity, slave, .. } => {
                let value = values.of_axis(quantity, slave)? as f64;
                Some(if quantity.is_magnitude() { value.abs() } else { value })
            }
            What::State => Some(values.state().into()),
            What::StateWord(code) => Some(code.into()),
            What::Fifo => values.fifo().map(f64::from),
        }
    }
}
