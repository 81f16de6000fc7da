//! The EC01M: an exact model of the chip over any [`crate::fieldbus::Fieldbus`]. Plain data and pure steps.

mod counters;

pub use counters::{Counters, Reason, Rejection};
