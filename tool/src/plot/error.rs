//! Errors of `ecmsk plot`.

use std::path::PathBuf;

use ecmsk::sk::SlotSize;

use super::{MAX_AXES, style};
use crate::output_file::OutputFileError;

/// Why no plot was made.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// Standard input is named, but a plot reads its recording twice.
    #[error("a plot cannot read standard input; name a file")]
    Stdin,
    /// `--find` for a picture, which has no list of events.
    #[error("--find lists events in a page, and a picture has no list; name a page with -o FILE.html")]
    FindNeedsPage,
    /// The expression of `--find` is wrong.
    #[error("--find: {0}; see `ecmsk find --help`")]
    Find(#[from] crate::find::ExpressionError),
    /// The network was never in OP.
    #[error(
        "{} has no response in OP ({frames} frames), and a plot shows what happens in OP; record a program that goes there, or look at this one with `ecmsk dump`",
        .file.display()
    )]
    NoOp {
        /// The path of the recording.
        file: PathBuf,
        /// The number of frames of the recording.
        frames: u64,
    },
    /// The recording has nothing in the requested range of times.
    #[error("no time in OP is left: {asked}, and the recording is in OP from {op}; change --from or --to")]
    NothingInRange {
        /// The requested range of times.
        asked: String,
        /// The range of times in which the network was in OP.
        op: String,
    },
    /// In the time shown, no slot of the chosen slaves has or answers a command listed in `--commands`.
    #[error(
        "nothing is left of {}: no slot asks for or answers {commands} in the time shown; change --commands, --axes, --from or --to", axes_list(.axes)
    )]
    NoSuchCommand {
        /// The command list of `--commands`.
        commands: String,
        /// The slaves whose slots were searched for the commands.
        axes: Vec<u8>,
    },
    /// More axes are requested than there are colours.
    #[error("{found} axes do not fit one plot, at most {MAX_AXES} do; name fewer with --axes")]
    TooManyAxes {
        /// The number of requested axes.
        found: usize,
    },
    /// The frames have too few slots for this axis.
    #[error("axis {axis} has no slot in frames of {}-byte slots; name axes from 1 to {} with --axes", .size.bytes(), .size.max_slaves())]
    NoSuchAxis {
        /// The number of the axis.
        axis: u8,
        /// The frames' slot size.
        size: SlotSize,
    },
    /// `--xy` names the same axis twice.
    #[error("the plane needs two axes, and both are axis {axis}; name another one with --xy")]
    SameAxis {
        /// The number of the slave.
        axis: u8,
    },
    /// The recording has no data of an axis.
    #[error("axis {axis} is empty: no slave has its slot in OP, and no command is for it; {}", others(.axes))]
    EmptyAxis {
        /// The number of the axis.
        axis: u8,
        /// The axes that have data.
        axes: Vec<u8>,
    },
    /// An IO slave is named as an axis of `--xy`.
    #[error("slave {slave} is IO and has no position; name two axes with --xy, as in --xy 1,2")]
    NotAnAxis {
        /// The number of the slave.
        slave: u8,
    },
    /// The diagram of two axes in their plane was requested, but the plot shows fewer than two axes.
    #[error("the plane needs two axes and the plot shows {found}; name them with --xy, as in --xy 1,2")]
    NoPlane {
        /// The number of axes of the plot.
        found: usize,
    },
    /// The recording has no data for the requested diagrams.
    #[error("the recording has nothing for the diagrams {asked}; name others with --panels, or leave it out")]
    NoPanel {
        /// The diagrams of `--panels`.
        asked: String,
    },
    /// The output file is the recording itself.
    #[error("the plot would replace the recording {}; name another file with {option}", .file.display())]
    SameFile {
        /// The path of the file.
        file: PathBuf,
        /// The option that names the file.
        option: &'static str,
    },
    /// The name of the output file has an unknown extension.
    #[error(
        "a plot is written as SVG (.svg) or PNG (.png), not as .{ending}: name such a file with {option}; programs such as rsvg-convert or Inkscape make other kinds from SVG"
    )]
    Ending {
        /// The extension without its dot.
        ending: String,
        /// The option that names the file.
        option: &'static str,
    },
    /// The output file cannot be written, or exists and may not be replaced.
    #[error(transparent)]
    File(#[from] OutputFileError),
    /// The picture cannot be drawn.
    #[error("cannot draw: {reason}; try fewer axes with --axes, or a shorter time with --from and --to")]
    Draw {
        /// The error of the drawing library.
        reason: String,
    },
}

/// Says which axes the user can request instead.
fn others(axes: &[u8]) -> String {
    match axes {
        [] => "leave --axes out, for the FIFO alone".to_owned(),
        axes => format!("name some of {} with --axes", style::list(axes)),
    }
}

fn axes_list(axes: &[u8]) -> String {
    match axes {
        [axis] => format!("axis {axis}"),
        axes => format!("axes {}", style::list(axes)),
    }
}
