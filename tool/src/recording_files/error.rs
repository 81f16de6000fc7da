//! The errors of `ecmsk recording`.

use std::io;
use std::path::PathBuf;

use crate::filter::Times;
use crate::output_file::OutputFileError;
use crate::plot::style::list;

use super::export::endings;

/// Why a verb of `ecmsk recording` failed.
#[derive(Debug, thiserror::Error)]
pub enum RecordingVerbError {
    /// The extension of the output file does not name a format.
    #[error("{} has no ending that names a format; name it {}", .file.display(), endings())]
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
    /// `ecmsk recording export` cannot write a capture of another program as a recording, because a capture contains
    /// more than the frames of one board.
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
    /// The output file cannot be created, or exists and may not be replaced.
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
        /// The requested slave.
        axis: u8,
        /// The slaves that have columns.
        axes: Vec<u8>,
    },
    /// `ecmsk recording info --machine-file` was used on a recording without a machine file.
    #[error(
        "{} carries no machine file; a verb with --record writes one into its recording if it uses one, and so does `exec`",
        .file.display()
    )]
    NoMachineFile {
        /// The recording.
        file: PathBuf,
    },
    /// The recording has no report in OP, so a table would be empty.
    #[error(
        "{} has no report in OP ({times}), so that its table has no row; `ecmsk dump` shows its frames",
        .file.display()
    )]
    NoRow {
        /// The recording.
        file: PathBuf,
        /// The requested times.
        times: Times,
    },
    /// No frame is within the requested times, so a copy would be empty.
    #[error("{} has no frame ({times}); `ecmsk recording info` says how long it is", .file.display())]
    NoFrame {
        /// The recording.
        file: PathBuf,
        /// The requested times.
        times: Times,
    },
}

/// The numbers of slaves as text, or `none`.
fn or_none(slaves: &[u8]) -> String {
    if slaves.is_empty() { "none".to_owned() } else { list(slaves) }
}
