//! The file of a picture; its name decides the format.

use std::fs;
use std::path::Path;

use super::chart::Sheet;
use super::{PlotError, png, svg};
use crate::recording::is_same_file;

/// The format of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Scalable vector graphics.
    Svg,
    /// A bitmap.
    Png,
}

impl Format {
    /// The format for the file's extension; without one SVG. `option` is the option that names the file, for the error.
    ///
    /// # Errors
    /// The extension is unknown: a file named `.jpg` must not contain SVG.
    pub fn of(file: &Path, option: &'static str) -> Result<Self, PlotError> {
        let Some(ending) = file.extension() else { return Ok(Self::Svg) };
        match ending.to_string_lossy().to_ascii_lowercase().as_str() {
            "svg" => Ok(Self::Svg),
            "png" => Ok(Self::Png),
            other => Err(PlotError::Ending { ending: other.to_owned(), option }),
        }
    }

    /// Draws a picture and returns the bytes of its file in this format.
    ///
    /// # Errors
    /// The picture cannot be drawn.
    pub fn write(self, sheet: &Sheet) -> Result<Vec<u8>, PlotError> {
        match self {
            Self::Svg => svg::write(sheet).map(String::into_bytes),
            Self::Png => png::write(sheet),
        }
    }
}

/// Checks the output file before anything is read or drawn: its format, and that it is not one of the recordings. `option`
/// is the option that names the output file, for the error.
///
/// # Errors
/// The file has an unknown extension, or is one of the recordings.
pub fn check(file: &Path, option: &'static str, recordings: &[&Path]) -> Result<Format, PlotError> {
    check_other(file, option, recordings)?;
    Format::of(file, option)
}

/// Checks that the output file is not one of the recordings.
///
/// # Errors
/// [`PlotError::SameFile`] if the file is one of the recordings.
pub fn check_other(file: &Path, option: &'static str, recordings: &[&Path]) -> Result<(), PlotError> {
    if recordings.iter().any(|recording| is_same_file(file, recording)) {
        return Err(PlotError::SameFile { file: file.to_owned(), option });
    }
    Ok(())
}

/// Writes a picture to a file, which must not be one of the recordings. `option` is the option that names the file, for the
/// error.
///
/// # Errors
/// The file has an unknown extension, is one of the recordings, or cannot be written; or the picture cannot be drawn.
pub fn save(file: &Path, option: &'static str, recordings: &[&Path], sheet: &Sheet) -> Result<(), PlotError> {
    let bytes = check(file, option, recordings)?.write(sheet)?;
    fs::write(file, bytes).map_err(|source| PlotError::Write { file: file.to_owned(), option, source })
}
