//! The homing methods of CiA 402-2 as data. To add a method, extend [`Method::from_code`], [`SUPPORTED`] and the tables
//! of the tests.
//!
//! A search plan names one edge of one switch, and the direction in which the shaft has to cross the edge. Home is where the
//! shaft crosses it in that direction; a search that reaches the edge from the other side reverses there and crosses it again.
//! Eight plans suffice for all methods: each method is one of them or its mirror image (left and right are exchanged, and so
//! are the limit switches), with or without the index pulse.

use crate::slave::switches::Input;

/// The methods of [`Method::from_code`], for error texts.
pub const SUPPORTED: &str = "1..14, 17..30, 33, 34, 35, 37";

/// A direction of the shaft.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Increasing counts, "right" in CiA 402-2.
    Positive,
    /// Decreasing counts, "left" in CiA 402-2.
    Negative,
}

impl Direction {
    /// The opposite direction.
    pub const fn reversed(self) -> Self {
        match self {
            Self::Positive => Self::Negative,
            Self::Negative => Self::Positive,
        }
    }

    /// The opposite direction for a mirrored method, otherwise this direction.
    pub const fn mirrored_if(self, mirrored: bool) -> Self {
        if mirrored { self.reversed() } else { self }
    }

    /// 1 for positive, -1 for negative.
    pub const fn sign(self) -> f64 {
        match self {
            Self::Positive => 1.0,
            Self::Negative => -1.0,
        }
    }

    /// The limit switch at the end of the travel in this direction.
    pub const fn limit(self) -> Input {
        match self {
            Self::Positive => Input::PositiveLimit,
            Self::Negative => Input::NegativeLimit,
        }
    }
}

/// The switch edge that determines home.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// The switch that has the edge: a limit switch or the home switch.
    pub switch: Input,
    /// The direction in which the shaft has to cross the edge.
    pub moving: Direction,
    /// Whether the switch becomes active (true) or inactive (false) when it is crossed in that direction.
    pub rises: bool,
}

impl Edge {
    /// The direction towards the edge from a position where the switch is active.
    pub const fn from_within(self) -> Direction {
        if self.rises { self.moving.reversed() } else { self.moving }
    }
}

/// The search plan of a homing method that starts to the right if the switch is inactive. For a method that starts to
/// the left, [`Method::mirrored`] exchanges left and right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SearchPlan {
    /// Home is at the edge of a switch, or at the first index pulse after the edge.
    Edge {
        /// The edge that determines home.
        edge: Edge,
        /// Whether the positive limit switch reverses the search, once, instead of ending it with `HomingError::WrongLimit`.
        limit_reverses: bool,
    },
    /// Home is at the next index pulse.
    Index,
    /// Home is at the present position.
    Here,
}

/// A homing method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Method {
    /// The search plan before mirroring.
    pub plan: SearchPlan,
    /// Whether left and right are exchanged in the plan.
    pub mirrored: bool,
    /// Whether home is at the first index pulse after the edge instead of at the edge itself.
    pub index: bool,
}

impl Method {
    /// The method for a value of 0x6098: 1 to 14, 17 to 30, 33, 34, 35 and 37; `None` for an unsupported value.
    pub const fn from_code(code: i8) -> Option<Self> {
        let (plan, mirrored, index) = match code {
            33 | 34 => (SearchPlan::Index, code == 33, true),
            35 | 37 => (SearchPlan::Here, false, false),
            1..=14 => (edge_plan(code), is_mirrored(code), true),
            17..=30 => (edge_plan(code - 16), is_mirrored(code - 16), false),
            _ => return None,
        };
        Some(Self { plan, mirrored, index })
    }

    /// The first input that the method needs but that is not wired; `None` if all needed inputs are wired.
    pub fn missing(&self, is_wired: impl Fn(Input) -> bool) -> Option<Input> {
        let edge = match self.plan {
            SearchPlan::Edge { edge: Edge { switch: Input::PositiveLimit, .. }, .. } => [Some(self.ahead()), None],
            SearchPlan::Edge { edge, limit_reverses } => [Some(edge.switch), limit_reverses.then(|| self.ahead())],
            SearchPlan::Index | SearchPlan::Here => [None, None],
        };
        let index = self.index.then_some(Input::Index);
        edge.into_iter().chain([index]).flatten().find(|input| !is_wired(*input))
    }

    /// The limit switch in the starting direction of the method.
    fn ahead(&self) -> Input {
        Direction::Positive.mirrored_if(self.mirrored).limit()
    }
}

/// Whether a method of 1 to 14 starts to the left if the switch of its edge is inactive.
const fn is_mirrored(code: i8) -> bool {
    matches!(code, 1 | 5 | 6 | 11..=14)
}

/// The plan of a method of 1 to 14. A [mirrored](is_mirrored) method has the plan of its mirror image, which starts to the
/// right.
const fn edge_plan(code: i8) -> SearchPlan {
    use Direction::{Negative, Positive};
    let (switch, moving, rises) = match code {
        1 | 2 => (Input::PositiveLimit, Negative, false),
        3 | 5 | 7 | 11 => (Input::Home, Negative, false),
        4 | 6 | 8 | 12 => (Input::Home, Positive, true),
        9 | 13 => (Input::Home, Negative, true),
        _ => (Input::Home, Positive, false),
    };
    SearchPlan::Edge { edge: Edge { switch, moving, rises }, limit_reverses: code >= 7 }
}
