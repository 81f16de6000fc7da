//! Why `ecmsk recording` fails.

use std::io;
use std::path::PathBuf;

use crate::filter::Times;
use crate::output_file::OutputFileError;
use crate::plot::style::list;

/// Why `ecmsk recording` fails.
#[derive(Debug, thiserror::Error)]
pub enum RecordingVerbError {
    /// The extension of the output file names no format.
    #[error("{} has no ending that names a format; name it .pcapng, .ecmrec, .csv, .mcap, .arrow or .feather", .file.display())]
    Ending {
        /// The output file.
        file: PathBuf,
    },
    /// The recording and the output file are the same.
    #[error("{} is the recording itself; name another file", .file.display())]
    SameFile {
        /// The recording, which is also the output file.
        file: PathBuf,
    },
    /// `ecmsk recording export` was to write a capture of another program as a recording. That is not possible, since a capture
    /// has more than the frames of one board.
    #[error(
        "{} is a capture of another program, which has more than frames of a board; verbs read it as it is, and it can be \
         exported as a table, such as .csv",
        .file.display()
    )]
    Capture {
        /// The capture.
        file: PathBuf,
    },
    /// The recording cannot be read.
    #[error("cannot read {}: {source}; look at the path and who may read it", .file.display())]
    Read {
        /// The recording.
        file: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The output file cannot be written.
    #[error("cannot write {}: {source}; name a file on a disk with room", .file.display())]
    Write {
        /// The output file.
        file: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// The output file cannot be made, or is there and stays.
    #[error(transparent)]
    File(#[from] OutputFileError),
    /// `--axes` names a slave for which the table has no columns.
    #[error(
        "{} has no slave {axis} in its first report in OP, but {}; name others with --axes",
        .file.display(), or_none(.axes)
    )]
    NoAxis {
        /// The recording.
        file: PathBuf,
        /// The slave that was asked for.
        axis: u8,
        /// The slaves that have columns.
        axes: Vec<u8>,
    },
    /// `ecmsk recording info --machine-file` for a recording that carries no machine file.
    #[error(
        "{} carries no machine file; a verb with --record writes one into its recording if it uses one, and so does `exec`",
        .file.display()
    )]
    NoMachineFile {
        /// The recording.
        file: PathBuf,
    },
    /// No report shows the board in OP, so a table would be empty.
    #[error(
        "{} has no report in OP ({times}), so that its table has no row; `ecmsk dump` shows its frames",
        .file.display()
    )]
    NoRow {
        /// The recording.
        file: PathBuf,
        /// The times that were asked for.
        times: Times,
    },
    /// No frame is within the times, so a copy would be empty.
    #[error("{} has no frame ({times}); `ecmsk recording info` says how long it is", .file.display())]
    NoFrame {
        /// The recording.
        file: PathBuf,
        /// The times that were asked for.
        times: Times,
    },
}

/// Numbers of slaves as text.
fn or_none(slaves: &[u8]) -> String {
    if slaves.is_empty() { "none".to_owned() } else { list(slaves) }
}
