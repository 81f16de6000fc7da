//! Selects the slaves and diagrams of a plot.

use clap::ValueEnum;
use ecmsk::machine_file::MachineFile;

use super::error::PlotError;
use super::survey::Survey;
use super::{MAX_AXES, style};
use crate::board::{AxisWord, BoardError};
use crate::filter::Slaves;
use crate::stderr::say;

/// The diagrams that a plot can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Diagram {
    /// Target and actual position of each axis
    Position,
    /// Velocity of the positions and of the targets; targets of CSV
    Velocity,
    /// Following difference: the target in force minus the actual position
    Difference,
    /// Torque, and targets of CST
    Torque,
    /// Inputs and outputs of IO slaves
    Io,
    /// Free entries of the FIFO
    Fifo,
    /// Path of two axes in their plane
    Xy,
}

/// The slaves and diagrams that the options request, before the recording is read.
#[derive(Clone, Debug, Default)]
pub struct Asked {
    /// The slaves in ascending order; if empty, those found in the recording.
    pub slaves: Vec<u8>,
    /// The diagrams; if empty, those for which the recording has data.
    pub diagrams: Vec<Diagram>,
    /// Whether the following error is drawn in addition.
    pub difference: bool,
    /// The two axes whose path in the plane is drawn in addition, one horizontally and one vertically.
    pub plane: Option<[u8; 2]>,
    /// The machine file, with names and units of axes.
    pub machine: Option<MachineFile>,
}

/// The slaves that are drawn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chosen {
    /// The axes, by slave number.
    pub axes: Vec<u8>,
    /// The IO slaves, by slave number.
    pub ios: Vec<u8>,
    /// The two axes whose path in the plane is drawn.
    pub plane: Option<[u8; 2]>,
}

impl Asked {
    /// Whether a diagram is drawn. `by_itself`: its default if the options request no diagrams.
    pub fn shows(&self, diagram: Diagram, by_itself: bool) -> bool {
        match diagram {
            Diagram::Difference if self.difference => true,
            Diagram::Xy if self.plane.is_some() => true,
            _ if self.diagrams.is_empty() => by_itself,
            _ => self.diagrams.contains(&diagram),
        }
    }

    /// The requested slaves, or those found in the recording.
    pub fn choose(&self, survey: &Survey, room: Room) -> Result<Chosen, PlotError> {
        let size = survey.size();
        let named = || self.slaves.iter().copied().chain(self.plane.into_iter().flatten());
        if let Some(axis) = named().find(|axis| usize::from(*axis) > size.max_slaves()) {
            return Err(PlotError::NoSuchAxis { axis, size });
        }
        if let Some(axis) = named().find(|axis| survey.is_empty(*axis)) {
            return Err(PlotError::EmptyAxis { axis, axes: survey.known() });
        }
        if let Some(slave) = self.plane.into_iter().flatten().find(|axis| survey.is_io(*axis)) {
            return Err(PlotError::NotAnAxis { slave });
        }
        let (mut ios, mut axes): (Vec<u8>, Vec<u8>) = if self.slaves.is_empty() {
            (survey.lively_ios(), survey.axes())
        } else {
            self.slaves.iter().partition(|slave| survey.is_io(**slave))
        };
        if axes.len() > room.axes {
            let (all, shown) = (axes.len(), style::list(&axes[..room.axes]));
            say("note", &format_args!("{all} axes, of which the plot shows {shown}; choose others with --axes"));
            axes.truncate(room.axes);
        }
        // The two axes of `--xy` are always shown.
        for axis in self.plane.into_iter().flatten().filter(|axis| !axes.contains(axis)).collect::<Vec<_>>() {
            if axes.len() == room.axes {
                return Err(PlotError::TooManyAxes { found: room.axes + 1 });
            }
            axes.push(axis);
        }
        axes.sort_unstable();
        let room = room.slaves - axes.len();
        if ios.len() > room {
            let shown = style::list(&ios[..room]);
            say(
                "note",
                &format_args!("{} IO slaves, of which the plot shows {shown}; choose others with --axes", ios.len()),
            );
            ios.truncate(room);
        }
        let plane = match (self.plane, &axes[..]) {
            (plane @ Some(_), _) => plane,
            _ if !self.diagrams.contains(&Diagram::Xy) => None,
            (None, [x, y, ..]) => Some([*x, *y]),
            (None, axes) => return Err(PlotError::NoPlane { found: axes.len() }),
        };
        Ok(Chosen { axes, ios, plane })
    }
}

/// How many slaves are drawn at most.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    /// The largest number of axes.
    pub axes: usize,
    /// The largest number of axes and IO slaves together.
    pub slaves: usize,
}

impl Room {
    /// The limits of a picture: each axis has a colour of its own.
    pub const PICTURE: Self = Self { axes: MAX_AXES, slaves: 2 * MAX_AXES };
}

/// Slaves on the command line: numbers and ranges, or the name of an axis.
#[derive(Clone, Debug)]
pub enum AxesWord {
    Slaves(Slaves),
    Name(AxisWord),
}

impl AxesWord {
    /// Parses `3`, `3-5` or `X`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        match AxisWord::parse(text) {
            Some(word) if word.is_name() => Ok(Self::Name(word)),
            _ => Slaves::parse(text).map(Self::Slaves),
        }
    }

    /// The numbers of the slaves.
    ///
    /// # Errors
    /// The machine file does not have the axis.
    pub fn slaves(&self, machine: Option<&MachineFile>) -> Result<Vec<u8>, BoardError> {
        match self {
            Self::Slaves(slaves) => Ok(slaves.numbers().collect()),
            Self::Name(word) => Ok(vec![word.slave("plot", machine)?]),
        }
    }
}

/// Parses two axes, `1,2` or `X,Y`.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn plane(text: &str) -> Result<[AxisWord; 2], String> {
    let axes: Option<Vec<AxisWord>> = text.split(',').map(AxisWord::parse).collect();
    match axes.map(<[AxisWord; 2]>::try_from) {
        Some(Ok(axes)) if axes[0] != axes[1] => Ok(axes),
        _ => Err("allowed: two axes from 1 to 40, as in 1,2; the first goes from left to right".to_owned()),
    }
}
