//! A condition of `ecmsk find`, and whether it holds at a report.

use std::cmp::Ordering;

use super::measure::Measure;
use crate::motion::Quantity;

/// The values at one report. What is `None` is not known there.
pub trait Values {
    /// A quantity of an axis, in counts, counts per second, or 0.1 % of the rated torque; of an alarm its code, and 0
    /// without one.
    fn of_axis(&self, quantity: OfAxis, slave: u8) -> Option<i64>;
    /// A state of an axis; without one, whether any axis has it.
    fn flag(&self, flag: Flag, slave: Option<u8>) -> Option<bool>;
    /// Byte 2 of slot 0.
    fn state(&self) -> u8;
    /// The free entries of the FIFO.
    fn fifo(&self) -> Option<u16>;
}

/// A quantity of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OfAxis {
    /// The actual position.
    Position,
    /// The target in force.
    Target,
    /// What `summary` has, too.
    Moving(Quantity),
    /// The error code of an alarm.
    Alarm,
}

impl OfAxis {
    /// Whether the quantity is a distance without a sign, as in `summary`. The direction of a position or velocity matters, and
    /// what is looked for in these two is mostly how much it is. \[OURS]
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
    /// The board is in state 0x18, and the slot has not changed since.
    Lost,
    /// A bit of the statusword.
    Bit(u16),
}

/// A condition, which holds or not at each report.
#[derive(Clone, Debug, PartialEq)]
pub enum Condition {
    /// At least one of these holds.
    Any(Vec<Condition>),
    /// All of these hold.
    All(Vec<Condition>),
    /// This one does not hold.
    Not(Box<Condition>),
    /// The numbers compare so.
    Compare { left: Number, comparison: Comparison, right: Number },
    /// An axis has this state; without a slave, any axis.
    Flag { flag: Flag, slave: Option<u8> },
    /// The FIFO was empty in a motion.
    Gap,
}

/// A number in a comparison.
#[derive(Clone, Debug, PartialEq)]
pub enum Number {
    Leaf(Leaf),
    /// The absolute value of a number.
    Magnitude(Box<Number>),
    /// The sum of numbers, each times 1 or -1.
    Sum(Vec<(f64, Number)>),
}

/// A number that stands in the expression, or a quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Leaf {
    /// Where it begins in the expression, in bytes.
    pub at: usize,
    pub what: What,
    /// By what a value is divided to get the unit of the comparison.
    pub divisor: f64,
}

/// What a [`Leaf`] is.
#[derive(Clone, Debug, PartialEq)]
pub enum What {
    /// A number with its unit.
    Literal { value: f64, measure: Option<Measure> },
    /// A quantity of an axis, which is given by its name or by its number.
    OfAxis { quantity: OfAxis, slave: u8, is_named: bool },
    /// The state of the network.
    State,
    /// A state of the network by its name.
    StateWord(u8),
    /// The free entries of the FIFO.
    Fifo,
}

/// Which orders of two numbers a comparison allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Comparison {
    pub orders: &'static [Ordering],
}

impl Condition {
    /// Whether the condition holds; `None` if that depends on what is not known. `gap`: whether the FIFO was empty in a
    /// motion.
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

    /// Whether `has` is true of this condition or of one inside it.
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
        let is_target = |leaf: &Leaf| {
            let What::OfAxis { quantity, .. } = leaf.what else { return false };
            matches!(quantity, Target | Moving(Quantity::FollowingError | Quantity::TargetStep))
        };
        self.has(&|condition| match condition {
            Self::Compare { left, right, .. } => left.any_leaf(&is_target) || right.any_leaf(&is_target),
            _ => false,
        })
    }
}

/// Joins conditions of which one that is `decides` decides. What is not known counts only if it may decide.
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

    /// All leaves, from left to right.
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
