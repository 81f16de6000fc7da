//! The homing methods of CiA 402-2 as data.
//!
//! Eight plans are all there is: each method is one of them or its mirror image (left and right, and the two limit
//! switches, change places), with the index pulse or without. A plan looks for one edge of one switch: the edge is
//! crossed in one direction, and a run that comes to the same edge from its other side turns there.

use crate::slave::switches::Input;

/// A direction of the shaft.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Counting up, "right".
    Positive,
    /// Counting down, "left".
    Negative,
}

impl Direction {
    /// The other one.
    pub const fn reversed(self) -> Self {
        match self {
            Self::Positive => Self::Negative,
            Self::Negative => Self::Positive,
        }
    }

    /// The same or, seen from the other end of the travel, the other one.
    pub const fn mirrored_if(self, mirrored: bool) -> Self {
        if mirrored { self.reversed() } else { self }
    }

    /// 1 or -1.
    pub const fn sign(self) -> f64 {
        match self {
            Self::Positive => 1.0,
            Self::Negative => -1.0,
        }
    }

    /// The limit switch at its end of the travel.
    pub const fn limit(self) -> Input {
        match self {
            Self::Positive => Input::PositiveLimit,
            Self::Negative => Input::NegativeLimit,
        }
    }
}

/// The edge of a switch by which home is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// The switch.
    pub switch: Input,
    /// The direction in which the shaft crosses it.
    pub moving: Direction,
    /// Whether the switch then becomes active, or inactive.
    pub rises: bool,
}

impl Edge {
    /// The direction in which it lies from a place where its switch is active.
    pub const fn from_within(self) -> Direction {
        if self.rises { self.moving.reversed() } else { self.moving }
    }
}

/// How home is looked for, for a method that sets out to the right where its switch is inactive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plan {
    /// By an edge.
    Edge {
        /// The edge.
        edge: Edge,
        /// Whether the positive limit switch turns the run, once, instead of ending it.
        limit_turns: bool,
    },
    /// By the next index pulse.
    Index,
    /// It is where the shaft is.
    Here,
}

/// A homing method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Method {
    /// The plan.
    pub plan: Plan,
    /// Left and right change places in the plan.
    pub mirrored: bool,
    /// Home is at the first index pulse after the edge, not at the edge.
    pub index: bool,
}

impl Method {
    /// The method of a value of 0x6098: 1 to 14, 17 to 30, 33, 34, 35 and 37; `None`: there is no such method here.
    pub const fn from_code(code: i8) -> Option<Self> {
        let (plan, mirrored, index) = match code {
            33 | 34 => (Plan::Index, code == 33, true),
            35 | 37 => (Plan::Here, false, false),
            1..=14 => (edge_plan(code), is_mirrored(code), true),
            17..=30 => (edge_plan(code - 16), is_mirrored(code - 16), false),
            _ => return None,
        };
        Some(Self { plan, mirrored, index })
    }

    /// The first input that it needs and that is not wired.
    pub fn missing(&self, is_wired: impl Fn(Input) -> bool) -> Option<Input> {
        let edge = match self.plan {
            Plan::Edge { edge: Edge { switch: Input::PositiveLimit, .. }, .. } => [Some(self.ahead()), None],
            Plan::Edge { edge, limit_turns } => [Some(edge.switch), limit_turns.then(|| self.ahead())],
            Plan::Index | Plan::Here => [None, None],
        };
        let index = self.index.then_some(Input::Index);
        edge.into_iter().chain([index]).flatten().find(|input| !is_wired(*input))
    }

    /// The limit switch at the end where it sets out to.
    fn ahead(&self) -> Input {
        Direction::Positive.mirrored_if(self.mirrored).limit()
    }
}

/// Of methods 1 to 14, those that set out to the left where their switch is inactive.
const fn is_mirrored(code: i8) -> bool {
    matches!(code, 1 | 5 | 6 | 11..=14)
}

/// The plan of methods 1 to 14, as it is for 2, 3, 4 and 7 to 10.
const fn edge_plan(code: i8) -> Plan {
    use Direction::{Negative, Positive};
    let (switch, moving, rises) = match code {
        1 | 2 => (Input::PositiveLimit, Negative, false),
        3 | 5 | 7 | 11 => (Input::Home, Negative, false),
        4 | 6 | 8 | 12 => (Input::Home, Positive, true),
        9 | 13 => (Input::Home, Negative, true),
        _ => (Input::Home, Positive, false),
    };
    Plan::Edge { edge: Edge { switch, moving, rises }, limit_turns: code >= 7 }
}
