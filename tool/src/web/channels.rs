//! The channels of a page. Each is a curve of a slave or of the board.

use std::collections::BTreeMap;

use serde::Serialize;

use super::codec::{self, Point};

/// The quantity that a channel shows over time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// The state byte of the board: the AL state, and whether a slave is lost or a state change has failed.
    AlState,
    /// The free entries of the FIFO.
    FifoFree,
    /// The full count: the number of command frames that found the FIFO full.
    FullCount,
    /// The statusword, 0x6041.
    Statusword,
    /// The error code, 0x603F.
    ErrorCode,
    /// The actual position in counts.
    Position,
    /// The executed target position in counts.
    Target,
    /// The actual position in counts in the recording of `--beside`.
    Beside,
    /// The following error in counts: the executed target minus the position.
    FollowingError,
    /// The velocity in counts per second, computed from actual positions.
    Velocity,
    /// The velocity in counts per second, computed from executed target positions.
    TargetVelocity,
    /// The target of CSV, in the drive's own unit.
    Csv,
    /// The torque in percent of the rated torque.
    Torque,
    /// The target of CST in percent of the rated torque.
    Cst,
    /// An input of an IO slave.
    Input,
    /// An output of an IO slave.
    Output,
}

impl Quantity {
    /// Whether a value of this quantity is valid until the next one, as for a state. The page then draws the curve with
    /// steps. Other curves connect their points by straight lines.
    pub const fn is_held(self) -> bool {
        !matches!(
            self,
            Self::Position
                | Self::Beside
                | Self::FollowingError
                | Self::Velocity
                | Self::TargetVelocity
                | Self::Torque
                | Self::FifoFree
        )
    }

    /// The unit of the integers in blocks of points: 0.125 counts per second for velocities, 0.1 % for torques,
    /// otherwise 1.
    pub const fn step(self) -> f64 {
        match self {
            Self::Velocity | Self::TargetVelocity => 0.125,
            Self::Torque | Self::Cst => 0.1,
            _ => 1.0,
        }
    }

    /// Whether the values are in counts or counts per second. If the axis has a unit, the page shows them in this unit.
    pub const fn is_scaled(self) -> bool {
        matches!(
            self,
            Self::Position | Self::Target | Self::Beside | Self::FollowingError | Self::Velocity | Self::TargetVelocity
        )
    }
}

/// The key of a channel: the slave (0: the board), the quantity, and the bit of an input or output (0 for other
/// quantities).
pub type Key = (u8, Quantity, u8);

/// The description of a channel that is sent to the page.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Channel {
    /// The number of the slave; 0: the board.
    pub slave: u8,
    /// The quantity that the channel shows.
    pub quantity: Quantity,
    /// The bit of an input or output; 0 for other quantities.
    pub bit: u8,
    /// The name of an input or output in the machine file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The page multiplies the integers of the channel's points by this factor, to get values in `unit`.
    pub factor: f64,
    /// The unit in which the page shows the values.
    pub unit: String,
    /// Whether a value is valid until the next one, see [`Quantity::is_held`].
    pub held: bool,
}

/// Gives channels their names, factors and units.
pub trait Naming {
    /// Describes the channel with this key: its name, factor and unit.
    fn channel(&self, key: Key) -> Channel;
}

/// The channels of a page, and the points since the last block.
#[derive(Debug, Default)]
pub struct Channels {
    list: Vec<Channel>,
    places: BTreeMap<Key, usize>,
    points: Vec<Vec<Point>>,
    /// The newest point of each channel.
    newest: Vec<Option<Point>>,
}

impl Channels {
    /// The channels so far, sorted by number.
    pub fn list(&self) -> &[Channel] {
        &self.list
    }

    /// The number of a channel in blocks of points. A new channel gets the next free number.
    pub fn place(&mut self, key: Key, naming: &impl Naming) -> usize {
        *self.places.entry(key).or_insert_with(|| {
            self.list.push(naming.channel(key));
            self.points.push(Vec::new());
            self.newest.push(None);
            self.list.len() - 1
        })
    }

    /// Adds a point to a channel, for the next block.
    pub fn push(&mut self, key: Key, naming: &impl Naming, point: Point) {
        let place = self.place(key, naming);
        self.points[place].push(point);
        self.newest[place] = Some(point);
    }

    /// A block with the newest point of each channel, for a new page; empty if there are no points.
    pub fn newest(&self) -> Vec<u8> {
        let mut block = Vec::new();
        for (place, point) in self.newest.iter().enumerate().filter_map(|(place, point)| Some((place, (*point)?))) {
            codec::append(&mut block, place, false, &[point]);
        }
        block
    }

    /// The points since the last call, as a block; empty if there are none.
    pub fn take_block(&mut self) -> Vec<u8> {
        let mut block = Vec::new();
        for (place, points) in self.points.iter_mut().enumerate().filter(|(_, points)| !points.is_empty()) {
            codec::append(&mut block, place, false, points);
            points.clear();
        }
        block
    }
}
