//! A second recording of the same program, drawn for comparison with the first one.

use std::path::{Path, PathBuf};

use ecmsk::ecm::Scale;
use ecmsk::recording::{Address, RecordError};
use ecmsk::sk::SlotSize;

use super::decimate::Pieces;
use super::series::{Series, Subject};
use super::states::{Span, State};
use super::survey::Survey;
use super::{PlotError, Window, seconds, style};
use crate::error::CliError;
use crate::filter::Times;
use crate::recording::{self, Frames, Walked};

/// The space for the name of the second recording in a legend, in pixels.
const NAME_WIDTH: u32 = 330;

/// The curves of the second recording, with their times converted to those of the first one.
#[derive(Default)]
pub struct Beside {
    /// The name of the second recording in legends.
    pub name: String,
    /// The positions of each axis, in units.
    pub positions: Vec<(u8, Pieces)>,
    /// The time spans in which each axis had a fault.
    pub faults: Vec<(u8, Vec<Span>)>,
    /// For each axis that was homed: the time at which homing last gave the position a new zero, in seconds.
    pub zeroed: Vec<(u8, f64)>,
}

/// The second recording after its first reading, which determines its slaves and its time in OP.
pub struct Other {
    file: PathBuf,
    size: Option<SlotSize>,
    device: Option<Address>,
    survey: Survey,
    /// What has ended the recording before its end; `None` if it is whole.
    damage: Option<RecordError>,
    /// The offset that is added to the times of the second recording, so that OP begins at the same time in both, ns.
    later_ns: i64,
    /// The time range of the second recording in OP, with [`Self::later_ns`] added.
    window: Window,
}

impl Other {
    /// Reads the second recording for the first time. `first` is the time range of the first recording in OP; the
    /// second one is aligned with it.
    pub fn read(file: &Path, size: Option<SlotSize>, first: Window) -> Result<Self, CliError> {
        let mut survey = Survey::default();
        let device = recording::board(file, None)?;
        let Walked { frames, damage, .. } =
            Frames::open(file, size, device)?.quiet().walk(i64::MAX, |framed| survey.frame(framed))?;
        let Some(op) = survey.op() else {
            let no_op = PlotError::NoOp { file: file.to_owned(), frames };
            return Err(damage.map_or(no_op.into(), CliError::from));
        };
        let later_ns = first.from_ns - op.from_ns;
        let window = Window::of_times(op.from_ns + later_ns, op.to_ns + later_ns);
        Ok(Self { file: file.to_owned(), size, device, survey, damage, later_ns, window })
    }

    /// Restricts the second recording to `times`, given as times of the first one; `None` if nothing is left.
    pub fn cut(self, times: Times) -> Option<Self> {
        let window = self.window.cut(times)?;
        Some(Self { window, ..self })
    }

    /// What has ended the recording before its end; `None` if it is whole.
    pub const fn damage(&self) -> Option<&RecordError> {
        self.damage.as_ref()
    }

    /// The time range of the second recording in OP, converted to times of the first one.
    pub const fn window(&self) -> Window {
        self.window
    }

    /// Reads the recording again and returns the positions and faults of these axes.
    pub fn lines(&self, axes: &[(u8, Scale)]) -> Result<Beside, CliError> {
        let Self { file, size, device, survey, later_ns, window, .. } = self;
        let own = Window::of_times(window.from_ns - later_ns, window.to_ns - later_ns);
        let mut series = Series::new(&Subject {
            window: own,
            columns: super::COLUMNS,
            axes,
            ios: &[],
            plane: None,
            board: survey.board(),
            cycle_ns: survey.cycle_ns(),
            commands: Vec::new(),
        });
        let mut recording = Frames::open(file, *size, *device)?.quiet();
        recording.walk(own.read_until_ns(), |framed| series.frame(framed))?;
        let link = survey.link().and_then(|link| link.split('?').next().map(str::to_owned));
        let name = link.unwrap_or_else(|| file.display().to_string());
        let mut beside = Beside { name: style::fitting(&name, style::TEXT, NAME_WIDTH), ..Beside::default() };
        let later = seconds(*later_ns);
        for axis in series.finish().axes {
            let moved =
                |piece: Vec<(f64, f64)>| piece.into_iter().map(|(at, position)| (at + later, position)).collect();
            beside.positions.push((axis.axis, axis.position.into_iter().map(moved).collect()));
            beside.zeroed.extend(axis.zeroed.map(|at| (axis.axis, at + later)));
            let faults = axis.states.into_iter().filter(|span| span.state == State::Fault);
            let named = |Span { state, from, to, note }: Span| Span {
                state,
                from: from + later,
                to: to + later,
                note: note.map(|note| note.of(&beside.name)),
            };
            beside.faults.push((axis.axis, faults.map(named).collect()));
        }
        Ok(beside)
    }
}
