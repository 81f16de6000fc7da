//! Why there is no plot.

use std::io;
use std::path::PathBuf;

use ecmsk::sk::SlotSize;

use super::{MAX_AXES, style};

/// Why there is no plot.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// A plot reads its recording twice.
    #[error("a plot cannot read standard input; name a file")]
    Stdin,
    /// The network never ran.
    #[error(
        "{} has no response in OP ({frames} frames), and a plot shows what happens in OP; record a program that goes there, or look at this one with `ecmsk dump`",
        .file.display()
    )]
    NoOp {
        /// The recording.
        file: PathBuf,
        /// Frames it has.
        frames: u64,
    },
    /// The times asked for lie elsewhere.
    #[error("no time in OP is left: {asked}, and the recording is in OP from {op}; change --from or --to")]
    NothingInRange {
        /// The times asked for.
        asked: String,
        /// The times there are.
        op: String,
    },
    /// The slaves never had one of these commands.
    #[error(
        "nothing is left of {}: no slot asks for or answers {commands} in the time shown; change --commands, --axes, --from or --to", axes_list(.axes)
    )]
    NoSuchCommand {
        /// Those asked for.
        commands: String,
        /// The slaves looked at.
        axes: Vec<u8>,
    },
    /// More than colours.
    #[error("{found} axes do not fit one plot, at most {MAX_AXES} do; name fewer with --axes")]
    TooManyAxes {
        /// Axes asked for.
        found: usize,
    },
    /// There is nothing of that axis.
    #[error("axis {axis} has no slot in frames of {}-byte slots; name axes from 1 to {} with --axes", .size.bytes(), .size.max_slaves())]
    NoSuchAxis {
        /// The axis.
        axis: u8,
        /// The frames' slot size.
        size: SlotSize,
    },
    /// An axis that the recording says nothing of.
    #[error("axis {axis} is empty: no slave has its slot in OP, and no command is for it; {}", others(.axes))]
    EmptyAxis {
        /// The axis.
        axis: u8,
        /// Those that are not.
        axes: Vec<u8>,
    },
    /// An IO slave is no axis of a plane.
    #[error("slave {slave} is IO and has no position; name two axes with --xy, as in --xy 1,2")]
    NotAnAxis {
        /// The slave.
        slave: u8,
    },
    /// A plane has two axes.
    #[error("the plane needs two axes and the plot shows {found}; name them with --xy, as in --xy 1,2")]
    NoPlane {
        /// Axes of the plot.
        found: usize,
    },
    /// None of the diagrams asked for has anything in it.
    #[error("the recording has nothing for the diagrams {asked}; name others with --panels, or leave it out")]
    NoPanel {
        /// Those asked for.
        asked: String,
    },
    /// The plot would replace the recording.
    #[error("the plot would replace the recording {}; name another file with {option}", .file.display())]
    SameFile {
        /// The file.
        file: PathBuf,
        /// What names it.
        option: &'static str,
    },
    /// A kind of file that is not made.
    #[error(
        "a plot is written as SVG (.svg) or PNG (.png), not as .{ending}: name such a file with {option}; programs such as rsvg-convert or Inkscape make other kinds from SVG"
    )]
    Ending {
        /// How the file's name ends.
        ending: String,
        /// What names it.
        option: &'static str,
    },
    /// The plot cannot be written.
    #[error("cannot write {}: {source}; name another file with {option}", .file.display())]
    Write {
        /// The file.
        file: PathBuf,
        /// What names it.
        option: &'static str,
        /// The system's words.
        source: io::Error,
    },
    /// The picture could not be made.
    #[error("cannot draw: {reason}; try fewer axes with --axes, or a shorter time with --from and --to")]
    Draw {
        /// The library's words.
        reason: String,
    },
}

/// What can be asked for instead.
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
