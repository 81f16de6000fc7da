//! Pictures of several short sections of a recording. The recording is read only once for all of them.

use std::path::Path;

use ecmsk::ecm::Scale;
use ecmsk::machine_file::MachineFile;

use super::beside::Beside;
use super::chart::{Caption, Sheet};
use super::chosen::Asked;
use super::series::{Series, Subject};
use super::survey::Survey;
use super::{COLUMNS, MAX_AXES, Window, layout, svg};
use crate::error::CliError;
use crate::recording::Frames;

/// How long before the drawn section its frames are read, ns. \[OURS] Within this time the board has executed all
/// commands that were in the FIFO when reading began: at most 160 cycles of 12.5 ms.
const LEAD_NS: i64 = 2_000_000_000;

/// A section of a recording that is drawn as one picture.
pub struct Stretch {
    /// What the picture shows, as its title.
    pub title: String,
    /// The time range of the section in nanoseconds of the recording's time: `from_ns` to `to_ns`.
    pub from_ns: i64,
    pub to_ns: i64,
    /// The axes by slave number. If there are more than a plot can show ([`MAX_AXES`]), only the first ones are drawn.
    pub axes: Vec<u8>,
}

/// Draws the sections as SVG: the targets, positions, following difference and torque of their axes, and the FIFO.
/// `survey` must be of the same recording. The result has `None` for a section without a time in OP.
///
/// # Errors
/// [`CliError`] if the recording cannot be read, or drawing fails.
pub fn pictures(
    file: &Path,
    frames: Frames<impl std::io::Read + Send>,
    survey: &Survey,
    stretches: &[Stretch],
    machine: Option<&MachineFile>,
) -> Result<Vec<Option<String>>, CliError> {
    let Some(op) = survey.op() else { return Ok(stretches.iter().map(|_| None).collect()) };
    let mut series: Vec<_> = stretches.iter().map(|stretch| Drawn::new(stretch, op, survey, machine)).collect();
    let until_ns = series.iter().flatten().map(|drawn| drawn.window.read_until_ns()).max().unwrap_or(i64::MIN);
    frames.quiet().walk(until_ns, |framed| {
        for drawn in series.iter_mut().flatten() {
            let from_ns = drawn.window.from_ns.saturating_sub(LEAD_NS);
            let is_near = from_ns <= framed.time_ns && framed.time_ns <= drawn.window.read_until_ns();
            // The frames before OP are read too, because their commands show the kinds of the slaves.
            if is_near || framed.time_ns < op.from_ns {
                drawn.series.frame(framed);
            }
        }
    })?;
    series
        .into_iter()
        .zip(stretches)
        .map(|(drawn, stretch)| drawn.map(|drawn| drawn.svg(file, stretch, machine)).transpose())
        .collect()
}

/// A section whose curves are being collected while frames are read.
struct Drawn {
    window: Window,
    axes: Vec<u8>,
    series: Series,
}

impl Drawn {
    fn new(stretch: &Stretch, op: Window, survey: &Survey, machine: Option<&MachineFile>) -> Option<Self> {
        let window = Window { from_ns: stretch.from_ns.max(op.from_ns), to_ns: stretch.to_ns.min(op.to_ns) };
        if window.from_ns > window.to_ns {
            return None;
        }
        let scale = |axis| machine.and_then(|machine| machine.axis_of(axis)).map_or(Scale::COUNTS, |axis| axis.scale);
        let axes: Vec<u8> = stretch.axes.iter().copied().take(MAX_AXES).collect();
        let scaled: Vec<(u8, Scale)> = axes.iter().map(|axis| (*axis, scale(*axis))).collect();
        let series = Series::new(&Subject {
            window,
            columns: COLUMNS,
            axes: &scaled,
            ios: &[],
            plane: None,
            board: survey.board(),
            cycle_ns: survey.cycle_ns(),
            commands: Vec::new(),
        });
        Some(Self { window, axes, series })
    }

    fn svg(self, file: &Path, stretch: &Stretch, machine: Option<&MachineFile>) -> Result<String, CliError> {
        let asked = Asked { difference: true, ..Asked::default() };
        let names = layout::Names::of_machine(&self.axes, machine);
        let panels = layout::panels(self.series.finish(), &asked, None, &names, Beside::default());
        let about = format!("{} of {}", self.window, file.display());
        let caption = Caption { title: stretch.title.clone(), about, range: self.window.range(), axis: "time (s)" };
        Ok(svg::write(&Sheet { panels, caption })?)
    }
}
