//! Why `ecmsk recording` fails.

use std::io;
use std::path::PathBuf;

use crate::filter::Times;

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
